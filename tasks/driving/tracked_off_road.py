"""Off-road navigation on tracks: an M113 drives to a goal over hills and low rocks, between high obstacles."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final

import numpy as np
import numpy.typing as npt
import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Ge, Gt, Le, NotNegative, Positive

from ..framework.config import require
from ..framework.registry import register
from ..framework.variants import Variant
from .driven_vehicles import CHASSIS_GROUP, SETTLING
from .driving_config import DrivingConfig
from .hills import Hills
from .off_road import FIELDS, SIDE, OffRoadConfig, OffRoadTask
from .soil import SoilKind
from .training_defaults import PEDALS_BY_CAMERA

SPACING = 0.4
"""Of the nodes of the ground, half a low rock's radius [m]."""
ROCK_HEIGHTS = (0.1, 0.35)
"""Least and greatest height of low rocks on the highest hills [m]."""
ROCK_RADII = (0.8, 1.4)
"""Least and greatest radius of their feet [m]."""
ROOM = 7.0
"""Distance of low rocks from the circle of starts [m]: the vehicle stands on none."""
SHOE_STEP = 0.001
"""Longest physics step of the model shoe by shoe [s]."""
LOSSES: Final = {
    "sprocket_loss": 0.0, "dry_loss": 0.005, "rolling_loss": 0.0, "linear_loss": 0.0, "square_loss": 1.4e-3,
}  # fmt: skip
"""Of belts: those of recorded runs, where friction hardly acts on the slow sliding in sprockets. Dry teeth take half of
the torque."""
SETTLING_OF_CHAINS = 1.5
"""Time in which chains tighten and the vehicle comes to rest [s]."""


@dataclasses.dataclass(frozen=True)
class TrackedOffRoadConfig(OffRoadConfig):
    """Configuration of :class:`TrackedOffRoadTask`."""

    dt: Positive = 0.005
    """Physics step [s]; shoe by shoe (``full``) 0.001 at most."""
    decimation: Annotated[int, Ge(1), Le(100_000)] = 40
    """Physics steps per control step: five actions a second; 200 shoe by shoe."""
    max_episode_steps: int = 125
    """Control steps after which an episode is truncated: 25 s."""
    full: bool = False
    """Drive the model shoe by shoe instead of the belts that policies are trained on."""
    friction: Positive | tuple[Positive, Positive] = 0.5
    """Of the ground: open country has 0.5 to 0.7. The more, the less a brake turns the vehicle."""
    tension: Positive | tuple[Positive, Positive] = 1.0
    """Factor of the tensioners' force as built: one number, or two between which each world's episodes are drawn."""
    obstacles: Annotated[int, Ge(0), Le(500)] = 8
    """Rocks, bushes and trees that must be avoided."""
    obstacle_scale: Annotated[float, Gt(0.0), Le(4.0)] = 1.5
    """Factor of their sizes."""
    low_rocks: Annotated[int, Ge(0), Le(5_000)] = 300
    """Rocks that may be driven over, on each of the fields, a square of twice ``half``; they are part of the ground and
    rise and fall with its hills: 0.1 to 0.35 m at ``hills`` 1."""
    hill_height: Annotated[float, Gt(0.0), Le(5.0)] = 2.0
    """Greatest height above or depth below the middle at ``hills`` 1 [m]."""
    hills: NotNegative = 1.0
    """Height of hills and low rocks as a share; 0: flat ground without low rocks."""
    half: float = 30.0
    """Obstacles and low rocks are in a square of twice this side [m]."""
    border: float = 45.0
    """An episode ends where the vehicle is farther than this from the middle, along x or y [m]."""
    radius: float = 30.0
    """Of the circle on which start and goal lie [m]."""
    goal_radius: float = 8.0
    """Distance at which the goal is reached [m]."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {}

    def validate(self) -> None:
        """Check what tracks have no choice of."""
        super().validate()
        require(self.variant is Variant.SIMWARP, self, "variant", "simwarp: the thesis has no tracks")
        require(self.vehicle is None, self, "vehicle", "None: the task's own has tracks")
        require(self.tires is None, self, "tires", "None: tracks have none")
        require(self.soil is not SoilKind.RANDOM, self, "soil", "none or one preset, on which belts settle")
        require(not self.full or self.dt <= SHOE_STEP, self, "dt", f"at most {SHOE_STEP} with full (decimation 200)")
        require(not self.full or self.soil is SoilKind.NONE, self, "soil", "none with full: chains meet hard ground")
        least, largest = self.tensions
        require(least <= largest, self, "tension", "one number, or two in order, least and largest")

    @property
    def tensions(self) -> tuple[float, float]:
        """Return the bounds of `tension`, equal where it is one number."""
        return self.tension if isinstance(self.tension, tuple) else (self.tension, self.tension)


class Tensioners:
    """Forces of a tracked vehicle's tensioners in every world, of belts or of chains.

    Args:
        vehicle: whose model gives each world the `joint_preload` of chains.
    """

    def __init__(self, vehicle: sw.vehicle.TrackedVehicle) -> None:
        belts, model = vehicle.belts, vehicle.model
        if belts is not None:
            self._forces = sw.to_torch(belts.parameter)[..., int(sw.vehicle.BeltParameter.TENSIONER_FORCE)]
            self._places: list[int] = list(range(self._forces.shape[1]))
        else:
            self._forces = sw.to_torch(model.joint_preload)
            self._places = [model.joint_dof_start[side.tensioner] for side in vehicle.parts.chains]
        self._built = self._forces.clone()

    def scale(self, world_mask: torch.Tensor, factor: torch.Tensor) -> None:
        """Set the forces of the worlds of a mask (W,) to a factor (W, 1) of those that were built."""
        for place in self._places:
            forces = self._forces[:, place]
            forces.copy_(torch.where(world_mask, factor[:, 0] * self._built[:, place], forces))


@register("tracked-off-road")
class TrackedOffRoadTask(OffRoadTask):
    """Observations and actions are those of `off-road`. Steering brakes the inner track.

    The ground carries the tracks' belts; the box of the chassis meets high obstacles alone, so that low rocks, which
    are part of the ground, may be driven over. With ``full`` shoes meet the same ground as a shape.
    """

    summary: ClassVar[str] = "off-road on tracks: an M113 drives to a goal over hills and rocks, between obstacles"
    instruction: ClassVar[str] = "Drive over the hills to the goal and keep clear of obstacles."
    config_type: ClassVar[type[DrivingConfig]] = TrackedOffRoadConfig
    training: ClassVar[Mapping[str, Any]] = {**OffRoadTask.training, "iterations": 110, "num_envs": 128}
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "state": {"network.hidden": (128, 64), "network.init_mean": (0.0, 0.5)},
        "camera": PEDALS_BY_CAMERA,
    }
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    trained_in: ClassVar[Mapping[str, Any]] = {"varied": True}
    distilled_in: ClassVar[Mapping[str, Any]] = trained_in
    vehicle_name: ClassVar[str] = "m113-belt"
    full_name: ClassVar[str] = "m113"
    chassis_half: ClassVar[tuple[float, float, float]] = (2.4, 1.34, 0.55)
    chassis_place: ClassVar[tuple[float, float, float]] = (-2.0, 0.0, 0.5)
    camera_place: ClassVar[tuple[float, float, float]] = (0.3, 0.0, 1.2)
    contact_mask: ClassVar[int] = 0x7FFFFFFF & ~CHASSIS_GROUP

    config: TrackedOffRoadConfig

    # ---- the vehicle ---------------------------------------------------------------------------------------------

    def make_spec(self) -> Any:
        """Return the description of the vehicle on belts, or shoe by shoe."""
        spec = sw.vehicle.load_tracked_vehicle(self.full_name if self.config.full else self.vehicle_name)
        return spec if self.config.full else sw.vehicle.with_belts(spec, **LOSSES)

    def add_vehicle(self, builder: sw.ModelBuilder) -> None:
        """Add the vehicle on its tracks, and store its ``spec`` and ``parts``."""
        spec = self.make_spec()
        # smooth sprockets lose as little as the belts do; dry teeth take half of the torque
        sprocket = sw.vehicle.SprocketContact.DRUM
        self.parts: Any = sw.vehicle.add_tracked_vehicle(builder, spec, sprocket=sprocket)
        self.spec = spec

    @property
    def stands_on_shapes(self) -> bool:
        """Shoes meet shapes; belts look for the ground themselves."""
        return bool(self.config.full)

    def make_vehicle(self, model: sw.Model, ground: Any) -> Any:
        """Make ``self.vehicle``; belts have the ground and its soil, shoes the shape."""
        self.vehicle: Any
        if self.config.full:
            self.vehicle = sw.vehicle.TrackedVehicle(self.parts, model)
        else:
            soil = None if self.config.soil is SoilKind.NONE else self.config.soil.value
            self.vehicle = sw.vehicle.TrackedVehicle(self.parts, model, ground=ground, soil=soil, randomised=True)
        return self.vehicle

    def ground_friction(self) -> wp.array:
        """Return the friction (W,) below the belts, or that of the shape below the shoes."""
        if self.vehicle.belts is not None:
            return self.vehicle.belts.ground_friction
        shape = self._tire_ground if self.hills is None else self.hills.shape
        return self.vehicle.model.shape_friction[:, shape]

    def make_soil(self, ground: Any) -> None:
        """Return nothing: belts have the soil."""
        return

    @property
    def own_parameters(self) -> frozenset[str]:
        """Return what is written world by world: of tensioners of chains their force, too."""
        drawn = ("joint_preload",) if self.config.full and self.config.tensions != (1.0, 1.0) else ()
        return super().own_parameters.union(drawn)

    def setup(self) -> None:
        """Find the tensioners' forces beside what a vehicle on wheels has."""
        self._tensioners = None if self.config.tensions == (1.0, 1.0) else Tensioners(self.vehicle)
        super().setup()

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw the tracks' tension beside start, goal, ground and obstacles."""
        super().draw_world(world_mask)
        if self._tensioners is not None:
            factor = self.random.uniform("tension of tracks", *self.config.tensions)
            self._tensioners.scale(world_mask, factor)

    def settling(self) -> float:
        """Return the time in which the vehicle comes to rest before the first episode [s]."""
        return SETTLING_OF_CHAINS if self.config.full else SETTLING

    def solver_options(self) -> sw.SolverOptions:
        """Chains need more iterations than a vehicle on wheels or belts."""
        return sw.vehicle.TRACK_SOLVER if self.config.full else super().solver_options()

    def show_vehicle(self, visuals: sw.sensors.Visuals) -> None:
        """Show hull, wheels and shoes in place of the vehicle's shapes."""
        visuals.hide(*(each.shape for each in visuals.instances if each.body in self.parts.bodies and each.shape >= 0))
        sw.scenery.add_tracked_vehicle_visual(visuals, self.parts)

    # ---- the ground ----------------------------------------------------------------------------------------------

    def make_hills(self) -> Hills:
        """Return hills with low rocks on them."""
        return Hills(FIELDS, SIDE, spacing=SPACING, bumps=self._low_rocks())

    def _low_rocks(self) -> npt.NDArray[np.float32]:
        """Return (fields, rows, columns) heights of low rocks, as shares of ``hill_height``: flat domes."""
        config, nodes = self.config, math.ceil(SIDE / SPACING - 1e-9) + 1
        at = np.linspace(-0.5 * SIDE, 0.5 * SIDE, nodes)
        bumps = np.zeros((FIELDS, nodes, nodes), dtype=np.float32)
        rng = np.random.default_rng(FIELDS)
        for bump in bumps:
            places = rng.uniform(-config.half, config.half, (config.low_rocks, 2))
            radii, heights = (rng.uniform(*span, (config.low_rocks,)) for span in (ROCK_RADII, ROCK_HEIGHTS))
            for (x, y), radius, height in zip(places, radii, heights, strict=True):
                if abs(math.hypot(x, y) - config.radius) < ROOM:
                    continue
                columns, rows = (slice(*np.searchsorted(at, (c - radius, c + radius))) for c in (x, y))
                away = ((at[columns] - x)[None] ** 2 + (at[rows] - y)[:, None] ** 2) / radius**2
                dome = height / config.hill_height * np.clip(1.0 - away, 0.0, None)
                bump[rows, columns] = np.maximum(bump[rows, columns], dome)
        return bumps
