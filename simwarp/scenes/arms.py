"""Robot arms of six hinges from published numbers: the Comau Racer3 with its hand, and the ABB IRB 120.

Racer3: masses, frames and shapes of the arm's CAD export (Benatti, thesis, section 9.2), turned to Z up. IRB 120:
`irb120_3_58.urdf` of ROS-Industrial (`abb_irb120_support`), which gives no efforts; those of `IRB120` are two to three
times what gravity asks for. Its shapes are a box and capsules between the joints' frames.

All numbers are of the zero pose, in world axes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import frame_from_axis
from simwarp.core.types import WORLD, Material, PositionDrive, ShapeType, Vec3, pose
from simwarp.model.builder import ModelBuilder

Array = npt.NDArray[np.float64]

ARM_FRICTION = 0.5
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class ArmLink:
    """A rigid link.

    Attributes:
        name: of its body.
        mass: [kg].
        centre: of mass [m].
        moments: Ixx, Iyy, Izz about the centre of mass [kg·m²].
        products: Ixy, Ixz, Iyz, entries of the matrix [kg·m²].
    """

    name: str
    mass: float
    centre: Vec3
    moments: Vec3
    products: Vec3

    @property
    def inertia(self) -> Array:
        """(3, 3) about the centre of mass [kg·m²]."""
        (xx, yy, zz), (xy, xz, yz) = self.moments, self.products
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclasses.dataclass(frozen=True)
class ArmJoint:
    """A hinge between a link and the next one.

    Attributes:
        name: of the joint.
        point: on its axis [m].
        axis: its direction; the next link turns positively about it.
        limit: lower and upper stop [rad].
        torque: largest of the motor [N·m].
        speed: beyond which the motor speeds it up no more [rad/s].
    """

    name: str
    point: Vec3
    axis: Vec3
    limit: tuple[float, float]
    torque: float
    speed: float


@dataclasses.dataclass(frozen=True)
class ArmShape:
    """A collision shape.

    Attributes:
        name: of the shape.
        link: that carries it.
        kind: what it is.
        size: as `ShapeType` tells [m].
        centre: its middle [m].
        axis: of a cylinder or capsule; boxes have the world's axes.
    """

    name: str
    link: str
    kind: ShapeType
    size: Vec3
    centre: Vec3
    axis: Vec3 = _Z


@dataclasses.dataclass(frozen=True)
class Arm:
    """An arm on a fixed base.

    Attributes:
        links: from the base on; each hangs on the one before by the joint of its place, those without one are fixed.
        joints: between the first links.
        grip: point between the tips of the fingers, carried by the last link [m].
        shapes: what touches.
        barred: names of shapes that must not touch anything: base, upper arm, forearm.
        fingers: names of the two fingers' shapes.
        apart: pairs of links whose shapes never reach each other; None: the ground and what lies on it.
    """

    links: tuple[ArmLink, ...]
    joints: tuple[ArmJoint, ...]
    grip: Vec3
    shapes: tuple[ArmShape, ...]
    barred: tuple[str, ...]
    fingers: tuple[str, str]
    apart: tuple[tuple[str, str | None], ...]

    @property
    def mass(self) -> float:
        """Of all links [kg]."""
        return sum(link.mass for link in self.links)


def _hinge(name: str, point: Vec3, axis: Vec3, limit: tuple[float, float], torque: float, speed: float) -> ArmJoint:
    """A joint from limits and a speed in degrees."""
    low, high = limit
    return ArmJoint(name, point, axis, (math.radians(low), math.radians(high)), torque, math.radians(speed))


_HAND = ArmLink(
    "hand", 0.570098, (-0.502173, 3.9e-05, 0.684988), (0.000386194, 0.00128764, 0.00134277),
    (8.76701e-06, -1.8151e-05, -1.16086e-05),
)  # fmt: skip
_HAND_FLANGE = (-0.43144, 0.0, 0.685)
"""Where the Racer3's last joint carries the hand [m]."""
_FINGERS = tuple(
    ArmShape(name, "hand", ShapeType.BOX, (0.01, 0.003, 0.0105), (-0.57974, side, 0.685))
    for name, side in (("finger_1", -0.028), ("finger_2", 0.028))
)
_FINGER_NAMES = ("finger_1", "finger_2")

RACER3 = Arm(
    links=(
        ArmLink("base", 2.031121, (0.016574, -6.8e-05, 0.143199), (0.0178705, 0.0215332, 0.0139708),
                (1.03608e-05, 0.00154956, -3.57379e-06)),
        ArmLink("link_1", 5.77385, (-0.037609, 0.004623, 0.309756), (0.059709, 0.035488, 0.0472382),
                (0.00010346, -0.00446818, 1.35479e-05)),
        ArmLink("link_2", 10.372809, (-0.03965, 0.006406, 0.501561), (0.135351, 0.176467, 0.0661423),
                (0.000538427, -0.00941818, -0.000470897)),
        ArmLink("link_3", 2.578816, (-0.041971, 0.001891, 0.654516), (0.00508983, 0.00712171, 0.00588527),
                (-0.000111903, -0.00171483, -0.000118835)),
        ArmLink("link_4", 4.232698, (-0.224249, 0.002154, 0.680452), (0.0294943, 0.00845669, 0.0295974),
                (-0.000578718, -1.89364e-05, 1.95546e-06)),
        ArmLink("link_5", 2.100597, (-0.383232, -0.001371, 0.684993), (0.00108998, 0.00206095, 0.00212849),
                (7.16858e-05, 2.59789e-07, -2.74196e-07)),
        _HAND,
    ),
    joints=(
        _hinge("joint_1", (0.0, 0.0, 0.00211), _Z, (-170.0, 170.0), 100.0, 430.0),
        _hinge("joint_2", (-0.05, 0.061, 0.365), _Y, (-95.0, 135.0), 100.0, 450.0),
        _hinge("joint_3", (-0.05, 0.14201, 0.635), _Y, (-155.0, 90.0), 50.0, 500.0),
        _hinge("joint_4", (-0.05881, 0.0, 0.685), _X, (-179.0, 179.0), 7.36, 600.0),
        _hinge("joint_5", (-0.35594, 0.021, 0.685), _Y, (-100.0, 100.0), 7.36, 600.0),
        _hinge("joint_6", _HAND_FLANGE, _X, (-179.0, 179.0), 4.41, 900.0),
    ),
    grip=(-0.59024, 6e-05, 0.68498),
    shapes=(
        ArmShape("base", "base", ShapeType.CYLINDER, (0.11857, 0.09425, 0.11857), (0.0, 0.0, 0.0942)),
        ArmShape("upper_arm", "link_2", ShapeType.CYLINDER, (0.075, 0.055, 0.075), (-0.05, -0.005, 0.365), _Y),
        ArmShape("forearm_1", "link_4", ShapeType.CYLINDER, (0.04453, 0.02, 0.04453), (-0.35594, 0.041, 0.685), _Y),
        ArmShape("forearm_2", "link_4", ShapeType.CYLINDER, (0.04453, 0.015, 0.04453), (-0.35594, -0.045, 0.685), _Y),
        *_FINGERS,
    ),
    barred=("base", "upper_arm", "forearm_1", "forearm_2"),
    fingers=_FINGER_NAMES,
    # The upper arm's cylinder is about the shoulder's axis and stays there
    apart=(("base", None), ("base", "link_2"), ("link_2", None), ("link_4", "hand")),
)  # fmt: skip
"""Comau Racer3 with its hand: 27.660 kg; at zero the forearm points along -X."""


_IRB120_FLANGE = (0.374, 0.0, 0.63)


def _on_irb120(point: Vec3) -> tuple[float, float, float]:
    """A point of the Racer3's hand on the flange of the IRB 120, which points along +X: half a turn about Z."""
    x, y, z = (float(p) - q for p, q in zip(point, _HAND_FLANGE, strict=True))
    return (_IRB120_FLANGE[0] - x, _IRB120_FLANGE[1] - y, _IRB120_FLANGE[2] + z)


IRB120 = Arm(
    links=(
        ArmLink("base_link", 6.215, (-0.04204, 8.01e-05, 0.07964), (0.0247272, 0.0491285, 0.0472376),
                (-8.0784e-05, 0.00130902, -8.0419e-06)),
        ArmLink("link_1", 3.067, (9.77e-05, -0.00012, 0.23841), (0.0142175, 0.0144041, 0.0104533),
                (-1.28579e-05, -2.31364e-05, 1.93404e-05)),
        ArmLink("link_2", 3.909, (0.00078, -0.00212, 0.39124), (0.0603111, 0.041569, 0.0259548),
                (9.83431e-06, 5.72407e-05, -0.00050497)),
        ArmLink("link_3", 2.944, (0.02281, 0.00106, 0.61791), (0.00835606, 0.016713, 0.0126984),
                (-8.01545e-05, 0.00142884, -0.000182227)),
        ArmLink("link_4", 1.328, (0.2247, 0.00015, 0.63041), (0.00284661, 0.00401346, 0.0052535),
                (-2.12765e-05, -1.6435e-05, 1.31336e-05)),
        ArmLink("link_5", 0.546, (0.30091, 3.68e-05, 0.6300622), (0.000404891, 0.000892825, 0.000815468),
                (1.61943e-06, 8.46805e-07, -1.51792e-08)),
        ArmLink("link_6", 0.137, (0.36694, -0.00017, 0.62999868), (0.001, 0.001, 0.001), (0.0, 0.0, 0.0)),
        ArmLink("hand", _HAND.mass, _on_irb120(_HAND.centre), _HAND.moments,
                (_HAND.products[0], -_HAND.products[1], -_HAND.products[2])),
    ),
    joints=(
        ArmJoint("joint_1", (0.0, 0.0, 0.0), _Z, (-2.87979, 2.87979), 60.0, 4.36332),
        ArmJoint("joint_2", (0.0, 0.0, 0.29), _Y, (-1.91986, 1.91986), 60.0, 4.36332),
        ArmJoint("joint_3", (0.0, 0.0, 0.56), _Y, (-1.91986, 1.22173), 20.0, 4.36332),
        ArmJoint("joint_4", (0.0, 0.0, 0.63), _X, (-2.79253, 2.79253), 5.0, 5.58505),
        ArmJoint("joint_5", (0.302, 0.0, 0.63), _Y, (-2.094395, 2.094395), 5.0, 5.58505),
        ArmJoint("joint_6", _IRB120_FLANGE, _X, (-6.98132, 6.98132), 3.0, 7.33038),
    ),
    grip=_on_irb120(RACER3.grip),
    shapes=(
        ArmShape("base", "base_link", ShapeType.BOX, (0.155, 0.093, 0.083), (-0.0625, 0.0, 0.083)),
        ArmShape("upper_arm", "link_2", ShapeType.CAPSULE, (0.05, 0.135, 0.05), (0.0, 0.0, 0.425)),
        ArmShape("forearm", "link_4", ShapeType.CAPSULE, (0.045, 0.05, 0.045), (0.252, 0.0, 0.63), _X),
        *(dataclasses.replace(finger, centre=_on_irb120(finger.centre)) for finger in _FINGERS),
    ),
    barred=("base", "upper_arm", "forearm"),
    fingers=_FINGER_NAMES,
    # With the shoulder at its stop the upper arm still is 0.14 m above the ground
    apart=(("base_link", None), ("base_link", "link_2"), ("link_2", None), ("link_4", "hand")),
)  # fmt: skip
"""ABB IRB 120-3/0.58 with the Racer3's hand on its flange: 18.716 kg; at zero the forearm points along +X."""


def robot_arm(
    arm: Arm = RACER3, *, ground: bool = True, hand: bool = True, drives: Sequence[PositionDrive] | None = None
) -> ModelBuilder:
    """An arm on a fixed base, at its zero pose.

    Coordinates: the joints from the base on [rad], zero as built. Bodies have the arm's link names, and the world's
    axes at zero. Limits stand; torques (`joint_force`) are up to the caller.

    Args:
        arm: `RACER3`, `IRB120` or one of your own.
        ground: add a floor at z = 0.
        hand: with the last link, that carries the fingers; only an arm with a fixed hand can go without.
        drives: of the joints, towards `joint_target_q`; without, torques alone move them.
    """
    builder = ModelBuilder()
    surface = Material(friction=ARM_FRICTION)
    links = arm.links if hand else arm.links[:-1]
    bodies = {
        link.name: builder.add_body(link.name, mass=link.mass, inertia=link.inertia, pose=pose(link.centre))
        for link in links
    }
    centres = {link.name: np.asarray(link.centre) for link in links}
    builder.add_joint_fixed("foot", WORLD, bodies[links[0].name])
    for index, joint in enumerate(arm.joints):
        parent, child = (bodies[links[at].name] for at in (index, index + 1))
        builder.add_joint_revolute(
            joint.name, parent, child, axis=joint.axis, anchor=joint.point, limit=joint.limit,
            drive=None if drives is None else drives[index],
        )  # fmt: skip
    for before, link in zip(links[len(arm.joints) :], links[len(arm.joints) + 1 :], strict=False):
        builder.add_joint_fixed(f"mount_{link.name}", bodies[before.name], bodies[link.name])
    if ground:
        builder.add_shape_plane(WORLD, material=surface, name="floor")
    for shape in arm.shapes:
        if shape.link in bodies:
            rotation = frame_from_axis(f"shape '{shape.name}'", shape.axis)
            at = pose(np.asarray(shape.centre) - centres[shape.link], rotation)
            options = {"pose": at, "material": surface, "name": shape.name}
            size: dict[str, Any] = {"half": shape.size}
            if shape.kind is not ShapeType.BOX:
                size = {"radius": shape.size[0], "half_length": shape.size[1]}
            getattr(builder, f"add_shape_{shape.kind.name.lower()}")(bodies[shape.link], **size, **options)
    for first, second in arm.apart:
        if first in bodies and (second is None or second in bodies):
            builder.exclude_collision(bodies[first], WORLD if second is None else bodies[second])
    return builder
