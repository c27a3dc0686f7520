"""Equilibrium of a simulation's worlds, found without waiting for vibrations to die out."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.analysis.variations import (
    POSITION_STEP,
    Array,
    FreeCoordinates,
    Variations,
    checked_simulation,
    pushing_contacts,
)
from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, formatted, number
from simwarp.model.checks import whole_number
from simwarp.simulation.simulation import Simulation

FIRST_TRIAL: Final = 50
"""Steps of kinetic damping before Newton's method is tried; twice as many before each further trial."""
NEWTON_STEPS: Final = 12
LARGEST_TURN: Final = 0.3
"""Largest change of a coordinate in a step of Newton's method [m or rad]."""
QUIET_STEPS: Final = 10
"""Steps for which worlds must rest where contacts push, or dry friction and bristles hold."""
WORST: Final = 2.0
"""Growth of the acceleration beyond its smallest at which Newton's method is given up and kinetic damping goes on."""
NEARLY_STILL: Final = 20.0
"""Rate over the solver's tolerance below which a world rests on its contacts: a box on a slope trembles by ten."""
HELD_STILL: Final = 2.0
"""The same where dry friction of joints or bristles of tires hold, whose residuals are smaller."""
INDEPENDENT: Final = 1e-6
"""Part of the largest stiffness below which a direction has none, and Newton's method leaves it alone."""
RESOLVED: Final = 1e-6
"""Step of Newton's method that is none [m or rad]: light links have accelerations that float32 does not resolve."""
UNSTABLE: Final = 1e-3
"""Part of the largest stiffness by which the smallest may seem to be below zero."""
RATES: Final = ("body_v", "body_omega", "body_omega_last", "body_v_low", "body_omega_low", "joint_qd")
Flags = npt.NDArray[np.bool_]


@dataclasses.dataclass(frozen=True, repr=False)
class StaticResult(Readable):
    """How an equilibrium was found.

    Attributes:
        steps: of the simulation with kinetic damping.
        newton_steps: of Newton's method, the last of which ended at the equilibrium.
        acceleration: (W,) largest that is left of a free coordinate [m/s² or rad/s²].
        stable: (W,) False where a small push would grow, as of a pendulum on its head; True where contacts push.
        by_contacts: contacts push, or dry friction of joints (brakes) or what elements remember (bristles of tires)
            holds: it is one of many, the one that is reached from the given state.
    """

    steps: int
    newton_steps: int
    acceleration: Array
    stable: Flags
    by_contacts: bool

    def _readable_title(self) -> str:
        left = float(self.acceleration.max(initial=0.0))
        return f": {left:.2g} m/s² or rad/s² after {self.steps} steps and {self.newton_steps} of Newton's method"


def solve_static(simulation: Simulation, *, tolerance: float = 1e-3, max_steps: int = 20_000) -> StaticResult:
    """Bring every world to rest in an equilibrium, and leave it there.

    The simulation steps, and rates are taken away whenever their energy has turned (kinetic damping: Cundall 1976),
    which finds the valley; Newton's method on the accelerations finds its bottom. Where contacts push or dry friction
    of joints holds, there is no derivative: kinetic damping goes on alone. With friction many states are at rest, and
    the one that is reached from the given one is found: a vehicle on its brakes keeps the side forces of its tires.

    Args:
        simulation: its present state is where the search begins, and is replaced; its clock stays.
        tolerance: acceleration that may be left [m/s² or rad/s²]; with contacts and dry friction, what their solver
            leaves; or Newton's method wants to move by less than 1e-6 m or rad, as with light links, whose
            accelerations float32 does not resolve.
        max_steps: of the simulation.

    Raises:
        ModelError: no equilibrium was found; names the world, what still accelerates, and how much. The state is then
            the one that was there.
    """
    thing = "solve_static"
    sim = checked_simulation(thing, simulation)
    bound = number(tolerance)
    if not 0.0 < bound < np.inf:
        raise ModelError(f"{thing}: tolerance must be > 0 m/s², got {formatted(tolerance)}; 1e-3 is the default")
    limit = whole_number(thing, "max_steps", max_steps, 0, 10**9, "20000 is the default")
    kept, time = sim.snapshot(), sim.time.numpy().copy()
    try:
        found = _search(thing, sim, bound, limit)
    except BaseException:
        sim.restore(kept)
        raise
    sim.time.assign(time)
    return found


def _search(thing: str, sim: Simulation, tolerance: float, max_steps: int) -> StaticResult:
    _stand_still(sim, np.ones(sim.model.world_count, bool))
    relaxation = _Relaxation(sim)
    steps, trial, failed, resting = 0, 0, "", False
    while True:
        if resting:
            worlds = sim.model.world_count
            return StaticResult(steps, 0, relaxation.acceleration, np.ones(worlds, bool), by_contacts=True)
        if not relaxation.pushing() and not sliding_bounds(sim):
            newton = _Newton(thing, sim, tolerance)
            if newton.converge(any_equilibrium=steps == 0):
                return StaticResult(steps, newton.steps, newton.size, newton.stable, by_contacts=False)
            failed = newton.failed
        if steps >= max_steps:
            break
        until = min(max_steps, steps + FIRST_TRIAL * 2**trial)
        resting = False
        while steps < until and not resting:
            relaxation.step()
            steps += 1
            resting = relaxation.resting(tolerance)
        trial += 1
    what = relaxation.worst() if relaxation.pushing() or not failed else failed
    raise ModelError(
        f"{thing}: no equilibrium was found near the given state: {what} after {steps} steps (tolerance "
        f"{tolerance:g}); support what falls, or start nearer"
    )


class _Relaxation:
    """Kinetic damping of all worlds.

    Attributes:
        acceleration: (W,) largest change of a rate in the last step, by its time.
    """

    def __init__(self, sim: Simulation) -> None:
        self.sim = sim
        worlds = sim.model.world_count
        self.acceleration = np.full(worlds, np.inf)
        self._speed = np.full(worlds, np.inf)
        self._energy = np.zeros(worlds)
        self._calm = self._slow = 0
        self._since = _rates(sim)
        self._held = remembering(sim)
        self._mass = np.asarray(sim.model.body_mass.numpy(), np.float64)[:, :, None]

    def step(self) -> None:
        """One step of the simulation; worlds whose energy has turned stand still after it."""
        sim = self.sim
        before = _rates(sim)
        sim.step()
        after = _rates(sim)
        self.acceleration = np.abs(after - before).max(axis=1, initial=0.0) / sim.dt
        self._speed = np.abs(after).max(axis=1, initial=0.0)
        # Any norm of the rates turns with the energy; masses keep light links from ruling it
        v, omega, qd = (getattr(sim.state, name).numpy() for name in ("body_v", "body_omega", "joint_qd"))
        energy = (self._mass * (v**2 + omega**2)).sum(axis=(1, 2)) + (qd.astype(np.float64) ** 2).sum(axis=1)
        turned = (energy < self._energy) & (self._speed > NEARLY_STILL * sim.solver.tolerance)
        if turned.any():
            _stand_still(sim, turned)
            energy[turned] = 0.0
            self._since, self._slow = _rates(sim), 0
        self._energy = energy

    def resting(self, tolerance: float) -> bool:
        """Whether all worlds are at rest, where that is no matter of derivatives."""
        if self.pushing():
            return self._quiet(tolerance)
        return (self._held or sliding_bounds(self.sim)) and self._holds(tolerance)

    def _holds(self, tolerance: float) -> bool:
        """The same under dry friction of joints and bristles, which tremble by single steps: over some steps together,
        so that slow modes have come to rest, too.
        """
        sim = self.sim
        self._slow = self._slow + 1 if (self._speed <= HELD_STILL * sim.solver.tolerance).all() else 0
        if self._slow == 0:
            self._since = _rates(sim)
        if self._slow < QUIET_STEPS:
            return False
        span = QUIET_STEPS * sim.dt
        rates = _rates(sim)
        self.acceleration = np.abs(rates - self._since).max(axis=1, initial=0.0) / span
        self._since, self._slow = rates, 0
        return bool((self.acceleration <= max(tolerance, HELD_STILL * sim.solver.tolerance / span)).all())

    def _quiet(self, tolerance: float) -> bool:
        """Whether all worlds have been at rest for some steps, as far as the solver of the contacts finds it."""
        residual = NEARLY_STILL * self.sim.solver.tolerance
        still = (self._speed <= residual).all()
        still &= (self.acceleration <= max(tolerance, residual / self.sim.dt)).all()
        self._calm = self._calm + 1 if still else 0
        return self._calm >= QUIET_STEPS

    def pushing(self) -> bool:
        """Whether contacts push somewhere."""
        return bool(pushing_contacts(self.sim).any())

    def worst(self) -> str:
        """What moves most."""
        world = int(np.nanargmax(np.where(np.isfinite(self.acceleration), self.acceleration, -1.0)))
        return f"world {world} still accelerates by {self.acceleration[world]:.3g} m/s² or rad/s²"


class _Newton:
    """Newton's method on the accelerations at the simulation's present state.

    Attributes:
        steps: that were made.
        size: (W,) largest acceleration of a free coordinate.
        stable: (W,) whether no push grows.
        failed: what still accelerates, where it did not converge.
    """

    def __init__(self, thing: str, sim: Simulation, tolerance: float) -> None:
        self.thing, self.sim, self.tolerance = thing, sim, tolerance
        self.steps = 0
        self.size = np.full(sim.model.world_count, np.inf)
        self.stable = np.zeros(sim.model.world_count, bool)
        self.failed = ""
        self._kept = sim.snapshot()

    def converge(self, *, any_equilibrium: bool) -> bool:
        """Go to an equilibrium near by, and stand there; False, at the state that was there, where there is none.

        Args:
            any_equilibrium: the present state will do even if pushes grow from it: it was given.
        """
        variations = Variations(self.thing, self.sim, None)
        smallest = np.full(len(self.size), np.inf)
        for self.steps in range(NEWTON_STEPS):
            free = variations.free()

            def accelerations(q: Array, free: FreeCoordinates = free) -> Array:
                """(W, d) at rest beside the base."""
                return variations.respond(free.spread(q), extrapolate=False).acceleration[:, free.index]

            still = np.zeros((len(self.size), free.count))
            a = accelerations(still)
            self.size = np.abs(a).max(axis=1)
            hopeless = (self.size > WORST * smallest + self.tolerance).any()
            if not np.isfinite(a).all() or hopeless:
                break
            smallest = np.minimum(smallest, self.size)
            slope = np.zeros((len(a), free.count, free.count))
            for column in range(free.count):
                q = still.copy()
                q[:, column] = POSITION_STEP
                slope[:, :, column] = (accelerations(q) - accelerations(-q)) / (2.0 * POSITION_STEP)
            if not np.isfinite(slope).all():
                break
            values = np.linalg.eigvals(slope).real
            self.stable = values.max(axis=1) <= UNSTABLE * np.abs(values).max(axis=1)
            step = np.einsum("wij,wj->wi", np.linalg.pinv(-slope, rcond=INDEPENDENT), a)
            left = np.abs(a + np.einsum("wij,wj->wi", slope, step)).max(axis=1)
            short = np.abs(step).max(axis=1)
            close = (self.size <= self.tolerance) & (short <= 10.0 * RESOLVED)
            arrived = close | ((short <= RESOLVED) & (left <= 0.1 * self.size))
            if arrived.all() and ((any_equilibrium and self.steps == 0) or self.stable.all()):
                variations.place(free.spread(still))
                _stand_still(self.sim, np.ones(len(a), bool))
                return True
            if not self.stable.all() and self.steps > 1:
                break
            step *= np.minimum(1.0, LARGEST_TURN / np.maximum(np.abs(step).max(axis=1), 1e-30))[:, None]
            variations.place(free.spread(step))
            if variations.open_worlds().any():
                break
            _stand_still(self.sim, np.ones(len(a), bool))
            variations.rebase()
        world = int(np.nan_to_num(self.size, nan=np.inf).argmax())
        title = free.titles[int(np.nan_to_num(np.abs(a[world]), nan=np.inf).argmax())]
        self.failed = f"{title} of world {world} still accelerates by {self.size[world]:.3g} m/s² or rad/s²"
        self.sim.restore(self._kept)
        return False


def sliding_bounds(sim: Simulation) -> bool:
    """Whether dry friction acts in a joint now, for brakes write its bound in a step: it has no derivative."""
    friction = sim.model.parameters.joint_friction
    return bool(friction.size) and bool((friction.numpy() > 0.0).any())


def remembering(sim: Simulation) -> bool:
    """Whether a force element remembers: what a bristle or a filter holds depends on how it came there."""
    return any(len(element.memory) > 0 for element in sim.elements)


def _rates(sim: Simulation) -> Array:
    """(W, k) of all bodies and joints."""
    state, worlds = sim.state, sim.model.world_count
    parts = [each.numpy().reshape(worlds, -1) for each in (state.body_v, state.body_omega, state.joint_qd)]
    return np.concatenate(parts, axis=1).astype(np.float64)


def _stand_still(sim: Simulation, worlds: Flags) -> None:
    """Take all rates of some worlds away."""
    for name in RATES:
        array = getattr(sim.state, name)
        if worlds.all():
            array.zero_()
        elif array.size:
            values = array.numpy()
            values[worlds] = 0.0
            array.assign(values)
