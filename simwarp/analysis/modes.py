"""Modes of vibration of a linear model, undamped and damped, and the motion of the bodies in them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import eig
from scipy.spatial.transform import Rotation

from simwarp.analysis.linearisation import Linearisation, linearise
from simwarp.analysis.variations import Array
from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import ModelError
from simwarp.model.checks import whole_number
from simwarp.simulation.simulation import Simulation

RESTING: Final = 0.05
"""Acceleration of a state that is taken for an equilibrium [m/s² or rad/s²],"""
AWAY: Final = 1e-3
"""or that of the stiffest coordinate so far from its equilibrium [m or rad]."""
UNEQUAL: Final = 1e-3
"""Share of the largest frequency below which a mode has none: float32 leaves some 1e-4 of it."""

Complex = npt.NDArray[np.complex128]


@dataclasses.dataclass(frozen=True, repr=False)
class Modes(Readable):
    """Modes in the order of their frequency. A shape is of unit size in its largest entry.

    Attributes:
        frequency: (k,) of the free vibration [Hz]; 0 of a mode that does not vibrate.
        decay: (k,) [1/s]: the amplitude falls with exp(-decay t); below zero it grows.
        damping_ratio: (k,) share of critical damping; 1 where a mode does not vibrate and decays, -1 where it grows.
        eigenvalue: (k,) complex [1/s].
        shapes: (k, d) complex, of the free coordinates.
        linearisation: that they are of.
    """

    frequency: Array
    decay: Array
    damping_ratio: Array
    eigenvalue: Complex
    shapes: Complex
    linearisation: Linearisation

    def coordinates(self, mode: int) -> Complex:
        """(n,) what all coordinates of the model do in a mode."""
        found: Complex = self.linearisation.basis @ self.shapes[self._checked(mode)]
        return found

    def bodies(self, mode: int) -> Complex:
        """(bodies, 6) places and turns of the bodies in a mode [m, rad]."""
        found: Complex = self.linearisation.bodies @ self.shapes[self._checked(mode)]
        return found

    def pose_changes(self, mode: int, phase: float, amplitude: float = 0.1) -> tuple[Array, Array]:
        """Places (bodies, 3) [m] and turns (bodies, 4) xyzw by which bodies leave the state at a phase of a mode.

        Args:
            mode: its index.
            phase: in the period [rad].
            amplitude: of the largest entry of its shape [m or rad].
        """
        change = amplitude * np.real(self.bodies(mode) * np.exp(1j * phase))
        return change[:, :3], Rotation.from_rotvec(change[:, 3:]).as_quat()

    def place(
        self, simulation: Simulation, phase: float, *, modes: Sequence[int] | None = None, amplitude: float = 0.1
    ) -> None:
        """Put the bodies of every world into a phase of a mode: world k shows the k-th of `modes`, and these in turn.

        Args:
            simulation: of the same model; its poses are replaced, its rates stay.
            phase: in the period [rad].
            modes: indices; None: all of them.
            amplitude: of the largest entry of a shape [m or rad].

        Raises:
            ModelError: the simulation has other bodies, or there is no such mode.
        """
        linear, model = self.linearisation, simulation.model
        if model.body_names != linear.body_names:
            raise ModelError(
                "modes: the simulation must have the bodies of the linear model; pass that which was linearised"
            )
        chosen = [self._checked(each) for each in (range(len(self.frequency)) if modes is None else modes)]
        if not chosen:
            raise ModelError("modes: there must be a mode to show, got none")
        changes = [self.pose_changes(each, phase, amplitude) for each in chosen]
        x = np.stack([linear.body_x + change[0] for change in changes])
        rot = np.stack([
            (Rotation.from_quat(change[1]) * Rotation.from_quat(linear.body_rot)).as_quat() for change in changes
        ])  # fmt: skip
        turn = np.arange(model.world_count) % len(chosen)
        simulation.state.body_x.assign(x[turn])
        simulation.state.body_rot.assign(rot[turn])
        simulation.measure()

    def _checked(self, mode: int) -> int:
        count = len(self.frequency)
        return whole_number("modes", "mode", mode, 0, count - 1, "count from 0")

    def _readable_title(self) -> str:
        return f": {plural(len(self.frequency), 'mode')}"

    def _readable_rows(self) -> dict[str, Any]:
        return {
            f"{index}": f"{self.frequency[index]:.4g} Hz, {self.damping_ratio[index]:.3g} of critical damping"
            for index in range(min(len(self.frequency), 12))
        }


def modes(of: Simulation | Linearisation, *, damped: bool = True, world: int = 0) -> Modes:
    """Modes of vibration about a state, which should be an equilibrium.

    Args:
        of: a simulation, which is linearised at its present state, or a linear model.
        damped: with dampers and what else depends on rates; False: K v = ω² M v alone.
        world: of the simulation.

    Raises:
        ModelError: as `linearise`; or the state accelerates, so that there are no vibrations about it.
    """
    linear = of if isinstance(of, Linearisation) else linearise(of, world=world, inputs=())
    check_equilibrium(linear)
    d = len(linear.coordinates)
    if damped:
        values, vectors = eig(linear.a)
        scale = float(np.abs(values).max(initial=1.0))
        values = np.where(np.abs(values.imag) < UNEQUAL * scale, values.real, values)
        keep = np.flatnonzero(values.imag >= 0.0)
        values, shapes = values[keep], vectors[:d, keep].T
        resting = np.abs(shapes).max(axis=1) == 0.0
        shapes[resting] = vectors[d:, keep].T[resting]
    else:
        squares, vectors = eig(linear.stiffness)
        squares = squares.real
        squares[np.abs(squares) < UNEQUAL**2 * float(np.abs(squares).max(initial=1.0))] = 0.0
        values = np.where(squares >= 0.0, 1j * np.sqrt(np.abs(squares)), np.sqrt(np.abs(squares)) + 0j)
        shapes = vectors.T.astype(np.complex128)
    order = np.argsort(np.abs(values), kind="stable")
    values, shapes = values[order], shapes[order]
    largest = shapes[np.arange(len(shapes)), np.abs(shapes).argmax(axis=1)]
    shapes = shapes / largest[:, None]
    size = np.abs(values)
    ratio = np.divide(-values.real, size, out=np.zeros(len(values)), where=size > 0.0)
    return Modes(np.abs(values.imag) / (2.0 * np.pi), -values.real, ratio, values, shapes, linear)


def check_equilibrium(linear: Linearisation) -> None:
    """Refuse a state that accelerates.

    Raises:
        ModelError: names the coordinate that accelerates most.
    """
    worst = int(np.abs(linear.acceleration).argmax())
    stiffest = float(np.abs(linear.stiffness).max(initial=0.0))
    if abs(linear.acceleration[worst]) > RESTING + AWAY * stiffest:
        raise ModelError(
            f"modes: the state must be an equilibrium, got {linear.acceleration[worst]:.3g} m/s² or rad/s² of "
            f"{linear.coordinates[worst]}; call analysis.solve_static first"
        )
