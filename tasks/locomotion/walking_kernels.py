"""Device half of the walking tasks: torques, touches, observations, resets and the criteria of success."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from ..framework.control_step_kernels import follow
from ..framework.frames_kernels import euler_123, heading_quaternion, rotate_back
from ..framework.randomness_kernels import Draws, episode_key, uniform_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

BASE = wp.constant(0)
"""Body that carries the legs."""
TARGET_X = wp.constant(wp.float64(1000.0))
"""Distance of the target whose approach is progress [m]."""
ARENA = wp.constant(wp.float64(49.0))
FORCE_CLIP = wp.constant(5.0)
AT_LIMIT = wp.constant(0.98)
"""A joint counts as at its limit beyond this share of its range."""


@wp.struct
class Walker:
    """What a robot is, and what is observed of it."""

    feet: wp.array[int]  # whose contact forces are observed
    others: wp.array[int]  # that must not touch the ground
    force: wp.array2d[wp.vec3]  # (W, N) contact forces [N]
    sizes: wp.array[float]  # observations are divided by them; of no length: SI units
    legs: int
    quaternion: int  # 1: orientation as four numbers, 0: three angles
    lateral: int  # 1: the sideways position comes first, 0: the height
    torque: float  # of a full action [N·m]
    speed_limit: float  # of a joint that a torque drives on [rad/s]
    cut_anew: int  # 1: there is a limit, and torques are cut in every physics step


@wp.struct
class WalkState:
    """State of the running episode and control step."""

    physics_steps: wp.array[int]  # (W,) begun in this control step
    distance: wp.array[wp.float64]  # (W,) to the target before the control step [m]
    last_action: wp.array2d[float]  # (W, A) of the control step before
    touched: wp.array[wp.bool]  # (W,) in this control step
    aside: wp.array[float]  # (W,) largest distance from the line y = 0 [m]
    reached: wp.array[wp.bool]  # (W,) the goal, in time


@wp.func
def distance_ahead(world: int, state: StateArrays) -> wp.float64:
    """Distance of the base to a target far ahead, as the original measures progress [m]."""
    place = state.body_x[world, BASE]
    x = TARGET_X - place[0]
    return wp.sqrt(x * x + place[1] * place[1])


@wp.func
def progress_speed(world: int, control_dt: wp.float64, state: StateArrays, walk: WalkState) -> float:
    """Speed at which the target came nearer in this control step [m/s]."""
    return float((walk.distance[world] - distance_ahead(world, state)) / control_dt)


@wp.func
def base_rotation(world: int, state: StateArrays) -> wp.quat:
    """Orientation of the base in float32."""
    return wp.transform_get_rotation(state.body_q[world, BASE])


@wp.func
def joints_at_limit(world: int, joint_q: wp.array2d[float], middle: wp.array[float], half: wp.array[float]) -> float:
    """Number of joints in the last part of their range."""
    count = float(0.0)
    for i in range(middle.shape[0]):
        if wp.abs(joint_q[world, i] - middle[i]) / half[i] > AT_LIMIT:
            count += 1.0
    return count


@wp.func
def mean_power(world: int, action: wp.array2d[float], joint_qd: wp.array2d[float]) -> float:
    """Mean size of action times rate."""
    total = float(0.0)
    for i in range(action.shape[1]):
        total += wp.abs(action[world, i] * joint_qd[world, i])
    return total / float(action.shape[1])


@wp.func
def set_torques(
    world: int, walker: Walker, state: StateArrays, action: wp.array2d[float], torque: wp.array2d[float]
):  # fmt: skip
    """Turn the joints; no torque drives one on that is too fast."""
    for i in range(action.shape[1]):
        rate = state.joint_qd[world, i]
        value = walker.torque * action[world, i]
        if not (wp.abs(rate) < walker.speed_limit or action[world, i] * rate <= 0.0):
            value = 0.0
        torque[world, i] = value


@wp.kernel
def begin_walk(state: StateArrays, action: wp.array2d[float], walk: WalkState):
    """Store what a control step is compared with."""
    world = wp.tid()
    walk.physics_steps[world] = 0
    walk.distance[world] = distance_ahead(world, state)
    walk.touched[world] = False
    for i in range(action.shape[1]):
        walk.last_action[world, i] = action[world, i]


@wp.func
def touch(world: int, walker: Walker, walk: WalkState):
    """Notice a touch of the physics step that is over."""
    for i in range(walker.others.shape[0]):
        force = walker.force[world, walker.others[i]]
        if force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0:
            walk.touched[world] = True


@wp.kernel
def walk_on(
    worlds: WorldRange,
    reach: wp.array[float], request: wp.array2d[float], action: wp.array2d[float], walker: Walker, state: StateArrays,
    walk: WalkState, torque: wp.array2d[float],
):  # fmt: skip
    """Before a physics step: the touch of the one before, the action's way, and the torques."""
    world = worlds.first + wp.tid()
    steps = walk.physics_steps[world]
    if steps > 0:
        touch(world, walker, walk)
    walk.physics_steps[world] = steps + 1
    follow(world, reach, request, action)
    if steps == 0 or reach.shape[0] > 0 or walker.cut_anew == 1:
        set_torques(world, walker, state, action, torque)


@wp.kernel
def drive_joints(action: wp.array2d[float], walker: Walker, state: StateArrays, torque: wp.array2d[float]):
    """Turn the joints."""
    set_torques(wp.tid(), walker, state, action, torque)


@wp.kernel
def finish_physics(
    action: wp.array2d[float], walker: Walker, state: StateArrays, walk: WalkState, torque: wp.array2d[float]
):  # fmt: skip
    """After a physics step: a touch may be over before the control step is; torques are cut anew."""
    world = wp.tid()
    touch(world, walker, walk)
    if walker.cut_anew == 1:
        set_torques(world, walker, state, action, torque)


@wp.func
def write_vector(world: int, start: int, value: wp.vec3, policy: wp.array2d[float]) -> int:
    """Write three observations; the column after them."""
    for i in range(3):
        policy[world, start + i] = value[i]
    return start + 3


@wp.kernel
def observe_walk(walker: Walker, state: StateArrays, policy: wp.array2d[float]):
    """Height, orientation, velocity, angular velocity, joint angles and rates, forces on the feet."""
    world = wp.tid()
    place = wp.transform_get_translation(state.body_q[world, BASE])
    rotation = base_rotation(world, state)
    policy[world, 0] = place[2 - walker.lateral]
    at = int(1)
    if walker.quaternion == 1:
        for i in range(4):
            policy[world, at + i] = rotation[i]
        at += 4
    else:
        at = write_vector(world, at, euler_123(rotation), policy)
    at = write_vector(world, at, rotate_back(rotation, state.body_v[world, BASE]), policy)
    at = write_vector(world, at, rotate_back(rotation, state.body_omega[world, BASE]), policy)
    joints = state.joint_q.shape[1]
    for i in range(joints):
        policy[world, at + i] = state.joint_q[world, i]
        policy[world, at + joints + i] = state.joint_qd[world, i]
    at += 2 * joints
    for i in range(walker.feet.shape[0]):
        force = wp.length(walker.force[world, walker.feet[i]])
        if force > FORCE_CLIP:  # NaN stays
            force = FORCE_CLIP
        policy[world, at + i] = force
    for i in range(walker.sizes.shape[0]):
        policy[world, i] = policy[world, i] / walker.sizes[i]


@wp.kernel
def find_outside(state: StateArrays, outside: wp.array[wp.bool]):
    """Whether the robot has left the floor."""
    world = wp.tid()
    place = state.body_x[world, BASE]
    outside[world] = wp.abs(place[0]) > ARENA or wp.abs(place[1]) > ARENA


@wp.kernel
def begin_walk_episode(
    mask: wp.array[wp.bool], angle: float, rate: float, heading: wp.array[wp.uint64], angles: wp.array[wp.uint64],
    rates: wp.array[wp.uint64], draws: Draws, walker: Walker, state: StateArrays, walk: WalkState,
    q: wp.array2d[float], qd: wp.array2d[float],
):  # fmt: skip
    """Start near the built pose and the heading +X; the coordinates are for the assembly that follows."""
    world = wp.tid()
    if not mask[world]:
        return
    turn = uniform_at(episode_key(heading, world, draws), 0, -angle, angle)
    state.body_rot[world, BASE] = heading_quaternion(wp.float64(turn))
    bent = episode_key(angles, world, draws)
    moving = episode_key(rates, world, draws)
    for i in range(q.shape[1]):
        value = uniform_at(bent, i, -angle, angle)
        # The outer joints only turn outwards and up: the feet stay above the ground
        if i >= walker.legs:
            value = -wp.abs(value)
        q[world, i] = value
        qd[world, i] = uniform_at(moving, i, -rate, rate)
    walk.touched[world] = False
    walk.aside[world] = 0.0
    walk.reached[world] = False


@wp.kernel
def measure_success(
    steps: wp.array[wp.int64], control_dt: float, goal_distance: float, goal_time: float, goal_width: float,
    state: StateArrays, walk: WalkState, success: wp.array[wp.bool], distance: wp.array[float],
):  # fmt: skip
    """Bring the criteria of success up to date."""
    world = wp.tid()
    place = wp.transform_get_translation(state.body_q[world, BASE])
    aside = wp.abs(place[1])
    if aside > walk.aside[world] or wp.isnan(aside):
        walk.aside[world] = aside
    if place[0] >= goal_distance and float(steps[world]) * control_dt <= goal_time:
        walk.reached[world] = True
    success[world] = walk.reached[world] and walk.aside[world] <= goal_width and not walk.touched[world]
    distance[world] = place[0]
