"""The PhantomX hexapod follows commanded velocities by eighteen servos: the quadruped's task with another robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import simwarp as sw
from simwarp.core.types import PositionDrive

from ...framework.config import TaskConfig
from ...framework.registry import register
from ..walking import BASE
from .config import VelocityConfig
from .quadruped import QuadrupedVelocity
from .walked_soil import WalkedSoilConfig

_LEGS = range(1, 7)
_SERVO = PositionDrive(stiffness=10.0, damping=0.2, effort_limit=1.5)
"""An AX-12A: 1.5 N·m stall torque; gains of our own, with which the robot's weight bends a joint by a degree or two."""


@dataclasses.dataclass(frozen=True)
class HexapodVelocityConfig(VelocityConfig):
    """Configuration of :class:`HexapodVelocity`: slower commands for shorter legs."""

    max_speed: float = 0.3
    """Bound of the commanded speed ahead and back [m/s]."""
    max_sideways: float = 0.2
    """Bound of the commanded speed to either side [m/s]."""
    max_turn: float = 0.6
    """Bound of the commanded turn about the vertical [rad/s]."""
    soil: WalkedSoilConfig = dataclasses.field(default_factory=lambda: WalkedSoilConfig(spacing=0.0044))
    """Soil, its parameters and its grid; its own strength counts in place of a friction."""
    push_speed: float = 0.15
    """Largest change of speed that a push gives the robot [m/s]; 0: nothing pushes it."""


@register("hexapod-velocity")
class HexapodVelocity(QuadrupedVelocity):
    """As :class:`QuadrupedVelocity`, with 18 joints: hips, femurs, tibias, each of legs 1 to 6."""

    summary: ClassVar[str] = "hexapod: six legs follow commanded velocities and turns, 18 position drives"
    config_type: ClassVar[type[TaskConfig]] = HexapodVelocityConfig
    action_size: int = 18
    training: ClassVar[Mapping[str, Any]] = {
        **QuadrupedVelocity.training, "iterations": 300, "network.hidden": (128, 128), "network.init_std": 0.4,
        "network.symmetric": False,
    }  # fmt: skip
    trained_in: ClassVar[Mapping[str, Any]] = {}
    sides: ClassVar[tuple[tuple[str, str], ...]] = ()  # turned by half a turn it is itself again, mirrored it is not
    trunk: ClassVar[str] = "base"
    feet: ClassVar[tuple[str, ...]] = tuple(f"foot_{leg}" for leg in _LEGS)
    stance: ClassVar[Mapping[str, float]] = {f"{k}_{leg}": 0.0 for k in ("hip", "femur", "tibia") for leg in _LEGS}
    gait: ClassVar[tuple[float, ...]] = (0.0, 0.5, 0.0, 0.5, 0.0, 0.5)  # legs go round: a tripod
    height: ClassVar[float] = sw.scenes.HEXAPOD_STANCE

    def robot(self) -> sw.ModelBuilder:
        """The PhantomX of :mod:`simwarp.scenes`, with servos."""
        robot = sw.scenes.hexapod(ground=False, drive=_SERVO)
        robot.add_joint_free("base", BASE, anchor=(0.0, 0.0, sw.scenes.HEXAPOD_STANCE))
        return robot

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the links as rods between the hinges; the collision boxes are the servos."""
        sw.viewer.add_skeleton(visuals, 0.008)
