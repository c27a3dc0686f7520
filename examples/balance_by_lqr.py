"""Balance a pole on a cart by a regulator that is computed from the simulation itself, in 256 worlds.

    python examples/balance_by_lqr.py

`linearise` gives A and B at the upright state, SciPy solves the Riccati equation, and u = -K (z - z0) holds poles that
start up to 0.2 rad off. A pole without the regulator falls.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_continuous_are

import simwarp as sw
from simwarp.analysis import linearise, modes

WORLDS, DT, SECONDS = 256, 5e-3, 5.0


def cart_pole() -> sw.ModelBuilder:
    """A cart of 1 kg on a rail along X, and a pole of 0.2 kg and 1 m that stands on it."""
    builder = sw.ModelBuilder()
    cart = builder.add_body("cart", mass=1.0, inertia=(0.1, 0.1, 0.1))
    pole = builder.add_body("pole", mass=0.2, inertia=(1 / 60, 1 / 60, 1e-4), pose=sw.pose((0.0, 0.0, 0.5)))
    builder.add_joint_prismatic("rail", sw.WORLD, cart, axis=(1.0, 0.0, 0.0), anchor=(0.0, 0.0, 0.0))
    builder.add_joint_revolute("hinge", cart, pole, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    return builder


def main() -> float:
    """Return the largest angle that is left after some seconds [rad]."""
    simulation = sw.Simulation(cart_pole().finalize(WORLDS, "cpu"), DT)
    linear = linearise(simulation, inputs=["rail"])
    print("coordinates", linear.coordinates)
    print("A\n", linear.a.round(3), "\nB", linear.b.T.round(3))
    print("upright, a push grows with", -modes(linear).decay.min().round(2), "1/s")
    weights = np.diag([1.0, 10.0, 1.0, 1.0])
    riccati = solve_continuous_are(linear.a, linear.b, weights, np.eye(1))
    gain = linear.b.T @ riccati
    print("K", gain.round(2))
    start = np.zeros((WORLDS, 2))
    start[:, 1] = np.linspace(-0.2, 0.2, WORLDS)
    simulation.set_joint_state(None, start, None)
    force = np.zeros((WORLDS, 2), np.float32)
    for _ in range(round(SECONDS / DT)):
        state = np.concatenate([simulation.state.joint_q.numpy(), simulation.state.joint_qd.numpy()], axis=1)
        force[:, 0] = -(state @ gain.T)[:, 0]
        simulation.control.joint_force.assign(force)
        simulation.step()
    left = float(np.abs(simulation.state.joint_q.numpy()[:, 1]).max())
    print(f"largest angle after {SECONDS:g} s: {left:.1e} rad")
    return left


if __name__ == "__main__":
    main()
