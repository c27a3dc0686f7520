"""Motion of the bodies of the shown worlds on the host."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.simulation.state import State
from simwarp.viewer.live.body_readback_kernels import gather_bodies

Array = npt.NDArray[np.float64]

NUMBERS: Final = 10
"""Of a body: centre of mass, orientation, velocity."""


class BodyReadback:
    """Centres of mass, orientations and velocities of some worlds' bodies.

    A CPU's are read where they are. A GPU's are copied to pinned memory behind the steps in its stream, and used when
    the event behind the copy has passed: nobody waits for the steps.

    Args:
        state: of the simulation.
        worlds: indices of the shown worlds.
    """

    def __init__(self, state: State, worlds: npt.NDArray[np.int64]) -> None:
        self._state, self._worlds = state, worlds
        self._device = wp.get_device(str(state.body_x.device))
        if self._device.is_cpu:
            return
        shape = (len(worlds), state.body_x.shape[1], NUMBERS)
        self._chosen: Any = wp.array(worlds.astype(np.int32), dtype=int, device=self._device)
        self._gathered: Any = wp.zeros(shape, dtype=wp.float64, device=self._device)
        self._pinned: Any = wp.zeros(shape, dtype=wp.float64, device="cpu", pinned=True)
        self._arrived: Any = wp.Event(self._device)
        self._under_way = False
        self._rows = np.zeros(shape)
        self.read()

    @property
    def positions(self) -> Array:
        """(S, B, 3) centres of mass [m]."""
        return self._of("body_x", slice(0, 3))

    @property
    def rotations(self) -> Array:
        """(S, B, 4) orientations, xyzw."""
        return self._of("body_rot", slice(3, 7))

    @property
    def velocities(self) -> Array:
        """(S, B, 3) velocities of the centres of mass [m/s]."""
        return self._of("body_v", slice(7, 10))

    def read(self) -> None:
        """Bring the present state; waits for the steps that lead to it."""
        if not self._device.is_cpu:
            self._begin()
            self._finish()

    def read_on(self) -> bool:
        """Bring the newest state whose copy has arrived, and begin the next copy; False where none has arrived since.

        Never waits. On a CPU it is the present state.
        """
        if self._device.is_cpu:
            return True
        if self._under_way and not self._arrived.is_complete:
            return False
        arrived = self._under_way
        if arrived:
            self._rows = self._pinned.numpy().copy()
        self._begin()
        return arrived

    def _begin(self) -> None:
        """Queue the copy of the present state, behind its steps."""
        state = self._state
        wp.launch(
            gather_bodies, dim=self._rows.shape[:2], inputs=[self._chosen, state.arrays, self._gathered],
            device=self._device,
        )  # fmt: skip
        wp.copy(self._pinned, self._gathered)
        wp.get_stream(self._device).record_event(self._arrived)
        self._under_way = True

    def _finish(self) -> None:
        wp.synchronize_event(self._arrived)
        self._rows, self._under_way = self._pinned.numpy().copy(), False

    def _of(self, name: str, numbers: slice) -> Array:
        if self._device.is_cpu:
            return np.asarray(getattr(self._state, name).numpy()[self._worlds], np.float64)
        return self._rows[..., numbers]
