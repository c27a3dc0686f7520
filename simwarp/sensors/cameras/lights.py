"""Suns, lamps, sky and fog: what lights a scene, each number shared by all worlds or a world's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.readable import Readable, ReadableFields
from simwarp.core.rotation import unit_vector
from simwarp.core.types import ModelError, Vec3, finite_vector, formatted
from simwarp.model.checks import finite_number
from simwarp.model.model import Model
from simwarp.sensors.cameras.shade_kernels import LightArrays
from simwarp.sensors.interface import wanted_arrays

Color = float | Vec3

PER_WORLD: Final = (
    "sun_direction", "sun_color", "lamp_position", "lamp_color", "ambient_above", "ambient_below", "sky_zenith",
    "sky_horizon", "sky_below", "fog_density", "fog_color",
)  # fmt: skip
"""Arrays of `Lights` that may differ by world."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sun:
    """Parallel light.

    Attributes:
        direction: from the scene towards the sun, world axes; any length.
        color: radiance that a white surface facing it reflects; one number is a grey.
    """

    direction: Vec3 = (0.4, -0.3, 1.0)
    color: Color = (0.92, 0.88, 0.8)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lamp:
    """A point that shines in all directions alike; its light falls with the square of the distance.

    Attributes:
        position: in the world [m].
        color: radiance that a white surface facing it reflects at a distance of 1 m.
    """

    position: Vec3
    color: Color = 1.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lighting(ReadableFields):
    """All lights of a camera's pictures. Colours are linear, 1 is white; one number is a grey.

    Attributes:
        suns: parallel lights.
        lamps: point lights.
        shadows: True if things stand in the way of suns and lamps.
        shadow_reach: distance towards a sun within which occluders count [m].
        ambient: light of the sky on surfaces that look up; they need no view of it.
        ambient_below: light from the ground on surfaces that look down; those in between get their share of both.
        sky: colour of the zenith.
        horizon: colour of the sky at the horizon.
        below: colour of what lies below the horizon where there is nothing; None: that of the horizon.
        fog_density: b of exp(-b distance) [1/m].
        fog: its colour; None: that of the horizon.

    Raises:
        ModelError: a value breaks its rule.
    """

    suns: Sequence[Sun] = (Sun(),)
    lamps: Sequence[Lamp] = ()
    shadows: bool = True
    shadow_reach: float = 1.0e4
    ambient: Color = (0.3, 0.34, 0.4)
    ambient_below: Color = (0.14, 0.13, 0.12)
    sky: Color = (0.16, 0.33, 0.67)
    horizon: Color = (0.62, 0.74, 0.87)
    below: Color | None = None
    fog_density: float = 0.0
    fog: Color | None = None

    def __post_init__(self) -> None:
        finite_number("Lighting", "shadow_reach", self.shadow_reach, "pass metres")
        _values(self)


class Lights(Readable):
    """The lighting of all worlds on a device: arrays to write into between steps.

    Args:
        lighting: initial values.
        world_count: number of worlds W.
        device: Warp device.
        per_world: names of the arrays below that get a row per world.

    Attributes:
        sun_direction: (1 or W, suns) vec3, unit, towards the sun.
        sun_color: (1 or W, suns) vec3.
        lamp_position: (1 or W, lamps) vec3d [m].
        lamp_color: (1 or W, lamps) vec3.
        ambient_above, ambient_below, sky_zenith, sky_horizon, sky_below, fog_color: (1 or W,) vec3.
        fog_density: (1 or W,) [1/m].

    Raises:
        ModelError: a value breaks its rule, or `per_world` names no array.
    """

    sun_direction: WritableArray
    sun_color: WritableArray
    lamp_position: WritableArray
    lamp_color: WritableArray
    ambient_above: WritableArray
    ambient_below: WritableArray
    sky_zenith: WritableArray
    sky_horizon: WritableArray
    sky_below: WritableArray
    fog_density: WritableArray
    fog_color: WritableArray

    def __init__(self, lighting: Lighting, world_count: int, device: Any, per_world: Iterable[str] = ()) -> None:
        if not isinstance(lighting, Lighting):
            raise ModelError(f"lights: lighting must be a Lighting, got {formatted(lighting)}; write Lighting(...)")
        whole = isinstance(world_count, (int, np.integer)) and not isinstance(world_count, bool)
        if not whole or world_count < 1:
            raise ModelError(
                f"lights: world_count must be an integer >= 1, got {formatted(world_count)}; pass model.world_count"
            )
        wanted = wanted_arrays("lights", per_world, PER_WORLD)
        self.arrays = LightArrays()
        self.arrays.shadows = int(lighting.shadows)
        self.arrays.shadow_reach = float(lighting.shadow_reach)
        for name, (values, dtype) in _values(lighting).items():
            copies = world_count if name in wanted else 1
            array = writable_from(np.repeat(values[None], copies, axis=0), dtype, device)
            setattr(self, name, array)
            setattr(self.arrays, name, array)

    def _readable_title(self) -> str:
        return f": {self.sun_direction.shape[1]} suns, {self.lamp_color.shape[1]} lamps"

    def check(self, model: Model) -> None:
        """Refuses a model of another device, or of another number of worlds where these have lights of their own.

        Raises:
            ModelError: they do not fit.
        """
        for name in PER_WORLD:
            array: wp.array = getattr(self, name)
            if array.device != model.device:
                raise ModelError(
                    f"lights: device must be that of the model, {model.device}, got {array.device}; pass model.device"
                )
            if array.shape[0] not in (1, model.world_count):
                raise ModelError(
                    f"lights: '{name}' must have 1 row or one for each of {model.world_count} worlds, "
                    f"got {array.shape[0]}; make the Lights with model.world_count"
                )


def _values(lighting: Lighting) -> dict[str, tuple[npt.NDArray[Any], Any]]:
    """One world's values, and their types."""
    density = finite_number("Lighting", "fog_density", lighting.fog_density, "use 0 for none")
    if density < 0.0:
        raise ModelError(f"Lighting: fog_density must be >= 0 1/m, got {density:g}; use 0 for none")
    for field, kind in (("suns", Sun), ("lamps", Lamp)):
        given = getattr(lighting, field)
        if not isinstance(given, (list, tuple)) or not all(isinstance(each, kind) for each in given):
            raise ModelError(
                f"Lighting: {field} must be a list of {kind.__name__}, got {formatted(given)}; "
                f"write {field}=[{kind.__name__}(...)]"
            )
    fog = lighting.horizon if lighting.fog is None else lighting.fog
    below = lighting.horizon if lighting.below is None else lighting.below
    directions = [unit_vector("Sun", "direction", sun.direction) for sun in lighting.suns]
    places = [finite_vector("Lamp", "position", lamp.position, 3) for lamp in lighting.lamps]
    return {
        "sun_direction": (np.array(directions, np.float32).reshape(-1, 3), wp.vec3),
        "sun_color": (_colors("Sun", [sun.color for sun in lighting.suns]), wp.vec3),
        "lamp_position": (np.array(places, np.float64).reshape(-1, 3), wp.vec3d),
        "lamp_color": (_colors("Lamp", [lamp.color for lamp in lighting.lamps]), wp.vec3),
        "ambient_above": (checked_color("Lighting", "ambient", lighting.ambient), wp.vec3),
        "ambient_below": (checked_color("Lighting", "ambient_below", lighting.ambient_below), wp.vec3),
        "sky_zenith": (checked_color("Lighting", "sky", lighting.sky), wp.vec3),
        "sky_horizon": (checked_color("Lighting", "horizon", lighting.horizon), wp.vec3),
        "sky_below": (checked_color("Lighting", "below", below), wp.vec3),
        "fog_color": (checked_color("Lighting", "fog", fog), wp.vec3),
        "fog_density": (np.array(density, np.float32), wp.float32),
    }


def _colors(thing: str, colors: list[Color]) -> npt.NDArray[np.float32]:
    return np.array([checked_color(thing, "color", color) for color in colors], np.float32).reshape(-1, 3)


def checked_color(thing: str, field: str, color: Color) -> npt.NDArray[np.float32]:
    """Three numbers from zero up; one number is a grey.

    Raises:
        ModelError: it is neither, or below zero.
    """
    values = finite_vector(thing, field, (color,) * 3 if isinstance(color, (int, float)) else color, 3)
    if values.min() < 0.0:
        raise ModelError(f"{thing}: {field} must be >= 0, got {formatted(color)}; 1 is white")
    return values.astype(np.float32)
