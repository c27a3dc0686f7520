"""Files: read with limits, written whole or not at all, and every failure reported in one line.

Every room writes through :func:`replacing` or :func:`write_file` and reads JSON through :func:`read_json`, so that a
full disk, a device node, a symlink or a hostile file means the same everywhere.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import shutil
import stat
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from simwarp.core.operating_system import name_trouble, open_for_writing, put_in_place

LONGEST_NAME: Final = 255
"""Bytes of a file name that Linux and macOS take."""

LARGEST_TEXT: Final = 64 * 2**20
"""Bytes of the largest text file that is read."""

FLOAT32_MAX: Final = 3.4028234663852886e38
"""Largest number of the arrays."""

DRAFT_PREFIX: Final = ".simwarp-"
"""Beginning of the names of files that are not complete yet."""

DEEPEST: Final = 100
"""Lists and objects within one another that a JSON text may have."""

LONGEST_INTEGER: Final = 19
"""Digits of the largest whole number of 64 bits."""

ENTITIES: Final = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)

WAIT_FOR_READER: Final = 5.0
"""Time that writing to a FIFO waits for a reader [s]."""


class FileError(ValueError):
    """A file that cannot be read, or a path that cannot be written to: the user's to mend.

    Attributes:
        reason: reason why it cannot be read, without its name; empty for other errors.
    """

    def __init__(self, message: str, reason: str = "") -> None:
        super().__init__(message)
        self.reason = reason


class OutputError(RuntimeError):
    """Writing to the disk failed; the earlier file is unchanged."""


# ---- writing ---------------------------------------------------------------------------------------------------------


def check_output(path: str | Path, option: str = "output") -> Path:
    """Return the path, if something could be written there; nothing is touched.

    Args:
        path: of a file to be written; devices and FIFOs may stand there.
        option: option that asked for it, such as ``--json``: the errors begin with it.

    Raises:
        FileError: it is empty, a folder or a socket, its name is too long, its folder does not exist, or there is no
            permission.
    """
    text = os.fspath(path)
    if not _is_name(text):
        raise FileError(f"{option} must name a file, got {text!r}; write a name such as result.out")
    path = Path(text)
    if len(os.fsencode(path.name)) > LONGEST_NAME:
        raise FileError(f"{option}: the name '{path.name[:40]}...' is longer than {LONGEST_NAME} bytes; shorten it")
    target = _target(path, option)
    if (trouble := name_trouble(target.name)) and not is_special(target):
        raise FileError(f"{option}: the name '{target.name}' {trouble}; choose another name")
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        mode = None
    except OSError as error:
        raise FileError(f"{option}: cannot write '{path}': {error.strerror}") from None
    if mode is not None and stat.S_ISDIR(mode):
        raise FileError(f"{option} must name a file, '{path}' is a folder; add a file name")
    if mode is not None and stat.S_ISSOCK(mode):
        raise FileError(f"{option} must name a file, '{path}' is a socket; write to a file")
    if mode is not None and not os.access(target, os.W_OK):
        raise FileError(f"{option}: '{path}' is write-protected; choose another name or give permission")
    if mode is not None and not stat.S_ISREG(mode):
        return path
    folder = target.parent
    if not folder.is_dir():
        what = "is no folder" if folder.exists() else "does not exist"
        raise FileError(f"{option}: cannot write '{path}': folder {folder} {what}; make it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise FileError(f"{option}: cannot write '{path}': folder {folder} is write-protected; choose another")
    return path


def _is_name(text: str) -> bool:
    """Return True if a text can be a path: neither empty nor of characters that no file system takes."""
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        return False
    return bool(text) and "\0" not in text


def _target(path: Path, option: str = "output") -> Path:
    """Return the target of a path: that of a symlink, existing or not."""
    try:
        return Path(os.path.realpath(path)) if path.is_symlink() else path
    except OSError as error:
        raise FileError(f"{option}: cannot write '{path}': {error.strerror}") from None


def is_special(path: str | Path) -> bool:
    """Return True if a device, a FIFO or the like stands there: written to, never replaced."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield the path of a draft with the same ending; when the block ends, the draft takes the place of ``path``.

    Whoever looks sees the old content or the new one. A symlink stays and what it leads to is replaced; a device or a
    FIFO gets the bytes. If the block raises, nothing has happened.

    Raises:
        FileError: ``path`` cannot be written to.
        OutputError: the disk did not take it.
    """
    path = check_output(path)
    special = is_special(path)
    target = _target(path)
    folder = Path(tempfile.gettempdir()) if special else target.parent
    ending = path.suffix if len(os.fsencode(path.suffix)) <= 16 else ""
    draft: Path | None = None
    try:
        handle, name = tempfile.mkstemp(dir=folder, prefix=DRAFT_PREFIX, suffix=ending)
        draft = Path(name)
        os.close(handle)
        yield draft
        if special:
            _pour(draft, path)
            return
        with draft.open("r+b") as file:  # Windows flushes only what could be written
            os.fsync(file.fileno())
        draft.chmod(_mode(target))
        put_in_place(draft, target)
    except OSError as error:
        raise output_error(path, error, draft) from error
    finally:
        if draft is not None:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)


def write_file(path: str | Path, data: bytes | str) -> None:
    """Write a whole file, as :func:`replacing` does."""
    content = data.encode("utf-8") if isinstance(data, str) else data
    with replacing(path) as draft:
        try:
            draft.write_bytes(content)
        except OSError as error:
            raise output_error(Path(path), error, draft, len(content)) from error


def layout(value: Any, indent: str = "") -> str:
    """JSON with lists of plain values on one line, for files that people edit."""
    inner = indent + "  "
    short = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, (dict, list)) or (isinstance(value, list) and len(short) + len(inner) <= 116):
        flat = not isinstance(value, list) or not any(isinstance(item, dict) for item in value)
        if flat or not value:
            return short
    if isinstance(value, dict):
        if not value:
            return short
        lines = [f"{inner}{json.dumps(key)}: {layout(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    return "[\n" + ",\n".join(inner + layout(item, inner) for item in value) + f"\n{indent}]"


def output_error(path: str | Path, error: OSError, draft: Path | None = None, needed: int = 0) -> OutputError:
    """Return the error that says which folder did not take how much.

    Args:
        path: of the file that was to be written.
        error: of the operating system.
        draft: partial file that exists already.
        needed: bytes of the whole, where they are known.
    """
    folder = Path(path).absolute().parent
    written = 0
    with contextlib.suppress(OSError):
        written = draft.stat().st_size if draft is not None else 0
    amount = f"{max(needed, written) / 1e6:.3g} MB" + ("" if needed else " or more")
    reason = error.strerror or str(error)
    try:
        free = shutil.disk_usage(folder).free
    except OSError:
        reason, there = f"folder {folder} is gone", ""
    else:
        there = "" if is_special(path) else f", {free / 1e6:.3g} MB are free in {folder}"
    remedy = {
        errno.ENOSPC: "; make room and repeat",
        errno.EDQUOT: "; make room in the quota and repeat",
        errno.EFBIG: "; raise the limit of file sizes (ulimit -f) and repeat",
    }.get(error.errno or 0, "")
    return OutputError(f"cannot write '{path}': {reason}: {amount} needed{there}{remedy}")


def _mode(target: Path) -> int:
    """Return the permissions for a file: those it has, or those a new one gets."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except OSError:
        umask = os.umask(0)
        os.umask(umask)
        return 0o666 & ~umask


def _pour(draft: Path, target: Path) -> None:
    """Copy a file into a device or FIFO."""
    with draft.open("rb") as source, _open_special(target) as sink:
        shutil.copyfileobj(source, sink)


def _open_special(target: Path) -> Any:
    """Open a device or FIFO for writing; a FIFO without a reader is an error instead of an endless wait."""
    deadline = time.monotonic() + WAIT_FOR_READER
    while (handle := open_for_writing(target)) is None:
        if time.monotonic() > deadline:
            raise FileError(f"cannot write '{target}': nobody reads this FIFO; start its reader first")
        time.sleep(0.02)
    return os.fdopen(handle, "wb")


# ---- reading ---------------------------------------------------------------------------------------------------------


def check_input(path: str | Path, what: str = "file", *, largest: int | None = None) -> Path:
    """Return the path, if a regular file can be read there.

    Args:
        path: of the file.
        what: expected kind of file, such as ``vehicle file``: the errors begin with it.
        largest: most bytes it may have.

    Raises:
        FileError: there is no such file, or it is a folder, a device or a FIFO, unreadable or too large.
    """
    text = os.fspath(path)
    if not _is_name(text):
        raise FileError(f"{what}: the path must name a file, got {text!r}", "the path must name a file")
    path = Path(text)
    shown = text if len(text) <= 200 else f"{text[:100]}..."
    try:
        info = path.stat()
    except FileNotFoundError as error:
        raise FileError(f"{what} '{shown}' does not exist", str(error.strerror)) from None
    except OSError as error:
        raise FileError(f"{what} '{shown}' cannot be read: {error.strerror}", str(error.strerror)) from None
    if stat.S_ISDIR(info.st_mode):
        raise FileError(f"{what} '{shown}' is a folder; name a file", "it is a folder")
    if not stat.S_ISREG(info.st_mode):
        raise FileError(f"{what} '{shown}' is no regular file; save it to one first", "it is no regular file")
    if not os.access(path, os.R_OK):
        raise FileError(f"{what} '{shown}' cannot be read: no permission", "no permission")
    if largest is not None and info.st_size > largest:
        size = f"{info.st_size / 1e6:.3g} MB, at most {largest / 1e6:.3g} MB are read"
        raise FileError(f"{what} '{shown}' has {size}", f"it has {size}")
    return path


def read_text(path: str | Path, what: str = "file") -> str:
    """Return the text of a UTF-8 file.

    Raises:
        FileError: see :func:`check_input`; or it is not UTF-8.
    """
    path = check_input(path, what, largest=LARGEST_TEXT)
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise FileError(f"{what} '{path}' cannot be read: {error.strerror}", str(error.strerror)) from None
    except UnicodeDecodeError as error:
        reason = f"not UTF-8 text at byte {error.start}"
        raise FileError(f"{what} '{path}' is {reason}", reason) from None


def declares_entities(xml: bytes) -> bool:
    """Return True if an XML text declares a document type or an entity, whatever its encoding.

    That is the door to texts that expand without end, and to other files; no description needs it.
    """
    return ENTITIES.search(xml.replace(b"\0", b"")) is not None


def read_json(path: str | Path, what: str = "file") -> Any:
    """Return the value in a JSON file; see :func:`parse_json` for what is refused."""
    return parse_json(read_text(path, what), f"{what} '{path}'")


def parse_json(text: str, name: str) -> Any:
    """Return the value of a JSON text.

    Args:
        text: the JSON.
        name: its location: the errors begin with it.

    Raises:
        FileError: it is broken, nested too deep, gives a key twice, or has a number that no array could hold: a whole
            number beyond 64 bits, or one beyond float32.
    """
    try:
        value = json.loads(text, object_pairs_hook=_once, parse_int=_whole, parse_float=_fraction)
    except json.JSONDecodeError as error:
        raise FileError(f"{name}: line {error.lineno} column {error.colno}: broken JSON: {error.msg}") from None
    except RecursionError:
        raise FileError(f"{name}: broken JSON: objects or lists nested too deep") from None
    except ValueError as error:
        raise FileError(f"{name}: {error}") from None
    if _deeper_than(DEEPEST, value):
        raise FileError(f"{name}: broken JSON: objects or lists nested too deep: more than {DEEPEST} levels")
    return value


def _deeper_than(levels: int, value: Any) -> bool:
    """Return True if lists and objects are nested deeper than that: readers recurse into them."""
    layer = [value] if isinstance(value, dict | list) else []
    for _ in range(levels):
        inner = (item for owner in layer for item in (owner.values() if isinstance(owner, dict) else owner))
        layer = [item for item in inner if isinstance(item, dict | list)]
        if not layer:
            return False
    return bool(layer)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ValueError(f"{_short(twice, 'characters')}: given twice in one object; give it once")
    return members


def _whole(text: str) -> int:
    if len(text.lstrip("-")) > LONGEST_INTEGER or not -(2**63) <= int(text) < 2**63:
        raise ValueError(f"the number {_short(text)} is beyond 64 bits; give a smaller one")
    return int(text)


def _fraction(text: str) -> float:
    value = float(text)
    if abs(value) > FLOAT32_MAX:
        raise ValueError(f"the number {_short(text)} is beyond float32 (3.4e38); give a smaller one")
    return value


def _short(text: str, unit: str = "digits") -> str:
    return text if len(text) <= 40 else f"{text[:12]}... of {len(text)} {unit}"
