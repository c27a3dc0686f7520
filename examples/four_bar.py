"""A closed loop: a four-bar linkage runs free, and its energy shows what the time step loses.

Four hinges close one loop; three of its rows are redundant, as in every planar mechanism. The same run is made with
and without projecting the positions onto the joints after each step.

Run: python examples/four_bar.py --seconds 10 --plot four_bar.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

import simwarp as sw

Array = npt.NDArray[np.float64]
GRAVITY = 9.81

# Pins of the mechanism in the XZ plane [m]: ground, crank end, coupler end, ground
PINS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.8, 0.0, 0.7), (0.95, 0.0, 0.0))
MASSES = (0.5, 1.5, 1.0)


def add_rod(builder: sw.ModelBuilder, name: str, start: Array, end: Array, mass: float) -> int:
    """A thin rod between two points: body axes are world axes, so its inertia is a full matrix."""
    length = np.linalg.norm(end - start)
    along = (end - start) / length
    across = mass * length**2 / 12.0
    inertia = across * (np.eye(3) - 0.999 * np.outer(along, along))
    return builder.add_body(name, mass=mass, inertia=inertia, pose=sw.pose(0.5 * (start + end)))


def four_bar() -> sw.ModelBuilder:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    o, a, b, c = (np.array(pin) for pin in PINS)
    crank = add_rod(builder, "crank", o, a, MASSES[0])
    coupler = add_rod(builder, "coupler", a, b, MASSES[1])
    rocker = add_rod(builder, "rocker", c, b, MASSES[2])
    axis = (0.0, 1.0, 0.0)
    builder.add_joint_revolute("crank_pivot", sw.WORLD, crank, axis=axis, anchor=o)
    builder.add_joint_revolute("crank_pin", crank, coupler, axis=axis, anchor=a)
    builder.add_joint_revolute("rocker_pivot", sw.WORLD, rocker, axis=axis, anchor=c)
    builder.add_joint_revolute("rocker_pin", coupler, rocker, axis=axis, anchor=b)  # closes the loop
    return builder


def energy(sim: sw.Simulation) -> float:
    """Kinetic and potential energy of world 0 [J]."""
    height = sim.state.body_x.numpy()[0, :, 2]
    v = sim.state.body_v.numpy()[0].astype(float)
    omega = sim.state.body_omega.numpy()[0].astype(float)
    rotation = sim.state.body_rot.numpy()[0]
    mass = sim.model.body_mass.numpy()[0].astype(float)
    inertia = sim.model.body_inertia_b.numpy()[0].astype(float)
    total = float(np.sum(0.5 * mass * np.sum(v**2, axis=1) + mass * GRAVITY * height))
    for q, i, w in zip(rotation, inertia, omega, strict=True):
        r = matrix(q)
        total += 0.5 * float(w @ r @ i @ r.T @ w)
    return total


def matrix(q: Array) -> Array:
    """Rotation matrix of an xyzw quaternion."""
    skew = np.array([[0.0, -q[2], q[1]], [q[2], 0.0, -q[0]], [-q[1], q[0], 0.0]])
    return np.asarray(np.eye(3) + 2.0 * q[3] * skew + 2.0 * skew @ skew)


def run(seconds: float, dt: float, passes: int) -> tuple[Array, Array, float]:
    """Times, energies, and the largest joint violation [m or rad]."""
    model = four_bar().finalize(world_count=1, device="cpu")
    sim = sw.Simulation(model, dt=dt, solver=sw.SolverOptions(position_projection=passes))
    rates = np.zeros((1, model.dof_count))
    rates[0, model.dof("crank_pivot")] = 12.0
    sim.set_joint_state(None, np.zeros_like(rates), rates)  # rates become consistent with the loop
    times, energies, violation = [], [], 0.0
    for step in range(round(seconds / dt) + 1):
        if step % 10 == 0:
            times.append(step * dt)
            energies.append(energy(sim))
        sim.step()
        violation = max(violation, float(sim.diagnostics.position_error.numpy()[0]))
    return np.array(times), np.array(energies), violation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--dt", type=float, default=0.001)
    parser.add_argument("--plot", type=Path, default=None, help="picture to write")
    args = parser.parse_args()

    curves = {}
    for passes in (0, 2):
        times, energies, violation = run(args.seconds, args.dt, passes)
        drift = (energies - energies[0]) / energies[0]
        curves[f"{passes} projection passes"] = drift
        print(
            f"{passes} projection passes: energy drift {drift[-1]:+.2e}, at most {np.abs(drift).max():.2e};"
            f" joint violation at most {violation:.1e} m or rad"
        )
    if args.plot is not None:
        try:
            import matplotlib.pyplot as plt
        except ImportError:
            print("no picture: matplotlib is not installed")
            return
        figure, axes = plt.subplots()
        for label, drift in curves.items():
            axes.plot(times, drift, label=label)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("relative energy drift")
        axes.legend()
        figure.savefig(args.plot)
        print(f"wrote {args.plot}")


if __name__ == "__main__":
    main()
