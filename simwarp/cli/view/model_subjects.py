"""Simulations that no task controls, as a page shows them: scenes and robots from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from simwarp.cli.robots.robot_sources import RobotOptions, load_file
from simwarp.core.types import Material
from simwarp.model.builder import ModelBuilder
from simwarp.sensors.scene import Visuals
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.default_visuals import add_bodies, paint
from simwarp.viewer.live.controls.joint_coordinates import joint_series
from simwarp.viewer.live.hand import with_hand
from simwarp.viewer.live.subject import Mask, Subject
from simwarp.viewer.studio import Shot

FRAME = 1.0 / 60.0
"""Time of one step of the page where nobody controls the simulation [s]."""


def scene_subject(name: str, worlds: int, device: str) -> Subject:
    """A scene of `simwarp.scenes`; its motors and drives rest as built."""
    import simwarp.scenes as scenes

    builder: ModelBuilder = getattr(scenes, name.replace("-", "_"))()
    return simple_subject(name, builder, worlds, device)


def model_subject(path: str, worlds: int, device: str, options: RobotOptions) -> Subject:
    """A robot from a file, with a floor under it where it has none, in its keyframe `home` or its first one."""
    _, robot = load_file(Path(path), options)
    visuals = Visuals(robot.builder)
    robot.add_visuals(visuals)
    return simple_subject(Path(path).stem, robot.builder, worlds, device, visuals=visuals, floor=True, robot=robot)


def simple_subject(
    name: str, builder: ModelBuilder, worlds: int, device: str, *, visuals: Visuals | None = None, floor: bool = False,
    robot: Any = None, dt: float = 1e-3,
) -> Subject:  # fmt: skip
    """A builder's worlds without a policy."""
    from simwarp.actuators import Actuators
    from simwarp.core.types import ShapeType
    from simwarp.model.model import resolve_device

    seen = Visuals(builder) if visuals is None else visuals
    grounded = any(shape.type in (ShapeType.PLANE, ShapeType.HEIGHT_FIELD) for shape in builder.shapes)
    if floor and not grounded:
        builder.add_shape_plane(name="floor", material=Material(friction=1.0))
    if not any(instance.body >= 0 for instance in seen.instances):
        add_bodies(seen)
    paint(seen)
    model = builder.finalize(world_count=worlds, device=resolve_device(None if device == "auto" else device))
    elements: dict[str, Any] = {}
    if robot is not None and robot.actuators:
        elements["actuators"] = Actuators(model, robot.actuators)
    start = _start_of(robot)
    acting = [*elements.values(), *with_hand(model)]
    simulation = Simulation(model, dt, elements=acting, check_start=start is None)

    def reset(mask: Mask | None) -> None:
        simulation.reset(mask)
        if start is not None:
            count = model.world_count
            chosen = np.ones(count, bool) if mask is None else mask
            simulation.set_joint_state(chosen, np.tile(start, (count, 1)), np.zeros((count, model.dof_count)))

    reset(None)
    steps = max(1, round(FRAME / dt))
    scene = seen.finalize(model)
    return Subject(
        name, simulation, scene, steps * dt, lambda: simulation.advance(steps), reset, Shot(), elements=elements,
        series=joint_series(simulation),
    )  # fmt: skip


def _start_of(robot: Any) -> Any:
    if robot is None or not robot.keyframes:
        return None
    key = robot.keyframes.get("home") or next(iter(robot.keyframes.values()))
    return np.asarray(key.q, np.float32)
