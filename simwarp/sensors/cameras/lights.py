"""Suns, lamps, sky and fog: what lights a scene, each number shared by all worlds or a world's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.constraints import Count, Direction, Meaning, Parsed, RuleError
from simwarp.core.object_repr import Readable
from simwarp.core.rotation import unit_vector
from simwarp.core.types import FLOAT32_MAX, ModelError, Vec3, numbers
from simwarp.model.checks import checked_names
from simwarp.model.model import Model
from simwarp.model.rules import RULES, Configuration, Passive, Vector3, instance_of
from simwarp.sensors.cameras.shade_kernels import LightArrays


def _light(value: Any) -> Any:
    values = numbers(value)
    if values.shape not in ((), (3,)) or not ((values >= 0.0) & (values <= FLOAT32_MAX)).all():
        raise RuleError(">= 0, one number or red, green and blue", "1 is white")
    return value


Color: TypeAlias = Annotated[float | Vec3, Parsed(_light)]

PER_WORLD: Final = (
    "sun_direction", "sun_color", "lamp_position", "lamp_color", "ambient_above", "ambient_below", "sky_zenith",
    "sky_horizon", "sky_below", "fog_density", "fog_color",
)  # fmt: skip
"""Arrays of `Lights` that may differ by world."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sun(Configuration):
    """Parallel light.

    Attributes:
        direction: from the scene towards the sun, world axes; any length.
        color: radiance that a white surface facing it reflects; one number is a grey.
    """

    direction: Direction = (0.4, -0.3, 1.0)
    color: Color = (0.92, 0.88, 0.8)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lamp(Configuration):
    """A point that shines in all directions alike; its light falls with the square of the distance.

    Attributes:
        position: in the world [m].
        color: radiance that a white surface facing it reflects at a distance of 1 m.
    """

    position: Vector3
    color: Color = 1.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lighting(Configuration):
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

    suns: Annotated[Sequence[Sun], Meaning("a list of Sun, as suns=[Sun(...)]")] = (Sun(),)
    lamps: Annotated[Sequence[Lamp], Meaning("a list of Lamp, as lamps=[Lamp(...)]")] = ()
    shadows: bool = True
    shadow_reach: Annotated[float, Meaning("metres")] = 1.0e4
    ambient: Color = (0.3, 0.34, 0.4)
    ambient_below: Color = (0.14, 0.13, 0.12)
    sky: Color = (0.16, 0.33, 0.67)
    horizon: Color = (0.62, 0.74, 0.87)
    below: Color | None = None
    fog_density: Passive = 0.0
    fog: Color | None = None


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

    @RULES.arguments("lights")
    def __init__(
        self, lighting: Annotated[Lighting, instance_of(Lighting, "write Lighting(...)")],
        world_count: Annotated[Count, Meaning("model.world_count")], device: Any, per_world: Iterable[str] = (),
    ) -> None:  # fmt: skip
        wanted = checked_names("lights", "per_world", per_world, PER_WORLD)
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
    fog = lighting.horizon if lighting.fog is None else lighting.fog
    below = lighting.horizon if lighting.below is None else lighting.below
    directions = [unit_vector("Sun", "direction", sun.direction) for sun in lighting.suns]
    places = [lamp.position for lamp in lighting.lamps]
    return {
        "sun_direction": (np.array(directions, np.float32).reshape(-1, 3), wp.vec3),
        "sun_color": (_colors(*(sun.color for sun in lighting.suns)), wp.vec3),
        "lamp_position": (np.array(places, np.float64).reshape(-1, 3), wp.vec3d),
        "lamp_color": (_colors(*(lamp.color for lamp in lighting.lamps)), wp.vec3),
        "ambient_above": (_colors(lighting.ambient)[0], wp.vec3),
        "ambient_below": (_colors(lighting.ambient_below)[0], wp.vec3),
        "sky_zenith": (_colors(lighting.sky)[0], wp.vec3),
        "sky_horizon": (_colors(lighting.horizon)[0], wp.vec3),
        "sky_below": (_colors(below)[0], wp.vec3),
        "fog_color": (_colors(fog)[0], wp.vec3),
        "fog_density": (np.array(lighting.fog_density, np.float32), wp.float32),
    }


def _colors(*colors: Color) -> npt.NDArray[np.float32]:
    """(colours, 3); one number is a grey."""
    return np.array([np.broadcast_to(color, 3) for color in colors], np.float32).reshape(-1, 3)
