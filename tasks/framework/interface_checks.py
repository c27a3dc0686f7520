"""Checks of a task's return values, made once when it is built; every error names the task and the term."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import torch

from .errors import TaskError


class Worlds(Protocol):
    """Interface of a batch of worlds."""

    @property
    def name(self) -> str:
        """Of the task."""
        ...

    @property
    def num_worlds(self) -> int:
        """Worlds stepped together."""
        ...

    @property
    def device(self) -> torch.device:
        """Of its tensors."""
        ...

    @property
    def action_size(self) -> int:
        """Numbers of an action."""
        ...


def _check_batch(task: Worlds, what: str, value: object) -> torch.Tensor:
    if not isinstance(value, torch.Tensor):
        raise TaskError(f"task '{task.name}': {what} must be a torch tensor, got {type(value).__name__}")
    if value.dim() == 0 or value.shape[0] != task.num_worlds:
        raise TaskError(
            f"task '{task.name}': {what} must have {task.num_worlds} worlds in front, got shape {tuple(value.shape)}"
        )
    if value.device != task.device:
        raise TaskError(f"task '{task.name}': {what} must be on {task.device}, got {value.device}")
    return value


def _check_mapping(task: Worlds, what: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TaskError(f"task '{task.name}': {what} must be a dict of named tensors, got {type(value).__name__}")
    return value


def check_observations(task: Worlds, groups: object) -> Mapping[str, torch.Tensor]:
    """Check observation groups: at least one, each (W, ...) and not 64-bit floating point."""
    checked = _check_mapping(task, "observations()", groups)
    if not checked:
        raise TaskError(f"task '{task.name}': observations() returned no group")
    for name, group in checked.items():
        value = _check_batch(task, f"observation '{name}'", group)
        if value.dim() < 2:
            raise TaskError(f"task '{task.name}': observation '{name}' must be (W, ...), got {tuple(value.shape)}")
        if value.dtype == torch.float64:
            raise TaskError(f"task '{task.name}': observation '{name}' is float64; networks take float32")
    return checked


def check_terms(
    task: Worlds, terms: object, *, kind: str = "reward", floating: bool = True
) -> Mapping[str, torch.Tensor]:
    """Check reward terms or metrics: each (W,), and float32 for rewards."""
    checked = _check_mapping(task, f"{kind}s()", terms)
    if kind == "reward" and not checked:
        raise TaskError(f"task '{task.name}': rewards() returned no term")
    for name, term in checked.items():
        value = _check_batch(task, f"{kind} '{name}'", term)
        if value.dim() != 1:
            raise TaskError(f"task '{task.name}': {kind} '{name}' must be (W,), got {tuple(value.shape)}")
        if floating and value.dtype != torch.float32:
            raise TaskError(f"task '{task.name}': {kind} '{name}' must be float32, got {value.dtype}")
    return checked


def check_flags(task: Worlds, kind: str, flags: object) -> Mapping[str, torch.Tensor]:
    """Check end reasons: each (W,) bool."""
    checked = _check_mapping(task, f"{kind}s()", flags)
    for name, flag in checked.items():
        value = _check_batch(task, f"{kind} '{name}'", flag)
        if value.dim() != 1 or value.dtype != torch.bool:
            raise TaskError(
                f"task '{task.name}': {kind} '{name}' must be (W,) bool, got {tuple(value.shape)} {value.dtype}"
            )
    return checked


def check_action(task: Worlds, action: torch.Tensor) -> None:
    """Check that an action is (W, A) floating point; costs no device read."""
    wanted = (task.num_worlds, task.action_size)
    if tuple(action.shape) != wanted or not action.is_floating_point():
        raise TaskError(
            f"task '{task.name}': action must be {wanted} floating point, got {tuple(action.shape)} {action.dtype}"
        )
