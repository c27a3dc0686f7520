"""Energy and power of a vehicle in float64 NumPy, from its description's builder and the states of its bodies."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from simwarp.core.types import JointType
from simwarp.model.builder import ModelBuilder
from tests.reference.step_rows import matrices


@dataclasses.dataclass
class Sample:
    """Bodies and shafts at one time: positions of record in float64, velocities of float32."""

    x: np.ndarray
    rotation: np.ndarray
    v: np.ndarray
    omega: np.ndarray
    joint_qd: np.ndarray


def sample(sim: Any, world: int = 0) -> Sample:
    """The present state of a world."""
    state = sim.state
    return Sample(
        state.body_x.numpy()[world].copy(),
        matrices(state.body_rot.numpy()[world]),
        state.body_v.numpy()[world].astype(float),
        state.body_omega.numpy()[world].astype(float),
        state.joint_qd.numpy()[world].astype(float),
    )


class Ledger:
    """What a builder's mechanism stores and dissipates."""

    def __init__(self, builder: ModelBuilder) -> None:
        self.gravity = np.asarray(builder.gravity, dtype=float)
        self.mass = np.array([body.mass for body in builder.bodies])
        self.inertia = np.array([body.inertia for body in builder.bodies])
        self.lines = [joint for joint in builder.joints if joint.type == JointType.DISTANCE]
        self.shafts = [
            (builder.dof_start(index), joint.inertia)
            for index, joint in enumerate(builder.joints)
            if joint.type == JointType.SHAFT
        ]
        self.viscous = [coupling for coupling in builder.couplings if coupling.damping > 0.0]
        dofs = [line.dofs[0] for line in self.lines]
        self.linear = all(dof.spring_table is None and dof.damper_table is None for dof in dofs)

    def lengths(self, now: Sample) -> tuple[np.ndarray, np.ndarray]:
        """Length [m] and rate [m/s] of every spring."""
        found = []
        for line in self.lines:
            arms = [
                now.rotation[body] @ frame.position
                for body, frame in ((line.parent, line.frame0), (line.child, line.frame1))
            ]
            ends = [now.x[body] + arm for body, arm in zip((line.parent, line.child), arms, strict=True)]
            speeds = [
                now.v[body] + np.cross(now.omega[body], arm)
                for body, arm in zip((line.parent, line.child), arms, strict=True)
            ]
            apart = ends[1] - ends[0]
            length = np.linalg.norm(apart)
            found.append((length, apart @ (speeds[1] - speeds[0]) / length))
        lengths, rates = np.array(found).reshape(-1, 2).T
        return lengths, rates

    def stored(self, now: Sample) -> float:
        """Kinetic energy of bodies and shafts, of weights and of springs [J]."""
        assert self.linear, "tables store and dissipate what is not written here"
        moving = 0.5 * self.mass @ np.sum(now.v**2, axis=1)
        local = np.einsum("bji,bj->bi", now.rotation, now.omega)
        turning = 0.5 * np.einsum("bi,bij,bj->", local, self.inertia, local)
        turning += sum(0.5 * inertia * now.joint_qd[dof] ** 2 for dof, inertia in self.shafts)
        weight = -self.mass @ (now.x @ self.gravity)
        springs = 0.0
        for line, length in zip(self.lines, self.lengths(now)[0], strict=True):
            law = line.dofs[0]
            springs += 0.5 * law.stiffness * (length - law.rest) ** 2 - law.preload * (length - law.rest)
        return float(moving + turning + weight + springs)

    def damping(self, before: Sample, after: Sample, dt: float) -> float:
        """Work of dampers and viscous couplings over a step: force of its end, way of its middle [J]."""
        work = 0.0
        (length, _), (length_after, rate) = self.lengths(before), self.lengths(after)
        for line, way, speed in zip(self.lines, length_after - length, rate, strict=True):
            work -= line.dofs[0].damping * speed * way
        for coupling in self.viscous:
            slip = [sum(value * s.joint_qd[dof] for dof, value in coupling.terms) for s in (before, after)]
            work -= coupling.damping * slip[1] * 0.5 * (slip[0] + slip[1]) * dt
        return float(work)


def tire_work(vehicle: Any, before: Sample, after: Sample, dt: float, world: int = 0) -> float:
    """Of the forces and torques at the wheels' centres that acted over a step [J]."""
    spindles = [side.spindle for side in vehicle.parts.sides]
    force = vehicle.tires.force_w.numpy()[world].astype(float)
    torque = vehicle.tires.torque_w.numpy()[world].astype(float)
    v = 0.5 * (before.v[spindles] + after.v[spindles])
    omega = 0.5 * (before.omega[spindles] + after.omega[spindles])
    return float(dt * (np.sum(force * v) + np.sum(torque * omega)))


def drag_work(vehicle: Any, before: Sample, after: Sample, dt: float) -> float:
    """0.5 density · area · coefficient · v² against the chassis' motion [J]."""
    chassis, spec = vehicle.parts.chassis, vehicle.parts.spec.chassis
    factor = 0.5 * spec.air_density * spec.drag_coefficient * spec.drag_area
    v = before.v[chassis]
    return float(-factor * np.linalg.norm(v) * v @ (0.5 * (v + after.v[chassis])) * dt)


def shaft_work(sim: Any, before: Sample, after: Sample, dt: float, world: int = 0) -> float:
    """Of what engine and converter put on the coordinates [J]."""
    effort = sim.control.element_joint_force.numpy()[world].astype(float)
    return float(dt * effort @ (0.5 * (before.joint_qd + after.joint_qd)))


def body_momenta(ledger: Ledger, now: Sample) -> tuple[np.ndarray, np.ndarray]:
    """Linear [N·s] and angular momentum about the common centre of mass [N·m·s], of the bodies."""
    linear = ledger.mass @ now.v
    center = ledger.mass @ now.x / ledger.mass.sum()
    spins = np.einsum("bij,bjk,blk,bl->bi", now.rotation, ledger.inertia, now.rotation, now.omega)
    orbital = np.cross(now.x - center, ledger.mass[:, None] * now.v)
    return linear, (spins + orbital).sum(axis=0)
