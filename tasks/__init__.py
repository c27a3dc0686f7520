"""Reinforcement-learning tasks; installed and imported as ``simwarp.tasks``.

``make("pendulum", num_worlds=64)`` builds a registered task, :class:`Task` is what an author subclasses.
"""

if __name__ != "simwarp.tasks":
    # The checkout root on sys.path would load a second copy, with a registry of its own.
    raise ImportError("this folder is imported as simwarp.tasks: write `import simwarp.tasks`")

from simwarp.core.renames import renamed_names

from .config import TaskConfig, replace_fields, require
from .devices import available_devices, resolve_device
from .drawing import Drawing, Line
from .errors import InputError, TaskError
from .gym_env import TaskEnv, TaskVectorEnv, register_envs
from .plain import config_from_plain, config_to_plain
from .randomness import WorldRandom
from .registry import ENTRY_POINT_GROUP, make, register, task_class, task_names
from .replay import ReplayReport
from .simulation_access import Attachments
from .statistics import EpisodeSummary
from .task import NON_FINITE, TIME_LIMIT, StepResult, Task
from .uncertainty import Curriculum, Driver, Mode, Range, Sensing, When

__all__ = [
    "ENTRY_POINT_GROUP",
    "NON_FINITE",
    "TIME_LIMIT",
    "Attachments",
    "Curriculum",
    "Drawing",
    "Driver",
    "EpisodeSummary",
    "InputError",
    "Line",
    "Mode",
    "Range",
    "ReplayReport",
    "Sensing",
    "StepResult",
    "Task",
    "TaskConfig",
    "TaskEnv",
    "TaskError",
    "TaskVectorEnv",
    "When",
    "WorldRandom",
    "available_devices",
    "config_from_plain",
    "config_to_plain",
    "make",
    "register",
    "register_envs",
    "replace_fields",
    "require",
    "resolve_device",
    "task_class",
    "task_names",
]

register_envs()

__getattr__ = renamed_names(__name__, Equipment="Attachments")
