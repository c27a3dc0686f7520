"""Motions that keep a scene at work: torques and forces written by one kernel before every step, on the device.

Worlds differ by where they are in the motion: `variants` of them are spread over one period, then they repeat.
"""

# Kernel bodies are Warp's language, as in simwarp.kernels.
# mypy: disable-error-code="attr-defined, arg-type, index, operator"

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.simulation.simulation import Simulation

wp.set_module_options({"enable_backward": False})

PD_STIFFNESS = 20.0
PD_DAMPING = 1.0
SWING = 0.3
SWING_HZ = 1.5
TWIST_HZ = 2.0


@wp.func
def swing(time: wp.float64, dof: int, world: int, variants: int) -> float:
    """The target of a joint [rad]: a sine of 1.5 Hz, the joints one radian apart."""
    turns = wp.float64(SWING_HZ) * time
    turns = turns - wp.floor(turns)
    phase = 2.0 * wp.pi * (float(turns) + float(world % variants) / float(variants))
    return SWING * wp.sin(phase + float(dof))


@wp.kernel
def hold_swing(
    variants: int, world_time: wp.array[wp.float64], joint_q: wp.array2d[float], joint_qd: wp.array2d[float],
    joint_force: wp.array2d[float],
) -> None:  # fmt: skip
    """A PD torque towards the target on every degree of freedom."""
    world = wp.tid()
    for dof in range(joint_q.shape[1]):
        error = swing(world_time[world], dof, world, variants) - joint_q[world, dof]
        joint_force[world, dof] = PD_STIFFNESS * error - PD_DAMPING * joint_qd[world, dof]


@wp.kernel
def aim_swing(variants: int, world_time: wp.array[wp.float64], joint_target_q: wp.array2d[float]) -> None:
    """The targets for drives in the joints."""
    world = wp.tid()
    for dof in range(joint_target_q.shape[1]):
        joint_target_q[world, dof] = swing(world_time[world], dof, world, variants)


@wp.kernel
def write_swing(variants: int, time: wp.array[float], targets: wp.array2d[float]) -> None:
    """The targets alone, for engines with position actuators."""
    world = wp.tid()
    for dof in range(targets.shape[1]):
        targets[world, dof] = swing(wp.float64(time[world]), dof, world, variants)


@wp.kernel
def hold_swing_by_leg(
    variants: int, time: wp.array[float], joint_q: wp.array2d[float], joint_qd: wp.array2d[float],
    joint_force: wp.array2d[float],
) -> None:  # fmt: skip
    """The same for an engine with hip and ankle of each leg in turn, behind a free joint of 7 and 6 numbers."""
    world = wp.tid()
    for joint in range(8):
        error = (
            swing(wp.float64(time[world]), 4 * (joint % 2) + joint // 2, world, variants) - joint_q[world, 7 + joint]
        )
        joint_force[world, 6 + joint] = PD_STIFFNESS * error - PD_DAMPING * joint_qd[world, 6 + joint]


@wp.kernel
def twist(
    variants: int, torque: float, world_time: wp.array[wp.float64], body_torque: wp.array2d[wp.vec3]
) -> None:  # fmt: skip
    """A torque about Z on every body: a sine of 2 Hz, the same for all bodies of a world."""
    world = wp.tid()
    turns = wp.float64(TWIST_HZ) * world_time[world]
    turns = turns - wp.floor(turns)
    phase = 2.0 * wp.pi * (float(turns) + float(world % variants) / float(variants))
    for body in range(body_torque.shape[1]):
        body_torque[world, body] = wp.vec3(0.0, 0.0, torque * wp.sin(phase))


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
    return wp.launch(
        hold_swing, dim=sim.model.world_count, device=sim.model.device, record_cmd=True,
        inputs=[variants, state.world_time, state.joint_q, state.joint_qd], outputs=[sim.control.joint_force],
    )  # fmt: skip


def swinging_drives(sim: Simulation, variants: int) -> Any:
    """The benchmark motion of the hexapod: its drives aim at 0.3 sin(2π 1.5 Hz t + dof)."""
    state = sim.state
    return wp.launch(
        aim_swing, dim=sim.model.world_count, device=sim.model.device, record_cmd=True,
        inputs=[variants, state.world_time], outputs=[sim.control.joint_target_q],
    )  # fmt: skip


STACK_TORQUE = 1.2


def twisted_bodies(sim: Simulation, variants: int) -> Any:
    """1.2 N·m sin(2π 2 Hz t) about Z on every body: a little more than friction holds in a stack of cubes."""
    return wp.launch(
        twist, dim=sim.model.world_count, device=sim.model.device, record_cmd=True,
        inputs=[variants, STACK_TORQUE, sim.state.world_time], outputs=[sim.control.body_torque],
    )  # fmt: skip
