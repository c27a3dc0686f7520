"""Distillation on a task: a student with one set of observations learns from a teacher with another."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from rsl_rl.models import MLPModel
from rsl_rl.utils import resolve_callable
from tensordict import TensorDict

from simwarp.core.object_repr import Readable
from simwarp.tasks import InputError, Task, config_to_plain
from simwarp.tasks.framework.agent_rows import refuse_agents
from simwarp.tasks.framework.saved_state import check_like

from ..config import TrainConfig, rsl_rl_config, train_config_from_plain
from ..networks.group_checks import check_groups
from ..networks.symmetric import network_mirror, task_settings
from ..runs.checkpoint import inference_only
from .distillation import DistillationConfig, ThreadedDistillation
from .distributed import Processes
from .learner import Learner
from .vec_env import TEACHER, TaskVecEnv

LESSON = "distillation"
"""Entry of a checkpoint: the hyperparameters; and of a run's ``config.json``, with the path of the teacher."""
TAUGHT_BY = "teacher"
"""Entry of a checkpoint: the teacher's policy, whole; beside the hyperparameters in ``config.json``: its path."""


@dataclasses.dataclass(frozen=True, repr=False)
class Lesson(Readable):
    """Who teaches, and how.

    Attributes:
        teacher: checkpoint of the teacher's policy.
        path: file of it.
        config: hyperparameters.
    """

    teacher: dict[str, Any]
    path: str
    config: DistillationConfig

    @property
    def obs(self) -> str | None:
        """Observations that the teacher was trained on; None where its task has no choice."""
        obs: str | None = self.teacher["task_config"].get("obs")
        return obs

    def described(self) -> dict[str, Any]:
        """Return what a checkpoint and a run's ``config.json`` say of it."""
        return {LESSON: {TAUGHT_BY: self.path, "config": config_to_plain(self.config)}}

    def _readable_title(self) -> str:
        return f" by a policy of task '{self.teacher['task']}'" + (f" (--obs {self.obs})" if self.obs else "")

    def _readable_rows(self) -> dict[str, str]:
        return {"config": str(self.config)}


class Distiller(Learner):
    """Worlds, a student and its optimiser, and a teacher that sees the same worlds with observations of its own.

    Args:
        task: the worlds of this process, as the student observes them.
        config: the training configuration; of its ``ppo`` nothing is used.
        lesson: who teaches, and how.
        group: the processes that train together; this one alone by default. They must be connected.

    Raises:
        InputError: the teacher cannot see these worlds, or its network is none for what it sees.
    """

    rate_option: ClassVar[str] = "distillation.learning-rate"
    algorithm: ThreadedDistillation

    def __init__(self, task: Task[Any], config: TrainConfig, lesson: Lesson, group: Processes | None = None) -> None:
        torch.manual_seed(config.seed)
        refuse_agents(task, "and a student is one", "distil with one")
        check_groups(
            config.network, task.name, task.observation_shapes, task.observation_dtypes, task.observation_kinds
        )
        samples, parts = config.steps_per_iteration * config.num_envs, lesson.config.mini_batches
        if parts > samples and not config.network.recurrent:
            most = f"--steps-per-iteration x --num-envs = {samples}"
            raise InputError(f"--distillation.mini-batches must be at most {most}, got {parts}")
        self.lesson = lesson
        task.contract.on_iteration(0)
        super().__init__(task, config, TaskVecEnv(task, teacher=lesson.obs or ""), group)

    def _make_algorithm(self, observations: TensorDict) -> ThreadedDistillation:
        task, lesson = self.task, self.lesson
        own = list(task.observation_shapes)
        seen = [str(name) for name in observations.keys() if str(name).startswith(TEACHER)]  # noqa: SIM118 (no dict)
        teaching = train_config_from_plain(lesson.teacher["train_config"], "train_config of the teacher")
        shapes = {name.removeprefix(TEACHER): tuple(observations[name].shape[1:]) for name in seen}
        dtypes = {name.removeprefix(TEACHER): observations[name].dtype for name in seen}
        kinds = {name: kind for name, kind in task.observation_kinds.items() if name in shapes}
        check_groups(teaching.network, task.name, shapes, dtypes, kinds)
        recurrent = teaching.network.recurrent or self.config.network.recurrent
        settings = {
            "num_steps_per_env": self.config.steps_per_iteration,
            "obs_groups": {"student": own, "teacher": seen},
            "student": task_settings(task, self.config)["actor"],
            "teacher": rsl_rl_config(
                teaching,
                seen,
                task.action_size,
                kinds,
                prefix=TEACHER,
                mirror=network_mirror(task, teaching.network, shapes),
            )["actor"],
            "multi_gpu": self.group.rsl_rl(),
            "algorithm": {
                "class_name": "simwarp.train.algorithm.distillation:ThreadedDistillation",
                "learning_rate": lesson.config.learning_rate,
                "num_learning_epochs": lesson.config.epochs,
                "num_mini_batches": lesson.config.mini_batches,
                "augmentation": lesson.config.augmentation,
                "max_grad_norm": lesson.config.max_grad_norm,
                # One optimiser step for the whole of what a recurrent student lives through
                "gradient_length": self.config.steps_per_iteration if recurrent else 1,
            },
        }
        kind: Any = resolve_callable(settings["algorithm"]["class_name"])
        made: ThreadedDistillation = kind.construct_algorithm(observations, self.env, settings, self.device)
        self._teach(made)
        return made

    def _teach(self, algorithm: ThreadedDistillation) -> None:
        """Load the teacher's network."""
        state = self.lesson.teacher["actor_state_dict"]
        try:
            check_like(algorithm.teacher.state_dict(), state, "actor_state_dict")
        except InputError as error:
            raise InputError(
                f"the teacher's network does not fit what task '{self.task.name}' shows it: teach with the task's "
                f"options that the teacher was trained with ({error})"
            ) from error
        algorithm.teacher.load_state_dict(state, strict=True)
        algorithm.teacher_loaded = True

    @property
    def networks(self) -> Mapping[str, MLPModel]:
        """The student, under the name of a policy's network."""
        return {"actor": self.algorithm.student}

    @property
    def _remembering(self) -> Sequence[MLPModel]:
        return (self.algorithm.student, self.algorithm.teacher)

    def _load_worlds(self, own: dict[str, Any], where: str) -> bool:
        same = super()._load_worlds(own, where)
        # What the networks remember is where the next rollout begins, and its lesson
        self.algorithm.last_hidden_states = tuple(model.get_hidden_state() for model in self._remembering)
        return same

    def collect(self) -> None:
        """Fill the storage with one rollout."""
        lesson, done = self.lesson.config, self.iteration / self.config.iterations
        guided = max(0.0, 1.0 - self.iteration / lesson.guided) if lesson.guided else 0.0
        rate = lesson.learning_rate * max(0.5 * (1.0 + math.cos(math.pi * done)), 1e-3)
        self.algorithm.begin_rollout(guided, rate)
        super().collect()

    def _learn(self) -> dict[str, float]:
        losses: dict[str, float] = self.algorithm.update()
        return losses

    def checkpoint(self) -> dict[str, Any]:
        """Return everything a resumed run needs, the teacher included. All processes must call this together."""
        return {**super().checkpoint(), TAUGHT_BY: inference_only(self.lesson.teacher), **self.lesson.described()}
