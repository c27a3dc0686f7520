"""A quadruped with twelve drives, built by code from the published numbers of Unitree's Go2.

Masses, centres of mass, moments of inertia, lengths, ranges, torques and speeds are those of the manufacturer's robot
description (``go2_description``, BSD-3-Clause), rounded. Products of inertia are left out and right legs mirror left
ones, so that the robot is its own mirror image. Shapes are of our own: few and simple, for the ground alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Material, PositionDrive, Vec3, pose
from simwarp.model.builder import ModelBuilder

if TYPE_CHECKING:
    from simwarp.sensors.scene import Visuals

QUADRUPED_LEGS: Final = ("FL", "FR", "RL", "RR")
"""Front left, front right, rear left, rear right: the order of legs wherever there is one."""
QUADRUPED_FEET: Final = tuple(f"{leg}_foot" for leg in QUADRUPED_LEGS)
"""Names of the shapes that stand on the ground."""
QUADRUPED_LINK: Final = 0.213
"""Length of a thigh, and of a calf down to the middle of its foot [m]."""
QUADRUPED_FOOT_RADIUS: Final = 0.022
"""Of the balls that are its feet [m]."""
QUADRUPED_TORQUES: Final = {"hip": 23.7, "thigh": 23.7, "calf": 45.43}
"""Largest torque of a motor [N·m]."""
QUADRUPED_SPEEDS: Final = {"hip": 30.1, "thigh": 30.1, "calf": 15.7}
"""Highest speed of a motor without load [rad/s]."""
QUADRUPED_STANCE: Final[Mapping[str, float]] = {
    f"{leg}_{part}_joint": angle
    for leg in QUADRUPED_LEGS
    for part, angle in (("hip", 0.0), ("thigh", 0.8), ("calf", -1.6))
}
"""Angles of a stance with the feet under the hips [rad], in the order of the coordinates."""
QUADRUPED_STANCE_HEIGHT: Final = 2.0 * QUADRUPED_LINK * math.cos(0.8) + QUADRUPED_FOOT_RADIUS
"""Height of the trunk's origin, between the hips, over flat ground in that stance [m]."""

_HIP: Final = (0.1934, 0.0465)
"""Of a hip's axis from the middle, forward and to the left [m]."""
_SIDE: Final = 0.0955
"""From a hip's axis sideways to the plane of its leg [m]."""
_TRUNK_HALF: Final = (0.188, 0.0468, 0.057)
_ARMATURE: Final = 0.01
"""Inertia of a motor's rotor behind its gear [kg·m²]: that of the same robot in MuJoCo Menagerie."""
# Mass [kg], centre of mass from the joint [m], moments of inertia about it [kg·m²], of the front left leg
_TRUNK: Final = (6.921, (0.0211, 0.0, -0.0054), (0.02448, 0.09808, 0.107))
_LINKS: Final[Mapping[str, tuple[float, Vec3, Vec3]]] = {
    "hip": (0.678, (-0.0054, 0.0019, -0.0001), (0.00048, 0.000884, 0.000596)),
    "thigh": (1.152, (-0.0037, -0.0223, -0.0327), (0.00584, 0.0058, 0.00103)),
    "calf": (0.2414, (0.0063, -0.0006, -0.1414), (0.00149, 0.00146, 0.00005)),  # with its foot
}
_RANGES: Final[Mapping[str, tuple[float, float]]] = {
    "hip": (-1.0472, 1.0472), "front thigh": (-1.5708, 3.4907), "rear thigh": (-0.5236, 4.5379),
    "calf": (-2.7227, -0.83776),
}  # fmt: skip
_AXES: Final[Mapping[str, Vec3]] = {"hip": (1.0, 0.0, 0.0), "thigh": (0.0, 1.0, 0.0), "calf": (0.0, 1.0, 0.0)}
_DARK: Final = (0.03, 0.03, 0.035)
_LIGHT: Final = (0.55, 0.57, 0.6)
_ACCENT: Final = (0.7, 0.2, 0.03)
_LYING: Final = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""The rotation that turns an axis z into y."""


def quadruped(
    *, ground: bool = True, gains: tuple[float, float] | None = (40.0, 1.0), friction: float = 0.8
) -> ModelBuilder:  # fmt: skip
    """A quadruped of 15.2 kg: a trunk and four legs of hip, thigh and calf, whose motors have limited torques.

    Forward is +X, left is +Y. Coordinates: position of the point between the hips and rotation vector of the trunk
    (``base``, 0..5), then hip, thigh and calf of FL, FR, RL, RR (6..17) [rad]. As built the legs hang straight down,
    where all angles are zero; that is out of the calves' range: start from ``QUADRUPED_STANCE``. Hips turn about x,
    thighs and calves about y: a positive hip lifts the foot to the left, a positive thigh or calf turns it back.

    Only trunk, thighs, calves and feet touch something, and that is shapes of group 2 alone: legs pass through each
    other.

    Args:
        ground: True if there is a floor, z = 0.
        gains: stiffness [N·m/rad] and damping [N·m·s/rad] of the drives towards ``joint_target_q``; None: torques alone
            (``joint_force``) move the joints.
        friction: of feet and floor.
    """
    builder = ModelBuilder()
    surface = Material(friction=friction)
    if ground:
        builder.add_shape_plane(WORLD, material=surface, name="floor", group=2)
    height = 2.0 * QUADRUPED_LINK + QUADRUPED_FOOT_RADIUS
    origin = np.array([0.0, 0.0, height])
    mass, centre, moments = _TRUNK
    trunk = builder.add_body("trunk", mass=mass, inertia=moments, pose=pose(origin + centre))
    builder.add_shape_box(
        trunk, half=_TRUNK_HALF, pose=pose(-np.array(centre)), material=surface, name="trunk", mask=2
    )  # fmt: skip
    builder.add_joint_free("base", trunk, anchor=origin)
    for leg in QUADRUPED_LEGS:
        _add_leg(builder, leg, trunk, origin, surface, gains)
    return builder


def _signs(leg: str) -> tuple[float, float]:
    """Return where a leg is: 1 in front or -1 behind, 1 on the left or -1 on the right."""
    return (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)


def _add_leg(
    builder: ModelBuilder, leg: str, trunk: int, origin: npt.NDArray[np.float64], surface: Material,
    gains: tuple[float, float] | None,
) -> None:  # fmt: skip
    """Add the links, joints and shapes of a leg that hangs straight down."""
    front, left = _signs(leg)
    anchor = np.add(origin, (front * _HIP[0], left * _HIP[1], 0.0))
    parent = trunk
    for part, (mass, centre, moments) in _LINKS.items():
        # Hips point inwards from both ends of the trunk; the other links are the same in front and behind
        mirror = np.array([front if part == "hip" else 1.0, left, 1.0])
        body = builder.add_body(
            f"{leg}_{part}", mass=mass, inertia=moments, pose=pose(anchor + mirror * np.array(centre))
        )  # fmt: skip
        torque = QUADRUPED_TORQUES[part]
        drive = None if gains is None else PositionDrive(stiffness=gains[0], damping=gains[1], effort_limit=torque)
        side = ("front " if front > 0 else "rear ") if part == "thigh" else ""
        builder.add_joint_revolute(
            f"{leg}_{part}_joint", parent, body, axis=_AXES[part], anchor=anchor, limit=_RANGES[side + part],
            armature=_ARMATURE, drive=drive,
        )  # fmt: skip
        offset = -mirror * np.array(centre)  # from the centre of mass to the joint
        if part == "thigh":
            at = pose(np.add(offset, (0.0, 0.0, -0.5 * QUADRUPED_LINK)))
            builder.add_shape_capsule(
                body, radius=0.02, half_length=0.5 * QUADRUPED_LINK - 0.02, pose=at, material=surface,
                name=f"{leg}_thigh", mask=2,
            )  # fmt: skip
        if part == "calf":
            # The rod ends above the sole: on flat ground only feet stand
            builder.add_shape_capsule(
                body, radius=0.012, half_length=0.085, pose=pose(np.add(offset, (0.0, 0.0, -0.09))), material=surface,
                name=f"{leg}_calf", mask=2,
            )  # fmt: skip
            builder.add_shape_sphere(
                body, radius=QUADRUPED_FOOT_RADIUS, pose=pose(np.add(offset, (0.0, 0.0, -QUADRUPED_LINK))),
                material=surface, name=f"{leg}_foot", mask=2,
            )  # fmt: skip
        parent = body
        anchor = anchor + ((0.0, left * _SIDE, 0.0) if part == "hip" else (0.0, 0.0, -QUADRUPED_LINK))


def show_quadruped(visuals: Visuals) -> None:
    """Paint the shapes of :func:`quadruped`, and add what only shows: head, motors of the hips, a stripe on the back.

    Args:
        visuals: of its builder.
    """
    bodies = {body.name: index for index, body in enumerate(visuals.builder.bodies)}
    for index, shape in enumerate(visuals.builder.shapes):
        if shape.body != WORLD:
            dark = shape.name.endswith("_foot") or shape.name.endswith("_calf")
            visuals.show(index, color=_DARK if dark else _LIGHT)
    middle = -np.array(_TRUNK[1])
    trunk = bodies["trunk"]
    for name, half, at, color in (
        ("head", (0.045, 0.035, 0.035), (0.24, 0.0, 0.0), _DARK),
        ("stripe", (0.13, 0.018, 0.003), (0.0, 0.0, 0.058), _ACCENT),
    ):
        visuals.add_box(trunk, half=half, name=name, pose=pose(middle + at), color=color)
    for leg in QUADRUPED_LEGS:
        front, left = _signs(leg)
        centre = np.array(_LINKS["hip"][1]) * (front, left, 1.0)
        for name, aside in (("hip motor", 0.02), ("thigh motor", 0.075)):
            visuals.add_cylinder(
                bodies[f"{leg}_hip"], radius=0.046, half_length=0.021, name=f"{leg} {name}",
                pose=pose((0.0, left * aside, 0.0) - centre, _LYING), color=_DARK,
            )  # fmt: skip
