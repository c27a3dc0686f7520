"""Networks of authors' own: ``module:Class`` or ``path/to/file.py:Class``, a torch module or a model of rsl-rl."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from types import ModuleType
from typing import Any, Final

import torch
from rsl_rl.models import MLPModel
from torch import nn

from simwarp.core.types import formatted
from simwarp.tasks import InputError
from simwarp.tasks.framework.errors import TaskFileError, near_names
from simwarp.tasks.framework.task_class_import import imported_file, module_of_file

from .group_models import GroupModel, Shapes
from .networks import finish

_OPTION: Final = "--network.class"
_FORM: Final = "module:Class or path/to/file.py:Class"
_ROWS: Final = 2
"""Of the observations that a network is tried on."""


def network_class(word: str) -> type[nn.Module]:
    """Import the class of a network.

    Args:
        word: ``module:Class``, of which the module is looked for in the working folder too, or
            ``path/to/file.py:Class``.

    Raises:
        InputError: there is no such module or class, it cannot be imported, or it is no torch module.
    """
    source, _, name = word.rpartition(":")
    where = f"{_OPTION} {formatted(word)}"
    if not (source and name.isidentifier()):
        raise InputError(f"{_OPTION} must be {_FORM}, got {formatted(word)}")
    module = _file(source, where) if source.endswith(".py") else _module(source, where)
    kind = getattr(module, name, None)
    if kind is None:
        known = [each for each, value in vars(module).items() if _is_network(value)]
        raise InputError(f"{where}: module '{source}' has no class '{name}'{near_names(name, known)}")
    if not _is_network(kind):
        got = f"class '{name}'" if isinstance(kind, type) else f"'{name}', a {type(kind).__name__}"
        raise InputError(f"{where}: must be a class that is derived from torch.nn.Module, got {got}")
    found: type[nn.Module] = kind
    return found


def _is_network(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, nn.Module)


def _file(path: str, where: str) -> ModuleType:
    try:
        return imported_file(path)
    except TaskFileError as error:
        raise InputError(f"{where}: {error}") from error


def _module(name: str, where: str) -> ModuleType:
    folder = os.getcwd()
    if folder not in sys.path:
        sys.path.append(folder)  # `python -m` and scripts look there, console scripts do not
    try:
        found = importlib.util.find_spec(name)  # of a package's module it imports the package
        # The file of a task may have its network too: it was imported under a name of ours, and registers the task once
        known = None if found is None or found.origin is None else module_of_file(found.origin)
        return known or importlib.import_module(name)
    except Exception as error:  # whatever an author's file raises
        if isinstance(error, ModuleNotFoundError) and error.name is not None and name.startswith(error.name):
            raise InputError(
                f"{where}: there is no module '{error.name}'; start in its folder, add that to PYTHONPATH, or give"
                f" {_FORM}"
            ) from error
        raise InputError(f"{where}: module '{name}' cannot be imported: {_words(error)}") from error


def _words(error: BaseException) -> str:
    lines = f"{type(error).__name__}: {error}".splitlines()
    return lines[0].rstrip(": ")


class OwnNetwork(GroupModel):
    """A torch module of an author's own as rsl-rl trains it.

    Args:
        arguments: see :class:`~simwarp.train.networks.group_models.GroupModel`.
        own: the class, called with the shapes of the groups by name, without the worlds, and the number of outputs.
        options: see there.
    """

    def __init__(self, *arguments: Any, own: type[nn.Module], **options: Any) -> None:
        self._own = own
        super().__init__(*arguments, **options)

    def make_layers(self, shapes: Shapes, outputs: int) -> nn.Module:
        """Return the author's network."""
        return self._own(dict(shapes), outputs)


def own_network(
    obs: Any, obs_groups: dict[str, list[str]], obs_set: str, output_dim: int, *, own: str, hidden_dims: list[int],
    activation: str, obs_normalization: bool, distribution_cfg: dict[str, Any] | None = None, prefix: str = "",
    **drawn: Any,
) -> MLPModel:  # fmt: skip
    """Build an author's network, and try it on observations of zeros; rsl-rl calls this as it does a class.

    Args:
        obs, obs_groups, obs_set, output_dim: arguments that rsl-rl hands to every model.
        own: the class, see :func:`network_class`. One that is derived from rsl-rl's models gets their arguments.
        hidden_dims, activation: for a model of rsl-rl.
        obs_normalization, distribution_cfg: for either.
        prefix: of the groups' names; a model of rsl-rl gets them with it.
        drawn: see :func:`~simwarp.train.networks.networks.finish`.

    Raises:
        InputError: it cannot be built or called, is recurrent, or returns another shape than (N, outputs).
    """
    kind, where = network_class(own), f"{_OPTION} {formatted(own)}"
    common = {"obs_normalization": obs_normalization, "distribution_cfg": distribution_cfg}
    place = (obs, obs_groups, obs_set, output_dim)
    try:
        if issubclass(kind, MLPModel):
            model: MLPModel = kind(*place, hidden_dims=hidden_dims, activation=activation, **common)
            finish(model, **drawn)
        else:
            model = OwnNetwork(*place, own=kind, prefix=prefix, **common, **drawn)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    except Exception as error:  # whatever an author's class raises
        raise InputError(f"{where}: cannot be built: {_words(error)}") from error
    if model.is_recurrent:
        raise InputError(f"{where}: is recurrent; memories are those of --network.kind recurrent")
    _try(model, obs, output_dim if model.distribution is None else model.distribution.input_dim, where)
    return model


def _try(model: MLPModel, obs: Any, outputs: Any, where: str) -> None:
    """Call a network once, on zeros, in evaluation mode; refuse one that PPO could not learn with."""
    groups = {name: torch.zeros(_ROWS, *group.shape[1:], dtype=group.dtype) for name, group in obs.items()}
    named = dict(model.named_parameters())
    named = {name: one for name, one in named.items() if one.requires_grad and not name.startswith("distribution.")}
    model.eval()
    with torch.inference_mode(False), torch.enable_grad():
        try:
            found = model.mlp(model.get_latent(groups))
        except Exception as error:  # whatever an author's network raises
            raise InputError(f"{where}: fails on observations of zeros: {_words(error)}") from error
        wanted = (_ROWS, outputs)
        got = f"{tuple(found.shape)} {found.dtype}" if isinstance(found, torch.Tensor) else type(found).__name__
        if got != f"{wanted} torch.float32":
            raise InputError(
                f"{where}: must return {wanted} torch.float32 for {_ROWS} rows of observations, got {got}; the number"
                " of outputs is the second argument of the class"
            )
        slopes = torch.autograd.grad(found.sum(), list(named.values()), allow_unused=True) if named else ()
    unused = [name for name, slope in zip(named, slopes, strict=True) if slope is None]
    if unused:
        raise InputError(f"{where}: its parameter '{unused[0]}' has no part in what it returns; remove it")
    model.train()
