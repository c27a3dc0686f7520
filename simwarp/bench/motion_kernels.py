"""Motions that keep a scene at work: targets of joints and torques on bodies, written before every step.

Worlds differ by where they are in the motion: `variants` of them are spread over one period, then they repeat.
"""

import warp as wp

from simwarp.kernels.core.world_range import WorldRange

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
    worlds: WorldRange, variants: int, world_time: wp.array[wp.float64], joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float], joint_force: wp.array2d[float],
) -> None:  # fmt: skip
    """A PD torque towards the target on every degree of freedom."""
    world = worlds.first + wp.tid()
    for dof in range(joint_q.shape[1]):
        error = swing(world_time[world], dof, world, variants) - joint_q[world, dof]
        joint_force[world, dof] = PD_STIFFNESS * error - PD_DAMPING * joint_qd[world, dof]


@wp.kernel
def aim_swing(
    worlds: WorldRange, variants: int, world_time: wp.array[wp.float64], joint_target_q: wp.array2d[float]
) -> None:
    """The targets for drives in the joints."""
    world = worlds.first + wp.tid()
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
    worlds: WorldRange, variants: int, torque: float, world_time: wp.array[wp.float64], body_torque: wp.array2d[wp.vec3]
) -> None:  # fmt: skip
    """A torque about Z on every body: a sine of 2 Hz, the same for all bodies of a world."""
    world = worlds.first + wp.tid()
    turns = wp.float64(TWIST_HZ) * world_time[world]
    turns = turns - wp.floor(turns)
    phase = 2.0 * wp.pi * (float(turns) + float(world % variants) / float(variants))
    for body in range(body_torque.shape[1]):
        body_torque[world, body] = wp.vec3(0.0, 0.0, torque * wp.sin(phase))
