"""What ``simwarp ros2`` connects: vehicles, tasks, scenes and robots, each with the commands that it takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from simwarp.cli import UsageError
from simwarp.cli.ros.ros2_options import Ros2Options, Ros2TaskOptions
from simwarp.cli.view.view_target import ViewTarget
from simwarp.ros2.bridge import BridgeTarget
from simwarp.ros2.command_topics import CommandTopic, action_topic, joint_topic, velocity_topic

NO_BASE: Final = "it has no base that can be driven"
NEVER: Final = 1e9
"""Time between commands that a task draws by itself [s]."""


def vehicle_target(name: str, options: Ros2Options) -> BridgeTarget:
    """A vehicle on asphalt, driven by speeds and angles.

    Raises:
        ModelError: nothing drives its wheels, or there is no such sensor.
    """
    from simwarp.cli.drive.mounted_sensors import mounted_sensors
    from simwarp.cli.view.vehicle_subject import Additions, vehicle_subject
    from simwarp.ros2.vehicle_commands import VehicleCommands
    from simwarp.vehicle.tracks.tracked_vehicle import TRACK_SOLVER

    made: list[VehicleCommands] = []

    def before(vehicle: Any, spec: Any) -> Sequence[Any]:
        made.append(VehicleCommands(vehicle, spec, stamped=options.stamped))
        return [made[0].driver]

    def sensors(vehicle: Any, scene: Any) -> Sequence[Any]:
        return mounted_sensors(options.sensors, vehicle, scene, options.seed)

    subject = vehicle_subject(name, 1, options.device, Additions(before, sensors, TRACK_SOLVER))
    simulation, commands = subject.simulation, made[0]
    steps = round(subject.dt / simulation.dt)

    def advance(seen: Callable[[], None]) -> None:
        commands.advance(subject.dt)
        for _ in range(steps):
            simulation.step()
            seen()

    def reset(seed: int) -> None:
        subject.reset(None)
        commands.rest()

    return BridgeTarget(subject.name, simulation, subject.dt, advance, reset, commands.topics(), "it has no such topic")


def plain_target(target: ViewTarget, options: Ros2Options) -> BridgeTarget:
    """A scene or a robot's file, commanded joint by joint.

    Raises:
        UsageError: the target is a dump.
        ModelError: the file cannot be read.
    """
    from simwarp.cli.view.model_subjects import model_subject, scene_subject

    if target.kind == "dump":
        raise UsageError(f"ros2: '{target.name}' is a dump, which nobody commands; simwarp view shows it")
    if target.kind == "scene":
        subject = scene_subject(target.name, 1, options.device)
    else:
        from simwarp.cli.robots.robot_sources import RobotOptions

        given = RobotOptions(options.base, options.allow, options.packages, options.density)
        subject = model_subject(target.name, 1, options.device, given)
    simulation = subject.simulation
    steps = round(subject.dt / simulation.dt)

    def advance(seen: Callable[[], None]) -> None:
        for _ in range(steps):
            simulation.step()
            seen()

    joints = joint_topic(simulation, 0)
    commands = [] if joints is None else [joints]
    return BridgeTarget(
        subject.name, simulation, subject.dt, advance, lambda seed: subject.reset(None), commands, NO_BASE
    )


def task_target(name: str, arguments: list[str]) -> tuple[Any, Callable[[], BridgeTarget]]:
    """The options, and what makes the task with a policy.

    Raises:
        UsageError: an option is wrong, or the task has no bodies.
        InputError: there is no such policy, or a value of the configuration is wrong.
    """
    from simwarp.cli.options import config_of_variant, expand_shorthands, parse_options, task_options
    from simwarp.cli.view.policy_choice import find_actor
    from simwarp.tasks import task_class

    cls, word = task_class(name), name
    arguments = expand_shorthands(arguments, cls.name, cls.config_type())
    actor = find_actor(cls.name, arguments)
    options: Any = parse_options(
        task_options("Ros2Command", Ros2TaskOptions, task=actor.config or config_of_variant(arguments, cls)), arguments,
        f"simwarp ros2 {word}",
    )  # fmt: skip
    return options, lambda: _task(cls.name, actor, options)


def _task(name: str, actor: Any, options: Any) -> BridgeTarget:
    import dataclasses

    import torch

    from simwarp.cli.view.task_subject import TaskLoop
    from simwarp.tasks import make, resolve_device

    torch.set_num_threads(1)
    # commands come from outside now
    own = {"command_time": NEVER, "heading": False}
    known = {field.name for field in dataclasses.fields(options.task)}
    config = dataclasses.replace(options.task, **{key: value for key, value in own.items() if key in known})
    task = make(name, 1, device=resolve_device(options.device), seed=options.seed, config=config)
    simulation = task.simulation
    if simulation is None:
        raise UsageError(f"ros2: task '{name}' has no bodies, and so no topics; take one that has")
    loop = TaskLoop(task, actor.policy(task), options.seed)
    commands: list[CommandTopic] = []
    before: list[Callable[[], None]] = []
    speeds = task.commands()
    if {"ahead", "turn"} <= speeds.keys():
        commands.append(_speeds(speeds, before, options.stamped))
    commands.append(_actions(loop))

    def advance(seen: Callable[[], None]) -> None:
        for each in before:
            each()
        loop.advance()
        seen()

    def reset(seed: int) -> None:
        loop.restart(seed)
        for command in commands:
            if command.rest is not None:
                command.rest()

    refusal = "" if len(commands) > 1 else f"{NO_BASE} by speeds"
    return BridgeTarget(name, simulation, float(task.config.control_dt), advance, reset, commands, refusal, True)


def _speeds(speeds: Any, before: list[Callable[[], None]], stamped: bool) -> CommandTopic:
    """Speeds that a task's policy follows, within what it was trained for."""
    wanted = dict.fromkeys(speeds, 0.0)

    def move(ahead: float, left: float, turn: float) -> None:
        for name, value in (("ahead", ahead), ("left", left), ("turn", turn)):
            if name in speeds:
                wanted[name] = min(max(value, speeds[name].low), speeds[name].high)

    def write() -> None:
        for name, value in wanted.items():
            speeds[name].values[0] = value

    before.append(write)
    return velocity_topic(move, lambda: move(0.0, 0.0, 0.0), stamped=stamped, sideways="left" in speeds)


def _actions(loop: Any) -> CommandTopic:
    """Actions in the policy's place."""
    import torch

    task = loop.task
    given = torch.zeros(task.num_worlds, task.action_size, device=task.device)
    taken = [False]

    def act(values: list[float]) -> None:
        given[0] = torch.tensor(values)
        taken[0] = True

    def rest() -> None:
        taken[0] = False

    loop.overrides.append(lambda actions: given if taken[0] else actions)
    return action_topic(task.action_size, act, rest)
