"""Satellite receivers and magnetometers: where on the Earth the sensor is, and the Earth's field there."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.sensors.clock import ClockSettings, SampleEvents
from simwarp.kernels.sensors.motion.geodesy import DEGREE, GeoFrame, earth_centred, geographic, local_velocity
from simwarp.kernels.sensors.motion.mount_motion import MountArrays, mount_position, mount_rotation, mount_velocity
from simwarp.kernels.sensors.noise import NoiseArrays, noise_elapsed, noisy
from simwarp.kernels.sensors.vector_sensor import write_vector

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FIELD_RADIUS = wp.constant(wp.float64(6371200.0))  # reference radius of geomagnetic models [m]


@wp.struct
class GpsRings:
    """Output buffers of a receiver: measured and true values."""

    data: wp.array2d[wp.float64]  # latitude, longitude [deg], altitude [m]
    truth: wp.array2d[wp.float64]
    velocity: wp.array2d[float]  # east, north, up at the place [m/s]
    velocity_truth: wp.array2d[float]
    position: wp.array2d[float]  # world axes, from the world's origin [m]


@wp.func
def in_degrees(place: wp.vec3d) -> wp.vec3d:
    """Latitude and longitude in degrees, the latter in -180..180."""
    longitude = place[1] / DEGREE
    longitude -= wp.float64(360.0) * wp.floor((longitude + wp.float64(180.0)) / wp.float64(360.0))
    return wp.vec3d(place[0] / DEGREE, longitude, place[2])


@wp.kernel
def sample_gps(
    # inputs
    frame: GeoFrame,
    mount: MountArrays,
    state: StateArrays,
    tick: SampleEvents,
    # in and out
    position_noise: NoiseArrays,
    velocity_noise: NoiseArrays,
    # outputs
    rings: GpsRings,
):
    """The latest sample of a frame's window; position noise acts east, north and up."""
    world = wp.tid()
    if tick.complete[world] == 0:
        return
    row = tick.row[world]
    position = mount_position(world, mount, state)
    enu = frame.local * position
    place = geographic(enu, frame)
    v = local_velocity(frame.local * mount_velocity(world, mount, state), place, frame)
    elapsed = noise_elapsed(world, tick, state, position_noise)
    measured = wp.vec3d()
    for axis in range(3):
        measured[axis] = noisy(world, axis, enu[axis], elapsed, tick, position_noise)
    reported = in_degrees(geographic(measured, frame))
    true = in_degrees(place)
    metres = wp.transpose(frame.local) * measured
    elapsed = noise_elapsed(world, tick, state, velocity_noise)
    for axis in range(3):
        rings.data[row, axis] = reported[axis]
        rings.truth[row, axis] = true[axis]
        rings.position[row, axis] = float(metres[axis])
        rings.velocity_truth[row, axis] = float(v[axis])
        rings.velocity[row, axis] = float(noisy(world, axis, v[axis], elapsed, tick, velocity_noise))


@wp.kernel
def sample_magnetometer(
    # inputs
    clock: ClockSettings,
    frame: GeoFrame,
    pole: wp.vec3d,  # unit vector to the geomagnetic north pole, Earth-centred
    strength: wp.float64,  # at the magnetic equator [T]
    mount: MountArrays,
    state: StateArrays,
    tick: SampleEvents,
    # in and out
    noise: NoiseArrays,
    sums: wp.array2d[wp.float64],
    # outputs
    truth: wp.array2d[float],
    data: wp.array2d[float],
):
    """The field of a dipole in the Earth's centre, B = B0 (R/r)^3 (m - 3 (m . r) r) with unit vectors m, r: it points
    to the geomagnetic north pole along the equator, and down into the ground there.
    """
    world = wp.tid()
    if tick.collecting[world] == 0:
        return
    place = earth_centred(frame.local * mount_position(world, mount, state), frame)
    distance = wp.length(place)
    radial = place / distance
    ratio = FIELD_RADIUS / distance
    field = strength * ratio * ratio * ratio * (pole - wp.float64(3.0) * wp.dot(pole, radial) * radial)
    field_w = wp.transpose(frame.local) * (wp.transpose(frame.axes) * field)
    value = wp.quat_rotate_inv(mount_rotation(world, mount, state), field_w)
    write_vector(world, 0, value, clock, tick, state, noise, sums, truth, data)
