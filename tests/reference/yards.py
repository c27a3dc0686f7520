"""Things that stand far apart on one floor, each busy with contacts of its own, and what belongs to each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

import simwarp as sw
from simwarp.core.types import WORLD, Material, Vec3, pose
from simwarp.model.builder import ModelBuilder

ROUGH = Material(friction=0.4, restitution=0.2)
ROLLS = Material(friction=0.6, rolling_friction=0.01, spinning_friction=0.005)
PARTS = ("slider", "stack", "crash", "arm", "linkage", "ball", "walker")
"""Kinds of things."""


def yard(parts: Sequence[str], *, ordered: bool = True) -> ModelBuilder:
    """A floor with things on it, 10 m apart, each always at its own place.

    Args:
        parts: kinds, of `PARTS`, in the order in which they are built.
        ordered: False: the joints of all come after the bodies of all.
    """
    builder = ModelBuilder()
    builder.add_shape_plane(name="floor", material=ROLLS)
    later: list[Any] = []
    for part in parts:
        joints = BUILD[part](builder, (0.0, 10.0 * PARTS.index(part), 0.0))
        if joints is not None and ordered:
            joints()
        elif joints is not None:
            later.append(joints)
    for joints in later:
        joints()
    return builder


def _box(builder: ModelBuilder, name: str, at: Any, half: Sequence[float], mass: float = 2.0, **motion: Any) -> int:
    # a millimetre of height, and a little turn, so that corners come down one by one
    where = pose(np.add(at, (0.0, 0.0, half[2] + 1e-3)), (0.01, 0.02, 0.0, 1.0))
    return builder.add_solid(name, "box", half, mass=mass, pose=where, material=ROUGH, **motion)


def _slider(builder: ModelBuilder, at: Vec3) -> None:
    _box(builder, "slider", at, (0.2, 0.15, 0.1), velocity=(1.5, 0.4, 0.0), omega=(0.0, 0.0, 2.0))


def _stack(builder: ModelBuilder, at: Vec3) -> None:
    for level in range(3):
        _box(
            builder, f"stack{level}", np.add(at, (0.02 * level, 0.0, 0.402 * level)), (0.2, 0.2, 0.2), omega=(0.3, 0, 0)
        )


def _crash(builder: ModelBuilder, at: Vec3) -> None:
    for side in (-1.0, 1.0):
        _box(
            builder, f"crash{int(side)}", np.add(at, (0.6 * side, 0.05 * side, 0.0)), (0.3, 0.2, 0.15), 3.0 + side,
            velocity=(-3.0 * side, 0.0, 0.0),
        )  # fmt: skip


def _arm(builder: ModelBuilder, at: Vec3) -> Any:
    x, y, z = at
    body = builder.add_body("arm", mass=1.0, inertia=(0.01, 0.1, 0.1), pose=pose((x, y, z + 0.2)))
    builder.add_shape_capsule(body, radius=0.1, half_length=0.2, name="arm", pose=pose((0.3, 0.0, 0.0)), material=ROUGH)
    return lambda: builder.add_joint_revolute(
        "arm_hinge", WORLD, body, axis=(0.0, 1.0, 0.0), anchor=(x - 0.5, y, z + 0.2), friction=0.1, limit=(-0.3, 0.15)
    )


def _linkage(builder: ModelBuilder, at: Vec3) -> Any:
    """A four-bar that drops its base on the floor: rows of a loop, and a motor."""
    x, y, z = at
    centres = [(0.0, 0.0, 0.31), (-0.3, 0.0, 0.51), (0.0, 0.0, 0.76), (0.3, 0.0, 0.56)]
    first = len(builder.bodies)
    for index, centre in enumerate(centres):
        builder.add_body(
            f"bar{index}", mass=4.0 - 0.7 * index, inertia=(0.05, 0.06, 0.04), pose=pose(np.add(at, centre))
        )
    builder.add_shape_sphere(first, radius=0.3, material=ROUGH, name="base")

    def joints() -> None:
        pins = [("crank", 0, 1, -0.3, 0.31), ("pin", 1, 2, -0.3, 0.71), ("rocker", 0, 3, 0.3, 0.31)]
        for name, parent, child, dx, dz in [*pins, ("loop", 2, 3, 0.3, 0.81)]:
            builder.add_joint_revolute(
                name, first + parent, first + child, axis=(0.0, 1.0, 0.0), anchor=(x + dx, y, z + dz),
                friction=0.05 if name == "pin" else 0.0,
            )  # fmt: skip

    return joints


def _ball(builder: ModelBuilder, at: Vec3) -> None:
    builder.add_solid(
        "ball", "sphere", 0.15, mass=1.5, pose=pose(np.add(at, (0.0, 0.0, 0.16))), material=ROLLS,
        velocity=(1.0, 0.0, 0.0), omega=(0.0, 0.0, 3.0),
    )  # fmt: skip


def _walker(builder: ModelBuilder, at: Vec3) -> Any:
    """A tree of three bodies on two feet, with drives of limited effort."""
    x, y, z = at
    torso = _box(builder, "torso", (x, y, z + 0.5), (0.2, 0.15, 0.1), 4.0)
    feet = []
    for side in (-1.0, 1.0):
        foot = builder.add_body(
            f"foot{int(side)}", mass=0.8, inertia=(0.02, 0.02, 0.01), pose=pose((x, y + 0.2 * side, z + 0.25))
        )
        builder.add_shape_capsule(foot, radius=0.08, half_length=0.16, name=f"foot{int(side)}", material=ROUGH)
        feet.append((side, foot))

    def joints() -> None:
        for side, foot in feet:
            builder.add_joint_revolute(
                f"hip{int(side)}", torso, foot, axis=(0.0, 1.0, 0.0), anchor=(x, y + 0.2 * side, z + 0.5),
                limit=(-0.4, 0.4), drive=sw.PositionDrive(stiffness=60.0, damping=2.0, effort_limit=6.0),
            )  # fmt: skip

    return joints


BUILD = {
    "slider": _slider, "stack": _stack, "crash": _crash, "arm": _arm, "linkage": _linkage, "ball": _ball,
    "walker": _walker,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Owned:
    """What belongs to one thing in a model: indices."""

    bodies: list[int]
    dofs: list[int]

    @classmethod
    def of(cls, part: str, model: sw.Model) -> Owned:
        names = set(yard([part]).finalize(1, "cpu").body_names)
        joints = set(yard([part]).finalize(1, "cpu").joint_names)
        starts = model.joint_dof_start
        return cls(
            [k for k, name in enumerate(model.body_names) if name in names],
            [d for k, name in enumerate(model.joint_names) if name in joints for d in range(starts[k], starts[k + 1])],
        )


def content(part: str, sim: sw.Simulation) -> dict[str, np.ndarray]:
    """All that there is of one thing: its motion, its bounded impulses, and its contacts in their order."""
    owned, state, contacts = Owned.of(part, sim.model), sim.state, sim.contacts
    found = {
        name: getattr(state, name).numpy()[:, owned.bodies]
        for name in ("body_x", "body_rot", "body_v", "body_omega", "body_v_low", "body_omega_low")
    }
    found |= {name: getattr(state, name).numpy()[:, owned.dofs] for name in ("joint_x", "joint_q", "joint_qd")}
    boxes = [k for k, (dof, _) in enumerate(sim.model.tables.boxes) if dof in owned.dofs]
    found["box_impulse"] = state.box_impulse.numpy()[:, boxes]
    found["body_contact_force"] = contacts.body_contact_force.numpy()[:, owned.bodies]
    shape_body = np.array([shape.body for shape in sim.model.builder.shapes])
    count, second = contacts.contact_count.numpy(), contacts.contact_shape1.numpy()
    first = contacts.contact_shape0.numpy()
    for world in range(len(count)):
        used = np.arange(count[world])
        touching = np.isin(shape_body[first[world, used]], owned.bodies)
        mine = used[touching | np.isin(shape_body[second[world, used]], owned.bodies)]
        for name in ("contact_impulse", "contact_moment", "contact_gap", "contact_normal_w"):
            found[f"{name}_{world}"] = getattr(contacts, name).numpy()[world, mine]
    return found
