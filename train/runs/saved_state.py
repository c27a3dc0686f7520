"""State of an optimiser and of memories in a checkpoint, checked against those that it is to replace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from rsl_rl.models import MLPModel

from simwarp.core.types import formatted
from simwarp.tasks.framework.saved_state import check_like, check_names, state_mismatch


def check_optimizer(optimizer: torch.optim.Optimizer, saved: Any, where: str) -> None:
    """Check the saved state of an optimiser against its parameters.

    A parameter that never got a gradient has no state, so that the present one says nothing about the saved one.

    Raises:
        InputError: it is of other parameters, or damaged.
    """
    present = optimizer.state_dict()
    check_names(present, saved, where)
    for index, group in enumerate(present["param_groups"]):
        groups = saved["param_groups"]
        if not isinstance(groups, list) or len(groups) != len(present["param_groups"]):
            raise state_mismatch(f"{where}.param_groups", f"a list of {len(present['param_groups'])}", groups)
        check_like(group, groups[index], f"{where}.param_groups[{index}]")
        for name, value in group.items():
            right = groups[index][name] > 0.0 if name == "lr" else groups[index][name] == value
            if not right:
                rule = "positive" if name == "lr" else formatted(value)
                raise state_mismatch(f"{where}.param_groups[{index}].{name}", rule, groups[index][name])
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    if not isinstance(saved["state"], Mapping):
        raise state_mismatch(f"{where}.state", "an object of named values", saved["state"])
    for index, state in saved["state"].items():
        if type(index) is not int or not 0 <= index < len(parameters):
            raise state_mismatch(f"{where}.state", f"of parameters 0 to {len(parameters) - 1}", index)
        like = parameters[index].detach()
        check_like({"step": torch.tensor(0.0), "exp_avg": like, "exp_avg_sq": like}, state, f"{where}.state[{index}]")


def check_memories(models: Sequence[MLPModel], saved: Any, worlds: int, where: str) -> None:
    """Check hidden states of recurrent networks against these networks and a number of worlds.

    Raises:
        InputError: it is of other networks, or damaged.
    """
    if not isinstance(saved, list) or len(saved) != len(models):
        raise state_mismatch(where, f"a list of {len(models)}", saved)
    for index, (model, cells) in enumerate(zip(models, saved, strict=True)):
        network = model.rnn.rnn if model.is_recurrent else None
        if cells == [] or network is None:
            check_like([], cells, f"{where}[{index}]")
            continue
        cell = torch.empty(network.num_layers, worlds, network.hidden_size, device="meta")
        check_like([cell] * (2 if network.mode == "LSTM" else 1), cells, f"{where}[{index}]")
