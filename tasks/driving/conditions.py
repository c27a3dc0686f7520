"""Conditions of driving: grip, mass, daylight, fog, camera and delays; each fixed, or drawn for world and episode."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Final, TypeAlias

import torch

import simwarp as sw
from simwarp.tasks import Fraction, Gt, Le, NotNegative, Positive

from ..framework.config import TaskConfig, require
from ..framework.errors import InputError
from ..randomisation.randomisation_config import Delay, Range, Sensing, Steps, Uncertainty
from ..randomisation.randomness import WorldRandom
from .camera_images import CameraImages

Elevation: TypeAlias = Annotated[float, Gt(0.0), Le(0.5 * math.pi)]
Span: TypeAlias = tuple[float, float]
"""Bounds between which a condition is drawn."""

RANDOM_RANGES: Final[Mapping[str, Span]] = MappingProxyType(
    {
        "friction": (0.5, 1.0),
        "mass": (0.9, 1.3),
        "light": (0.35, 1.5),
        "sun_elevation": (math.radians(10.0), math.radians(80.0)),
        "sun_azimuth": (-math.pi, math.pi),
        "fog": (0.0, 0.03),
        "image_noise": (0.0, 0.05),
        "contrast": (0.7, 1.3),
        "image_delay": (0, 1),
        "action_delay": (0, 1),
    }
)
"""What `Conditions.RANDOM` draws; why these: docs/driving.md."""
NOMINAL_SHARE: Final = 0.2
"""Of the episodes of `Conditions.RANDOM`, which have nominal grip, light and image: those are ends of their ranges or
single points within them, which draws alone never meet."""
NEUTRAL: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "mass": 1.0, "light": 1.0, "sun_elevation": None, "sun_azimuth": None, "fog": 0.0, "image_noise": 0.0,
        "contrast": 1.0, "image_delay": 0, "action_delay": (0, 0),
    }
)  # fmt: skip
"""Values that leave everything as the task is built."""
SEEN: Final = ("light", "sun_elevation", "sun_azimuth", "fog", "image_noise", "contrast")
"""Conditions that only a camera notices."""
SUN: Final = ("sun_elevation", "sun_azimuth")


class Conditions(enum.Enum):
    """What a condition that is left at its default is."""

    NOMINAL = "nominal"
    RANDOM = "random"


@dataclasses.dataclass(frozen=True)
class ConditionsConfig(TaskConfig):
    """Conditions in which a vehicle is driven: one number, or two between which each world's episodes are drawn."""

    conditions: Conditions = Conditions.NOMINAL
    """random: each condition below that is left at its default is drawn for every world and episode, in the ranges of
    docs/driving.md, and one episode in five is nominal; two equal numbers hold one fixed."""
    friction: Positive | tuple[Positive, Positive] = 0.9
    """Of the ground. Tires' curves hold as written where it is the friction they were measured at, mostly 0.8."""
    mass: Positive | tuple[Positive, Positive] = 1.0
    """Factor of the chassis' mass and inertia: a load that is spread over it."""
    light: Positive | tuple[Positive, Positive] = 1.0
    """Factor of all light, to a camera of fixed exposure: 1 a bright day, 0.1 dusk."""
    sun_elevation: Elevation | tuple[Elevation, Elevation] | None = None
    """Of the sun above the horizon [rad]: lower is redder, with longer shadows. None: as the task's light has it."""
    sun_azimuth: float | tuple[float, float] | None = None
    """Of the sun, from the world's X towards Y [rad]. None: as the task's light has it."""
    fog: NotNegative | tuple[NotNegative, NotNegative] = 0.0
    """Density b [1/m]: of the light of a thing at distance d, exp(-b d) is left; one sees 3.9 / b far."""
    image_noise: Fraction | tuple[Fraction, Fraction] = 0.0
    """Standard deviation of the noise of each value of a pixel, which is 0 to 1."""
    contrast: Positive | tuple[Positive, Positive] = 1.0
    """Factor of the distance of the image's values from grey."""
    image_delay: Steps | Delay = 0
    """Of the image [control steps]."""
    tires: str | None = None
    """Tire model: one of those that are shipped for the vehicle, such as pacejka2002, or a .json file. None: the
    task's."""

    def validate(self) -> None:
        """Check that bounds are in order, and that nothing is said twice."""
        super().validate()
        for name in RANDOM_RANGES:
            value = getattr(self, name)
            if isinstance(value, tuple):
                require(value[0] <= value[1], self, name, "one number, or two in order, least and largest")
        said = "body_mass" in self.randomise and self.mass != NEUTRAL["mass"]
        require(not said, self, "mass", "1 where randomise has a range of body_mass")
        said = "camera" in self.sensing and self.image_delay != NEUTRAL["image_delay"]
        require(not said, self, "image_delay", "0 where sensing says what the camera's delay is")

    def left_to_chance(self, name: str) -> bool:
        """Return True if `Conditions.RANDOM` draws a condition, because nothing else says what it is.

        Args:
            name: one of `RANDOM_RANGES`.
        """
        default = next(field.default for field in dataclasses.fields(self) if field.name == name)
        by_hand = {"mass": "body_mass" in self.randomise, "image_delay": "camera" in self.sensing}
        left = getattr(self, name) == default and not by_hand.get(name, False)
        return self.conditions is Conditions.RANDOM and left

    def span(self, name: str) -> Span | None:
        """Return the bounds between which a condition is drawn, equal where it is fixed; None: nothing changes it.

        Args:
            name: one of `RANDOM_RANGES`.
        """
        if self.left_to_chance(name):
            return RANDOM_RANGES[name]
        value = getattr(self, name)
        if value == NEUTRAL.get(name, ()):
            return None
        low, high = value if isinstance(value, tuple) else (value, value)
        return low, high

    def chassis_names(self) -> tuple[str, ...]:
        """Return the names of the bodies that `mass` acts on."""
        return ("chassis",)

    def uncertainty_of(self, own: Uncertainty, *, camera: bool) -> Uncertainty:
        """Return what is drawn with mass and delays in it.

        Args:
            own: what `randomise`, `sensing` and `action_delay` say.
            camera: True if there is one.
        """
        randomise, sensing, action_delay = dict(own.randomise), dict(own.sensing), own.action_delay
        mass, late, act_late = (self.span(name) for name in ("mass", "image_delay", "action_delay"))
        if mass is not None:
            randomise["body_mass"] = Range(*mass, only=self.chassis_names())
        if late is not None and camera:
            sensing["camera"] = Sensing(delay=_whole(late))
        if act_late is not None:
            action_delay = _whole(act_late)
        return Uncertainty(randomise, sensing, action_delay)

    def camera_arrays(self, suns: int) -> tuple[str, ...]:
        """Return the names of the camera's arrays that differ by world.

        Args:
            suns: number of suns in the task's light.
        """
        arrays: list[str] = []
        if self.span("light") is not None:
            arrays.append("exposure")
        if self.span("fog") is not None:
            arrays.append("fog_density")
        if suns and any(self.span(name) is not None for name in SUN):
            arrays += ["sun_direction", "sun_color"]
        return tuple(arrays)


def _whole(span: Span) -> Delay:
    return int(span[0]), int(span[1])


def middle(value: float | Span) -> float:
    """Return a number, or the middle between two."""
    return 0.5 * (value[0] + value[1]) if isinstance(value, tuple) else value


def set_middle_mass(config: ConditionsConfig, model: sw.Model) -> None:
    """Give chassis the middle of the masses that episodes draw, which write them anew: vehicles settle with it."""
    span = config.span("mass")
    if span is not None:
        bodies = [model.body(name) for name in config.chassis_names()]
        for name in ("body_mass", "body_inertia_b"):
            sw.to_torch(getattr(model, name))[:, bodies] *= middle(span)


class DrawnConditions:
    """Conditions of all worlds at work: hands on those that are not neutral, and draws those that have a range.

    Mass and delays are not here: `ConditionsConfig.uncertainty_of` hands them to what draws parameters and delays.

    Args:
        config: what is fixed, and what is drawn.
        random: of the task.
        worlds: their number W.
        friction: (W,) of the ground below the tires, written here; None on soil, whose own strength counts.
        images: of the policies' cameras, which show light, fog and noise; none without a camera.

    Attributes:
        values: name -> (W,) float32, of the running episodes; those that are neutral are not there.

    Raises:
        InputError: there is a place of the sun where the task's light has none.
    """

    def __init__(
        self, config: ConditionsConfig, random: WorldRandom, worlds: int, friction: torch.Tensor | None,
        images: Sequence[CameraImages], device: torch.device,
    ) -> None:  # fmt: skip
        self._random, self._friction, self._images = random, friction, images
        acting = (*(("friction",) if friction is not None else ()), *(SEEN if images else ()))
        spans = {name: config.span(name) for name in acting}
        if images and not images[0].has_sun:
            for name in SUN:
                if getattr(config, name) is not None:
                    raise InputError(f"{name.replace('_', '-')}: there is no sun in this task's light; leave it away")
                spans[name] = None
        self.values = {
            name: torch.full((worlds,), 0.5 * (span[0] + span[1]), device=device)
            for name, span in spans.items() if span is not None
        }  # fmt: skip
        self._drawn = {name: span for name, span in spans.items() if span is not None and span[0] < span[1]}
        self._nominal = {name: self._nominal_value(config, name) for name in self._drawn if config.left_to_chance(name)}
        for each in images:
            each.bind(self.values)
        self._write()

    def _nominal_value(self, config: ConditionsConfig, name: str) -> torch.Tensor:
        """Return the value (W,) of a condition as the task is built."""
        if name in SUN:
            return self._images[0].built_sun()[SUN.index(name)]
        return torch.full_like(self.values[name], float(getattr(config, name)))

    def draw(self, world_mask: torch.Tensor) -> None:
        """Draw the conditions of the running episodes, which begin or are taken up, where ``world_mask`` is true."""
        for images in self._images:
            images.begin(world_mask)
        if not self._drawn:
            return
        nominal = self._random.uniform("nominal conditions").squeeze(1) < NOMINAL_SHARE
        for name, (low, high) in self._drawn.items():
            drawn = self._random.uniform(f"condition {name}", low, high).squeeze(1)
            if name in self._nominal:
                drawn = torch.where(nominal, self._nominal[name], drawn)
            self.values[name].copy_(torch.where(world_mask, drawn, self.values[name]))
        self._write()

    def _write(self) -> None:
        """Hand the values to what they act on: the same numbers again in worlds that have not drawn."""
        if self._friction is not None and "friction" in self.values:
            self._friction.copy_(self.values["friction"])
        for images in self._images:
            images.light_up()
