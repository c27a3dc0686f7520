"""Measurements of an imported robot against MuJoCo, the oracle: poses, masses, inverse mass, accelerations, swing."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.importers.imported import Imported
from simwarp.model.model import meeting_pairs
from tests.reference.imported_robots import full_mass

Array = npt.NDArray[np.float64]


@dataclasses.dataclass
class Pair:
    """A robot in both engines: ours, and MuJoCo's compiled model of the same file."""

    mine: Imported
    model: Any

    @property
    def data(self) -> Any:
        """New data of MuJoCo."""
        return mujoco.MjData(self.model)

    def random_positions(self, count: int, seed: int, *, reach: float = 0.9) -> Array:
        """(count, nq) positions within limits, or within 1 rad and 0.3 m of the initial ones."""
        rng, model = np.random.default_rng(seed), self.model
        qpos = np.tile(model.qpos0, (count, 1))
        for joint in range(model.njnt):
            first, kind = model.jnt_qposadr[joint], mujoco.mjtJoint(model.jnt_type[joint])
            if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
                if kind == mujoco.mjtJoint.mjJNT_FREE:
                    qpos[:, first : first + 3] += rng.uniform(-0.5, 0.5, (count, 3))
                    first += 3
                turned = Rotation.from_rotvec(rng.uniform(-1.0, 1.0, (count, 3)))
                qpos[:, first : first + 4] = np.roll(turned.as_quat(), 1, axis=-1)
                continue
            width = 0.3 if kind == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
            low, high = model.qpos0[first] - width, model.qpos0[first] + width
            if model.jnt_limited[joint]:
                low, high = model.jnt_range[joint]
                middle, half = 0.5 * (low + high), 0.5 * reach * (high - low)
                low, high = middle - half, middle + half
            qpos[:, first] = rng.uniform(low, high, count)
        return self.closed(qpos) if model.neq else qpos

    def closed(self, qpos: Array) -> Array:
        """Positions near these at which the equality constraints hold, by Newton's method with MuJoCo's rows."""
        model, closed = self.model, []
        for row in qpos:
            data = mujoco.MjData(model)
            data.qpos[:] = model.qpos0 + 0.5 * (row - model.qpos0)
            for _ in range(30):
                mujoco.mj_fwdPosition(model, data)
                rows = equality_rows(model, data)
                violation = data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
                mujoco.mj_integratePos(model, data.qpos, -np.linalg.pinv(rows, rcond=1e-5) @ violation, 1.0)
            assert np.abs(violation).max() < 1e-9
            closed.append(data.qpos.copy())
        return np.array(closed)

    def simulation(self, worlds: int, dt: float, **options: Any) -> sw.Simulation:
        """Ours, in as many worlds."""
        return sw.Simulation(self.mine.builder.finalize(worlds, "cpu"), dt, **options)


def set_positions(pair: Pair, sim: sw.Simulation, qpos: Array, qvel: Array | None = None) -> None:
    """Bring all worlds into positions and rates of the file."""
    rates = np.zeros((len(qpos), pair.model.nv)) if qvel is None else qvel
    mask = np.ones(len(qpos), bool)
    sim.set_joint_state(mask, pair.mine.q_from(qpos), pair.mine.qd_from(rates, qpos))


def pose_errors(pair: Pair, count: int = 64, seed: int = 0) -> tuple[float, float]:
    """Largest errors of body origins [m] and of their orientations [rad] in random positions."""
    qpos = pair.random_positions(count, seed)
    sim = pair.simulation(count, 1e-3)
    set_positions(pair, sim, qpos)
    place, turned = sim.state.body_x.numpy(), sim.state.body_rot.numpy()
    data, worst = pair.data, np.zeros(2)
    for world in range(count):
        data.qpos[:] = qpos[world]
        mujoco.mj_kinematics(pair.model, data)
        for body in range(1, pair.model.nbody):
            name = pair.model.body(body).name or f"body{body}"
            frame = pair.mine.frames[name]
            if frame.body < 0:
                origin, rotation = frame.pose.position, Rotation(frame.pose.rotation)
            else:
                own = Rotation(turned[world, frame.body])
                origin = place[world, frame.body] + own.apply(frame.pose.position)
                rotation = own * Rotation(frame.pose.rotation)
            expected = Rotation(np.roll(data.xquat[body], -1))
            worst = np.maximum(worst, [np.abs(origin - data.xpos[body]).max(), (expected.inv() * rotation).magnitude()])
    return float(worst[0]), float(worst[1])


def mass_errors(pair: Pair) -> float:
    """Largest relative error of the mass of a moving body."""
    model, worst = pair.model, 0.0
    for body in range(1, model.nbody):
        if model.body_weldid[body] == body:
            own = [other for other in range(model.nbody) if model.body_weldid[other] == body]
            mine = pair.mine.builder.bodies[pair.mine.bodies[model.body(body).name or f"body{body}"]].mass
            worst = max(worst, abs(mine / model.body_mass[own].sum() - 1.0))
    return worst


def inverse_mass_error(pair: Pair, seed: int = 1) -> float:
    """Error of the inverse mass matrix in the energy norm at a random position: one world for each unit effort.

    Where constraints tie the coordinates, it is that of the motion that they leave.
    """
    model, dt = pair.model, 1e-3
    sim = passive(pair, model.nv + 1, dt)  # the last world has no effort: what corrects the loops is the same in all
    wanted = np.tile(pair.random_positions(1, seed), (model.nv + 1, 1))
    set_positions(pair, sim, wanted)
    qpos = pair.mine.qpos_from(sim.state.joint_q.numpy())[0]  # where loops are closed
    data = pair.data
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    mass = full_mass(model, qpos)
    scale = np.minimum(1.0, 0.01 / (dt * np.diag(np.linalg.inv(mass))))  # so weak that nothing turns in a step
    efforts = np.stack([force_along(pair, unit, qpos) for unit in np.diag(scale)])
    sim.control.joint_force[: model.nv] = efforts.astype(np.float32)
    sim.step()
    found = sim.state.joint_qd.numpy().astype(np.float64)
    rates = (found[:-1] - found[-1]) / (dt * scale[:, None])
    inverse = pair.mine.qvel_from(rates, np.tile(qpos, (model.nv, 1))).T
    root = np.linalg.cholesky(mass)
    rows = equality_rows(model, data) @ np.linalg.inv(root).T
    left = np.eye(model.nv) - np.linalg.pinv(rows, rcond=1e-5) @ rows
    return float(np.abs(root.T @ inverse @ root - left).max())


def equality_rows(model: Any, data: Any) -> Array:
    """(rows, nv) Jacobian of the equality constraints that are active."""
    if data.nefc == 0:
        return np.zeros((0, model.nv))
    dense = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    else:
        dense[:] = data.efc_J.reshape(data.nefc, model.nv)
    return np.asarray(dense[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)])


def acceleration_error(pair: Pair, count: int = 4, seed: int = 2) -> float:
    """Error of `joint_qdd` with gravity and rates up to 2, relative to the largest acceleration of a world."""
    model, dt = pair.model, 1e-5
    qpos = pair.random_positions(count, seed)
    sim = passive(pair, count, dt)
    sim.model.gravity[:] = np.asarray(pair.mine.builder.gravity, np.float32)
    set_positions(pair, sim, qpos)
    qpos = pair.mine.qpos_from(sim.state.joint_q.numpy())
    qvel = np.random.default_rng(seed).uniform(-2.0, 2.0, (count, model.nv))
    set_positions(pair, sim, qpos, qvel)
    qvel = pair.mine.qvel_from(sim.state.joint_qd.numpy(), qpos)
    sim.step()
    found = sim.diagnostics.joint_qdd.numpy().astype(np.float64)
    worst, free = 0.0, without_laws(model)
    for world in range(count):
        data = mujoco.MjData(free)
        data.qpos[:], data.qvel[:] = qpos[world], qvel[world]
        expected = tied_acceleration(free, data)
        ours = pair.mine.qvel_from(found[world], qpos[world])
        worst = max(worst, float(np.abs(ours - expected).max() / max(1.0, np.abs(expected).max())))
    return worst


def tied_acceleration(model: Any, data: Any) -> Array:
    """(nv,) acceleration under rigid equality constraints of constant rows: the free one, projected by Gauss."""
    mujoco.mj_forward(model, data)
    rows = equality_rows(model, data)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    mujoco.mj_forward(model, data)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    root = np.linalg.cholesky(full_mass(model, data.qpos))
    scaled = rows @ np.linalg.inv(root).T
    return np.asarray(data.qacc - np.linalg.solve(root.T, np.linalg.pinv(scaled, rcond=1e-5) @ rows @ data.qacc))


def without_laws(model: Any) -> Any:
    """The model without springs, dampers, friction, stops, contact, actuators; equalities stay."""
    free = copy.deepcopy(model)
    free.jnt_stiffness[:] = 0.0
    free.dof_damping[:] = 0.0
    free.tendon_stiffness[:] = 0.0
    free.tendon_damping[:] = 0.0
    flags = mujoco.mjtDisableBit
    for flag in (flags.mjDSBL_CONTACT, flags.mjDSBL_LIMIT, flags.mjDSBL_FRICTIONLOSS, flags.mjDSBL_ACTUATION):
        free.opt.disableflags |= int(flag)
    return free


def swing_errors(pair: Pair, duration: float = 1.0, seed: int = 3) -> tuple[float, float, float]:
    """A free swing without laws: errors of the last body's centre at steps of 1 and 0.5 ms, and the chain's length.

    Of a robot that floats, or slides, it is seen from its first body: the fall alone is late by g h t / 2 in any such
    scheme.
    """
    model, free = pair.model, without_laws(pair.model)
    free.opt.timestep, free.opt.integrator = 1e-4, int(mujoco.mjtIntegrator.mjINT_RK4)
    qpos = pair.random_positions(1, seed)
    data = mujoco.MjData(free)
    data.qpos[:] = qpos[0]
    for _ in range(round(duration / 1e-4)):
        mujoco.mj_step(free, data)
    last = max(range(1, model.nbody), key=lambda body: depth(model, body))
    errors = []
    for dt in (1e-3, 5e-4):
        sim = passive(pair, 1, dt)
        sim.model.gravity[:] = np.asarray(pair.mine.builder.gravity, np.float32)
        set_positions(pair, sim, qpos)
        for _ in range(round(duration / dt)):
            sim.step()
        end = pair.mine.qpos_from(sim.state.joint_q.numpy())[0]
        errors.append(float(np.linalg.norm(_end_of(model, end, last) - _end_of(model, data.qpos, last))))
    return errors[0], errors[1], chain_length(model, last)


def _end_of(model: Any, qpos: Array, body: int) -> Array:
    """Centre of a body, from the origin of the first one of its chain where that floats [m]."""
    probe = mujoco.MjData(model)
    probe.qpos[:] = qpos
    mujoco.mj_kinematics(model, probe)
    first = int(model.body_rootid[body])
    start = int(model.body_jntadr[first])
    kinds = {mujoco.mjtJoint(kind) for kind in model.jnt_type[start : start + int(model.body_jntnum[first])]}
    floats = bool(kinds & {mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_SLIDE})
    return np.asarray(probe.xipos[body] - (probe.xpos[first] if floats else 0.0))


def depth(model: Any, body: int) -> int:
    """Bodies between one and the world."""
    return 0 if body == 0 else 1 + depth(model, int(model.body_parentid[body]))


def chain_length(model: Any, body: int) -> float:
    """Sum of the offsets from body to body down to one [m], and that of its centre."""
    total = float(np.linalg.norm(model.body_ipos[body]))
    while body > 0 and model.body_parentid[body] > 0:
        total += float(np.linalg.norm(model.body_pos[body]))
        body = int(model.body_parentid[body])
    return max(total, 0.05)


def pairs_of_mujoco(pair: Pair) -> set[tuple[str, str]]:
    """Pairs of geoms that MuJoCo's own filters let through where all of them are made to overlap."""
    model = copy.deepcopy(pair.model)
    model.geom_margin[:] = 1.0e3  # everything is near everything
    model.body_margin[:] = 1.0e3
    model.geom_gap[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    model.geom_type[model.geom_type == mujoco.mjtGeom.mjGEOM_BOX] = mujoco.mjtGeom.mjGEOM_SPHERE  # boxes far apart miss
    model.pair_margin[:] = 1.0e3
    data = mujoco.MjData(model)
    found = set()
    for seed in range(3):  # flat things beside each other meet at one or the other position
        data.qpos[:] = pair.random_positions(1, seed)[0]
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact:
            names = sorted(model.geom(geom).name or f"geom{geom}" for geom in (contact.geom1, contact.geom2))
            found.add((names[0], names[1]))
    return found


def pairs_of_ours(pair: Pair) -> set[tuple[str, str]]:
    """Pairs of shapes that can meet, by name."""
    name_of = {slot: name for name, slots in pair.mine.shapes.items() for slot in slots}
    found = set()
    for low, high in meeting_pairs(pair.mine.builder):
        names = sorted((name_of[low], name_of[high]))
        found.add((names[0], names[1]))
    return found


def force_along(pair: Pair, effort: Array, qpos: Array) -> Array:
    """(dofs,) our generalised force for one of the file: the dual of the rates."""
    columns = np.stack([pair.mine.qvel_from(unit, qpos) for unit in np.eye(pair.mine.coordinates.dof_count)], axis=1)
    return np.asarray(columns.T @ effort)


def passive(pair: Pair, worlds: int, dt: float) -> sw.Simulation:
    """The robot without gravity, springs, dampers, drives, contact, friction and stops; the armature stays."""
    names = (
        "joint_stiffness", "joint_damping", "joint_friction", "drive_stiffness", "drive_damping", "joint_preload",
        "gravity", "shape_enabled",
    )  # fmt: skip
    model = pair.mine.builder.finalize(worlds, "cpu")
    for name in names:
        getattr(model, name).zero_()
    model.joint_limit_lower.fill_(-1e30)
    model.joint_limit_upper.fill_(1e30)
    return sw.Simulation(model, dt, joint_accelerations=True)
