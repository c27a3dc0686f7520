"""Files: written whole or not at all, devices and FIFOs written to, symlinks kept, hostile JSON refused in one line."""

import os
import resource
import shutil
import stat
import threading
from pathlib import Path

import pytest

from simwarp.core.files import FileError, OutputError, check_output, parse_json, read_json, replacing, write_file


def left_over(folder: Path) -> list[str]:
    """Drafts that somebody forgot."""
    return [path.name for path in folder.iterdir() if path.name.startswith(".simwarp-")]


def test_new_file_gets_the_umask_and_an_old_one_keeps_its_permissions(tmp_path: Path) -> None:
    umask = os.umask(0o027)
    try:
        write_file(tmp_path / "new.txt", "x")
    finally:
        os.umask(umask)
    assert stat.S_IMODE((tmp_path / "new.txt").stat().st_mode) == 0o640
    (tmp_path / "new.txt").chmod(0o604)
    write_file(tmp_path / "new.txt", "y")
    assert (tmp_path / "new.txt").read_text() == "y"
    assert stat.S_IMODE((tmp_path / "new.txt").stat().st_mode) == 0o604


def test_a_symlink_stays_and_its_target_is_replaced(tmp_path: Path) -> None:
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    target.write_text("old")
    link.symlink_to(target)
    write_file(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_dangling_symlink_makes_its_target(tmp_path: Path) -> None:
    link = tmp_path / "link.txt"
    link.symlink_to(tmp_path / "missing.txt")
    write_file(link, "new")
    assert link.is_symlink()
    assert (tmp_path / "missing.txt").read_text() == "new"


def test_a_device_is_written_to(tmp_path: Path) -> None:
    write_file("/dev/null", "gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_fifo_hands_the_bytes_to_its_reader(tmp_path: Path) -> None:
    fifo = tmp_path / "pipe"
    os.mkfifo(fifo)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(fifo.read_bytes()))
    reader.start()
    content = b"0123456789" * 100_000  # more than a pipe holds
    write_file(fifo, content)
    reader.join(timeout=30)
    assert got == [content]
    assert stat.S_ISFIFO(fifo.stat().st_mode)


def test_a_fifo_without_a_reader_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simwarp.core.files.WAIT_FOR_READER", 0.1)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileError, match="nobody reads"):
        write_file(tmp_path / "pipe", "x")


def test_a_failure_in_the_block_leaves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")

    def fail() -> None:
        with replacing(tmp_path / "a.txt") as draft:
            draft.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert not left_over(tmp_path)


def test_a_limit_of_file_sizes_is_told_and_the_old_file_stays(tmp_path: Path) -> None:
    write_file(tmp_path / "a.bin", b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OutputError, match=r"a\.bin.*0\.005 MB needed.*are free in .*ulimit"):
            write_file(tmp_path / "a.bin", bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (tmp_path / "a.bin").read_bytes() == b"old"
    assert not left_over(tmp_path)


def test_a_folder_that_vanishes_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()

    def write() -> None:
        with replacing(folder / "a.txt") as draft:
            draft.write_text("x")
            shutil.rmtree(folder)

    with pytest.raises(OutputError, match=r"folder .*run is gone"):
        write()


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "must name a file"),
        (".", "is a folder"),
        ("missing/a.txt", "does not exist"),
        ("file/a.txt", "Not a directory"),
        ("x" * 256, "longer than 255 bytes"),
        ("ü" * 128, "longer than 255 bytes"),
        ("a\0b", "must name a file"),
        ("a\ud800b", "must name a file"),
        ("loop", "symbolic links"),
    ],
)
def test_what_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("x")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(FileError, match=reason):
        check_output(name, "--output")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[" * 100_000, "nested too deep"),
        ('{"a":' * 100_000, "nested too deep"),
        ("[" * 101 + "]" * 101, "more than 100 levels"),
        ("{" + "".join(f'"{index}": 1, ' for index in range(50_000)) + '"7": 2}', "7: given twice"),
        ("9" * 400, "beyond 64 bits"),
        ("9" * 5000, "beyond 64 bits"),
        (f"{2**63}", "beyond 64 bits"),
        ("1e308", "beyond float32"),
        ("-1e999", "beyond float32"),
        ("1." + "0" * 400 + "e99", "beyond float32"),
        ('{"a": 1, "a": 2}', "a: given twice"),
        ("{", "line 1 column"),
        ("", "line 1 column 1"),
    ],
)
def test_json_that_no_array_can_hold_is_refused(text: str, reason: str) -> None:
    with pytest.raises(FileError, match=reason):
        parse_json(text, "file 'a.json'")


def test_what_is_no_text_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "latin.json").write_bytes(b'{"a": "\xe9"}')
    os.mkfifo(tmp_path / "pipe.json")
    for path, reason in (
        (tmp_path / "latin.json", "not UTF-8 text at byte 7"),
        (tmp_path / "pipe.json", "no regular file"),
        (tmp_path / "none.json", "does not exist"),
        (tmp_path, "is a folder"),
        (Path("/dev/zero"), "no regular file"),
        (tmp_path / ("x" * 300), "File name too long"),
    ):
        with pytest.raises(FileError, match=reason):
            read_json(path, "vehicle file")


def test_ordinary_json_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"a": [1, -2.5e3, true, null], "b": 9223372036854775807}')
    assert parse_json("[" * 100 + "]" * 100, "text") == [parse_json("[" * 99 + "]" * 99, "text")]
    assert read_json(tmp_path / "a.json") == {"a": [1, -2500.0, True, None], "b": 2**63 - 1}
