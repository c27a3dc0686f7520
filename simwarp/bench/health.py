"""Checks that a final state is sound: an exploded world may be stepped very fast indeed."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WorldStatus
from simwarp.simulation.simulation import Simulation

Array = npt.NDArray[np.float64]

RESIDUAL_SHARE = 1e-3
"""Largest sound residual of a row, as a share of the fastest body's speed; in m/s or rad/s below 1 m/s."""


@dataclasses.dataclass(frozen=True)
class Health:
    """Diagnostics of a state; the worst world counts.

    Attributes:
        problems: reasons why it is refused; empty when it is sound.
        residual: of any row [m/s or rad/s].
        position_error: of any joint [m or rad].
        energy_gain: mechanical energy above that of the start [J].
        max_speed: of any body [m/s].
        penetration: of any contact [m].
        contacts: that push, mean of the worlds; None without shapes.
        iterations: of the solver, mean of the worlds.
    """

    problems: tuple[str, ...]
    residual: float
    position_error: float
    energy_gain: float
    max_speed: float
    penetration: float | None = None
    contacts: float | None = None
    iterations: float | None = None

    def worse(self, other: Health) -> Health:
        """Both together: the larger of every number (NaN counts as largest), the problems of either."""
        numbers = (
            _larger(getattr(self, field.name), getattr(other, field.name)) for field in dataclasses.fields(self)[1:]
        )
        return Health(tuple(dict.fromkeys(self.problems + other.problems)), *numbers)  # type: ignore[arg-type]


class HealthCheck(Protocol):
    """Interface of a health check."""

    def examine(self) -> Health:
        """Judges the state now; waits for the device."""
        ...


class MotionHealthCheck:
    """Health check of a motion's final state against its start."""

    def __init__(
        self, sim: Simulation, *, energy_gain: float | None, position_error: float, penetration: float
    ) -> None:
        self.sim = sim
        self.position_error = position_error
        self.penetration = penetration
        self.start_energy = mechanical_energy(sim)
        self.energy_gain = 1e-6 + 0.1 * _energy_held(sim) if energy_gain is None else energy_gain

    def examine(self) -> Health:
        """Judges the state now; waits for the device."""
        state = self.sim.state
        speed = float(np.linalg.norm(state.body_v.numpy(), axis=-1).max(initial=0.0))
        problems, finite, residual, position_error = examine_solution(self.sim, speed, "m/s", self.position_error)
        penetration, contacts = None, None
        if self.sim.model.shape_count:
            penetration, contacts = _largest(self.sim.contacts.penetration), pushing_contacts(self.sim)
            if not penetration <= self.penetration:
                problems.append(f"contacts are {penetration:.2g} m deep (sound: {self.penetration:g} m)")
            left_out = int(self.sim.contacts.contact_overflow.numpy().max(initial=0))
            if left_out > 0:
                problems.append(f"{left_out} contacts of a world found no room")
        gain = float((mechanical_energy(self.sim) - self.start_energy).max(initial=0.0)) if finite else float("nan")
        if finite and not gain <= self.energy_gain:
            problems.append(f"energy rose by {gain:.3g} J (sound: {self.energy_gain:.3g} J)")
        if finite and max(speed, float(np.abs(state.body_omega.numpy()).max(initial=0.0))) < 1e-9:
            problems.append("nothing moves: this is no work")
        return Health(
            tuple(problems), residual, position_error, gain, speed, penetration, contacts,
            float(self.sim.diagnostics.iterations.numpy().mean()),
        )  # fmt: skip


def examine_solution(
    sim: Simulation, speed: float, unit: str, largest_error: float
) -> tuple[list[str], bool, float, float]:
    """What must hold in any motion: a finite state, solved rows, joints together.

    Args:
        sim: in motion.
        speed: that residuals are compared with [m/s].
        unit: of residuals.
        largest_error: of a sound joint [m or rad].

    Returns:
        The problems, whether the state is finite, the largest residual of a row and the largest error of a joint.
    """
    state, reports = sim.state, sim.diagnostics
    names = ("body_x", "body_rot", "body_v", "body_omega", "joint_x")
    finite = all(np.isfinite(getattr(state, name).numpy()).all() for name in names)
    problems = [] if finite else ["a state is not finite"]
    status = int(np.bitwise_or.reduce(state.world_status.numpy()))
    if status:
        problems.append(f"world status {WorldStatus(status)!r}")
    residual = max(_largest(reports.row_residual), _largest(reports.cone_residual))
    if not residual <= RESIDUAL_SHARE * max(speed, 1.0):
        problems.append(f"row residual {residual:.2g} {unit} at {speed:.3g} m/s")
    error = _largest(reports.position_error)
    if not error <= largest_error:
        problems.append(f"joints are {error:.2g} m or rad apart (sound: {largest_error:g})")
    return problems, finite, residual, error


def pushing_contacts(sim: Simulation) -> float:
    """Contacts with an impulse, mean of the worlds."""
    contacts = sim.contacts
    normal = contacts.contact_impulse.numpy()[..., 0]
    in_use = np.arange(normal.shape[1]) < contacts.contact_count.numpy()[:, None]
    return float((in_use & (normal > 0.0)).sum(axis=1).mean())


def mechanical_energy(sim: Simulation) -> Array:
    """(W,) kinetic energy and that of gravity [J]; springs are left out."""
    return kinetic_energy(sim) + gravity_energy(sim)


def kinetic_energy(sim: Simulation) -> Array:
    """(W,) [J]."""
    v, omega = np.asarray(sim.state.body_v.numpy(), float), np.asarray(sim.state.body_omega.numpy(), float)
    mass, inertia = np.asarray(sim.model.body_mass.numpy(), float), np.asarray(sim.model.body_inertia_b.numpy(), float)
    # omega in the body frame: the inertia stays as it is
    omega_b = _rotate_back(sim.state.body_rot.numpy(), omega)
    twice = mass * (v * v).sum(-1) + np.einsum("...i,...ij,...j->...", omega_b, inertia, omega_b)
    return 0.5 * twice.sum(-1)


def gravity_energy(sim: Simulation) -> Array:
    """(W,) [J], zero at the origin."""
    mass, gravity = np.asarray(sim.model.body_mass.numpy(), float), _gravity(sim)
    return -(mass * (sim.state.body_x.numpy() * gravity[:, None, :]).sum(-1)).sum(-1)


def _energy_held(sim: Simulation) -> float:
    """Kinetic energy, and what gravity can do over the size of the scene [J]; the largest world's."""
    x = sim.state.body_x.numpy()
    size = float(np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=-1).max(initial=0.0)) + 1.0
    weight = np.asarray(sim.model.body_mass.numpy(), float).sum(-1) * np.linalg.norm(_gravity(sim), axis=-1)
    return float(kinetic_energy(sim).max(initial=0.0)) + size * float(weight.max(initial=0.0))


def _gravity(sim: Simulation) -> Array:
    """(1 or W, 3)."""
    return np.asarray(sim.model.gravity.numpy(), float).reshape(-1, 3)


def _larger(one: float | None, other: float | None) -> float | None:
    return other if one is None else one if other is None else float(np.maximum(one, other))


def _largest(array: Any) -> float:
    values = np.asarray(array.numpy(), float)
    return float(values.max(initial=0.0))


def _rotate_back(quat: Array, vector: Array) -> Array:
    """World vectors in the frames of unit quaternions xyzw."""
    axis, w = -quat[..., :3], quat[..., 3:]
    twice = 2.0 * np.cross(axis, vector)
    return vector + w * twice + np.cross(axis, twice)
