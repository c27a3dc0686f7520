"""A simulation in ROS 2: its topics out, commands in, in lock-step or at the pace of the clock."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from simwarp.core.types import ModelError
from simwarp.core.wording import suggestion
from simwarp.ros2.bridge_node import BridgeNode, ServiceKind
from simwarp.ros2.command_topics import Apply, CommandError, CommandTopic
from simwarp.ros2.real_time_pace import MOST_FACTOR, Pace
from simwarp.ros2.ros_messages import MessageTypes, Template
from simwarp.ros2.world_topics import WorldTopics
from simwarp.simulation.simulation import Simulation

FIRST_LINE: Final = 2.0
"""Of waiting, after which a line says for what [s]."""
NEXT_LINES: Final = 10.0
"""Of waiting between further lines [s]."""
TURN: Final = 0.1
"""For which the node is waited for at a time: what else ends the bridge is seen as often [s]."""
LOOK: Final = 5.0
"""By the clock, between looks at who publishes commands, and how fast it goes [s]."""
LEFT_OUT: Final = frozenset({"/joint_commands"})
"""Topics of recordings that the bridge listens to instead."""


class BridgeTimeoutError(RuntimeError):
    """No command has come for as long as was agreed; the message is one line."""


@dataclasses.dataclass(frozen=True)
class BridgeTarget:
    """What is bridged.

    Attributes:
        name: of it.
        simulation: whose first world it is.
        dt: time of one control step [s].
        advance: goes on by that much, and calls its argument after each step that it should be seen in.
        reset: begins again, with a seed.
        commands: topics that it is commanded by, the usual one first.
        refusal: why there is no other way to command it; "": there is.
        seeded: whether the seed changes anything.
    """

    name: str
    simulation: Simulation
    dt: float
    advance: Callable[[Callable[[], None]], None]
    reset: Callable[[int], None]
    commands: Sequence[CommandTopic] = ()
    refusal: str = ""
    seeded: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class BridgeOptions:
    """How it runs.

    Attributes:
        lock_step: each step waits for its command.
        wait_for: topic of these commands; None: the usual one.
        factor: of real time where it runs freely; 0: as fast as it goes.
        command_timeout: simulated time without commands after which a free-running target rests [s]; 0: never.
        wait_timeout: time by the clock after which waiting for a command ends the bridge [s]; 0: never.
        rate: of the topics of the state [Hz]; None: after every control step.
        seed: of the worlds.
    """

    lock_step: bool = False
    wait_for: str | None = None
    factor: float = 1.0
    command_timeout: float = 0.5
    wait_timeout: float = 0.0
    rate: float | None = None
    seed: int = 0


class Bridge:
    """Publishes what `simwarp.mcap.Writer` records, and steps the target by the commands that it receives.

    In lock-step the n-th command of a topic moves the n-th step: the same commands repeat a run bit by bit. Else the
    newest command holds.

    Args:
        node: of ROS 2.
        target: that is bridged.
        options: how it runs.
        say: takes lines for the user.
        clock: returns the time [s].

    Attributes:
        steps: control steps that were taken.
        refused: messages that could not be done.
        pace: of free running.

    Raises:
        ModelError: there is no such topic to wait for, the rate is too low for lock-step, or types are not installed.
    """

    def __init__(
        self, node: BridgeNode, target: BridgeTarget, options: BridgeOptions, say: Callable[[str], None], *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.node, self.target, self.options = node, target, options
        self._say, self._clock = say, clock
        self.steps, self.refused, self.paused = 0, 0, False
        self._awaited = _awaited(target, options)
        self._seed, self._types = options.seed, MessageTypes()
        self._queue: deque[Apply] = deque()
        self._single, self._again, self._begun = False, False, False
        self._resting: dict[str, float] = {}
        self._wrong: set[tuple[str, str]] = set()
        self._said: dict[str, float] = {}
        self._look_at = clock() + FIRST_LINE
        self.pace = Pace(options.factor, clock)
        rate = 1.0 / target.dt if options.rate is None else options.rate
        self._topics = WorldTopics(
            _NodeSink(node, self._warn), target.simulation, thing="ros2", rate=rate, without=LEFT_OUT
        )
        for name in self._topics.left_out:
            self._warn(f"sensor '{name}' has no message; it is left out")
        for command in target.commands:
            if not node.subscribe(command.topic, command.kind, functools.partial(self._receive, command)):
                if command is self._awaited:
                    raise ModelError(f"ros2: {command.topic}: {_not_installed(command.kind)}")
                self._warn(f"{command.topic} is left out: {_not_installed(command.kind)}")
        node.serve("reset", ServiceKind.TRIGGER, self._reset)
        node.serve("pause", ServiceKind.SET_BOOL, self._pause)
        node.serve("step", ServiceKind.TRIGGER, self._step_once)
        if target.seeded:
            node.parameter("seed", options.seed, self._set_seed)
        if not options.lock_step:
            node.parameter("real_time_factor", float(options.factor), self._set_factor)

    @property
    def elapsed(self) -> float:
        """Time on `/clock` [s]; 0 before it has begun."""
        return self._topics.elapsed if self._begun else 0.0

    @property
    def missed(self) -> dict[str, int]:
        """Frames of sensors that were not sent, by the sensor's name."""
        return self._topics.missed

    def run(self, stop: Callable[[], bool], *, steps: int | None = None) -> None:
        """Runs until it is stopped, or has taken so many control steps.

        Args:
            stop: whether to end; looked at between steps, and every 0.1 s.
            steps: most; None: no bound.

        Raises:
            BridgeTimeoutError: in lock-step no command has come for the time that was agreed.
        """
        if self._awaited is not None and not self._wait(self._has_company, stop):
            return
        self._topics.add()
        self._begun = True
        self.pace.begin()
        while not stop() and (steps is None or self.steps < steps):
            if not self._wait_for_turn(stop):
                return
            if self._again:
                self._begin_anew()
                continue
            self._step()

    def _step(self) -> None:
        """One control step."""
        self._single = False
        if self._awaited is None:
            self._rest_where_silent()
        self.target.advance(self._topics.add)
        self.steps += 1
        self.pace.step(self.target.dt)
        if self._awaited is None:
            self._look_around()

    # ---- whose turn it is --------------------------------------------------------------------------------------------

    def _wait_for_turn(self, stop: Callable[[], bool]) -> bool:
        """Until a step is due; False: it is to end."""
        if self._awaited is not None:
            if not self._wait(self._may_go, stop):
                return False
            if self._queue and not (self._again or self._single):
                self._queue.popleft()()
            return True
        self.node.handle(0.0)
        was_paused = self.paused
        while not stop():
            if self._again or self._single:
                return True
            if not self.paused and self.pace.wait() == 0.0:
                return True
            self.node.handle(TURN if self.paused else min(self.pace.wait(), TURN))
            if was_paused and not self.paused:
                self.pace.begin()
            was_paused = self.paused
        return False

    def _may_go(self) -> bool:
        """Whether there is something to do in lock-step."""
        return self._again or self._single or (bool(self._queue) and not self.paused)

    def _has_company(self) -> bool:
        """Whether a controller is there: it would miss the first state otherwise, and nothing would ever happen."""
        assert self._awaited is not None
        there = self._awaited.kind in self.node.senders(self._awaited.topic) and self.node.listeners() > 0
        return there or self._may_go()

    def _wait(self, done: Callable[[], bool], stop: Callable[[], bool]) -> bool:
        """Waits until something is so, with a line where it takes long; False: it is to end.

        Raises:
            BridgeTimeoutError: it took too long.
        """
        begun = self._clock()
        line = begun + FIRST_LINE
        self.node.handle(0.0)
        while not done():
            if stop():
                return False
            self.node.handle(TURN)
            now = self._clock()
            if self.paused:
                begun, line = now, now + FIRST_LINE
                continue
            limit = self.options.wait_timeout
            if limit > 0.0 and now - begun >= limit and not done():
                raise BridgeTimeoutError(f"ros2: {self._waiting(now - begun)}; --wait-timeout {limit:g} ends it")
            if now >= line and not done():
                self._say(self._waiting(now - begun))
                line = now + NEXT_LINES
        return True

    def _waiting(self, seconds: float) -> str:
        """For what it waits."""
        assert self._awaited is not None
        topic, kind = self._awaited.topic, self._awaited.kind
        senders = self.node.senders(topic)
        others = sorted(set(senders) - {kind})
        text = f"waiting for {topic} ({kind}) at {self.elapsed:.3f} s, for {seconds:.0f} s by the clock"
        if kind in senders:
            return f"{text}: somebody publishes it, and nothing more has come"
        if others:
            return f"{text}: it is published as {' and '.join(others)}, which is another type"
        return f"{text}: nobody publishes it"

    # ---- commands ----------------------------------------------------------------------------------------------------

    def _receive(self, command: CommandTopic, data: bytes) -> None:
        """A message: refused with a line, done at once, or kept for the step that it belongs to."""
        try:
            apply = command.read(self._types.read(command.kind, data))
        except CommandError as error:
            self._refuse(str(error))
            return
        except ValueError as error:
            self._refuse(f"{command.topic}: {error}; the message was left out")
            return
        if command is self._awaited:
            self._queue.append(apply)
            return
        apply()
        if command.rest is not None:
            self._resting[command.topic] = self.elapsed

    def _refuse(self, text: str) -> None:
        """A message that cannot be done: a line, the same one every 5 s at most."""
        self.refused += 1
        now = self._clock()
        if now - self._said.get(text, -math.inf) >= LOOK:
            self._said[text] = now
            self._warn(text)

    def _warn(self, text: str) -> None:
        self._say(f"warning: {text}")
        self.node.warn(text)

    def _rest_where_silent(self) -> None:
        """Targets whose commands have not come for a while rest."""
        limit, now = self.options.command_timeout, self.elapsed
        for command in self.target.commands:
            heard = self._resting.get(command.topic)
            if heard is None or command.rest is None or limit == 0.0 or now - heard < limit - 1e-9:
                continue
            del self._resting[command.topic]
            command.rest()
            if not self._resting:
                self._say(f"no {command.topic} for {limit:g} s of simulated time: it rests until the next one")

    def _look_around(self) -> None:
        """From time to time: who publishes commands of another type, and whether simulated time is the slower one."""
        now = self._clock()
        if now < self._look_at:
            return
        self._look_at = now + LOOK
        for command in self.target.commands:
            for kind in sorted(set(self.node.senders(command.topic)) - {command.kind}):
                if (command.topic, kind) not in self._wrong:
                    self._wrong.add((command.topic, kind))
                    self._warn(f"{command.topic} is published as {kind}, and must be {command.kind}; it is not heard")
        reached = self.pace.lag()
        if reached is not None:
            self._say(f"lags: {reached:.2f} of real time, {self.pace.factor:g} was asked for; /clock goes as slowly")

    # ---- services and parameters -------------------------------------------------------------------------------------

    def _reset(self, _: bool) -> tuple[bool, str]:
        self._again = True
        with_seed = f" with seed {self._seed}" if self.target.seeded else ""
        return True, f"begins anew{with_seed}; /clock goes on"

    def _begin_anew(self) -> None:
        self._again = False
        self._queue.clear()
        self._resting.clear()
        self.target.reset(self._seed)
        self._topics.add()
        self.pace.begin()

    def _pause(self, paused: bool) -> tuple[bool, str]:
        self.paused = paused
        return True, "paused" if paused else "goes on"

    def _step_once(self, _: bool) -> tuple[bool, str]:
        if not self.paused and self._awaited is None:
            return False, "must be paused; call pause with data: true"
        self._single = True
        return True, f"takes one step of {self.target.dt:g} s with the command that holds"

    def _set_seed(self, value: float) -> str:
        if int(value) != value or value < 0:
            return f"seed must be an integer >= 0, got {value:g}"
        self._seed = int(value)
        return ""

    def _set_factor(self, value: float) -> str:
        if not 0.0 <= value <= MOST_FACTOR:
            return f"real_time_factor must be from 0 (as fast as it goes) to {MOST_FACTOR:g}, got {value:g}"
        self.pace.factor = float(value)
        self.pace.begin()
        return ""


def _awaited(target: BridgeTarget, options: BridgeOptions) -> CommandTopic | None:
    """The topic that steps wait for; None: they wait for none.

    Raises:
        ModelError: there is no such topic, or the state would come too seldom.
    """
    if not options.lock_step:
        return None
    topics = {each.topic: each for each in target.commands}
    if not topics:
        raise ModelError(f"ros2: '{target.name}' takes no commands{_because(target)}; leave out --lock-step")
    if options.rate is not None and options.rate < (1.0 - 1e-6) / target.dt:
        raise ModelError(
            f"ros2: rate must be at least {1.0 / target.dt:g} in lock-step, where controllers wait for the state of "
            f"each step, got {options.rate:g}; leave it out"
        )
    if options.wait_for is None:
        return target.commands[0]
    if options.wait_for not in topics:
        hint = suggestion(options.wait_for, topics, f"it takes {', '.join(topics)}")
        raise ModelError(f"ros2: '{target.name}' takes no {options.wait_for}{_because(target)}; {hint}")
    return topics[options.wait_for]


def _because(target: BridgeTarget) -> str:
    return f": {target.refusal}" if target.refusal else ""


def _not_installed(kind: str) -> str:
    package = kind.partition("/")[0]
    return f"{package} is not installed; apt install ros-$ROS_DISTRO-{package.replace('_', '-')}"


class _NodeSink:
    """Messages to a node."""

    def __init__(self, node: BridgeNode, warn: Callable[[str], None]) -> None:
        self._node, self._warn = node, warn
        self._publish: list[Callable[[bytes], None] | None] = []

    def channel(self, topic: str, kind: str, *, latched: bool = False) -> int:
        """A topic of the node; what is sent to one whose type is not installed goes nowhere."""
        publish = self._node.publish_to(topic, kind, latched=latched)
        if publish is None:
            self._warn(f"{topic} is left out: {_not_installed(kind)}")
        self._publish.append(publish)
        return len(self._publish) - 1

    def write(self, channel: int, template: Template, time: int) -> None:
        """Sends a message as it is now; its time is on `/clock`."""
        publish = self._publish[channel]
        if publish is not None:
            publish(bytes(template.data))
