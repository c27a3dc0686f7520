"""Training with rsl-rl; installed and imported as ``simwarp.train``.

``train("pendulum", default_config(task), task_config)`` trains, ``evaluate(task, policy, episodes)`` measures a policy.
Names are imported when they are used: torch and rsl-rl take their time.
"""

import importlib
from typing import TYPE_CHECKING, Any

if __name__ != "simwarp.train":
    # The checkout root on sys.path would load a second copy, with a registry of its own.
    raise ImportError("this folder is imported as simwarp.train: write `import simwarp.train`")

if TYPE_CHECKING:
    from .algorithm.cloning import CloneConfig, clone
    from .algorithm.distillation import DistillationConfig
    from .algorithm.distiller import Lesson
    from .algorithm.vec_env import TaskVecEnv
    from .config import (
        Activation,
        AugmentationConfig,
        Cell,
        CriticSees,
        InitialWeights,
        LoggerKind,
        NetworkConfig,
        NetworkKind,
        Objective,
        PPOConfig,
        Precision,
        Schedule,
        TrainConfig,
        default_config,
        student_config,
    )
    from .datasets.dataset_formats import Recorded, load_trajectories, record_dataset
    from .datasets.dataset_kinds import DatasetFormat
    from .datasets.episodes import record
    from .datasets.trajectories import Trajectories, save_trajectories
    from .evaluation.evaluation import Evaluation, evaluate
    from .evaluation.play import Frame, write_video
    from .networks.augmentation import augment
    from .networks.export import ExportFormat, export_policy
    from .networks.policies import find_policy, network_policy, random_policy, zero_policy
    from .runs.run_folder import RunFolder, open_run
    from .runs.saved_distillation import lesson_by
    from .runs.training import TrainResult, train

_HOMES = {
    "algorithm.cloning": ("CloneConfig", "clone"),
    "algorithm.distillation": ("DistillationConfig",),
    "algorithm.distiller": ("Lesson",),
    "algorithm.vec_env": ("TaskVecEnv",),
    "config": (
        "Activation", "AugmentationConfig", "Cell", "CriticSees", "InitialWeights", "LoggerKind", "NetworkConfig",
        "NetworkKind", "Objective", "PPOConfig", "Precision", "Schedule", "TrainConfig", "default_config",
        "student_config",
    ),
    "datasets.dataset_formats": ("Recorded", "load_trajectories", "record_dataset"),
    "datasets.dataset_kinds": ("DatasetFormat",),
    "datasets.episodes": ("record",),
    "datasets.trajectories": ("Trajectories", "save_trajectories"),
    "evaluation.evaluation": ("Evaluation", "evaluate"),
    "evaluation.play": ("Frame", "write_video"),
    "networks.augmentation": ("augment",),
    "networks.export": ("ExportFormat", "export_policy"),
    "networks.policies": ("find_policy", "network_policy", "random_policy", "zero_policy"),
    "runs.saved_distillation": ("lesson_by",),
    "runs.run_folder": ("RunFolder", "open_run"),
    "runs.training": ("TrainResult", "train"),
}  # fmt: skip
"""Module -> public names that it has."""

__all__ = [
    "Activation", "AugmentationConfig", "Cell", "CloneConfig", "CriticSees", "DatasetFormat", "DistillationConfig",
    "Evaluation", "ExportFormat", "Frame", "InitialWeights", "Lesson", "LoggerKind", "NetworkConfig", "NetworkKind",
    "Objective", "PPOConfig", "Precision", "Recorded", "RunFolder", "Schedule", "TaskVecEnv", "TrainConfig",
    "TrainResult", "Trajectories", "augment", "clone", "default_config", "evaluate", "export_policy", "find_policy",
    "lesson_by", "load_trajectories", "network_policy", "open_run", "random_policy", "record", "record_dataset",
    "save_trajectories", "student_config", "train", "write_video", "zero_policy",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
