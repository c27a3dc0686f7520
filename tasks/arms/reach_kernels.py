"""Device half of the reaching arms: torques, touches, observations, rewards, resets and the criteria of success."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from ..framework.control_step_kernels import clipped, follow
from ..framework.frames_kernels import rotate
from ..framework.randomness_kernels import Draws, episode_key, uniform_at
from ..locomotion.walking_kernels import joints_at_limit

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

SHAPED = wp.constant(0)
THESIS = wp.constant(1)
FAR = wp.constant(0.3)
"""Distance that earns a quarter of what the approach pays [m]."""
CLOSE = wp.constant(0.02)
"""Distance that earns half of what the end pays [m]."""
SLACK = wp.constant(wp.float64(5.0))
"""Displacements by which the aim may be ahead of the grip."""
FIRM = wp.constant(20.0)
"""Force on the fingers that costs most [N]."""


@wp.struct
class ReachingArm:
    """What an arm is."""

    hand: int  # body that carries the grip
    grip: wp.vec3d  # from the hand's centre of mass, its axes [m]
    torque: wp.array[float]  # (A,) of a full action [N·m]
    speed: wp.array[float]  # (A,) beyond which no torque speeds a joint up [rad/s]
    middle: wp.array[float]  # (A,) of the range of each joint [rad]
    half: wp.array[float]
    barred: wp.array[int]  # shapes that must not touch anything
    fingers: wp.array[int]
    force: wp.array2d[wp.vec3]  # (W, S) contact forces of shapes [N]
    near: wp.float64  # distance of a success [m]
    driven: int  # 1: drives turn the joints, 0: torques


@wp.struct
class ReachState:
    """State of the running episode and control step."""

    physics_steps: wp.array[int]  # (W,) begun in this control step
    touched: wp.array[wp.bool]  # (W,) something that must not, in this control step
    pinch: wp.array[float]  # (W,) sum over physics steps of the forces on both fingers [N]
    near_steps: wp.array[int]  # (W,) physics steps in a row at whose ends the grip was near
    target: wp.array[wp.vec3d]  # (W,) centre of the cube [m]
    last_action: wp.array2d[float]  # (W, A) of the control step before


@wp.func
def grip_point(world: int, arm: ReachingArm, state: StateArrays) -> wp.vec3d:
    """Point between the tips of the fingers, in the world [m]."""
    return state.body_x[world, arm.hand] + rotate(state.body_rot[world, arm.hand], arm.grip)


@wp.func
def distance_left(world: int, arm: ReachingArm, state: StateArrays, reach: ReachState) -> wp.float64:
    """From the grip to the centre of the target [m]."""
    return wp.length(reach.target[world] - grip_point(world, arm, state))


@wp.func
def set_arm_torques(
    world: int, arm: ReachingArm, state: StateArrays, action: wp.array2d[float], torque: wp.array2d[float]
):  # fmt: skip
    """Turn the joints; no torque drives one on that is too fast."""
    if arm.driven == 1:
        return
    for i in range(action.shape[1]):
        rate = state.joint_qd[world, i]
        value = arm.torque[i] * action[world, i]
        if not (wp.abs(rate) < arm.speed[i] or value * rate <= 0.0):
            value = 0.0
        torque[world, i] = value


@wp.func
def notice(world: int, arm: ReachingArm, state: StateArrays, reach: ReachState):
    """Notice touches of the physics step that is over, and whether the grip is near."""
    for i in range(arm.barred.shape[0]):
        force = arm.force[world, arm.barred[i]]
        if force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0:
            reach.touched[world] = True
    pinch = reach.pinch[world]
    for i in range(arm.fingers.shape[0]):
        pinch += wp.length(arm.force[world, arm.fingers[i]])
    reach.pinch[world] = pinch
    steps = reach.near_steps[world] + 1
    if not (distance_left(world, arm, state, reach) < arm.near):
        steps = 0
    reach.near_steps[world] = steps


@wp.kernel
def begin_reach(action: wp.array2d[float], reach: ReachState):
    """Store what a control step is compared with."""
    world = wp.tid()
    reach.physics_steps[world] = 0
    reach.touched[world] = False
    reach.pinch[world] = 0.0
    for i in range(action.shape[1]):
        reach.last_action[world, i] = action[world, i]


@wp.kernel
def reach_on(
    worlds: WorldRange,
    rise: wp.array[float], request: wp.array2d[float], action: wp.array2d[float], arm: ReachingArm,
    state: StateArrays, reach: ReachState, torque: wp.array2d[float],
):  # fmt: skip
    """Before a physics step: what the one before has touched, the action's way, and the torques."""
    world = worlds.first + wp.tid()
    steps = reach.physics_steps[world]
    if steps > 0:
        notice(world, arm, state, reach)
    reach.physics_steps[world] = steps + 1
    follow(world, rise, request, action)
    set_arm_torques(world, arm, state, action, torque)


@wp.kernel
def turn_joints(action: wp.array2d[float], arm: ReachingArm, state: StateArrays, torque: wp.array2d[float]):
    """Turn the joints."""
    set_arm_torques(wp.tid(), arm, state, action, torque)


@wp.kernel
def aim_grip(
    request: wp.array2d[float], longest: wp.float64, arm: ReachingArm, state: StateArrays, aim: wp.array[wp.vec3d]
):  # fmt: skip
    """Displace where the grip should be by an action; it does not run away from where the grip is."""
    world = wp.tid()
    there = aim[world]
    for i in range(3):
        there[i] += longest * wp.float64(clipped(request[world, i]))
    grip = grip_point(world, arm, state)
    away = there - grip
    slack = SLACK * longest
    if wp.length(away) > slack:
        there = grip + away * (slack / wp.length(away))
    aim[world] = there


@wp.kernel
def aim_drives(found: wp.array2d[float], control_dt: float, arm: ReachingArm, target_q: wp.array2d[float]):
    """Take the drives to coordinates that were found, as far as the joints' speeds allow."""
    world = wp.tid()
    for i in range(arm.speed.shape[0]):
        q = target_q[world, i]
        far = arm.speed[i] * control_dt
        target_q[world, i] = q + wp.clamp(found[world, i] - q, -far, far)


@wp.kernel
def rest_drives(
    mask: wp.array[wp.bool], arm: ReachingArm, state: StateArrays, aim: wp.array[wp.vec3d], target_q: wp.array2d[float]
):  # fmt: skip
    """Aim at where the grip is."""
    world = wp.tid()
    if mask[world]:
        aim[world] = grip_point(world, arm, state)
        for i in range(arm.speed.shape[0]):
            target_q[world, i] = state.joint_q[world, i]


@wp.kernel
def finish_reach(
    action: wp.array2d[float], arm: ReachingArm, state: StateArrays, reach: ReachState, torque: wp.array2d[float]
):  # fmt: skip
    """After a physics step: a touch may be over before the control step is; torques are cut anew."""
    world = wp.tid()
    notice(world, arm, state, reach)
    set_arm_torques(world, arm, state, action, torque)


@wp.kernel
def observe_reach(arm: ReachingArm, state: StateArrays, reach: ReachState, policy: wp.array2d[float]):
    """Joint angles and rates, target, grip."""
    world = wp.tid()
    joints = state.joint_q.shape[1]
    for i in range(joints):
        policy[world, i] = state.joint_q[world, i]
        policy[world, joints + i] = state.joint_qd[world, i]
    grip = grip_point(world, arm, state)
    for i in range(3):
        policy[world, 2 * joints + i] = float(reach.target[world][i])
        policy[world, 2 * joints + 3 + i] = float(grip[i])


@wp.struct
class ReachRewardWeights:
    """Weights of the reward's terms, and its variant."""

    variant: int
    near: float
    contact: float
    fingers: float
    energy: float
    joint_pos_limits: float
    action_rate_l2: float


@wp.kernel
def compute_reach_rewards(
    weights: ReachRewardWeights, decimation: float, action: wp.array2d[float], arm: ReachingArm, state: StateArrays,
    reach: ReachState, terms: wp.array2d[float],
):  # fmt: skip
    """Terms of the reward, (T, W)."""
    world = wp.tid()
    d = float(distance_left(world, arm, state, reach))
    touched = float(0.0)
    if reach.touched[world]:
        touched = 1.0
    pinch = reach.pinch[world] / decimation
    limits = joints_at_limit(world, state.joint_q, arm.middle, arm.half)
    joints = float(arm.speed.shape[0])
    square = float(0.0)
    share = float(0.0)
    for i in range(arm.speed.shape[0]):
        product = wp.abs(state.joint_qd[world, i])
        if arm.driven == 0:
            product = wp.abs(action[world, i]) * product
        square += product * product
        share += wp.min(product / arm.speed[i], 1.0) / joints
    change = float(0.0)
    for i in range(action.shape[1]):
        difference = action[world, i] - reach.last_action[world, i]
        change += 0.25 * difference * difference / float(action.shape[1])
    terms[1, world] = weights.contact * touched
    if weights.variant == THESIS:
        terms[0, world] = weights.near / (d + 1.0e-4)
        terms[2, world] = weights.fingers * pinch
        terms[3, world] = weights.energy * wp.sqrt(square)
        terms[4, world] = weights.joint_pos_limits * limits
        return
    terms[0, world] = weights.near * (1.0 - wp.tanh(d / FAR) + 1.0 / (1.0 + (d / CLOSE) * (d / CLOSE)))
    terms[2, world] = weights.fingers * wp.min(pinch / FIRM, 1.0)
    terms[3, world] = weights.energy * share
    terms[4, world] = weights.joint_pos_limits * limits / joints
    terms[5, world] = weights.action_rate_l2 * change


@wp.kernel
def begin_reach_episode(
    mask: wp.array[wp.bool], angle: float, centre: wp.vec3d, spread: wp.vec3d, angles: wp.array[wp.uint64],
    targets: wp.array[wp.uint64], draws: Draws, cube: int, shape_x: wp.array2d[wp.vec3d], reach: ReachState,
    q: wp.array2d[float], qd: wp.array2d[float],
):  # fmt: skip
    """Place the target, and start near the zero pose; the coordinates are for the assembly that follows."""
    world = wp.tid()
    if not mask[world]:
        return
    placed = episode_key(targets, world, draws)
    target = centre
    for i in range(3):
        target[i] += spread[i] * wp.float64(uniform_at(placed, i, -1.0, 1.0))
    reach.target[world] = target
    shape_x[world, cube] = target
    bent = episode_key(angles, world, draws)
    for i in range(q.shape[1]):
        q[world, i] = uniform_at(bent, i, -angle, angle)
        qd[world, i] = 0.0
    reach.touched[world] = False
    reach.near_steps[world] = 0


@wp.kernel
def measure_reach(
    hold_steps: int, arm: ReachingArm, state: StateArrays, reach: ReachState, success: wp.array[wp.bool],
    distance: wp.array[float],
):  # fmt: skip
    """Whether the grip has been near for so many physics steps, and its distance to the target [m]."""
    world = wp.tid()
    success[world] = reach.near_steps[world] >= hold_steps and not reach.touched[world]
    distance[world] = float(distance_left(world, arm, state, reach))
