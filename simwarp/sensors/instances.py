"""Things that rays can hit, and how they look: what a scene is made of."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Final, TypeAlias, TypedDict

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import As, Ge, Le, Meaning
from simwarp.core.types import Pose, ShapeType, Vec3

GREY: Final = (0.5, 0.5, 0.5)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Appearance:
    """Colour, texture, label and reflectance of an instance.

    Attributes:
        color: linear albedo, 0 to 1.
        texture: index that `Visuals.texture` returned; -1: none, or that of the mesh's file.
        label: semantic class.
        reflectance: of a lidar's or radar's beam, 0 to 1.
        group: bits; a sensor sees instances of the groups in its mask.
    """

    color: Vec3 = GREY
    texture: int = -1
    label: int = 0
    reflectance: float = 0.5
    group: int = 1


Albedo: TypeAlias = Annotated[float, Ge(0.0), Le(1.0), Meaning("0 for none to 1 for all light")]
Int32: TypeAlias = Annotated[int, Ge(-(2**31)), Le(2**31 - 1), Meaning("an integer of 32 bits")]
TextureIndex: TypeAlias = Annotated[
    int,
    Ge(-1),
    Le(2**31 - 1),
    Meaning("one of visuals: write texture=visuals.texture(ImageTexture(image=...))"),
]


class PlainAppearanceOptions(TypedDict, total=False):
    """Fields of `Appearance` without its colour, with its defaults."""

    texture: TextureIndex
    label: Int32
    reflectance: Albedo
    group: Int32


class AppearanceOptions(PlainAppearanceOptions, total=False):
    """Fields of `Appearance`, with its defaults."""

    color: Annotated[Vec3, As(tuple[Albedo, Albedo, Albedo])]


@dataclasses.dataclass(frozen=True)
class Instance:
    """One thing that rays can hit. A shape of the model (`shape` >= 0) lends its placement, size and asset; a flexible
    mesh (`flexible` >= 0, its number in the builder) its surface, from the body of its first node that moves by itself,
    in one colour or in those of values.
    """

    name: str
    kind: ShapeType
    body: int
    shape: int
    pose: Pose
    size: npt.NDArray[np.float64]
    asset: int
    appearance: Appearance
    flexible: int = -1
    by_values: bool = False
