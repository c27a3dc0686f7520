"""Device half of the crane: drives, hoist, wind, touches, observations, rewards, resets and ends."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.tasks.framework.control_step_kernels import follow
from simwarp.tasks.framework.randomness_kernels import Draws, episode_key, normal_at, step_key, uniform_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

SLEW = wp.constant(0)
TROLLEY = wp.constant(1)
HOIST = wp.constant(2)
AIR = wp.constant(1.2)
"""Density [kg/m³]."""
SLACK = wp.constant(0.1)
"""Tension of the cable, as a share of the load's weight, below which the load stands."""
STILL = wp.constant(0.05)
"""Speed below which it stands [m/s]."""
SOFT = wp.constant(0.2)
"""Touch-down speed that halves what softness pays [m/s]."""
CLEAR = wp.constant(3.0)
"""Greatest height at which the load should come near [m]; nearer than that, as high as it is far away."""
ABOVE = wp.constant(0.5)
"""What a metre above that height counts as a way, and one below it."""
BELOW = wp.constant(1.0)
CALM = wp.constant(0.2)
"""Speed that is no haste anywhere [m/s]."""
EASE = wp.constant(0.5)
"""What a metre of distance allows beyond it [1/s]."""
KILO = wp.constant(1.0e-3)
"""Kilonewtons per newton."""


@wp.struct
class Crane:
    """What the crane is."""

    trolley: int  # bodies
    load: int
    first: int  # node of the cable at the trolley, and the next one
    second: int
    shape: int  # of the load
    pad: int
    slew: int  # coordinates
    rail: int
    hinge: int  # the first of three, of the cable at the trolley
    axial: wp.array[int]  # (E,) along the elements
    built: wp.float64  # length of the cable as built [m]
    middle: wp.float64  # height of the load's centre above its underside [m]
    reach: wp.vec2  # of the trolley, from and to [m]
    place: float  # of the trolley as built [m]
    lengths: wp.vec2  # of the cable, from and to [m]
    speed: wp.vec3  # of slewing [rad/s], trolley and hoist [m/s] at a full action
    brake: wp.vec3  # deceleration towards the ends of a way [rad/s², m/s²]
    area: float  # drag coefficient times area of the load [m²]
    gravity: float  # [m/s²]
    dt: float  # physics step [s]
    tolerance: float  # of a place [m]
    touch_down: float  # largest speed [m/s]
    hold_steps: int  # physics steps
    force: wp.array2d[wp.vec3]  # (W, S) contact forces of shapes [N]
    mass: wp.array2d[float]  # (W or 1, B) [kg]
    stiffness: wp.array2d[float]  # (W or 1, D) of joints
    damping: wp.array2d[float]


@wp.struct
class CraneState:
    """State of the running episode and control step."""

    physics_steps: wp.array[int]  # (W,) begun in this control step
    length: wp.array[wp.float64]  # (W,) of the cable, unstressed [m]
    payout: wp.array[float]  # (W,) how fast it grows [m/s]
    target: wp.array[wp.vec3d]  # (W,) middle of the pad [m]
    wind: wp.array[wp.vec2]  # (W,) mean [m/s]
    gust: wp.array[wp.vec2]  # (W,) beyond it [m/s]
    tension: wp.array[float]  # (W,) at the trolley, as the last physics step left it [N]
    touching: wp.array[wp.bool]  # (W,)
    touch_speed: wp.array[float]  # (W,) the largest of the episode [m/s]
    speed: wp.array[float]  # (W,) of the load after the last physics step [m/s]
    stood: wp.array[int]  # (W,) physics steps in a row in which the load stood on the pad
    missed: wp.array[wp.bool]  # (W,) it touched the ground elsewhere
    way: wp.array[float]  # (W,) that was left before the control step [m]
    last_action: wp.array2d[float]  # (W, 3) of the control step before


@wp.struct
class Verdicts:
    """Why an episode is over; each (W,)."""

    placed: wp.array[wp.bool]
    hard: wp.array[wp.bool]
    missed: wp.array[wp.bool]


@wp.func
def row_of(world: int, rows: int) -> int:
    """Row of a world in an array that may have one row for all."""
    row = int(0)
    if rows > 1:
        row = world
    return row


@wp.func
def in_boom_axes(turn: float, x: float, y: float) -> wp.vec2:
    """Along the boom and across it, to the left."""
    c = wp.cos(turn)
    s = wp.sin(turn)
    return wp.vec2(c * x + s * y, c * y - s * x)


@wp.func
def load_from_target(world: int, crane: Crane, state: StateArrays, episode: CraneState) -> wp.vec3:
    """From the middle of the pad to that of the load's underside, world axes [m]."""
    away = state.body_x[world, crane.load] - episode.target[world]
    return wp.vec3(float(away[0]), float(away[1]), float(away[2] - crane.middle))


@wp.func
def error_of(away: wp.vec3) -> float:
    """Horizontal distance [m]."""
    return wp.sqrt(away[0] * away[0] + away[1] * away[1])


@wp.func
def way_left(away: wp.vec3) -> float:
    """What an approach makes shorter [m]: distance over the ground, and from the height that suits it."""
    error = error_of(away)
    height = away[2] - wp.min(error, CLEAR)
    return error + ABOVE * wp.max(height, 0.0) + BELOW * wp.max(-height, 0.0)


@wp.func
def haste_of(away: wp.vec3, v: wp.vec3) -> float:
    """Speed of the load beyond what its distance from the pad allows [m/s]."""
    return wp.max(wp.length(v) - CALM - EASE * (error_of(away) + wp.abs(away[2])), 0.0)


@wp.func
def tension_of(world: int, crane: Crane, state: StateArrays, rest: wp.array2d[float]) -> float:
    """Tension of the uppermost element of the cable [N], before its length at rest is changed for the next step."""
    dof = crane.axial[0]
    k = crane.stiffness[row_of(world, crane.stiffness.shape[0]), dof]
    d = crane.damping[row_of(world, crane.damping.shape[0]), dof]
    return k * float(state.joint_x[world, dof] - wp.float64(rest[world, dof])) + d * state.joint_qd[world, dof]


@wp.func
def within(speed: float, brake: float, back: float, ahead: float) -> float:
    """A speed at which a drive can still stop before the ends of its way.

    Args: speed that is asked for; deceleration; ways that are left on both sides [m].
    """
    most = wp.sqrt(2.0 * brake * wp.max(ahead, 0.0))
    least = wp.sqrt(2.0 * brake * wp.max(back, 0.0))
    return wp.clamp(speed, -least, most)


@wp.func
def write_rest(world: int, crane: Crane, episode: CraneState, rest: wp.array2d[float]):
    """Share the cable that is out among its elements."""
    count = crane.axial.shape[0]
    more = float((episode.length[world] - crane.built) / wp.float64(count))
    for k in range(count):
        rest[world, crane.axial[k]] = more


@wp.kernel
def begin_crane(
    time: float, spread: float, gusts: wp.array[wp.uint64], draws: Draws, action: wp.array2d[float], crane: Crane,
    state: StateArrays, episode: CraneState,
):  # fmt: skip
    """Store what a control step is compared with, and let the wind change.

    Args: correlation time of the gusts in control steps; their deviation as a share of the mean wind.
    """
    world = wp.tid()
    episode.physics_steps[world] = 0
    for i in range(action.shape[1]):
        episode.last_action[world, i] = action[world, i]
    episode.way[world] = way_left(load_from_target(world, crane, state, episode))
    keep = wp.exp(-1.0 / time)
    sigma = spread * wp.length(episode.wind[world]) * wp.sqrt(1.0 - keep * keep)
    key = step_key(gusts, world, draws)
    gust = episode.gust[world] * keep
    for i in range(2):
        gust[i] += sigma * normal_at(key, i, wp.float64(0.0), wp.float64(1.0))
    episode.gust[world] = gust


@wp.func
def set_drives(
    world: int, action: wp.array2d[float], crane: Crane, state: StateArrays, episode: CraneState,
    target_qd: wp.array2d[float], body_force: wp.array2d[wp.vec3],
):  # fmt: skip
    """Speeds of the drives, and the wind's force on the load."""
    place = crane.place + state.joint_q[world, crane.rail]
    target_qd[world, crane.slew] = crane.speed[SLEW] * action[world, SLEW]
    asked = crane.speed[TROLLEY] * action[world, TROLLEY]
    target_qd[world, crane.rail] = within(
        asked, crane.brake[TROLLEY], place - crane.reach[0], crane.reach[1] - place
    )  # fmt: skip
    length = float(episode.length[world])
    asked = crane.speed[HOIST] * action[world, HOIST]
    episode.payout[world] = within(
        asked, crane.brake[HOIST], length - crane.lengths[0], crane.lengths[1] - length
    )  # fmt: skip
    wind = episode.wind[world] + episode.gust[world]
    v = state.body_v[world, crane.load]
    air = wp.vec3(wind[0] - v[0], wind[1] - v[1], -v[2])
    body_force[world, crane.load] = 0.5 * AIR * crane.area * wp.length(air) * air


@wp.kernel
def drive_crane(
    action: wp.array2d[float], crane: Crane, state: StateArrays, episode: CraneState, target_qd: wp.array2d[float],
    body_force: wp.array2d[wp.vec3],
):  # fmt: skip
    """Drive the crane."""
    set_drives(wp.tid(), action, crane, state, episode, target_qd, body_force)


@wp.func
def notice(world: int, crane: Crane, state: StateArrays, episode: CraneState, rest: wp.array2d[float]):
    """After a physics step: notice a touch and whether the load stands, and pay cable out."""
    push = crane.force[world, crane.shape]
    touching = push[0] != 0.0 or push[1] != 0.0 or push[2] != 0.0
    error = error_of(load_from_target(world, crane, state, episode))
    if touching and not episode.touching[world]:
        episode.touch_speed[world] = wp.max(episode.touch_speed[world], episode.speed[world])
    if touching and error > crane.tolerance:
        episode.missed[world] = True
    episode.touching[world] = touching
    speed = wp.length(state.body_v[world, crane.load])
    episode.speed[world] = speed
    weight = crane.mass[row_of(world, crane.mass.shape[0]), crane.load] * crane.gravity
    tension = tension_of(world, crane, state, rest)
    episode.tension[world] = tension
    steps = episode.stood[world] + 1
    if not (touching and speed < STILL and tension < SLACK * weight):
        steps = 0
    episode.stood[world] = steps
    episode.length[world] = episode.length[world] + wp.float64(crane.dt * episode.payout[world])
    write_rest(world, crane, episode, rest)


@wp.kernel
def crane_on(
    worlds: WorldRange, rise: wp.array[float], request: wp.array2d[float], action: wp.array2d[float], crane: Crane,
    state: StateArrays, episode: CraneState, target_qd: wp.array2d[float], body_force: wp.array2d[wp.vec3],
    rest: wp.array2d[float],
):  # fmt: skip
    """Before a physics step: what the one before has led to, the action's way, and the drives."""
    world = worlds.first + wp.tid()
    steps = episode.physics_steps[world]
    if steps > 0:
        notice(world, crane, state, episode, rest)
    episode.physics_steps[world] = steps + 1
    follow(world, rise, request, action)
    set_drives(world, action, crane, state, episode, target_qd, body_force)


@wp.kernel
def finish_physics_step(
    action: wp.array2d[float], crane: Crane, state: StateArrays, episode: CraneState, target_qd: wp.array2d[float],
    body_force: wp.array2d[wp.vec3], rest: wp.array2d[float],
):  # fmt: skip
    """After a physics step: what it has led to, and the drives anew."""
    world = wp.tid()
    notice(world, crane, state, episode, rest)
    set_drives(world, action, crane, state, episode, target_qd, body_force)


@wp.func
def judge(world: int, crane: Crane, episode: CraneState, verdicts: Verdicts):
    """Why the episode is over, if it is."""
    hard = episode.touch_speed[world] > crane.touch_down
    verdicts.hard[world] = hard
    verdicts.missed[world] = episode.missed[world]
    verdicts.placed[world] = episode.stood[world] >= crane.hold_steps and not hard and not episode.missed[world]


@wp.kernel
def judge_crane(crane: Crane, episode: CraneState, verdicts: Verdicts):
    """Judge the state that a control step has reached."""
    judge(wp.tid(), crane, episode, verdicts)


@wp.kernel
def finish_control_step(
    crane: Crane, state: StateArrays, episode: CraneState, verdicts: Verdicts, rest: wp.array2d[float]
):  # fmt: skip
    """What the last physics step of a control step has led to, and a verdict."""
    world = wp.tid()
    notice(world, crane, state, episode, rest)
    judge(world, crane, episode, verdicts)


@wp.kernel
def observe_crane(
    action: wp.array2d[float], crane: Crane, state: StateArrays, episode: CraneState, policy: wp.array2d[float],
):  # fmt: skip
    """What `CraneTask` lists."""
    world = wp.tid()
    turn = state.joint_q[world, crane.slew]
    place = crane.place + state.joint_q[world, crane.rail]
    policy[world, 0] = state.joint_qd[world, crane.slew]
    policy[world, 1] = place
    policy[world, 2] = state.joint_qd[world, crane.rail]
    policy[world, 3] = float(episode.length[world])
    policy[world, 4] = episode.payout[world]
    goal = in_boom_axes(turn, float(episode.target[world][0]), float(episode.target[world][1]))
    policy[world, 5] = goal[0] - place
    policy[world, 6] = goal[1]
    away = load_from_target(world, crane, state, episode)
    aside = in_boom_axes(turn, away[0], away[1])
    policy[world, 7] = aside[0]
    policy[world, 8] = aside[1]
    policy[world, 9] = away[2]
    v = state.body_v[world, crane.load]
    moving = in_boom_axes(turn, v[0], v[1])
    policy[world, 10] = moving[0]
    policy[world, 11] = moving[1]
    policy[world, 12] = v[2]
    below = state.body_x[world, crane.load] - state.body_x[world, crane.trolley]
    leaning = in_boom_axes(turn, float(below[0] / -below[2]), float(below[1] / -below[2]))
    policy[world, 13] = leaning[0]
    policy[world, 14] = leaning[1]
    top = state.body_x[world, crane.second] - state.body_x[world, crane.first]
    cable = in_boom_axes(turn, float(top[0] / wp.length(top)), float(top[1] / wp.length(top)))
    policy[world, 15] = cable[0]
    policy[world, 16] = cable[1]
    policy[world, 17] = KILO * episode.tension[world]
    for i in range(action.shape[1]):
        policy[world, 18 + i] = action[world, i]


@wp.struct
class CraneRewardWeights:
    """Weights of the reward's terms."""

    approach: float
    landing: float
    placed: float
    haste: float
    sway: float
    action_rate_l2: float
    time: float


@wp.kernel
def compute_crane_rewards(
    weights: CraneRewardWeights, action: wp.array2d[float], crane: Crane, state: StateArrays, episode: CraneState,
    verdicts: Verdicts, terms: wp.array2d[float],
):  # fmt: skip
    """Terms of the reward, (T, W)."""
    world = wp.tid()
    away = load_from_target(world, crane, state, episode)
    landing = float(0.0)
    if verdicts.placed[world] or verdicts.hard[world] or verdicts.missed[world]:
        far = error_of(away) / crane.tolerance
        fast = episode.touch_speed[world] / SOFT
        landing = 0.5 / (1.0 + far) + 0.5 / (1.0 + fast)
    placed = float(0.0)
    if verdicts.placed[world]:
        placed = 1.0
    swing = state.body_v[world, crane.load] - state.body_v[world, crane.trolley]
    change = float(0.0)
    for i in range(action.shape[1]):
        difference = action[world, i] - episode.last_action[world, i]
        change += difference * difference / float(action.shape[1])
    terms[0, world] = weights.approach * (episode.way[world] - way_left(away))
    terms[1, world] = weights.landing * landing
    terms[2, world] = weights.placed * placed
    terms[3, world] = weights.haste * haste_of(away, state.body_v[world, crane.load])
    terms[4, world] = weights.sway * wp.min(swing[0] * swing[0] + swing[1] * swing[1], 4.0)
    terms[5, world] = weights.action_rate_l2 * change
    terms[6, world] = weights.time


@wp.struct
class CraneStart:
    """Half-widths and ranges of what an episode begins with."""

    slew: float  # [rad]
    target: float  # [rad]
    places: wp.vec2  # of trolley and target [m]
    lengths: wp.vec2  # of the cable [m]
    near_lengths: wp.vec2  # the same at level 0 [m]
    swing: float  # [rad]
    swing_rate: float  # [rad/s]
    wind: float  # the strongest [m/s]
    spread: float  # of gusts, as a share


@wp.func
def between(level: float, near: float, far: float) -> float:
    """From a number at level 0 to another one at level 1."""
    return near + level * (far - near)


@wp.kernel
def begin_crane_episode(
    mask: wp.array[wp.bool], levels: wp.array[float], start: CraneStart, places: wp.array[wp.uint64],
    winds: wp.array[wp.uint64], draws: Draws, crane: Crane, episode: CraneState, verdicts: Verdicts,
    rest: wp.array2d[float], shape_x: wp.array2d[wp.vec3d], q: wp.array2d[float], qd: wp.array2d[float],
):  # fmt: skip
    """Draw crane, pad, swing and wind; the coordinates are for the assembly that follows. At a curriculum's level 0 the
    load hangs low over the pad in calm air, at 1 anywhere.
    """
    world = wp.tid()
    if not mask[world]:
        return
    level = levels[world]
    key = episode_key(places, world, draws)
    turn = uniform_at(key, 0, -start.target, start.target)
    far = uniform_at(key, 1, start.places[0], start.places[1])
    episode.target[world] = wp.vec3d(
        wp.float64(far) * wp.cos(wp.float64(turn)), wp.float64(far) * wp.sin(wp.float64(turn)), wp.float64(0.0)
    )  # fmt: skip
    for i in range(q.shape[1]):
        q[world, i] = 0.0
        qd[world, i] = 0.0
    q[world, crane.slew] = between(level, turn, uniform_at(key, 2, -start.slew, start.slew))
    place = between(level, far, uniform_at(key, 3, start.places[0], start.places[1]))
    q[world, crane.rail] = place - crane.place
    near = uniform_at(key, 4, start.near_lengths[0], start.near_lengths[1])
    episode.length[world] = wp.float64(between(level, near, uniform_at(key, 5, start.lengths[0], start.lengths[1])))
    calm = between(level, 0.2, 1.0)
    for i in range(2):
        q[world, crane.hinge + i] = calm * uniform_at(key, 6 + i, -start.swing, start.swing)
        qd[world, crane.hinge + i] = calm * uniform_at(key, 8 + i, -start.swing_rate, start.swing_rate)
    write_rest(world, crane, episode, rest)
    shape_x[world, crane.pad] = episode.target[world]
    weight = crane.mass[row_of(world, crane.mass.shape[0]), crane.load] * crane.gravity
    for k in range(crane.axial.shape[0]):
        dof = crane.axial[k]
        stretch = weight / crane.stiffness[row_of(world, crane.stiffness.shape[0]), dof]
        q[world, dof] = rest[world, dof] + stretch
    blown = episode_key(winds, world, draws)
    direction = uniform_at(blown, 0, 0.0, 6.2831853)
    speed = level * uniform_at(blown, 1, 0.0, start.wind)
    episode.wind[world] = wp.vec2(speed * wp.cos(direction), speed * wp.sin(direction))
    gust = wp.vec2(0.0, 0.0)
    for i in range(2):
        gust[i] = start.spread * speed * normal_at(blown, 2 + i, wp.float64(0.0), wp.float64(1.0))
    episode.gust[world] = gust
    episode.payout[world] = 0.0
    episode.tension[world] = weight
    episode.touching[world] = False
    episode.touch_speed[world] = 0.0
    episode.speed[world] = 0.0
    episode.stood[world] = 0
    episode.missed[world] = False
    judge(world, crane, episode, verdicts)


@wp.kernel
def still_crane(
    mask: wp.array[wp.bool], crane: Crane, state: StateArrays, episode: CraneState, target_qd: wp.array2d[float],
    body_force: wp.array2d[wp.vec3],
):  # fmt: skip
    """An episode begins: the drives rest until they are asked, the load has the speed of its swing."""
    world = wp.tid()
    if not mask[world]:
        return
    target_qd[world, crane.slew] = 0.0
    target_qd[world, crane.rail] = 0.0
    body_force[world, crane.load] = wp.vec3(0.0, 0.0, 0.0)
    episode.speed[world] = wp.length(state.body_v[world, crane.load])


@wp.kernel
def show_crane(crane: Crane, episode: CraneState, rest: wp.array2d[float], shape_x: wp.array2d[wp.vec3d]):
    """Write what the model has of an episode that is loaded: the length of the cable, and the pad's place."""
    world = wp.tid()
    write_rest(world, crane, episode, rest)
    shape_x[world, crane.pad] = episode.target[world]


@wp.kernel
def measure_crane(
    crane: Crane, state: StateArrays, episode: CraneState, error: wp.array[float], touch_speed: wp.array[float]
):  # fmt: skip
    """Horizontal distance of the load from the pad's middle [m], and the fastest touch [m/s]."""
    world = wp.tid()
    error[world] = error_of(load_from_target(world, crane, state, episode))
    touch_speed[world] = episode.touch_speed[world]
