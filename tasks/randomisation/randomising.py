"""Model parameters drawn anew for worlds whose episode begins, or in every control step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

import simwarp as sw
from simwarp.core.types import formatted

from ..framework.errors import InputError, near_names
from .actuator_randomisation import ARRAYS, ActuatorNumbers, of_actuators
from .limit_ranges import LIMITS, DrawnLimits, check_limit_ranges
from .mass_centres import ARRAYS_OF_CENTRES, CENTRES, MassCentres, of_centres
from .randomisation_config import Mode, Range, When
from .randomness import WorldRandom

if TYPE_CHECKING:
    from simwarp.model.effective_parameters import ActiveEntries


class _Parameter:
    """One parameter: the view of it, its built value, and which of its entries are drawn."""

    def __init__(self, name: str, spec: Range, view: torch.Tensor, chosen: torch.Tensor) -> None:
        self.name = name
        self.spec = spec
        self.view = view
        self.built = self.view.clone()
        self.chosen = _spread(chosen, self.view)
        trailing = self.view.dim() - (1 if name == "gravity" else 2)
        if not self.view.is_floating_point():
            raise InputError(f"randomise '{name}': it holds whole numbers, which no range describes")
        if trailing and spec.mode is not Mode.SCALE:
            raise InputError(f"randomise '{name}': vectors and matrices can be scaled only")
        self.count = 1 if name == "gravity" else self.view.shape[1]
        self.shape = (self.view.shape[0],) + (() if name == "gravity" else (self.count,)) + (1,) * trailing

    def draw(self, random: WorldRandom, mask: torch.Tensor, level: torch.Tensor) -> None:
        """Write new values into the worlds of the mask."""
        spec, per_step = self.spec, self.spec.when is When.STEP
        purpose = f"randomise {spec.draw or self.name}"
        size = 1 if spec.shared else self.count
        number = random.uniform(purpose, spec.low, spec.high, size=size, per_step=per_step).expand(-1, self.count)
        number = number.reshape(self.shape).to(self.view.dtype)
        if spec.mode is Mode.SCALE:
            value = self.built * number
        elif spec.mode is Mode.ADD:
            value = self.built + number
        else:
            value = number.expand_as(self.view)
        if spec.grows:
            share = level.to(self.view.dtype).view(-1, *(1,) * (self.view.dim() - 1))
            value = self.built + share * (value - self.built)
        where = mask.view(-1, *(1,) * (self.view.dim() - 1)) & self.chosen
        self.view.copy_(torch.where(where, value, self.view))


def _of_model(name: str, spec: Range, model: Any) -> _Parameter:
    """Return a parameter of the model."""
    view = sw.to_torch(getattr(model, name))
    return _Parameter(name, spec, view, _chosen(name, spec, model, view))


class _Inertia:
    """The inertia of bodies whose mass is scaled: it grows with it, as that of a denser body does."""

    def __init__(self, mass: _Parameter, model: Any) -> None:
        self.mass = mass
        self.view = sw.to_torch(model.body_inertia_b)
        self.built = self.view.clone()

    def follow(self, mask: torch.Tensor) -> None:
        """Write the inertias of the present masses into the worlds of the mask."""
        factor = (self.mass.view / self.mass.built)[..., None, None]
        where = mask.view(-1, 1, 1, 1) & self.mass.chosen[..., None, None]
        self.view.copy_(torch.where(where, self.built * factor, self.view))


def _parts_of(name: str, model: Any) -> tuple[str, ...] | None:
    """Return the names of the parts that a parameter has an entry for; None where they have none."""
    names: dict[str, tuple[str, ...]] = {
        "body": model.body_names, "joint": model.joint_names, "drive": model.joint_names, "shape": model.shape_names,
        "flexible": tuple(mesh.name for mesh in model.builder.flexible_meshes for _ in mesh.parts),
    }  # fmt: skip
    return names.get(name.partition("_")[0])


def _entries(name: str, part: str, model: Any) -> slice:
    """Return the entries of a parameter that belong to a part."""
    if name.startswith("flexible"):
        owners = [mesh.name for mesh in model.builder.flexible_meshes for _ in mesh.parts]
        return slice(owners.index(part), owners.index(part) + owners.count(part))
    index = model.shape_names.index(part) if name.startswith("shape") else -1
    if name.startswith("body"):
        index = model.body(part)
    if name.startswith(("joint", "drive")):
        index = model.joint(part)
        if not name.startswith(_PER_JOINT):
            return slice(model.joint_dof_start[index], model.joint_dof_start[index + 1])
    return slice(index, index + 1)


_PER_JOINT = ("joint_anchor", "joint_frame", "joint_offset")
"""Parameters with an entry for each joint; others of joints have one for each coordinate."""


def _chosen(name: str, spec: Range, model: Any, view: torch.Tensor) -> torch.Tensor:
    """Return a mask over the entries of a parameter: those that ``only`` names."""
    count = 1 if name == "gravity" else view.shape[1]
    if not spec.only:
        return torch.ones(count, dtype=torch.bool)
    names = _parts_of(name, model)
    if names is None:
        raise InputError(f"randomise '{name}': it has no parts that `only` could name")
    mask = torch.zeros(count, dtype=torch.bool)
    for part in spec.only:
        if part not in names:
            raise InputError(f"randomise '{name}': there is no {formatted(part)}{near_names(part, names)}")
        mask[_entries(name, part, model)] = True
    return mask


def _spread(mask: torch.Tensor, view: torch.Tensor) -> torch.Tensor:
    """Return a mask over entries in a shape that broadcasts to the parameter."""
    if view.dim() == 1 or len(mask) != view.shape[1]:
        return mask.to(view.device).view((1,) * view.dim())
    return mask.to(view.device).view(1, -1, *(1,) * (view.dim() - 2))


def _check_acts(parameter: _Parameter, effect: ActiveEntries, model: Any, owner: str) -> None:
    """Refuse a range that changes nothing, on the whole or on a part that ``only`` names.

    Raises:
        InputError: kernels read none of the entries, or a factor meets nothing but zeros.
    """
    name, spec = parameter.name, parameter.spec
    built = parameter.built[0].reshape(effect.entries.shape[0], -1) if effect.entries.shape[0] else parameter.built
    nonzero = (built != 0).any(dim=1).cpu().numpy() if effect.entries.shape[0] else effect.entries
    parts = [(f"'{part}'", _entries(name, part, model)) for part in spec.only]
    for part, entries in parts or [("any part", slice(None))]:
        where = f"on {part} of {owner}" if spec.only else f"in {owner}"
        if not effect.entries[entries].any():
            remedy = "build it so, or leave it out" if effect.rule else "leave it out"
            raise InputError(f"randomise '{name}': it cannot act {where}: {effect.rule}; {remedy}")
        if spec.mode is Mode.SCALE and not (effect.entries & nonzero)[entries].any():
            raise InputError(
                f"randomise '{name}': a factor cannot act {where}: it is 0 as built; use mode='add' or 'set', or build "
                "it with a value"
            )


def _check_limits(parameters: Sequence[_Parameter], model: Any, owner: str) -> None:
    """Refuse ranges of stops that could cross.

    Raises:
        InputError: a lower stop could be above its upper one.
    """
    drawn = {item.name: item for item in parameters if item.name in LIMITS}
    if not drawn:
        return
    limits = {}
    for name in LIMITS:
        built = getattr(model, name).numpy()[0].astype(np.float64)
        item = drawn.get(name)
        chosen = np.broadcast_to(item.chosen.cpu().numpy()[0] if item else False, built.shape)
        limits[name] = DrawnLimits(spec=item.spec if item else None, built=built, chosen=chosen)
    check_limit_ranges({name: item.spec for name, item in drawn.items()}, limits, model, owner)


class Randomiser:
    """Draws the parameters that a configuration names.

    Args:
        ranges: parameter name -> range.
        simulation: of a model whose named parameters have a copy per world (:func:`drawn_parameters`).
        owner: whose simulation it is: the errors name it.

    Raises:
        InputError: a range cannot act on the model.
    """

    def __init__(self, ranges: Mapping[str, Range], simulation: Any, owner: str) -> None:
        from simwarp.model.effective_parameters import effective_entries

        model = simulation.model
        moving, shifting = of_actuators(ranges), of_centres(ranges)
        of_model = {name: spec for name, spec in ranges.items() if name not in {*moving, *shifting}}
        self._parameters = [_of_model(name, spec, model) for name, spec in of_model.items()]
        self._numbers = ActuatorNumbers(moving, simulation, owner) if moving else None
        if self._numbers is not None:
            self._parameters += [
                _Parameter(name, spec, self._numbers.views[name], self._numbers.chosen(name, spec))
                for name, spec in moving.items()
            ]
        self._centres = MassCentres(shifting, simulation, owner) if shifting else None
        if self._centres is not None:
            for name, spec in shifting.items():
                view = self._centres.views[name]
                chosen = self._centres.chosen(spec, _chosen(name, spec, model, view))
                self._parameters.append(_Parameter(name, spec, view, chosen))
        self._by_step = [item for item in self._parameters if item.spec.when is When.STEP]
        self._inertias = [_Inertia(item, model) for item in self._parameters if _scales_inertia(item.name, ranges)]
        for item in (one for one in self._parameters if one.name in of_model):
            contact_model = simulation.solver.contact_model
            effect = effective_entries(model, item.name, contact_model=contact_model, also=ranges.keys())
            _check_acts(item, effect, model, owner)
        _check_limits(self._parameters, model, owner)

    def begin_episodes(self, random: WorldRandom, mask: torch.Tensor, level: torch.Tensor) -> None:
        """Draw everything in the worlds of the mask ((W,) bool).

        Args:
            random: of the worlds.
            mask: (W,) bool.
            level: (W,) float32, of the curriculum as these episodes begin.
        """
        for item in self._parameters:
            item.draw(random, mask, level)
        for inertia in self._inertias:
            inertia.follow(mask)
        if self._numbers is not None:
            self._numbers.compose(mask)
        if self._centres is not None:
            self._centres.compose(mask)

    def begin_step(self, random: WorldRandom, every: torch.Tensor, level: torch.Tensor) -> None:
        """Draw what changes in every control step."""
        for item in self._by_step:
            item.draw(random, every, level)
        for inertia in self._inertias:
            if inertia.mass in self._by_step:
                inertia.follow(every)
        if self._numbers is not None and any(item.name in self._numbers.views for item in self._by_step):
            self._numbers.compose(every)


def _scales_inertia(name: str, ranges: Mapping[str, Range]) -> bool:
    """Return True if the inertia follows this parameter: a scaled mass, unless it has a range of its own."""
    scaled = name == "body_mass" and ranges[name].mode is Mode.SCALE
    return scaled and ranges[name].inertia and "body_inertia_b" not in ranges


def drawn_parameters(ranges: Mapping[str, Range]) -> set[str]:
    """Return the model parameters that ranges change: what they name, and what follows masses and centres."""
    following = {"body_inertia_b" for name in ranges if _scales_inertia(name, ranges)}
    following |= set(ARRAYS_OF_CENTRES) if of_centres(ranges) else set()
    return {*ranges, *following} - {*of_actuators(ranges), *CENTRES}


def randomiser_of(ranges: Mapping[str, Range], simulation: Any, owner: str) -> Randomiser | None:
    """Return the sampler of the ranges; None where there are none."""
    return Randomiser(ranges, simulation, owner) if ranges else None


def check_ranges(ranges: Mapping[str, Range]) -> None:
    """Refuse the name of a parameter that does not exist."""
    from simwarp.model.model import PARAMETERS

    known = (*PARAMETERS, *ARRAYS, *CENTRES)
    for name in ranges:
        if name in ARRAYS_OF_CENTRES and of_centres(ranges):
            raise InputError(f"randomise '{name}': it follows {next(iter(of_centres(ranges)))}; leave one of them out")
        if name not in known:
            raise InputError(f"randomise: there is no model parameter {formatted(name)}{near_names(name, known)}")
