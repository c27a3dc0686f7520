"""Configuration of tasks in which a robot on legs follows commanded velocities."""

from __future__ import annotations

import dataclasses
import enum
from typing import Annotated

from simwarp.tasks import Fraction, Ge, Gt, Le, Lt, NotNegative, Positive

from ...framework.config import RewardWeights, TaskConfig
from ...framework.config_values import Settings
from .ground import Ground, RoughConfig, ScanConfig
from .walked_soil import WalkedSoilConfig


class VelocityObs(enum.Enum):
    """Observations of a policy.

    ``state``: the trunk's velocity, proprioception, and the command. ``scan``: also heights of the ground around.
    ``history``: proprioception and the command of the last control steps: no more than a real robot has.
    """

    STATE = "state"
    SCAN = "scan"
    HISTORY = "history"


@dataclasses.dataclass(frozen=True)
class VelocityRewards(RewardWeights):
    """Weights of the reward, per second but for that of a fall."""

    speed: float = 2.0
    """exp(-e²), of the error of the horizontal velocity as a share of half of ``max_speed``."""
    turn: float = 1.0
    """exp(-e²), of the error of the yaw rate as a share of half of ``max_turn``."""
    lin_vel_z_l2: float = -2.0
    """Squared vertical velocity [m²/s²]."""
    ang_vel_xy_l2: float = -0.03
    """Squared roll and pitch rates [rad²/s²]."""
    flat_orientation_l2: float = -2.5
    """Squared sine of the tilt."""
    joint_deviation_l2: float = -0.1
    """Squared joint angles from the stance [rad²]."""
    joint_acc_l2: float = -1e-7
    """Squared joint accelerations [rad²/s⁴]."""
    action_rate_l2: float = -0.01
    """Squared change of the action."""
    feet_air_time: float = 0.25
    """Feet whose swing or stance has lasted 0.1 to 0.3 s, while the robot is to move."""
    gait_contacts: float = 0.5
    """Mean over feet of 1 for one that keeps to the clock of the gait, and -1 for one that does not; with a clock."""
    feet_slide: float = -0.05
    """Squared speed of feet on the ground [m²/s²]."""
    fall: float = -5.0
    """The trunk touches something, or tilts by more than 60 degrees; once."""


@dataclasses.dataclass(frozen=True)
class GaitConfig(Settings):
    """Clock of a gait: observed as sine and cosine, and rewarded as `rewards.gait-contacts`."""

    rate: Annotated[float, Ge(0.0), Le(20.0)] = 0.0
    """Cycles per second [Hz]; 0: no clock."""
    stance: Annotated[float, Gt(0.0), Lt(1.0)] = 0.5
    """Share of a cycle in which a foot stands."""


@dataclasses.dataclass(frozen=True)
class VelocityConfig(TaskConfig):
    """Fields of velocity tasks; each is an option of the command line, as ``--task.max-speed``."""

    dt: float = 0.005
    """Physics step [s]."""
    decimation: int = 4
    """Physics steps per control step; one action lasts decimation * dt seconds."""
    max_episode_steps: int = 1000
    """Control steps after which an episode is truncated: 20 s."""
    obs: VelocityObs = VelocityObs.STATE
    """state: the trunk's velocity, proprioception, and the command. scan: also heights of the ground around.
    history: proprioception and the command of the last control steps: no more than a real robot has."""
    history: Annotated[int, Ge(1), Le(50)] = 6
    """Control steps that observations with a history tell of."""
    rewards: VelocityRewards = VelocityRewards()
    """Weights of the reward."""
    gait: GaitConfig = GaitConfig()
    """Clock that feet keep to."""
    ground: Ground = Ground.FLAT
    """flat: a plane. rough: patches of seven kinds, from easy to hard. soil: feet sink in, and leave footprints."""
    soil: WalkedSoilConfig = dataclasses.field(default_factory=WalkedSoilConfig)
    """Soil, its parameters and its grid; its own strength counts in place of a friction."""
    rough: RoughConfig = dataclasses.field(default_factory=RoughConfig)
    """Rough ground and its levels."""
    scan: ScanConfig = dataclasses.field(default_factory=ScanConfig)
    """Grid of the heights that are observed."""
    max_speed: Positive = 1.0
    """Bound of the commanded speed ahead and back [m/s]."""
    max_sideways: Positive = 0.5
    """Bound of the commanded speed to either side [m/s]."""
    max_turn: Positive = 1.0
    """Bound of the commanded turn about the vertical [rad/s]."""
    command_time: Positive = 5.0
    """Time between two commands [s]."""
    standing: Fraction = 0.0
    """Share of commands that are to stand."""
    heading: bool = False
    """Command headings, drawn over the whole circle, in place of turns."""
    action_scale: Positive = 0.5
    """How far a full action moves the target of a joint away from the stance [rad]."""
    start_angle: NotNegative = 0.1
    """Largest deviation of a joint from the stance at the start [rad]."""
    # Without pushes a policy knows no tilts but its own, and falls over what it has not seen
    push_speed: NotNegative = 0.5
    """Largest change of speed that a push gives the robot [m/s]; 0: nothing pushes it."""
    push_time: Positive = 4.0
    """Time between two pushes [s]."""

    @property
    def on_soil(self) -> bool:
        """Feet sink in."""
        return self.ground is Ground.SOIL

    @property
    def surface(self) -> Ground:
        """What the ground is where nothing has sunk in: a plane, or patches of rough ground."""
        if self.on_soil:
            return Ground.ROUGH if self.soil.rough else Ground.FLAT
        return self.ground

    def steps_in(self, time: float) -> int:
        """Return the control steps in a time [s], at least 1."""
        return max(1, round(time / self.control_dt))
