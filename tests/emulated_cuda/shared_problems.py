"""Cone problems that lanes of a warp share against those that a thread solves alone; prints as JSON how they agree.

`python -m tests.emulated_cuda tests/emulated_cuda/shared_problems.py`
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.kernels.dynamics import solve_stages, world
from tests.emulated_cuda.device import device
from tests.reference.yards import PARTS, yard

WORLDS = 3
LANES = (1, 8, 32)
SEEDS = (1, 7)


def rolling() -> sw.ModelBuilder:
    """Balls with rolling and spinning friction, and a box among them."""
    builder = sw.ModelBuilder()
    rough = sw.Material(friction=0.6, rolling_friction=0.01, spinning_friction=0.01)
    builder.add_shape_plane(material=rough)
    for index in range(3):
        body = builder.add_body(
            f"b{index}", mass=1.0, inertia=(0.01, 0.01, 0.01), pose=sw.pose((0.39 * index, 0.0, 0.199)),
            velocity=(0.3 - 0.2 * index, 0.2, 0.0), omega=(0.0, 1.0, 3.0),
        )  # fmt: skip
        if index == 1:
            builder.add_shape_box(body, half=(0.19, 0.2, 0.2))
        else:
            builder.add_shape_sphere(body, radius=0.2, material=rough)
    return builder


CASES: dict[str, tuple[Callable[[], sw.ModelBuilder], int, dict[str, Any]]] = {
    "ant": (scenes.ant, 12, {}),
    "without S": (scenes.ant, 12, {"dense_rows": 0}),
    "Newton": (lambda: scenes.stack(count=3), 12, {"tolerance": 1e-5}),
    "islands": (lambda: yard(PARTS), 12, {}),
    "loops": (lambda: yard(("linkage",)), 30, {}),
    "loops without S": (lambda: yard(("linkage",)), 30, {"dense_rows": 0}),
    "rolling": (rolling, 12, {}),
}
"""Models, steps until they have contacts, and options of the solver."""


def moved(name: str, lanes: int) -> dict[str, np.ndarray]:
    """Velocities after some steps, and what the solver says of the last."""
    solve_stages.lanes_for = world.lanes_for = lambda rows: lanes
    build, steps, options = CASES[name]
    model = build().finalize(WORLDS, "cuda:0")
    sim = sw.Simulation(model, 2e-3, solver=sw.SolverOptions(**{"tolerance": 1e-6, **options}), check_start=False)
    draws = np.random.default_rng(3)
    sim.control.joint_force.assign(draws.uniform(-30.0, 30.0, (WORLDS, model.dof_count)).astype(np.float32))
    omega = sim.state.body_omega.numpy()
    if model.joint_count == 0:
        sim.state.body_omega.assign(omega + draws.uniform(-1.0, 1.0, omega.shape))
    found: dict[str, np.ndarray] = {"iterations": np.zeros(WORLDS, int), "cone_residual": np.zeros(WORLDS)}
    for _ in range(steps):
        sim.step()
        for key, values in found.items():
            found[key] = np.maximum(values, getattr(sim.diagnostics, key).numpy())
    return found | {key: getattr(sim.state, key).numpy().copy() for key in ("body_v", "body_omega")}


def main() -> None:
    """Run all cases."""
    wp.config.log_level = wp.LOG_WARNING
    target = device()
    rows = {}
    for name in CASES:
        found = {}
        for lanes in LANES:
            runs = []
            for seed in SEEDS:
                target.seed = seed
                runs.append(moved(name, lanes))
            found[lanes] = runs[0]
            found[lanes]["same"] = np.array(all(np.array_equal(runs[0][key], runs[1][key]) for key in runs[1]))
        alone = found[1]
        rows[name] = {
            lanes: {
                "difference": max(float(np.abs(each[key] - alone[key]).max()) for key in ("body_v", "body_omega")),
                "speed": float(np.abs(alone["body_omega"]).max()),
                "iterations": each["iterations"].tolist(),
                "residual": float(each["cone_residual"].max()),
                "same": bool(each["same"]),
            }
            for lanes, each in found.items()
        }
    print(json.dumps({"rows": rows, "races": target.races(), "faults": [text for text, _ in target.faults.violations]}))


if __name__ == "__main__":
    main()
