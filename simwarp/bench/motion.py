"""Motions that keep a scene at work: launches of `motion_kernels.py`, and what they write, on the host.

Worlds differ by where they are in the motion: `variants` of them are spread over one period, then they repeat.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.bench.motion_kernels import SWING, SWING_HZ, TWIST_HZ, aim_swing, hold_swing, twist
from simwarp.simulation.simulation import Simulation


def swing_targets(time: npt.ArrayLike, dofs: int, worlds: int, variants: int) -> npt.NDArray[np.float64]:
    """(W, T, dofs) what `swing` gives at the times (T,) or (W, T) [s]."""
    phase = 2.0 * math.pi * (np.arange(worlds) % variants) / variants
    angle = 2.0 * math.pi * SWING_HZ * np.atleast_2d(np.asarray(time, float)) + phase[:, None]
    return np.asarray(SWING * np.sin(angle[:, :, None] + np.arange(dofs)))


def twist_torques(time: npt.ArrayLike, torque: float, worlds: int, variants: int) -> npt.NDArray[np.float64]:
    """(W, T) what `twist` gives at the times (T,) or (W, T) [s]."""
    phase = 2.0 * math.pi * (np.arange(worlds) % variants) / variants
    return np.asarray(
        torque * np.sin(2.0 * math.pi * TWIST_HZ * np.atleast_2d(np.asarray(time, float)) + phase[:, None])
    )


def swinging_joints(sim: Simulation, variants: int) -> Any:
    """The benchmark motion of the ant: 20 (target - q) - 1.0 qd [N·m], target = 0.3 sin(2π 1.5 Hz t + dof)."""
    state = sim.state
    return sim.shares.record(
        hold_swing,
        inputs=[variants, state.world_time, state.joint_q, state.joint_qd], outputs=[sim.control.joint_force],
    )  # fmt: skip


def swinging_drives(sim: Simulation, variants: int) -> Any:
    """The benchmark motion of the hexapod: its drives aim at 0.3 sin(2π 1.5 Hz t + dof)."""
    state = sim.state
    return sim.shares.record(
        aim_swing,
        inputs=[variants, state.world_time], outputs=[sim.control.joint_target_q],
    )  # fmt: skip


STACK_TORQUE = 1.2


def twisted_bodies(sim: Simulation, variants: int) -> Any:
    """1.2 N·m sin(2π 2 Hz t) about Z on every body: a little more than friction holds in a stack of cubes."""
    return sim.shares.record(
        twist,
        inputs=[variants, STACK_TORQUE, sim.state.world_time], outputs=[sim.control.body_torque],
    )  # fmt: skip
