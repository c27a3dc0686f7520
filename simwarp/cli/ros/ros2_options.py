"""Options of ``simwarp ros2``."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from simwarp.cli import UsageError
from simwarp.cli.drive.mounted_sensors import SENSORS_HINT, placed, words_of
from simwarp.cli.options import CommonOptions
from simwarp.ros2.real_time_pace import MOST_FACTOR

if TYPE_CHECKING:
    from simwarp.ros2.bridge import BridgeOptions

ROS_ARGUMENTS = "--ros-args"
LONGEST = 1e6
"""Of times [s]."""


@dataclasses.dataclass(frozen=True)
class Ros2Options(CommonOptions):
    """Connects a task, a vehicle, a scene or a model file with ROS 2: clock, state and sensors out, commands in.

    What follows --ros-args goes to ROS.
    """

    lock_step: bool = False
    """Each step waits for its command: the same commands repeat a run bit by bit. Otherwise time runs freely."""
    wait_for: Annotated[
        str | None, tyro.conf.arg(metavar="TOPIC", help_behavior_hint="(default: the first one that it takes)")
    ] = None
    """Topic whose commands are waited for in lock-step."""
    wait_timeout: Annotated[float, tyro.conf.arg(metavar="s")] = 0.0
    """In lock-step: end with exit code 1 after this time by the clock without a command; 0: wait for ever."""
    real_time_factor: float = 1.0
    """Of free running: simulated time over the clock's, at most; 0: as fast as it goes."""
    command_timeout: Annotated[float, tyro.conf.arg(metavar="s")] = 0.5
    """Of free running: simulated time without commands after which a base stands still, and a policy acts; 0: never."""
    rate: Annotated[float | None, tyro.conf.arg(metavar="Hz", help_behavior_hint="(default: of the control steps)")] = (
        None
    )
    """Of the topics of the state; sensors come at rates of their own."""
    stamped: tyro.conf.FlagCreatePairsOff[bool] = False
    """Take /cmd_vel as geometry_msgs/TwistStamped, not as Twist."""
    sensors: Annotated[str | None, tyro.conf.arg(metavar="NAMES", help_behavior_hint=SENSORS_HINT)] = None
    """On the chassis of a vehicle: names of `simwarp list` or JSON files with commas between, each with its place from
    the centre of mass where it matters, "vlp-16@0:0:1.2,mems-imu"."""
    seconds: Annotated[float | None, tyro.conf.arg(metavar="s", help_behavior_hint="(default: until Ctrl-C)")] = None
    """End after this much simulated time."""
    seed: int = 0
    """Of a task's worlds, and of the noise of sensors on a vehicle."""
    node: str = "simwarp"
    """Name of the node."""
    base: Literal["fixed", "floating"] | None = None
    """Of a URDF: its root link is welded to the world, or floats."""
    allow: tuple[str, ...] = ()
    """Kinds of refused elements of a model file to drop."""
    packages: tuple[str, ...] = ()
    """Folders of a URDF's packages, NAME=FOLDER each."""
    density: float | None = None
    """Of all parts of a STEP file, or of the links of a URDF whose mass it does not tell [kg/m³]."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""

    def check_bridge(self, kind: str) -> None:
        """Refuses what makes no sense, before any work is done.

        Args:
            kind: of the target.

        Raises:
            UsageError: a value is out of bounds, or is of another way to run or of another kind of target.
        """
        self.check()
        for name in ("wait_timeout", "command_timeout"):
            value = getattr(self, name)
            if not 0.0 <= value <= LONGEST:
                raise UsageError(f"--{name.replace('_', '-')} must be from 0 to {LONGEST:g}, got {value:g}")
        if not 0.0 <= self.real_time_factor <= MOST_FACTOR:
            raise UsageError(
                f"--real-time-factor must be from 0 (as fast as it goes) to {MOST_FACTOR:g}, got "
                f"{self.real_time_factor:g}"
            )
        if self.seconds is not None and not 0.0 < self.seconds <= LONGEST:
            raise UsageError(f"--seconds must be positive and at most {LONGEST:g}, got {self.seconds:g}")
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0.0):
            raise UsageError(f"--rate must be positive, got {self.rate:g}")
        for name in ("wait_for", "wait_timeout"):
            if getattr(self, name) and not self.lock_step:
                raise UsageError(f"--{name.replace('_', '-')}: is of --lock-step; add it, or leave this out")
        if self.lock_step and self.real_time_factor != 1.0:
            raise UsageError("--real-time-factor: is of free running; in --lock-step commands set the pace")
        if self.sensors is not None and kind != "vehicle":
            raise UsageError(f"--sensors: are mounted on vehicles; a {kind} has sensors of its own")
        for word in words_of(self.sensors):
            placed(word)

    def bridge(self) -> BridgeOptions:
        """How the bridge runs."""
        from simwarp.ros2.bridge import BridgeOptions

        return BridgeOptions(
            lock_step=self.lock_step, wait_for=self.wait_for, factor=self.real_time_factor,
            command_timeout=self.command_timeout, wait_timeout=self.wait_timeout, rate=self.rate, seed=self.seed,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Ros2TaskOptions(Ros2Options):
    """Connects a task with ROS 2: a policy acts until actions or speeds are commanded."""

    checkpoint: str | None = None
    """Checkpoint file or run folder, `shipped`, `zero` or `random`; by default the newest run, else the shipped one."""


def split_ros(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Splits off what is for ROS: from `--ros-args` to `--` or the end, as launch files add it."""
    if ROS_ARGUMENTS not in arguments:
        return arguments, []
    begin = arguments.index(ROS_ARGUMENTS)
    end = arguments.index("--", begin) if "--" in arguments[begin:] else len(arguments)
    return arguments[:begin] + arguments[end + 1 :], arguments[begin:end]
