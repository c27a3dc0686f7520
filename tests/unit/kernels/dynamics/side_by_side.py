"""Steps a simulation and its float64 reference side by side, one step at a time from the simulation's own state.

How far they may differ after one step (`tolerance`):

- rounding: the kernel works in float32 on speeds of size `speed`; a solve with constraint matrix of condition k loses
  k roundings per operation. Measured over some 200 random mechanisms: below 4 eps k speed; 12 are allowed.
- violation C of the joints at the step's start: the tree turns a joint's error away as one vector, the reference by the
  scalar rows of `RowKind`; their Jacobians differ by terms of order C, which act on `speed`, and the solve may enlarge
  that by the condition. Measured: below 3.5 C speed, and 26 where k = 90; 6 max(1, k / 16) are allowed. The same holds
  for redundant rows, of which the kernel keeps some and the reference a mean. The first step starts with C = 0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

import simwarp as sw
from simwarp.core.types import JointType
from simwarp.model.builder import ModelBuilder
from tests.reference.step import ReferenceStep
from tests.reference.step_solve import Bilateral

EPS = float(np.finfo(np.float32).eps)
ROUNDINGS = 12.0
VIOLATIONS = 6.0

Controls = dict[str, np.ndarray]


@dataclasses.dataclass
class Pair:
    """A simulation and its reference."""

    sim: sw.Simulation
    reference: ReferenceStep
    world: int = 0

    @classmethod
    def of(cls, builder: ModelBuilder, dt: float = 1e-3, *, rank: int | str | None = None, **options: Any) -> Pair:
        options.setdefault("solver", sw.SolverOptions(position_projection=0))  # the reference does not project
        sim = sw.Simulation(builder.finalize(1, "cpu"), dt, **options)
        return cls(sim, ReferenceStep(builder, dt, rank=rank, numerical_damping=sim.solver.numerical_damping))

    def feed(self) -> None:
        """Gives the reference the state of record of the simulation."""
        state, builder = self.sim.state, self.reference.builder
        columns = [builder.dof_start(j) for j, spec in enumerate(builder.joints) if spec.type == JointType.SHAFT]
        q = state.joint_x.numpy()[self.world]
        qd = state.joint_qd.numpy()[self.world].astype(float)
        self.reference.set_state(
            state.body_x.numpy()[self.world], state.body_rot.numpy()[self.world], state.body_v.numpy()[self.world],
            state.body_omega.numpy()[self.world], q[columns], qd[columns], state.body_omega_last.numpy()[self.world],
        )  # fmt: skip
        self.reference.joint_q, self.reference.joint_qd = q.copy(), qd
        self.reference.time = float(self.sim.time.numpy()[self.world])

    def condition(self) -> float:
        """Largest over smallest singular value of the bilateral rows in the mass metric (rows of unit length)."""
        reference = self.reference
        rows = np.vstack(
            [
                reference.rows.jacobian[: reference.rows.bilateral],
                reference.coupling_coefficients @ reference.dof_jacobian,
            ]
        )  # prescribed rows sit on coordinates of their own
        solved = Bilateral(
            reference.mass_matrix(), rows, None if reference.rank is None else min(reference.rank, len(rows))
        )
        return float(solved.s[0] / solved.s[-1]) if solved.rank else 1.0

    def step(self, controls: Controls | None = None) -> None:
        """One step of both, from the simulation's state and the same controls (float32 values)."""
        self.feed()
        control = self.sim.control
        control.clear()
        wanted: dict[str, np.ndarray] = {}
        for name, values in (controls or {}).items():
            single = np.asarray(values, np.float32)
            getattr(control, name).assign(single[None])
            wanted[name.replace("joint_target", "target")] = single.astype(float)
        for kind in ("force", "torque"):  # the reference knows forces in the world frame only
            turned = wanted.pop(f"body_{kind}_b", None)
            if turned is not None:
                world = np.einsum("bij,bj->bi", self.reference.rotation, turned)
                wanted[f"body_{kind}"] = world + wanted.get(f"body_{kind}", 0.0)
        self.sim.step()
        self.reference.step(**wanted)

    def differences(self) -> dict[str, float]:
        """Largest absolute differences of velocities, poses and coordinates."""
        s, reference, world = self.sim.state, self.reference, self.world

        def far(a: np.ndarray, b: np.ndarray) -> float:
            return float(np.max(np.abs(a.astype(float) - b), initial=0.0))

        turned = np.abs(np.sum(s.body_rot.numpy()[world] * reference.rot, axis=1))
        return {
            "v": far(s.body_v.numpy()[world], reference.v), "omega": far(s.body_omega.numpy()[world], reference.omega),
            "qd": far(s.joint_qd.numpy()[world], reference.joint_qd), "x": far(s.body_x.numpy()[world], reference.x),
            # an angle a makes 1 - |cos(a/2)| = a²/8
            "turn": float(np.sqrt(8.0 * np.max(np.maximum(1.0 - turned, 0.0), initial=0.0))),
            "q": far(s.joint_x.numpy()[world], reference.joint_q),
        }  # fmt: skip


def tolerance(speed: float, condition: float, violation: float) -> float:
    """Allowed difference of velocities after one step [m/s, rad/s]; see the module's text."""
    per_speed = ROUNDINGS * EPS * condition + VIOLATIONS * violation * max(1.0, condition / 16.0)
    return per_speed * max(speed, 1.0)


def random_controls(builder: ModelBuilder, rng: np.random.Generator, size: float = 1.0) -> Controls:
    """Efforts on every coordinate."""
    return {"joint_force": size * rng.normal(size=builder.dof_count)}


def assert_same_steps(
    builder: ModelBuilder,
    *,
    dt: float = 1e-3,
    steps: int = 4,
    size: float = 1.0,
    controls: Callable[[np.random.Generator, int], Controls] | None = None,
    rank: int | str | None = None,
    **options: Any,
) -> Pair:
    """Steps both `steps` times and compares after every step; returns the pair."""
    pair = Pair.of(builder, dt, rank=rank, **options)
    rng = np.random.default_rng(0)
    for step in range(steps):
        inputs = random_controls(builder, rng, size) if controls is None else controls(rng, step)
        pair.feed()
        violation, condition = pair.reference.violation(), pair.condition()
        before = float(np.max(np.abs(pair.reference.velocity), initial=0.0))
        pair.step(inputs)
        speed = max(before, float(np.max(np.abs(pair.reference.velocity), initial=0.0)))
        allowed = tolerance(speed, condition, violation)
        found = pair.differences()
        report = (
            f"step {step}: {found}, allowed {allowed:.2g} (speed {speed:.2g}, k {condition:.2g}, C {violation:.2g})"
        )
        assert max(found["v"], found["omega"], found["qd"]) <= allowed, report
        # positions: what the velocities make of them in one step; angles are float32 within their turn (pi eps)
        assert max(found["x"], found["turn"]) <= dt * allowed + 4.0 * EPS * dt * speed + 1e-7, report
        assert found["q"] <= 2.0 * dt * allowed + 4.0 * EPS, report
        assert int(pair.sim.state.world_status.numpy()[0]) == 0, report
    return pair
