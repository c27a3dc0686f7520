"""Reinforcement-learning tasks; installed and imported as ``simwarp.tasks``.

``make("pendulum", num_worlds=64)`` builds a registered task, :class:`Task` is what an author subclasses.
"""

if __name__ != "simwarp.tasks":
    # The checkout root on sys.path would load a second copy, with a registry of its own.
    raise ImportError("this folder is imported as simwarp.tasks: write `import simwarp.tasks`")

from simwarp.core.constraints import Count, Fraction, Ge, Gt, Le, Lt, NotNegative, Positive, Whole
from simwarp.task_names import ENTRY_POINT_GROUP

from .actuation.actuator_network import ActuatorNetwork
from .actuation.attached_actuators import actuators_of
from .adapters.gym_env import TaskEnv, TaskVectorEnv, register_envs
from .framework.config import RewardWeights, TaskConfig, replace_fields, require
from .framework.config_values import config_from_plain, config_to_plain
from .framework.devices import available_devices, resolve_device
from .framework.drawing import Drawing, Line
from .framework.errors import InputError, TaskError
from .framework.mirror import Mirror, Reflection, reflection
from .framework.recorded_launches import (
    ComputedRows,
    NamedRows,
    TensorFunction,
    filled,
    launch_over,
    share_over,
    zeros_of,
)
from .framework.registry import config_to_train_in, make, register, task_class, task_names
from .framework.replay import ReplayReport
from .framework.statistics import EpisodeSummary
from .framework.step_check import StepReport, check_step
from .framework.step_result import StepResult
from .framework.task import NON_FINITE, TIME_LIMIT, Task
from .framework.task_simulation import Attachments
from .framework.user_command import Command
from .framework.variants import Variant
from .randomisation.randomisation_config import Curriculum, Driver, Mode, Range, Sensing, When
from .randomisation.randomness import WorldRandom

__all__ = [
    "ENTRY_POINT_GROUP",
    "NON_FINITE",
    "TIME_LIMIT",
    "ActuatorNetwork",
    "Attachments",
    "Command",
    "ComputedRows",
    "Count",
    "Curriculum",
    "Drawing",
    "Driver",
    "EpisodeSummary",
    "Fraction",
    "Ge",
    "Gt",
    "InputError",
    "Le",
    "Line",
    "Lt",
    "Mirror",
    "Mode",
    "NamedRows",
    "NotNegative",
    "Positive",
    "Range",
    "Reflection",
    "ReplayReport",
    "RewardWeights",
    "Sensing",
    "StepReport",
    "StepResult",
    "Task",
    "TaskConfig",
    "TaskEnv",
    "TaskError",
    "TaskVectorEnv",
    "TensorFunction",
    "Variant",
    "When",
    "Whole",
    "WorldRandom",
    "actuators_of",
    "available_devices",
    "check_step",
    "config_from_plain",
    "config_to_plain",
    "config_to_train_in",
    "filled",
    "launch_over",
    "make",
    "reflection",
    "register",
    "register_envs",
    "replace_fields",
    "require",
    "resolve_device",
    "share_over",
    "task_class",
    "task_names",
    "zeros_of",
]

register_envs()
