"""Checkpoints: written whole or not at all, every byte under a checksum, read without running code from the file.

A checkpoint is the zip archive that torch writes. Its comment, the last bytes of the file, holds the SHA-256 digest of
all bytes before the digest; whoever reads zip archives, ``torch.load`` too, reads it as before.
"""

from __future__ import annotations

import functools
import hashlib
import io
import struct
import sys
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch

from simwarp.core.files import FileError, check_input, write_file
from simwarp.tasks import InputError
from simwarp.tasks.framework.config_values import typed

FORMAT: Final = 1
SUFFIX: Final = ".pt"
LARGEST: Final = 16 * 2**30
"""Bytes of the largest checkpoint that is read."""
POLICY: Final[Mapping[str, Any]] = {
    "format": int,
    "task": str,
    "iteration": int,
    "train_config": dict,
    "task_config": dict,
    "actor_state_dict": Mapping[str, torch.Tensor],
}
"""Entries of every checkpoint, and their types."""

_ZIP = b"PK\x03\x04"
_ZIP_END = b"PK\x05\x06"
_ZIP_END_BYTES = 22
_SEAL = b"simwarp sha256 "
_DIGEST_BYTES = 64


def save_checkpoint(path: Path, content: dict[str, Any]) -> None:
    """Write ``content`` (tensors, numbers, strings, lists and dicts of them) to ``path``.

    Raises:
        FileError: ``path`` cannot be written to.
        OutputError: the disk did not take it; what stood there is unharmed.
    """
    write_file(path, checkpoint_bytes(content))


def checkpoint_bytes(content: dict[str, Any]) -> bytes:
    """Return the file that :func:`save_checkpoint` writes."""
    buffer = io.BytesIO()
    torch.save({"format": FORMAT, **content}, buffer)
    return sealed(buffer.getvalue())


def sealed(archive: bytes) -> bytes:
    """Return torch's archive, which has no comment, with its checksum as the comment."""
    assert archive[-_ZIP_END_BYTES:].startswith(_ZIP_END)
    assert archive.endswith(b"\0\0")
    body = archive[:-2] + struct.pack("<H", len(_SEAL) + _DIGEST_BYTES) + _SEAL
    return body + hashlib.sha256(body).hexdigest().encode()


def load_checkpoint(path: Path, device: str = "cpu") -> dict[str, Any]:
    """Read a checkpoint; says on standard error where one has no checksum.

    Raises:
        InputError: the file is missing, damaged, of another kind or of another version.
    """
    try:
        data = check_input(path, "checkpoint", largest=LARGEST).read_bytes()
    except FileError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"checkpoint {path} cannot be read: {error.strerror}") from None
    sealed = _has_seal(path, data)
    if not sealed:
        _check_records(path, data)
    content = _unpickle(path, data, device)
    if not isinstance(content, dict) or not POLICY.keys() <= content.keys():
        raise InputError(f"{path} is no simwarp checkpoint: it was written by another program")
    check_members(content, POLICY, f"checkpoint {path}")
    if content["format"] != FORMAT:
        raise InputError(f"checkpoint {path} has format {content['format']}, this simwarp reads {FORMAT}")
    if content["iteration"] < 0:
        raise InputError(f"checkpoint {path}: iteration must be zero or positive, got {content['iteration']}")
    if not sealed:
        _say_unsealed(path)  # of a file that is refused, one line is enough
    return content


def check_members(content: Mapping[str, Any], types: Mapping[str, Any], where: str) -> None:
    """Check the content that was read against the types of its members.

    Raises:
        InputError: one is missing, or of another type.
    """
    for name, kind in types.items():
        if name not in content:
            raise InputError(f"{where} has no '{name}': it was written by another version of simwarp, or is damaged")
        typed(kind, content[name], f"{where}: {name}")


def _has_seal(path: Path, data: bytes) -> bool:
    """Return True if there is a checksum, which must be right; False for a whole archive as torch writes it."""
    body, digest = data[:-_DIGEST_BYTES], data[-_DIGEST_BYTES:]
    if body.endswith(_SEAL):
        if hashlib.sha256(body).hexdigest().encode() != digest:
            raise InputError(f"checkpoint {path} is damaged: its checksum does not match its content")
        return True
    # Without the seal, a comment is a damaged seal: an archive of torch's ends with a length of zero
    if data.startswith(_ZIP) and data[-_ZIP_END_BYTES:].startswith(_ZIP_END) and data.endswith(b"\0\0"):
        return False
    raise InputError(f"checkpoint {path} is truncated or not a checkpoint")


def _check_records(path: Path, data: bytes) -> None:
    """Refuse an archive whose records do not match their own, weaker checksums, or unpack to more than the file has."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            records = archive.infolist()
            stored = all(record.compress_type == zipfile.ZIP_STORED for record in records)
            bad = None if stored and sum(record.file_size for record in records) <= len(data) else "sizes"
            bad = bad or archive.testzip()
    except (zipfile.BadZipFile, RuntimeError, OSError, ValueError, EOFError, struct.error) as error:
        raise InputError(f"checkpoint {path} is truncated or not a checkpoint") from error
    if bad:
        raise InputError(f"checkpoint {path} is damaged: its records are not as they were written")


def _unpickle(path: Path, data: bytes, device: str) -> Any:
    """Return the content of an archive of plain values and tensors, as torch reads it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return torch.load(io.BytesIO(data), map_location=device, weights_only=True)
    except Exception as error:
        raise InputError(f"checkpoint {path} is truncated or not a checkpoint") from error


@functools.cache
def _say_unsealed(path: Path) -> None:
    """Warn once per process."""
    print(
        f"simwarp: checkpoint {path} carries no checksum: it was written by an older simwarp, and damage may go unseen",
        file=sys.stderr,
    )


def checkpoint_name(iteration: int) -> str:
    """Return the file name of the checkpoint after ``iteration`` iterations."""
    return f"iteration_{iteration:06d}{SUFFIX}"


def inference_only(content: dict[str, Any]) -> dict[str, Any]:
    """Return only what playing needs: no optimiser, critic, random state or worlds."""
    return {key: content[key] for key in POLICY}
