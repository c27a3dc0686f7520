"""Soil below a driven vehicle: which one, its grid and memory, and parameters that are drawn for every episode."""

from __future__ import annotations

import enum
import math
from typing import Any, Final

import torch

import simwarp as sw

from ..randomisation.randomness import WorldRandom
from ..randomisation.soil_draws import RIGID_SHARE, SoilDraws, rigid_soil

USUAL_SPEED: Final = 8.0
"""At which ruts of a whole episode find room [m/s]."""
LONGEST_RUT: Final = 200.0
"""What is remembered at most behind a vehicle [m]."""
GROUNDS: Final = ("hills", "ground")
"""Names of the plane or height field in a scene that shows the ground."""


class SoilKind(enum.Enum):
    """What the wheels roll on."""

    NONE = "none"
    SOFT = "soft"
    SAND = "sand"
    MID = "mid"
    HARD = "hard"
    CLAY = "clay"
    SNOW = "snow"
    RANDOM = "random"


def pages_for(time: float, spacing: float, wheels: int, width: float) -> int:
    """Pages of 8 x 8 nodes that hold the ruts of an episode at `USUAL_SPEED`, or the last `LONGEST_RUT` of them.

    A track of one width in all directions crosses (4 / pi) (1 + width / side) / side pages of that side per metre.
    Rear wheels follow the front wheels, so that half of the wheels have tracks of their own.

    Args:
        time: that an episode lasts at most [s].
        spacing: of the nodes [m].
        wheels: number of them.
        width: of the widest wheel [m].
    """
    side = sw.soil.PAGE_SIDE * spacing
    way = min(USUAL_SPEED * time, LONGEST_RUT)
    tracks = 0.5 * wheels * (4.0 / math.pi) * (1.0 + width / side) / side
    return math.ceil(tracks * way) + 4 * wheels


class DrivenSoil:
    """The soil of a driving task, which differs by world and episode where it is `SoilKind.RANDOM`.

    Then its parameters are drawn between those of the presets soft and hard (`SoilDraws`). One in five episodes is
    nearly rigid (`RIGID_SHARE`).

    Args:
        vehicle: on `soil-rigid` tires; or several, which meet each other's ruts.
        kind: not `SoilKind.NONE`.
        random: of the task.
        ground: the undeformed ground (`simwarp.vehicle.ground`); the plane z = 0 when None.
        friction: of nearly rigid ground.
        spacing: of the nodes [m].
        pages: of each world; None: those that `pages_for` an episode.
        time: that an episode lasts at most [s].

    Attributes:
        element: the force element (`simwarp.soil.Soil`); it comes after the vehicle.
        parameter: (W, 1, 9) of `SoilSpec.values`.

    Raises:
        ModelError: the spacing does not suit the wheels.
    """

    def __init__(
        self, vehicle: sw.vehicle.Vehicle | sw.vehicle.Vehicles, kind: SoilKind, random: WorldRandom, *, ground: Any,
        friction: float, spacing: float, pages: int | None, time: float,
    ) -> None:  # fmt: skip
        parts = vehicle.parts if isinstance(vehicle.parts, tuple) else (vehicle.parts,)
        widest = max(axle.tire.width for axle in parts[0].spec.all_axles)
        wheels = sum(len(each.sides) for each in parts)
        settling = sw.soil.PRESETS["mid" if kind is SoilKind.RANDOM else kind.value]
        self.element = sw.soil.soil_under(
            vehicle, settling, ground=ground, spacing=spacing, per_world=True,
            pages=pages or pages_for(time, spacing, wheels, widest),
        )  # fmt: skip
        self._parts = parts
        soil = None if kind is SoilKind.RANDOM else settling
        ends = {"soft": sw.soil.PRESETS["soft"], "hard": sw.soil.PRESETS["hard"]}
        self._draws = SoilDraws(self.element, soil, random, **ends, rigid=rigid_soil(friction), rigid_share=RIGID_SHARE)
        self.parameter = self._draws.parameter
        self._shifts: torch.Tensor | None = None

    def draw(self, world_mask: torch.Tensor) -> None:
        """Write the parameters of the running episodes where ``world_mask`` (W,) is true.

        Until the first call a soil that is drawn is mid: vehicles settle on that.
        """
        self._draws.draw(world_mask)

    def keep(self, bodies: torch.Tensor) -> None:
        """Remember how the soil carries the vehicles, which have come to rest.

        Args:
            bodies: (W, B, 3) float64 places of all bodies [m], which `press_in` moves up or down.
        """
        self.element.keep_forces()
        self._bodies = bodies

    def press_in(self, world_mask: torch.Tensor) -> None:
        """Move each vehicle, which stands as it settled, to the depth at which the soil of this episode carries it, and
        press its imprint in, where ``world_mask`` (W,) is true.

        Args:
            world_mask: only these worlds change.
        """
        kept = self.element.resting_shifts(world_mask)
        if self._shifts is None:  # the same memory throughout
            self._shifts = sw.to_torch(kept)
        shifts = self._shifts.double()
        shifts = torch.where(world_mask.unsqueeze(1), shifts, torch.zeros_like(shifts))
        first = 0
        for parts in self._parts:
            wheels = slice(first, first + len(parts.sides))
            self._bodies[:, parts.bodies.start : parts.bodies.stop, 2] += shifts[:, wheels].mean(dim=1, keepdim=True)
            first = wheels.stop
        self.element.imprint(world_mask)

    def show_in(self, scene: sw.sensors.Scene) -> None:
        """Let a scene show the ruts, if one of `GROUNDS` is in it: roads and floors of other kinds stay as they are."""
        shown = [name for name in GROUNDS if name in scene.names]
        if shown:
            scene.cover_with(self.element, shown[0])
