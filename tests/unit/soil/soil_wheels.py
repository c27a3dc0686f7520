"""Wheels and discs on soil, for tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp

import simwarp as sw
from simwarp.soil import Soil, SoilSpec, SoilWheel

RADIUS, WIDTH = 0.467, 0.254
GRAVITY = 9.81
ON_ITS_SIDE = (math.sin(0.25 * math.pi), 0.0, 0.0, math.cos(0.25 * math.pi))
"""Turns a wheel's axis, y, to the vertical: a disc."""


def pressed(
    soil: SoilSpec | str, *, load: float, worlds: int = 1, spacing: float = 0.05, dt: float = 1e-3,
    seconds: float = 6.0, radius: float = RADIUS, width: float = WIDTH, disc: bool = False,
    place: tuple[float, float] = (0.003, 0.001),
) -> tuple[sw.Simulation, Soil]:  # fmt: skip
    """A wheel (or a disc) that slides along the vertical, its weight put on slowly, at rest."""
    builder = sw.ModelBuilder()
    mass = load / GRAVITY
    low = 0.5 * width if disc else radius
    start = sw.pose((*place, low), ON_ITS_SIDE) if disc else sw.pose((*place, low))
    body = builder.add_body("wheel", mass=mass, inertia=(0.1 * mass,) * 3, pose=start)
    builder.add_joint_prismatic("up", sw.WORLD, body, axis=(0, 0, 1))
    model = builder.finalize(worlds, "cpu")
    element = Soil(model, [SoilWheel(body="wheel", radius=radius, width=width)], soil, spacing=spacing)
    simulation = sw.Simulation(model, dt, elements=[element], threads=1)
    steps = round(seconds / dt)
    for step in range(0, steps, 10):
        rest = load * max(0.0, 1.0 - step / (0.8 * steps))
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, rest))
        simulation.step(10)
    return simulation, element


def sinkage(simulation: sw.Simulation, start: float) -> float:
    """How far the body of world 0 went down [m]."""
    return start - float(simulation.state.body_x.numpy()[0, 0, 2])


def rolling(
    worlds: int = 1, *, soil: SoilSpec | str = "mid", dt: float = 1e-3, speed: float = 1.0, torque: float = 0.0,
    direction: float = 0.0, threads: int = 1, **options: Any,
) -> tuple[sw.Simulation, Soil]:  # fmt: skip
    """A loose wheel of 650 kg that rolls, dropped from the surface, heading along `direction` [rad] from +X."""
    builder = sw.ModelBuilder()
    mass = 650.0
    turn = (0.0, 0.0, math.sin(0.5 * direction), math.cos(0.5 * direction))
    ahead = np.array([math.cos(direction), math.sin(direction), 0.0])
    side = np.array([-math.sin(direction), math.cos(direction), 0.0])
    body = builder.add_body("wheel", mass=mass, inertia=(20.0, 30.0, 20.0), pose=sw.pose((0.0, 0.0, RADIUS), turn))
    model = builder.finalize(worlds, "cpu")
    element = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)], soil, **options)
    simulation = sw.Simulation(model, dt, elements=[element], threads=threads)
    simulation.state.body_v.fill_(wp.vec3(*(speed * ahead)))
    simulation.state.body_omega.fill_(wp.vec3(*(speed / RADIUS * side)))
    simulation.measure()
    simulation.keep_as_initial()
    simulation.control.body_torque.fill_(wp.vec3(*(torque * side)))
    return simulation, element
