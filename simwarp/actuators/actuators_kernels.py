"""Actuators of all worlds, before each sub-step: delays, activations, laws, and what they write into `Control`.

One thread per world goes through its actuators, so that several of them on one coordinate or body add up in a fixed
order. Lengths and rates are those of the sub-step's start.
"""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.core.world_status import NON_FINITE
from simwarp.kernels.dynamics.efforts import effort_bounds
from simwarp.kernels.dynamics.joints import rotation_vector

wp.set_module_options({"enable_backward": False})

# members of `Law`, `Target` and `Activation` (simwarp/actuators/actuator_spec.py)
SERVO = wp.constant(1)
VELOCITY = wp.constant(1)
NO_STATE = wp.constant(0)
INTEGRATOR = wp.constant(1)
FILTER = wp.constant(2)
NO_BOUND = wp.constant(1.0e30)


@wp.struct
class ActuatorTables:
    """Constants of `A` actuators, shared by all worlds."""

    law: wp.array[int]  # Law
    target: wp.array[int]  # Target
    activation: wp.array[int]  # Activation
    early: wp.array[int]  # 1: the force follows the activation at the end of a sub-step
    ctrl_range: wp.array[wp.vec2]
    activation_range: wp.array[wp.vec2]
    length_offset: wp.array[float]
    line: wp.array[int]  # place in the delay lines, -1: no delay
    term_start: wp.array[int]  # CSR: coordinates
    term_dof: wp.array[int]
    term_coefficient: wp.array[float]
    site: wp.array[int]  # index of a site, -1: coordinates
    site_body: wp.array[int]
    site_x: wp.array[wp.vec3d]  # origin from the body's centre of mass, body axes [m]
    site_rot: wp.array[wp.quatd]
    site_force: wp.array[wp.vec3]
    site_torque: wp.array[wp.vec3]
    referred: wp.array[int]  # 1: axes of a reference, which takes the reaction
    reference_body: wp.array[int]  # -1: the world
    reference_x: wp.array[wp.vec3d]
    reference_rot: wp.array[wp.quatd]
    own_dof: wp.array[int]  # entries that the actuators write: coordinates
    own_body: wp.array[int]  # and bodies


@wp.struct
class ActuatorParameters:
    """(1 or W, A): what may differ per world."""

    gain: wp.array2d[wp.vec3]
    bias: wp.array2d[wp.vec3]
    force_range: wp.array2d[wp.vec2]
    time_constant: wp.array2d[float]
    delay: wp.array2d[float]
    stall_force: wp.array2d[float]
    free_speed: wp.array2d[float]
    corner_speed: wp.array2d[float]


@wp.struct
class ActuatorState:
    """Controls, and what outlives a sub-step."""

    ctrl: wp.array2d[float]  # (W, A)
    activation: wp.array2d[wp.float64]  # (W, A): small rates add up over many steps
    line: wp.array3d[float]  # (W, delayed, samples): a ring of controls
    cursor: wp.array[int]  # (W,) place of the present sample
    force: wp.array2d[float]  # (W, A) of the last sub-step


@wp.struct
class Motion:
    """Length of an actuator and its rate."""

    length: float
    rate: float


@wp.struct
class SiteFrame:
    """Where a site's wrench acts: axes of its gear, levers from both bodies' centres, world axes."""

    axes: wp.quatd
    own: wp.quatd  # axes of the site itself
    place: wp.vec3d
    arm: wp.vec3  # from the body's centre
    reference_arm: wp.vec3  # to the same point from the centre of the reference


@wp.func
def within(value: float, bounds: wp.vec2) -> float:
    """The value between its bounds; NaN stays."""
    result = value
    if value < bounds[0]:
        result = bounds[0]
    if value > bounds[1]:
        result = bounds[1]
    return result


@wp.func
def delayed(
    world: int, actuator: int, ctrl: float, dt: float, tables: ActuatorTables, parameters: ActuatorParameters,
    actuators: ActuatorState,
) -> float:  # fmt: skip
    """The control of some sub-steps ago; the present one joins the line."""
    line = tables.line[actuator]
    if line < 0:
        return ctrl
    samples = actuators.line.shape[2]
    now = actuators.cursor[world]
    actuators.line[world, line, now] = ctrl
    delay = parameters.delay[world_row(world, parameters.delay.shape[0]), actuator]
    past = now - wp.clamp(int(wp.round(delay / dt)), 0, samples - 1)
    if past < 0:
        past += samples
    return actuators.line[world, line, past]


@wp.func
def next_activation(kind: int, activation: wp.float64, ctrl: float, dt: float, time: float) -> wp.float64:
    """The state after a sub-step, without its bounds."""
    u = wp.float64(ctrl)
    h = wp.float64(dt)
    if kind == INTEGRATOR:
        return activation + h * u
    share = h / wp.float64(time)
    if kind != FILTER:
        share = wp.float64(1.0) - wp.exp(-share)
    return activation + (u - activation) * share


@wp.func
def driving_input(
    world: int, actuator: int, dt: float, tables: ActuatorTables, parameters: ActuatorParameters,
    actuators: ActuatorState,
) -> float:  # fmt: skip
    """The control, or the activation in its place, which advances."""
    ctrl = within(actuators.ctrl[world, actuator], tables.ctrl_range[actuator])
    ctrl = delayed(world, actuator, ctrl, dt, tables, parameters, actuators)
    kind = tables.activation[actuator]
    if kind == NO_STATE:
        return ctrl
    time = parameters.time_constant[world_row(world, parameters.time_constant.shape[0]), actuator]
    before = actuators.activation[world, actuator]
    after = next_activation(kind, before, ctrl, dt, time)
    bounds = tables.activation_range[actuator]
    if after < wp.float64(bounds[0]):
        after = wp.float64(bounds[0])
    if after > wp.float64(bounds[1]):
        after = wp.float64(bounds[1])
    actuators.activation[world, actuator] = after
    if tables.early[actuator] == 1:
        return float(after)
    return float(before)


@wp.func
def site_frame(site: int, world: int, tables: ActuatorTables, state: StateArrays) -> SiteFrame:
    """Axes and levers of a site's wrench at the present poses."""
    frame = SiteFrame()
    body = tables.site_body[site]
    q = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    x = wp.vec3d()
    if body >= 0:
        q = state.body_rot[world, body]
        x = state.body_x[world, body]
    arm = wp.quat_rotate(q, tables.site_x[site])
    frame.arm = to_float(arm)
    frame.place = x + arm
    frame.own = q * tables.site_rot[site]
    frame.axes = frame.own
    reference = tables.reference_body[site]
    if tables.referred[site] == 1:
        frame.axes = tables.reference_rot[site]
        if reference >= 0:
            frame.axes = state.body_rot[world, reference] * tables.reference_rot[site]
            frame.reference_arm = to_float(frame.place - state.body_x[world, reference])
    return frame


@wp.func
def to_world(axes: wp.quatd, v: wp.vec3) -> wp.vec3:
    """A vector in world axes."""
    return to_float(wp.quat_rotate(axes, wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))))


@wp.func
def site_motion(site: int, world: int, frame: SiteFrame, tables: ActuatorTables, state: StateArrays) -> Motion:
    """Length and rate of a site along its gear."""
    motion = Motion()
    body = tables.site_body[site]
    reference = tables.reference_body[site]
    omega = wp.vec3()
    v = wp.vec3()
    if body >= 0:
        omega = state.body_omega[world, body]
        v = state.body_v[world, body] + wp.cross(omega, frame.arm)
    if tables.referred[site] == 1:
        origin = tables.reference_x[site]
        if reference >= 0:
            origin = state.body_x[world, reference] + wp.quat_rotate(
                state.body_rot[world, reference], tables.reference_x[site]
            )
            spin = state.body_omega[world, reference]
            v -= state.body_v[world, reference] + wp.cross(spin, frame.reference_arm)
            omega -= spin
        offset = to_float(wp.quat_rotate_inv(frame.axes, frame.place - origin))
        turned = to_float(rotation_vector(wp.quat_to_matrix(frame.axes), wp.quat_to_matrix(frame.own)))
        motion.length = wp.dot(tables.site_force[site], offset) + wp.dot(tables.site_torque[site], turned)
    force = to_world(frame.axes, tables.site_force[site])
    torque = to_world(frame.axes, tables.site_torque[site])
    motion.rate = wp.dot(force, v) + wp.dot(torque, omega)
    return motion


@wp.func
def coordinate_motion(actuator: int, world: int, tables: ActuatorTables, state: StateArrays) -> Motion:
    """Length and rate of an actuator on coordinates."""
    length = wp.float64(tables.length_offset[actuator])
    rate = float(0.0)
    for term in range(tables.term_start[actuator], tables.term_start[actuator + 1]):
        dof = tables.term_dof[term]
        length += wp.float64(tables.term_coefficient[term]) * state.joint_x[world, dof]
        rate += tables.term_coefficient[term] * state.joint_qd[world, dof]
    motion = Motion()
    motion.length = float(length)
    motion.rate = rate
    return motion


@wp.func
def affine(law: wp.vec3, motion: Motion) -> float:
    """A number affine in length and rate."""
    return law[0] + law[1] * motion.length + law[2] * motion.rate


@wp.func
def actuator_force(
    world: int, actuator: int, u: float, motion: Motion, parameters: ActuatorParameters
) -> float:  # fmt: skip
    """The law, its bounds, and the motor's limit at its speed."""
    gain = affine(parameters.gain[world_row(world, parameters.gain.shape[0]), actuator], motion)
    bias = affine(parameters.bias[world_row(world, parameters.bias.shape[0]), actuator], motion)
    force = within(gain * u + bias, parameters.force_range[world_row(world, parameters.force_range.shape[0]), actuator])
    if force * motion.rate >= 0.0:  # it speeds the motion up
        stall = parameters.stall_force[world_row(world, parameters.stall_force.shape[0]), actuator]
        free = parameters.free_speed[world_row(world, parameters.free_speed.shape[0]), actuator]
        corner = parameters.corner_speed[world_row(world, parameters.corner_speed.shape[0]), actuator]
        if stall < NO_BOUND:
            share = wp.clamp((free - wp.abs(motion.rate)) / (free - corner), 0.0, 1.0)
            force = within(force, wp.vec2(-stall * share, stall * share))
    return force


@wp.func
def servo_force(
    world: int, actuator: int, u: float, tables: ActuatorTables, model: Parameters, state: StateArrays,
    control: ControlArrays,
) -> float:  # fmt: skip
    """Hands the target to the drive of the coordinate; returns the drive's force at the sub-step's start."""
    term = tables.term_start[actuator]
    dof = tables.term_dof[term]
    coefficient = tables.term_coefficient[term]
    if tables.target[actuator] == VELOCITY:
        control.joint_target_qd[world, dof] = u / coefficient
    else:
        control.joint_target_q[world, dof] = (u - tables.length_offset[actuator]) / coefficient
    stiffness = model.drive_stiffness[world_row(world, model.drive_stiffness.shape[0]), dof]
    damping = model.drive_damping[world_row(world, model.drive_damping.shape[0]), dof]
    effort = stiffness * (control.joint_target_q[world, dof] - state.joint_q[world, dof])
    effort += damping * (control.joint_target_qd[world, dof] - state.joint_qd[world, dof])
    return within(effort, effort_bounds(dof, world, model)) / coefficient


@wp.func
def apply_terms(world: int, actuator: int, force: float, tables: ActuatorTables, control: ControlArrays):
    """Adds the force to the coordinates of an actuator."""
    for term in range(tables.term_start[actuator], tables.term_start[actuator + 1]):
        dof = tables.term_dof[term]
        control.element_joint_force[world, dof] = (
            control.element_joint_force[world, dof] + tables.term_coefficient[term] * force
        )


@wp.func
def apply_site(site: int, world: int, force: float, frame: SiteFrame, tables: ActuatorTables, control: ControlArrays):
    """Adds the wrench to the body of a site, and its reaction to the reference."""
    body = tables.site_body[site]
    lin = to_world(frame.axes, tables.site_force[site]) * force
    ang = to_world(frame.axes, tables.site_torque[site]) * force
    if body >= 0:
        control.element_force[world, body] = control.element_force[world, body] + lin
        control.element_torque[world, body] = control.element_torque[world, body] + ang + wp.cross(frame.arm, lin)
    reference = tables.reference_body[site]
    if tables.referred[site] == 1 and reference >= 0:
        control.element_force[world, reference] = control.element_force[world, reference] - lin
        control.element_torque[world, reference] = (
            control.element_torque[world, reference] - ang - wp.cross(frame.reference_arm, lin)
        )


@wp.func
def clear_entries(world: int, tables: ActuatorTables, control: ControlArrays):
    """Zero where the actuators add."""
    for index in range(tables.own_dof.shape[0]):
        control.element_joint_force[world, tables.own_dof[index]] = 0.0
    for index in range(tables.own_body.shape[0]):
        control.element_force[world, tables.own_body[index]] = wp.vec3()
        control.element_torque[world, tables.own_body[index]] = wp.vec3()


@wp.kernel
def drive_actuators(
    # inputs
    worlds: WorldRange,
    dt: float,
    tables: ActuatorTables,
    parameters: ActuatorParameters,
    model: Parameters,
    state: StateArrays,
    # in and out
    actuators: ActuatorState,
    # outputs
    control: ControlArrays,
):
    """Efforts, wrenches and targets of a sub-step; frozen worlds stay as they are."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    clear_entries(world, tables, control)
    for actuator in range(tables.law.shape[0]):
        u = driving_input(world, actuator, dt, tables, parameters, actuators)
        site = tables.site[actuator]
        force = float(0.0)
        if tables.law[actuator] == SERVO:
            force = servo_force(world, actuator, u, tables, model, state, control)
        elif site >= 0:
            frame = site_frame(site, world, tables, state)
            motion = site_motion(site, world, frame, tables, state)
            force = actuator_force(world, actuator, u, motion, parameters)
            apply_site(site, world, force, frame, tables, control)
        else:
            motion = coordinate_motion(actuator, world, tables, state)
            force = actuator_force(world, actuator, u, motion, parameters)
            apply_terms(world, actuator, force, tables, control)
        actuators.force[world, actuator] = force
    if actuators.line.shape[1] > 0:
        actuators.cursor[world] = (actuators.cursor[world] + 1) % actuators.line.shape[2]


@wp.kernel
def map_actions(action: wp.array2d[float], ctrl_range: wp.array[wp.vec2], ctrl: wp.array2d[float]):
    """Controls of actions: -1 to 1 is the range of the control; where it has none, the action itself."""
    world, actuator = wp.tid()
    value = action[world, actuator]
    bounds = ctrl_range[actuator]
    if bounds[0] > -NO_BOUND and bounds[1] < NO_BOUND:
        # exact at both ends
        value = 0.5 * ((1.0 - value) * bounds[0] + (1.0 + value) * bounds[1])
    ctrl[world, actuator] = value
