"""A manoeuvre as a simulation: a vehicle in every world, its driver, the ground, and the loop that records it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, Generic, TypedDict, TypeVar, Unpack, overload

import numpy as np

from simwarp.core.object_repr import Readable
from simwarp.core.rotation import rotate
from simwarp.core.types import WORLD, Material, Pose, WorldStatus, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.simulation.attachments import ForceElement, Sensor
from simwarp.simulation.simulation import Simulation
from simwarp.simulation.solver_options import SolverOptions
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.driving.drawbar import Drawbar, with_locks
from simwarp.vehicle.driving.drivers import ScriptedDriver
from simwarp.vehicle.driving.intervention import Intervening, no_intervention
from simwarp.vehicle.driving.maneuver_spec import Crossing, CrossingKind, Maneuver
from simwarp.vehicle.driving.path_tracking import PathTracker
from simwarp.vehicle.results.channels import Recorder, Run
from simwarp.vehicle.results.road import add_bump, check_below_tracks, check_own_ground, check_road, tire_ground
from simwarp.vehicle.roads.road_surface import FRICTION, RoadSurface, add_road, road_ground
from simwarp.vehicle.spec.parts import Array
from simwarp.vehicle.spec.track_parts import SimpleTrackDriveline
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.tracks.tracked_construction import add_tracked_vehicle
from simwarp.vehicle.tracks.tracked_vehicle import TRACK_SOLVER, AnyVehicle, TrackedVehicle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

SAMPLE_TIME = 0.01
"""Between the rows of a record [s]."""

REFERENCE_FRICTION = 0.9
REFERENCE_DT = 1.0e-3

START_REACH: Final = 5.0
"""To all sides of the origin, where a vehicle stands as a run begins [m]."""
GROUND_LENGTH: Final = 50.0
GROUND_WIDTH: Final = 20.0
"""Half lengths of the ground on either side of a trench [m]."""
TRENCH_DEPTH: Final = 2.0
HALF_ROUND_LENGTH: Final = 2.0
"""To either side [m]."""
ACROSS: Final = (math.sin(0.25 * math.pi), 0.0, 0.0, math.cos(0.25 * math.pi))
"""Turns a cylinder's axis from z to y."""

Progress = Callable[[float], None]
"""Called with the time of the manoeuvre [s] after every row."""


Kind = TypeVar("Kind", bound=AnyVehicle, covariant=True)


@dataclasses.dataclass(frozen=True)
class Setup(Generic[Kind]):
    """A manoeuvre ready to run, of a `Vehicle` or a `TrackedVehicle`, on a road or on the manoeuvre's own ground."""

    simulation: Simulation
    vehicle: Kind
    driver: ForceElement
    maneuver: Maneuver
    road: RoadSurface | None = None


class SetUpOptions(TypedDict, total=False):
    """Keyword arguments of `set_up`, for its two kinds of vehicles."""

    worlds: int
    device: str | None
    dt: float
    friction: float
    randomised: Iterable[str]
    elements: Callable[[Any], Sequence[ForceElement]]
    sensors: Callable[[Any, Sequence[ForceElement]], Sequence[Sensor]]
    on_soil: bool
    solver: SolverOptions | None
    joint_reactions: bool
    wheel_bodies: bool
    own_tires: bool
    road: RoadSurface | None
    driven: bool


@overload
def set_up(
    spec: VehicleSpec, maneuver: Maneuver, *, variants: Sequence[Maneuver] = (), **options: Unpack[SetUpOptions]
) -> Setup[Vehicle]: ...


@overload
def set_up(
    spec: TrackedVehicleSpec, maneuver: Maneuver, *, variants: Sequence[Maneuver] = (), **options: Unpack[SetUpOptions]
) -> Setup[TrackedVehicle]: ...


@overload
def set_up(
    spec: AnyVehicleSpec, maneuver: Maneuver, *, variants: Sequence[Maneuver] = (), **options: Unpack[SetUpOptions]
) -> Setup[AnyVehicle]: ...


def set_up(
    spec: AnyVehicleSpec,
    maneuver: Maneuver,
    *,
    worlds: int = 1,
    device: str | None = None,
    dt: float = REFERENCE_DT,
    friction: float = REFERENCE_FRICTION,
    randomised: Iterable[str] = (),
    elements: Callable[[Any], Sequence[ForceElement]] = lambda vehicle: (),
    sensors: Callable[[Any, Sequence[ForceElement]], Sequence[Sensor]] = lambda vehicle, elements: (),
    on_soil: bool = False,
    solver: SolverOptions | None = None,
    joint_reactions: bool = False,
    variants: Sequence[Maneuver] = (),
    wheel_bodies: bool = True,
    own_tires: bool = False,
    road: RoadSurface | None = None,
    driven: bool = True,
) -> Setup[AnyVehicle]:
    """Builds the vehicle at rest on the manoeuvre's ground, with its driver.

    Args:
        spec: of the vehicle, on wheels or tracks.
        maneuver: of `simwarp.vehicle.driving.maneuvers`.
        worlds: number of worlds.
        device: device of the run.
        dt: time step [s].
        friction: of the ground.
        randomised: model arrays of which every world needs its own, beside those that a vehicle writes.
        elements: returns further force elements for the `Vehicle` or `TrackedVehicle`, such as the soil below it.
        sensors: returns sensors for the vehicle and all force elements.
        on_soil: True if a soil is among the elements: rigid and flexible tires have no plane to stand on then.
        solver: None: `VEHICLE_SOLVER`, or `TRACK_SOLVER` of tracks.
        joint_reactions: record those of all joints; chains of tracks always do.
        variants: manoeuvres of the single worlds, for their drivers on paths and interventions; see `set_up_variants`.
        wheel_bodies: False: without the bodies that show the wheels of a reduced vehicle (`add_vehicle`).
        own_tires: True if the tires of every world have numbers and a friction of their own (`Vehicle`, `randomised`).
        road: of `simwarp.vehicle.roads`, below a manoeuvre on level ground; None: a plane.
        driven: False: nobody drives, and `vehicle.input` is there to be written; the driver is the vehicle itself.

    Raises:
        SpecError: the vehicle, the step, the friction or the road cannot be used.
    """
    _check(dt, friction)
    rotation = _lean(maneuver)
    builder = ModelBuilder()
    vehicle: AnyVehicle
    if isinstance(spec, TrackedVehicleSpec):
        if road is not None:
            check_below_tracks(road)
        if on_soil:
            raise SpecError(f"on_soil: must be False of a vehicle on tracks, got True for '{spec.name}'")
        model, vehicle = _tracks_on_ground(
            builder, spec, maneuver, friction, road,
            lambda: builder.finalize(world_count=worlds, device=device, per_world=per_world(randomised)),
        )  # fmt: skip
        if maneuver.gyration and isinstance(spec.driveline, SimpleTrackDriveline):
            vehicle.gyration.fill_(1)
    else:
        parts, asset = add_on_road(
            builder, spec, maneuver, friction=friction, on_soil=on_soil, wheel_bodies=wheel_bodies, road=road
        )  # fmt: skip
        model = builder.finalize(world_count=worlds, device=device, per_world=per_world(randomised))
        if road is None:
            terrain = tire_ground(maneuver, model.device, rotation, asset)
        else:
            terrain = road_ground(model, road, friction=friction)
        vehicle = Vehicle(parts, model, ground=terrain, randomised=own_tires)
        _prepare(vehicle, maneuver, friction)
    if driven:
        driver, acting = _acting(vehicle, variants or (maneuver,), elements(vehicle))
    else:
        driver, acting = vehicle, [vehicle, *elements(vehicle)]
    chains = isinstance(vehicle, TrackedVehicle) and vehicle.belts is None
    simulation = Simulation(
        model, dt, elements=acting, solver=solver or (TRACK_SOLVER if chains else VEHICLE_SOLVER),
        joint_reactions=chains or joint_reactions, sensors=sensors(vehicle, acting),
    )  # fmt: skip
    return Setup(simulation, vehicle, driver, maneuver, road)


def _tracks_on_ground(
    builder: ModelBuilder, spec: TrackedVehicleSpec, maneuver: Maneuver, friction: float, road: RoadSurface | None,
    finished: Callable[[], Model],
) -> tuple[Model, TrackedVehicle]:  # fmt: skip
    """A tracked vehicle with its ground, in the model that `finished` makes of the builder."""
    rotation = _lean(maneuver)
    tracked = add_tracked_vehicle(builder, spec, at=_start_pose(spec, maneuver, road))
    if spec.on_belts and maneuver.crossing is not None:
        rule = "must be driven shoe by shoe, got belts, which meet no shapes; take the vehicle with chains"
        raise SpecError(f"maneuver: {maneuver.name}: {rule}")
    if road is None:
        add_ground(builder, maneuver.crossing, rotation, Material(friction=friction))
    else:
        check_own_ground(maneuver)
        add_road(builder, road, friction=friction)
    model = finished()
    below = None
    if spec.on_belts:
        below = ground(model.device, rotation=rotation) if road is None else road_ground(model, road)
    vehicle = TrackedVehicle(tracked, model, ground=below)
    if vehicle.belts is not None:
        vehicle.belts.ground_friction.fill_(friction)
    return model, vehicle


def add_on_road(
    builder: ModelBuilder, spec: VehicleSpec, maneuver: Maneuver, *, friction: float, on_soil: bool = False,
    wheel_bodies: bool = True, road: RoadSurface | None = None,
) -> tuple[VehicleParts, int]:  # fmt: skip
    """Adds a vehicle on wheels at the start of a manoeuvre, with its ground and bump, as `set_up` does.

    Args:
        builder: that is empty.
        spec: of the vehicle.
        maneuver: that it is to drive.
        friction: of the ground below tires that are shapes.
        on_soil: True if soil is the ground.
        wheel_bodies: as of `set_up`.
        road: as of `set_up`.

    Returns:
        The vehicle's parts, and the asset of the road's bump (-1: none).

    Raises:
        SpecError: the vehicle cannot drive it.
    """
    if maneuver.drawbar is not None:
        spec.require_linkages("a drawbar test")
    driven = spec if maneuver.drawbar is None else with_locks(spec)
    start = _start_pose(spec, maneuver, road)
    parts = add_vehicle(
        builder, driven, at=start, speed=maneuver.initial_speed, gear=maneuver.held_gear, wheel_bodies=wheel_bodies
    )
    if road is not None:
        sinks = on_soil or any(axle.tire.template == "soil-rigid" for axle in spec.all_axles)
        add_road(builder, road, friction=friction, below_soil=sinks)
    elif not on_soil and any(side.meets_shapes for side in parts.sides):
        add_ground(builder, None, _lean(maneuver), Material(friction=friction))
    check_road(maneuver, parts.spec, on_soil, road)
    return parts, add_bump(builder, maneuver)


def _lean(maneuver: Maneuver) -> Array:
    """(4,) rotation of the ground."""
    lean = -math.atan(maneuver.slope)
    return np.array([0.0, math.sin(0.5 * lean), 0.0, math.cos(0.5 * lean)])


def _start_pose(spec: AnyVehicleSpec, maneuver: Maneuver, road: RoadSurface | None) -> Pose:
    """Of the vehicle's frame of reference; on a road above the highest place below it."""
    rotation = _lean(maneuver)
    x, y, z = (0.0, 0.0, spec.start_height) if maneuver.place is None else maneuver.place
    place = (x, y, z if road is None else z + road.highest(START_REACH))
    return pose(rotate(rotation, np.array(place)), rotation)


def _prepare(vehicle: Vehicle, maneuver: Maneuver, friction: float) -> None:
    """The road's friction, and gears that are held."""
    vehicle.tires.ground_friction.fill_(friction)
    if maneuver.held_gear is not None:
        vehicle.hold_gears()


def _check(dt: float, friction: float) -> None:
    for name, value in (("dt", dt), ("friction", friction)):
        if not (math.isfinite(value) and value > 0.0):
            raise SpecError(f"{name}: must be a positive number, got {value!r}")
    if not FRICTION[0] <= friction <= FRICTION[1]:
        raise SpecError(f"friction: must be from {FRICTION[0]:g} to {FRICTION[1]:g}, got {friction!r}")


def _acting(
    vehicle: AnyVehicle, maneuvers: Sequence[Maneuver], further: Sequence[ForceElement]
) -> tuple[ForceElement, list[ForceElement]]:
    """The driver of a manoeuvre, or of one for each world, and all force elements in the order in which they act."""
    first = maneuvers[0]
    driver: ForceElement = ScriptedDriver(vehicle, first.script)
    if first.follow is not None and not isinstance(vehicle, TrackedVehicle):
        driver = PathTracker(vehicle, [each.follow for each in maneuvers if each.follow is not None])
    if first.drawbar is not None:
        # it adds to the forces that the vehicle writes
        driver = Drawbar(vehicle, first.drawbar)
        return driver, [vehicle, driver, *further]
    tests = [each.intervention for each in maneuvers]
    if any(tests) and not isinstance(vehicle, TrackedVehicle):
        acts = [no_intervention() if test is None else test for test in tests]
        return driver, [driver, Intervening(vehicle, acts, first.start), vehicle, *further]
    return driver, [driver, vehicle, *further]


def add_ground(builder: ModelBuilder, crossing: Crossing | None, rotation: Array, material: Material) -> None:
    """The plane of a manoeuvre with what lies across the way; a trench is between two boxes above it."""
    if crossing is not None and crossing.kind is CrossingKind.TRENCH:
        half = (GROUND_LENGTH, GROUND_WIDTH, 0.5 * TRENCH_DEPTH)
        for name, x in (("near", crossing.ahead - half[0]), ("far", crossing.beyond + half[0])):
            place = pose((x, 0.0, -half[2]))
            builder.add_shape_box(WORLD, half=half, pose=place, material=material, name=f"ground_{name}")
        builder.add_shape_plane(name="bottom", pose=pose((0.0, 0.0, -TRENCH_DEPTH)), material=material)
        return
    builder.add_shape_plane(name="ground", pose=pose(rotation=rotation), material=material)
    if crossing is not None:
        builder.add_shape_cylinder(
            WORLD, radius=crossing.size, half_length=HALF_ROUND_LENGTH, pose=pose((crossing.ahead, 0.0, 0.0), ACROSS),
            material=material, name="half_round",
        )  # fmt: skip


def row_steps(dt: float) -> int:
    """Steps between the rows of a record; 0 where the step [s] does not divide the time between them."""
    steps = SAMPLE_TIME / dt
    return round(steps) if steps > 0.5 and abs(steps - round(steps)) < 1e-6 * steps else 0


class Drive(Readable):
    """Runs a manoeuvre and records one row every 10 ms, from the settling on.

    Args:
        setup: of `set_up`.
        worlds: indices of those that are recorded; the first alone by default.
        channels: further ones by name, as of `Recorder`.

    Attributes:
        after_step: called after every step; None: nothing is.
        steps_to_call: returns how many steps may be taken at once until `after_step` is called next.
        left_road: time of the manoeuvre at which a body came beyond the road's border [s]; None: none did.
    """

    def __init__(
        self, setup: Setup[AnyVehicle], worlds: slice = slice(0, 1), channels: Iterable[str] = ()
    ) -> None:  # fmt: skip
        self.setup = setup
        further = setup.driver.measured if isinstance(setup.driver, Drawbar) else {}
        self.recorder = Recorder(setup.simulation, setup.vehicle, worlds, setup.maneuver.start, further, channels)
        self.after_step: Callable[[], None] | None = None
        self.steps_to_call: Callable[[], int] = lambda: 1
        self._to_call = 0
        """Steps until the call."""
        self.left_road: float | None = None
        self._every = row_steps(setup.simulation.dt)
        """Steps between rows; 0: the step does not divide 10 ms, so that each one is recorded and rows interpolated."""

    def _readable_title(self) -> str:
        return f" of vehicle '{self.setup.vehicle.parts.spec.name}': {self.setup.maneuver.duration:g} s"

    def run(self, progress: Progress | None = None) -> Run:
        """Steps to the end of the manoeuvre, or until all recorded worlds have broken down or one has left the road.

        An interruption leaves what was recorded: `result`.
        """
        maneuver, simulation = self.setup.maneuver, self.setup.simulation
        total = math.ceil((maneuver.start + maneuver.duration) / simulation.dt - 1e-6)
        every = self._every or 1
        self.recorder.sample()
        for step in range(0, total, every):
            done = min(step + every, total)
            self._step(1)
            self.recorder.record_inputs()
            self._step(done - step - 1)
            if done % every == 0:
                self.recorder.sample()
                if self.broken():
                    # a frozen world shows its last state again
                    self.recorder.rows.pop()
                    break
                if self._beyond_road():
                    self.left_road = done * simulation.dt - maneuver.start
                    break
                if progress is not None:
                    progress(done * simulation.dt - maneuver.start)
        return self.result()

    def _step(self, steps: int) -> None:
        """Steps at once where nobody looks at each: the same state, bit by bit, without Python in between."""
        if self.after_step is None:
            self.setup.simulation.step(steps)
            return
        while steps:
            self._to_call = self._to_call or self.steps_to_call()
            taken = min(steps, self._to_call)
            self.setup.simulation.step(taken)
            steps, self._to_call = steps - taken, self._to_call - taken
            if not self._to_call:
                self.after_step()

    def broken(self) -> bool:
        """True if no recorded world is finite any more."""
        status = self.setup.simulation.state.world_status.numpy()[self.recorder.worlds]
        return bool(np.all(status & WorldStatus.NON_FINITE))

    def _beyond_road(self) -> bool:
        """True if a body of a recorded world is beyond the road's border, where there is no ground."""
        road = self.setup.road
        if road is None:
            return False
        places = self.setup.simulation.state.body_x.numpy()[self.recorder.worlds, :, :2].astype(np.float64)
        beyond = (places < road.origin) | (places > np.add(road.origin, road.size))
        return bool(beyond.any())

    def result(self, world: int = 0) -> Run:
        """Recorded run of one of the recorder's worlds, at multiples of 10 ms."""
        return self._at_rows(Run.of(self.recorder, world))

    def results(self) -> list[Run]:
        """Recorded runs of all of the recorder's worlds, in their order, at multiples of 10 ms."""
        return [self._at_rows(run) for run in Run.of_all(self.recorder)]

    def _at_rows(self, run: Run) -> Run:
        return run if self._every else run.resampled(SAMPLE_TIME)
