"""Convoy: a truck follows the last of three leaders along winding paths, past rocks and trees, faster and faster.

After ``convoy-v0`` of gym-chrono: paths, leaders, their speed and the reward's cone are the original's. Leaders are
ghosts: they are seen, they move as the path says, and nothing moves them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
import torch

from simwarp.tasks import Ge, Gt, Le, Positive

from ..framework.config import require
from ..framework.drawing import Drawing, Line
from ..framework.frames import heading_quaternion, to_heading
from ..framework.registry import register
from .base import CHASSIS_GROUP, VEHICLE_ARRAYS, DrivingConfig, DrivingTask, Frame, corners, outline
from .obstacles import Kind, Obstacles
from .ranging import RangeFan
from .routes import Routes

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Scene, Visuals

LEADERS = 3
APART = 0.05
"""Distance of the vehicles along the path, as a share of it."""
DURATION = 60.0
"""Time in which a leader that starts at the beginning comes to the end, ever faster [s]."""
OBSTACLES, LARGE = 8, 4
LEADER_HALF = (2.45, 1.1, 0.9)
_REACH, _RAYS, _FAN = 20.0, 17, math.radians(200.0)
_LENGTHS, _SPEED = 20.0, 10.0


@dataclasses.dataclass(frozen=True)
class ConvoyConfig(DrivingConfig):
    """Configuration of :class:`ConvoyTask`."""

    dt: float = 0.0025
    """Physics step [s]."""
    decimation: int = 80
    """Physics steps per control step: five actions a second."""
    max_episode_steps: int = 310
    """Control steps after which an episode is truncated; leaders are at the end of the path before."""
    latest_start: Annotated[float, Ge(0.0), Le(0.8)] = 0.5
    """The nearest leader starts between 0.05 and this more of its path, as shares."""
    generated: bool = False
    """Paths around four large obstacles, other than the sixteen of training."""
    place_frame: Frame = Frame.VEHICLE
    """Axes in which the leader's place is observed with a camera."""
    cone: Annotated[float, Gt(0.0), Le(math.pi)] = math.pi / 4.0
    """Half angle of the cone behind the leader in which following is paid for [rad]."""
    near: float = 16.0
    """Distance up to which following is paid in full [m]."""
    softness: Positive = 4.0
    """Distance beyond ``near`` at which the pay is halved [m]. The original has 0.2."""
    following_weight: float = 0.1
    """Reward of a step in the cone and near. The original pays 100."""
    speed_weight: float = 0.0
    """Taken per relative difference of speed; the thesis has none, the original's code 5 % of ``following_weight``."""
    lost_distance: float = 30.0
    """An episode ends where the leader is farther away [m]."""
    failure_weight: float = 2.0
    """Taken for touching an obstacle or a leader, for losing the leader, or turning over."""

    def validate(self) -> None:
        """Check sizes."""
        super().validate()
        require(0.0 < self.near < self.lost_distance, self, "near", "in (0, lost_distance)")


@register("convoy")
class ConvoyTask(DrivingTask[ConvoyConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 6): where the leader is, heading and both
    speeds, as measured; or, with ``obs`` state, ``policy`` (W, 34): exact places, motion, and ranges to obstacles.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "convoy: a truck follows a leader along winding paths, past rocks and trees"
    config_type: ClassVar[type[DrivingConfig]] = ConvoyConfig
    per_world: ClassVar[tuple[str, ...]] = (*VEHICLE_ARRAYS, *Obstacles.model_arrays)
    success_reasons: ClassVar[frozenset[str]] = frozenset({"goal"})
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 180,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "network.init_std": 0.6,
        "ppo.gamma": 0.98,
        "ppo.entropy": 0.002,
    }
    navigates: ClassVar[bool] = True
    view_distance: ClassVar[float] = 40.0

    # ---- the world -----------------------------------------------------------------------------------------------

    def build_world(self, builder: ModelBuilder) -> None:
        """Slots for what stands beside the path."""
        from simwarp.scenery import ROCKS, bush, rock, tree

        kinds = [Kind(rock(kind, 10 + seed), (0.7, 1.2)) for seed, kind in enumerate(ROCKS)]
        kinds += [
            Kind(bush("round", 1), (0.8, 1.3)),
            Kind(tree("oak", 1), (0.7, 1.0)),
            Kind(tree("spruce", 1), (0.7, 1.0)),
        ]
        large = LARGE if self.config.generated else 0
        self.obstacles = Obstacles(kinds, OBSTACLES + large, group=1, mask=CHASSIS_GROUP)
        self.obstacles.build(builder)

    def visuals(self, visuals: Visuals) -> None:
        """Show truck, leaders, obstacles, and grass."""
        import simwarp as sw
        from simwarp.scenery import ground_texture, vehicle_visual
        from simwarp.sensors import ImageTexture

        super().visuals(visuals)
        self.obstacles.visuals(visuals)
        grass = visuals.texture(ImageTexture(image=ground_texture("grass"), metres=(8.0, 8.0)))
        visuals.add_plane(name="ground", texture=grass, color=(1.0, 1.0, 1.0), label=1)
        leader = vehicle_visual("hmmwv", color=(0.5, 0.05, 0.03))
        asset = visuals.add_mesh_asset(leader.mesh)
        self._ghosts = [
            visuals.add_mesh_instance(sw.WORLD, asset, name=f"leader_{index}", label=int(leader.label))
            for index in range(LEADERS)
        ]

    def seen_per_world(self) -> Sequence[str]:
        """Obstacles and leaders differ."""
        return Obstacles.scene_arrays

    def setup(self) -> None:
        """Make paths, views and buffers."""
        from simwarp.scenery import CONVOY_PATHS, convoy_path, detour

        super().setup()
        detours = [detour(seed, count=LARGE) for seed in range(CONVOY_PATHS)] if self.config.generated else []
        paths = [way.path for way in detours] or [convoy_path(index) for index in range(CONVOY_PATHS)]
        self.routes = Routes(paths, 0.5, self.device)
        self._large = torch.tensor(
            np.array([way.obstacles for way in detours]).reshape(-1, LARGE, 3), dtype=torch.float32, device=self.device
        )
        self.obstacles.bind(self.simulation.model)
        worlds = self.num_worlds
        self.route = torch.zeros(worlds, dtype=torch.int64, device=self.device)
        self._begun = torch.zeros(worlds, device=self.device)
        self._deviation = torch.zeros(worlds, device=self.device)
        self._own_corners, self._leader_corners = (
            corners(half, self.device) for half in (self.chassis_half, LEADER_HALF)
        )
        self._fan = RangeFan(_RAYS, _FAN, _REACH, self.device)
        if self.camera is not None:
            self._frame_steps = math.gcd(self.camera.frames.steps.period, self.config.decimation)

    def bind_scene(self, scene: Scene) -> None:
        """Make views of obstacles and leaders."""
        from simwarp import to_torch

        self.obstacles.bind_scene(scene)
        first, after = self._ghosts[0], self._ghosts[0] + LEADERS
        self._ghost_x = to_torch(scene.x)[:, first:after]
        self._ghost_rot = to_torch(scene.rot)[:, first:after]

    # ---- an episode ----------------------------------------------------------------------------------------------

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw path, start, and what stands beside the path."""
        random = self.random
        route = random.uniform("path", 0.0, len(self.routes.length)).squeeze(1).long()
        begun = APART + random.uniform("begin", 0.0, self.config.latest_start).squeeze(1)
        self.route.copy_(torch.where(world_mask, route, self.route))
        self._begun.copy_(torch.where(world_mask, begun, self._begun))
        self._place_obstacles(world_mask)
        self._show_leaders(self._time())

    def _place_obstacles(self, world_mask: torch.Tensor) -> None:
        """At equal steps along the path, to either side, so far away that it stays free; and large ones between."""
        random, count = self.random, self.obstacles.count
        kind, scale = self.obstacles.draw_kinds(random)
        heading = random.uniform("obstacle headings", -math.pi, math.pi, count)
        share = (torch.arange(OBSTACLES, device=self.device) + 1.0) / (OBSTACLES + 1.0)
        length = self.routes.length[self.route].unsqueeze(1)
        along = self.routes.at(self.route, share * length)
        if self.config.generated:
            large = self._large[self.route]
            kind[:, OBSTACLES:] = 0
            scale[:, OBSTACLES:] = large[..., 2] / self.obstacles.reach(kind, torch.ones_like(scale))[:, OBSTACLES:]
        reach = self.obstacles.reach(kind, scale)
        side = 1.0 - 2.0 * (random.uniform("sides", size=OBSTACLES) < 0.5).float()
        aside = side * (reach[:, :OBSTACLES] + LEADER_HALF[1] + 1.5 + random.uniform("gaps", 0.0, 2.0, OBSTACLES))
        place = torch.stack(
            [along[..., 0] - aside * along[..., 2].sin(), along[..., 1] + aside * along[..., 2].cos()], dim=2
        )
        if self.config.generated:
            place = torch.cat([place, large[..., :2]], dim=1)
        free = torch.stack(
            [self.routes.distance(self.route, place[:, slot]) for slot in range(count)], dim=1
        ) > reach + LEADER_HALF[1] + 0.5  # fmt: skip
        sunk = -0.1 * self.obstacles.tallness(kind, scale)
        self.obstacles.fill(world_mask, place, sunk, heading, kind, scale, free)

    def start(self, world_mask: torch.Tensor) -> None:
        """On the path behind the leaders."""
        arc = (self._begun - APART) * self.routes.length[self.route]
        at = self.routes.at(self.route, arc.unsqueeze(1)).squeeze(1)
        self.place_vehicle(world_mask, torch.nn.functional.pad(at[:, :2], (0, 1)), at[:, 2])
        self._deviation.masked_fill_(world_mask, 0.0)
        self._show_leaders(torch.where(world_mask, 0.0, self._time()))

    def _time(self) -> torch.Tensor:
        """(W,) since the episode began, at the end of the last control step [s]."""
        return self.episode_steps * self.config.control_dt

    def _leaders(self, time: torch.Tensor) -> torch.Tensor:
        """(W, 3, 3) places and headings of the leaders, the nearest first."""
        ahead = APART * torch.arange(LEADERS, device=self.device)
        share = self._begun.unsqueeze(1) + ahead + (time / DURATION).square().unsqueeze(1)
        return self.routes.at(self.route, share * self.routes.length[self.route].unsqueeze(1))

    def _leader_speed(self) -> torch.Tensor:
        """(W,) [m/s]."""
        return 2.0 * self._time() / DURATION**2 * self.routes.length[self.route]

    def _show_leaders(self, time: torch.Tensor) -> None:
        if self._scene is None:
            return
        at = self._leaders(time)
        self._ghost_x[..., :2] = at[..., :2]
        turn = heading_quaternion(at[..., 2].reshape(-1)).view(*at.shape[:2], 4)
        self._ghost_rot.copy_(turn)

    def begin_step(self) -> None:
        """Move the leaders, if there is an image at the end of the first physics step."""
        super().begin_step()
        self._aim_leaders()

    def after_physics(self) -> None:
        """Move the leaders, if there is an image at the end of the next physics step."""
        super().after_physics()
        self._aim_leaders()

    def _aim_leaders(self) -> None:
        """Show the leaders where they are when the coming image is taken; it is taken within the physics step."""
        if self.camera is not None and (self._substep + 1) % self._frame_steps == 0:
            self._show_leaders(self._time() + (self._substep + 1) * self.config.dt)

    def end_step(self) -> None:
        """Store the truck's distance from the path."""
        point, _ = self.pose()
        deviation = self.routes.distance(self.route, point[:, :2])
        steps = self.episode_steps + 1
        self._deviation += (deviation - self._deviation) / steps

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return the truck's distance from the path, too."""
        return super().extra_state() | {"deviation": self._deviation}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back."""
        super().load_extra_state(state)
        self._deviation.copy_(state["deviation"])
        self._show_leaders(self._time())

    # ---- what a policy sees and is paid for ----------------------------------------------------------------------

    def measured(self) -> torch.Tensor:
        """Return (W, 6): place of the first leader, heading and speed by GPS and IMU, the leader's speed."""
        assert self.navigation is not None
        place, heading, speed = self.navigation.estimate()
        away = self._leaders(self._time())[:, :1, :2] - place.unsqueeze(1)
        seen = to_heading(away, heading) if self.config.place_frame is Frame.VEHICLE else away
        own = torch.stack([heading.sin(), heading.cos(), speed / _SPEED, self._leader_speed() / _SPEED], dim=1)
        return torch.cat([seen.squeeze(1) / _LENGTHS, own], dim=1)

    def exact_state(self) -> torch.Tensor:
        """Return the leaders' places, the first one's heading and speed, motion, tilt, inputs, ranges to obstacles."""
        leaders = self._leaders(self._time())
        leader_speed = self._leader_speed() / _SPEED
        point, heading = self.pose()
        motion = self.motion()
        motion[:, 0] /= _SPEED
        away = to_heading(leaders[..., :2] - point[:, :2].float().unsqueeze(1), heading)
        turn = leaders[:, 0, 2] - heading
        obstacles = to_heading(self.obstacles.place - point[:, :2].float().unsqueeze(1), heading)
        ranges = self._fan.ranges(obstacles, self.obstacles.radius)
        return torch.cat(
            [
                (away / _LENGTHS).flatten(1),
                torch.stack([turn.sin(), turn.cos(), leader_speed, away[:, 0].norm(dim=1) / _LENGTHS], dim=1),
                motion,
                self.tilt(),
                self.action,
                1.0 - ranges / _REACH,
            ],
            dim=1,
        )

    def _behind(self) -> tuple[torch.Tensor, torch.Tensor]:
        """(W,) distance to the nearest leader [m], and whether the truck is in the cone behind it."""
        point, _ = self.pose()
        leader = self._leaders(self._time())[:, 0]
        away = to_heading((leader[:, :2] - point[:, :2].float()).unsqueeze(1), leader[:, 2]).squeeze(1)
        return away.norm(dim=1), torch.atan2(away[:, 1], away[:, 0]).abs() < self.config.cone

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``following``, ``failure`` and, if it counts, the difference in ``speed``."""
        config = self.config
        distance, inside = self._behind()
        pay = config.softness / ((distance - config.near).clamp(min=0.0) + config.softness)
        failed = self._hit | self._bumped() | self.upset() | (distance > config.lost_distance)
        terms = {
            "following": config.following_weight * pay * inside,
            "failure": -config.failure_weight * failed.float(),
        }
        if config.speed_weight > 0.0:
            speed = self.motion()[:, 0]
            terms["speed"] = -config.speed_weight * ((self._leader_speed() - speed) / (speed.abs() + 0.05)).abs()
        return terms

    def _bumped(self) -> torch.Tensor:
        """(W,) whether a corner of the truck is within a leader, or the other way round."""
        point, heading = self.pose()
        leaders = self._leaders(self._time())
        touching = torch.zeros(self.num_worlds, dtype=torch.bool, device=self.device)
        for leader in leaders.unbind(dim=1):
            away = (leader[:, :2] - point[:, :2].float()).unsqueeze(1)
            turn = leader[:, 2] - heading
            touching |= corners_inside(to_heading(away, heading), turn, self._leader_corners, self.chassis_half)
            touching |= corners_inside(to_heading(-away, leader[:, 2]), -turn, self._own_corners, LEADER_HALF)
        return touching

    def _at_end(self) -> torch.Tensor:
        return (self._begun + (self._time() / DURATION).square() > 0.999) & ~self._hit

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``goal``, ``collision`` with an obstacle, ``bumped`` into a leader, ``lost`` it, and ``upset``."""
        distance, _ = self._behind()
        return {
            "collision": self._hit.clone(),
            "bumped": self._bumped(),
            "lost": distance > self.config.lost_distance,
            "upset": self.upset(),
            "goal": self._at_end(),
        }

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``distance`` to the leader, the mean ``path_deviation`` [m] and ``obstacle_hits``."""
        distance, _ = self._behind()
        return {"distance": distance, "path_deviation": self._deviation, "obstacle_hits": self._hit.float()}

    # ---- pictures ------------------------------------------------------------------------------------------------

    def drawing(self) -> Drawing:
        """Draw path, obstacles, leaders and truck from above."""
        worlds = self.num_worlds
        share = torch.linspace(0.0, 1.0, 100, device=self.device).expand(worlds, -1)
        path = self.routes.at(self.route, share * self.routes.length[self.route].unsqueeze(1))
        lines = [Line(torch.nn.functional.pad(path[..., :2], (0, 1)), "0.7", 1.0), *self.obstacles.rings()]
        for index in range(LEADERS):
            leader = self._leaders(self._time())[:, index]
            lines.append(Line(outline(leader.double(), leader[:, 2], LEADER_HALF), "tab:red", 1.5))
        point, heading = self.pose()
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0))
        return Drawing(tuple(lines), ((-110.0, 110.0), (-110.0, 110.0)))


def corners_inside(
    away: torch.Tensor, turn: torch.Tensor, corner: torch.Tensor, half: tuple[float, float, float]
) -> torch.Tensor:
    """Return (W,) bool: a corner of a rectangle lies within another one, which is about the origin.

    Args:
        away: (W, 1, 2) middle of the first, in axes of the second [m].
        turn: (W,) of the first against the second [rad].
        corner: (4, 2) of the first, in its own axes [m].
        half: lengths of the second; the first two count [m].
    """
    cosine, sine = turn.cos().unsqueeze(1), turn.sin().unsqueeze(1)
    x = away[..., 0] + cosine * corner[:, 0] - sine * corner[:, 1]
    y = away[..., 1] + sine * corner[:, 0] + cosine * corner[:, 1]
    return ((x.abs() < half[0]) & (y.abs() < half[1])).any(dim=1)
