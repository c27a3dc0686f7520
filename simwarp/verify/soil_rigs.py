"""Rigs for soil: plates pressed and dragged, wheels driven at a slip or over the same ground again, and their ruts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, VelocityMotor, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.soil import PressureNormal, ShearMemory, Soil, SoilSpec, SoilWheel
from simwarp.soil.soil_columns_kernels import SIDE
from simwarp.soil.soil_tables_kernels import PAGE_NODES, SINKAGE, YIELD

RADIUS: Final = 0.467
WIDTH: Final = 0.254
LOAD: Final = 6300.0
"""Of the wheels [N]: a quarter of a HMMWV."""
GRAVITY: Final = 9.81
SPEED: Final = 0.5
"""Of driven wheels [m/s]."""
DT: Final = 1e-3

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class DrivenWheel:
    """One wheel of a rig: its slip, 1 - v / (omega r), its soil and its load [N]."""

    slip: float
    soil: SoilSpec
    load: float = LOAD


@dataclasses.dataclass(frozen=True, kw_only=True)
class Driven:
    """Means over a metre, (wheels,): pull over load, torque over load and radius, sinkage [m]."""

    pull: Array
    torque: Array
    sinkage: Array


class WheelRig:
    """A wheel in every world that moves along X at a given speed and slip, free to rise and sink.

    Args:
        wheels: one for each world.
        spacing: of the soil's nodes [m].
        device: of the run.
        memory: of shear.
        normal: of the pressure.
    """

    def __init__(
        self, wheels: Sequence[DrivenWheel], spacing: float, device: str, memory: ShearMemory = ShearMemory.SCALAR,
        normal: PressureNormal = PressureNormal.GROUND,
    ) -> None:  # fmt: skip
        self.wheels = list(wheels)
        self.load = np.array([wheel.load for wheel in wheels])
        builder = ModelBuilder()
        start = pose((0.0, 0.0, RADIUS))
        mass = float(self.load.min()) / GRAVITY
        self._mass = mass
        sled = builder.add_body("sled", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=start)
        carrier = builder.add_body("carrier", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=start)
        self.body = builder.add_body("wheel", mass=mass - 1.0, inertia=(20.0, 30.0, 20.0), pose=start)
        motor = VelocityMotor(effort_limit=1.0e6)
        builder.add_joint_prismatic("along", WORLD, sled, axis=(1.0, 0.0, 0.0), drive=motor)
        builder.add_joint_prismatic("up", sled, carrier, axis=(0.0, 0.0, 1.0), damping=5.0e3)
        builder.add_joint_revolute("spin", carrier, self.body, axis=(0.0, 1.0, 0.0), drive=motor)
        model = builder.finalize(len(self.wheels), device)
        self.soil = Soil(
            model, [SoilWheel(body=self.body, radius=RADIUS, width=WIDTH)], self.wheels[0].soil, spacing=spacing,
            shear_memory=memory, pressure_normal=normal, per_world=True,
        )  # fmt: skip
        self.soil.parameter.assign(np.array([[wheel.soil.values()] for wheel in wheels]))
        self.simulation = Simulation(model, DT, elements=[self.soil])

    def press(self, share: float) -> None:
        """Puts a share of the loads on the wheels; the rest of their weight is held up."""
        force = np.zeros((*self.simulation.control.body_force.shape, 3), np.float32)
        force[:, self.body, 2] = self._mass * GRAVITY - share * self.load
        self.simulation.control.body_force.assign(force)

    def settle(self) -> None:
        """Puts the loads on slowly, at rest, in 2 s."""
        for step in range(200):
            self.press(min(1.0, step / 150.0))
            self.simulation.step(10)

    def turn(self, speed: float) -> None:
        """From now on moves at a speed [m/s], and turns as the slips say."""
        rates: Any = self.simulation.control.joint_target_qd.numpy()
        for rate, wheel in zip(rates, self.wheels, strict=True):
            rate[:] = [speed, 0.0, speed / (1.0 - wheel.slip) / RADIUS]
        self.simulation.control.joint_target_qd.assign(rates)

    def measure(self, samples: int = 400) -> Driven:
        """Means over the samples, one every 5 ms."""
        rows = []
        for _ in range(samples):
            self.simulation.step(5)
            force, torque = self.soil.force_w.numpy()[:, 0], self.soil.torque_w.numpy()[:, 0]
            deep = RADIUS - self.simulation.state.body_x.numpy()[:, self.body, 2]
            rows.append((force[:, 0] / self.load, -torque[:, 1] / (self.load * RADIUS), deep))
        pull, moment, sinkage = np.mean(rows, axis=0, dtype=float)
        return Driven(pull=pull, torque=moment, sinkage=sinkage)

    def go_back(self) -> None:
        """Sets the wheels to their start, on what was the surface, at rest; the ruts stay."""
        self.simulation.set_joint_state(None, np.zeros((1, 3)), np.zeros((1, 3)))


def driven_wheels(
    wheels: Sequence[DrivenWheel], spacing: float, device: str, memory: ShearMemory = ShearMemory.SCALAR,
    normal: PressureNormal = PressureNormal.GROUND,
) -> Driven:  # fmt: skip
    """Wheels at slips on fresh soil, at 0.5 m/s, each in a world of its own."""
    rig = WheelRig(wheels, spacing, device, memory, normal)
    rig.settle()
    rig.turn(SPEED)
    rig.simulation.step(3000)
    return rig.measure()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plate:
    """A plate on soil: a wheel on its side, whose disc covers twelve nodes, and no other within 2 cm to any side.

    Attributes:
        simulation, soil: of one world.
        body: the plate.
        area: of its nodes [m²].
    """

    simulation: Simulation
    soil: Soil
    body: int
    area: float

    @property
    def pressure(self) -> float:
        """Vertical force on it over its area [Pa]."""
        return float(self.soil.load.numpy()[0, 0]) / self.area

    @property
    def place(self) -> Array:
        """(3,) of its lower face from where it began, Z up [m]."""
        x: Array = self.simulation.state.body_x.numpy()[0, self.body]
        return x - PLATE_START


PLATE_RADIUS: Final = 0.18
PLATE_SPACING: Final = 0.1
PLATE_AREA: Final = 12 * PLATE_SPACING**2
PLATE_START: Final = np.array([0.05, 0.05, 0.1])
ON_ITS_SIDE: Final = (0.5**0.5, 0.0, 0.0, 0.5**0.5)


def _plate(
    soil: SoilSpec, mass: float, heading: float, device: str, memory: ShearMemory, *, held: bool,
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY), loose: bool = False,
) -> Plate:  # fmt: skip
    """A plate that moves along `heading` [rad], driven unless `loose`, and up and down, driven if `held`."""
    builder = ModelBuilder(gravity=gravity)
    start = pose(tuple(PLATE_START))
    motor = VelocityMotor(effort_limit=1.0e7)
    slider = builder.add_body("slider", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=start)
    body = builder.add_body("plate", mass=mass, inertia=(5.0, 5.0, 5.0), pose=pose(tuple(PLATE_START), ON_ITS_SIDE))
    along = (math.cos(heading), math.sin(heading), 0.0)
    builder.add_joint_prismatic("along", WORLD, slider, axis=along, drive=None if loose else motor)
    builder.add_joint_prismatic("up", slider, body, axis=(0.0, 0.0, 1.0), drive=motor if held else None)
    model = builder.finalize(1, device)
    wheel = SoilWheel(body=body, radius=PLATE_RADIUS, width=2.0 * float(PLATE_START[2]))
    element = Soil(model, [wheel], soil, spacing=PLATE_SPACING, shear_memory=memory)
    return Plate(simulation=Simulation(model, DT, elements=[element]), soil=element, body=body, area=PLATE_AREA)


def pressed_plate(soil: SoilSpec, turns: Sequence[float], device: str) -> tuple[Array, Array]:
    """Sinkage [m] and pressure [Pa] of a plate: pressed to each depth and let go of until nothing presses, in turn.

    Args:
        soil: without damping, for the law itself.
        turns: depths [m], rising.
        device: of the run.
    """
    plate = _plate(soil, 100.0, 0.0, device, ShearMemory.SCALAR, held=True)
    rows = [(0.0, 0.0)]

    def move(speed: float, every: int, done: Callable[[float, float], bool]) -> None:
        plate.simulation.control.joint_target_qd.assign(np.array([[0.0, speed]], np.float32))
        while not done(*rows[-1]):
            plate.simulation.step(every)
            rows.append((-float(plate.place[2]), plate.pressure))

    last = 0.0
    for depth in turns:
        # the elastic line is half a millimetre long: slowly there
        move(-SLOW, 25, partial(_beyond, last))
        move(-0.02, 25, partial(_beyond, depth))
        last = rows[-1][0]
        move(SLOW, 25, _free)
    sinkage, pressure = np.array(rows).T
    return sinkage, pressure


SLOW: Final = 2.0e-4
"""Speed of a plate along the elastic line [m/s]."""


def _beyond(depth: float, sinkage: float, pressure: float) -> bool:
    return sinkage >= depth


def _free(sinkage: float, pressure: float) -> bool:
    return pressure <= 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dragged:
    """A dragged plate over time: its way, the force against it and to its left, the load (n,) [m, N]."""

    way: Array
    force: Array
    across: Array
    load: Array


def dragged_plate(
    soil: SoilSpec, heading: float, device: str, memory: ShearMemory = ShearMemory.DIRECTION, load: float = 6000.0,
    ways: Sequence[float] = (0.018,),
) -> Dragged:  # fmt: skip
    """A plate that settles under its load for 3 s and is then dragged at 2 cm/s, to each of the ways in turn [m]."""
    plate = _plate(soil, load / GRAVITY, heading, device, memory, held=False)
    plate.simulation.step(3000)
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    left = np.array([-ahead[1], ahead[0], 0.0])
    rows = []
    for goal in ways:
        sign = 1.0 if goal > float(plate.place @ ahead) else -1.0
        plate.simulation.control.joint_target_qd.assign(np.array([[0.02 * sign, 0.0]], np.float32))
        while sign * (goal - float(plate.place @ ahead)) > 0.0:
            plate.simulation.step(5)
            force = plate.soil.force_w.numpy()[0, 0].astype(float)
            rows.append((float(plate.place @ ahead), -sign * float(force @ ahead), float(force @ left), force[2]))
    way, against, across, normal = np.array(rows).T
    return Dragged(way=way, force=against, across=across, load=normal)


def plate_on_slope(soil: SoilSpec, slope: float, seconds: float, device: str, memory: ShearMemory) -> float:
    """How far a loose plate of 600 kg creeps downhill on a slope (rise per run), a second after it was set down [m]."""
    lean = math.atan(slope)
    gravity = (GRAVITY * math.sin(lean), 0.0, -GRAVITY * math.cos(lean))
    plate = _plate(soil, 600.0, 0.0, device, memory, held=False, gravity=gravity, loose=True)
    plate.simulation.step(1000)
    start = plate.place
    plate.simulation.step(round(seconds / DT))
    return float(np.linalg.norm(plate.place - start))


def yielded_nodes(soil: Soil, world: int = 0) -> tuple[npt.NDArray[np.int64], Array]:
    """Columns and rows (n, 2) of a world's nodes that yielded, and their memory (n, values), row by row of the grid."""
    memory = {name: array.numpy()[world] for name, array in soil.memory.items()}
    count = int(memory["count"])
    values = memory["node"][: count * PAGE_NODES]
    inside = np.arange(PAGE_NODES)
    column = (SIDE * memory["place_x"][:count, None] + inside % SIDE).ravel()
    row = (SIDE * memory["place_y"][:count, None] + inside // SIDE).ravel()
    order = np.lexsort((column, row))
    order = order[values[order, YIELD] > 0.0]
    return np.stack([column, row], axis=1)[order].astype(np.int64), values[order].astype(float)


def ruts(soil: Soil, world: int = 0) -> tuple[Array, Array]:
    """Places (n, 2) of all nodes that yielded in a world, and how deep each stays when nothing presses on it (n,) [m].

    Along the normal of the undeformed ground. In the order of the grid: row by row.
    """
    nodes, values = yielded_nodes(soil, world)
    return soil.spacing * nodes.astype(float), values[:, SINKAGE]


def rut_profile(soil: Soil, start: float, end: float, world: int = 0) -> tuple[Array, Array]:
    """Lateral positions (n,) and mean depths (n,) of a rut along X, over columns from `start` to `end` [m]."""
    place, depth = ruts(soil, world)
    near = (place[:, 0] >= start) & (place[:, 0] <= end)
    across = np.unique(np.round(place[near, 1], 6))
    columns = len(np.unique(np.round(place[near, 0], 6)))
    total = [depth[near][np.abs(place[near, 1] - y) < 1e-6].sum() / columns for y in across]
    return across, np.array(total)


def repeated_passes(
    soil: SoilSpec, passes: int, spacing: float, device: str, slip: float = 0.05, load: float = LOAD
) -> list[tuple[Array, Array]]:
    """`rut_profile` of the third metre after each pass of a wheel at 1 m/s over the same ground."""
    rig = WheelRig([DrivenWheel(slip=slip, soil=soil, load=load)], spacing, device, ShearMemory.DIRECTION)
    found = []
    rig.press(1.0)
    for _ in range(passes):
        rig.go_back()
        rig.turn(1.0)
        rig.simulation.step(3300)
        found.append(rut_profile(rig.soil, 1.6, 2.6))
    return found
