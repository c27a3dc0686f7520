"""Scenes whose contacts the float64 reference knows: balls, boxes, capsules on planes, balls on balls, limbs."""

from __future__ import annotations

from typing import Any

import numpy as np

import simwarp as sw
from simwarp.core.rotation import quat_multiply
from simwarp.core.types import Material
from simwarp.model.builder import ModelBuilder


def random_material(rng: np.random.Generator, kinds: str) -> Material:
    """A surface with the features of `kinds`: r(estitution) c(ompliance) h(cohesion) o(rolling and spinning)."""
    return Material(
        friction=float(rng.uniform(0.1, 0.6)),
        restitution=float(rng.uniform(0.3, 0.9)) if "r" in kinds else 0.0,
        compliance=float(10.0 ** rng.uniform(-5.0, -3.0)) if "c" in kinds else 0.0,
        damping=float(rng.uniform(0.0, 0.02)) if "c" in kinds else 0.0,
        cohesion=float(rng.uniform(1.0, 20.0)) if "h" in kinds else 0.0,
        rolling_friction=float(rng.uniform(0.001, 0.05)) if "o" in kinds else 0.0,
        spinning_friction=float(rng.uniform(0.001, 0.05)) if "o" in kinds else 0.0,
    )


def single(x: Any) -> Any:
    """Rounded to float32, as the parameters of shapes are: a rounded radius is a gap, and gaps are divided by h."""
    return np.float64(np.float32(x))


def quat(rng: np.random.Generator) -> np.ndarray:
    """A random rotation."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def heap(
    rng: np.random.Generator, kinds: str = "", bodies: int = 4, depth: float = 1e-3, *, boxes: bool = True
) -> ModelBuilder:
    """Free balls, boxes and capsules at or in the ground, a second ball on every ball; all moving."""
    builder = ModelBuilder()
    builder.add_shape_plane(material=random_material(rng, kinds), name="ground")
    for index in range(bodies):
        kind = ("sphere", "box" if boxes else "sphere", "capsule")[index % 3]
        size: Any = {
            "sphere": single(rng.uniform(0.1, 0.3)), "box": tuple(single(rng.uniform(0.1, 0.3, 3))),
            "capsule": tuple(single(rng.uniform(0.1, 0.3, 2))),
        }[kind]  # fmt: skip
        tilt = np.array([*rng.normal(size=2) * 0.003, rng.normal(), rng.normal()])
        turn = tilt / np.linalg.norm(tilt)
        if kind == "capsule":
            half_turn = sw.pose(rotation=(0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))).rotation
            turn = quat_multiply(turn, half_turn)
        height = size if kind == "sphere" else (size[2] if kind == "box" else size[0])
        mass = float(10.0 ** rng.uniform(-0.5, 0.5))
        speeds: dict[str, Any] = {"velocity": 0.5 * rng.normal(size=3), "omega": 2.0 * rng.normal(size=3)}
        at = np.array([1.5 * index, 0.0, height - depth * rng.uniform()])
        surface = random_material(rng, kinds)
        builder.add_solid(f"b{index}", kind, size, mass=mass, pose=sw.pose(at, turn), material=surface, **speeds)
        if kind == "sphere":
            top = float(single(rng.uniform(0.05, 0.2)))
            lean = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
            above = at + (size + top - depth * rng.uniform()) * lean
            builder.add_solid(
                f"t{index}", "sphere", top, mass=float(10.0 ** rng.uniform(-0.5, 0.5)), pose=sw.pose(above, quat(rng)),
                material=random_material(rng, kinds), velocity=0.5 * rng.normal(size=3), omega=2.0 * rng.normal(size=3),
            )  # fmt: skip
    return builder


def limb(rng: np.random.Generator, kinds: str = "", *, floating: bool = False) -> ModelBuilder:
    """A chain of three links on hinges with balls at their ends, on the ground; limits, dry friction and a motor."""
    builder = ModelBuilder()
    builder.add_shape_plane(material=random_material(rng, kinds), name="ground")
    radius, length = 0.08, 0.5
    previous, anchor = sw.WORLD, np.array([0.0, 0.0, radius])
    for index in range(3):
        centre = anchor + np.array([0.5 * length, 0.0, 0.0])
        body = builder.add_body(
            f"link{index}", mass=float(10.0 ** rng.uniform(-0.5, 0.5)), inertia=rng.uniform(0.01, 0.015, 3),
            pose=sw.pose(centre), velocity=(0.0, 0.0, 0.0),
        )  # fmt: skip
        tip = sw.pose((0.5 * length, 0.0, -1e-3 * rng.uniform()))
        builder.add_shape_sphere(body, radius=radius, pose=tip, material=random_material(rng, kinds), name=f"s{index}")
        options = (
            {"limit": (-0.5, 0.001)}, {"friction": 0.5}, {"drive": sw.VelocityMotor(effort_limit=3.0)},
        )[index]  # fmt: skip
        if not (floating and index == 0):
            axis = (0.0, 1.0, 0.0) if index != 1 else (0.1, 0.3, 1.0)
            builder.add_joint_revolute(f"hinge{index}", previous, body, axis=axis, anchor=anchor, **options)
        previous, anchor = body, anchor + np.array([length, 0.0, 0.0])
    return builder
