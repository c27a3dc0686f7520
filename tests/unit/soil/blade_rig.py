"""A blade that is pushed along a line through soil by a carriage too heavy to slow down."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import simwarp as sw
from simwarp.soil import Soil, SoilBlade

HEAVY = 1.0e7
"""Mass of the carriage [kg]."""


def pushed(
    depth: float, *, soil: Any = "sand", rake: float = 0.5 * math.pi, speed: float = 0.5, width: float = 1.0,
    height: float = 0.4, spacing: float = 0.05, dt: float = 1e-3, yaw: float = 0.0, roll: float = 0.0, worlds: int = 1,
    mass: float = HEAVY, climb: float = 0.0, pages: int = 2048, **blade: float,
) -> tuple[sw.Simulation, Soil]:  # fmt: skip
    """A simulation in which a blade moves along its heading, and its soil; `climb` is how much it rises on the way."""
    builder = sw.ModelBuilder()
    lean, level = math.sin(0.5 * roll), math.cos(0.5 * roll)
    ahead, aside = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    turn = (lean * ahead, lean * aside, level * aside, level * ahead)
    body = builder.add_body("blade", mass=mass, inertia=(mass,) * 3, pose=sw.pose((0.0, 0.0, 0.5), turn))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(math.cos(yaw), math.sin(yaw), climb))
    model = builder.finalize(worlds, "cpu")
    edge = sw.pose((0.0, 0.0, -0.5 - depth))
    shape = SoilBlade(body=body, width=width, height=height, rake=rake, pose=edge, **blade)
    element = Soil(model, [shape], soil, spacing=spacing, pages=pages)
    simulation = sw.Simulation(model, dt, elements=[element], threads=1)
    simulation.state.joint_qd.fill_(speed)
    simulation.control.body_force.fill_((0.0, 0.0, 9.81 * mass))  # on a line that climbs it would roll back
    velocity = np.zeros((worlds, 1, 3))
    velocity[:, 0] = speed * np.array([math.cos(yaw), math.sin(yaw), climb]) / math.hypot(1.0, climb)
    simulation.state.body_v.assign(velocity.astype(np.float32))
    return simulation, element


def volumes(element: Soil, world: int = 0) -> tuple[float, float, float]:
    """Volume that was cut and volume that lies above the ground [m³], both positive, and what waits to be put."""
    memory = {name: array.numpy()[world] for name, array in element.memory.items()}
    cell = element.spacing**2
    raised = memory["raised"][: 64 * int(memory["count"])].astype(float) * cell
    return -raised[raised < 0.0].sum(), raised[raised > 0.0].sum(), float(memory["pending"].astype(float).sum()) * cell
