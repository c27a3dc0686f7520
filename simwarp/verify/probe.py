"""A simulation of one world seen from outside: float64 measures from its published state, nothing from its solver."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, JointType
from simwarp.model.builder import ModelBuilder
from simwarp.model.specifications import BodySpec, Frame, JointSpec
from simwarp.simulation.simulation import Simulation, SolverOptions

Array = npt.NDArray[np.float64]


class Probe:
    """Steps one world of a builder and measures it.

    Args:
        builder: the mechanism; its masses and frames are those of the measures.
        dt: of a step [s].
        device: that runs it.
        solver: see `SolverOptions`.
        joint_reactions: record reactions.
    """

    def __init__(
        self, builder: ModelBuilder, dt: float, device: str = "cpu", *, solver: SolverOptions | None = None,
        joint_reactions: bool = False,
    ) -> None:  # fmt: skip
        self.builder = builder
        self.dt = dt
        self.model = builder.finalize(1, device)
        self.sim = Simulation(self.model, dt, solver=solver, joint_reactions=joint_reactions)
        self.mass = np.array([body.mass for body in builder.bodies])
        self.inertia = np.array([body.inertia for body in builder.bodies]).reshape(-1, 3, 3)

    def step(self, count: int = 1) -> None:
        """Takes `count` steps."""
        for _ in range(count):
            self.sim.step()

    def run(self, duration: float) -> None:
        """Steps for `duration` [s]."""
        self.step(round(duration / self.dt))

    # ---- state ---------------------------------------------------------------------------------------------------

    @property
    def x(self) -> Array:
        """(B, 3) centres of mass [m]."""
        return self.sim.state.body_x.numpy()[0].astype(float)

    @property
    def rotation(self) -> Array:
        """(B, 3, 3) orientations."""
        q = self.sim.state.body_rot.numpy()[0].astype(float)
        # R = 1 + 2 w [v]x + 2 [v]x [v]x
        skew = np.zeros((len(q), 3, 3))
        skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0] = q[:, 0], q[:, 1], q[:, 2]
        skew -= skew.transpose(0, 2, 1)
        return np.eye(3) + 2.0 * (q[:, 3, None, None] * skew + skew @ skew)

    @property
    def v(self) -> Array:
        """(B, 3) velocities of the centres of mass [m/s]."""
        return self.sim.state.body_v.numpy()[0].astype(float)

    @property
    def omega(self) -> Array:
        """(B, 3) angular velocities, world axes [rad/s]."""
        return self.sim.state.body_omega.numpy()[0].astype(float)

    @property
    def q(self) -> Array:
        """(dofs,) coordinates of record."""
        return self.sim.state.joint_x.numpy()[0].astype(float)

    @property
    def qd(self) -> Array:
        """(dofs,) rates."""
        return self.sim.state.joint_qd.numpy()[0].astype(float)

    @property
    def body_rates(self) -> Array:
        """(B, 3) angular velocities in body axes [rad/s]."""
        return np.einsum("bji,bj->bi", self.rotation, self.omega)

    @property
    def finite(self) -> bool:
        """True if the world still runs and everything that it publishes is finite."""
        status = int(self.sim.state.world_status.numpy()[0])
        return status == 0 and all(np.isfinite(a).all() for a in (self.x, self.v, self.omega, self.q, self.qd))

    # ---- measures ------------------------------------------------------------------------------------------------

    def kinetic_energy(self) -> float:
        """[J], shafts not counted."""
        rates = self.body_rates
        return float(
            0.5 * np.sum(self.mass * np.sum(self.v**2, axis=1))
            + 0.5 * np.einsum("bi,bij,bj->", rates, self.inertia, rates)
        )

    def potential_energy(self) -> float:
        """[J] of the weights."""
        return float(-np.sum(self.mass[:, None] * self.x * self.builder.gravity))

    def energy(self) -> float:
        """[J], kinetic and of the weights."""
        return self.kinetic_energy() + self.potential_energy()

    def linear_momentum(self) -> Array:
        """[N·s]."""
        return self.mass @ self.v

    def angular_momentum(self) -> Array:
        """[N·m·s] about the world's origin."""
        spin = np.einsum("bij,bjk,bk->bi", self.rotation, self.inertia, self.body_rates)
        return np.sum(self.mass[:, None] * np.cross(self.x, self.v) + spin, axis=0)


CURVATURE_SHARE = 1.0 / 3.0
"""Of a step's curvature that rows ask for beforehand (docs/theory.md)."""

FAST_STEP = 0.3
"""Turn of a body in a step about which the curvature fades out [rad]."""


class HingeRows:
    """The rows of a probe's revolute and spherical joints in float64, each body at its own anchor."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        kinds = (JointType.REVOLUTE, JointType.SPHERICAL, JointType.FIXED)
        self.joints: list[JointSpec] = [joint for joint in probe.builder.joints if joint.type in kinds]
        self.hinged = np.array([joint.type == JointType.REVOLUTE for joint in self.joints])
        self.body0 = np.array([joint.parent for joint in self.joints])
        self.body1 = np.array([joint.child for joint in self.joints])
        self.anchor0 = np.array([joint.frame0.position for joint in self.joints])
        self.anchor1 = np.array([joint.frame1.position for joint in self.joints])
        self.axis0 = np.array([matrix_of(joint.frame0.rotation)[:, 2] for joint in self.joints])
        self.axis1 = np.array([matrix_of(joint.frame1.rotation)[:, 2] for joint in self.joints])

    def _with_world(self, values: Array, of_world: Array) -> Array:
        # WORLD is -1: the last row
        assert WORLD == -1
        return np.concatenate([values, of_world[None]])

    def geometry(self) -> HingeGeometry:
        """Levers, gaps and misalignments at the present poses."""
        probe = self.probe
        x = self._with_world(probe.x, np.zeros(3))
        rotation = self._with_world(probe.rotation, np.eye(3))
        r0 = np.einsum("jik,jk->ji", rotation[self.body0], self.anchor0)
        r1 = np.einsum("jik,jk->ji", rotation[self.body1], self.anchor1)
        z0 = np.einsum("jik,jk->ji", rotation[self.body0], self.axis0)
        z1 = np.einsum("jik,jk->ji", rotation[self.body1], self.axis1)
        gap = (x[self.body1] - x[self.body0]) + (r1 - r0)
        v, omega = self._with_world(probe.v, np.zeros(3)), self._with_world(probe.omega, np.zeros(3))
        w0, w1 = omega[self.body0], omega[self.body1]
        slip = v[self.body1] + np.cross(w1, r1) - v[self.body0] - np.cross(w0, r0)
        bend = np.cross(w1, np.cross(w1, r1)) - np.cross(w0, np.cross(w0, r0) + 2.0 * slip)
        tilting = np.cross(z1, w1) * np.sum(z1 * (w1 - w0), axis=1, keepdims=True)
        return HingeGeometry(
            r0, r1, z0, gap, np.where(self.hinged[:, None], np.cross(z0, z1), 0.0), bend, tilting,
            np.maximum(np.linalg.norm(w0, axis=1), np.linalg.norm(w1, axis=1)),
        )  # fmt: skip

    def speeds(self, at: HingeGeometry, dt: float) -> Array:
        """(J, 2) |J v + C / h + h κ / 6| of the point rows [m/s] and of a hinge's axis rows [rad/s], with the poses and
        the curvature κ of the step's start.
        """
        probe = self.probe
        ahead = (0.5 * CURVATURE_SHARE * dt / (1.0 + (dt * at.rate / FAST_STEP) ** 4))[:, None]
        v, omega = self._with_world(probe.v, np.zeros(3)), self._with_world(probe.omega, np.zeros(3))
        w0, w1 = omega[self.body0], omega[self.body1]
        points = v[self.body1] + np.cross(w1, at.r1) - v[self.body0] - np.cross(w0, at.r0)
        points = points + at.gap / dt + ahead * at.bend
        turn = w1 - w0
        turn = turn - at.z0 * np.sum(turn * at.z0, axis=1, keepdims=True) + at.tilt / dt + ahead * at.tilting
        turn = np.where(self.hinged[:, None], turn, 0.0)
        return np.stack([np.linalg.norm(points, axis=1), np.linalg.norm(turn, axis=1)], axis=1)

    def curvature(self, at: HingeGeometry, dt: float) -> Array:
        """(J,) h²/2 (w0² r0 + w1² r1) [m]: how far a step along the tangent takes two anchors apart."""
        omega = self._with_world(self.probe.omega, np.zeros(3))
        moved = [
            np.sum(omega[body] ** 2, axis=1) * np.linalg.norm(lever, axis=1)
            for body, lever in ((self.body0, at.r0), (self.body1, at.r1))
        ]
        return 0.5 * dt**2 * (moved[0] + moved[1])


@dataclasses.dataclass(frozen=True)
class HingeGeometry:
    """Levers [m] about the centres of mass, axis of body 0, gap [m] between the anchors, tilt [rad] of the axes, the
    curvatures of both [m/s², rad/s²], and the rate of the faster body [rad/s].
    """

    r0: Array
    r1: Array
    z0: Array
    gap: Array
    tilt: Array
    bend: Array
    tilting: Array
    rate: Array


def crossings(values: npt.ArrayLike, dt: float, start: float = 0.0) -> Array:
    """Times [s] at which a sampled quantity changes sign, by linear interpolation."""
    w = np.asarray(values, float)
    i = np.flatnonzero(w[1:] * w[:-1] < 0.0)
    return start + (i + w[i] / (w[i] - w[i + 1])) * dt


def displaced(builder: ModelBuilder, offset: Array) -> ModelBuilder:
    """The same mechanism, all of it moved by `offset` [m]: bodies, and anchors on the world."""
    moved = ModelBuilder(gravity=builder.gravity)
    for body in builder.bodies:
        moved.bodies.append(_moved_body(body, offset))
    for joint in builder.joints:
        frame0 = _moved_frame(joint.frame0, offset) if joint.parent == WORLD else joint.frame0
        frame1 = _moved_frame(joint.frame1, offset) if joint.child == WORLD else joint.frame1
        moved.joints.append(dataclasses.replace(joint, frame0=frame0, frame1=frame1))
    moved.couplings = list(builder.couplings)
    return moved


def _moved_body(body: BodySpec, offset: Array) -> BodySpec:
    return dataclasses.replace(body, pose=body.pose._replace(position=body.pose.position + offset))


def _moved_frame(frame: Frame, offset: Array) -> Frame:
    return dataclasses.replace(frame, position=frame.position + offset)
