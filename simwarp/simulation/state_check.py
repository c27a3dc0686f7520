"""What is wrong with a state as such: shapes that overlap, coordinates outside their limits."""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import WORLD, ContactModel, JointType, RowKind
from simwarp.kernels.collision.contact_lists import make_lists
from simwarp.kernels.collision.placement import make_collision_scratch
from simwarp.kernels.core.tables import StepConfig
from simwarp.kernels.dynamics.recovery import LEAST_SHARE
from simwarp.kernels.dynamics.world import make_scratch, measure_worlds
from simwarp.model.limit_order import coordinate_titles
from simwarp.model.model import Model
from simwarp.model.rules import INFINITE
from simwarp.simulation.flexible_options import FlexibleOptions
from simwarp.simulation.solver_options import SolverOptions, step_config
from simwarp.simulation.stage_recording import record_collision
from simwarp.simulation.state import Contacts, State, initial_arrays
from simwarp.simulation.step_sizes import collision_sizes, list_sizes, scratch_slots_of, step_sizes
from simwarp.simulation.world_launches import WorldLaunch, WorldShares

MOST_NAMED: Final = 4
"""Overlaps, and limits, that one line names; the lists have all."""
USUAL_STEP: Final = 1e-3
"""Where none is known [s]: what is deeper than it recovers in a fiftieth of it is a fault."""
LENGTHS: Final = (RowKind.POINT_AXIS0, RowKind.DISTANCE)


class InitialStateWarning(UserWarning):
    """Shapes of one mechanism overlap as built, or a coordinate starts outside its limits."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Overlap:
    """Two shapes in each other.

    Attributes:
        shapes: their indices, the smaller first.
        names: of the shapes.
        bodies: names of their bodies; "world" for what is fixed.
        depth: the deepest of their contacts [m].
    """

    shapes: tuple[int, int]
    names: tuple[str, str]
    bodies: tuple[str, str]
    depth: float

    def __str__(self) -> str:
        """One phrase."""
        parts = [
            f"'{shape}'" if shape == body else f"'{shape}' of '{body}'"
            for shape, body in zip(self.names, self.bodies, strict=True)
        ]
        return f"{parts[0]} and {parts[1]} by {_length(self.depth)}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class PassedLimit:
    """A coordinate outside its limits.

    Attributes:
        joint: name of its joint.
        title: of the coordinate: the joint, and which one where that has several.
        dof: column of `State.joint_q`.
        value: of the coordinate [m or rad].
        limit: lower and upper stop.
        unit: "m" or "rad".
    """

    joint: str
    title: str
    dof: int
    value: float
    limit: tuple[float, float]
    unit: str

    def __str__(self) -> str:
        """One phrase."""
        low, high = self.limit
        return f"{self.title} is at {self.value:.4g} {self.unit}, outside {low:.4g} to {high:.4g}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class StateFaults:
    """What `Simulation.check_state` found; true where there is anything.

    Attributes:
        overlaps: the deepest first.
        limits: in the order of the coordinates.
    """

    overlaps: tuple[Overlap, ...] = ()
    limits: tuple[PassedLimit, ...] = ()

    def __bool__(self) -> bool:
        """True where anything was found."""
        return bool(self.overlaps or self.limits)

    def __str__(self) -> str:
        """One line; empty where there is nothing."""
        parts = []
        if self.overlaps:
            parts.append(f"shapes overlap: {_listed(self.overlaps)}")
        if self.limits:
            parts.append(f"outside limits: {_listed(self.limits)}")
        return "; ".join(parts)


def _listed(found: Sequence[Overlap] | Sequence[PassedLimit]) -> str:
    more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
    return ", ".join(map(str, found[:MOST_NAMED])) + more


def _length(depth: float) -> str:
    return f"{1e3 * depth:.3g} mm" if depth < 1.0 else f"{depth:.3g} m"


class StateCheck:
    """Looks for faults of the present state that a step corrects by moving the bodies (docs/theory.md).

    Args:
        model: of the simulation.
        state, contacts, config: of the same.
        colliding: launches that find the contacts at the present poses.
    """

    def __init__(
        self, model: Model, state: State, contacts: Contacts, config: StepConfig, colliding: Sequence[WorldLaunch]
    ) -> None:
        self._model, self._state, self._contacts, self._config = model, state, contacts, config
        # an overlap is a law where contacts are springs
        self._colliding = tuple(colliding) if config.contact_model == int(ContactModel.RIGID) else ()

    def of(self, world: int) -> StateFaults:
        """Those of one world. Waits for the device."""
        with self._present_contacts(self._colliding):
            return self._faults([world]).get(world, StateFaults())

    def by_world(self) -> dict[int, StateFaults]:
        """Those of all worlds that have any: overlaps that the last step found, or that the first one will find."""
        time = self._state.world_time.numpy()
        found = self._faults(np.nonzero(time > 0.0)[0])
        fresh = np.nonzero(time == 0.0)[0]
        if fresh.size > 0:
            with self._present_contacts(self._colliding):
                found |= self._faults(fresh)
        return found

    def warn(self, stacklevel: int) -> None:
        """Names what the parts of a mechanism overlap by as built, and limits that are passed."""
        mechanisms = Mechanisms(self._model)
        with self._present_contacts(self._colliding if mechanisms.touch() else ()):
            faults = self._faults([0]).get(0, StateFaults())
        own = tuple(each for each in faults.overlaps if mechanisms.is_own(each.shapes))
        faults = dataclasses.replace(faults, overlaps=own)
        if faults:
            warnings.warn(
                f"Simulation: {faults}; they recover at {self._config.max_depenetration_velocity:g} m/s or "
                f"{self._config.max_depenetration_rate:g} rad/s at most; part the shapes, exclude their pair "
                "(self_collision='overlapping-off' of a loader), or start inside the limits",
                InitialStateWarning,
                stacklevel=stacklevel,
            )

    @contextlib.contextmanager
    def _present_contacts(self, commands: Sequence[WorldLaunch]) -> Iterator[None]:
        """Inside, the contacts are those of the present poses; after it those of before."""
        arrays = [getattr(self._contacts, name) for name in self._contacts.NAMES] if commands else []
        kept = [wp.clone(array) for array in arrays]
        for command in commands:
            command.launch()
        try:
            yield
        finally:
            for array, before in zip(arrays, kept, strict=True):
                wp.copy(array, before)

    def _faults(self, worlds: Sequence[int] | npt.NDArray[np.intp]) -> dict[int, StateFaults]:
        """Of those worlds."""
        if len(worlds) == 0:
            return {}
        limits = _passed_limits(self._model, self._state, self._config)
        depths = self._depths() if self._colliding else {}
        found = {}
        for world in sorted({*limits, *depths}.intersection(map(int, worlds))):
            overlaps = [_overlap(self._model, pair, depth) for pair, depth in depths.get(world, {}).items()]
            deepest_first = tuple(sorted(overlaps, key=lambda each: -each.depth))
            found[world] = StateFaults(overlaps=deepest_first, limits=tuple(limits.get(world, ())))
        return found

    def _depths(self) -> dict[int, dict[tuple[int, int], float]]:
        """Of overlapping pairs of shapes [m], by world."""
        contacts = self._contacts
        gap = contacts.contact_gap.numpy()
        least = float(LEAST_SHARE) * self._config.max_depenetration_velocity * self._config.dt
        deep = (gap < -least) & (np.arange(gap.shape[1]) < contacts.contact_count.numpy()[:, None])
        first, second = contacts.contact_shape0.numpy(), contacts.contact_shape1.numpy()
        found: dict[int, dict[tuple[int, int], float]] = {}
        for world, slot in np.argwhere(deep).tolist():
            pair = int(first[world, slot]), int(second[world, slot])
            if not _is_compliant(self._model, pair):
                pairs = found.setdefault(world, {})
                pairs[pair] = max(pairs.get(pair, 0.0), -float(gap[world, slot]))
        return found


def _is_compliant(model: Model, pair: tuple[int, int]) -> bool:
    """True where contacts of two shapes are springs, as built."""
    surface = model.builder.given_pairs.get(pair)
    surfaces = [surface] if surface is not None else [model.builder.shapes[shape].material for shape in pair]
    return any(each.compliance > 0.0 for each in surfaces)


def _overlap(model: Model, pair: tuple[int, int], depth: float) -> Overlap:
    bodies = [model.builder.shapes[shape].body for shape in pair]
    first, second = ("world" if body == WORLD else model.body_names[body] for body in bodies)
    names = model.shape_names[pair[0]], model.shape_names[pair[1]]
    return Overlap(shapes=pair, names=names, bodies=(first, second), depth=depth)


def _passed_limits(model: Model, state: State, config: StepConfig) -> dict[int, list[PassedLimit]]:
    """By world, those that a step takes away by moving alone."""
    if model.dof_count == 0:
        return {}
    q = state.joint_q.numpy()
    low = np.broadcast_to(model.joint_limit_lower.numpy(), q.shape)
    high = np.broadcast_to(model.joint_limit_upper.numpy(), q.shape)
    is_length = np.isin(model.topology.dof_kind.numpy(), LENGTHS)
    fastest = np.where(is_length, config.max_depenetration_velocity, config.max_depenetration_rate)
    # one unit in the last place of a coordinate is no fault
    least = float(LEAST_SHARE) * fastest * config.dt + 1e-6 * np.abs(q)
    below, above = (low > -INFINITE) & (q < low - least), (high < INFINITE) & (q > high + least)
    passed = (low <= high) & (below | above)
    titles = coordinate_titles(model.joint_names, model.joint_dof_start)
    names = np.repeat(np.array(model.joint_names, object), np.diff(model.joint_dof_start))
    found: dict[int, list[PassedLimit]] = {}
    for world, dof in np.argwhere(passed).tolist():
        limit = float(low[world, dof]), float(high[world, dof])
        unit = "m" if is_length[dof] else "rad"
        found.setdefault(world, []).append(
            PassedLimit(
                joint=names[dof], title=titles[dof], dof=dof, value=float(q[world, dof]), limit=limit, unit=unit
            )
        )
    return found


def initial_faults(model: Model) -> StateFaults:
    """Faults of a model as built, of its first world: without a Simulation, whose kernels take long to compile.

    Args:
        model: of one world, best.
    """
    shares = WorldShares(model.world_count, 1, model.device)
    state, contacts = initial_arrays(model), Contacts(model)
    worlds = wp.full(model.world_count, True, dtype=wp.bool, device=model.device)
    slots = scratch_slots_of(shares)
    scratch = make_scratch(model.device, slots, step_sizes(model, 0, False))
    inputs = [worlds, model.topology, model.parameters, scratch]
    shares.record(measure_worlds, inputs=inputs, outputs=[state.arrays, contacts.arrays]).launch()
    config = step_config(
        SolverOptions(), FlexibleOptions(), USUAL_STEP, model.mass_ratio, reactions=False, accelerations=False
    )
    colliding = record_collision(
        shares, model, config=config, state=state.arrays, contacts=contacts.arrays,
        scratch=make_collision_scratch(model.device, slots, collision_sizes(model)),
        lists=make_lists(model.device, slots, list_sizes(model, own_slots=shares.own_slots)),
    )  # fmt: skip
    return StateCheck(model, state, contacts, config, colliding).of(0)


class Mechanisms:
    """Which mechanism each body of a model is a part of: bodies that joints tie together.

    Args:
        model: the model.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._shape_body = [shape.body for shape in model.builder.shapes]
        self._unit: dict[int, int] = {}
        self._held: set[int] = set()
        roots: list[int] = []
        links = model.tables.links
        for index, (link, unit) in enumerate(zip(links, model.row_groups.link_unit, strict=True)):
            roots.append(index if link.parent < 0 else roots[link.parent])
            if link.body >= 0:
                self._unit[link.body] = unit
                if links[roots[index]].type != JointType.FREE:
                    self._held.add(link.body)

    def is_own(self, pair: tuple[int, int]) -> bool:
        """True of two shapes of one mechanism. Everything that joints hold to the world counts as one mechanism. Loose
        bodies do not: they may be put elsewhere before the first step.
        """
        one, other = (self._shape_body[shape] for shape in pair)
        held = all(body == WORLD or body in self._held for body in (one, other))
        return held or self._unit.get(one) == self._unit.get(other)

    def touch(self) -> bool:
        """True if parts of one mechanism may touch each other."""
        topology = self.model.topology
        if topology.pair_count == 0:
            return False
        if topology.grid_buckets > 0:
            return True
        first = np.repeat(np.arange(self.model.shape_count), np.diff(topology.pair_start.numpy()))
        pairs = zip(first.tolist(), topology.pair_other.numpy().tolist(), strict=True)
        return any(self.is_own(pair) for pair in pairs)
