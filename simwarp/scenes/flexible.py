"""Scenes with flexible bodies."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from simwarp.core.types import WORLD, Material, pose
from simwarp.flex import Clamp, Elastic, Round, Rubber, box
from simwarp.meshes.lattices import rectangle_of_triangles, revolved_triangles
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.model.builder import ModelBuilder

ROD_LENGTH: Final = 1.0
"""Of `rod` [m]."""
ROD_SECTION: Final = Round(diameter=0.02)
"""Of `rod`."""
ROD_MATERIAL: Final = Elastic(young=2.1e11, density=7850.0)
"""Of `rod`: steel."""


def rod(*, elements: int = 20, floor: bool = False) -> ModelBuilder:
    """A rod of steel, 1 m by 20 mm, clamped at one end or falling on a floor.

    Args:
        elements: of equal length.
        floor: drop it from 0.2 m, level, with friction 0.6.
    """
    builder = ModelBuilder()
    height = 0.2 if floor else 0.0
    if floor:
        builder.add_shape_plane()
    builder.add_rod(
        "rod", [(0.0, 0.0, height), (ROD_LENGTH, 0.0, height)], elements=elements, section=ROD_SECTION,
        material=ROD_MATERIAL, start=None if floor else Clamp(), surface=Material() if floor else None,
    )  # fmt: skip
    return builder


def rod_on_floor() -> ModelBuilder:
    """A rod of steel of 20 elements falls on a floor and lies there."""
    return rod(floor=True)


BLOCK_SIZE: Final = 0.1
"""Side of the block of `tetra` and `hexa` [m]."""
BLOCK_MATERIAL: Final = Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=1e-3)
"""Of that block."""
TIRE_RIM: Final = 0.35
"""Radius of the rim of `tire` [m]."""
TIRE_SECTION: Final = 0.195
"""Radius of the half circle that is its section [m]."""
TIRE_MATERIAL: Final = Elastic(young=9e7, poisson=0.3, density=500.0, damping_time=2e-3)
"""Of the tire."""


def tetra() -> ModelBuilder:
    """A block of soft rubber, 4 x 4 x 4 cells of five tetrahedra, falls on a floor."""
    return _block("tetrahedra")


def hexa() -> ModelBuilder:
    """A block of soft rubber, 4 x 4 x 4 hexahedra, falls on a floor."""
    return _block("hexahedra")


def _block(elements: Any) -> ModelBuilder:
    builder = ModelBuilder()
    builder.add_shape_plane(material=Material(friction=0.6))
    builder.add_solid_mesh(
        "block", box((BLOCK_SIZE,) * 3, 4, elements=elements), material=BLOCK_MATERIAL, pose=pose((0.0, 0.0, 0.1)),
        surface=Material(friction=0.6),
    )  # fmt: skip
    return builder


def shell() -> ModelBuilder:
    """A tarp of 1 m by 1 m, 11 x 11 nodes, falls on a box."""
    builder = ModelBuilder()
    builder.add_shape_plane(material=Material(friction=0.6))
    builder.add_shape_box(WORLD, half=(0.25, 0.25, 0.15), pose=pose((0.0, 0.0, 0.15)))
    points, triangles = rectangle_of_triangles((10, 10), (1.0, 1.0))
    builder.add_shell(
        "tarp", points - [0.5, 0.5, 0.0], triangles, thickness=1e-3, pose=pose((0.0, 0.0, 0.35)),
        material=Elastic(young=1e7, poisson=0.3, density=1000.0, damping_time=1e-3), radius=0.01,
        surface=Material(friction=0.6),
    )  # fmt: skip
    return builder


def tire() -> ModelBuilder:
    """A wheel with an inflated tire of rotation-free triangles, 45 x 8 cells, is dropped on a floor and rolls."""
    builder = ModelBuilder()
    builder.add_shape_plane(material=Material(friction=0.8))
    add_toroidal_tire(builder, "tire", around=45, across=8, pressure=1e5, height=0.56, speed=5.0)
    return builder


def add_toroidal_tire(
    builder: ModelBuilder, name: str, *, around: int, across: int, pressure: float, height: float, speed: float = 0.0
) -> FlexibleMesh:
    """A rim with a tire whose section is a half circle of one isotropic layer, 14 mm thick.

    Args:
        builder: gets the rim, a body `NAME:rim` of 20 kg whose axis is y, and the tire.
        name: of the tire.
        around, across: cells around the wheel and along the section.
        pressure: [Pa].
        height: of the axis [m].
        speed: at which it rolls along x at the start [m/s].
    """
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, across + 1)
    section = np.column_stack([TIRE_RIM + TIRE_SECTION * np.cos(angle), TIRE_SECTION * np.sin(angle)])
    inside = TIRE_RIM - np.pi * TIRE_SECTION / across
    # a row inside the rim beside each edge, glued too: the edges are clamped, not hinged
    section = np.vstack([[inside, -TIRE_SECTION], section, [inside, TIRE_SECTION]])
    points, triangles = revolved_triangles(section, around)
    row = np.arange(len(points)) % len(section)
    spin = (0.0, speed / (TIRE_RIM + TIRE_SECTION), 0.0)
    velocity = (speed, 0.0, 0.0)
    rim = builder.add_body(
        f"{name}:rim", mass=20.0, inertia=(1.0, 1.5, 1.0), pose=pose((0.0, 0.0, height)), velocity=velocity, omega=spin
    )
    return builder.add_shell(
        name, points, triangles, thickness=0.014, material=TIRE_MATERIAL, pressure=pressure,
        glue={rim: np.flatnonzero((row < 2) | (row > len(section) - 3))}, pose=pose((0.0, 0.0, height)), radius=0.007,
        surface=Material(friction=0.8), velocity=velocity, omega=spin,
    )  # fmt: skip
