"""Documents of a vehicle driven through a manoeuvre: as worlds of one simulation where that can be, else one by one."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from simwarp.identify.fit_error import FitError
from simwarp.identify.vehicle_target import input_gains, vehicle_numbers, write_vehicle_numbers
from simwarp.identify.world_numbers import World, WorldNumbers, write_world_numbers
from simwarp.model.builder import ModelBuilder
from simwarp.model.parameters import PARAMETERS
from simwarp.study.varied_vehicle import VariedVehicle, friction_of, maneuver_of, spec_of
from simwarp.vehicle.assessment.maneuver_variants import VARIED, Outcome, outcomes
from simwarp.vehicle.construction import VehicleParts
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.reduced.reduced_wheels import shares_tables
from simwarp.vehicle.results.runs import Drive, Setup, SetUpOptions, add_on_road, set_up
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.vehicle import Vehicle

NO_INPUTS: Final = np.zeros((0, 0))
SHARED: Final = tuple(
    field.name for field in dataclasses.fields(Maneuver) if field.name not in (*VARIED, "place", "wheelbase")
)
"""Fields of a manoeuvre that worlds of one simulation have in common."""


@dataclasses.dataclass(frozen=True)
class _Built:
    """A document as a vehicle at the start of its manoeuvre."""

    document: Any
    spec: VehicleSpec
    maneuver: Maneuver
    builder: ModelBuilder
    parts: VehicleParts


@dataclasses.dataclass(frozen=True)
class _Part:
    """Documents that are driven in one simulation, by their numbers in the order that was asked for."""

    indices: tuple[int, ...]
    worlds: tuple[_Built, ...]
    numbers: tuple[WorldNumbers, ...] | None
    """Of each world beside the vehicle as built; None of one that is driven alone."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WorldRuns:
    """Drives documents of one vehicle.

    A document whose difference worlds of a simulation cannot have (the ratio of a steering, gears, a centre of mass) is
    driven in a simulation of its own. What becomes of a document depends on nothing but itself.

    Attributes:
        vehicle: whose document is the one beside which others differ.
        dt: time step [s].
        device: of the simulations.
    """

    vehicle: VariedVehicle
    dt: float
    device: str

    def run(self, documents: Sequence[Any], progress: Callable[[float], None] | None = None) -> list[Outcome | str]:
        """What became of each document, or why it cannot be built, in one line.

        Args:
            documents: with ground and manoeuvre (`VariedVehicle.changed`).
            progress: called with the share that is done.
        """
        found: list[Outcome | str] = [""] * len(documents)
        built: dict[int, _Built] = {}
        for index, document in enumerate(documents):
            try:
                built[index] = self._built(document)
            except ValueError as error:
                found[index] = str(error)
        done = len(documents) - len(built)
        for part in self._parts(built):
            span = len(part.indices) / len(documents)
            shown = None if progress is None else _within(progress, done / len(documents), span, part.worlds)
            drive = Drive(self.set_up(part), worlds=slice(0, len(part.worlds)))
            drive.run(shown)
            judged = outcomes(drive, [each.maneuver for each in part.worlds])
            for index, outcome in zip(part.indices, judged, strict=True):
                found[index] = outcome
            done += len(part.indices)
        return found

    def alone(self, document: Any) -> Setup[Vehicle]:
        """A document ready to be driven as the only world, as it is in a batch.

        Raises:
            SpecError: it cannot be built.
        """
        (part,) = self._parts({0: self._built(document)})
        return self.set_up(part)

    def _built(self, document: Any) -> _Built:
        """A vehicle at the start of its manoeuvre.

        Raises:
            ValueError: a number breaks a rule.
        """
        spec = spec_of(document)
        what = maneuver_of(self.vehicle.maneuver, spec, document)
        builder = ModelBuilder()
        parts, _ = add_on_road(builder, spec, what, friction=friction_of(document))
        return _Built(document, spec, what, builder, parts)

    @functools.cached_property
    def _base(self) -> tuple[_Built, WorldNumbers] | None:
        """The vehicle as built, with its numbers; None where it cannot be."""
        try:
            base = self._built(self.vehicle.document)
        except ValueError:
            return None
        return base, vehicle_numbers(base.builder, base.parts, base.builder, base.parts)

    def _parts(self, built: Mapping[int, _Built]) -> Iterator[_Part]:
        """The batch of those that fit beside the vehicle as built, then the others one by one."""
        together: dict[int, WorldNumbers] = {}
        for index, each in built.items():
            numbers = None if self._base is None else _numbers_beside(each, *self._base)
            if numbers is not None:
                together[index] = numbers
        if together:
            worlds = tuple(built[index] for index in together)
            yield _Part(tuple(together), worlds, tuple(together.values()))
        for index, each in built.items():
            if index not in together:
                yield _Part((index,), (each,), None)

    def set_up(self, part: _Part) -> Setup[Vehicle]:
        """One simulation of a part."""
        first = part.worlds[0]
        options: SetUpOptions = {"device": self.device, "dt": self.dt, "friction": friction_of(first.document)}
        if part.numbers is None:
            return set_up(first.spec, first.maneuver, **options)
        assert self._base is not None  # beside which the worlds have numbers
        base, own = self._base
        differing = {name for numbers in part.numbers for name in numbers.different(own) if name in PARAMETERS}
        merged = dataclasses.replace(
            first.maneuver, duration=max(each.maneuver.duration for each in part.worlds)
        )  # fmt: skip
        options |= {"worlds": len(part.worlds), "randomised": differing, "own_tires": True}
        setup = set_up(base.spec, merged, variants=[each.maneuver for each in part.worlds], **options)
        write_world_numbers(setup.simulation, differing, [World(each, NO_INPUTS, {}) for each in part.numbers])
        frictions = [{"friction": np.array([friction_of(each.document)])} for each in part.worlds]
        others = [{**each.others, **rest} for each, rest in zip(part.numbers, frictions, strict=True)]
        write_vehicle_numbers(setup.vehicle, others)
        setup.simulation.measure()
        setup.simulation.keep_as_initial()
        return setup


def _within(
    progress: Callable[[float], None], begin: float, span: float, worlds: Sequence[_Built]
) -> Callable[[float], None]:
    """Progress of one simulation as a share of all."""
    start = worlds[0].maneuver.start
    whole = start + max(each.maneuver.duration for each in worlds)

    def advance(t: float) -> None:
        progress(begin + span * (t + start) / whole)

    return advance


def _numbers_beside(world: _Built, base: _Built, own: WorldNumbers) -> WorldNumbers | None:
    """What a world has beside another, whose numbers are given, in one simulation; None where it cannot be there."""
    if not _shares_maneuver(world.maneuver, base.maneuver) or _ground_parts(world) != _ground_parts(base):
        return None
    if base.spec.is_reduced and not shares_tables(world.spec, base.spec):
        return None
    try:
        numbers = vehicle_numbers(world.builder, world.parts, base.builder, base.parts)
        numbers.different(own)
        gains = input_gains(world.parts, base.parts)
    except (FitError, ValueError):
        return None
    alike = np.array_equal(gains, np.ones(3)) and np.array_equal(world.parts.reference, base.parts.reference)
    return numbers if alike else None


def _ground_parts(built: _Built) -> Any:
    """Tires that are no force laws, and their friction: their numbers are in shapes and tables."""
    if built.spec.axles[0].tire.template in MODELS:
        return None
    return [(axle.tire, axle.wheel) for axle in built.spec.all_axles], friction_of(built.document)


def _shares_maneuver(one: Maneuver, other: Maneuver) -> bool:
    return (one.follow is None) == (other.follow is None) and all(
        _same(getattr(one, name), getattr(other, name)) for name in SHARED
    )


def _same(one: object, other: object) -> bool:
    """Whether values are equal; NaN is equal to itself here."""
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one):
        return math.isnan(other)
    return one == other
