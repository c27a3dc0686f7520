"""Roads of files: a JSON file with bitmaps of height, friction and soil; and roads by a word of the command line."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from simwarp.core.constraints import Positive
from simwarp.core.files import FileError, check_input
from simwarp.vehicle.roads.open_crg import ENDING, load_crg
from simwarp.vehicle.roads.random_roads import MOST_NODES
from simwarp.vehicle.roads.road_profiles import RoadClass
from simwarp.vehicle.roads.road_surface import RoadSurface, random_road
from simwarp.vehicle.spec.parts import Spec, SpecError, refuse
from simwarp.vehicle.spec.vehicle_files import read_spec

RANDOM: Final = "iso8608"
FORM: Final = "iso8608:CLASS, iso8608:CLASS:SEED, a .json or a .crg file"
"""Of a road on the command line."""
Window = tuple[tuple[float, float], tuple[float, float]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bitmap(Spec):
    """A .png or .npy file of numbers: value = offset + scale x pixel."""

    pixels: str
    """File beside the JSON file."""
    scale: float = 1.0
    """Per step of the pixels, [m] of heights."""
    offset: float = 0.0
    """Of a pixel of 0, [m] of heights."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RoadFile(Spec):
    """What the JSON file of a road says. Pictures lie as maps do, x to the right and y upwards; .npy files have rows
    along y, the first one at the least y.
    """

    origin: tuple[float, float]
    """x and y of the lower left corner [m]."""
    size: tuple[Positive, Positive]
    """Of all bitmaps along x and y [m]: of heights from the first to the last node, of others to the cells' edges."""
    height: Bitmap
    """16 bits per pixel, or an array of numbers."""
    friction: Bitmap | None = None
    """Coefficients."""
    soil: str | None = None
    """File of indices in `soils`."""
    soils: tuple[str, ...] = ()
    """Names of soils."""


def load_road(path: str | Path) -> RoadSurface:
    """The road of a JSON file with its bitmaps, or of an OpenCRG file.

    Args:
        path: of the file, .json or .crg.

    Raises:
        SpecError: a file cannot be read or used; names it, the rule, the value and the remedy.
    """
    file = Path(path)
    if file.suffix == ENDING:
        return load_crg(file)
    found = read_spec(RoadFile, file)
    heights = _values(file, "height", found.height, deep=True).astype(np.float32)
    friction = None if found.friction is None else _values(file, "friction", found.friction)
    soil = None if found.soil is None else _values(file, "soil", Bitmap(pixels=found.soil))
    try:
        if soil is not None and (soil != np.floor(soil)).any():
            raise refuse("soil", "whole numbers, indices in soils", soil[soil != np.floor(soil)][0])
        return RoadSurface(
            heights=heights, origin=found.origin, size=found.size, friction=friction,
            soil=None if soil is None else soil.astype(np.int32), soils=found.soils,
        )  # fmt: skip
    except SpecError as error:
        raise SpecError(f"{file.name}: {error}") from None


def _values(file: Path, key: str, bitmap: Bitmap, *, deep: bool = False) -> npt.NDArray[np.float64]:
    """(rows along y, columns) of a bitmap. `deep`: 8 bits are not enough."""
    name = f"{file.name}: {key}"
    path = file.parent / bitmap.pixels
    try:
        check_input(path)
        pixels = np.load(path, allow_pickle=False) if path.suffix == ".npy" else _picture(path)
    except (FileError, OSError, ValueError, SyntaxError, EOFError) as error:
        reason = error.reason if isinstance(error, FileError) else error
        raise SpecError(f"{name}: '{bitmap.pixels}' cannot be read: {reason}; give a .png or .npy file") from None
    if pixels.ndim != 2 or pixels.dtype.kind not in "buif":
        got = f"{pixels.dtype} of the shape {pixels.shape}"
        raise SpecError(f"{name}: must be one number per pixel, got {got} in '{bitmap.pixels}'; save it as greyscale")
    if deep and pixels.dtype.itemsize < 2:
        remedy = "save it with 16 bits per pixel"
        raise SpecError(f"{name}: must have at least 16 bits, got {pixels.dtype} in '{bitmap.pixels}'; {remedy}")
    least = 2 if deep else 1
    if min(pixels.shape) < least or pixels.size > MOST_NODES:
        rule = f"at least {least} x {least} pixels and at most {MOST_NODES:.3g}"
        raise SpecError(f"{name}: must have {rule}, got {pixels.shape[1]} x {pixels.shape[0]} in '{bitmap.pixels}'")
    values = np.asarray(bitmap.offset + bitmap.scale * pixels.astype(np.float64))
    if not np.isfinite(values).all():
        raise SpecError(f"{name}: must hold finite numbers, got others in '{bitmap.pixels}'; fill the gaps")
    return values


def _picture(path: Path) -> npt.NDArray[Any]:
    """Pixels of a picture, from the bottom row up."""
    with Image.open(path) as image:
        if image.mode == "P":
            raise ValueError("it has a palette")
        # Pillow reads greyscale of 16 bits as 32
        deep = image.mode.startswith("I")
        pixels = np.asarray(image)
    return np.flipud(pixels.astype(np.uint16) if deep and pixels.max(initial=0) < 2**16 else pixels)


def check_road_word(word: str) -> tuple[RoadClass, int] | Path:
    """Class and seed of a random road, or the file of another one.

    Args:
        word: as `FORM` says.

    Raises:
        SpecError: it is neither.
    """
    if word.endswith((".json", ENDING)):
        return Path(word)
    first, *rest = word.split(":")
    if first != RANDOM or not 1 <= len(rest) <= 2:
        raise refuse("road", FORM, word)
    letters = [road.value for road in RoadClass]
    if rest[0].upper() not in letters:
        raise refuse("road", f"of a class from {letters[0]} to {letters[-1]}", rest[0], "C is an average road")
    seed = rest[1] if len(rest) == 2 else "0"
    if not (seed.isascii() and seed.isdigit() and len(seed) < 19):
        raise refuse("road", "of a seed that is a whole number, 0 or more", seed)
    return RoadClass(rest[0].upper()), int(seed)


def road_of(word: str, window: Window) -> RoadSurface:
    """The road of a word of the command line.

    Args:
        word: as `FORM` says.
        window: first and last x and y of a random road [m]; files have their own.

    Raises:
        SpecError: there is no such road.
    """
    found = check_road_word(word)
    if isinstance(found, Path):
        return load_road(found)
    return random_road(found[0], seed=found[1], x=window[0], y=window[1])
