"""Named arrays in ``.npz`` files: written whole or not at all, read with limits and without running code from the file.

NumPy's own reader makes room for whatever a header claims; here what is claimed is held to the file first.
"""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp import ModelError
from simwarp.core.files import FileError, check_input, write_file
from simwarp.core.memory import check_fits
from simwarp.core.types import formatted

Arrays = dict[str, npt.NDArray[Any]]

_SUFFIX: Final = ".npy"
_MOST_DENSE: Final = 1040
"""Bytes that one byte of the zip format can stand for, at most."""
_OVERHEAD: Final = 1024
"""Bytes of an array's header, about."""
_KINDS: Final = "biufU"
"""Truth values, whole numbers, numbers and text."""


def write_arrays(path: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write arrays, compressed.

    Raises:
        FileError: ``path`` cannot be written to.
        OutputError: the disk did not take it.
    """
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    write_file(path, buffer.getvalue())


def read_arrays(path: Path, what: str) -> Arrays:
    """Return all arrays of a file, by name.

    Args:
        path: of the file.
        what: expected content: the errors begin with it.

    Raises:
        FileError: there is no such file, it is damaged or of another kind, or it claims more than it can hold.
    """
    check_input(path, what)
    try:
        with zipfile.ZipFile(path) as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _check_sizes(archive.infolist(), f"{what} '{path}'")
            return {item.filename.removesuffix(_SUFFIX): _array(archive, item) for item in archive.infolist()}
    except ModelError as error:
        raise FileError(str(error)) from None
    except Exception as error:  # whatever zipfile, zlib and NumPy make of damaged bytes
        reason = "".join(str(error).splitlines()[:1])[:200]
        raise FileError(f"{what} '{path}' is no .npz file of arrays, or a damaged one: {reason}") from error


def text_of(arrays: Arrays, name: str) -> str:
    """Return a text that is kept as an array; empty where there is none."""
    array = arrays.get(name)
    return str(array) if array is not None and array.shape == () and array.dtype.kind == "U" else ""


def _check_sizes(items: list[zipfile.ZipInfo], what: str) -> None:
    """Refuse an archive that would unpack to more than it can stand for, or than there is room for."""
    names = [item.filename for item in items]
    if len(set(names)) != len(names) or not all(name.endswith(_SUFFIX) for name in names):
        raise ValueError("its members are not named arrays")
    for item in items:
        if item.file_size > _MOST_DENSE * item.compress_size + _OVERHEAD:
            raise ValueError(f"{formatted(item.filename)} claims {item.file_size} bytes and has {item.compress_size}")
    # Twice: what is unpacked, and the array made of it
    total = 2 * sum(item.file_size for item in items)
    check_fits(f"{what}: its arrays", total, wp.get_device("cpu"), "take a smaller file")


def _array(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> npt.NDArray[Any]:
    content = archive.read(item)
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = header(stream)
    left = len(content) - stream.tell()
    if dtype.kind not in _KINDS or math.prod(shape) * dtype.itemsize != left or min(shape, default=1) < 0:
        raise ValueError(f"{formatted(item.filename)} claims {formatted(shape)} of {dtype} and has {left} bytes")
    if not left:
        return np.zeros(shape, dtype)
    flat = np.frombuffer(content, dtype, offset=stream.tell())
    # A copy, since bytes cannot be written to, in the byte order of this machine
    array: npt.NDArray[Any] = flat.reshape(shape, order="F" if fortran else "C").astype(dtype.newbyteorder("="))
    return array
