"""Ground of robots on legs: a plane, or patches of rough ground whose level follows what a robot achieves.

A task makes one (:func:`ground_of`) and calls

- :meth:`FlatGround.build` in ``build``, :meth:`FlatGround.bind` in ``setup``;
- :meth:`FlatGround.choose` in ``reset``, before it places the robot in the middle, where the ground is level and at
  height 0 on all patches;
- :meth:`FlatGround.record` once per control step, in ``rewards``: what the curriculum judges by;
- :meth:`FlatGround.scan`, :meth:`FlatGround.height` and :meth:`FlatGround.outside` wherever it needs them;
- :meth:`FlatGround.climb` in ``on_iteration``, :meth:`FlatGround.extra_state` and
  :meth:`FlatGround.load_extra_state` in its own, :meth:`FlatGround.metrics` in ``metrics``, and
  :meth:`FlatGround.scene` in ``scene``;

and has ``per_world = RoughGround.model_arrays``, on flat ground too.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp.scenery.rough_ground import LEVELS, GroundKind, GroundPatch, ground_patch, level_colors
from simwarp.tasks import Ge, Le, NotNegative

from ...framework.config import require
from ...framework.config_values import Settings
from ...framework.recorded_launches import TensorFunction, TensorLaunch, fill, filled
from ...framework.task import Task
from ..walking_ground_kernels import (
    Climb,
    Heights,
    Patches,
    Rules,
    choose_patch,
    measure_heights,
    record_walk,
    scan_field,
    scan_plane,
    show_patches,
)
from .height_scan import GridScan, ScanConfig

__all__ = ["Climbing", "FlatGround", "Ground", "RoughConfig", "RoughGround", "ScanConfig", "ground_of"]

ANY_LEVEL = -1
BEYOND = 0.5
"""Distance of a base from the platform at which its feet are off it [m]."""


class Ground(enum.Enum):
    """What a robot walks on."""

    FLAT = "flat"
    ROUGH = "rough"
    SOIL = "soil"


class Climbing(enum.Enum):
    """When levels follow what robots achieve: never, in training, or always, as where a policy's level is measured."""

    NEVER = "never"
    TRAINING = "training"
    ALWAYS = "always"


@dataclasses.dataclass(frozen=True)
class RoughConfig(Settings):
    """Rough ground, and how its levels are chosen.

    Attributes:
        kinds: of the patches. A world that climbs keeps its kind, in turn by its index; others draw one per episode.
        variants: patterns of each kind and level, one of which is drawn per episode.
        seed: of the patterns; training and evaluation may have different ones.
        level: of worlds that do not climb, 0 to 9; -1 draws one per episode.
        climbing: when levels go up and down.
        first: a climb begins on levels 0 to this.
        up: share of the way that is enough to go up.
        down: share of the commanded way below which a world goes down.
        least: commanded way below which an episode decides nothing [m].
        again: who masters the last level goes to a random one, as training wants it: the mean level of those who
            master all is 6 then. Else it stays, as where a policy's level is measured.
    """

    NAMED: ClassVar[bool] = True
    kinds: tuple[GroundKind, ...] = (
        GroundKind.ROUGH,
        GroundKind.SLOPE_UP,
        GroundKind.SLOPE_DOWN,
        GroundKind.WAVES,
        GroundKind.STEPS,
        GroundKind.STAIRS_UP,
        GroundKind.STAIRS_DOWN,
    )
    variants: Annotated[int, Ge(1), Le(100)] = 2
    seed: Annotated[int, Ge(0), Le(10**9)] = 0
    level: Annotated[int, Ge(ANY_LEVEL), Le(LEVELS - 1)] = ANY_LEVEL
    climbing: Climbing = Climbing.TRAINING
    first: Annotated[int, Ge(0), Le(LEVELS - 1)] = 0
    up: Annotated[float, Ge(0.0), Le(1.0)] = 0.75
    down: Annotated[float, Ge(0.0), Le(1.0)] = 0.5
    least: NotNegative = 1.0
    again: bool = True

    def validate(self) -> None:
        """Check that there is a kind, and that who goes up would not go down."""
        require(len(self.kinds) > 0, self, "kinds", "at least one kind of ground")
        require(self.down <= self.up, self, "down", "at most up")


class FlatGround:
    """The plane z = 0, as ground of a batch of worlds.

    Args:
        scan: grid of the height scan.
        stand: height of the base over the feet of the robot that stands [m].

    Attributes:
        start: height of the ground below a robot that starts in the middle [m].
        shape: index of the ground among the shapes, once built.
        kind, level: (W,) int64, of the patches that worlds show, the kind among the configured ones; once bound. Of a
            plane they are 0.
    """

    scene_arrays: ClassVar[tuple[str, ...]] = ()
    start: ClassVar[float] = 0.0
    shape: int
    kind: torch.Tensor
    level: torch.Tensor

    def __init__(self, scan: ScanConfig, stand: float) -> None:
        self.scanned, self.stand = scan, stand
        self._scene: sw.sensors.Scene | None = None

    def build(
        self, builder: sw.ModelBuilder, *, material: sw.Material | None = None, group: int = 1, mask: int = 0x7FFFFFFF
    ) -> int:  # fmt: skip
        """Add the ground to the world; return the index of its shape.

        Args:
            builder: of one world.
            material: of the surface; None: the default one.
            group, mask: see :class:`~simwarp.ShapeOptions`.
        """
        self.shape = builder.add_shape_plane(name="ground", material=material, group=group, mask=mask)
        return self.shape

    def bind(self, task: Task[Any]) -> None:
        """Make tables of a task's worlds; its simulation exists."""
        device = task.device
        self.kind, self.level = torch.zeros(2, task.num_worlds, dtype=torch.int64, device=device)
        self._outside = torch.zeros(task.num_worlds, dtype=torch.bool, device=device)
        self._scan = GridScan(scan_plane, self.scanned, self.stand, task.num_worlds, device)

    def choose(self, world_mask: torch.Tensor) -> None:
        """Give the worlds of a mask (W,) bool the ground of their next episode."""

    def height(self, points: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of the ground at world points (W, N, 2) [m]: of the triangles that feet stand on.

        Beyond the border that of its nearest point.
        """
        return torch.zeros(points.shape[:2], device=points.device)

    def scan(self, position: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of the ground below the grid, over that of the feet of a robot that stands: 0 on
        level ground, positive where it is higher, cut off at the limit.

        On rough ground they are looked up in the height field. Rays (``height_scan.RayScan``) tell the same and cost
        more.

        Args:
            position: (W, 3) of the bases, world [m].
            yaw: (W,) headings [rad].
        """
        return self._scan(position, yaw)

    def outside(self, position: torch.Tensor) -> torch.Tensor:
        """Return (W,) bool: the base, at (W, 2 or 3) [m], is on the level rim, beyond which there is no ground."""
        return self._outside

    def record(self, velocity: torch.Tensor, command: torch.Tensor) -> None:
        """Count a control step for the curriculum; the clock of its episodes has counted it already.

        Args:
            velocity: (W, 2) of the bases [m/s].
            command: (W, 2) velocities that they should have, in the same axes [m/s].
        """

    def climb(self, climbing: bool = True) -> None:
        """Let levels follow what robots achieve, from their next episodes on; or no more."""

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return what an evaluation reports of the ground: the ``level`` (W,) float32 of rough ground."""
        return {}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return what a checkpoint must keep, name -> (W, ...)."""
        return {}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back, name -> (W, ...), and show the ground again."""

    def scene(self, task: Task[Any]) -> sw.sensors.Scene:
        """Return the scene of a task's pictures, always the same, in which patches have the colour of their level."""
        if self._scene is None:
            assert task.builder is not None
            visuals = sw.sensors.Visuals(task.builder)
            self._paint(visuals)
            task.visuals(visuals)
            sw.viewer.paint(visuals)
            self._scene = visuals.finalize(task.simulation.model, per_world=self.scene_arrays)
            self._show_in(self._scene, visuals)
        return self._scene

    def _paint(self, visuals: sw.sensors.Visuals) -> None:
        """Give the ground an appearance of its own, before the rest is painted."""

    def _show_in(self, scene: sw.sensors.Scene, visuals: sw.sensors.Visuals) -> None:
        """From now on colours of the ground follow its levels in a scene."""


class RoughGround(FlatGround):
    """Patches of rough ground, all of one size, which worlds share: each shows one.

    **Levels.** A world that climbs keeps its kind of ground. After an episode it goes up where its robot walked more
    than ``up`` times the way that a patch has room for, from the middle to the rim, or that it was commanded to walk,
    whichever is the smaller, and was off the platform with all feet: circles on level ground gain nothing. It goes
    down where it covered less than ``down`` times the commanded way; who masters the last level goes to a random one
    (Rudin et al. 2021, sec. IV). The way counts along the command and no faster than it: a robot that slides, or runs
    ahead, gains nothing. An episode that ends by a fall is held to the way that was still to come.

    The framework's :class:`~simwarp.tasks.Curriculum` does not fit: its level is a share of difficulty that every
    success raises and every failure lowers. Here a level is one of ten patches, most episodes end neither in success
    nor in failure, and a robot that stumbled but came far stays where it is. ``Task.level`` remains for what grows in
    a task, such as ``randomise``.

    Outside training nobody climbs: each episode draws a kind, and a level unless that is fixed.

    Args:
        config: patches and levels.
        scan: grid of the height scan.
        stand: height of the base over the feet of the robot that stands [m].
        patch: sizes of the patches.

    Attributes:
        model_arrays: model parameters that it writes, for ``per_world``.
        reach: distance from the middle, along x or y, at which a base is outside [m].
    """

    model_arrays: ClassVar[tuple[str, ...]] = ("shape_asset",)
    scene_arrays: ClassVar[tuple[str, ...]] = ("color",)

    def __init__(
        self, config: RoughConfig, scan: ScanConfig, stand: float, patch: GroundPatch | None = None
    ) -> None:  # fmt: skip
        super().__init__(scan, stand)
        self.config = config
        self.patch = GroundPatch() if patch is None else patch
        self.reach = 0.5 * self.patch.side - self.patch.rim

    def fields(self) -> list[np.ndarray[Any, np.dtype[np.float32]]]:
        """The patches by kind, level and variant, each (rows, columns) [m]; no two levels have the same pattern."""
        config = self.config
        return [
            ground_patch(kind, level, (config.seed * config.variants + variant) * LEVELS + level, patch=self.patch)
            for kind in config.kinds
            for level in range(LEVELS)
            for variant in range(config.variants)
        ]

    def build(
        self, builder: sw.ModelBuilder, *, material: sw.Material | None = None, group: int = 1, mask: int = 0x7FFFFFFF
    ) -> int:  # fmt: skip
        """Add all patches as assets, and the ground as one shape that shows one of them; see :class:`FlatGround`."""
        fields, size = self.fields(), (self.patch.side,) * 2
        self._assets = [builder.add_height_field_asset(field, size=size) for field in fields]
        self.shape = builder.add_shape_height_field(
            sw.WORLD, fields[0], size=size, name="ground", material=material, group=group, mask=mask
        )
        return self.shape

    def bind(self, task: Task[Any]) -> None:
        """Make tables of a task's worlds, and record what is launched for them."""
        model, worlds, device, config = task.simulation.model, task.num_worlds, task.device, self.config
        self._patches = filled(
            Patches,
            shape=self.shape,
            kinds=len(config.kinds),
            levels=LEVELS,
            variants=config.variants,
            asset=wp.array(self._assets, dtype=int, device=str(device)),
            shape_asset=model.shape_asset,
            tint=wp.array(level_colors().astype(np.float32), dtype=wp.vec3, device=str(device)),
        )
        streams = {"begin": "first level", "kind": "ground", "level": "level of ground", "variant": "pattern of ground"}
        self._rules = filled(
            Rules,
            first=config.first,
            fixed=config.level,
            reach=self.reach,
            beyond=0.5 * self.patch.platform + BEYOND,
            up=config.up,
            down=config.down,
            least=config.least,
            again=int(config.again),
            **{name: task.random.stream(purpose) for name, purpose in streams.items()},
        )
        flags, whole, lengths = (
            ("climbing", "judged"),
            ("kind", "level", "variant"),
            ("walked", "asked", "expected", "farthest"),
        )
        dtypes = {torch.int32: flags, torch.int64: whole, torch.float32: lengths}
        self._state = {
            name: torch.zeros(worlds, dtype=dtype, device=device) for dtype, names in dtypes.items() for name in names
        }
        self.level, self.kind = self._state["level"], self._state["kind"]
        self._climb = filled(Climb, **self._state)
        self._draws = task.random.draws
        heights = filled(
            Heights,
            shape=self.shape,
            nodes=2 * self.patch.half + 1,
            scale=1.0 / self.patch.spacing,
            shape_asset=model.shape_asset,
            start=model.assets.field_start,
            height=model.assets.field_height,
        )
        self._height = TensorFunction(measure_heights, [heights], [(torch.float32, ())], device, dimensions=2)
        self._scan = GridScan(scan_field, self.scanned, self.stand, worlds, device, [heights])
        timed = [task.episode_clock, task.config.max_episode_steps, task.config.control_dt]
        self._walk = TensorFunction(record_walk, [*timed, self._climb], [], device)
        self._place = task.map_position
        self._record_launches()
        self._climbs = False
        if config.climbing is Climbing.ALWAYS:
            self.climb()

    def _record_launches(self) -> None:
        """Record what depends on whether a scene shows the ground."""
        device, worlds = self.level.device, len(self.level)
        every = torch.ones(worlds, dtype=torch.bool, device=device)
        arguments = [every, self._rules, self._draws, self._patches, self._climb]
        self._choose = TensorLaunch(choose_patch, worlds, arguments, device)
        self._show = TensorLaunch(show_patches, worlds, [self._patches, self._climb], device)

    def choose(self, world_mask: torch.Tensor) -> None:
        """Judge the episodes of the worlds of a mask (W,) bool that are over, where they climb; show their patches."""
        self._choose.on(world_mask)

    def height(self, points: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of the patches at points (W, N, 2) [m]; see :class:`FlatGround`."""
        return self._height(points.float().contiguous())[0]

    def outside(self, position: torch.Tensor) -> torch.Tensor:
        """Return (W,) bool: the base, at (W, 2 or 3) [m], is on the level rim, beyond which there is no ground."""
        return position[:, :2].abs().amax(dim=1) > self.reach

    def record(self, velocity: torch.Tensor, command: torch.Tensor) -> None:
        """Count a control step for the curriculum; see :class:`FlatGround`. Bases are at ``Task.map_position``.

        Args:
            velocity: (W, 2) of the bases [m/s].
            command: (W, 2) velocities that they should have, in the same axes [m/s].
        """
        place = self._place()
        assert place is not None
        self._walk(*(part.float().contiguous() for part in (velocity, command, place)))

    def climb(self, climbing: bool = True) -> None:
        """Let levels follow what robots achieve, from their next episodes on; or no more. Twice is as once."""
        climbing = climbing and self.config.climbing is not Climbing.NEVER
        if climbing and not self._climbs:
            self._state["judged"].zero_()
        self._state["climbing"].fill_(int(climbing))
        self._climbs = climbing

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``level`` of the running episodes, (W,) float32."""
        return {"level": self.level.float()}

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return what a checkpoint must keep, name -> (W,)."""
        return {f"ground_{name}": values for name, values in self._state.items()}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back, name -> (W,), and show the patches: a checkpoint does not keep model parameters."""
        for name, values in self._state.items():
            values.copy_(state[f"ground_{name}"])
        self._climbs = bool(self._state["climbing"].any())
        self._show.launch()

    def _paint(self, visuals: sw.sensors.Visuals) -> None:
        """A checker whose squares, half a metre wide, show how steep the ground is; levels give its colour."""
        checker = sw.sensors.CheckerTexture(colors=((0.85, 0.85, 0.85), (1.0, 1.0, 1.0)), metres=0.5)
        visuals.show(self.shape, color=(1.0, 1.0, 1.0), texture=visuals.texture(checker))

    def _show_in(self, scene: sw.sensors.Scene, visuals: sw.sensors.Visuals) -> None:
        fill(self._patches, color=scene.color, instance=visuals.index_of(self.shape))
        self._record_launches()
        self._show.launch()


def ground_of(
    kind: Ground, stand: float, *, rough: RoughConfig | None = None, scan: ScanConfig | None = None
) -> FlatGround:  # fmt: skip
    """Return the ground that a configuration asks for.

    Args:
        kind: a plane, or patches; of soil the undeformed surface, a plane.
        stand: height of the base over the feet of the robot that stands [m].
        rough: patches and levels of rough ground.
        scan: grid of the height scan.
    """
    grid = ScanConfig() if scan is None else scan
    if kind is not Ground.ROUGH:
        return FlatGround(grid, stand)
    return RoughGround(RoughConfig() if rough is None else rough, grid, stand)
