"""Topics that a target is commanded by: what their messages must hold, and what is done with them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from simwarp.actuators import Actuators, Law, Target
from simwarp.core.types import DriveMode, ModelError, formatted
from simwarp.core.wording import suggestion
from simwarp.model.joint_types import ELEMENTS
from simwarp.simulation.simulation import Simulation

CMD_VEL: Final = "/cmd_vel"
ACKERMANN: Final = "/ackermann_cmd"
JOINTS: Final = "/joint_commands"
ACTIONS: Final = "/actions"
TWIST: Final = "geometry_msgs/msg/Twist"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
ACKERMANN_STAMPED: Final = "ackermann_msgs/msg/AckermannDriveStamped"
JOINT_STATE: Final = "sensor_msgs/msg/JointState"
NUMBERS: Final = "std_msgs/msg/Float64MultiArray"
FIELDS: Final = ("position", "velocity", "effort")
MOST_NAMED: Final = 12
"""Joints that an error lists."""

Apply: TypeAlias = Callable[[], None]


class CommandError(ModelError):
    """A message that cannot be done; the text is one line and begins with its topic."""


@dataclasses.dataclass(frozen=True)
class CommandTopic:
    """A topic with commands.

    Attributes:
        topic: its name.
        kind: type of its messages.
        read: checks a message and returns what does it; raises `CommandError`.
        rest: what is done where no command comes any more; None: the last one goes on.
    """

    topic: str
    kind: str
    read: Callable[[Any], Apply]
    rest: Apply | None = None


def checked_numbers(topic: str, field: str, values: Any) -> list[float]:
    """Numbers of a message, all of them finite.

    Raises:
        CommandError: one is not.
    """
    found = [float(value) for value in np.atleast_1d(values)]
    for index, value in enumerate(found):
        if not math.isfinite(value):
            place = field if len(found) == 1 else f"{field}[{index}]"
            raise CommandError(f"{topic}: {place} must be finite, got {value:g}; the message was left out")
    return found


def velocity_topic(
    move: Callable[[float, float, float], None], rest: Apply, *, stamped: bool, sideways: bool
) -> CommandTopic:
    """`/cmd_vel` for what moves by speeds ahead and to the left [m/s] and a turn to the left [rad/s].

    Args:
        move: takes them.
        rest: what is done where no command comes any more.
        stamped: messages are TwistStamped.
        sideways: it can move to the left, too; otherwise such commands are refused.
    """

    def read(message: Any) -> Apply:
        twist = message.twist if stamped else message
        (ahead,) = checked_numbers(CMD_VEL, "linear.x", twist.linear.x)
        (left,) = checked_numbers(CMD_VEL, "linear.y", twist.linear.y)
        (turn,) = checked_numbers(CMD_VEL, "angular.z", twist.angular.z)
        if left != 0.0 and not sideways:
            raise CommandError(f"{CMD_VEL}: linear.y must be 0, got {left:g}; this base does not move sideways")
        return lambda: move(ahead, left, turn)

    return CommandTopic(CMD_VEL, TWIST_STAMPED if stamped else TWIST, read, rest)


def action_topic(size: int, act: Callable[[list[float]], None], rest: Apply) -> CommandTopic:
    """`/actions` of a task: as many numbers as an action has.

    Args:
        size: of an action.
        act: takes them.
        rest: the policy acts again.
    """

    def read(message: Any) -> Apply:
        values = list(message.data)
        if len(values) != size:
            raise CommandError(f"{ACTIONS}: data must hold {size} numbers, got {len(values)}; give a whole action")
        numbers = checked_numbers(ACTIONS, "data", values)
        return lambda: act(numbers)

    return CommandTopic(ACTIONS, NUMBERS, read, rest)


def joint_topic(simulation: Simulation, world: int) -> CommandTopic | None:
    """`/joint_commands` of a simulation's joints of one coordinate; None: it has none."""
    commands = JointCommands(simulation, world)
    return CommandTopic(JOINTS, JOINT_STATE, commands.read) if commands.columns else None


class JointCommands:
    """Writes commands of joints by name: targets of their drives or servos, and efforts.

    Args:
        simulation: whose joints they are.
        world: that is commanded.

    Attributes:
        columns: joint -> column of its coordinate.
    """

    def __init__(self, simulation: Simulation, world: int) -> None:
        model, control = simulation.model, simulation.control
        self._modes = [each.mode for each in model.effort_models]
        self._world = world
        self.columns = {
            model.joint_names[index]: model.joint_dof_start[index]
            for index, kind in enumerate(model.joint_types) if len(ELEMENTS[kind].dofs) == 1
        }  # fmt: skip
        self._arrays: dict[str, Any] = {
            "position": control.joint_target_q, "velocity": control.joint_target_qd, "effort": control.joint_force,
        }  # fmt: skip
        self._servos: dict[tuple[int, str], tuple[Actuators, int]] = {}
        for element in simulation.elements:
            if not isinstance(element, Actuators):
                continue
            for index, spec in enumerate(element.specs):
                if spec.law is Law.SERVO:
                    field = "position" if spec.target is Target.POSITION else "velocity"
                    self._servos[spec.terms[0][0], field] = element, index

    def read(self, message: Any) -> Apply:
        """Checks a JointState: names of joints, and for each a position, velocity or effort, or several of them.

        Raises:
            CommandError: a joint is not there or is there twice, a list is too short or too long, or a joint does not
                take such a command.
        """
        names = list(message.name)
        if not names:
            raise CommandError(f"{JOINTS}: name must hold joints, got none; name those that are commanded")
        for index, name in enumerate(names):
            if name not in self.columns:
                hint = suggestion(name, self.columns, f"they are {', '.join(list(self.columns)[:MOST_NAMED])}")
                raise CommandError(f"{JOINTS}: no joint of one coordinate is called {formatted(name)}; {hint}")
            if name in names[:index]:
                raise CommandError(f"{JOINTS}: name must hold each joint once, got {formatted(name)} twice")
        columns = [self.columns[name] for name in names]
        given: dict[str, list[float]] = {}
        for field in FIELDS:
            values = list(getattr(message, field))
            if not values:
                continue
            if len(values) != len(names):
                raise CommandError(
                    f"{JOINTS}: {field} must hold {len(names)} numbers, one for each name, or none, got {len(values)}"
                )
            given[field] = checked_numbers(JOINTS, field, values)
            for name, column in zip(names, columns, strict=True):
                self._check(name, column, field)
        if not given:
            raise CommandError(f"{JOINTS}: must hold position, velocity or effort, got none of them; give one")
        return lambda: self._write(columns, given)

    def _check(self, name: str, column: int, field: str) -> None:
        """Whether a coordinate takes such a command: otherwise it would do nothing, and nobody would know why."""
        mode = self._modes[column]
        if (column, field) in self._servos:
            return
        if field == "effort":
            good = mode < DriveMode.PRESCRIBED_POSITION
            why = "its motion is prescribed; leave effort out"
        elif field == "position":
            good = mode in (DriveMode.POSITION, DriveMode.PRESCRIBED_POSITION)
            why = "it has no drive for positions; send effort, or give it a PositionDrive"
        else:
            good = mode in (DriveMode.POSITION, DriveMode.VELOCITY, DriveMode.PRESCRIBED_SPEED)
            why = "it has no drive for velocities; send effort, or give it a drive"
        if not good:
            raise CommandError(f"{JOINTS}: joint {formatted(name)} takes no {field}: {why}")

    def _write(self, columns: Sequence[int], given: dict[str, list[float]]) -> None:
        for field, values in given.items():
            for column, value in zip(columns, values, strict=True):
                servo = self._servos.get((column, field))
                if servo is None:
                    self._arrays[field][self._world, column] = value
                    continue
                actuators, index = servo
                spec = actuators.specs[index]
                offset = spec.length_offset if field == "position" else 0.0
                actuators.ctrl[self._world, index] = spec.terms[0][1] * value + offset
