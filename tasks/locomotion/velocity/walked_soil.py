"""Soil below a robot on legs: its parameters, its grid and memory, and what it does to feet and belly."""

from __future__ import annotations

import dataclasses
import enum
from typing import Annotated, Any, ClassVar, Final

import numpy as np
import torch

import simwarp as sw
from simwarp.tasks import Ge, Le, Positive

from ...framework.config_values import Settings
from ...framework.named_contacts import SoilForces
from ...randomisation.randomness import WorldRandom
from ...randomisation.soil_draws import RIGID_SHARE, SoilDraws, rigid_soil

SOFTEST: Final = "sand"
"""Preset at the soft end of what is drawn: on softer ones feet of a few centimetres find no ground."""
HARDEST: Final = "hard"
"""Preset at the other end."""


class WalkedSoilKind(enum.Enum):
    """What the feet sink into."""

    SOFT = "soft"
    SAND = "sand"
    MID = "mid"
    HARD = "hard"
    CLAY = "clay"
    SNOW = "snow"
    RANDOM = "random"


@dataclasses.dataclass(frozen=True)
class WalkedSoilConfig(Settings):
    """Soil, of ``ground`` soil.

    Attributes:
        kind: a preset by name; random: between sand and hard, drawn for every episode, one in five nearly rigid.
        rough: its undeformed surface is a patch of rough ground, as ``rough`` says, and not a plane.
        spacing: of its nodes [m]; four or more across a foot.
        pages: of 8 x 8 nodes, of each world; when all are taken, the oldest footprints are lost.
    """

    NAMED: ClassVar[bool] = True
    kind: WalkedSoilKind = WalkedSoilKind.SAND
    rough: bool = False
    spacing: Positive = 0.01
    pages: Annotated[int, Ge(16), Le(2**20)] = 1024


class WalkedSoil:
    """The soil of a task on legs. All shapes of the robot sink in.

    Args:
        model: finished, in which the ground meets no shape.
        ground: index of the plane or height field that is its undeformed surface.
        config: which soil, and its grid.
        random: of the task.
        friction: of nearly rigid ground.

    Attributes:
        element: the force element (`simwarp.soil.Soil`), after all that acts on the robot's bodies.
        forces: what it does to the robot's parts, by names of shapes and of bodies.
        parameter: (W, 1, 9) of `SoilSpec.values`.

    Raises:
        ModelError: the spacing does not suit the shapes, or one of them cannot sink in.
    """

    def __init__(
        self, model: sw.Model, ground: int, config: WalkedSoilConfig, random: WorldRandom, *, friction: float
    ) -> None:
        presets = sw.soil.PRESETS
        drawn = config.kind is WalkedSoilKind.RANDOM
        soil = presets[SOFTEST if drawn else config.kind.value]
        self.element = sw.soil.Soil(
            model, sw.soil.soil_shapes(model), soil, ground=sw.vehicle.ground_of(model, ground),
            spacing=config.spacing, pages=config.pages, per_world=True,
        )  # fmt: skip
        self._draws = SoilDraws(
            self.element, None if drawn else soil, random, soft=presets[SOFTEST], hard=presets[HARDEST],
            rigid=rigid_soil(friction), rigid_share=RIGID_SHARE,
        )  # fmt: skip
        self.parameter = self._draws.parameter
        self.forces = SoilForces(sw.to_torch(self.element.force_w), _rows_by_name(model))
        self._shown: Any = None

    def draw(self, world_mask: torch.Tensor) -> None:
        """Write the parameters of the running episodes where ``world_mask`` (W,) is true."""
        self._draws.draw(world_mask)

    def show_in(self, scene: sw.sensors.Scene) -> sw.sensors.Scene:
        """Let a scene show the footprints; return it."""
        if self._shown is not scene:
            scene.cover_with(self.element, "ground")
            self._shown = scene
        return scene


def _rows_by_name(model: sw.Model) -> dict[str, list[int]]:
    """Rows of `soil_shapes` of all bodies by the names of shapes and of bodies."""
    bodies = model.topology.shape_body.numpy()
    moving = np.flatnonzero(bodies >= 0)
    rows: dict[str, list[int]] = {}
    for row, shape in enumerate(moving[np.argsort(bodies[moving], kind="stable")]):
        rows.setdefault(model.body_names[bodies[shape]], []).append(row)
    for row, shape in enumerate(moving[np.argsort(bodies[moving], kind="stable")]):
        rows[model.shape_names[shape]] = [row]
    return rows
