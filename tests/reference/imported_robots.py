"""Oracles for importers: MuJoCo's own reading of a URDF, and measurements of an imported model in our simulation."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.importers.imported import Imported

Array = npt.NDArray[np.float64]

etree: Any = importlib.import_module("lxml.etree")  # it has no types

ROBOTS = Path(__file__).resolve().parents[2] / "../shared/reference/robots"
"""Published model files, which are not part of the project."""


@dataclasses.dataclass(frozen=True)
class ArmLink:
    """A link of a random arm, on a hinge through its frame's origin.

    Attributes:
        name: of the link; its joint is "j" and the number.
        offset: of its frame in the parent's [m].
        local: rotation of its frame in the parent's.
        axis: of its hinge, in its frame.
        mass: [kg].
        centre: of mass, in its frame [m].
        inertia: about the centre, in its axes [kg m2].
        place, turn: of its frame in the world, where all angles are 0.
    """

    name: str
    offset: Array
    local: Rotation
    axis: Array
    mass: float
    centre: Array
    inertia: Array
    place: Array
    turn: Array


def random_arm(count: int = 5, seed: int = 3) -> tuple[list[ArmLink], str]:
    """A serial arm of random numbers, and its URDF: for readers of other formats."""
    rng = np.random.default_rng(seed)
    links: list[ArmLink] = []
    urdf = ['<robot name="arm"><link name="base"/>']
    turn, place = np.eye(3), np.zeros(3)
    for number in range(1, count + 1):
        local = Rotation.from_rotvec(rng.normal(size=3))
        offset, axis, centre = rng.uniform(-0.3, 0.3, 3), rng.normal(size=3), rng.uniform(-0.1, 0.1, 3)
        axis /= np.linalg.norm(axis)
        points = rng.normal(size=(6, 3)) * 0.1
        points -= points.mean(axis=0)
        mass = float(rng.uniform(0.5, 3.0))
        inertia = mass / 6 * sum((np.dot(p, p) * np.eye(3) - np.outer(p, p) for p in points), np.zeros((3, 3)))
        place, turn = place + turn @ offset, turn @ local.as_matrix()
        links.append(ArmLink(f"link{number}", offset, local, axis, mass, centre, inertia, place, turn))
        entries = {f"i{a}{b}": float(inertia[i, j]) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j}
        urdf.append(
            f'<link name="link{number}"><inertial><origin xyz="{_text(centre)}"/><mass value="{mass!r}"/>'
            f"<inertia {' '.join(f'{key}={chr(34)}{value!r}{chr(34)}' for key, value in entries.items())}/></inertial>"
            f'</link><joint name="j{number}" type="continuous">'
            f'<origin xyz="{_text(offset)}" rpy="{_text(local.as_euler("xyz"))}"/>'
            f'<parent link="{"base" if number == 1 else f"link{number - 1}"}"/><child link="link{number}"/>'
            f'<axis xyz="{_text(axis)}"/></joint>'
        )
    return links, "".join([*urdf, "</robot>"])


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def mujoco_urdf(text: bytes, base: str) -> mujoco.MjModel:
    """MuJoCo's model of a URDF: geometry taken out, no link fused, the root on a joint of its own."""
    robot = etree.fromstring(text, etree.XMLParser(remove_comments=True))
    for part in [*robot.iter("visual"), *robot.iter("collision"), *robot.findall("transmission")]:
        part.getparent().remove(part)
    links = [link.get("name") for link in robot.findall("link")]
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}
    (root,) = (name for name in links if name not in children)
    etree.SubElement(robot, "link", name="world")
    joint = etree.SubElement(robot, "joint", name="the_base", type=base)
    etree.SubElement(joint, "parent", link="world")
    etree.SubElement(joint, "child", link=root)
    settings = etree.SubElement(robot, "mujoco")
    etree.SubElement(settings, "compiler", fusestatic="false", balanceinertia="false")
    spec = mujoco.MjSpec.from_string(etree.tostring(robot).decode())
    spec.option.gravity = (0.0, 0.0, 0.0)
    return spec.compile()


def without_geometry(text: bytes) -> bytes:
    """A URDF in which nothing touches."""
    robot = etree.fromstring(text)
    for part in [*robot.iter("visual"), *robot.iter("collision")]:
        part.getparent().remove(part)
    return etree.tostring(robot)


def random_positions(model: mujoco.MjModel, count: int, seed: int) -> Array:
    """(count, nq) positions within limits, rounded to float32, of free joints and single coordinates."""
    rng = np.random.default_rng(seed)
    qpos = np.zeros((count, model.nq))
    for joint in range(model.njnt):
        at = model.jnt_qposadr[joint]
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            qpos[:, at : at + 3] = rng.uniform(-2.0, 2.0, (count, 3))
            quaternion = rng.normal(size=(count, 4))
            qpos[:, at + 3 : at + 7] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
        else:
            low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-2.0, 2.0)
            qpos[:, at] = rng.uniform(low + 0.05 * (high - low), high - 0.05 * (high - low), count)
    return qpos.astype(np.float32).astype(np.float64)


def column_order(model: mujoco.MjModel, names: list[str]) -> tuple[list[int], list[int]]:
    """MuJoCo's columns of qpos and of qvel, for joints in the order of names."""
    widths = {int(mujoco.mjtJoint.mjJNT_FREE): (7, 6), int(mujoco.mjtJoint.mjJNT_BALL): (4, 3)}
    positions: list[int] = []
    rates: list[int] = []
    for name in names:
        joint = model.joint(name).id
        width, speed = widths.get(int(model.jnt_type[joint]), (1, 1))
        positions += range(model.jnt_qposadr[joint], model.jnt_qposadr[joint] + width)
        rates += range(model.jnt_dofadr[joint], model.jnt_dofadr[joint] + speed)
    return positions, rates


def inverse_mass(imported: Imported, qpos: Array, dt: float = 1e-3) -> Array:
    """(nv, nv) in the file's coordinates: rates after a step without gravity under a unit effort in each world."""
    imported.builder.gravity = np.zeros(3)
    count = imported.coordinates.rate_count
    sim = sw.Simulation(imported.builder.finalize(count, "cpu"), dt)
    q = imported.q_from(np.tile(qpos, (count, 1)))
    sim.set_joint_state(None, q, None)
    # rates are orthogonal images of the file's, so that efforts turn like rates
    sim.control.joint_force.assign(imported.qd_from(np.eye(count), np.tile(qpos, (count, 1))))
    sim.step()
    return imported.qvel_from(sim.state.joint_qd.numpy(), np.tile(qpos, (count, 1))).T / dt


def energy_norm_error(found: Array, mass: Array) -> float:
    """Largest relative error of an inverse mass matrix in the norm of kinetic energy."""
    lower = np.linalg.cholesky(mass)
    return float(np.abs(np.linalg.eigvalsh(lower.T @ (0.5 * (found + found.T)) @ lower) - 1.0).max())


def full_mass(model: mujoco.MjModel, qpos: Array) -> Array:
    """(nv, nv) MuJoCo's mass matrix."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    dense = np.zeros((model.nv, model.nv))
    # products with unit vectors: releases of MuJoCo store the matrix in different ways
    for index in range(model.nv):
        mujoco.mj_mulM(model, data, dense[index], np.eye(model.nv)[index])
    return dense


def link_poses(imported: Imported, qpos: Array) -> dict[str, tuple[Array, Array]]:
    """Name -> positions (n, 3) and rotation matrices (n, 3, 3) of every frame in n worlds."""
    sim = sw.Simulation(imported.builder.finalize(len(qpos), "cpu"), 1e-3)
    sim.set_joint_state(None, imported.q_from(qpos), None)
    origin, turned = sim.state.body_x.numpy(), sim.state.body_q.numpy()[..., 3:].astype(np.float64)
    found: dict[str, tuple[Any, Any]] = {}
    for name, frame in imported.frames.items():
        turn, place = Rotation.identity(len(qpos)), np.zeros((len(qpos), 3))
        if frame.body >= 0:
            turn, place = Rotation(turned[:, frame.body]), origin[:, frame.body]
        found[name] = place + turn.apply(frame.pose.position), (turn * Rotation(frame.pose.rotation)).as_matrix()
    return found
