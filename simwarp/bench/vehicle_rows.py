"""A vehicle's row: the moving part of `reference-steer`, worlds at sixteen places of it; and those of convoys."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, Final

import numpy as np

from simwarp.bench.health import Health, examine_solution
from simwarp.bench.measure import Row, TimedRun, measure_run, steps_before
from simwarp.bench.workloads import CONVOYS, ON_SOIL
from simwarp.simulation.simulation import Simulation
from simwarp.soil import soil_under
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.runs import REFERENCE_DT, set_up
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.tires.soil_tires import TEMPLATE, SoilTires
from simwarp.vehicle.vehicle import Vehicle, Vehicles
from simwarp.vehicle.vehicle_convoy import set_up_convoy

HORIZON: Final = 1.5
"""Each world drives that long [s]: sixteen of them cover the 24 s that follow the settling."""
VARIANTS: Final = 16
FIRST: Final = 9
"""The place of world 0: t = 15 s, where the steering turns."""

POSITION_ERROR: Final = 1e-3
"""Largest sound violation of a joint [m or rad]; 1e-5 is usual, 2e-4 where a steering turns fast."""
LOAD_SHARE: Final = 0.02
"""Mean wheel loads of all worlds may differ from the weight by this share ..."""
SOIL_LOAD_SHARE: Final = 0.08
"""The same on soil: wheels go from node to node, and sixteen places of a run are 2 % off on average."""
WORST_LOAD_SHARE: Final = 0.5
"""... and those of one world, which may be in a gear change or a step of the steering, by this."""


SOIL_SPEED: Final = 4.0
"""Held on soil [m/s]: with all of its engine a HMMWV comes to 4.6."""


CONVOY_SPEED: Final = 12.0
"""Held by convoys on firm ground [m/s]."""
PAGES: Final = 2048
"""Of soil for each vehicle of a world."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VehicleScene:
    """What drives, and on what.

    Attributes:
        name: of the row.
        vehicles: in each world; more than one, or one as a part of a convoy, in a row.
        soil: name of a preset; None: firm ground.
        spacing: of its nodes [m].
    """

    name: str
    vehicles: int = 1
    soil: str | None = None
    spacing: float = 0.05


@dataclasses.dataclass(frozen=True)
class Driven:
    """A scene ready to run."""

    simulation: Simulation
    vehicle: Vehicle | Vehicles
    maneuver: Maneuver


def _set_up(scene: VehicleScene, worlds: int, device: str, dt: float | None) -> Driven:
    step = REFERENCE_DT if dt is None else dt
    spec = load_vehicle({**ON_SOIL, **CONVOYS}.get(scene.name, scene.name))
    soil = "mid" if scene.name in ON_SOIL else scene.soil
    speed = CONVOY_SPEED
    if soil is not None:
        spec, speed = with_options(spec, tire=TEMPLATE), SOIL_SPEED

    def elements(vehicle: Vehicle | Vehicles) -> list[Any]:
        if soil is None:
            return []
        return [soil_under(vehicle, soil, spacing=scene.spacing, pages=PAGES * scene.vehicles)]

    if scene.name in CONVOYS:
        straight = maneuver("step-steer", spec, speed=speed, steering=0.0)
        row = set_up_convoy(
            spec, straight, vehicles=scene.vehicles, worlds=worlds, device=device, dt=step, elements=elements
        )  # fmt: skip
        return Driven(row.simulation, row.vehicles, straight)
    course = maneuver("reference-steer", spec) if soil is None else maneuver("step-steer", spec, speed=speed)
    one = set_up(spec, course, worlds=worlds, device=device, dt=step, elements=elements, wheel_bodies=False)
    return Driven(one.simulation, one.vehicle, course)


class VehicleExaminer:
    """Judges vehicles under way: nothing creates energy by rule here, so that their motion itself is looked at."""

    def __init__(self, setup: Driven) -> None:
        self.setup = setup
        model = setup.simulation.model
        mass = np.asarray(model.body_mass.numpy(), float).sum(-1)
        gravity = np.linalg.norm(np.asarray(model.gravity.numpy(), float).reshape(-1, 3), axis=-1)
        self._weight = mass * gravity
        self._target = max(speed for _, speed in setup.maneuver.script.speed)

    def examine(self) -> Health:
        """Finite, on the road, joints together, rows solved, wheels carrying the weight, no faster than asked for."""
        simulation, vehicle = self.setup.simulation, self.setup.vehicle
        speed = np.linalg.norm(simulation.state.body_v.numpy()[:, vehicle.chassis.numpy()], axis=-1)
        # wheels and shafts turn faster than the chassis drives; the rows are of their speeds too
        problems, finite, residual, position_error = examine_solution(
            simulation, self._target, "m/s or rad/s", POSITION_ERROR
        )  # fmt: skip
        if finite:
            problems += self._motion_problems(speed)
        return Health(
            tuple(problems), residual, position_error, 0.0, float(speed.max(initial=0.0)),
            iterations=float(simulation.diagnostics.iterations.numpy().mean()),
        )  # fmt: skip

    def _motion_problems(self, speed: np.ndarray) -> list[str]:
        problems = []
        share = self.setup.vehicle.tires.load.numpy().sum(axis=1) / self._weight
        # a few worlds may all be in a transient
        usual = SOIL_LOAD_SHARE if isinstance(self.setup.vehicle.tires, SoilTires) else LOAD_SHARE
        allowed = usual if len(share) >= VARIANTS else WORST_LOAD_SHARE
        if not abs(share.mean() - 1.0) <= allowed or not np.abs(share - 1.0).max() <= WORST_LOAD_SHARE:
            problems.append(
                f"wheels carry {share.min():.3g} to {share.max():.3g} of the weight, {share.mean():.3g} on average"
            )
        if not speed.max() <= 1.1 * self._target:
            problems.append(f"a vehicle drives {speed.max():.3g} m/s where {self._target:.3g} m/s are held")
        if not speed.max() >= 0.1 * self._target:
            problems.append("nothing moves: this is no work")
        return problems


class VehicleRun(TimedRun):
    """A vehicle in the moving part of `reference-steer`."""

    def __init__(self, scene: VehicleScene | str, worlds: int, device: str, dt: float | None) -> None:
        self.scene = VehicleScene(name=scene) if isinstance(scene, str) else scene
        self.setup = _set_up(self.scene, worlds, device, dt)
        super().__init__(self.setup.simulation, HORIZON)

    def set_motion(self) -> None:
        """World k starts at the same place whatever the number of worlds."""
        self._assign(_places(self.scene, self.settle_device, self.dt))
        self._start_here(VehicleExaminer(self.setup))

    def places(self) -> dict[str, Any]:
        """Drives the whole run: everything that a step reads, every `HORIZON` from t = 0 on, by name."""
        shots: list[dict[str, Any]] = []
        before, between = round(self.setup.maneuver.start / self.dt), round(HORIZON / self.dt)
        steps_before(self.setup.maneuver.start + VARIANTS * HORIZON, self.dt)
        for place in range(VARIANTS):
            self.advance(before if place == 0 else between)
            # the first place is after the settling, with the brakes just released
            shots.append({name: array.numpy().copy() for name, array in self._arrays().items()})
        order = [(FIRST + index) % VARIANTS for index in range(VARIANTS)]
        names = [name for name, values in shots[0].items() if values.size]
        found = {name: np.concatenate([shots[index][name] for index in order]) for name in names}
        return {name: found.get(name, values) for name, values in shots[0].items()}


@functools.lru_cache(maxsize=2)
def _places(scene: VehicleScene, device: str, dt: float) -> dict[str, Any]:
    """The same for every number of worlds."""
    return VehicleRun(scene, 1, device, dt).places()


def measure_vehicle(scene: VehicleScene, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """Times a vehicle, or several in each world.

    Raises:
        SpecError: there is no such vehicle.
        ModelError: the worlds do not fit into memory.
    """
    row = measure_run(scene.name, worlds, seconds, lambda count: VehicleRun(scene, count, device, dt))
    return dataclasses.replace(row, vehicles=scene.vehicles if scene.name in CONVOYS else None)
