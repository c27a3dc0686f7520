"""All topics of one world: what is new after a step, as messages with their stamps, to a file or to ROS 2."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, Final, Protocol

import numpy as np
import warp as wp

from simwarp.core.types import ModelError, formatted
from simwarp.model.checks import checked_index, whole_number
from simwarp.ros2.frame_names import MAP, ODOM, Names, topic_word
from simwarp.ros2.ros_messages import SECOND, MessageTypes, Template
from simwarp.ros2.sensor_topics import Context, Output, mount_of, optical_rotation, outputs_of
from simwarp.ros2.state_topics import (
    body_frames,
    named_numbers,
    state_topics,
    transform_paths,
    transforms,
    vehicles_of,
)
from simwarp.ros2.world_rows import row_of
from simwarp.simulation.attachments import Sensor
from simwarp.simulation.simulation import Simulation

RATE: Final = 50.0
"""Of the topics of the state [Hz]."""
NEAR: Final = 1e-6
"""Of a step, that its time may be off by rounding."""
COMMANDS: Final = "/commands"
NOWHERE: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class MessageSink(Protocol):
    """Where messages go."""

    def channel(self, topic: str, kind: str, *, latched: bool = False) -> int:
        """A new topic with messages of a type; its last message is for those who come later, too, where `latched`."""
        ...

    def write(self, channel: int, template: Template, time: int) -> None:
        """Takes a message as it is now, delivered at a time [ns]; its memory is written into again afterwards."""
        ...


class WorldTopics:
    """The topics of a world: its clock, transforms, odometry, joints, vehicles, and all frames of its sensors.

    Nothing in the simulation changes by it. Time goes on where a world is reset: an episode begins where the last one
    ended.

    Args:
        sink: where messages go.
        thing: what errors begin with.
        simulation: whose world it is.
        world: which.
        rate: of the topics of the state [Hz]. Sensors come at rates of their own.
        base: body of the frame `base_link`, by name or index; None: the chassis of the first vehicle, else body 0.
        without: topics of the state that are left out.

    Attributes:
        left_out: names of sensors of classes that have no message.

    Raises:
        ModelError: there is no such world or body, or no such rate.
    """

    def __init__(
        self, sink: MessageSink, simulation: Simulation, *, thing: str, world: int = 0, rate: float = RATE,
        base: str | int | None = None, without: Collection[str] = (),
    ) -> None:  # fmt: skip
        model = simulation.model
        self._thing, self._sink, self._world = thing, sink, checked_world(thing, simulation, world)
        body = base_of(thing, simulation, base)
        self._period = 1.0 / checked_rate(thing, rate)
        self._time = row_of(simulation.state.world_time, self._world)
        self._dt, self._substeps = simulation.dt, simulation.substeps
        self._offset, self._last, self._step, self._next = 0, math.inf, 0.0, 0.0
        self._spacing = math.inf
        """Of the times at which it might be called, where not each of them is one at which it is [s]."""
        names = Names(MAP, ODOM, "base_link")
        frames = body_frames(model, body, names)
        self._types = types = MessageTypes()
        self._clock = _Channel(sink, "/clock", "rosgraph_msgs/msg/Clock", types.template(
            "rosgraph_msgs/msg/Clock", {}
        ))  # fmt: skip
        self._state = [
            (_Channel(sink, each.topic, each.kind, each.template), each.fill)
            for each in state_topics(types, simulation, self._world, frames, body)
            if each.topic not in without
        ]
        self._sensors, words = [], Names()
        self.left_out: list[str] = []
        mounted: list[tuple[str, str, Any]] = [(MAP, ODOM, None)]
        for sensor in simulation.sensors:
            word = words(topic_word(sensor.name))
            frame = names(f"{word}_link")
            outputs = outputs_of(sensor, Context(types, self._world, word, frame))
            mount = mount_of(sensor)
            if not outputs:
                self.left_out.append(sensor.name)
                continue
            self._sensors.append(_SensorChannels(sink, sensor, outputs, self._world))
            if mount is not None:
                mounted.append((frames[mount.body] if mount.body >= 0 else MAP, frame, mount))
            turn = optical_rotation(sensor)
            if turn is not None:
                mounted.append((frame, names(f"{word}_optical_frame"), turn))
        self._static = _StaticFrames(sink, types, mounted, self._world)
        self._commands: tuple[tuple[str, ...], _Channel] | None = None

    @property
    def elapsed(self) -> float:
        """Time from the beginning to the last call of `add` [s]."""
        return self._offset / SECOND + self._last

    @property
    def missed(self) -> dict[str, int]:
        """Frames that came and went between two calls of `add`, by the sensor's name; 0: none was lost."""
        return {each.sensor.name: each.missed for each in self._sensors}

    def steps_to_next(self) -> int:
        """Steps until there is something to send, at least 1, if no world is reset before."""
        self._spacing = self._dt
        if not math.isfinite(self._last):
            return 1
        steps = max(math.ceil((self._next - self._last) / self._dt - 0.5 - NEAR), 1)
        for sensor in self._sensors:
            if steps == 1:
                break
            steps = min(steps, sensor.steps_to_next(self._substeps))
        return steps

    def add(self, commands: Mapping[str, float] | None = None) -> None:
        """Sends what is new: frames of sensors, and the state where it is due. To be called after every step.

        Args:
            commands: numbers by name for the topic `/commands`; the same names in every call.

        Raises:
            ModelError: names of the commands have changed.
        """
        time = float(self._time())
        if time < self._last:
            self._begin(time)
            moved = True
        else:
            moved = time > self._last
            self._step = time - self._last if moved else self._step
        self._last = time
        fresh = [sensor for sensor in self._sensors if sensor.is_new()]
        # Half a step early is as near as half a step late
        due = moved and time + 0.5 * min(self._step, self._spacing) >= self._next
        if not (due or fresh or commands is not None):
            return
        now = self._offset + round(time * SECOND)
        self._clock.write(now, now)
        if due:
            self._static.refresh(now)
        for sensor in fresh:
            sensor.write(now, self._offset)
        if due:
            for channel, fill in self._state:
                fill()
                channel.write(now, now)
            self._next = max(self._next + self._period, time + 0.5 * self._period)
        if commands is not None:
            self._write_commands(commands, now)

    def _begin(self, time: float) -> None:
        """An episode: the time of the messages goes on where that of the world went back."""
        if math.isfinite(self._last):
            self._offset += round((self._last + self._step - time) * SECOND)
        self._next = time
        for sensor in self._sensors:
            sensor.forget()

    def _write_commands(self, commands: Mapping[str, float], now: int) -> None:
        names = tuple(commands)
        if self._commands is None:
            template = named_numbers(self._types, names, ["position"])
            self._commands = names, _Channel(self._sink, COMMANDS, "sensor_msgs/msg/JointState", template)
        known, channel = self._commands
        if names != known:
            raise ModelError(
                f"{self._thing}: commands must have the names {', '.join(known)} in every call, got "
                f"{', '.join(names)}; give them all, in this order"
            )
        if names:
            channel.template.numbers("position")[...] = list(commands.values())
        channel.write(now, now)


def checked_world(thing: str, simulation: Simulation, world: int) -> int:
    """The index of a world.

    Raises:
        ModelError: there is no such world.
    """
    return whole_number(thing, "world", world, 0, simulation.model.world_count - 1, "count from 0")


def checked_rate(thing: str, rate: float) -> float:
    """A rate of the state [Hz].

    Raises:
        ModelError: it is not positive.
    """
    if not (math.isfinite(rate) and rate > 0.0):
        raise ModelError(f"{thing}: rate must be positive, got {formatted(rate)}; give messages per second [Hz]")
    return rate


def base_of(thing: str, simulation: Simulation, given: str | int | None) -> int:
    """Body of `base_link`.

    Raises:
        ModelError: there is no such body.
    """
    model = simulation.model
    if given is not None:
        rule = f"base must be an index below {model.body_count} or a name"
        return checked_index(thing, rule, given, model.body_count, model.body, "take what add_body returned")
    vehicles = vehicles_of(simulation)
    return vehicles[0].parts.chassis if vehicles else 0


class _Channel:
    """A topic and its message."""

    def __init__(self, sink: MessageSink, topic: str, kind: str, template: Template, *, latched: bool = False) -> None:
        self.template = template
        self._sink, self._number = sink, sink.channel(topic, kind, latched=latched)

    def write(self, now: int, stamp: int) -> None:
        """Writes the message as it is, with a stamp, as delivered now [ns]."""
        self.template.stamp(stamp)
        self._sink.write(self._number, self.template, now)


class _SensorChannels:
    """The topics of a sensor.

    Attributes:
        sensor: the sensor.
        missed: frames that nobody saw.
    """

    def __init__(self, sink: MessageSink, sensor: Sensor, outputs: list[Output], world: int) -> None:
        self.sensor, self.missed = sensor, 0
        self._channels = [(_Channel(sink, each.topic, each.kind, each.template), each.fill) for each in outputs]
        self._timestamp, self._valid = row_of(sensor.timestamp, world), row_of(sensor.valid, world)
        frames: Any = getattr(sensor, "frames", None)
        self._frames, self._period = frames, 0.0 if frames is None else frames.steps.period * frames.dt
        if frames is not None:
            self._count, self._phase = (row_of(frames.memory[f"clock {name}"], world) for name in ("count", "phase"))
        self._last = -math.inf

    def steps_to_next(self, substeps: int) -> int:
        """Steps of so many sub-steps until a frame is published, at least 1."""
        if self._frames is None:
            return 1
        count = int(self._count())
        return -(-(self._frames.steps.next_published(count, int(self._phase())) - count) // substeps)

    def is_new(self) -> bool:
        """Whether there is a frame that was not written."""
        return bool(self._timestamp() > self._last and self._valid())

    def forget(self) -> None:
        """To be called where the world was reset: its time begins anew."""
        self._last = -math.inf

    def write(self, now: int, offset: int) -> None:
        """Writes the present frame, delivered now, in a world whose time began at an offset [ns]."""
        time = float(self._timestamp())
        gone = time - self._last
        if self._period > 0.0 and math.isfinite(gone):
            self.missed += max(round(gone / self._period) - 1, 0)
        self._last = time
        for channel, fill in self._channels:
            fill()
            channel.write(now, offset + round(time * SECOND))


class _StaticFrames:
    """Transforms that stay: of mounts, and of optical frames; written again where a mount was moved.

    Args:
        sink: where messages go.
        types: of the messages.
        edges: parent, child, and a mount's arrays, a rotation, or None.
        world: that is recorded.
    """

    def __init__(self, sink: MessageSink, types: MessageTypes, edges: list[tuple[str, str, Any]], world: int) -> None:
        template = transforms(types, [(parent, child) for parent, child, _ in edges])
        self._cells = template.doubles(transform_paths(len(edges)))
        self._channel = _Channel(sink, "/tf_static", "tf2_msgs/msg/TFMessage", template, latched=True)
        self._values = np.tile(NOWHERE, (len(edges), 1))
        self._mounts = []
        for index, (_, _, what) in enumerate(edges):
            if isinstance(what, tuple):
                self._values[index, 3:] = what
            elif what is not None:
                rows = (_own_row(what.position, world), _own_row(what.rotation, world))
                self._mounts.append((index, *rows))
        self._written: Any = None

    def refresh(self, now: int) -> None:
        """Writes them where they are not yet written."""
        if self._written is not None and not self._mounts:
            return
        for index, position, rotation in self._mounts:
            self._values[index, :3], self._values[index, 3:] = position(), rotation()
        if self._written is not None and np.array_equal(self._values, self._written):
            return
        self._written = self._values.copy()
        self._cells.write(self._values)
        self._channel.write(now, now)


def _own_row(array: wp.array, world: int) -> Any:
    """The row of a world, or the one that all share."""
    return row_of(array, world if array.shape[0] > 1 else 0)
