"""Device half of the ant: its rewards."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.tasks.framework.frames_kernels import euler_123
from simwarp.tasks.locomotion.walking_kernels import (
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
    """Numbers of the reward: weights of its terms, and what they are computed by."""

    progress: float
    alive: float
    energy: float
    joint_pos_limits: float
    lin_vel_y_l1: float
    heading: float
    line: float
    variant: int
    control_dt: wp.float64
    target_speed: float
    torque: float
    middle: wp.array[float]  # (A,) of the range of each joint [rad]
    half: wp.array[float]


@wp.kernel
def compute_ant_rewards(
    weights: AntRewardWeights, action: wp.array2d[float], state: StateArrays, walk: WalkState, terms: wp.array2d[float]
):
    """Terms of the reward, (T, W)."""
    world = wp.tid()
    speed = progress_speed(world, weights.control_dt, state, walk)
    alive = 1.0
    if walk.touched[world]:
        alive = -1.0
    terms[1, world] = weights.alive * alive
    terms[2, world] = weights.energy * mean_power(world, action, state.joint_qd)
    terms[3, world] = weights.joint_pos_limits * joints_at_limit(world, state.joint_q, weights.middle, weights.half)
    if weights.variant != WALK:
        terms[0, world] = weights.progress * speed
        if weights.variant == THESIS:
            total = float(0.0)
            for i in range(action.shape[1]):
                total += action[world, i] * state.joint_qd[world, i]
            terms[2, world] = weights.energy * weights.torque * total
        return
    place = wp.transform_get_translation(state.body_q[world, BASE])
    heading = euler_123(base_rotation(world, state))[2]
    target = weights.target_speed
    terms[0, world] = weights.progress * (wp.min(speed, target) - 0.5 * wp.max(speed - target, 0.0))
    terms[4, world] = weights.lin_vel_y_l1 * wp.abs(state.body_v[world, BASE][1])
    terms[5, world] = weights.heading * wp.abs(heading)
    terms[6, world] = weights.line * wp.min(wp.abs(place[1]), 2.0)
