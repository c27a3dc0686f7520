"""Device half of the hexapod: its rewards."""

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


@wp.struct
class HexapodRewardWeights:
    """Numbers of the reward."""

    variant: int
    control_dt: wp.float64
    target_speed: float
    start_height: wp.array[float]  # (W,) of the base [m]
    middle: wp.array[float]  # (A,) of the range of each joint [rad]
    half: wp.array[float]


@wp.kernel
def compute_hexapod_rewards(
    pay: HexapodRewardWeights, action: wp.array2d[float], state: StateArrays, walk: WalkState, terms: wp.array2d[float]
):  # fmt: skip
    """Terms of the reward, (T, W)."""
    world = wp.tid()
    speed = progress_speed(world, pay.control_dt, state, walk)
    power = mean_power(world, action, state.joint_qd)
    alive = 1.0
    if walk.touched[world]:
        alive = -1.0
    limits = joints_at_limit(world, state.joint_q, pay.middle, pay.half)
    place = wp.transform_get_translation(state.body_q[world, BASE])
    rise = place[2] - pay.start_height[world]
    if pay.variant == CODE:
        terms[0, world] = 5.0 * speed
        terms[1, world] = alive
        terms[2, world] = -0.1 * power
        terms[3, world] = -0.8 * limits
        terms[4, world] = 2.0 * rise
        return
    bent = float(0.0)
    change = float(0.0)
    for i in range(action.shape[1]):
        bent += state.joint_q[world, i] * state.joint_q[world, i]
        difference = action[world, i] - walk.last_action[world, i]
        change += difference * difference
    joints = float(action.shape[1])
    turned = euler_123(base_rotation(world, state))
    target = pay.target_speed
    terms[0, world] = 5.0 * (wp.min(speed, target) - wp.max(speed - target, 0.0))
    terms[1, world] = 0.5 * alive
    terms[2, world] = -0.02 * power
    terms[3, world] = -0.2 * limits
    terms[4, world] = -2.0 * (bent / joints)
    terms[5, world] = -10.0 * wp.abs(rise)
    terms[6, world] = -(wp.abs(turned[0]) + wp.abs(turned[1]))
    terms[7, world] = -0.1 * (change / joints)
    terms[8, world] = -wp.abs(state.body_v[world, BASE][1])
    terms[9, world] = -wp.abs(turned[2])
    terms[10, world] = -2.0 * wp.min(wp.abs(place[1]), 1.0)
