"""A vehicle and its manoeuvre as one document of numbers, some of which a study varies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from simwarp.core.types import formatted
from simwarp.identify.document_numbers import Keys, is_number, is_scalable, matches, path_of, replaced, scaled, value_at
from simwarp.identify.fit_error import FitError
from simwarp.identify.vehicle_target import vehicle_document
from simwarp.study.distributions import Distribution, parse_distribution
from simwarp.study.study_error import StudyError
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver, maneuver_options
from simwarp.vehicle.results.runs import FRICTION
from simwarp.vehicle.spec.parts import SPECS
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec

GROUND: Final = "ground"
MANEUVER: Final = "maneuver"
"""What a document has beside the vehicle's file: `ground.friction`, and the manoeuvre's options that are given."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariedKey:
    """A key of a study.

    Attributes:
        name: as it was written: paths of `simwarp fit --list` with commas between.
        distribution: of its values.
        places: where in the document it acts.
        factor: whether a value multiplies what is there; False: it takes the place of each number.
    """

    name: str
    distribution: Distribution
    places: tuple[Keys, ...]
    factor: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariedVehicle:
    """A vehicle with the keys that a study varies.

    Attributes:
        document: of the vehicle as it is, with ground and manoeuvre.
        maneuver: its name.
        keys: in the order in which they were given.
    """

    document: Any
    maneuver: str
    keys: tuple[VariedKey, ...]

    def changed(self, values: Sequence[float | None]) -> Any:
        """The document with a value for each key; None leaves what is there."""
        changes: dict[Keys, Any] = {}
        for key, value in zip(self.keys, values, strict=True):
            for place in key.places if value is not None else ():
                assert value is not None
                changes[place] = scaled(value_at(self.document, place), value) if key.factor else float(value)
        return replaced(self.document, changes)

    def drawn(self, shares: Sequence[float]) -> tuple[float, ...]:
        """Values of the keys below which these shares of all draws are; changes in % as factors."""
        return tuple(
            _value(key, float(key.distribution.at(share))) for key, share in zip(self.keys, shares, strict=True)
        )

    def nominal(self) -> tuple[float, ...]:
        """Values of the keys as built: 1 of factors, NaN where the numbers of a key differ."""
        found = []
        for key in self.keys:
            built = {1.0} if key.factor else {float(value_at(self.document, place)) for place in key.places}
            found.append(built.pop() if len(built) == 1 else math.nan)
        return tuple(found)


def _value(key: VariedKey, drawn: float) -> float:
    return 1.0 + drawn if key.distribution.relative else drawn


def spec_of(document: Any) -> VehicleSpec:
    """The vehicle of a document.

    Raises:
        SpecError: a number breaks a rule of the description.
    """
    values = {key: value for key, value in document.items() if key not in (GROUND, MANEUVER)}
    made: VehicleSpec = SPECS.load(VehicleSpec, values)
    return made


def maneuver_of(name: str, spec: VehicleSpec, document: Any) -> Maneuver:
    """The manoeuvre of a document's vehicle, with the options that the document gives.

    Raises:
        SpecError: an option cannot be used.
    """
    given = {key: value for key, value in document[MANEUVER].items() if not math.isnan(value)}
    return maneuver(name, spec, **given)


def friction_of(document: Any) -> float:
    """Of the ground.

    Raises:
        SpecError: there is no such friction.
    """
    friction = float(document[GROUND]["friction"])
    if not FRICTION[0] <= friction <= FRICTION[1]:
        raise SpecError(f"ground.friction: must be from {FRICTION[0]:g} to {FRICTION[1]:g}, got {friction!r}")
    return friction


def varied_vehicle(
    spec: VehicleSpec, name: str, texts: Sequence[str], *, options: Mapping[str, float], friction: float,
    option: str = "--vary",
) -> VariedVehicle:  # fmt: skip
    """A vehicle with keys from their texts, `PATH[,PATH]=DISTRIBUTION`.

    Paths are those of `simwarp fit --list`, with `ground.friction` and `maneuver.speed` (or another option of the
    manoeuvre). Numbers are values, of each place that the paths lead to; those in % are changes of what is there, the
    only ones that a table takes.

    Args:
        spec: of the vehicle.
        name: of the manoeuvre.
        texts: of the keys.
        options: of the manoeuvre that are given.
        friction: of the ground.
        option: of the command line, for messages.

    Raises:
        SpecError: the vehicle as built cannot drive the manoeuvre so.
        StudyError: a text is no key, the vehicle has no such number, or an end of a range breaks a rule of it.
    """
    maneuver(name, spec, **options)  # what is wrong without any key is no fault of one
    document = vehicle_document(spec)
    document[GROUND] = {"friction": friction}
    known = maneuver_options(name) if name in MANEUVERS else ["duration"]
    document[MANEUVER] = {key: float(options.get(key, math.nan)) for key in known}
    keys: list[VariedKey] = []
    taken: dict[Keys, str] = {}
    for text in texts:
        key = _key(document, text, option)
        for place in key.places:
            if place in taken:
                where = path_of(document, place)
                raise StudyError(f"{option} {key.name}: {where} is varied by {formatted(taken[place])} already")
            taken[place] = key.name
        keys.append(key)
    made = VariedVehicle(document=document, maneuver=name, keys=tuple(keys))
    _check_ends(made, option)
    return made


def _key(document: Any, text: str, option: str) -> VariedKey:
    name, equals, words = text.partition("=")
    name = name.strip()
    if not equals or not name:
        raise StudyError(f"{option}: must be KEY=LOW..HIGH, got {formatted(text)}")
    place = f"{option} {name}"
    distribution = parse_distribution(words, place)
    try:
        places = tuple(keys for path in name.split(",") for keys in matches(document, path.strip()))
    except FitError as error:
        raise StudyError(f"{option} {str(error).removeprefix('parameters: ')}") from None
    for keys in places:
        if not is_scalable(value_at(document, keys)):
            raise StudyError(f"{place}: must be a number or a table of numbers, got {path_of(document, keys)}")
    factor = distribution.relative
    table = next((keys for keys in places if not is_number(value_at(document, keys))), None)
    if table is not None and not factor:
        raise StudyError(f"{place}: {path_of(document, table)} is a table, which takes changes in %: -10%..10%")
    if factor and any(_unknown(value_at(document, keys)) for keys in places):
        raise StudyError(f"{place}: a change in % needs a value; give it as an option, or the numbers themselves")
    if factor and all(not np.any(_flat(value_at(document, keys))) for keys in places):
        raise StudyError(f"{place}: a factor of 0 is 0; give the numbers themselves")
    return VariedKey(name=name, distribution=distribution, places=places, factor=factor)


def _unknown(value: Any) -> bool:
    return is_number(value) and math.isnan(value)


def _flat(value: Any) -> list[float]:
    return [value] if is_number(value) else [number for item in value for number in _flat(item)]


def _check_ends(vehicle: VariedVehicle, option: str) -> None:
    """Refuse ranges that leave what a vehicle can be; each key alone at both ends, the others as built."""
    for key in vehicle.keys:
        for end in key.distribution.ends:
            document = vehicle.changed([_value(key, end) if each is key else None for each in vehicle.keys])
            try:
                friction_of(document)
                maneuver_of(vehicle.maneuver, spec_of(document), document)
            except ValueError as error:
                raise StudyError(f"{option} {key.name}={_value(key, end):g}: {error}") from None
