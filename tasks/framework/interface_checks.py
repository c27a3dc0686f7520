"""Checks of what a task's methods return the first time; every error names the task and the term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import Any

import torch

from simwarp.core.types import formatted

from .agents import Worlds, lead_of
from .errors import TaskError
from .observation_kinds import ObservationKind
from .user_command import Command


def _named(task: Worlds, more: bool = False) -> str:
    """Return the shape of a value, in letters."""
    end = ", ..." if more else ","
    return f"(W{end})" if task.agents == 1 else f"(W, N{end})".replace("N,)", "N)")


def check_batch(task: Worlds, what: str, value: object) -> torch.Tensor:
    """Check that a value is a tensor on the task's device, with its worlds, and agents if there are several, in front.

    Raises:
        TaskError: it is none.
    """
    if not isinstance(value, torch.Tensor):
        raise TaskError(f"task '{task.name}': {what} must be a torch tensor, got {type(value).__name__}")
    lead = lead_of(task)
    if tuple(value.shape[: len(lead)]) != lead:
        agents = f" and {task.agents} agents" if len(lead) > 1 else ""
        raise TaskError(
            f"task '{task.name}': {what} must have {task.num_worlds} worlds{agents} in front, got shape "
            f"{tuple(value.shape)}"
        )
    if value.device != task.device:
        raise TaskError(f"task '{task.name}': {what} must be on {task.device}, got {value.device}")
    return value


def _check_mapping(task: Worlds, what: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TaskError(f"task '{task.name}': {what} must be a dict of named tensors, got {type(value).__name__}")
    for name in value:
        if not isinstance(name, str) or not name:
            raise TaskError(f"task '{task.name}': {what} must have names that are text, got {formatted(name)}")
    return value


def check_observations(task: Worlds, groups: object) -> Mapping[str, torch.Tensor]:
    """Check observation groups: at least one, each (W, ...) and not 64-bit floating point."""
    checked = _check_mapping(task, "observations()", groups)
    if not checked:
        raise TaskError(f"task '{task.name}': observations() returned no group")
    for name, group in checked.items():
        value = check_batch(task, f"observation '{name}'", group)
        if value.dim() <= len(lead_of(task)):
            raise TaskError(
                f"task '{task.name}': observation '{name}' must be {_named(task, True)}, got {tuple(value.shape)}"
            )
        if value.dtype == torch.float64:
            raise TaskError(f"task '{task.name}': observation '{name}' is float64; networks take float32")
        if value.dtype.is_complex:
            raise TaskError(f"task '{task.name}': observation '{name}' is complex; give its parts as float32")
    return checked


def check_terms(
    task: Worlds, terms: object, *, kind: str = "reward", floating: bool = True
) -> Mapping[str, torch.Tensor]:
    """Check reward terms or metrics: each (W,), and float32 for rewards."""
    checked = _check_mapping(task, f"{kind}s()", terms)
    if kind == "reward" and not checked:
        raise TaskError(f"task '{task.name}': rewards() returned no term")
    for name, term in checked.items():
        value = check_batch(task, f"{kind} '{name}'", term)
        if value.dim() != len(lead_of(task)):
            raise TaskError(f"task '{task.name}': {kind} '{name}' must be {_named(task)}, got {tuple(value.shape)}")
        if floating and value.dtype != torch.float32:
            raise TaskError(f"task '{task.name}': {kind} '{name}' must be float32, got {value.dtype}")
    return checked


def check_reasons(task: Worlds, metrics: Mapping[str, torch.Tensor], reasons: Sequence[str]) -> None:
    """Check the names of all reasons to end, and what tells a success.

    Raises:
        TaskError: two reasons have one name, `success_reasons` names others, or the metric `success` is not bool.
    """
    if len(set(reasons)) != len(reasons):
        raise TaskError(f"task '{task.name}': end reasons must have different names, got {list(reasons)}")
    told = metrics.get("success")
    if told is not None and told.dtype != torch.bool:
        raise TaskError(
            f"task '{task.name}': metric 'success' must be bool, got {told.dtype}; compare it with a threshold"
        )
    good = getattr(task, "success_reasons", ())
    if not isinstance(good, Set):
        raise TaskError(f"task '{task.name}': success_reasons must be a set of names, got {good!r}")
    unknown = sorted(set(good) - set(reasons))
    if unknown:
        raise TaskError(f"task '{task.name}': success_reasons names {unknown}, not among {list(reasons)}")


def check_flags(task: Worlds, flags: object, *, kind: str) -> Mapping[str, torch.Tensor]:
    """Check end reasons: each (W,) bool."""
    checked = _check_mapping(task, f"{kind}s()", flags)
    for name, flag in checked.items():
        value = check_batch(task, f"{kind} '{name}'", flag)
        if value.dim() != len(lead_of(task)) or value.dtype != torch.bool:
            raise TaskError(
                f"task '{task.name}': {kind} '{name}' must be {_named(task)} bool, got {tuple(value.shape)} "
                f"{value.dtype}"
            )
    return checked


def check_action(task: Worlds, action: torch.Tensor) -> None:
    """Check that an action is (W, A) floating point; costs no device read."""
    wanted = (*lead_of(task), task.action_size)
    if tuple(action.shape) != wanted or not action.is_floating_point():
        raise TaskError(
            f"task '{task.name}': action must be {wanted} floating point, got {tuple(action.shape)} {action.dtype}"
        )


def check_names(task: Any) -> None:
    """Check what a task says in words: its instruction, names of observations, actions and commands, kinds of groups.

    Raises:
        TaskError: names are not lists of words, as many as there are components, a kind is unknown or does not fit its
            group, or commands are not `Command`.
    """
    if task.action_size < 1:
        raise _wrong(task, "action_size", "at least 1; one that nothing reads, where nothing is done", task.action_size)
    if not isinstance(task.instruction, str) or not task.instruction.isprintable():
        raise _wrong(task, "instruction", "a sentence on one line", task.instruction)
    groups: Mapping[str, tuple[int, ...]] = task.observation_shapes
    named = _mapping(task, "observation_names", task.observation_names, "of groups to lists of names")
    for group, names in named.items():
        shape = groups.get(group)
        if shape is None or len(shape) != 1:
            rows = sorted(name for name, own in groups.items() if len(own) == 1)
            raise _wrong(task, "observation_names", f"of groups that are rows of numbers ({', '.join(rows)})", group)
        _words(task, f"observation_names of '{group}'", names, shape[0])
    known = [kind.value for kind in ObservationKind]
    for group, kind in _mapping(task, "observation_kinds", task.observation_kinds, "of groups to kinds").items():
        if group not in groups:
            raise _wrong(task, "observation_kinds", f"of groups that there are ({', '.join(sorted(groups))})", group)
        if kind not in known:
            raise _wrong(task, f"observation_kinds of '{group}'", f"one of {', '.join(known)}", kind)
        if not ObservationKind(kind).fits(groups[group]):
            raise _wrong(task, f"observation_kinds of '{group}'", f"one that fits its shape {groups[group]}", kind)
    _words(task, "action_names", task.action_names, task.action_size)
    _words(task, "action_joints", task.action_joints, task.action_size)
    for name in ("action_scale", "default_positions"):
        scales = getattr(task, name)
        if len(scales) not in (0, task.action_size):
            raise _wrong(task, name, f"{task.action_size} numbers, one per component of an action", scales)
    for name, command in _mapping(task, "commands()", task.commands(), "of names to Command").items():
        if not isinstance(command, Command):
            raise _wrong(task, f"commands() of '{name}'", "a Command(values, low, high)", command)


def _mapping(task: Any, name: str, value: Any, rule: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _wrong(task, name, f"a dict {rule}", value)
    return value


def _words(task: Any, name: str, words: Any, count: int) -> None:
    if isinstance(words, str) or not all(isinstance(word, str) for word in words):
        raise _wrong(task, name, "a list of names", words)
    if len(words) not in (0, count):
        raise TaskError(f"task '{task.name}': {name} must be {count} names, one per component, got {len(words)}")


def _wrong(task: Any, name: str, rule: str, value: Any) -> TaskError:
    return TaskError(f"task '{task.name}': {name} must be {rule}, got {formatted(value)}")


def check_physics_flag(cls: Any, base: Any) -> None:
    """Check that a class's ``fused_physics`` fits the methods that it writes.

    Args:
        cls: the class of a task.
        base: the class that all tasks are derived from.

    Raises:
        TaskError: it writes methods that would never be called.
    """
    where, has_launches = f"task class {cls.__name__}", cls.physics_launches is not base.physics_launches
    if cls.fused_physics and not has_launches:
        raise TaskError(f"{where}: fused_physics is True without physics_launches(); write it, or set False")
    parents = [kind for kind in cls.__bases__ if getattr(kind, "fused_physics", False)]
    for parent in parents if cls.fused_physics and "fused_physics" not in vars(cls) else []:
        hidden = [name for name in ("apply", "after_physics") if getattr(cls, name) is not getattr(parent, name)]
        if hidden and cls.physics_launches is parent.physics_launches:
            raise TaskError(
                f"{where}: {', '.join(hidden)} is not called where fused_physics is True, as in {parent.__name__}; "
                "set fused_physics = False beside it, or write physics_launches() too"
            )
    if not cls.fused_physics and "physics_launches" in vars(cls):
        raise TaskError(f"{where}: physics_launches() is not called where fused_physics is False; set it to True")
