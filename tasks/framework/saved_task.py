"""The state of a task that a checkpoint keeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from .errors import InputError
from .task_simulation import pack_snapshot, unpack_snapshot

NEW_STATE: Final = frozenset({"drawn_level"})
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


def _cloned(tensors: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tensor.clone() for name, tensor in tensors.items()}
