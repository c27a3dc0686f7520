"""From a name or a file on the command line to what a page shows."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from simwarp.cli import UsageError
from simwarp.cli.listing import catalogue
from simwarp.cli.robots.robot_sources import Base
from simwarp.core.types import Material
from simwarp.core.wording import close_names
from simwarp.model.builder import ModelBuilder
from simwarp.sensors.scene import Visuals
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.default_appearance import add_bodies, paint
from simwarp.viewer.live.subject import Mask, Subject
from simwarp.viewer.studio import Shot

MODEL_FILES = (".xml", ".urdf", ".usd", ".usda", ".usdc", ".stp", ".step", ".py")
DUMPS = (".npz",)
FRAME = 1.0 / 60.0
"""Time of one step of the page where nobody controls the simulation [s]."""


@dataclasses.dataclass(frozen=True)
class ViewTarget:
    """What was asked for.

    Attributes:
        kind: task, vehicle, scene, model or dump.
        name: of it, or path of its file.
    """

    kind: str
    name: str


def find_target(name: str, tasks: Callable[[], list[str]]) -> ViewTarget:
    """What a TARGET means; tasks, which take long to find, come last.

    Raises:
        UsageError: nothing has that name.
    """
    from simwarp.vehicle.spec.vehicle_files import vehicle_names

    path = Path(name)
    suffix = path.suffix.lower()
    if suffix in MODEL_FILES:
        return ViewTarget("model", name)
    if suffix in DUMPS:
        return ViewTarget("dump", name)
    if suffix == ".json":
        return ViewTarget("model" if _is_model(path) else "vehicle", name)
    if name in vehicle_names():
        return ViewTarget("vehicle", name)
    scenes = catalogue("simwarp.scenes")
    known = tasks()
    if name in known:
        return ViewTarget("task", name)
    if name in scenes:
        return ViewTarget("scene", name)
    close = close_names(name, [*known, *vehicle_names(), *scenes])
    hint = f"; did you mean {' or '.join(close)}?" if close else ";"
    raise UsageError(
        f"nothing is called '{name}'{hint} `simwarp list` shows all, and model files end in {', '.join(MODEL_FILES)} or"
        " .json"
    )


def _is_model(path: Path) -> bool:
    """Whether a .json file is a model of ours; else it is taken for a vehicle."""
    try:
        head = path.read_text(encoding="utf-8", errors="replace")[:400]
    except OSError:
        return False
    return '"chassis"' not in head and "simwarp" in head


def scene_subject(name: str, worlds: int, device: str) -> Subject:
    """A scene of `simwarp.scenes`; its motors and drives rest as built."""
    import simwarp.scenes as scenes

    builder: ModelBuilder = getattr(scenes, name.replace("-", "_"))()
    return simple_subject(name, builder, worlds, device)


def model_subject(path: str, worlds: int, device: str, *, base: Base | None, allow: tuple[str, ...]) -> Subject:
    """A robot from a file, with a floor under it where it has none, in its keyframe `home` or its first one."""
    from simwarp.cli.robots.robot_sources import RobotOptions, load_file

    _, robot = load_file(Path(path), RobotOptions(base, allow))
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
    simulation = Simulation(model, dt, elements=list(elements.values()))
    start = _start_of(robot)

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
        name, simulation, scene, steps * dt, lambda: simulation.advance(steps), reset, Shot(), elements=elements
    )


def _start_of(robot: Any) -> Any:
    if robot is None or not robot.keyframes:
        return None
    key = robot.keyframes.get("home") or next(iter(robot.keyframes.values()))
    return np.asarray(key.q, np.float32)
