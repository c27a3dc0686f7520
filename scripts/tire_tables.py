"""The table of grips in docs/vehicles.md, measured on the tire kernel: `python -m scripts.tire_tables` writes it.

Each tire rolls at 20 m/s on a plane whose friction is the one it was measured on, under the load that it bears in its
vehicle at rest. The table stands between `<!-- grips of tires -->` and `<!-- end of grips -->`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

import simwarp as sw
from simwarp.kernels.core.fields import StateArrays
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world, with_options
from simwarp.vehicle.spec.vehicle_spec import Tire
from simwarp.vehicle.tires.parameter_vector import MODELS, ParameterVector, tire_vector
from simwarp.vehicle.tires.parameter_vector_kernels import Common, TireModel
from simwarp.vehicle.tires.tires import Mount, Tires

Array: TypeAlias = npt.NDArray[np.float64]

PAGE = Path(__file__).resolve().parent.parent / "docs" / "vehicles.md"
BLOCK = re.compile(r"(<!-- grips of tires -->\n).*?(<!-- end of grips -->)", re.DOTALL)
SHIPPED = {
    "hmmwv": ("tmeasy", "tmsimple", "fiala", "pacejka89", "pacejka2002", "lugre"),
    "gator": ("tmeasy",),
    "artcar": ("tmeasy",),
    "sedan": ("tmeasy", "pacejka2002"),
    "skid-steer": ("lugre",),
}
"""Vehicles and the force laws that come with them; the first one is that of the load at rest."""
SPEED = 20.0
STEP = 1.0e-3
SETTLED = 300
"""Steps after which a bristle of LuGre has taken its place: 6 m of way."""
SMALL = 2.0e-3
"""Slip angle of the cornering stiffness [rad]."""


class Grip(NamedTuple):
    """What one tire does under one load."""

    stiffness: float
    """Cornering stiffness [N/rad]."""
    lateral: float
    """Largest lateral force over the load."""
    braking: float
    """Largest force of braking over the load."""
    locked: float
    """Force of the locked wheel over the load."""


def rolling(vector: ParameterVector, height: float, slip: Array, angle: Array) -> tuple[Array, float]:
    """Forces (N, 3) of wheels that roll along x with slip ratios and slip angles, and their load [N]."""
    count = len(slip)
    friction = float(vector.values[Common.REFERENCE_FRICTION])
    tires = Tires([Mount(vector, 0)], count, 1, "cpu", friction=friction)
    effective = float(vector.values[Common.RADIUS]) * (1.0 - float(vector.values[Common.RADIUS_SHARE]))
    effective += float(vector.values[Common.RADIUS_SHARE]) * height
    zero = np.zeros(count)
    spin = SPEED * np.cos(angle) * (1.0 + slip) / effective
    state: Any = StateArrays()
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    state.body_x = wp.array(np.stack([zero, zero, zero + height], axis=-1)[:, None], dtype=wp.vec3d, device="cpu")
    state.body_rot = wp.array(upright[:, None], dtype=wp.quatd, device="cpu")
    v = SPEED * np.stack([np.cos(angle), np.sin(angle), zero], axis=-1)
    state.body_v = wp.array(v[:, None], dtype=wp.vec3, device="cpu")
    state.body_omega = wp.array(np.stack([zero, spin, zero], axis=-1)[:, None], dtype=wp.vec3, device="cpu")
    for _ in range(SETTLED if vector.model is TireModel.LUGRE else 1):
        tires.apply(STEP, state)
    return tires.force_w.numpy()[:, 0].astype(float), float(tires.load.numpy()[0, 0])


def height_under(vector: ParameterVector, load: float) -> float:
    """Height of the wheel's centre at which it bears a load [m]: bisection."""
    high = float(vector.values[Common.RADIUS])
    low, none = 0.5 * high, np.zeros(1)
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rolling(vector, middle, none, none)[1] > load else (low, middle)
    return 0.5 * (low + high)


def grip(tire: Tire, load: float) -> Grip:
    """What a tire does under a load [N]."""
    vector = tire_vector(tire)
    height = height_under(vector, load)
    angles = np.concatenate([[-SMALL, SMALL], np.linspace(0.0, 0.8, 321)])
    side = rolling(vector, height, 0.0 * angles, angles)[0][:, 1]
    slips = np.linspace(-1.0, 0.0, 401)
    along = rolling(vector, height, slips, 0.0 * slips)[0][:, 0]
    return Grip(
        (side[0] - side[1]) / (2.0 * SMALL), float(np.abs(side[2:]).max()) / load, float(np.abs(along).max()) / load,
        abs(float(along[0])) / load,
    )  # fmt: skip


def loads_at_rest(name: str) -> list[float]:
    """Load of one tire of each axle of a shipped vehicle at rest [N]."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle(name), tire=SHIPPED[name][0]))
    vehicle = Vehicle(parts, builder.finalize(1, "cpu", per_world=per_world()))
    sw.Simulation(vehicle.model, STEP, elements=[vehicle], solver=VEHICLE_SOLVER).step(3000)
    loads, axles = vehicle.tires.load.numpy()[0], [side.axle for side in parts.sides]
    return [
        float(loads[[k for k, axle in enumerate(axles) if axle == number]].mean()) for number in range(max(axles) + 1)
    ]


def rows(name: str) -> list[str]:
    """Lines of the table for a vehicle; axles whose tires and loads are alike within 2 % share one."""
    lines = []
    loads = loads_at_rest(name)
    for tire in SHIPPED[name]:
        axles = with_options(load_vehicle(name), tire=tire).axles
        shared = all(axle.tire == axles[0].tire for axle in axles) and max(loads) < 1.02 * min(loads)
        for number, (axle, load) in enumerate(zip(axles, loads, strict=True)):
            if shared and number:
                continue
            assert axle.tire.template in MODELS
            at, twice = grip(axle.tire, load), grip(axle.tire, 2.0 * load)
            place = "" if shared else (", front", ", rear")[number]
            lines.append(
                f"| `{name}`{place} | `{tire}` | {load / 1e3:.3g} | {at.stiffness / 1e3:.3g} | {at.lateral:.2f} |"
                f" {at.braking:.2f} | {at.locked:.2f} | {twice.stiffness / at.stiffness:.2f} |"
                f" {twice.lateral / at.lateral:.2f} |"
            )
    return lines


def table() -> str:
    """The whole table."""
    columns = (
        "vehicle", "tire", "load at rest [kN]", "cornering stiffness [kN/rad]", "largest lateral force / load",
        "largest braking force / load", "locked wheel / load", "stiffness at twice the load",
        "lateral grip at twice the load",
    )  # fmt: skip
    head = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    return "\n".join([*head, *(line for name in SHIPPED for line in rows(name))]) + "\n"


def main() -> int:
    """Write the page; exit code 0."""
    made = table()
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda match: f"{match[1]}{made}{match[2]}", page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
