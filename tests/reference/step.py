"""The independent float64 reference of the step: one world, dense NumPy algebra, maximal coordinates.

It shares no code with the kernels: every joint is explicit rows, redundant or not, solved by a truncated SVD.
The equations are those of SOLVER sections 1 and 2, for whatever a ModelBuilder can hold besides contacts.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simwarp.core.types import Dof, JointType
from simwarp.model.builder import ModelBuilder
from tests.reference.step_laws import (
    DofInput,
    Rule,
    box_constraints,
    drive_terms,
    implicit_terms,
    prescribed_speed,
    relative_rotation,
    rotation_terms,
    table_integral,
)
from tests.reference.step_rows import Rows, matrices, quat_exp, quat_product
from tests.reference.step_solve import Bilateral, Boxes, solve_boxes

CURVATURE_SHARE = 1.0 / 3.0
FAST_STEP = 0.3  # rad


def gyroscopic(inertia: np.ndarray, w0: np.ndarray, h: float) -> np.ndarray:
    """Free body rate after `h`: the root of I (w1 - w0)/h + m x I m, m = (w0 + w1)/2 (body axes)."""

    def cross_matrix(a: np.ndarray) -> np.ndarray:
        return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])

    w1 = w0.copy()
    for _ in range(50):
        m = 0.5 * (w0 + w1)
        momentum = inertia @ m
        f = inertia @ (w1 - w0) + h * np.cross(m, momentum)
        jacobian = inertia + 0.5 * h * (cross_matrix(m) @ inertia - cross_matrix(momentum))
        change = np.linalg.solve(jacobian, f)
        w1 = w1 - change
        if np.linalg.norm(change) <= 1e-15 * (1.0 + np.linalg.norm(w1)):
            break
    return w1


ROTATIONS = {JointType.SPHERICAL: 0, JointType.BUSHING: 3, JointType.FREE: 3}
"""First of the three coordinates of a rotation vector."""


class ReferenceStep:
    """One world of a ModelBuilder, stepped in float64.

    State: `x` (B, 3) centres of mass, `rot` (B, 4) xyzw, `v`, `omega` (B, 3) world frame, `shaft_q`,
    `shaft_qd` (S,), `joint_q` (unwrapped) and `joint_qd` (D,) in the order of the builder, `time`.
    A correction C/h turns a body about its joint's error only while it turns less than 2.33 rad per step, where
    tan(x/2) = x (a hinge on the world): faster, the step itself amplifies the tilt of a hinge. Spin a shaft instead.
    After a step: `bilateral_impulse` per joint row, `dof_impulse` (D,) of everything along a degree of
    freedom but limits and friction, `prescribed_effort`, `coupling_impulse`, `box_impulse`.

    Args:
        rank: of the bilateral rows; measured in the initial configuration when None ("generic" assembly),
            "every" measures it in every step; the attribute `rank` is None then.
        numerical_damping: of springs, dampers and drives.
    """

    def __init__(
        self, builder: ModelBuilder, dt: float, *, rank: int | str | None = None, numerical_damping: float = 1.0
    ) -> None:
        self.rule = Rule(float(dt), numerical_damping)
        self.builder, self.dt, self.time = builder, float(dt), 0.0
        bodies = builder.bodies
        self.mass = np.array([b.mass for b in bodies])
        self.inertia = np.array([b.inertia for b in bodies]).reshape(-1, 3, 3)
        self.x = np.array([b.pose.position for b in bodies]).reshape(-1, 3)
        self.rot = np.array([b.pose.rotation for b in bodies]).reshape(-1, 4)
        self.v = np.array([b.velocity for b in bodies]).reshape(-1, 3)
        self.omega = np.array([b.omega for b in bodies]).reshape(-1, 3)
        self.omega_last = self.omega.copy()
        self.jointed = {body for joint in builder.joints for body in (joint.parent, joint.child)}
        self.rows = Rows(builder)
        shafts = [self.rows.joints[j] for j in self.rows.shaft_of]
        self.shaft_q = np.array([s.initial_q for s in shafts])
        self.shaft_qd = np.array([s.initial_qd for s in shafts])
        self.shaft_inertia = np.array([s.inertia for s in shafts])
        self.dofs: list[Dof] = [dof for joint in self.rows.joints for dof in joint.dofs]
        self.rotations = [self.rows.dof_start[j] + ROTATIONS[joint.type]
                          for j, joint in enumerate(self.rows.joints) if joint.type in ROTATIONS]  # fmt: skip
        self._evaluate()
        self.joint_q = self.rows.coordinates(self.shaft_q, None)
        self.joint_qd = self.dof_jacobian @ self.velocity
        self._set_couplings()
        self.rank: int | None = None
        if isinstance(rank, int):
            self.rank = rank
        elif rank is None:
            zeros = np.zeros(len(self.dofs))
            jacobian, _ = self._bilateral_rows(self._inputs(zeros, self.joint_q, zeros))
            self.rank = Bilateral(self.mass_matrix(), jacobian).rank
        self.bilateral_impulse = np.zeros(self.rows.bilateral)
        self.dof_impulse = np.zeros(len(self.dofs))
        self.prescribed_effort = np.zeros(len(self.dofs))
        self.coupling_impulse = np.zeros(len(builder.couplings))
        self.box_impulse = np.zeros(0)

    # ---- state ---------------------------------------------------------------------------------------------------

    @property
    def velocity(self) -> np.ndarray:
        """(6 B + S,): v and omega of each body, then the shaft speeds."""
        return np.concatenate([np.hstack([self.v, self.omega]).reshape(-1), self.shaft_qd])

    def set_velocity(self, velocity: np.ndarray) -> None:
        """Sets v, omega, shaft speeds and joint_qd from one vector like `velocity`."""
        bodies = velocity[: 6 * len(self.mass)].reshape(-1, 6)
        self.v, self.omega = bodies[:, :3].copy(), bodies[:, 3:].copy()
        self.shaft_qd = velocity[6 * len(self.mass) :].copy()
        self.joint_qd = self.dof_jacobian @ velocity

    def set_state(
        self,
        x: npt.ArrayLike,
        rot: npt.ArrayLike,
        v: npt.ArrayLike,
        omega: npt.ArrayLike,
        shaft_q: npt.ArrayLike = (),
        shaft_qd: npt.ArrayLike = (),
        omega_last: npt.ArrayLike | None = None,
    ) -> None:
        """Starts the next step from another state, say that of a simulation; angles stay next to those of now."""
        self.x, self.rot = np.array(x, float).reshape(-1, 3), np.array(rot, float).reshape(-1, 4)
        self.rot /= np.linalg.norm(self.rot, axis=1, keepdims=True)
        self.shaft_q = np.array(shaft_q, float)
        self._evaluate()
        bodies = np.hstack([np.array(v, float).reshape(-1, 3), np.array(omega, float).reshape(-1, 3)])
        self.set_velocity(np.concatenate([bodies.reshape(-1), np.array(shaft_qd, float)]))
        self.omega_last = self.omega.copy() if omega_last is None else np.array(omega_last, float).reshape(-1, 3)
        self.joint_q = self.rows.coordinates(self.shaft_q, self.joint_q)

    def _evaluate(self) -> None:
        self.rotation = matrices(self.rot)
        self.rows.evaluate(self.x, self.rotation)
        self.dof_jacobian = self.rows.jacobian[self.rows.bilateral :]

    def _set_couplings(self) -> None:
        self.coupling_coefficients = np.zeros((len(self.builder.couplings), len(self.dofs)))
        self.coupling_offset = np.zeros(len(self.builder.couplings))
        self.coupling_eta = np.zeros(len(self.builder.couplings))
        dof_eta = self.rows.eta[self.rows.bilateral :]
        for k, coupling in enumerate(self.builder.couplings):
            for dof, coefficient in coupling.terms:
                self.coupling_coefficients[k, dof] += coefficient
            initial = self.coupling_coefficients[k] @ self.joint_q
            self.coupling_offset[k] = initial if coupling.offset is None else coupling.offset
            self.coupling_eta[k] = min(dof_eta[dof] for dof, _ in coupling.terms)

    def world_inertia(self) -> np.ndarray:
        """(B, 3, 3) about the centres of mass, world axes."""
        return self.rotation @ self.inertia @ self.rotation.transpose(0, 2, 1)

    def mass_matrix(self) -> np.ndarray:
        """(6 B + S, 6 B + S), block diagonal, without armature."""
        matrix = np.zeros((self.rows.width, self.rows.width))
        for b, inertia in enumerate(self.world_inertia()):
            matrix[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = self.mass[b] * np.eye(3)
            matrix[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = inertia
        tail = 6 * len(self.mass)
        matrix[tail:, tail:] = np.diag(self.shaft_inertia)
        return matrix

    # ---- step ----------------------------------------------------------------------------------------------------

    def step(
        self,
        joint_force: npt.ArrayLike | None = None,
        target_q: npt.ArrayLike | None = None,
        target_qd: npt.ArrayLike | None = None,
        body_force: npt.ArrayLike | None = None,
        body_torque: npt.ArrayLike | None = None,
    ) -> None:
        """One step of `dt`; absent controls are zeros.

        Args:
            joint_force: (D,) effort along each degree of freedom [N or N·m].
            body_force: (B, 3) at the centres of mass, world frame [N].
            body_torque: (B, 3) world frame [N·m].
        """
        zeros = np.zeros(len(self.dofs))
        controls = (joint_force, target_q, target_qd)
        inputs = self._inputs(*(zeros if a is None else np.asarray(a, float) for a in controls))
        gain, start = self._implicit(inputs)
        mass = self.mass_matrix()
        jd = self.dof_jacobian
        mass_implicit = mass + jd.T @ gain @ jd
        free = np.linalg.solve(mass_implicit, mass @ self._free_velocity(body_force, body_torque) + jd.T @ start)
        jacobian, bias = self._bilateral_rows(inputs)
        bilateral = Bilateral(mass_implicit, jacobian, self.rank)
        boxes = self._boxes(inputs)
        smooth = bilateral.project(free, bias)
        columns = bilateral.compliance(boxes.jacobian)
        delassus = boxes.jacobian @ columns + np.diag(boxes.compliance)
        self.box_impulse = solve_boxes(delassus, boxes.jacobian @ smooth + boxes.bias, boxes.low, boxes.high)
        velocity = bilateral.project(smooth + columns @ self.box_impulse, bias)
        pushed = np.linalg.solve(mass_implicit, boxes.jacobian.T @ self.box_impulse)
        impulses = bilateral.impulses(velocity - free - pushed)
        self._record(impulses, gain, start, velocity, boxes)
        self._advance(velocity)

    def _inputs(self, force: np.ndarray, target_q: np.ndarray, target_qd: np.ndarray) -> list[DofInput]:
        eta = self.rows.eta[self.rows.bilateral :]
        before = self.dof_jacobian @ self.velocity
        columns = (self.joint_q, self.joint_qd, before, force, target_q, target_qd, eta)
        return [DofInput(*values) for values in zip(*columns, strict=True)]

    def _free_velocity(self, body_force: npt.ArrayLike | None, body_torque: npt.ArrayLike | None) -> np.ndarray:
        h, count = self.dt, len(self.mass)
        force = np.zeros((count, 3)) if body_force is None else np.asarray(body_force, float)
        torque = np.zeros((count, 3)) if body_torque is None else np.asarray(body_torque, float)
        v = self.v + h * (self.builder.gravity + force / self.mass[:, None])
        omega = np.zeros_like(self.omega)
        for b, (r, inertia) in enumerate(zip(self.rotation, self.inertia, strict=True)):
            if b in self.jointed and h * np.linalg.norm(self.omega[b]) <= 0.15:
                # what a jointed body would do alone has a component along its joints: extrapolate by half a step
                middle = r.T @ (1.5 * self.omega[b] - 0.5 * self.omega_last[b])
                rate = r.T @ self.omega[b] - h * np.linalg.solve(inertia, np.cross(middle, inertia @ middle))
            else:
                rate = gyroscopic(inertia, r.T @ self.omega[b], h)
            omega[b] = r @ (rate + h * np.linalg.solve(inertia, r.T @ torque[b]))
        return np.concatenate([np.hstack([v, omega]).reshape(-1), self.shaft_qd])

    def _bilateral_rows(self, inputs: list[DofInput]) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian and bias of joint rows, prescribed degrees of freedom and couplings, in that order."""
        h, n = self.dt, self.rows.bilateral
        eta = self.rows.eta[:n]
        bend = self._bend()
        bias = np.clip(self.rows.value[:n] / h - (1.0 - CURVATURE_SHARE) * bend, -eta, eta) + bend
        speeds = enumerate(
            prescribed_speed(dof, s, self.time, self.rule) for dof, s in zip(self.dofs, inputs, strict=True)
        )
        wanted = {i: -speed for i, speed in speeds if speed is not None}
        self.prescribed = list(wanted)
        c = self.coupling_coefficients
        error = (c @ self.joint_q - self.coupling_offset) / h
        jacobian = np.vstack([self.rows.jacobian[:n], self.dof_jacobian[self.prescribed], c @ self.dof_jacobian])
        return jacobian, np.concatenate(
            [bias, list(wanted.values()), np.clip(error, -self.coupling_eta, self.coupling_eta)]
        )

    def _bend(self) -> np.ndarray:
        """h/2 times the second derivative of each row's value along a motion of the present velocities, by differences
        of the values themselves; it fades out where a body of the joint turns by more than `FAST_STEP`.
        """
        n, h = self.rows.bilateral, self.dt
        instant = 1e-4 / (1.0 + np.abs(np.concatenate([self.v, self.omega])).max(initial=0.0))
        values = []
        for t in (-instant, 0.0, instant):
            turned = quat_product(quat_exp(t * self.omega), self.rot)
            self.rows.evaluate(self.x + t * self.v, matrices(turned))
            values.append(self.rows.value[:n].copy())
        self._evaluate()
        curvature = (values[0] - 2.0 * values[1] + values[2]) / instant**2
        turns = np.append(h * np.linalg.norm(self.omega, axis=1), 0.0)  # the world, -1, does not turn
        joint = self.rows.joint[:n]
        turn = np.maximum(turns[self.rows.parent[joint]], turns[self.rows.child[joint]])
        return 0.5 * h * curvature / (1.0 + (turn / FAST_STEP) ** 4)

    def _boxes(self, inputs: list[DofInput]) -> Boxes:
        jacobian, rest, self.box_dof = [], [], []
        drive_terms_of: dict[int, tuple[float, float]] = {}
        for first in self.rotations:
            three = slice(first, first + 3)
            gain, start = drive_terms(self.dofs[three], inputs[three], self.rule, bounded=True)
            drive_terms_of |= {first + k: (float(gain[k, k]), float(start[k])) for k in range(3)}
        for i, (dof, s) in enumerate(zip(self.dofs, inputs, strict=True)):
            for sign, *row in box_constraints(dof, s, self.rule, drive_terms_of.get(i)):
                jacobian.append(sign * self.dof_jacobian[i])
                rest.append(row)
                self.box_dof.append(i)
        bias, compliance, low, high = np.array(rest, float).reshape(-1, 4).T
        return Boxes(np.array(jacobian).reshape(-1, self.rows.width), bias, compliance, low, high)

    def _implicit(self, inputs: list[DofInput]) -> tuple[np.ndarray, np.ndarray]:
        """(G, g) of the impulses g - G u along all degrees of freedom."""
        terms = [implicit_terms(dof, s, self.rule) for dof, s in zip(self.dofs, inputs, strict=True)]
        gain, start = np.diag([term[0] for term in terms]), np.array([term[1] for term in terms])
        for first in self.rotations:
            three = slice(first, first + 3)
            gain[three, three], start[three] = rotation_terms(self.dofs[three], inputs[three], self.rule)
        return gain, start

    def _record(
        self, impulses: np.ndarray, gain: np.ndarray, start: np.ndarray, velocity: np.ndarray, boxes: Boxes
    ) -> None:
        n, m = self.rows.bilateral, self.rows.bilateral + len(self.prescribed)
        self.bilateral_impulse, self.coupling_impulse = impulses[:n], impulses[m:]
        self.prescribed_effort = np.zeros(len(self.dofs))
        self.prescribed_effort[self.prescribed] = impulses[n:m] / self.dt
        self.dof_impulse = start - gain @ self.dof_jacobian @ velocity
        self.box_speed = boxes.jacobian @ velocity + boxes.bias + boxes.compliance * self.box_impulse
        side1 = self.rows.side1[:n] * self.bilateral_impulse[:, None] / self.dt
        arm = self.rows.anchor1 - self.rows.center1
        self._reactions = []
        for j in range(len(self.rows.joints)):
            total = side1[self.rows.joint[:n] == j].sum(axis=0)
            self._reactions.append((total[:3], total[3:] - np.cross(arm[j], total[:3])))

    def _advance(self, velocity: np.ndarray) -> None:
        h = self.dt
        predicted = self.joint_q + h * (self.dof_jacobian @ velocity)
        bodies = velocity[: 6 * len(self.mass)].reshape(-1, 6)
        self.x = self.x + h * bodies[:, :3]
        self.rot = quat_product(quat_exp(h * bodies[:, 3:]), self.rot)
        self.rot /= np.linalg.norm(self.rot, axis=1, keepdims=True)
        self.shaft_q = self.shaft_q + h * velocity[6 * len(self.mass) :]
        rates = self.dof_jacobian @ velocity  # in the frames of the step's start, as the step solved for them
        self._evaluate()
        self.omega_last = self.omega.copy()
        self.set_velocity(velocity)
        self.joint_qd = rates
        self.joint_q = self.rows.coordinates(self.shaft_q, predicted)
        self.time += h

    # ---- results -------------------------------------------------------------------------------------------------

    def reaction(self, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and torque [N·m] of the element's bilateral rows on the child at its anchor, world frame.

        Of the step just made, at its starting poses. Where rows are redundant: the least-norm share.
        """
        force, torque = self._reactions[joint]
        return force.copy(), torque.copy()

    @property
    def mobility(self) -> int:
        """Degrees of freedom that the bilateral rows leave, by the rank in use."""
        return self.rows.width - (self.rank or 0)

    def violation(self) -> float:
        """Largest |C| over the joint rows at the current poses [m, or rad-like]."""
        return float(np.max(np.abs(self.rows.value[: self.rows.bilateral]), initial=0.0))

    def energy(self) -> float:
        """Kinetic (armature included), gravity, springs and preloads [J]."""
        w = np.einsum("bij,bj->bi", self.world_inertia(), self.omega)
        total = 0.5 * np.sum(self.mass[:, None] * self.v**2) + 0.5 * np.sum(self.omega * w)
        total += 0.5 * self.shaft_inertia @ self.shaft_qd**2 - np.sum(self.mass * (self.x @ self.builder.gravity))
        stretch, moved = self.joint_q - [dof.rest for dof in self.dofs], self.joint_q.copy()
        for first in self.rotations:
            three = slice(first, first + 3)
            rest = np.array([dof.rest for dof in self.dofs[three]])
            stretch[three] = moved[three] = relative_rotation(self.joint_q[three], rest)
        for dof, x, q, qd in zip(self.dofs, stretch, moved, self.joint_qd, strict=True):
            total += 0.5 * dof.armature * qd**2 - dof.preload * q
            if dof.spring_table is None:
                total += 0.5 * dof.stiffness * x**2
            else:
                total += table_integral(dof.spring_table, x)
        return float(total)

    def linear_momentum(self) -> np.ndarray:
        """[kg·m/s], world frame."""
        return np.sum(self.mass[:, None] * self.v, axis=0)

    def angular_momentum(self, about: np.ndarray | tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
        """[kg·m²/s] about a world point."""
        spin = np.einsum("bij,bj->bi", self.world_inertia(), self.omega)
        return np.sum(spin + self.mass[:, None] * np.cross(self.x - np.asarray(about), self.v), axis=0)
