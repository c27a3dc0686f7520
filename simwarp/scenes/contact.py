"""Scenes with contacts: robots, stacks and piles. Every function returns a ModelBuilder. SI units, Z up."""

from __future__ import annotations

import math

import numpy as np

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import WORLD, Material, pose
from simwarp.model.builder import ModelBuilder

ANT_TORSO_RADIUS = 0.25
ANT_LIMB_RADIUS = 0.04
"""Radius of the capsules that are the legs of `ant()` [m]."""
ANT_LEG = 0.3
ANT_ANKLE = 0.4
ANT_DENSITY = 250.0
ANT_TORSO_DENSITY = 100.0


def _about(axis: int, angle: float) -> np.ndarray:
    q = np.zeros(4)
    q[axis], q[3] = math.sin(0.5 * angle), math.cos(0.5 * angle)
    return q


def _rod_inertia(mass: float, radius: float, length: float) -> tuple[float, float, float]:
    """A solid cylinder about its centre, its axis x."""
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    return (0.5 * mass * radius**2, across, across)


def ant(*, height: float = 0.4, ground: bool = True) -> ModelBuilder:
    """A ball on four legs of two links, eight hinges; only torso and feet touch the ground.

    Coordinates: the hips 0..3, then the ankles 4..7 [rad], zero as built: ankles 60 degrees down.
    """
    builder = ModelBuilder()
    surface = Material(friction=0.5)
    if ground:
        builder.add_shape_plane(WORLD, material=surface, name="floor", group=2)
    mass = ANT_TORSO_DENSITY * 4.0 / 3.0 * math.pi * ANT_TORSO_RADIUS**3
    torso = builder.add_body(
        "torso", mass=mass, inertia=(0.4 * mass * ANT_TORSO_RADIUS**2,) * 3, pose=pose((0.0, 0.0, height))
    )
    builder.add_shape_sphere(torso, radius=ANT_TORSO_RADIUS, material=surface, name="torso", mask=2)
    section = ANT_DENSITY * math.pi * ANT_LIMB_RADIUS**2
    ankles = []
    for leg in range(4):
        yaw = (0.25 + 0.5 * leg) * math.pi
        out = _about(2, yaw)
        hip = np.array([0.0, 0.0, height]) + ANT_TORSO_RADIUS * np.array([math.cos(yaw), math.sin(yaw), 0.0])
        down = quat_multiply(out, _about(1, math.pi / 3.0))
        knee = hip + rotate(out, np.array([ANT_LEG, 0.0, 0.0]))
        leg_mass, ankle_mass = section * ANT_LEG, section * ANT_ANKLE
        thigh = builder.add_body(
            f"leg_{leg}", mass=leg_mass, inertia=_rod_inertia(leg_mass, ANT_LIMB_RADIUS, ANT_LEG),
            pose=pose(0.5 * (hip + knee), out),
        )  # fmt: skip
        shin = builder.add_body(
            f"ankle_{leg}", mass=ankle_mass, inertia=_rod_inertia(ankle_mass, ANT_LIMB_RADIUS, ANT_ANKLE),
            pose=pose(knee + rotate(down, np.array([0.5 * ANT_ANKLE, 0.0, 0.0])), down),
        )  # fmt: skip
        builder.add_joint_revolute(
            f"hip_{leg}", torso, thigh, axis=(0.0, 0.0, 1.0), anchor=hip, limit=(-math.pi / 3.0, math.pi / 3.0)
        )
        ankles.append((thigh, shin, knee, rotate(out, np.array([0.0, 1.0, 0.0]))))
        builder.add_shape_sphere(
            shin, radius=ANT_LIMB_RADIUS, pose=pose((0.5 * ANT_ANKLE, 0.0, 0.0)), material=surface,
            name=f"foot_{leg}", mask=2,
        )  # fmt: skip
    for leg, (thigh, shin, knee, axis) in enumerate(ankles):
        builder.add_joint_revolute(
            f"ankle_{leg}", thigh, shin, axis=axis, anchor=knee, limit=(-math.pi / 2.0, math.pi / 4.0)
        )
    return builder


def stack(*, count: int = 10, half: float = 0.25, mass: float = 1.0, friction: float = 0.5) -> ModelBuilder:
    """Cubes on top of each other, at rest and touching."""
    builder = ModelBuilder()
    material = Material(friction=friction)
    builder.add_shape_plane(WORLD, material=material, name="ground")
    for level in range(count):
        at = pose((0.0, 0.0, (2 * level + 1) * half))
        builder.add_solid(f"box{level}", "box", half, mass=mass, pose=at, material=material)
    return builder


def heavy_on_light(*, ratio: float = 1000.0) -> ModelBuilder:
    """Two cubes of 0.5 m, the lower of 1 kg, the upper `ratio` times as heavy, touching, at rest."""
    builder = ModelBuilder()
    material = Material(friction=0.5)
    builder.add_shape_plane(WORLD, material=material, name="ground")
    builder.add_solid("light", "box", 0.25, mass=1.0, pose=pose((0.0, 0.0, 0.25)), material=material)
    builder.add_solid("heavy", "box", 0.25, mass=ratio, pose=pose((0.0, 0.0, 0.75)), material=material)
    return builder


def wall(*, rows: int = 5, columns: int = 6) -> ModelBuilder:
    """A gable wall in running bond: every row has one brick of 0.4 x 0.2 x 0.2 m and 1 kg less than the one below."""
    builder = ModelBuilder()
    material = Material(friction=0.6)
    builder.add_shape_plane(WORLD, material=material, name="ground")
    for row in range(rows):
        for column in range(columns - row):
            at = pose((0.4 * column + 0.2 * row, 0.0, 0.1 + 0.2 * row))
            builder.add_solid(f"brick{row}_{column}", "box", (0.2, 0.1, 0.1), mass=1.0, pose=at, material=material)
    return builder


def incline(*, angle: float = 0.3, friction: float = 0.5) -> ModelBuilder:
    """A box on a plane that is tilted by `angle` [rad] about Y: it slides down along +X, or sticks."""
    builder = ModelBuilder()
    material = Material(friction=friction)
    tilt = _about(1, angle)
    builder.add_shape_plane(WORLD, material=material, name="ground", pose=pose(rotation=tilt))
    at = pose(rotate(tilt, np.array([0.0, 0.0, 0.1])), tilt)
    builder.add_solid("box", "box", (0.2, 0.2, 0.1), mass=1.0, pose=at, material=material)
    return builder


def pile(
    *, side: int = 6, radius: float = 0.1, mass: float = 10.0, spacing: float = 0.21, height: float = 0.101,
    material: Material | None = None,
) -> ModelBuilder:  # fmt: skip
    """Balls on a cubic grid above the ground, the lowest centres at `height` [m]."""
    builder = ModelBuilder()
    surface = Material(friction=0.0) if material is None else material
    builder.add_shape_plane(WORLD, material=surface, name="ground")
    for index in range(side**3):
        i, j, k = index % side, index // side % side, index // side**2
        at = pose((spacing * i, spacing * j, height + spacing * k))
        builder.add_solid(f"ball{index}", "sphere", radius, mass=mass, pose=at, material=surface)
    return builder


def rolling_box() -> ModelBuilder:
    """A box of 20 x 20 x 1 m on the ground with 25 balls of 0.5 m radius on top of it, on a grid of 2 m."""
    builder = ModelBuilder()
    builder.add_shape_plane(WORLD, material=Material(friction=0.4), name="ground")
    material = Material(friction=0.8)
    box = pose((0.0, 0.0, 0.5))
    builder.add_solid("box", "box", (10.0, 10.0, 0.5), mass=10.0, pose=box, material=material)
    for index in range(25):
        at = pose((2.0 * (index % 5) - 4.0, 2.0 * (index // 5) - 4.0, 1.5))
        builder.add_solid(f"ball{index}", "sphere", 0.5, mass=1.0, pose=at, material=material)
    return builder


def card_house(*, levels: int = 3) -> ModelBuilder:
    """Cards of 0.1 x 0.14 x 0.004 m and 10 g: pairs that lean against each other by 15 degrees, flat ones between."""
    builder = ModelBuilder()
    material = Material(friction=0.6)
    builder.add_shape_plane(WORLD, material=material, name="ground")
    lean = math.radians(15.0)
    width, length, thickness = 0.1, 0.14, 0.004
    half = (0.5 * thickness, 0.5 * width, 0.5 * length)
    # a leaning card reaches from its lowest edge to its highest one over this much of x and z
    reach = length * math.sin(lean) + thickness * math.cos(lean)
    rise = length * math.cos(lean) + thickness * math.sin(lean)
    pitch = length  # flat cards end where two leaning ones meet
    floor = 0.0
    for level in range(levels):
        pairs = levels - level
        for pair in range(pairs):
            middle = (pair - 0.5 * (pairs - 1)) * pitch
            for side in (-1.0, 1.0):
                at = pose((middle + side * 0.5 * reach, 0.0, floor + 0.5 * rise), _about(1, -side * lean))
                name = f"card{level}_{pair}{'lr'[side > 0]}"
                builder.add_solid(name, "box", half, mass=0.01, pose=at, material=material)
        floor += rise
        if level + 1 < levels:
            for pair in range(pairs - 1):
                middle = (pair - 0.5 * (pairs - 2)) * pitch
                at = pose((middle, 0.0, floor + 0.5 * thickness))
                flat = (0.5 * length, 0.5 * width, 0.5 * thickness)
                builder.add_solid(f"flat{level}_{pair}", "box", flat, mass=0.01, pose=at, material=material)
            floor += thickness
    return builder


def arch(*, stones: int = 15, span: float = 3.0, thickness: float = 0.4, depth: float = 0.4) -> ModelBuilder:
    """A half circle of wedges between two fixed springers; friction 0.7, 1000 kg/m³."""
    builder = ModelBuilder()
    material = Material(friction=0.7)
    builder.add_shape_plane(WORLD, material=material, name="ground")
    inner, outer = 0.5 * span, 0.5 * span + thickness
    half_step = 0.5 * math.pi / stones
    # a stone at the top of the arch, about its centre
    wedge = [
        (r * math.sin(a), y, r * math.cos(a))
        for r in (inner, outer) for a in (-half_step, half_step) for y in (-0.5 * depth, 0.5 * depth)
    ]  # fmt: skip
    for stone in range(stones):
        angle = (2 * stone + 1) * half_step - 0.5 * math.pi
        builder.add_solid(
            f"stone{stone}", "hull", density=1000.0, points=wedge, pose=pose(rotation=_about(1, angle)),
            material=material,
        )  # fmt: skip
    return builder


def bouncing_balls(*, side: int = 7, height: float = 5.0, restitution: float = 1.0) -> ModelBuilder:
    """Balls of 0.1 m radius and 10 kg in a square, their centres `height` above the ground, without friction."""
    material = Material(friction=0.0, restitution=restitution)
    builder = ModelBuilder()
    builder.add_shape_plane(WORLD, material=material, name="ground")
    for index in range(side * side):
        at = pose((0.5 * (index % side), 0.5 * (index // side), height))
        builder.add_solid(f"ball{index}", "sphere", 0.1, mass=10.0, pose=at, material=material)
    return builder
