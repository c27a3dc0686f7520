"""How a command ends that is not allowed to finish: signals, streams that are closed or full, memory that is gone."""

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

from simwarp import cli
from simwarp.cli import Command, ShortfallError, process
from simwarp.cli.options import CommonOptions


@pytest.fixture
def ends_with(monkeypatch, capfd):
    """Run a command whose work is the given function: exit code and standard error."""

    def run(work, *arguments):
        monkeypatch.setattr(Command, "load", lambda self: lambda words: work())
        monkeypatch.setattr("simwarp.core.warp_start.start_warp", lambda: None)
        code = cli.main(["list", *arguments])
        return code, capfd.readouterr().err

    return run


def raises(error):
    def work():
        raise error

    return work


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_end_a_command_as_ctrl_c_does(ends_with, number, tmp_path):
    from simwarp.core.files import DRAFT_PREFIX, replacing

    before = signal.getsignal(number)

    def work():
        with replacing(tmp_path / "a.txt") as draft:
            draft.write_text("half")
            os.kill(os.getpid(), number)
            signal.sigtimedwait([], 5)
        return 0

    assert ends_with(work) == (130, "simwarp: interrupted\n")
    assert signal.getsignal(number) is before is signal.SIG_DFL
    assert not list(tmp_path.glob(f"{DRAFT_PREFIX}*"))
    assert not (tmp_path / "a.txt").exists()


def test_handlers_of_others_are_left_alone(ends_with):
    def handler(number, frame):
        pass

    signal.signal(signal.SIGTERM, handler)
    try:
        assert ends_with(lambda: int(signal.getsignal(signal.SIGTERM) is not handler))[0] == 0
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Ending:
    """Is asked to end while it is taken away, where Python drops what is raised."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)


def test_a_signal_that_comes_where_exceptions_are_dropped_ends_the_command(ends_with):
    def command():
        ending = Ending()
        del ending
        end = time.monotonic() + 20.0  # the signal comes again after a twentieth of a second
        while time.monotonic() < end:
            time.sleep(0.01)
        return 0

    before = sys.unraisablehook
    code, err = ends_with(command)
    assert (code, err) == (130, "simwarp: interrupted\n")
    assert sys.unraisablehook is before


INTERRUPTED = """
import atexit, sys, threading, time
from simwarp import cli

class Library:
    def __del__(self):
        print("taken apart", flush=True)

def load(command):
    raise KeyboardInterrupt

library = Library()
atexit.register(print, "exit function")
threading.Thread(target=lambda: (time.sleep(0.2), print("thread"))).start()
cli.Command.load = load
sys.argv = ["simwarp", "list"]
sys.exit(cli.main())
"""


def test_an_interrupted_process_ends_without_taking_half_loaded_libraries_apart():
    """Some of them abort when they are: then the exit code would be that of SIGABRT."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, "simwarp: interrupted\n")
    assert done.stdout.splitlines() == ["thread", "exit function"]


DONE = """
import os, signal, sys
from simwarp import cli

class Library:
    def __del__(self):
        os.kill(os.getpid(), signal.{name})

library = Library()
cli.Command.load = lambda command: lambda words: {code}
import simwarp.core.warp_start
simwarp.core.warp_start.start_warp = lambda: None
sys.argv = ["simwarp", "list"]
sys.exit(cli.main())
"""


def test_copies_of_a_signal_are_one_line(ends_with):
    """As `timeout` and batch systems send them: also while the first one is told, and files are removed."""

    def work():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(20.0)
        finally:
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
                signal.raise_signal(number)

    assert ends_with(work) == (130, "simwarp: interrupted\n")


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "SIGHUP"])
@pytest.mark.parametrize("code", [0, 1])
def test_a_signal_after_the_work_changes_nothing(name, code):
    """While Python takes its modules apart, a signal would end it by that signal, as if nothing had been done."""
    done = subprocess.run([sys.executable, "-c", DONE.format(name=name, code=code)], capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (code, b"")


def test_an_interruption_while_a_command_is_loaded_is_one_line(monkeypatch, capfd):
    monkeypatch.setattr(Command, "load", lambda self: raises(KeyboardInterrupt())())
    assert cli.main(["list"]) == 130
    assert capfd.readouterr().err == "simwarp: interrupted\n"


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (MemoryError(), 2, "not enough memory: an allocation failed; use fewer worlds"),
        (MemoryError("Unable to allocate 8 TiB"), 2, "not enough memory: Unable to allocate 8 TiB"),
        (RuntimeError("Failed to allocate 12 bytes on device 'cuda:0'"), 2, "not enough memory: Failed to allocate"),
        (OSError(28, "No space left on device", "a.bin"), 1, "'a.bin': No space left on device"),
        (OSError(28, "No space left on device"), 1, "standard output: No space left on device"),
        (OSError("cannot identify image file"), 1, "cannot identify image file"),
        (ShortfallError("cold start failed"), 1, "cold start failed"),
        (cli.UsageError("x" * 10**6), 2, "xxxx ..."),
        (cli.UsageError("two\nlines"), 2, "simwarp: two lines\n"),
        (cli.UsageError("\x1b[2J \udcff é"), 2, "simwarp: \\x1b[2J \\udcff é\n"),
    ],
)
def test_what_is_no_mistake_of_ours_is_one_line(ends_with, error, code, words):
    got, err = ends_with(raises(error))
    assert got == code
    assert words in err
    assert err.count("\n") == 1
    assert len(err) < 2200


@pytest.mark.parametrize("error", [RuntimeError("a bug"), TypeError("a bug"), OSError(28, "full")])
def test_mistakes_of_ours_and_debug_show_the_traceback(ends_with, error):
    with pytest.raises(type(error)):
        ends_with(raises(error), "--debug")
    if not isinstance(error, OSError):
        with pytest.raises(type(error)):
            ends_with(raises(error))


def test_a_kernel_cache_that_cannot_be_is_one_line_with_the_remedy(monkeypatch, capfd):
    monkeypatch.setattr(
        "simwarp.core.warp_start.start_warp", raises(PermissionError(13, "Permission denied", "/cache"))
    )
    assert cli.main(["verify", "--list"]) == 1
    assert capfd.readouterr().err == (
        "simwarp: the folder '/cache' of compiled kernels cannot be used: Permission denied; "
        "set WARP_CACHE_PATH to a folder of your own\n"
    )


def shell(text):
    """Run a line of the shell in which S is the command: exit code, standard output, standard error."""
    line = f'S() {{ "{sys.executable}" -m simwarp "$@"; }}; {text}'
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
def test_a_full_standard_output_is_one_line_and_code_one():
    assert shell("S --help > /dev/full") == (
        1, "", "simwarp: cannot write or read standard output: No space left on device\n",
    )  # fmt: skip
    assert shell("S bogus 2> /dev/full") == (2, "", "")


def test_closed_streams_are_no_files_of_others(tmp_path, monkeypatch):
    assert shell("S --version >&-") == (0, "", "")
    assert shell("S bogus 2>&-") == (2, "", "")
    # a file would get number 1, and with it all that is printed
    code = "import sys; from simwarp.cli.process import prepare_streams; prepare_streams();"
    code += " file = open(sys.argv[1], 'w'); file.write(str(file.fileno())); print('no', file=sys.stderr)"
    assert shell(f'"{sys.executable}" -c "{code}" {tmp_path}/a.txt <&- >&- 2>&-') == (0, "", "")
    assert int((tmp_path / "a.txt").read_text()) > 2
    monkeypatch.setattr(sys, "stdout", None)
    with pytest.raises(cli.UsageError, match="standard output, which is closed; name a file"):
        CommonOptions(json="-").check()


def test_a_reader_that_goes_away_ends_a_command_with_nothing_said(ends_with, monkeypatch):
    for tell in (print, Console().print):
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write, "w") as stream:
            monkeypatch.setattr(sys, "stdout", stream)
            assert ends_with(lambda tell=tell: tell("words")) == (0, "")


def test_a_stream_that_is_not_utf_8_takes_all_text(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    process.prepare_streams()
    print("5 µm", flush=True)
    assert stream.buffer.getvalue() == b"5 \\xb5m\n"


def test_doctor_weighs_a_cache_that_other_processes_work_in(tmp_path, monkeypatch):
    import warp as wp

    from simwarp.cli.doctor import examine_cache

    for name in ("kept", "gone"):
        (tmp_path / name).write_bytes(bytes(2**25))
    look = Path.lstat
    monkeypatch.setattr(Path, "lstat", lambda self: look(self) if self.name == "kept" else look(self / "gone"))
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    facts, problems = examine_cache()
    assert facts["size_gib"] == pytest.approx(2**25 / 2**30, abs=1e-3)
    assert problems == []
