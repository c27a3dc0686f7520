"""The state of a task: what a checkpoint keeps, and copies of worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from simwarp.core.interop import to_torch
from simwarp.core.types import formatted

from ..randomisation.sensing import WorldRows
from .errors import InputError
from .task_simulation import pack_snapshot, unpack_snapshot

NEW_STATE: Final = frozenset({"drawn_level", "drawn_as"})
"""Entries of a task's state that older checkpoints do not have."""
_COUNTERS: Final = ("episode_index", "episode_steps", "episode_clock", "action", "level")


def task_state(task: Any) -> dict[str, Any]:
    """Return everything that a later :func:`load_task_state` needs to go on exactly from here."""
    state: dict[str, Any] = {
        "seed": task.random.seed,
        "iteration": task.iteration,
        **{name: getattr(task, name).clone() for name in _COUNTERS},
        "running_terms": task._statistics.running.clone(),
        "drawn_level": task.drawn_level.clone(),
        "drawn_as": task.random.world.clone(),
        "climbing": task._climbing,
        "sensing": task._sensors.state() | task._path.state() | _cloned(task._contacts.state()),
        "extra": _cloned(task.contract.extra_state()),
        **task._agents.state(),
    }
    if task.simulation is not None:
        with task._acting():
            state["simulation"] = pack_snapshot(task.simulation.snapshot())
    return state


def load_task_state(task: Any, state: Mapping[str, Any]) -> None:
    """Load what :func:`task_state` returned, for the same configuration and number of worlds.

    Raises:
        InputError: it is of another number of worlds, another simulation, or an older version of simwarp.
    """
    if state["episode_index"].shape != task.episode_index.shape:
        raise InputError(f"saved state has {len(state['episode_index'])} worlds, the task has {task.num_worlds}")
    if "level" not in state:
        raise InputError("saved state of the task was made by an older version of simwarp: start a new run")
    with task._acting():
        task.random.reseed(int(state["seed"]))
        task.random.world.copy_(state.get("drawn_as", task.random.world))
        task.iteration = int(state["iteration"])
        for name in _COUNTERS:
            getattr(task, name).copy_(state[name])
        task._statistics.running.copy_(state["running_terms"])
        task.drawn_level.copy_(state.get("drawn_level", state["level"]))  # older states lack it
        task._climb(bool(state["climbing"]))
        task._sensors.load(state["sensing"])
        task._path.load(state["sensing"])
        task._agents.load(state)
        if task._randomiser is not None:
            task._randomiser.begin_episodes(task.random, task._every_world, task.drawn_level)
        if task.simulation is not None:
            task.simulation.restore(unpack_snapshot(state["simulation"], task.simulation.snapshot()))
        for name, tensor in task._contacts.state().items():
            tensor.copy_(state["sensing"][name])
        task.load_extra_state(state["extra"])


def copy_task_worlds(task: Any, source: Any, targets: Any, of: Any) -> None:
    """Make worlds of a task copies of others: see :meth:`~simwarp.tasks.Task.copy_worlds`.

    Raises:
        InputError: there is no physics, or the other task is of another class or configuration.
        ModelError: worlds that do not exist; see `Simulation.copy_worlds`.
    """
    origin = task if of is None else of
    if task.simulation is None:
        raise InputError(f"task '{task.name}' has no physics: its worlds cannot be copied")
    if type(origin) is not type(task):
        raise InputError(f"copy_worlds: of must be a task '{task.name}', got {formatted(of)}; pass one of its kind")
    if origin.random.seed != task.random.seed:
        seeds = f"{origin.random.seed} and {task.random.seed}"
        raise InputError(f"copy_worlds: both tasks must have one seed, got {seeds}; restart one with the other's")
    kept, there = _per_world(task), _per_world(origin)
    mine, theirs = task.contract.extra_state(), origin.contract.extra_state()
    for name, tensor in (kept | mine).items():
        other = (there | theirs).get(name)
        if other is None or other.shape[1:] != tensor.shape[1:]:
            raise InputError(f"copy_worlds: the tasks must have the same configuration, but '{name}' differs")
    with task._acting():
        rows = task.simulation.copy_worlds(source, targets, of=None if origin is task else origin.simulation)
        copied = WorldRows(to_torch(rows))
        for name, tensor in kept.items():
            copied.into(tensor, there[name])
        task._path.take(origin._path, copied)
        task._sensors.take(origin._sensors, copied)
        own = {name for name, tensor in mine.items() if tensor.dim() and tensor.shape[0] == task.num_worlds}
        task.load_extra_state({name: copied.of(v, theirs[name]) if name in own else v for name, v in mine.items()})


def _per_world(task: Any) -> dict[str, Any]:
    """Return what a task keeps of each world, (W, ...) or (W * N, ...), beside its own state."""
    counters = {name: getattr(task, name) for name in (*_COUNTERS, "drawn_level")}
    others = {"running": task._statistics.running, "done": task._agents.done, "drawn_as": task.random.world}
    return counters | others | task._contacts.state()


def _cloned(tensors: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tensor.clone() for name, tensor in tensors.items()}
