"""Device half of the hexapod: its rewards."""

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


@wp.struct
class HexapodRewardWeights:
    """Numbers of the reward: weights of its terms, and what they are computed by."""

    progress: float
    alive: float
    energy: float
    joint_pos_limits: float
    joint_deviation_l2: float
    height: float
    tilt: float
    action_rate_l2: float
    lin_vel_y_l1: float
    heading: float
    line: float
    variant: int
    control_dt: wp.float64
    target_speed: float
    start_height: wp.array[float]  # (W,) of the base [m]
    middle: wp.array[float]  # (A,) of the range of each joint [rad]
    half: wp.array[float]


@wp.kernel
def compute_hexapod_rewards(
    weights: HexapodRewardWeights, action: wp.array2d[float], state: StateArrays, walk: WalkState,
    terms: wp.array2d[float],
):  # fmt: skip
    """Terms of the reward, (T, W)."""
    world = wp.tid()
    speed = progress_speed(world, weights.control_dt, state, walk)
    power = mean_power(world, action, state.joint_qd)
    alive = 1.0
    if walk.touched[world]:
        alive = -1.0
    limits = joints_at_limit(world, state.joint_q, weights.middle, weights.half)
    place = wp.transform_get_translation(state.body_q[world, BASE])
    rise = place[2] - weights.start_height[world]
    terms[1, world] = weights.alive * alive
    terms[2, world] = weights.energy * power
    terms[3, world] = weights.joint_pos_limits * limits
    if weights.variant == CODE:
        terms[0, world] = weights.progress * speed
        terms[4, world] = weights.height * rise
        return
    bent = float(0.0)
    change = float(0.0)
    for i in range(action.shape[1]):
        bent += state.joint_q[world, i] * state.joint_q[world, i]
        difference = action[world, i] - walk.last_action[world, i]
        change += difference * difference
    joints = float(action.shape[1])
    turned = euler_123(base_rotation(world, state))
    target = weights.target_speed
    terms[0, world] = weights.progress * (wp.min(speed, target) - wp.max(speed - target, 0.0))
    terms[4, world] = weights.joint_deviation_l2 * (bent / joints)
    terms[5, world] = weights.height * wp.abs(rise)
    terms[6, world] = weights.tilt * (wp.abs(turned[0]) + wp.abs(turned[1]))
    terms[7, world] = weights.action_rate_l2 * (change / joints)
    terms[8, world] = weights.lin_vel_y_l1 * wp.abs(state.body_v[world, BASE][1])
    terms[9, world] = weights.heading * wp.abs(turned[2])
    terms[10, world] = weights.line * wp.min(wp.abs(place[1]), 1.0)
