"""The float64 reference of a step with contacts: `ReferenceStep` with contact rows on top, one world, dense algebra.

Contacts are found in closed form: spheres, boxes and capsules on planes, spheres on spheres. A contact has two points,
one on each surface; the normal goes from the shape with the smaller index to the other one. Equations: SOLVER 1 and 3.
"""

from __future__ import annotations

import dataclasses
import itertools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import WORLD, FrictionRule, JointType, Material, PairRule, ShapeType
from simwarp.model.builder import ModelBuilder
from simwarp.model.specifications import ShapeSpec
from tests.reference.contact_solve import Cones, solve_cones
from tests.reference.step import ReferenceStep
from tests.reference.step_solve import Bilateral


@dataclasses.dataclass
class Touch:
    """One contact: its shapes, the normal from shape 0 to shape 1, the gap and the points on both surfaces (world)."""

    shape0: int
    shape1: int
    normal: np.ndarray
    gap: float
    point0: np.ndarray
    point1: np.ndarray


COMBINED: dict[FrictionRule, Callable[[float, float], float]] = {
    FrictionRule.MIN: min, FrictionRule.MAX: max, FrictionRule.MEAN: lambda a, b: (a + b) / 2.0,
    FrictionRule.PRODUCT: operator.mul,
}  # fmt: skip


def mixed(a: Material, b: Material, rule: FrictionRule = FrictionRule.MIN) -> Material:
    """What two materials make of a contact: friction of the one of higher priority or by the rule, of levers never
    the product; the smaller of everything else, the sum of the compliances.
    """
    least: dict[str, Any] = {
        field: min(getattr(a, field), getattr(b, field)) for field in ("restitution", "cohesion", "damping")
    }
    frictions: dict[str, Any] = {}
    for field in ("friction", "rolling_friction", "spinning_friction"):
        combine = COMBINED[rule] if field == "friction" or rule != FrictionRule.PRODUCT else min
        frictions[field] = combine(getattr(a, field), getattr(b, field))
        if a.priority != b.priority:
            frictions[field] = getattr(a if a.priority > b.priority else b, field)
    return Material(compliance=a.compliance + b.compliance, **least, **frictions)


def contact_bias(
    m: Material, gap: float, before: float, free: float, h: float, recovery: float, bounce: float
) -> tuple[float, float]:
    """(bias of the normal row, what its diagonal gains) for normal speed `before` at the step's start and `free`
    after a step without contacts.
    """
    rebound = m.restitution * before
    if rebound < -bounce and gap + h * min(before, free) < 0.0:
        return rebound, 0.0
    if m.compliance > 0.0:
        return gap / (h + m.damping), m.compliance / (h * (h + m.damping))
    return max(gap / h, -recovery), 0.0


def tangents(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across the normal; cones are round, so any do."""
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


class ContactReference(ReferenceStep):
    """One world with shapes, stepped in float64.

    After a step: `touches`, `contact_impulse` (contacts, 6) along n, t1, t2 and about t1, t2, n,
    `contact_force_on_body` (B, 3) [N], `solve_residual` [m/s].

    Args:
        friction_law, max_depenetration_velocity, restitution_threshold: as `SolverOptions`.
        envelope: contacts nearer than this at the start of the step, or at its end if nothing touched, take part [m].
    """

    def __init__(
        self, builder: ModelBuilder, dt: float, *, friction_law: str = "exact", max_depenetration_velocity: float = 0.6,
        restitution_threshold: float = 0.15, envelope: float = 1e-3, rank: int | str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(builder, dt, rank=rank)
        self.exact, self.envelope = friction_law == "exact", envelope
        self.recovery, self.bounce = max_depenetration_velocity, restitution_threshold
        self.solve_residual = 0.0
        self.touches: list[Touch] = []
        self.contact_impulse = np.zeros((0, 6))
        self.tied = {
            frozenset((j.parent, j.child)) for j in builder.joints
            if j.type != JointType.SHAFT and WORLD not in (j.parent, j.child)
        } | {frozenset(pair) for pair in builder.excluded_bodies}  # fmt: skip

    # ---- geometry ------------------------------------------------------------------------------------------------

    def frame_of(self, shape: ShapeSpec) -> tuple[np.ndarray, np.ndarray]:
        """Origin and xyzw rotation of a shape in the world."""
        if shape.body == WORLD:
            return shape.pose.position, shape.pose.rotation
        at, turn = self.x[shape.body], self.rot[shape.body]
        return at + rotate(turn, shape.pose.position), quat_multiply(turn, shape.pose.rotation)

    def _balls(self, shape: ShapeSpec) -> list[tuple[np.ndarray, float]]:
        """Centres and radii of the balls that a plane meets of a convex shape."""
        at, turn = self.frame_of(shape)
        if shape.type == ShapeType.SPHERE:
            return [(at, shape.size[0] + shape.margin)]
        if shape.type == ShapeType.CAPSULE:
            ends = (np.array([0.0, 0.0, s * shape.size[1]]) for s in (-1.0, 1.0))
            return [(at + rotate(turn, end), shape.size[0] + shape.margin) for end in ends]
        if shape.type == ShapeType.BOX:
            corners = itertools.product((-1.0, 1.0), repeat=3)
            return [(at + rotate(turn, np.array(corner) * shape.size), shape.margin) for corner in corners]
        raise NotImplementedError(shape.type.name)

    def _pair(self, i: int, j: int) -> list[Touch]:
        a, b = self.builder.shapes[i], self.builder.shapes[j]
        found = []
        if b.type == ShapeType.PLANE:
            return [Touch(i, j, -t.normal, t.gap, t.point1, t.point0) for t in self._pair(j, i)]
        if a.type == ShapeType.PLANE:
            at, turn = self.frame_of(a)
            normal = rotate(turn, np.array([0.0, 0.0, 1.0]))
            for centre, radius in self._balls(b):
                height = float((centre - at) @ normal) - a.margin
                surface = centre - height * normal
                found.append(Touch(i, j, normal, height - radius, surface, centre - radius * normal))
            return found
        span = sum(float(np.linalg.norm(shape.size)) + shape.margin for shape in (a, b))
        if np.linalg.norm(self.frame_of(a)[0] - self.frame_of(b)[0]) > span:
            return []
        (centre0, radius0), (centre1, radius1) = self._balls(a)[0], self._balls(b)[0]
        if a.type != ShapeType.SPHERE or b.type != ShapeType.SPHERE:
            raise NotImplementedError(f"{a.type.name} on {b.type.name}")
        apart = centre1 - centre0
        distance = float(np.linalg.norm(apart))
        normal = apart / distance
        gap = distance - radius0 - radius1
        return [Touch(i, j, normal, gap, centre0 + radius0 * normal, centre1 - radius1 * normal)]

    def find_contacts(self, velocity: np.ndarray) -> list[Touch]:
        """All contacts that take part; `velocity` is that of the step without contacts."""
        found: list[Touch] = []
        for i, j in itertools.combinations(range(len(self.builder.shapes)), 2):
            if self.may_meet(i, j):
                found += [touch for touch in self._pair(i, j) if self._takes_part(touch, velocity)]
        return found

    def may_meet(self, i: int, j: int) -> bool:
        """Whether two shapes, the smaller index first, may have contacts."""
        a, b = self.builder.shapes[i], self.builder.shapes[j]
        if (i, j) in self.builder.given_pairs:
            return True
        sides = [a.group & b.mask != 0, b.group & a.mask != 0]
        allowed = any(sides) if self.builder.pair_rule is PairRule.EITHER else all(sides)
        excluded = (i, j) in self.builder.excluded_shapes or frozenset((a.body, b.body)) in self.tied
        return allowed and not excluded and a.body != b.body

    def _takes_part(self, touch: Touch, velocity: np.ndarray) -> bool:
        speed = 0.0
        for sign, shape, point in ((-1.0, touch.shape0, touch.point0), (1.0, touch.shape1, touch.point1)):
            body = self.builder.shapes[shape].body
            if body != WORLD:
                v, omega = velocity[6 * body : 6 * body + 3], velocity[6 * body + 3 : 6 * body + 6]
                speed += sign * float(touch.normal @ (v + np.cross(omega, point - self.x[body])))
        return touch.gap + self.dt * min(speed, 0.0) < self.envelope

    # ---- rows ----------------------------------------------------------------------------------------------------

    def _contact_rows(
        self, touches: list[Touch], smooth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Cones]:
        """Jacobian, bias and added diagonal of six rows per contact, and their cones (without boxes)."""
        h, width = self.dt, self.rows.width
        jacobian = np.zeros((6 * len(touches), width))
        bias, gain = np.zeros(6 * len(touches)), np.zeros(6 * len(touches))
        slopes, apex = np.zeros((len(touches), 3)), np.zeros(len(touches))
        for k, touch in enumerate(touches):
            shapes = [self.builder.shapes[s] for s in (touch.shape0, touch.shape1)]
            own = self.builder.given_pairs.get((touch.shape0, touch.shape1))
            material = own or mixed(shapes[0].material, shapes[1].material, self.builder.friction_rule)
            t1, t2 = tangents(touch.normal)
            for sign, shape, point in zip((-1.0, 1.0), shapes, (touch.point0, touch.point1), strict=True):
                if shape.body == WORLD:
                    continue
                columns = slice(6 * shape.body, 6 * shape.body + 6)
                arm = point - self.x[shape.body]
                for row, axis in enumerate((touch.normal, t1, t2)):
                    jacobian[6 * k + row, columns] += sign * np.concatenate([axis, np.cross(arm, axis)])
                for row, axis in enumerate((t1, t2, touch.normal)):
                    jacobian[6 * k + 3 + row, columns] += sign * np.concatenate([np.zeros(3), axis])
            before = float(jacobian[6 * k] @ self.velocity)
            free = float(jacobian[6 * k] @ smooth)
            bias[6 * k], gain[6 * k] = contact_bias(material, touch.gap, before, free, h, self.recovery, self.bounce)
            slopes[k] = material.friction, material.rolling_friction, material.spinning_friction
            apex[k] = h * material.cohesion if touch.gap <= 0.1 * self.envelope else 0.0
        empty = np.zeros(0)
        return jacobian, bias, gain, Cones(empty, empty, slopes, apex)

    # ---- step ----------------------------------------------------------------------------------------------------

    def step(  # type: ignore[override]
        self, joint_force: np.ndarray | None = None, body_force: np.ndarray | None = None,
        body_torque: np.ndarray | None = None, target_q: np.ndarray | None = None, target_qd: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        h = self.dt
        zeros = np.zeros(len(self.dofs))
        controls = (joint_force, target_q, target_qd)
        inputs = self._inputs(*(zeros if a is None else np.asarray(a, float) for a in controls))
        gain, start = self._implicit(inputs)
        mass, jd = self.mass_matrix(), self.dof_jacobian
        implicit = mass + jd.T @ gain @ jd
        free = np.linalg.solve(implicit, mass @ self._free_velocity(body_force, body_torque) + jd.T @ start)
        jacobian, bias = self._bilateral_rows(inputs)
        bilateral = Bilateral(implicit, jacobian, self.rank)
        boxes = self._boxes(inputs)
        smooth = bilateral.project(free, bias)
        self.touches = self.find_contacts(smooth)
        contact_jacobian, contact_bias_, softness, cones = self._contact_rows(self.touches, smooth)
        cones.low, cones.high = boxes.low, boxes.high
        rows = np.vstack([boxes.jacobian, contact_jacobian])
        columns = bilateral.compliance(rows)
        delassus = rows @ columns + np.diag(np.concatenate([boxes.compliance, softness]))
        offset = rows @ smooth + np.concatenate([boxes.bias, contact_bias_])
        impulse, self.solve_residual = solve_cones(delassus, offset, cones, exact=self.exact)
        velocity = bilateral.project(smooth + columns @ impulse, bias)
        self.box_impulse = impulse[: len(boxes.low)]
        self.contact_impulse = impulse[len(boxes.low) :].reshape(-1, 6)
        pushed = contact_jacobian.T @ self.contact_impulse.reshape(-1)
        self.contact_force_on_body = pushed[: 6 * len(self.mass)].reshape(-1, 6)[:, :3] / h
        impulses = bilateral.impulses(velocity - free - np.linalg.solve(implicit, rows.T @ impulse))
        self._record(impulses, gain, start, velocity, boxes)
        self._advance(velocity)
