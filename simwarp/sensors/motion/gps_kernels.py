"""Satellite receivers: where on the Earth the sensor is."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.clock_kernels import SampleEvents
from simwarp.sensors.motion.geodesy_kernels import DEGREE, GeoFrame, axes_at, geographic
from simwarp.sensors.motion.mount_motion_kernels import MountArrays, mount_position, mount_velocity
from simwarp.sensors.noise_kernels import NoiseArrays, noise_elapsed, noisy

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


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
    worlds: WorldRange,
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
    """The latest sample of a frame's window; position noise acts east, north and up at the place."""
    world = worlds.first + wp.tid()
    if tick.complete[world] == 0:
        return
    row = tick.row[world]
    position = mount_position(world, mount, state)
    enu = frame.local * position
    place = geographic(enu, frame)
    here = axes_at(place, frame)
    v = here * (frame.local * mount_velocity(world, mount, state))
    elapsed = noise_elapsed(world, tick, state, position_noise)
    along = here * enu
    error = wp.vec3d()
    for axis in range(3):
        error[axis] = noisy(world, axis, along[axis], elapsed, tick, position_noise) - along[axis]
    measured = enu + wp.transpose(here) * error  # without noise exactly the place
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
