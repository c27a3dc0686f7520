"""How far scenes with flexible bodies are from what theory or a finer mesh says: told beside their speeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Final

import numpy as np

from simwarp import scenes
from simwarp.core.types import WORLD, Material, PositionDrive
from simwarp.flex import Elastic, mesh_positions
from simwarp.meshes.lattices import rectangle_of_triangles
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.flexible_options import FlexibleOptions
from simwarp.simulation.simulation import Simulation


def rod_sag_error(device: str | None) -> float:
    """Of the clamped rod under its weight, against qL⁴/8EI + qL²/2kGA."""
    material, numbers, length = scenes.ROD_MATERIAL, scenes.ROD_SECTION.numbers, scenes.ROD_LENGTH
    shear = numbers.shear_z * numbers.area * material.young / (2.0 * (1.0 + material.poisson))
    load = material.density * numbers.area * 9.81
    sag = load * length**4 / (8.0 * material.young * numbers.inertia_y) + load * length**2 / (2.0 * shear)
    sim = Simulation(scenes.rod().finalize(1, device), 0.01, flex=FlexibleOptions(numerical_damping=1.0))
    sim.step(500)
    return abs(-float(sim.body_position("rod_20")[2]) / sag - 1.0)


def block_sag_error(build: Callable[[], ModelBuilder], device: str | None) -> float:
    """Of a rubber block on a floor without friction under its weight, against ρ g H² / 2E, from damped steps."""
    builder = build()
    builder.shapes[:] = [dataclasses.replace(each, material=Material(friction=0.0)) for each in builder.shapes]
    mesh = builder.flexible_meshes[0]
    sim = Simulation(builder.finalize(1, device), 5e-3, flex=FlexibleOptions(numerical_damping=1.0))
    sim.step(600)
    height = mesh_positions(sim, mesh).numpy()[0, :, 2]
    rest, stuff = scenes.BLOCK_SIZE, scenes.BLOCK_MATERIAL
    top = height[mesh.points[:, 2] > 0.49 * rest].mean() - height[mesh.points[:, 2] < -0.49 * rest].mean()
    sag = stuff.density * 9.81 * rest**2 / (2.0 * stuff.young)
    return float(abs((rest - top) / sag - 1.0))


def plate_error(device: str | None) -> float:
    """Of a simply supported square plate of 10 x 10 cells under pressure, against 0.00406235 p L⁴ / D."""
    builder = ModelBuilder((0.0, 0.0, 0.0))
    points, triangles = rectangle_of_triangles((10, 10), (1.0, 1.0))
    edge = np.flatnonzero((points[:, :2] == 0.0).any(axis=1) | (points[:, :2] == 1.0).any(axis=1))
    steel = Elastic(young=2.1e11, poisson=0.3, density=7850.0)
    mesh = builder.add_shell(
        "plate", points, triangles, thickness=0.01, material=steel, fixed=edge, pressure=100.0, double=True
    )
    sim = Simulation(builder.finalize(1, device), 5e-3, flex=FlexibleOptions(numerical_damping=1.0))
    sim.step(400)
    stiffness = steel.young * 0.01**3 / (12.0 * (1.0 - steel.poisson**2))
    found = mesh_positions(sim, mesh).numpy()[0, :, 2].max()
    return float(abs(found / (0.00406235 * 100.0 / stiffness) - 1.0))


CONVERGED_LOAD: Final = 3908.0
"""Of the tire of `scenes.tire` at 1 bar, pressed by 20 mm on a floor without friction, with 80 x 16 cells [N]."""


def tire_load_error(device: str | None) -> float:
    """Of the load on the tire, pressed by 20 mm on a floor without friction, against one of four times the cells."""
    builder = ModelBuilder((0.0, 0.0, 0.0))
    builder.add_shape_plane(material=Material(friction=0.0))
    mesh = scenes.add_toroidal_tire(builder, "tire", around=45, across=8, pressure=1e5, height=0.6)
    builder.add_joint_prismatic(
        "press", WORLD, mesh.owner, anchor=(0.0, 0.0, 0.6), axis=(0.0, 0.0, 1.0),
        drive=PositionDrive(stiffness=1e8, damping=1e5),
    )  # fmt: skip
    sim = Simulation(builder.finalize(1, device), 1e-3, flex=FlexibleOptions(numerical_damping=1.0))
    sim.step(300)
    low = float(mesh_positions(sim, mesh).numpy()[0, :, 2].min()) - 0.007
    sim.control.joint_target_q.assign(np.array([[-low - 0.02]], np.float32))
    sim.step(400)
    load = sim.contacts.body_contact_force.numpy()[0, :, 2].sum()
    return float(abs(load / CONVERGED_LOAD - 1.0))
