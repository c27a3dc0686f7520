"""Linear models of a simulation about one of its states: d(q, qd)/dt = A (q, qd) + B u, y = C (q, qd) + D u."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from simwarp.analysis.variations import (
    POSITION_STEP,
    RATE_STEP,
    TIME_STEP,
    Array,
    FreeCoordinates,
    Response,
    Variations,
    checked_simulation,
    refuse_contacts,
)
from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import ModelError, formatted, number
from simwarp.model.checks import whole_number
from simwarp.simulation.simulation import Simulation

INPUTS: Final = ("joint_force", "joint_target_q", "joint_target_qd")
"""Arrays of `Control` that may be inputs."""
INPUT_STEP: Final = 1e-2
"""Change of an input for a difference [N, N·m, m, rad, m/s or rad/s]."""
FAR: Final = 0.05
"""Change of a coordinate by which a singular position shows [m or rad]; of small mechanisms, of their extent."""
SINGULAR: Final = 0.5
"""Share of such a change by which it may be missed."""

Outputs = Callable[[Simulation], Any]


@dataclasses.dataclass(frozen=True, repr=False)
class Linearisation(Readable):
    """A linear model about a state: with z = (q - q0, qd - qd0) of the free coordinates,
    dz/dt = (0, acceleration) + A z + B u and y = y0 + C z + D u.

    Attributes:
        a: (2d, 2d) of the states: free coordinates [m or rad], then their rates.
        b: (2d, m) of the inputs.
        c: (p, 2d) of the outputs.
        d: (p, m): outputs that an input reaches at once; zeros, for outputs are of the state.
        coordinates: (d) names of the free coordinates.
        inputs: (m) names of the inputs.
        acceleration: (d,) of the state itself: zero in an equilibrium [m/s² or rad/s²].
        basis: (n, d) what all coordinates of the model do for one of the free ones.
        all_coordinates: (n) their names.
        bodies: (bodies, 6, d) places and turns of bodies for one of the free coordinates [m, rad].
        body_names: (bodies).
        body_x: (bodies, 3) places in the state [m].
        body_rot: (bodies, 4) turns in the state, xyzw.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    acceleration: Array
    basis: Array
    all_coordinates: tuple[str, ...]
    bodies: Array
    body_names: tuple[str, ...]
    body_x: Array
    body_rot: Array

    def __iter__(self) -> Any:
        """A, B and C, as in `a, b, c = linearise(sim)`."""
        return iter((self.a, self.b, self.c))

    @property
    def stiffness(self) -> Array:
        """(d, d) of the accelerations: -da/dq, which is M⁻¹ K [1/s²]."""
        half = len(self.coordinates)
        return -self.a[half:, :half]

    @property
    def damping(self) -> Array:
        """(d, d) of the accelerations: -da/dqd, which is M⁻¹ D [1/s]."""
        half = len(self.coordinates)
        return -self.a[half:, half:]

    def _readable_title(self) -> str:
        return f": {plural(len(self.a), 'state')}, {plural(self.b.shape[1], 'input')}, {plural(len(self.c), 'output')}"


def linearise(
    simulation: Simulation,
    *,
    world: int = 0,
    inputs: Sequence[str] | None = None,
    of: str = "joint_force",
    outputs: Outputs | None = None,
    time_step: float = TIME_STEP,
) -> Linearisation:
    """Linearise a simulation about the present state of one world, by central differences.

    Changes are tried side by side in all worlds that have this world's parameters: give the model many worlds, and it
    is one batch. Accelerations are taken from two short steps and extrapolated to a step of no length, so that the
    result does not depend on `dt` and its numerical damping. The present state comes back.

    Args:
        simulation: that is looked at; contacts must not push. Tires and other force elements may.
        world: whose state.
        inputs: joints whose entries of `Control` are inputs; None: all joints, with none for a model without joints.
        of: which array of `Control`: joint_force [N or N·m], joint_target_q or joint_target_qd of drives.
        outputs: measures the outputs from the simulation, (W, p); None: all coordinates and their rates.
        time_step: longest step of which accelerations are taken [s].

    Raises:
        ModelError: contacts push, a loop does not close, the mechanism is at a singular position, nothing can move, or
            there is no such world, joint or input.
    """
    thing = "linearise"
    sim = checked_simulation(thing, simulation)
    world = whole_number(thing, "world", world, 0, sim.model.world_count - 1, "count from 0")
    if not 0.0 < number(time_step) < np.inf:
        raise ModelError(f"{thing}: time_step must be > 0 s, got {formatted(time_step)}; 1e-4 is the default")
    refuse_contacts(thing, sim, [world])
    columns = _input_columns(sim, inputs, of)
    variations = Variations(thing, sim, world, time_step)
    try:
        return _measured(variations, columns, of, outputs)
    finally:
        variations.restore()


def _measured(variations: Variations, columns: dict[str, int], of: str, outputs: Outputs | None) -> Linearisation:
    sim, free = variations.simulation, variations.free()
    model, d = sim.model, free.count
    measure = outputs or _all_coordinates

    def row(rows: Array) -> Array:
        """States, how fast they change, bodies and outputs of every world, one after the other."""
        change, rates = free.spread(rows[:, :d]), free.spread(rows[:, d:])
        variations.place(change, rates)
        variations.check_placed()
        outs = np.array(measure(sim), np.float64).reshape(model.world_count, -1)
        response = variations.respond(change, rates)
        return np.concatenate([*states(response, free), response.bodies.reshape(len(rows), -1), outs], axis=1)

    _check_regular(variations, free)
    steps = np.diag(np.repeat([POSITION_STEP, RATE_STEP], d))
    change = 0.5 * (variations.over_lanes(steps, row) - variations.over_lanes(-steps, row))
    ends = np.cumsum([2 * d, 2 * d, 6 * model.body_count])
    moved, rates, bodies, outs = np.split(change, ends)
    inverse = np.linalg.inv(moved)
    at_rest = variations.over_lanes(np.zeros((1, 2 * d)), row)[3 * d : 4 * d, 0]
    b, c = _input_matrix(variations, free, columns, of), outs @ inverse
    return Linearisation(
        rates @ inverse, b, c, np.zeros((len(c), b.shape[1])), free.titles, tuple(columns), at_rest, free.basis,
        variations.titles, (bodies @ inverse)[:, :d].reshape(model.body_count, 6, d), model.body_names,
        *variations.base_poses(),
    )  # fmt: skip


def states(response: Response, free: FreeCoordinates) -> tuple[Array, Array]:
    """(W, 2d) free coordinates and their rates, and how fast these change."""
    index = free.index
    return (
        np.concatenate([response.position[:, index], response.rate[:, index]], axis=1),
        np.concatenate([response.motion[:, index], response.acceleration[:, index]], axis=1),
    )


def _check_regular(variations: Variations, free: FreeCoordinates) -> None:
    """Refuse a position at which coordinates cannot follow their rates: loops would pull them back."""
    size = FAR * np.where(variations.travels()[free.index], min(1.0, variations.extent()), 1.0)

    def row(rows: Array) -> Array:
        variations.place(free.spread(rows))
        reached = variations.positions()[:, free.index]
        reached[variations.open_worlds()] = 0.0
        return reached

    steps = np.diag(size)
    arrived = np.diag(variations.over_lanes(steps, row) - variations.over_lanes(-steps, row)) / (2.0 * size)
    stuck = np.flatnonzero(~(np.abs(arrived - 1.0) < SINGULAR))
    if len(stuck):
        raise ModelError(
            f"{variations.thing}: the mechanism is at a singular position: {free.titles[int(stuck[0])]} cannot move as "
            "its rate says; move it away from where it locks or branches"
        )


def _all_coordinates(simulation: Simulation) -> Array:
    """(W, 2 dofs) coordinates of joints, and their rates."""
    state = simulation.state
    return np.concatenate([state.joint_x.numpy(), state.joint_qd.numpy()], axis=1)


def _input_columns(simulation: Simulation, inputs: Sequence[str] | None, of: str) -> dict[str, int]:
    """Place in the array of `Control` by the name of the input."""
    model = simulation.model
    if of not in INPUTS:
        raise ModelError(f"linearise: of must be one of {', '.join(INPUTS)}, got {formatted(of)}")
    names = model.joint_names if inputs is None else tuple(inputs)
    found = {}
    for name in names:
        if name not in model.joint_names:
            raise ModelError(f"linearise: inputs must be names of joints, got {formatted(name)}; see model.joint_names")
        joint = model.joint_names.index(name)
        first, end = model.joint_dof_start[joint], model.joint_dof_start[joint + 1]
        for dof in range(first, end):
            found[name if end == first + 1 else f"{name} ({dof - first})"] = dof
    return found


def _input_matrix(variations: Variations, free: FreeCoordinates, columns: dict[str, int], of: str) -> Array:
    """(2d, m) of what inputs do."""
    count = len(columns)
    if not count:
        return np.zeros((2 * free.count, 0))
    still = np.zeros((variations.simulation.model.world_count, variations.count))
    dofs = list(columns.values())

    def row(rows: Array) -> Array:
        inputs = np.zeros((len(rows), variations.simulation.model.dof_count))
        inputs[:, dofs] = rows
        return states(variations.respond(still, inputs=(of, inputs)), free)[1]

    steps = INPUT_STEP * np.eye(count)
    return 0.5 / INPUT_STEP * (variations.over_lanes(steps, row) - variations.over_lanes(-steps, row))
