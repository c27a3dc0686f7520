"""One step of a reduced vehicle; one thread per vehicle of a world.

The chassis is a free body of the model with the mass and inertia of the whole vehicle, wheels held in it. A wheel's
travel z moves it along r(z, steering) with slope s = dr/dz and turns its carrier by l dz across its axis and w dz about
it. With the momentum p and the moment of momentum h per rate of the travel, mass m, chassis' acceleration a and angular
acceleration b, and f and t the ground's force and torque on the wheel,

    m z'' + p · a + h · b = s · f + l · t - w T_brake - springs - dampers - anti-roll bar
    M a = sum of f - sum of p z'',    I b + omega x I omega = sum of (r x f + t) - sum of h z'' - wheels' spins

which is the principle of virtual work: what acts on the wheel acts on travel and chassis by the same slopes, so that
roll centres, anti-dive and anti-squat are those of the linkage. Weights cancel between the first equation and the
chassis' fall, so that they act on the chassis alone. The four travels are solved together, dampers implicit; the
forces p z'' and h z'' go to the chassis, which the Simulation's step moves with all else that acts on it.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.cpu_flags import INLINE
from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import matrix_to_float, to_double
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.inputs_kernels import VehicleMotion, VehicleTables, member_of, point_velocity
from simwarp.vehicle.powertrain_kernels import Powertrain, PowertrainState, chassis_reaction
from simwarp.vehicle.reduced.driveline_kernels import biased, run_engine, turn_wheels
from simwarp.vehicle.reduced.reduced_tables_kernels import (
    WHEELS,
    Corner,
    ReducedState,
    ReducedTables,
    corner,
    damper_load,
)
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.patch_kernels import Envelopes, Wheel
from simwarp.vehicle.tires.tires_kernels import TireReports, TireTables, ground_force, report_tire

# As those of the step (kernels/dynamics/world.py): calls of the tires' laws copy all tables unless they are inlined.
CPU_FLAGS = f"{INLINE} -ffp-contract=fast"

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS})

HALF_TURN = wp.constant(wp.float64(3.141592653589793))
FULL_TURN = wp.constant(wp.float64(6.283185307179586))


@wp.struct
class TireArrays:
    """What `apply_tires` takes, for a kernel that finds the forces itself."""

    tables: TireTables
    parameter: wp.array3d[float]
    ground_friction: wp.array[float]
    state: wp.array3d[float]


@wp.struct
class Chassis:
    """The chassis at the start of a step."""

    x: wp.vec3d  # centre of mass [m]
    turn: wp.mat33d  # its axes to the world's
    axes: wp.mat33  # the same
    v: wp.vec3  # its axes [m/s]
    omega: wp.vec3  # [rad/s]


@wp.func
def chassis_of(world: int, body: int, state: StateArrays) -> Chassis:
    """A body as it is."""
    c = Chassis()
    c.x = state.body_x[world, body]
    c.turn = wp.quat_to_matrix(state.body_rot[world, body])
    c.axes = matrix_to_float(c.turn)
    back = wp.transpose(c.axes)
    c.v = back * state.body_v[world, body]
    c.omega = back * state.body_omega[world, body]
    return c


@wp.func
def wheel_at(c: Chassis, place: Corner, rate: float, spin: float) -> Wheel:
    """A wheel in the world."""
    wheel = Wheel()
    wheel.x = c.x + c.turn * to_double(place.r)
    wheel.axis = c.axes * place.axis
    wheel.v = c.axes * (c.v + wp.cross(c.omega, place.r) + rate * place.slope)
    around = c.omega + rate * place.lean
    wheel.omega_w = c.axes * (around + (spin - wp.dot(around, place.axis)) * place.axis)
    wheel.spin = spin
    return wheel


@wp.func
def bar_load(axle: int, side: int, first: Corner, second: Corner, rates: wp.vec2, t: ReducedTables) -> float:
    """Load of an anti-roll bar on the first (side 0) or second wheel of an axle [N]."""
    twist = first.bar_twist - second.bar_twist
    speed = first.bar_slope * rates[0] - second.bar_slope * rates[1]
    torque = t.bar_stiffness[axle] * twist + t.bar_damping[axle] * speed
    if side == 0:
        return torque * first.bar_slope
    return -torque * second.bar_slope


@wp.struct
class Loads:
    """What acts on chassis, travels and wheels; axes of the chassis."""

    force: wp.vec3  # on the vehicle [N]
    torque: wp.vec3  # about the chassis' centre of mass [N·m]
    push: wp.vec4  # on the travels [N]
    damping: wp.vec4  # slopes of the dampers [N·s/m]
    windup: wp.vec4  # turns of the calipers per travel [rad/m]
    moment: wp.vec4  # about the wheels' axes [N·m]
    speed: wp.vec4  # of the wheels, seen from the chassis [rad/s]
    caliper: wp.vec4  # of the calipers, likewise
    axes: wp.mat44  # rows: the wheels' axes
    spins: wp.vec3  # moment of momentum of the turning wheels [N·m·s]


@wp.func
def act_on_wheels(
    world: int, number: int, dt: float, c: Chassis, drag: float, steering: float, t: ReducedTables, tires: TireArrays,
    terrain: TerrainTables, envelopes: Envelopes, assets: Assets, reduced: ReducedState, reports: TireReports,
) -> Loads:  # fmt: skip
    """Ground, springs, dampers, anti-roll bars and drag; the tires' states are advanced."""
    back = wp.transpose(c.axes)
    factors = world_row(world, reduced.scale.shape[0])
    p_row = world_row(world, tires.parameter.shape[0])
    force = (-drag * wp.length(c.v)) * c.v
    torque = wp.vec3()
    push = wp.vec4()
    damping = wp.vec4()
    windup = wp.vec4()
    moment = wp.vec4()
    speed = wp.vec4()
    caliper = wp.vec4()
    axes = wp.mat44()
    spins = wp.vec3()
    for axle in range(2):
        one = WHEELS * number + 2 * axle
        rates = wp.vec2(reduced.travel_rate[world, one], reduced.travel_rate[world, one + 1])
        left = corner(2 * axle, reduced.travel[world, one], steering, t)
        right = corner(2 * axle + 1, reduced.travel[world, one + 1], steering, t)
        for side in range(2):
            wheel = 2 * axle + side
            slot = WHEELS * number + wheel
            place = left
            if side == 1:
                place = right
            rate = rates[side]
            spin = reduced.spin[world, slot]
            moving = wheel_at(c, place, rate, spin)
            on = ground_force(
                world, slot, moving, dt, tires.tables, tires.parameter[p_row, slot], tires.state[world, slot],
                tires.ground_friction, terrain, envelopes, assets,
            )  # fmt: skip
            report_tire(world, slot, on, reports)
            f = back * on.force
            m = back * on.torque
            force += f
            torque += wp.cross(place.r, f) + m
            load = damper_load(wheel, reduced.travel[world, slot], rate, t)
            held = reduced.scale[factors, slot, 0] * place.spring_load + reduced.scale[factors, slot, 1] * load[0]
            if t.bar_stiffness[axle] > 0.0:
                held += bar_load(axle, side, left, right, rates, t)
            push[wheel] = t.free[wheel] * (wp.dot(place.slope, f) + wp.dot(place.lean, m) - held)
            damping[wheel] = t.free[wheel] * reduced.scale[factors, slot, 1] * wp.max(load[1], 0.0)
            windup[wheel] = place.windup
            moment[wheel] = wp.dot(place.axis, m)
            speed[wheel] = spin - wp.dot(c.omega, place.axis)
            caliper[wheel] = place.windup * rate
            axes[wheel] = wp.vec4(place.axis[0], place.axis[1], place.axis[2], 0.0)
            spins += (t.spin_inertia[wheel] * spin) * place.axis
    result = Loads()
    result.force = force
    result.torque = torque
    result.push = push
    result.damping = damping
    result.windup = windup
    result.moment = moment
    result.speed = speed
    result.caliper = caliper
    result.axes = axes
    result.spins = spins
    return result


@wp.func
def move_travels(
    world: int, number: int, dt: float, mass: float, inertia: wp.mat33, omega: wp.vec3, loads: Loads,
    t: ReducedTables, reduced: ReducedState,
) -> Loads:  # fmt: skip
    """The four travels move on; returns the loads with those that their masses leave to the chassis."""
    force = loads.force
    torque = loads.torque
    push = loads.push
    damping = loads.damping
    inverse = wp.inverse(inertia)
    a = force / mass
    b = inverse * (torque - wp.cross(omega, inertia * omega))
    coupled = wp.mat44()
    for i in range(4):
        p = t.momentum[i]
        h = t.moment[i]
        lighter = p / mass
        turning = inverse * h
        for j in range(4):
            coupled[i, j] = -wp.dot(lighter, t.momentum[j]) - wp.dot(turning, t.moment[j])
        coupled[i, i] += t.mass[i] + dt * damping[i]
        push[i] = push[i] - wp.dot(p, a) - wp.dot(h, b)
    accelerations = wp.inverse(coupled) * push
    for wheel in range(4):
        slot = WHEELS * number + wheel
        rate = reduced.travel_rate[world, slot] + dt * accelerations[wheel]
        reduced.travel_rate[world, slot] = rate
        reduced.travel[world, slot] += dt * rate
        force -= accelerations[wheel] * t.momentum[wheel]
        torque -= accelerations[wheel] * t.moment[wheel]
    result = loads
    result.force = force
    result.torque = torque
    return result


@wp.kernel
def run_reduced_vehicle(
    # inputs
    worlds: WorldRange,
    dt: float,
    vehicle: VehicleTables,
    t: ReducedTables,
    powertrain: Powertrain,
    vehicle_input: wp.array3d[float],  # (W, V, 4): steering -1..1 (left +), throttle, braking, clutch 0..1
    lock: wp.array3d[float],  # (W, V, locks) 0..1
    tires: TireArrays,
    terrain: TerrainTables,
    envelopes: Envelopes,
    assets: Assets,
    parameters: Parameters,
    state: StateArrays,
    # outputs
    reduced: ReducedState,
    memory: PowertrainState,
    motion: VehicleMotion,
    reports: TireReports,
    control: ControlArrays,
):
    """Wheels and powertrain move on by a step, and the chassis' forces for it are found; dim (W, V), or (1, V) where
    one thread takes all worlds of the range: it fetches the tables once.
    """
    index, number = wp.tid()
    end = wp.where(worlds.own_slots == 1, index + 1, worlds.count)
    for turn in range(index, end):
        world = worlds.first + turn
        of = member_of(world, number, vehicle)
        body = of.body + vehicle.chassis
        steering = wp.clamp(vehicle_input[world, number, 0], -1.0, 1.0)
        throttle = wp.clamp(vehicle_input[world, number, 1], 0.0, 1.0)
        braking = wp.clamp(vehicle_input[world, number, 2], 0.0, 1.0)
        clutch = wp.clamp(vehicle_input[world, number, 3], 0.0, 1.0)
        c = chassis_of(world, body, state)
        loads = act_on_wheels(
            world, number, dt, c, vehicle.drag, steering, t, tires, terrain, envelopes, assets, reduced, reports
        )  # fmt: skip
        speed = loads.speed
        moment = loads.moment
        memory.drive_speed[world, number] = wp.dot(t.drive, speed)
        reacting = wp.vec3()
        drive = run_engine(of, dt, throttle, clutch, state.world_time[world], t, powertrain, memory, reduced)
        if powertrain.engine > 0:
            reacting = chassis_reaction(of, dt, powertrain, memory)
            moment += (drive.direct * drive.torque) * t.drive + biased(speed, drive.torque, t, powertrain)
        turned = turn_wheels(of, dt, drive, speed, moment, loads.caliper, braking, lock, t, reduced)

        torque = loads.torque + reacting - wp.cross(c.omega, loads.spins)
        push = loads.push
        for wheel in range(4):
            slot = WHEELS * number + wheel
            change = turned.speed[wheel] - speed[wheel]
            reduced.spin[world, slot] += change
            reduced.turn_rate[world, slot] = turned.speed[wheel]
            angle = reduced.turn[world, slot] + wp.float64(dt * turned.speed[wheel])
            if angle > HALF_TURN:
                angle -= FULL_TURN
            elif angle < -HALF_TURN:
                angle += FULL_TURN
            reduced.turn[world, slot] = angle
            push[wheel] = push[wheel] - loads.windup[wheel] * turned.brake[wheel]
            axis = wp.vec3(loads.axes[wheel, 0], loads.axes[wheel, 1], loads.axes[wheel, 2])
            torque -= (t.spin_inertia[wheel] * change / dt) * axis
            reduced.axis[world, slot] = axis
        loads.torque = torque
        loads.push = push
        mass = parameters.body_mass[world_row(world, parameters.body_mass.shape[0]), body]
        inertia = parameters.body_inertia_b[world_row(world, parameters.body_inertia_b.shape[0]), body]
        loads = move_travels(world, number, dt, mass, inertia, c.omega, loads, t, reduced)
        arm = c.axes * vehicle.point
        motion.last_v[world, number] = point_velocity(world, body, arm, state)
        control.element_force[world, body] = c.axes * loads.force
        control.element_torque[world, body] = c.axes * loads.torque
