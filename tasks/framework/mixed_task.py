"""A task over several models: a group of worlds for each, stepped as one batch.

Each model has a task of its own, with a simulation of its own. Worlds are numbered through: those of the second model
follow those of the first. A group's rows are, bit by bit, those of its task made alone with as many worlds, the same
seed, and as ``first_world`` the number of its first world. Groups share memory where the framework has it for each
world (clocks, levels, actions); what they return is joined by one copy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NoReturn, Protocol

import torch

from simwarp.core.object_repr import Row, plural

from ..randomisation.randomness import WorldRandom
from .argument_checks import whole
from .config import TaskConfig
from .contract import Contract
from .drawing import Drawing, Line
from .errors import InputError, TaskError
from .interface_checks import check_action
from .joint_rows import JointRows, joined
from .mixing import worlds_of_models
from .model_group import ModelGroup
from .statistics import EpisodeSummary, summed
from .step_result import StepResult
from .task import Task

SHARED: Final = (
    "name", "task_file", "summary", "instruction", "config_type", "action_size", "agents", "resting_action",
    "success_reasons", "observation_shapes", "observation_dtypes",
)  # fmt: skip
"""Attributes that the tasks of all models have alike."""
ALIKE: Final[Mapping[str, Callable[[Task[Any]], Any]]] = {
    "components of an action": lambda task: task.action_size,
    "agents of a world": lambda task: task.agents,
    "observations": lambda task: {
        name: (shape, str(task.observation_dtypes[name]).removeprefix("torch."))
        for name, shape in task.observation_shapes.items()
    },
    "kinds of observations": lambda task: dict(task.observation_kinds),
    "reward terms": lambda task: task.reward_terms,
    "end reasons": lambda task: task.end_reasons,
    "metrics": lambda task: [*task.contract.metrics()],
    "time of a control step": lambda task: round(task.config.control_dt, 12),
    "control steps of an episode": lambda task: task.config.max_episode_steps,
}
"""What must be the same of all models, for one policy to act in them and one report to tell of them."""


class MemberMaker(Protocol):
    """Interface of what builds the task of one model."""

    def __call__(self, config: TaskConfig, num_worlds: int, first_world: int, rows: JointRows) -> Task[Any]:
        """Return the task, of so many worlds from number ``first_world`` on."""
        ...


class MixedTask(Task[TaskConfig]):
    """A batch of worlds in which groups have models of their own; to whoever steps it, a task as any other.

    Args:
        name: of the task, for errors.
        config: configuration of the whole batch.
        num_worlds: number of all worlds W.
        make_member: builds the task of a model.
        device: canonical device name.
        seed: seed of all randomness.
        first_world: global index of world 0.

    Raises:
        InputError: there are fewer worlds than models, or two models differ in what one policy must find alike.
    """

    def __init__(
        self, name: str, config: TaskConfig, num_worlds: int, make_member: MemberMaker, *, device: str = "cpu",
        seed: int = 0, first_world: int = 0,
    ) -> None:  # fmt: skip
        models, self.config = config.by_model(), config
        self.num_worlds = whole("num_worlds", num_worlds, 1, 2**31 - 1)
        self.first_world = whole("first_world", first_world, 0, 2**53)
        self.device = torch.device(device)
        tensors: dict[str, torch.Tensor] = {}
        groups, start = [], 0
        counts = worlds_of_models([*models], config.mix_shares, num_worlds, name)
        for (model, own), count in zip(models.items(), counts, strict=True):
            rows = slice(start, start + count)
            task = make_member(own, count, first_world + start, JointRows(tensors, rows, num_worlds))
            groups.append(ModelGroup(model, task, rows))
            start += count
        self._groups = tuple(groups)
        self._tasks = [group.task for group in groups]
        _check_alike(name, self._groups)
        vars(self).update({name: getattr(self._tasks[0], name) for name in SHARED}, **tensors)
        self.random = WorldRandom(seed, self.episode_index, self.episode_steps, first_world)
        self.contract = Contract(self)
        self.simulation = self.builder = self.guard = None
        """Each model has its own: see `model_groups`."""
        self._views = None
        self._seen_at: dict[str, torch.Tensor | None] = {}

    # ---- the groups ----------------------------------------------------------------------------------------------

    @property
    def model_groups(self) -> tuple[ModelGroup, ...]:
        """Models and their worlds."""
        return self._groups

    @property
    def views(self) -> NoReturn:
        """Refuse: each model has views of its own."""
        raise TaskError(f"task '{self.name}' has none of all models: take views of model_groups[0].task")

    def _by_task(self, call: Callable[[Task[Any]], Any]) -> Any:
        """Return what the models' tasks return, joined."""
        return joined([call(task) for task in self._tasks])

    def _parts(self, batch: torch.Tensor) -> Iterator[tuple[Task[Any], torch.Tensor]]:
        """Yield each model's task with its rows of a tensor (W, ...)."""
        return ((group.task, batch[group.rows]) for group in self._groups)

    def _same(self, name: str) -> Any:
        """Return an attribute that all models have alike, else nothing of its kind."""
        values = [getattr(task, name) for task in self._tasks]
        return values[0] if all(value == values[0] for value in values) else type(values[0])()

    # ---- what a task says of its worlds --------------------------------------------------------------------------

    def apply(self, action: torch.Tensor) -> None:
        """Turn ``action`` (W, A) into controls, group by group."""
        for task, part in self._parts(action):
            task.apply(part)

    def observations(self) -> dict[str, torch.Tensor]:
        """Return the observation groups, name -> (W, ...)."""
        return self._by_task(lambda task: task.contract.observations())

    def privileged(self) -> torch.Tensor | None:
        """Return what only a critic sees, (W, N); None where the models have nothing."""
        return self._by_task(lambda task: task.contract.privileged())

    def observations_of(self, obs: str | None) -> dict[str, torch.Tensor] | None:
        """Return the groups (W, ...) of other observations; None where there are none."""
        return self._by_task(lambda task: task.contract.observations_of(obs))

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the reward terms, name -> (W,)."""
        return self._by_task(lambda task: task.contract.rewards())

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return the reasons to end, name -> (W,) bool."""
        return self._by_task(lambda task: task.contract.terminations())

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return the reasons to cut off, name -> (W,) bool."""
        return self._by_task(lambda task: task.contract.truncations())

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the metrics, name -> (W,)."""
        return self._by_task(lambda task: task.contract.metrics())

    def step_limit(self) -> torch.Tensor:
        """Return the control steps after which episodes are over, (W,)."""
        return self._by_task(lambda task: task.contract.step_limit())

    def on_iteration(self, iteration: int) -> Mapping[str, torch.Tensor]:
        """Begin a training iteration; return what is logged, name -> (W,)."""
        return self._by_task(lambda task: task.contract.on_iteration(iteration))

    def reset(self, world_mask: torch.Tensor) -> None:
        """Start new episodes in the worlds of ``world_mask`` (W,), group by group."""
        for task, part in self._parts(world_mask):
            task.reset(part)

    def map_position(self) -> torch.Tensor | None:
        """Return the agents' positions, (W, 3) [m]; within `before_reset` those at the end of the control step."""
        if len(self._seen_at) == len(self._groups):
            return joined([self._seen_at[group.name] for group in self._groups])
        return self._by_task(lambda task: task.contract.map_position())

    def drawing(self) -> Drawing:
        """Return the lines of all models; where one has fewer or shorter ones, points that are not finite."""
        drawings = [(group, group.task.contract.drawing()) for group in self._groups]
        longest = max((drawing.lines for _, drawing in drawings), key=len)
        found = []
        for index, like in enumerate(longest):
            having = [(group.rows, drawing.lines) for group, drawing in drawings if index < len(drawing.lines)]
            parts = [(rows, lines[index].points) for rows, lines in having]
            points = like.points.new_full((self.num_worlds, max(part.shape[1] for _, part in parts), 3), torch.nan)
            for rows, part in parts:
                points[rows, : part.shape[1]] = part
            found.append(Line(points, like.colour, like.width, like.only_maps))
        return Drawing(tuple(found), drawings[0][1].window)

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """Names of the components of observation groups, where all models have the same."""
        return self._same("observation_names")

    @property
    def observation_kinds(self) -> Mapping[str, str]:
        """Kinds of observation groups."""
        return self._tasks[0].observation_kinds

    @property
    def action_names(self) -> Sequence[str]:
        """Names of the components of an action, where all models have the same."""
        return self._same("action_names")

    @property
    def action_scale(self) -> Sequence[float]:
        """What a full action is, where it is the same of all models."""
        return self._same("action_scale")

    @property
    def action_joints(self) -> Sequence[str]:
        """Names of the joints that actions move, where all models have the same."""
        return self._same("action_joints")

    @property
    def default_positions(self) -> Sequence[float]:
        """Coordinates of ``action_joints`` at rest, where they are the same of all models."""
        return self._same("default_positions")

    def mirror(self) -> Any:
        """Return what left-right reflection makes of observations and actions."""
        return self._tasks[0].mirror()

    # ---- what runners call ---------------------------------------------------------------------------------------

    def restart(self, seed: int | None = None) -> dict[str, torch.Tensor]:
        """Begin a new episode in every world; see `Task.restart`."""
        if seed is not None:
            self.random.reseed(seed)
        return self._by_task(lambda task: task.restart(seed))

    def begin_episodes(self, world_mask: torch.Tensor) -> dict[str, torch.Tensor]:
        """Begin new episodes in the worlds of a mask ((W,) bool); return the observations."""
        return joined([task.begin_episodes(part) for task, part in self._parts(world_mask)])

    def observe(self) -> dict[str, torch.Tensor]:
        """Return the observations as a policy gets them, group name -> (W, ...)."""
        return self._by_task(lambda task: task.observe())

    def step(self, action: torch.Tensor) -> StepResult:
        """Advance every world by one control step, one group after another; see `Task.step`."""
        check_action(self, action)
        self.contract.step += 1
        results = [task.step(part) for task, part in self._parts(action)]
        names = [field.name for field in dataclasses.fields(StepResult)]
        return StepResult(**{name: joined([getattr(result, name) for result in results]) for name in names})

    def advance(self, request: torch.Tensor) -> None:
        """Take the physics through one control step towards ``request`` (W, A)."""
        for task, part in self._parts(request):
            task.advance(part)

    def state_dict(self) -> dict[str, Any]:
        """Return everything that a later :meth:`load_state_dict` needs; each model's under its name."""
        models = {group.name: group.task.state_dict() for group in self._groups}
        return {"episode_index": self.episode_index.clone(), "level": self.level.clone(), "models": models}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Load what :meth:`state_dict` returned, for the same configuration and number of worlds.

        Raises:
            InputError: it is of other models, or of another number of worlds.
        """
        models = state.get("models", {})
        if [*models] != [group.name for group in self._groups]:
            here = ", ".join(group.name for group in self._groups)
            raise InputError(f"saved state has the models {', '.join(models) or 'none'}, the task has {here}")
        for group in self._groups:
            group.task.load_state_dict(models[group.name])
        self.random.reseed(self._tasks[0].random.seed)

    def drain_statistics(self) -> EpisodeSummary:
        """Read and clear the statistics of the episodes that ended, of all models and of each."""
        return summed({group.name: group.task.drain_statistics() for group in self._groups})

    def check_values(self) -> None:
        """Raise what :meth:`drain_statistics` raises, if there is a reason."""
        for task in self._tasks:
            task.check_values()

    @property
    def reward_terms(self) -> list[str]:
        """Names of the reward terms."""
        return self._tasks[0].reward_terms

    @property
    def weighted_terms(self) -> list[str]:
        """Names of the reward terms, each with the weight that it has for the first model."""
        return self._tasks[0].weighted_terms

    @property
    def end_reasons(self) -> list[str]:
        """Names of the reasons an episode ends for."""
        return self._tasks[0].end_reasons

    @property
    def iteration(self) -> int:
        """Training iteration, set by the trainer."""
        return self._tasks[0].iteration

    @iteration.setter
    def iteration(self, value: int) -> None:
        for task in self._tasks:
            task.iteration = value

    @property
    def capture(self) -> bool:
        """Capture the control steps of each model into a CUDA graph, where there is a CUDA device."""
        return self._tasks[0].capture

    @capture.setter
    def capture(self, value: bool) -> None:
        for task in self._tasks:
            task.capture = value

    @property
    def not_captured(self) -> str:
        """Reason for which the control steps of a model are not captured; empty where all are, or will be."""
        return next((task.not_captured for task in self._tasks if task.not_captured), "")

    @property
    def keep_final_observations(self) -> bool:
        """Whether results have the observations before a reset."""
        return self._tasks[0].keep_final_observations

    @keep_final_observations.setter
    def keep_final_observations(self, value: bool) -> None:
        for task in self._tasks:
            task.keep_final_observations = value

    @property
    def before_reset(self) -> Callable[[], None] | None:
        """Called in every control step once all models are judged; see `map_position`."""
        return self._before_reset if self._tasks[0].before_reset is not None else None

    @before_reset.setter
    def before_reset(self, call: Callable[[], None] | None) -> None:
        self._before_reset = call
        for group in self._groups:
            group.task.before_reset = None if call is None else self._noting(group)

    def _noting(self, group: ModelGroup) -> Callable[[], None]:
        """Return what notes where a group is before its worlds begin anew; the last one calls who asked for it."""

        def note() -> None:
            place = group.task.contract.map_position()
            self._seen_at[group.name] = None if place is None else place.clone()
            if group is self._groups[-1] and self._before_reset is not None:
                self._before_reset()
                self._seen_at.clear()

        return note

    def _climb(self, climbing: bool) -> None:
        for task in self._tasks:
            task._climb(climbing)

    def _readable_rows(self) -> dict[str, Row]:
        models = ", ".join(f"{group.name} {plural(group.count, 'world')}" for group in self._groups)
        return {"models": models, **super()._readable_rows()}


def _check_alike(name: str, groups: Sequence[ModelGroup]) -> None:
    """Refuse models that one policy cannot act in, or that no report can tell of together.

    Raises:
        InputError: names two of them and what differs.
    """
    first, *others = groups
    for other in others:
        for what, look in ALIKE.items():
            one, two = look(first.task), look(other.task)
            if one != two:
                raise InputError(
                    f"task '{name}': models '{first.name}' and '{other.name}' must have the same {what}, got {one} and "
                    f"{two}; mix models that agree"
                )
