"""A cart that a force pushes along a rail, to be brought to rest at the origin: linear, with a known optimum."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

import simwarp as sw
from simwarp.planning import Imagination

DT, STEPS, HORIZON = 0.05, 2, 20
"""Of a step [s]; steps of a control step; control steps."""
MASS = 2.0
Q = np.diag([1.0, 0.1])
R = np.array([[0.01]])
END = np.diag([10.0, 1.0])
FULL = 20.0
"""Force of the bounds [N]; the optimum stays within."""


def cart(worlds: int, start: tuple[float, float] = (1.0, 0.0), **options: Any) -> sw.Simulation:
    """Worlds with the cart at a place and a speed [m, m/s]."""
    builder = sw.ModelBuilder()
    body = builder.add_body("cart", mass=MASS, inertia=(1, 1, 1))
    builder.add_joint_prismatic("rail", sw.WORLD, body, axis=(1, 0, 0))
    sim = sw.Simulation(builder.finalize(worlds, "cpu"), DT, **options)
    sim.set_joint_state(None, np.full((worlds, 1), start[0]), np.full((worlds, 1), start[1]))
    return sim


def imagine(real: sw.Simulation, worlds: int, **options: Any) -> Imagination:
    """Imagined carts, pushed by -1 to 1 times the full force."""
    imagined = cart(worlds, **options)
    force = sw.to_torch(imagined.control.joint_force)
    return Imagination(
        real, imagined, act=lambda action: force.copy_(action), action_size=1, low=-FULL, high=FULL, steps=STEPS
    )


def matrices() -> tuple[Any, Any]:
    """A and B of a control step: the speed changes first, then the place (symplectic Euler), `STEPS` times."""
    a, b = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[DT * DT], [DT]]) / MASS
    whole, push = np.eye(2), np.zeros((2, 1))
    for _ in range(STEPS):
        whole, push = a @ whole, a @ push + b
    return whole, push


def optimal_cost(start: tuple[float, float] = (1.0, 0.0)) -> float:
    """Least sum of x'Qx + u'Ru, the first state included, and x'Ex at the end: Riccati's recursion in float64."""
    a, b = matrices()
    value = END
    for _ in range(HORIZON):
        gain = np.linalg.solve(R + b.T @ value @ b, b.T @ value @ a)
        value = Q + a.T @ value @ (a - b @ gain)
    x = np.array(start)
    return float(x @ value @ x)


def state_cost(x: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
    return x @ torch.as_tensor(Q) @ x + u @ torch.as_tensor(R) @ u


def end_state_cost(x: torch.Tensor) -> torch.Tensor:
    return x @ torch.as_tensor(END) @ x


def states(sim: sw.Simulation) -> torch.Tensor:
    """(W, 2) place and speed."""
    return torch.cat([sw.to_torch(sim.state.joint_x), sw.to_torch(sim.state.joint_qd).double()], dim=1)


def cost(sim: sw.Simulation, action: torch.Tensor) -> torch.Tensor:
    """That of a step by the state it leads to: over the horizon the first state is left out, the last one counts."""
    x = states(sim)
    return (x**2 @ torch.as_tensor(Q).diagonal()) + R[0, 0] * action[:, 0].double() ** 2


def end_cost(sim: sw.Simulation) -> torch.Tensor:
    return states(sim) ** 2 @ torch.as_tensor(END - Q).diagonal()


def first_cost(start: tuple[float, float] = (1.0, 0.0)) -> float:
    x = np.array(start)
    return float(x @ Q @ x)
