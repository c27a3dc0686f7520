"""Obstacles that stand anywhere: slots of a world, each of which shows one of a few things, turned and scaled."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import torch

from ..framework.drawing import Line
from ..framework.frames import heading_quaternion

if TYPE_CHECKING:
    from simwarp import Model, ModelBuilder
    from simwarp.scenery import Visual
    from simwarp.sensors import Scene, Visuals

    from ..randomisation.randomness import WorldRandom

UNDERGROUND = -100.0
"""Height of obstacles that do not take part [m]."""


@dataclasses.dataclass(frozen=True)
class Kind:
    """A thing that may stand in the way, and how small or large it may be."""

    visual: Visual
    scale: tuple[float, float]


class Obstacles:
    """As many slots as a world may have obstacles; every world fills its own, anew in each episode.

    Contact sees the hull of a thing's first proxy, cameras its picture; both share one geometry for all worlds.

    Attributes:
        place: (W, N, 2) float32, feet of the obstacles [m].
        radius: (W, N) float32, of the upright cylinder around what contact sees [m]; -1 where a slot is empty.
    """

    model_arrays: ClassVar[tuple[str, ...]] = ("shape_x", "shape_rot", "shape_size", "shape_asset", "shape_enabled")
    scene_arrays: ClassVar[tuple[str, ...]] = ("x", "rot", "size", "asset", "enabled")

    place: torch.Tensor
    radius: torch.Tensor

    def __init__(self, kinds: Sequence[Kind], count: int, *, group: int, mask: int) -> None:
        self.kinds, self.count = tuple(kinds), count
        self._group, self._mask = group, mask
        self._seen: dict[str, torch.Tensor] = {}

    def build(self, builder: ModelBuilder) -> None:
        """Add the slots as shapes; they meet the groups of the mask."""
        import simwarp as sw

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

    def visuals(self, visuals: Visuals) -> None:
        """Show pictures in place of the hulls."""
        import simwarp as sw

        visuals.hide(*self.shapes)
        self._visuals = [visuals.add_mesh_asset(kind.visual.mesh) for kind in self.kinds]
        self._instances = [
            visuals.add_mesh_instance(
                sw.WORLD, self._visuals[0], name=f"obstacle_{slot}_visual",
                label=int(self.kinds[0].visual.label), reflectance=self.kinds[0].visual.reflectance,
            )
            for slot in range(self.count)
        ]  # fmt: skip

    def bind(self, model: Model) -> None:
        """Make views of the arrays of a model."""
        from simwarp import to_torch

        first, after = self.shapes[0], self.shapes[0] + self.count
        views = {name: to_torch(getattr(model, name))[:, first:after] for name in self.model_arrays}
        self._x, self._rot, self._size = views["shape_x"], views["shape_rot"], views["shape_size"]
        self._asset, self._enabled = views["shape_asset"], views["shape_enabled"]
        device = self._x.device
        self._hull = torch.tensor(self._hulls, dtype=torch.int32, device=device)
        hulls = [kind.visual.hull for kind in self.kinds]
        reach = [float(np.linalg.norm(hull[:, :2], axis=1).max()) for hull in hulls]
        self._reach = torch.tensor(reach, dtype=torch.float32, device=device)
        self._height = torch.tensor([float(hull[:, 2].max()) for hull in hulls], device=device)
        self._scale = torch.tensor([kind.scale for kind in self.kinds], device=device)
        self.place = self._x[..., :2].float()
        self.radius = torch.full(self.place.shape[:2], -1.0, device=device)

    def bind_scene(self, scene: Scene) -> None:
        """Make views of the arrays of what cameras see."""
        from simwarp import to_torch

        first, after = self._instances[0], self._instances[0] + self.count
        self._seen = {name: to_torch(getattr(scene, name))[:, first:after] for name in self.scene_arrays}
        self._visual = torch.tensor(self._visuals, dtype=torch.int32, device=self._seen["asset"].device)

    def draw_kinds(self, random: WorldRandom) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the index of the thing in each slot (W, N) int64, and its scale (W, N)."""
        kind = random.uniform("obstacle kinds", 0.0, len(self.kinds), self.count).to(torch.int64)
        low, high = self._scale[kind].unbind(dim=2)
        return kind, low + (high - low) * random.uniform("obstacle scales", size=self.count)

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
        where = world_mask.unsqueeze(1)
        wide = where.unsqueeze(2)
        level = torch.where(present, height, UNDERGROUND)
        turn = heading_quaternion(heading.reshape(-1)).view(*heading.shape, 4)
        values = {
            "x": torch.cat([place, level.unsqueeze(2)], dim=2).double(), "rot": turn,
            "size": scale.unsqueeze(2).expand(-1, -1, 3),
        }  # fmt: skip
        shapes = {"x": self._x, "rot": self._rot, "size": self._size}
        for name, value in values.items():
            for target in (shapes[name], *([self._seen[name]] if self._seen else [])):
                target.copy_(torch.where(wide, value.to(target.dtype), target))
        self._asset.copy_(torch.where(where, self._hull[kind], self._asset))
        self._enabled.copy_(torch.where(where, present.int(), self._enabled))
        if self._seen:
            self._seen["asset"].copy_(torch.where(where, self._visual[kind], self._seen["asset"]))
            self._seen["enabled"].copy_(torch.where(where, present.int(), self._seen["enabled"]))
        self.place.copy_(torch.where(wide, place, self.place))
        self.radius.copy_(torch.where(where, torch.where(present, scale * self._reach[kind], -1.0), self.radius))

    def rings(self) -> list[Line]:
        """Return their outlines from above."""
        angle = torch.linspace(0.0, 2.0 * math.pi, 13, device=self.place.device)
        ring = torch.stack([angle.cos(), angle.sin()], dim=1)
        size = self.radius.clamp(min=0.0)
        return [
            Line(
                torch.nn.functional.pad(self.place[:, slot, None] + size[:, slot].view(-1, 1, 1) * ring, (0, 1)),
                "tab:brown", 1.5,
            )
            for slot in range(self.count)
        ]  # fmt: skip

    def reach(self, kind: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
        """Return the radius of the upright cylinder around a thing [m]."""
        return scale * self._reach[kind]

    def tallness(self, kind: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
        """Return the height of what contact sees of a thing [m]."""
        return scale * self._height[kind]
