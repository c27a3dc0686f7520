"""MuJoCo C in motion for comparisons: worlds one after the other on each thread, with no Python in its loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.threads import thread_count

Array = npt.NDArray[np.float64]

MOST_STEPS = 50_000
"""Steps of all worlds together in one call."""


class Rollout:
    """Steps of `mujoco.rollout`; see `timing.Steppable`.

    Args:
        text: the model as MJCF.
        dt: step [s].
        start: (W, 1 + nq + nv) time, positions and velocities.
        horizon_steps: of one motion; it is rounded down to whole calls.
        steps_per_call: at most; None: as many as `MOST_STEPS` allow.

    Attributes:
        now: (W, 1 + nq + nv) present state.
        parts: inputs of the calls in turn, each (W, steps or 1, inputs); a subclass sets them, and `spec`, their kind.
    """

    parts: Sequence[Array]

    def __init__(
        self, text: str, dt: float, start: Array, horizon_steps: int, steps_per_call: int | None = None
    ) -> None:
        import mujoco
        from mujoco import rollout

        self.mujoco: Any = mujoco
        self.model: Any = mujoco.MjModel.from_xml_string(text)
        self.model.opt.timestep = dt
        self.threads = min(thread_count(), len(start))
        self.data = mujoco.MjData(self.model)
        self._data = [self.data, *(mujoco.MjData(self.model) for _ in range(self.threads - 1))]
        self.worlds = len(start)
        self.steps_per_call = min(steps_per_call or max(1, MOST_STEPS // self.worlds), horizon_steps)
        self.horizon_steps = max(1, horizon_steps // self.steps_per_call)
        self.spec: int = mujoco.mjtState.mjSTATE_CTRL.value
        self._start = start
        self._states = np.zeros((self.worlds, self.steps_per_call, start.shape[1]))
        self._sensors = np.zeros((self.worlds, self.steps_per_call, 0))
        # as many threads as data; with one it stays on this thread
        self._rollout: Any = rollout.Rollout(nthread=self.threads if self.threads > 1 else 0).rollout
        self.restart()

    def restart(self) -> None:
        """Back to the start."""
        self.now = self._start.copy()
        self._turn = 0

    def step(self) -> None:
        """`steps_per_call` steps."""
        self._rollout(
            self.model, self._data, self.now, self.parts[self._turn % len(self.parts)], control_spec=self.spec,
            nstep=self.steps_per_call, state=self._states, sensordata=self._sensors,
        )  # fmt: skip
        self._turn += 1
        self.now = self._states[:, -1].copy()

    def wait(self) -> None:
        """Nothing to wait for."""

    def bytes_per_world(self) -> int:
        """Of one `mjData` without its stack."""
        return int(self.data.nbuffer)
