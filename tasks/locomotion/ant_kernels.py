"""Device half of the ant: its rewards."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays

from ..framework.frames_kernels import euler_123
from .walking_kernels import (
    BASE,
    WalkState,
    base_rotation,
    joints_at_limit,
    mean_power,
    progress_speed,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

WALK = wp.constant(0)
CODE = wp.constant(1)
THESIS = wp.constant(2)


@wp.struct
class AntRewardWeights:
    """Numbers of the reward."""

    variant: int
    control_dt: wp.float64
    target_speed: float
    torque: float
    middle: wp.array[float]  # (A,) of the range of each joint [rad]
    half: wp.array[float]


@wp.kernel
def compute_ant_rewards(
    pay: AntRewardWeights, action: wp.array2d[float], state: StateArrays, walk: WalkState, terms: wp.array2d[float]
):
    """Terms of the reward, (T, W)."""
    world = wp.tid()
    speed = progress_speed(world, pay.control_dt, state, walk)
    alive = 1.0
    if walk.touched[world]:
        alive = -1.0
    limits = joints_at_limit(world, state.joint_q, pay.middle, pay.half)
    if pay.variant != WALK:
        effort = -0.2 * mean_power(world, action, state.joint_qd)
        if pay.variant == THESIS:
            total = float(0.0)
            for i in range(action.shape[1]):
                total += action[world, i] * state.joint_qd[world, i]
            effort = -0.2 * pay.torque * total
        terms[0, world] = speed
        terms[1, world] = alive
        terms[2, world] = effort
        terms[3, world] = -0.6 * limits
        return
    place = wp.transform_get_translation(state.body_q[world, BASE])
    heading = euler_123(base_rotation(world, state))[2]
    target = pay.target_speed
    terms[0, world] = 2.0 * wp.min(speed, target) - wp.max(speed - target, 0.0)
    terms[1, world] = 0.5 * alive
    terms[2, world] = -0.05 * mean_power(world, action, state.joint_qd)
    terms[3, world] = -0.05 * limits
    terms[4, world] = -0.5 * wp.abs(state.body_v[world, BASE][1])
    terms[5, world] = -0.5 * wp.abs(heading)
    terms[6, world] = -wp.min(wp.abs(place[1]), 2.0)
