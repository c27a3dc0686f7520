"""Random models with contacts: bodies of every convex shape, free or in trees of random joints, on a plane."""

from __future__ import annotations

from typing import Any

import numpy as np

import simwarp as sw
from simwarp.core.types import Material, ShapeType
from simwarp.model.builder import ModelBuilder

KINDS = [
    ShapeType.SPHERE, ShapeType.CAPSULE, ShapeType.CYLINDER, ShapeType.BOX, ShapeType.ELLIPSOID, ShapeType.CONE,
    ShapeType.HULL,
]  # fmt: skip
JOINTS = ["fixed", "revolute", "prismatic", "spherical", "cylindrical", "universal", "planar"]
MOST_SPEED = 100.0


def unit(rng: np.random.Generator, length: int = 3) -> np.ndarray:
    """A random direction, or with length 4 a random rotation."""
    q = rng.normal(size=length)
    return q / np.linalg.norm(q)


def random_surface(rng: np.random.Generator, scale: float) -> Material:
    """Any friction; half of them bounce, some roll hard, some stick or yield."""
    return Material(
        friction=float(rng.choice([0.0, rng.uniform(0.0, 1.5)], p=[0.1, 0.9])),
        restitution=float(rng.choice([0.0, rng.uniform()])),
        rolling_friction=float(rng.choice([0.0, 0.01 * scale], p=[0.8, 0.2])),
        spinning_friction=float(rng.choice([0.0, 0.01 * scale], p=[0.8, 0.2])),
        cohesion=float(rng.choice([0.0, rng.uniform()], p=[0.9, 0.1])),
        compliance=float(rng.choice([0.0, 10.0 ** rng.uniform(-6.0, -3.0)], p=[0.8, 0.2])),
    )


def add_joint(builder: ModelBuilder, rng: np.random.Generator, parent: int, child: int, anchor: np.ndarray) -> None:
    """One of JOINTS, with whatever acts along its coordinates."""
    kind = str(rng.choice(JOINTS))
    name = f"joint{child}"
    if kind == "fixed":
        builder.add_joint_fixed(name, parent, child, anchor=anchor)
    elif kind in ("revolute", "prismatic"):
        choices: list[dict[str, Any]] = [
            {}, {"limit": (-0.5, 0.5)}, {"friction": 0.1}, {"damping": 0.1, "stiffness": 1.0},
            {"drive": sw.VelocityMotor(effort_limit=1.0)},
        ]  # fmt: skip
        options = choices[rng.integers(5)]
        getattr(builder, f"add_joint_{kind}")(name, parent, child, axis=unit(rng), anchor=anchor, **options)
    elif kind == "spherical":
        builder.add_joint_spherical(name, parent, child, anchor=anchor)
    elif kind == "universal":
        axis = unit(rng)
        across = np.cross(axis, unit(rng))
        builder.add_joint_universal(name, parent, child, anchor=anchor, axis0=axis, axis1=across)
    elif kind == "cylindrical":
        builder.add_joint_cylindrical(name, parent, child, anchor=anchor, axis=unit(rng))
    else:
        builder.add_joint_planar(name, parent, child, anchor=anchor, normal=unit(rng))


def random_scene(seed: int) -> tuple[ModelBuilder, float]:
    """A model and a time step that suits its size: masses 1e-3 to 1e3 kg, sizes of one scale from 1e-2 to 1e2 m."""
    rng = np.random.default_rng(seed)
    scale = float(10.0 ** rng.uniform(-2.0, 2.0))
    spread = float(rng.choice([0.3, 1.0, 3.0]))
    speed = min(float(10.0 ** rng.uniform(-1.0, 2.0)) * min(scale, 1.0), MOST_SPEED)
    count = int(rng.integers(2, 9))
    builder = ModelBuilder()
    builder.add_shape_plane(name="ground", material=random_surface(rng, scale))
    overlap = float(rng.choice([0.6, 1.0, 1.3]))
    for index in range(count):
        kind = KINDS[rng.integers(len(KINDS))]
        extent = scale * rng.uniform(0.5, 1.0, 3)
        points = scale * rng.uniform(-1.0, 1.0, (12, 3)) if kind == ShapeType.HULL else None
        size = {ShapeType.SPHERE: extent[0], ShapeType.HULL: None}.get(kind, tuple(extent))
        if kind in (ShapeType.CAPSULE, ShapeType.CYLINDER, ShapeType.CONE):
            size = tuple(extent[:2])
        at = overlap * 2.2 * scale * np.array([index % 2, index // 2 % 2, 0.5 + index // 4])
        mass = float(np.clip(10.0 ** rng.uniform(-spread, spread), 1e-3, 1e3))
        body = builder.add_solid(
            f"b{index}", kind, size, mass=mass, points=points, pose=sw.pose(at, unit(rng, 4)),
            material=random_surface(rng, scale), velocity=speed * rng.uniform(-0.5, 0.5, 3),
            omega=min(speed / scale, 50.0) * rng.uniform(-0.5, 0.5, 3),
        )  # fmt: skip
        if index > 0 and rng.uniform() < 0.5:
            parent = int(rng.integers(-1, body))
            other = at if parent == sw.WORLD else np.asarray(builder.bodies[parent].pose.position)
            add_joint(builder, rng, parent, body, 0.5 * (at + other))
    return builder, float(np.clip(2e-3 * np.sqrt(scale), 5e-4, 5e-3))


def random_speeds(builder: ModelBuilder, world: int) -> np.ndarray:
    """(B, 3) velocities that world `world` adds to those as built."""
    rng = np.random.default_rng(1000 + world)
    built = np.array([body.velocity for body in builder.bodies])
    return 0.3 * np.abs(built).max() * rng.normal(size=built.shape)
