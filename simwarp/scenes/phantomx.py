"""The PhantomX Mark II hexapod: numbers of its CAD export, and one builder for the bench scene and the task.

Source: ``hexapod.py`` of gym-chrono (2020), exported from CAD with Y up and scalar-first quaternions. The tables below
keep the source's numbers. The builder turns everything, body axes included, by the rotation (x, y, z) -> (z, x, y):
that is Y up to Z up, (x, y, z) -> (x, -z, y), then a quarter turn about the vertical, by which the source's walking
direction +z becomes +X. Seen from above with +X ahead, legs 1 to 3 are on the right from front to back, 4 to 6 on the
left.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of, quat_conjugate, quat_multiply, rotate
from simwarp.core.types import WORLD, Material, PositionDrive, Vec3, pose
from simwarp.model.builder import ModelBuilder

Array = npt.NDArray[np.float64]
Quat = tuple[float, float, float, float]

HEXAPOD_LIMIT = 0.5 * math.pi
"""Largest angle of a joint on either side [rad]."""
HEXAPOD_STANCE = 0.1325
"""Height above the floor of the base's origin as built [m]: 0.128 + the radius of a foot."""
HEXAPOD_FOOT_RADIUS = 0.0045
_LEGS = 6
_FRICTION = 0.5


@dataclasses.dataclass(frozen=True)
class _Placement:
    """Placement of a body in the source: its reference frame, and its inertia about the centre of mass in body axes."""

    position: Vec3
    rotation: Quat
    """Scalar first."""
    moments: Vec3
    """Ixx, Iyy, Izz [kg·m²]."""
    products: Vec3
    """Ixy, Ixz, Iyz [kg·m²], entries of the matrix."""


@dataclasses.dataclass(frozen=True)
class _Part:
    """A part of which every leg has one: mass [kg], centre of mass in the reference frame [m], legs 1 to 6."""

    mass: float
    centre: Vec3
    placements: tuple[_Placement, ...]


_BASE_MASS = 0.52312
_BASE_CENTRE = (-0.00035713, 0.019258, -0.0016328)
_BASE = _Placement(
    (0, 0, 0), (1, 0, 0, 0), (0.003434, 0.0048807, 0.0016536), (-1.417e-7, 2.9529e-7, -1.5382e-5)
)  # fmt: skip

# Half sizes and centre in the reference frame [m]
_BASE_BOXES = (
    ((0.043, 0.076, 0.0185), (0, 0.0185, 0)),
    ((0.01925, 0.016, 0.0175), (-0.0472983, 0.02, 0.108298)),
    ((0.01925, 0.016, 0.0175), (-0.08425, 0.02, 0)),
    ((0.01925, 0.016, 0.0175), (0.0472983, 0.02, 0.108298)),
    ((0.01925, 0.016, 0.0175), (-0.0472983, 0.02, -0.108298)),
    ((0.01925, 0.016, 0.0175), (0.0472983, 0.02, -0.108298)),
    ((0.01925, 0.016, 0.0175), (0.08425, 0.02, 0)),
)

_HIP = _Part(
    mass=0.018719, centre=(-0.00096271, 0.00096271, 0.026009),
    placements=(
        _Placement((-0.09768, 0.01774, 0.15868), (0.38268, 0, 0.92388, 0),
                   (8.0036e-6, 9.6222e-6, 8.9405e-6), (3.4328e-7, -1.1502e-6, 3.1874e-7)),
        _Placement((-0.1555, 0.01774, 0), (0.70711, 0, 0.70711, 0),
                   (7.3218e-6, 9.6222e-6, 9.6222e-6), (4.6812e-7, 4.6843e-7, -1.735e-8)),
        _Placement((-0.09768, 0.01774, -0.15868), (0.92388, 0, 0.38268, 0),
                   (8.9405e-6, 9.6222e-6, 8.0036e-6), (3.1874e-7, 1.1502e-6, -3.4328e-7)),
        _Placement((0.09768, 0.01774, 0.15868), (-0.38268, 0, 0.92388, 0),
                   (8.9405e-6, 9.6222e-6, 8.0036e-6), (-3.1874e-7, 1.1502e-6, 3.4328e-7)),
        _Placement((0.1555, 0.01774, 0), (0.70711, 0, -0.70711, 0),
                   (7.3218e-6, 9.6222e-6, 9.6222e-6), (-4.6812e-7, 4.6843e-7, 1.735e-8)),
        _Placement((0.09768, 0.01774, -0.15868), (0.92388, 0, -0.38268, 0),
                   (8.0036e-6, 9.6222e-6, 8.9405e-6), (-3.4328e-7, -1.1502e-6, -3.1874e-7)),
    ),
)  # fmt: skip
_FEMUR = _Part(
    mass=0.056081, centre=(0.00073337, -0.020749, 0.0031585),
    placements=(
        _Placement((-0.10046, 0.017463, 0.15802), (0.65328, -0.2706, 0.2706, -0.65328),
                   (1.2327e-5, 3.0002e-5, 2.9558e-5), (-1.142e-6, -2.225e-6, 2.1027e-6)),
        _Placement((-0.157, 0.017463, -0.0024321), (0.70711, 0, 0, -0.70711),
                   (1.2327e-5, 3.1882e-5, 2.7677e-5), (-2.3808e-6, -7.6581e-7, -2.2207e-7)),
        _Placement((-0.09702, 0.017463, -0.16146), (0.65328, 0.2706, -0.2706, -0.65328),
                   (1.2327e-5, 2.9558e-5, 3.0002e-5), (-2.225e-6, 1.142e-6, -2.1027e-6)),
        _Placement((0.09702, 0.017463, 0.16146), (-0.2706, 0.65328, -0.65328, 0.2706),
                   (1.2327e-5, 2.9558e-5, 3.0002e-5), (2.225e-6, -1.142e-6, -2.1027e-6)),
        _Placement((0.157, 0.017463, 0.0024321), (0, 0.70711, -0.70711, 0),
                   (1.2327e-5, 3.1882e-5, 2.7677e-5), (2.3808e-6, 7.6581e-7, -2.2207e-7)),
        _Placement((0.10046, 0.017463, -0.15802), (-0.2706, -0.65328, 0.65328, 0.2706),
                   (1.2327e-5, 3.0002e-5, 2.9558e-5), (1.142e-6, 2.225e-6, 2.1027e-6)),
    ),
)  # fmt: skip
_TIBIA = _Part(
    mass=0.074983, centre=(0.015962, -0.020308, 0.00024097),
    placements=(
        _Placement((-0.15165, -0.0013265, 0.21285), (0.80585, -0.18716, 0.33379, -0.45184),
                   (4.5826e-5, 0.00010843, 8.9531e-5), (-2.6933e-6, -3.4599e-5, -1.3656e-6)),
        _Placement((-0.23197, -0.0013265, 0.00013726), (0.87224, 0, 0, -0.48907),
                   (3.0124e-5, 0.00010519, 0.00010848), (-1.6527e-5, 3.0896e-7, 1.2096e-7)),
        _Placement((-0.15185, -0.0013265, -0.21265), (0.80585, 0.18716, -0.33379, -0.45184),
                   (4.6222e-5, 0.00010857, 8.9002e-5), (-2.3288e-6, 3.4841e-5, 1.2176e-6)),
        _Placement((0.15185, -0.0013265, 0.21265), (0.33379, -0.45184, 0.80585, -0.18716),
                   (9.7502e-5, 5.7287e-5, 8.9002e-5), (2.3933e-5, -1.4798e-5, 3.1565e-5)),
        _Placement((0.23197, -0.0013265, -0.00013726), (0, -0.48907, 0.87224, 0),
                   (0.000103, 3.2311e-5, 0.00010848), (2.0796e-5, -3.3169e-8, 3.3013e-7)),
        _Placement((0.15165, -0.0013265, -0.21285), (-0.33379, -0.45184, 0.80585, 0.18716),
                   (9.7611e-5, 5.665e-5, 8.9531e-5), (2.3827e-5, 1.4556e-5, -3.1418e-5)),
    ),
)  # fmt: skip
# In the order of the tibias that they are fixed to; the source numbers them 2, 1, 3, 6, 5, 4
_FOOT = _Part(
    mass=0.0093282, centre=(0.084604, -0.070877, -1.7255e-5),
    placements=(
        _Placement((-0.15165, -0.0013265, 0.21285), (0.80585, -0.18716, 0.33379, -0.45184),
                   (1.4426e-6, 1.846e-6, 1.3687e-6), (-4.1287e-7, -3.0411e-7, 2.0753e-7)),
        _Placement((-0.23197, -0.0013265, 0.00013726), (0.87224, 0, 0, -0.48907),
                   (1.312e-6, 1.995e-6, 1.3503e-6), (-4.7409e-7, 0, 0)),
        _Placement((-0.17493, -0.0013265, -0.23579), (0.33379, -0.45184, 0.80585, -0.18716),
                   (2.0972e-6, 1.1914e-6, 1.3687e-6), (-7.7633e-8, -3.2334e-7, 1.7608e-7)),
        _Placement((0.17493, -0.0013265, 0.23579), (0.80585, 0.18716, -0.33379, -0.45184),
                   (1.4426e-6, 1.846e-6, 1.3687e-6), (-4.1287e-7, 3.0411e-7, -2.0753e-7)),
        _Placement((0.26465, -0.0013265, -0.00010274), (0.87224, 0, 0, -0.48907),
                   (1.312e-6, 1.995e-6, 1.3503e-6), (-4.7409e-7, 0, 0)),
        _Placement((0.17479, -0.0013265, -0.23593), (0.80585, -0.18716, 0.33379, -0.45184),
                   (1.4426e-6, 1.846e-6, 1.3687e-6), (-4.1287e-7, -3.0411e-7, 2.0753e-7)),
    ),
)  # fmt: skip

# Point and axis of the hinges, world frame of the source: body-hip, hip-femur, femur-tibia of legs 1 to 6
_HINGES: tuple[tuple[tuple[Vec3, Vec3], ...], ...] = (
    (
        ((-0.06091, 0.0364, 0.12191), (0, 1, 0)),
        ((-0.1035, 0.0364, 0), (0, 1, 0)),
        ((-0.06091, 0.0364, -0.12191), (0, 1, 0)),
        ((0.06091, 0.0364, 0.12191), (0, 1, 0)),
        ((0.1035, 0.0364, 0), (0, 1, 0)),
        ((0.06091, 0.0364, -0.12191), (0, 1, 0)),
    ),
    (
        ((-0.08498, 0.01774, 0.17138), (0.70711, 0, 0.70711)),
        ((-0.1555, 0.01774, 0.01796), (0, 0, 1)),
        ((-0.11038, 0.01774, -0.14598), (-0.70711, 0, 0.70711)),
        ((0.11038, 0.01774, 0.14598), (0.70711, 0, -0.70711)),
        ((0.1555, 0.01774, -0.01796), (0, 0, -1)),
        ((0.08498, 0.01774, -0.17138), (-0.70711, 0, -0.70711)),
    ),
    (
        ((-0.1305, 0.003151, 0.21698), (0.70711, 0, 0.70711)),
        ((-0.21993, 0.003151, 0.01802), (0, 0, 1)),
        ((-0.15598, 0.003151, -0.1915), (-0.70711, 0, 0.70711)),
        ((0.15598, 0.003151, 0.1915), (0.70711, 0, -0.70711)),
        ((0.21993, 0.003151, -0.01802), (0, 0, -1)),
        ((0.1305, 0.003151, -0.21698), (-0.70711, 0, -0.70711)),
    ),
)  # fmt: skip

_SERVO_HALF = (0.01925, 0.016, 0.0175)
_FEMUR_BOX = (-0.00027665, -0.01775017, 0.00399213)
_TIBIA_BOX = (0.00245913, -0.00664367, 0.00148274)
_FOOT_BALL = (0.0987886, -0.07954917, -0.00001726)


@dataclasses.dataclass(frozen=True)
class _Solid:
    """A body, or a piece of one, in the scene's world; its inertia is about the centre of mass in body axes."""

    mass: float
    centre: Array
    rotation: Array
    inertia: Array
    origin: Array
    """Origin of the reference frame, in the world [m]."""

    def local(self, point: Vec3) -> Array:
        """A point of the source's reference frame, from the centre of mass in body axes [m]."""
        place = self.origin + rotate(self.rotation, _turned(point))
        return rotate(quat_conjugate(self.rotation), place - self.centre)


def _turned(vector: Vec3) -> Array:
    """A vector of the source in our axes: (x, y, z) -> (z, x, y)."""
    return np.array([vector[2], vector[0], vector[1]], dtype=np.float64)


def _solid(mass: float, centre: Vec3, at: _Placement) -> _Solid:
    """One exported body, turned and lifted onto the floor."""
    e0, e1, e2, e3 = at.rotation
    rotation = np.array([e3, e1, e2, e0]) / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    (xx, yy, zz), (xy, xz, yz) = at.moments, at.products
    inertia = np.array([[zz, xz, yz], [xz, xx, xy], [yz, xy, yy]])
    origin = _turned(at.position) + np.array([0.0, 0.0, HEXAPOD_STANCE])
    return _Solid(mass, origin + rotate(rotation, _turned(centre)), rotation, inertia, origin)


def _merged(one: _Solid, other: _Solid) -> _Solid:
    """Two solids as one, in the axes and with the reference frame of the first."""
    mass = one.mass + other.mass
    centre = (one.mass * one.centre + other.mass * other.centre) / mass
    into = matrix_of(quat_multiply(quat_conjugate(one.rotation), other.rotation))
    inertia = one.inertia + into @ other.inertia @ into.T
    for part in (one, other):
        arm = rotate(quat_conjugate(one.rotation), part.centre - centre)
        inertia = inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return _Solid(mass, centre, one.rotation, inertia, one.origin)


def _leg_solids(leg: int) -> tuple[_Solid, _Solid, _Solid, Array]:
    """Hip, femur, and tibia with its foot; and the centre of the foot's ball from the tibia's centre of mass."""
    hip, femur, tibia, foot = (
        _solid(part.mass, part.centre, part.placements[leg]) for part in (_HIP, _FEMUR, _TIBIA, _FOOT)
    )
    shank = _merged(tibia, foot)
    ball = foot.origin + rotate(foot.rotation, _turned(_FOOT_BALL))
    return hip, femur, shank, rotate(quat_conjugate(shank.rotation), ball - shank.centre)


def hexapod(*, ground: bool = True, drive: PositionDrive | None = None) -> ModelBuilder:
    """The PhantomX Mark II: six legs of three links, 18 hinges, 1.4778 kg; it stands on feet of 4.5 mm.

    Coordinates: hips 0..5 about the vertical, femurs 6..11, tibias 12..17 [rad], zero as built. Positive angles of
    femurs and tibias move the foot down. Feet are part of their tibias. Every shape meets the ground alone: legs pass
    through each other.

    Args:
        ground: True if there is a floor.
        drive: of every joint, towards `joint_target_q`; without, torques alone (`joint_force`) move it.
    """
    builder = ModelBuilder()
    surface = Material(friction=_FRICTION)
    if ground:
        builder.add_shape_plane(WORLD, material=surface, name="floor", group=2)

    def add(name: str, solid: _Solid) -> int:
        place = pose(solid.centre, solid.rotation)
        return builder.add_body(name, mass=solid.mass, inertia=solid.inertia, pose=place)

    def box(body: int, solid: _Solid, name: str, half: Vec3, centre: Vec3) -> None:
        at = pose(solid.local(centre))
        builder.add_shape_box(body, half=_turned(half), pose=at, material=surface, name=name, mask=2)

    base = _solid(_BASE_MASS, _BASE_CENTRE, _BASE)
    legs = [_leg_solids(leg) for leg in range(_LEGS)]
    body = add("base", base)
    hips = [add(f"hip_{leg}", solids[0]) for leg, solids in enumerate(legs, 1)]
    femurs = [add(f"femur_{leg}", solids[1]) for leg, solids in enumerate(legs, 1)]
    tibias = [add(f"tibia_{leg}", solids[2]) for leg, solids in enumerate(legs, 1)]
    for index, (half, centre) in enumerate(_BASE_BOXES):
        box(body, base, f"base_{index}", half, centre)
    for leg, (_, femur, tibia, _) in enumerate(legs, 1):
        box(femurs[leg - 1], femur, f"femur_{leg}", _SERVO_HALF, _FEMUR_BOX)
        box(tibias[leg - 1], tibia, f"tibia_{leg}", _SERVO_HALF, _TIBIA_BOX)
    for leg, (_, _, _, ball) in enumerate(legs, 1):
        builder.add_shape_sphere(
            tibias[leg - 1], radius=HEXAPOD_FOOT_RADIUS, pose=pose(ball), material=surface, name=f"foot_{leg}", mask=2
        )
    pairs = (("hip", [body] * _LEGS, hips), ("femur", hips, femurs), ("tibia", femurs, tibias))
    for (kind, parents, children), hinges in zip(pairs, _HINGES, strict=True):
        for leg, (parent, child, (point, axis)) in enumerate(zip(parents, children, hinges, strict=True), 1):
            anchor = _turned(point) + np.array([0.0, 0.0, HEXAPOD_STANCE])
            builder.add_joint_revolute(
                f"{kind}_{leg}", parent, child, axis=_turned(axis), anchor=anchor,
                limit=(-HEXAPOD_LIMIT, HEXAPOD_LIMIT), drive=drive,
            )  # fmt: skip
    return builder
