"""Small changes of a state, and the accelerations that follow: what statics, linearisation and modes work with.

The coordinates of a model are those of its joints, then six of every body that moves without a joint: its place and its
turn. Loops, couplings and prescribed motions tie them together, so that only some are free. Which ones is found from
the velocities that the constraints let through.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr
from scipy.spatial.transform import Rotation

from simwarp.core.types import JointType, ModelError, WorldStatus, formatted
from simwarp.model.flexible_meshes import refuse_meshes
from simwarp.model.limit_order import coordinate_titles
from simwarp.model.parameters import PARAMETERS
from simwarp.simulation.simulation import Simulation

Array: TypeAlias = npt.NDArray[np.float64]

ROOT: Final = 6
"""Coordinates of a body that moves without a joint."""
INDEPENDENT: Final = 1e-4
"""Share of the largest, from which a direction of the velocities counts: float32 leaves 1e-6 in forbidden ones."""
POSITION_STEP: Final = 1e-3
"""Change of a coordinate for a difference [m or rad]."""
RATE_STEP: Final = 1e-2
"""Change of a rate for a difference [m/s or rad/s]."""
TIME_STEP: Final = 1e-4
"""Longest step from whose change of velocity an acceleration is taken [s]."""
STILL: Final = 1e-6
"""Turn [rad] and rate [rad/s] below which a rotation vector changes by its rates."""
LENGTHS: Final = {
    JointType.PRISMATIC: 1, JointType.CYLINDRICAL: 1, JointType.PLANAR: 2, JointType.FREE: 3,
    JointType.ELASTIC: 3,
}  # fmt: skip
"""How many of a joint's first coordinates are lengths."""
AXES: Final = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


class Response(NamedTuple):
    """What followed a change of the state, in every world.

    Attributes:
        position: (W, n) coordinates that were reached; turns of free bodies from those of the base [m or rad].
        rate: (W, n) rates before the step [m/s or rad/s].
        motion: (W, n) how fast the coordinates change [m/s or rad/s]: the rates, but for rotation vectors.
        acceleration: (W, n) of the rates [m/s² or rad/s²]. Both by two steps and extrapolation to one of no length.
        bodies: (W, bodies, 6) places, then turns from those of the base [m, rad].
    """

    position: Array
    rate: Array
    motion: Array
    acceleration: Array
    bodies: Array


@dataclasses.dataclass(frozen=True)
class FreeCoordinates:
    """Coordinates whose rates determine all others.

    Attributes:
        index: (d,) their places among all coordinates.
        basis: (n, d) rates of all coordinates for a unit rate of each of them; (W, n, d) where worlds
            have bases of their own.
        titles: what errors and tables call them.
    """

    index: npt.NDArray[np.intp]
    basis: Array
    titles: tuple[str, ...]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.index)

    def spread(self, change: Array) -> Array:
        """(W, n) of all coordinates for (W, d) of the free ones."""
        if self.basis.ndim == 2:
            return change @ self.basis.T
        return np.einsum("wnd,wd->wn", self.basis, change)


class Variations:
    """Changes of a simulation's present state. The state itself comes back by `restore`.

    Args:
        simulation: that is looked at.
        world: whose state all worlds get that have its parameters; None: each world its own.
        time_step: longest step of which an acceleration is taken [s].

    Attributes:
        titles: of all coordinates.
        lanes: worlds that are to be used: those like `world`, or all.

    Raises:
        ModelError: a world has broken down.
    """

    def __init__(self, thing: str, simulation: Simulation, world: int | None, time_step: float = TIME_STEP) -> None:
        self.thing, self.simulation, self.world = thing, simulation, world
        model = simulation.model
        self._roots = _roots(model)
        self.titles = (
            *coordinate_titles(model.joint_names, model.joint_dof_start),
            *(f"body '{model.body_names[body]}' ({axis})" for body in self._roots for axis in AXES),
        )
        self.lanes = np.arange(model.world_count) if world is None else alike(simulation, world)
        self._refuse_broken()
        self._kept = simulation.snapshot()
        self.rebase()
        self._h = min(simulation.dt / simulation.substeps, time_step)
        self._steps = [simulation.physics_of(self._h), simulation.physics_of(0.5 * self._h)]

    def rebase(self) -> None:
        """Let changes begin at the present state."""
        self._base = self.simulation.snapshot()
        if self.world is not None:
            self._spread(self.world)
        state = self._base.state
        self._rotations = state.body_rot.numpy()
        self._x, self._v, self._omega = (each.numpy() for each in (state.body_x, state.body_v, state.body_omega))
        self._q = state.joint_q.numpy().astype(np.float64)
        self._qd = state.joint_qd.numpy().astype(np.float64)
        self._turned = self._turned_coordinates()

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return len(self.titles)

    def base_poses(self) -> tuple[Array, Array]:
        """Places (bodies, 3) [m] and turns (bodies, 4) xyzw of the base, in the first lane."""
        return self._x[self.lanes[0]].copy(), self._rotations[self.lanes[0]].copy()

    def extent(self) -> float:
        """How far the bodies of the first lane are apart [m]; infinite of a single one."""
        x = self._x[self.lanes[0]]
        apart = float(np.ptp(x, axis=0).max()) if len(x) else 0.0
        return apart or float("inf")

    def travels(self) -> npt.NDArray[np.bool_]:
        """(n,) coordinates that are lengths; the others are angles."""
        model = self.simulation.model
        found = [
            local < LENGTHS.get(kind, 0)
            for joint, kind in enumerate(model.joint_types)
            for local in range(model.joint_dof_start[joint + 1] - model.joint_dof_start[joint])
        ]
        return np.array([*found, *([True] * 3 + [False] * 3) * len(self._roots)], bool)

    def restore(self) -> None:
        """Bring back the state that was there."""
        self.simulation.restore(self._kept)

    def place(self, change: Array, rates: Array | None = None) -> None:
        """Put every world to its base state with changes (W, n) of coordinates and rates; loops are closed again."""
        sim, dofs = self.simulation, self.simulation.model.dof_count
        sim.restore(self._base)
        rates = np.zeros_like(change) if rates is None else rates
        if self._roots:
            x, rot, v, omega = self._x.copy(), self._rotations.copy(), self._v.copy(), self._omega.copy()
            for index, body in enumerate(self._roots):
                first = dofs + ROOT * index
                x[:, body] += change[:, first : first + 3]
                turn = Rotation.from_rotvec(change[:, first + 3 : first + ROOT])
                rot[:, body] = (turn * Rotation.from_quat(self._rotations[:, body])).as_quat()
                v[:, body] += rates[:, first : first + 3]
                omega[:, body] += rates[:, first + 3 : first + ROOT]
            for array, values in (
                (sim.state.body_x, x), (sim.state.body_rot, rot), (sim.state.body_v, v), (sim.state.body_omega, omega)
            ):  # fmt: skip
                array.assign(values)
        q, qd = self._q + change[:, :dofs], self._qd + rates[:, :dofs]
        sim.set_joint_state(None, q.astype(np.float32), qd.astype(np.float32))

    def rates(self) -> Array:
        """(W, n) present rates of the coordinates."""
        state = self.simulation.state
        parts = [state.joint_qd.numpy()]
        v, omega = state.body_v.numpy(), state.body_omega.numpy()
        parts += [array[:, body] for body in self._roots for array in (v, omega)]
        return np.concatenate(parts, axis=1).astype(np.float64)

    def respond(
        self, change: Array, rates: Array | None = None, *, inputs: tuple[str, Array] | None = None,
        extrapolate: bool = True,
    ) -> Response:  # fmt: skip
        """Accelerations after a change; see `Response`.

        Args:
            change, rates: (W, n) of coordinates and rates.
            inputs: an array of `Control`, and (W, dofs) changes of it.
            extrapolate: to a step of no length; False: one step, where an acceleration of zero is looked for.
        """
        motion, acceleration = [], []
        for index, commands in enumerate(self._steps[: 2 if extrapolate else 1]):
            self.place(change, rates)
            if inputs is not None:
                array = getattr(self.simulation.control, inputs[0])
                array.assign((array.numpy() + inputs[1]).astype(np.float32))
            position, bodies, rate = self.positions(), self._bodies(), self.rates()
            self.simulation.shares.run(commands)
            h = self._h / (index + 1)
            motion.append((self.positions() - position) / h)
            acceleration.append((self.rates() - rate) / h)
        if not extrapolate:
            return Response(position, rate, np.where(self._turned, motion[0], rate), acceleration[0], bodies)
        moving, accelerating = (2.0 * each[1] - each[0] for each in (motion, acceleration))
        return Response(position, rate, np.where(self._turned, moving, rate), accelerating, bodies)

    def free(self) -> FreeCoordinates:
        """Find coordinates whose rates determine those of all others: where worlds have bases of their own, the same
        ones in all of them, chosen in the first.

        Raises:
            ModelError: nothing can move.
        """
        changes = np.eye(self.count)
        if self.world is None:
            rows = [self._bound(np.broadcast_to(row, (len(self._q), self.count))) for row in changes]
            bound = np.stack(rows, axis=2)
        else:
            bound = self.over_lanes(changes, self._bound)[None]
        columns = bound[0]
        _, upper, order = qr(columns, pivoting=True, mode="economic")
        sizes = np.abs(np.diag(upper))
        rank = int((sizes > INDEPENDENT * max(float(sizes.max(initial=0.0)), 1e-30)).sum())
        if rank == 0 or not sizes.max(initial=0.0) > 0.0:
            raise ModelError(f"{self.thing}: the model has no coordinate that can move; leave a joint free")
        index = np.sort(qr(columns[:, order[:rank]].T, pivoting=True, mode="r")[1][:rank])
        span = bound[:, :, order[:rank]]
        basis = span @ np.linalg.pinv(span[:, index])
        return FreeCoordinates(
            index, basis if self.world is None else basis[0], tuple(self.titles[row] for row in index)
        )  # fmt: skip

    def over_lanes(self, changes: Array, measure: Any) -> Array:
        """Measure a row of changes in each lane, in as many calls as that takes; results by column.

        Args:
            changes: (k, m), one row for each result.
            measure: of (W, m) changes, one row per world, to (W, r).
        """
        worlds = self.simulation.model.world_count
        found = []
        for first in range(0, len(changes), len(self.lanes)):
            some = changes[first : first + len(self.lanes)]
            rows = np.zeros((worlds, changes.shape[1]))
            rows[self.lanes[: len(some)]] = some
            found.append(measure(rows)[self.lanes[: len(some)]])
        return np.concatenate(found).T

    def open_worlds(self) -> npt.NDArray[np.bool_]:
        """(W,) whether loops could not be closed."""
        found: npt.NDArray[np.bool_] = self.simulation.state.world_status.numpy() & int(WorldStatus.NOT_ASSEMBLED) != 0
        return found

    def check_placed(self) -> None:
        """Refuse a state whose loops could not be closed."""
        stuck = self.lanes[self.open_worlds()[self.lanes]]
        if len(stuck):
            raise ModelError(
                f"{self.thing}: loops of world {stuck[0]} do not close beside its state; assemble it "
                "(analysis.assemble), or move it away from where it locks"
            )

    # ---- inside --------------------------------------------------------------------------------------------------

    def _bound(self, rates: Array) -> Array:
        """(W, n) rates that constraints let through, beside those of the base."""
        still = np.zeros_like(rates)
        self.place(still, rates)
        forth = self.rates()
        self.place(still, -rates)
        return 0.5 * (forth - self.rates())

    def positions(self) -> Array:
        """(W, n) present coordinates; turns of free bodies from those of the base."""
        state, dofs = self.simulation.state, self.simulation.model.dof_count
        bodies = self._bodies()
        return np.concatenate([state.joint_x.numpy()[:, :dofs], *(bodies[:, body] for body in self._roots)], axis=1)

    def _turned_coordinates(self) -> npt.NDArray[np.bool_]:
        """(W, n) coordinates that do not change by their rates: of rotation vectors that are not zero, or turn."""
        model, dofs = self.simulation.model, self.simulation.model.dof_count
        turned = np.zeros((model.world_count, self.count), bool)
        for joint, kind in enumerate(model.joint_types):
            if kind in (JointType.SPHERICAL, JointType.FREE):
                part = slice(model.joint_dof_start[joint + 1] - 3, model.joint_dof_start[joint + 1])
                size = np.abs(self._q[:, part]) + np.abs(self._qd[:, part])
                turned[:, part] = (size > STILL).any(axis=1)[:, None]
        for index, body in enumerate(self._roots):
            first = dofs + ROOT * index + 3
            turned[:, first : first + 3] = (np.abs(self._omega[:, body]) > STILL).any(axis=1)[:, None]
        return turned

    def _bodies(self) -> Array:
        """(W, bodies, 6) places, and turns from the base [m, rad]."""
        state = self.simulation.state
        x, rot = state.body_x.numpy(), state.body_rot.numpy()
        turn = Rotation.from_quat(rot.reshape(-1, 4)) * Rotation.from_quat(self._rotations.reshape(-1, 4)).inv()
        return np.concatenate([x, turn.as_rotvec().reshape(x.shape)], axis=2)

    def _spread(self, world: int) -> None:
        """Give the lanes the world's state, control and memory."""
        worlds = self.simulation.model.world_count
        for array in self._base.arrays().values():
            if array.shape[0] % worlds or not array.size or array.shape[0] == 0:
                continue  # shared by all worlds
            values = array.numpy()
            rows = values.reshape(worlds, -1)
            rows[self.lanes] = rows[world]
            array.assign(rows.reshape(values.shape))

    def _refuse_broken(self) -> None:
        sim = self.simulation
        status = sim.state.world_status.numpy()[self._asked()]
        if status.any():
            world = int(self._asked()[int(np.argmax(status != 0))])
            raise ModelError(f"{self.thing}: world {world} has broken down; see simulation.problems()")

    def _asked(self) -> npt.NDArray[np.intp]:
        return self.lanes if self.world is None else np.array([self.world])


def alike(simulation: Simulation, world: int) -> npt.NDArray[np.intp]:
    """Worlds whose parameters are those of `world`, itself first; it alone where force elements may have numbers of
    their own in every world.
    """
    model = simulation.model
    if simulation.elements:
        return np.array([world])
    same = np.ones(model.world_count, bool)
    for name in PARAMETERS:
        values = getattr(model, name).numpy()
        if values.shape[0] == model.world_count and values.size:
            rows = values.reshape(model.world_count, -1)
            same &= (rows == rows[world]).all(axis=1)
    same[world] = False
    return np.array([world, *np.flatnonzero(same)])


def refuse_contacts(thing: str, simulation: Simulation, worlds: Sequence[int] | npt.NDArray[np.intp]) -> None:
    """Refuse worlds in which contacts push: their forces have no derivative.

    Raises:
        ModelError: names the first such world.
    """
    pushing = pushing_contacts(simulation)
    for world in worlds:
        if pushing[world]:
            raise ModelError(
                f"{thing}: contacts must not push, got {pushing[world]} that do in world {int(world)}; stand the model "
                "on springs, joints or tires, or take the ground away"
            )


def pushing_contacts(simulation: Simulation) -> npt.NDArray[np.int64]:
    """(W,) contacts with an impulse in the last step."""
    contacts = simulation.contacts
    if not contacts.contact_impulse.size:
        return np.zeros(simulation.model.world_count, np.int64)
    count = contacts.contact_count.numpy()[:, None]
    size = np.abs(contacts.contact_impulse.numpy()).max(axis=2)
    found: npt.NDArray[np.int64] = ((size > 0.0) & (np.arange(size.shape[1])[None] < count)).sum(axis=1)
    return found


def checked_simulation(thing: str, simulation: Any) -> Simulation:
    """A simulation, or a ModelError."""
    if not isinstance(simulation, Simulation):
        raise ModelError(f"{thing}: simulation must be a Simulation, got {formatted(simulation)}; pass Simulation(...)")
    refuse_meshes(thing, simulation.model.builder)
    return simulation


def _roots(model: Any) -> list[int]:
    """Bodies that move freely without a joint of the model."""
    t = model.topology
    kinds, joints, bodies = (getattr(t, name).numpy() for name in ("link_type", "link_joint", "link_body"))
    free = int(JointType.FREE)
    return [int(body) for kind, joint, body in zip(kinds, joints, bodies, strict=True) if kind == free and joint < 0]
