"""Obstacles that stand anywhere: slots of a world, each of which shows one of a few things, turned and scaled."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
import warp as wp

import simwarp as sw

from ..framework.drawing import Line
from ..framework.recorded_launches import TensorFunction, filled
from ..randomisation.randomness import WorldRandom
from .obstacles_kernels import UNDERGROUND, SlotArrays, Slots, fill_slots


@dataclasses.dataclass(frozen=True)
class ObstacleKind:
    """A thing that may stand in the way, and how small or large it may be."""

    visual: sw.scenery.Visual
    scale: tuple[float, float]


class Obstacles:
    """Slots for obstacles, as many as a world may have; every world fills its own, anew in each episode.

    Contact sees the hull of a thing's first proxy, cameras its picture; both share one geometry for all worlds.

    Attributes:
        place: (W, N, 2) float32, feet of the obstacles [m].
        radius: (W, N) float32, of the upright cylinder around what contact sees [m]; -1 where a slot is empty.
        slots: the kinds, and what stands in the slots, for kernels.
        arrays: slots of the model and of the scene, for kernels; the latter is empty where there is none.
    """

    model_arrays: ClassVar[tuple[str, ...]] = ("shape_x", "shape_rot", "shape_size", "shape_asset", "shape_enabled")
    scene_arrays: ClassVar[tuple[str, ...]] = ("x", "rot", "size", "asset", "enabled")

    place: torch.Tensor
    radius: torch.Tensor
    slots: Slots
    arrays: tuple[SlotArrays, SlotArrays]

    def __init__(self, kinds: Sequence[ObstacleKind], count: int, *, group: int, mask: int) -> None:
        self.kinds, self.count = tuple(kinds), count
        self._group, self._mask = group, mask

    def __repr__(self) -> str:
        return f"Obstacles: {self.count} slots for {len(self.kinds)} kinds"

    def build(self, builder: sw.ModelBuilder) -> None:
        """Add the slots as shapes; they meet the groups of the mask."""
        hulls = [kind.visual.hull for kind in self.kinds]
        self._hulls = [builder.add_hull_asset(hull) for hull in hulls]
        self.shapes = [
            builder.add_shape_hull(
                sw.WORLD,
                hulls[0],
                name=f"obstacle_{slot}",
                pose=sw.pose((0.0, 0.0, UNDERGROUND)),
                group=self._group,
                mask=self._mask,
            )
            for slot in range(self.count)
        ]

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show pictures in place of the hulls."""
        visuals.hide(*self.shapes)
        self._visuals = [visuals.add_mesh_asset(kind.visual.mesh) for kind in self.kinds]
        self._instances = [
            visuals.add_mesh_instance(
                sw.WORLD, self._visuals[0], name=f"obstacle_{slot}_visual",
                label=int(self.kinds[0].visual.label), reflectance=self.kinds[0].visual.reflectance,
            )
            for slot in range(self.count)
        ]  # fmt: skip

    def bind(self, model: sw.Model, random: WorldRandom) -> None:
        """Make tables of a model's slots; things are drawn from ``random``."""
        device, worlds = str(model.device), model.world_count
        hulls = [kind.visual.hull for kind in self.kinds]
        reach = [float(np.linalg.norm(hull[:, :2], axis=1).max()) for hull in hulls]
        place = wp.zeros((worlds, self.count), dtype=wp.vec2, device=device)
        radius = wp.full((worlds, self.count), -1.0, dtype=float, device=device)
        self.place, self.radius = sw.to_torch(place), sw.to_torch(radius)
        self.slots = filled(
            Slots,
            reach=wp.array(reach, dtype=float, device=device),
            tallness=wp.array([float(hull[:, 2].max()) for hull in hulls], dtype=float, device=device),
            scale=wp.array([kind.scale for kind in self.kinds], dtype=wp.vec2, device=device),
            kinds=random.stream("obstacle kinds"),
            scales=random.stream("obstacle scales"),
            place=place,
            radius=radius,
        )
        arrays = {name: getattr(model, f"shape_{name}") for name in self.scene_arrays}
        assets: wp.array = wp.array(self._hulls, dtype=int, device=device)
        self._bound(filled(SlotArrays, first=self.shapes[0], assets=assets, **arrays), SlotArrays())

    def bind_scene(self, scene: sw.sensors.Scene) -> None:
        """Make tables of the slots of what cameras see."""
        arrays = {name: getattr(scene, name) for name in self.scene_arrays}
        assets: wp.array = wp.array(self._visuals, dtype=int, device=scene.x.device)
        self._bound(self.arrays[0], filled(SlotArrays, first=self._instances[0], assets=assets, **arrays))

    def _bound(self, model: SlotArrays, scene: SlotArrays) -> None:
        self.arrays = (model, scene)
        self._fill = TensorFunction(fill_slots, [self.slots, *self.arrays], [], self.place.device, dimensions=2)

    def fill(
        self, world_mask: torch.Tensor, place: torch.Tensor, height: torch.Tensor, heading: torch.Tensor,
        kind: torch.Tensor, scale: torch.Tensor, present: torch.Tensor,
    ) -> None:  # fmt: skip
        """Put things into the slots of the worlds of a mask (W,).

        Args:
            world_mask: only these worlds change.
            place: (W, N, 2) [m].
            height: (W, N) of their feet [m].
            heading: (W, N) [rad].
            kind: (W, N) index of the thing.
            scale: (W, N).
            present: (W, N) bool: slots that are filled; the others are empty.
        """
        numbers = [part.float().contiguous() for part in (place, height, heading)]
        self._fill(world_mask, *numbers, kind, scale.float(), present)

    def rings(self) -> list[Line]:
        """Return their outlines from above."""
        angle = torch.linspace(0.0, 2.0 * math.pi, 13, device=self.place.device)
        ring = torch.stack([angle.cos(), angle.sin()], dim=1)
        size = self.radius.clamp(min=0.0)
        return [
            Line(
                torch.nn.functional.pad(self.place[:, slot, None] + size[:, slot].view(-1, 1, 1) * ring, (0, 1)),
                "tab:brown", 1.5, only_maps=True,
            )
            for slot in range(self.count)
        ]  # fmt: skip
