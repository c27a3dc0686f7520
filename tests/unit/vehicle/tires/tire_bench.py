"""One wheel per world on a test bench: the tire kernel and its reference on the same states."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.vehicle.spec.vehicle_files import read_spec
from simwarp.vehicle.spec.vehicle_spec import Tire
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.tires import Mount, ParameterVector, Tires, ground, tire_vector
from tests.reference.tires import Wheel

DATA = Path(__file__).resolve().parents[4] / "simwarp" / "vehicle" / "data" / "hmmwv" / "tires"
TEMPLATES = tuple(MODELS)
DT = 1.0e-3
PARKED_MASS = 800.0
"""Of what stands on one wheel [kg]."""


def spec(template: str, **changes) -> Tire:
    """An HMMWV tire, with some parameters changed."""
    tire = read_spec(Tire, DATA / f"{template}.json")
    return dataclasses.replace(tire, parameters={**tire.parameters, **changes})


def row_of(template: str, **changes) -> ParameterVector:
    return tire_vector(spec(template, **changes))


def properties(**changes) -> dict:
    """The keys of the Pacejka 2002 tire's property file, with some changed."""
    tir: Any = spec("pacejka2002").parameters["tir"]
    return {**tir, **changes}


def values(row: ParameterVector) -> np.ndarray:
    """The row as the kernel has it: float32 numbers."""
    return row.values.astype(np.float32).astype(float)


def quaternion(axis, angle) -> np.ndarray:
    return np.array([*(np.sin(0.5 * angle) * np.asarray(axis)), np.cos(0.5 * angle)])


def product(p, q) -> np.ndarray:
    """Quaternion product, xyzw."""
    return np.array([*(p[3] * q[:3] + q[3] * p[:3] + np.cross(p[:3], q[:3])), p[3] * q[3] - p[:3] @ q[:3]])


def rotated(q, v) -> np.ndarray:
    return v + 2.0 * np.cross(q[:3], np.cross(q[:3], v) + q[3] * v)


@dataclasses.dataclass
class States:
    """Motion of the wheels, one per world: float64 positions, the rest as float32 has it."""

    x: np.ndarray
    q: np.ndarray
    v: np.ndarray
    omega: np.ndarray

    def __post_init__(self) -> None:
        self.v = self.v.astype(np.float32).astype(float)
        self.omega = self.omega.astype(np.float32).astype(float)

    def arrays(self) -> Any:
        state: Any = StateArrays()
        state.body_x = wp.array(self.x[:, None], dtype=wp.vec3d, device="cpu")
        state.body_rot = wp.array(self.q[:, None], dtype=wp.quatd, device="cpu")
        state.body_v = wp.array(self.v[:, None], dtype=wp.vec3, device="cpu")
        state.body_omega = wp.array(self.omega[:, None], dtype=wp.vec3, device="cpu")
        return state

    def wheel(self, world: int) -> Wheel:
        axis = rotated(self.q[world], np.array([0.0, 1.0, 0.0]))
        return Wheel(self.x[world], axis, self.v[world], self.omega[world])


def bench(row: ParameterVector, worlds: int, **options) -> Tires:
    """Tires of as many worlds, one wheel each."""
    side = options.pop("side", "left")
    return Tires([Mount(row, 0, side=side)], worlds, 1, "cpu", **options)


def steady(row: ParameterVector, *, speed=20.0, slip=0.0, angle=0.0, load=8000.0, camber=0.0) -> States:
    """Wheels that roll along x on the plane z = 0 with slip ratios and slip angles [rad], under a load [N]."""
    slip, angle, camber = (np.atleast_1d(np.asarray(a, dtype=float)) for a in np.broadcast_arrays(slip, angle, camber))
    radius = row.values[0]
    low, high = 0.5 * radius, radius
    for _ in range(60):
        height = 0.5 * (low + high)
        low, high = (height, high) if load_at(row, height) > load else (low, height)
    zero = 0.0 * slip
    effective = radius - row.values[2] * (radius - height)
    spin = speed * np.cos(angle) * (1.0 + slip) / effective
    x = np.stack([zero, zero, zero + height], axis=-1)
    # camber about the point of contact, which stays below
    q = np.stack([quaternion((1.0, 0.0, 0.0), c) for c in camber])
    x[:, 2] *= np.cos(camber)
    omega = np.stack([zero, np.cos(camber) * spin, np.sin(camber) * spin], axis=-1)
    return States(x, q, np.stack([speed * np.cos(angle), speed * np.sin(angle), zero], axis=-1), omega)


def load_at(row: ParameterVector, height: float) -> float:
    """Load of a wheel at rest over the plane z = 0 [N]."""
    tires = bench(row, 1)
    still = np.zeros((1, 3))
    tires.apply(DT, States(np.array([[0.0, 0.0, height]]), np.array([[0.0, 0.0, 0.0, 1.0]]), still, still).arrays())
    return float(tires.load.numpy()[0, 0])


def run(row: ParameterVector, states: States, steps: int = 1, **options) -> Tires:
    """The tires after some steps of the same motion."""
    tires = bench(row, len(states.x), **options)
    arrays = states.arrays()
    for _ in range(steps):
        tires.apply(DT, arrays)
    return tires


def parked(row, worlds, angle, dt, seconds):
    """Point masses on locked wheels, turned in different directions on a slope: positions over time (steps, W, 3)."""
    normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    rotation = quaternion((0.0, 1.0, 0.0), -angle)
    tires = bench(row, worlds, terrain=ground("cpu", rotation=rotation), friction=0.8)
    turns = np.linspace(0.0, np.pi, worlds)
    q = np.stack([product(rotation, quaternion((0.0, 0.0, 1.0), a)) for a in turns])
    x = np.tile((row.values[Common.RADIUS] - 0.02) * normal, (worlds, 1))
    v = np.zeros((worlds, 3))
    states = States(x, q, v, np.zeros((worlds, 3)))
    arrays = states.arrays()
    path = []
    for _ in range(round(seconds / dt)):
        tires.apply(dt, arrays)
        v = v + dt * (tires.force.numpy()[:, 0] / PARKED_MASS + [0.0, 0.0, -9.81])
        x = x + dt * v
        arrays.body_x.assign(x[:, None])
        arrays.body_v.assign(v[:, None].astype(np.float32))
        path.append(x)
    return np.array(path)


def damped(template):
    """Dampers that end all bouncing in seconds: while the load swings, bristles give way bit by bit, as they should."""
    if template == "pacejka2002":
        return {"tir": properties(VERTICAL_DAMPING=6000.0)}
    return {"vertical_damping": 6000.0, **({"bristle_viscosity": (1.0, 1.0)} if template == "lugre" else {})}


def check_held(row, dt):
    """Assert that brakes hold five wheels on a slope of 0.2: they settle in 4 s, and stay for as long."""
    path = parked(row, 5, np.arctan(0.2), dt, 8.0)
    settled = path[len(path) // 2]
    # what it slid before is the give of the bristles: 1600 N / 1e5 N/m = 16 mm, and LuGre's 0.2 / 60 = 3 mm
    assert np.abs(settled - path[0])[:, :2].max() < 0.05
    # 4 s later: rounding of the velocity, 1e-7 m/s, moves it less than this
    assert np.abs(path[-1] - settled)[:, :2].max() < 1e-5
