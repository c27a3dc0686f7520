"""Joint geometry: frames in the world, motion columns, stabilisation, and measured coordinates.

Both anchors are kept apart (frame 0 on the joint's first body, frame 1 on its second), so that a row is the exact
time derivative of its violation. Differences are formed in float64 and only then become float32.
"""

from typing import Any

import warp as wp

from simwarp.core.types import JointType, RowKind
from simwarp.kernels.core.fields import Parameters
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import clamp_length, column, matrix_to_float, rotation_vector_of, to_float

wp.set_module_options({"enable_backward": False})

REVOLUTE = wp.constant(int(JointType.REVOLUTE))
PRISMATIC = wp.constant(int(JointType.PRISMATIC))
FIXED = wp.constant(int(JointType.FIXED))
FREE = wp.constant(int(JointType.FREE))
CYLINDRICAL = wp.constant(int(JointType.CYLINDRICAL))
UNIVERSAL = wp.constant(int(JointType.UNIVERSAL))
PLANAR = wp.constant(int(JointType.PLANAR))
SPHERICAL = wp.constant(int(JointType.SPHERICAL))
SHAFT = wp.constant(int(JointType.SHAFT))
ELASTIC = wp.constant(int(JointType.ELASTIC))
RELATIVE_ROTATION = wp.constant(int(JointType.RELATIVE_ROTATION))
JOINT_DISTANCE = wp.constant(int(JointType.DISTANCE))
BUSHING = wp.constant(int(JointType.BUSHING))
COMBINATION = wp.constant(int(JointType.COMBINATION))
POINT_ON_PLANE = wp.constant(int(JointType.POINT_ON_PLANE))
POINT_ON_LINE = wp.constant(int(JointType.POINT_ON_LINE))

POINT_AXIS0 = wp.constant(int(RowKind.POINT_AXIS0))
POINT_AXIS1 = wp.constant(int(RowKind.POINT_AXIS1))
DOT = wp.constant(int(RowKind.DOT))
DISTANCE = wp.constant(int(RowKind.DISTANCE))
ANGLE0 = wp.constant(int(RowKind.ANGLE0))
ANGLE1 = wp.constant(int(RowKind.ANGLE1))

FAST_STEP = wp.constant(0.3)  # rad: of a step that turns further, the curvature at its start says little

PI_D = wp.constant(wp.float64(3.14159265358979323846))


@wp.struct
class JointFrames:
    """`r0`, `r1`: anchors from their body's centre [m]; `d`: anchor 1 minus anchor 0; axes as columns; world."""

    r0: wp.vec3d
    r1: wp.vec3d
    d: wp.vec3d
    f0: wp.mat33d
    f1: wp.mat33d


@wp.func
def joint_frames(joint: int, world: int, topology: Topology, parameters: Parameters, work: Work) -> JointFrames:
    """Frames of `joint` at the poses in `work`."""
    frames = JointFrames()
    body0 = topology.joint_body0[joint]
    body1 = topology.joint_body1[joint]
    wa = world_row(world, parameters.joint_anchor0.shape[0])
    wf = world_row(world, parameters.joint_frame0.shape[0])
    anchor0 = parameters.joint_anchor0[wa, joint]
    anchor1 = parameters.joint_anchor1[world_row(world, parameters.joint_anchor1.shape[0]), joint]
    frame0 = parameters.joint_frame0[wf, joint]
    frame1 = parameters.joint_frame1[world_row(world, parameters.joint_frame1.shape[0]), joint]
    x0 = wp.vec3d()
    x1 = wp.vec3d()
    if body0 >= 0:
        x0 = work.x[body0]
        frames.r0 = work.rot[body0] * anchor0
        frames.f0 = work.rot[body0] * frame0
    else:
        frames.r0 = anchor0
        frames.f0 = frame0
    if body1 >= 0:
        x1 = work.x[body1]
        frames.r1 = work.rot[body1] * anchor1
        frames.f1 = work.rot[body1] * frame1
    else:
        frames.r1 = anchor1
        frames.f1 = frame1
    frames.d = (x1 - x0) + (frames.r1 - frames.r0)
    return frames


@wp.func
def allowed_part(kind: int, z: Any, d: Any):
    """The part of a translation `d` that an element with the axis `z` allows, in either precision."""
    if kind == PRISMATIC or kind == CYLINDRICAL or kind == POINT_ON_LINE:
        return z * wp.dot(z, d)
    if kind == FREE or kind == BUSHING or kind == ELASTIC:
        return d
    if kind == PLANAR or kind >= POINT_ON_PLANE:
        return d - z * wp.dot(z, d)
    return type(d)()


@wp.func
def allowed_translation(kind: int, frames: JointFrames) -> wp.vec3d:
    """The part of `d` that the element allows."""
    return allowed_part(kind, column(frames.f0, 2), frames.d)


@wp.func
def misalignment(kind: int, frames: JointFrames) -> wp.vec3d:
    """Rotation vector [rad] by which frame 1 is turned against what the joint allows (small angles)."""
    error = wp.vec3d()
    if kind == REVOLUTE or kind == CYLINDRICAL or kind == PLANAR:
        error = wp.cross(column(frames.f0, 2), column(frames.f1, 2))
    elif kind == PRISMATIC or kind == FIXED:
        error = wp.float64(0.5) * (
            wp.cross(column(frames.f0, 0), column(frames.f1, 0))
            + wp.cross(column(frames.f0, 1), column(frames.f1, 1))
            + wp.cross(column(frames.f0, 2), column(frames.f1, 2))
        )
    elif kind == UNIVERSAL:
        x0 = column(frames.f0, 0)
        y1 = column(frames.f1, 1)
        error = -wp.dot(x0, y1) * wp.cross(x0, y1)
    return error


@wp.struct
class ErrorCurvature:
    """Second derivative of a joint's error along a motion of the present velocities [rad/s², m/s²], world axes."""

    ang: wp.vec3
    lin: wp.vec3


@wp.func
def error_curvature(
    kind: int, r0: wp.vec3, r1: wp.vec3, omega0: wp.vec3, omega1: wp.vec3, slip: wp.vec3, frames: JointFrames
) -> ErrorCurvature:
    """Curvature of what the joint forbids. `r0` includes the travel that it allows; `slip` is the velocity of anchor 1
    against the point of body 0 there [m/s].
    """
    z0 = to_float(column(frames.f0, 2))
    turning = omega1 - omega0
    curvature = ErrorCurvature()
    curvature.lin = wp.cross(omega1, wp.cross(omega1, r1)) - wp.cross(omega0, wp.cross(omega0, r0) + 2.0 * slip)
    curvature.lin -= allowed_part(kind, z0, curvature.lin)
    if kind == REVOLUTE or kind == CYLINDRICAL or kind == PLANAR:
        z1 = to_float(column(frames.f1, 2))
        curvature.ang = wp.cross(z1, omega1) * wp.dot(z1, turning)
    elif kind == UNIVERSAL:
        x0 = to_float(column(frames.f0, 0))
        y1 = to_float(column(frames.f1, 1))
        across = wp.cross(x0, y1)
        bend = wp.cross(x0, omega0) * wp.dot(x0, turning) + wp.cross(y1, omega1) * wp.dot(y1, turning)
        curvature.ang = across * wp.dot(across, bend)
    return curvature


@wp.func
def half_step(omega0: wp.vec3, omega1: wp.vec3, dt: float) -> float:
    """Half a step [s], fading out where a body turns by more than `FAST_STEP` within it."""
    turn = wp.max(wp.dot(omega0, omega0), wp.dot(omega1, omega1)) * (dt * dt / (FAST_STEP * FAST_STEP))
    return 0.5 * dt / (1.0 + turn * turn)


@wp.func
def curvature_term(
    kind: int, axis0: int, axis1: int, dt: float, omega0: wp.vec3, omega1: wp.vec3, speed: wp.vec3, frames: JointFrames
) -> float:
    """Half a step (`half_step`) times the second derivative of a row's value (RowKind) along a motion of two bodies, of
    which `speed` is the difference of their velocities [m/s or 1/s].
    """
    half = half_step(omega0, omega1, dt)
    e = to_float(column(frames.f0, axis0))
    f = to_float(column(frames.f1, axis1))
    if kind == DOT:
        e_rate = wp.cross(omega0, e)
        f_rate = wp.cross(omega1, f)
        turned = wp.dot(wp.cross(omega0, e_rate), f) + wp.dot(e, wp.cross(omega1, f_rate))
        return half * (turned + 2.0 * wp.dot(e_rate, f_rate))
    rate0 = wp.cross(omega0, to_float(frames.r0))
    rate1 = wp.cross(omega1, to_float(frames.r1))
    apart = speed + rate1 - rate0
    bend = wp.cross(omega1, rate1) - wp.cross(omega0, rate0)
    d = to_float(frames.d)
    if kind == DISTANCE:
        length = wp.length(d)
        if length == 0.0:
            return 0.0
        n = d / length
        along = wp.dot(n, apart)
        return half * (wp.dot(n, bend) + (wp.dot(apart, apart) - along * along) / length)
    u = e
    turning = omega0
    if kind == POINT_AXIS1:
        u = f
        turning = omega1
    u_rate = wp.cross(turning, u)
    return half * (wp.dot(wp.cross(turning, u_rate), d) + 2.0 * wp.dot(u_rate, apart) + wp.dot(u, bend))


@wp.func
def corrected(error: wp.vec3, bend: wp.vec3, inv_dt: float, limit: float, config: StepConfig) -> wp.vec3:
    """Rate at which a joint's error must fall [m/s or rad/s]: `bend`, half a step of its curvature, and the error of
    the step's start. What that has beyond the steady error of a moving joint is limited (docs/theory.md).
    """
    return clamp_length(error * inv_dt - (1.0 - config.curvature_share) * bend, limit) + bend


@wp.func
def link_geometry(
    link: int, world: int, inv_dt: float, topology: Topology, parameters: Parameters, config: StepConfig, work: Work
) -> float:
    """Sets shift, stabilisation and motion columns of a link with a joint; returns its violation [m or rad]."""
    joint = topology.link_joint[link]
    kind = topology.link_type[link]
    sign = topology.link_sign[link]
    frames = joint_frames(joint, world, topology, parameters, work)
    legal = allowed_translation(kind, frames)
    e_lin = to_float(frames.d - legal)
    e_ang = to_float(misalignment(kind, frames))
    r0 = to_float(frames.r0 + legal)
    r1 = to_float(frames.r1)
    child = r1
    parent = r0
    if sign < 0.0:
        child = r0
        parent = r1
    above = topology.link_parent[link]
    carrier_ang = wp.vec3()
    carrier_lin = wp.vec3()
    if above >= 0:
        carrier_ang = work.o_ang[above]
        carrier_lin = work.o_lin[above] + wp.cross(carrier_ang, parent)
    else:
        parent = wp.vec3()  # the world does not move: no lever, and its anchor may be kilometres long
    work.shift[link] = parent - child
    omega = work.o_ang[link]
    slip = (work.o_lin[link] + wp.cross(omega, child) - carrier_lin) * sign
    omega0 = carrier_ang
    omega1 = omega
    if sign < 0.0:
        omega0 = omega
        omega1 = carrier_ang
    curvature = error_curvature(kind, r0, r1, omega0, omega1, slip, frames)
    half = half_step(omega0, omega1, config.dt)
    # it carries all that the change of velocity must make good: the correction, and what the velocities of the
    # step's start violate at its poses
    ang = corrected(e_ang, half * curvature.ang, inv_dt, config.max_depenetration_rate, config) * (-sign)
    lin = corrected(e_lin, half * curvature.lin, inv_dt, config.max_depenetration_velocity, config) * (-sign)
    lin -= wp.cross(ang, child)
    f0 = matrix_to_float(frames.f0)
    for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
        dof = topology.tree_dof_to_dof[tree_dof]
        axis = topology.dof_axis[dof]
        a = wp.vec3()
        v = wp.vec3()
        if topology.dof_kind[dof] == POINT_AXIS0:
            v = wp.vec3(f0[0, axis], f0[1, axis], f0[2, axis]) * sign
        elif topology.dof_kind[dof] == ANGLE0:
            a = wp.vec3(f0[0, axis], f0[1, axis], f0[2, axis]) * sign
            v = wp.cross(child, a)
        else:
            a = to_float(column(frames.f1, axis)) * sign
            v = wp.cross(child, a)
        work.s_ang[tree_dof] = a
        work.s_lin[tree_dof] = v
        rate = work.rate[tree_dof]
        if config.numerical_damping < 1.0:  # the published rate is along the axes of the step before
            before = wp.dot(a, omega - carrier_ang)
            if topology.dof_kind[dof] == POINT_AXIS0:
                before = wp.dot(v, slip) * sign
            work.effort[tree_dof] = work.effort[tree_dof] + work.start[tree_dof] * (before - rate)
        ang += a * rate
        lin += v * rate
    work.stabilisation_ang[link] = ang + carrier_ang - omega
    work.stabilisation_lin[link] = lin + carrier_lin - wp.cross(carrier_ang, child) - work.o_lin[link]
    return wp.max(wp.length(e_lin), wp.length(e_ang))


@wp.func
def rotation_vector(f0: wp.mat33d, f1: wp.mat33d) -> wp.vec3d:
    """log(f0^T f1), in axes of frame 0 [rad]."""
    return rotation_vector_of(wp.quat_from_matrix(wp.transpose(f0) * f1))


@wp.func
def angle_of(cosine: wp.float64, sine: wp.float64, exact: int) -> wp.float64:
    """Angle in (-pi, pi]; to float32 accuracy, all that a published coordinate holds, unless `exact`."""
    if exact == 1:
        return wp.atan2(sine, cosine)
    return wp.float64(wp.atan2(float(sine), float(cosine)))


@wp.func
def joint_rotation_vector(kind: int, frames: JointFrames) -> wp.vec3d:
    """Rotation vector of the joints whose coordinates hold one, else zeros."""
    if kind == SPHERICAL or kind == FREE or kind == BUSHING or kind == ELASTIC:
        return rotation_vector(frames.f0, frames.f1)
    return wp.vec3d()


@wp.func
def coordinate(kind: int, local: int, exact: int, frames: JointFrames, angles: wp.vec3d) -> wp.float64:
    """Coordinate `local` of a joint of type `kind`; angles within one turn, lengths [m].

    `angles` is `joint_rotation_vector`, computed once per joint.
    """
    x0 = column(frames.f0, 0)
    y0 = column(frames.f0, 1)
    x1 = column(frames.f1, 0)
    q = wp.float64(0.0)
    if kind == REVOLUTE or (kind == CYLINDRICAL and local == 1) or (kind == PLANAR and local == 2):
        q = angle_of(wp.dot(x1, x0), wp.dot(x1, y0), exact)
    elif kind == PRISMATIC or kind == CYLINDRICAL:
        q = wp.dot(frames.d, column(frames.f0, 2))
    elif kind == UNIVERSAL:
        if local == 0:
            y1 = column(frames.f1, 1)
            q = angle_of(wp.dot(y1, y0), wp.dot(y1, column(frames.f0, 2)), exact)
        else:
            q = angle_of(wp.dot(x1, x0), wp.dot(column(frames.f1, 2), x0), exact)
    elif kind == PLANAR:
        q = wp.dot(frames.d, column(frames.f0, local))
    elif kind == JOINT_DISTANCE:
        q = wp.length(frames.d)
    elif kind == SPHERICAL:
        q = angles[local]
    elif local < 3:
        q = wp.dot(frames.d, column(frames.f0, local))
    else:
        q = angles[local - 3]
    return q


@wp.func
def unwrapped(angle: wp.float64, near: wp.float64) -> wp.float64:
    """`angle` plus the number of whole turns that brings it nearest to `near`."""
    turns = wp.round((near - angle) / (wp.float64(2.0) * PI_D))
    return angle + turns * wp.float64(2.0) * PI_D


@wp.func
def wraps(kind: int, row_kind: int) -> bool:
    """True where a coordinate counts turns."""
    vector = kind == SPHERICAL or kind == FREE or kind == BUSHING or kind == ELASTIC
    return (row_kind == ANGLE0 or row_kind == ANGLE1) and not vector
