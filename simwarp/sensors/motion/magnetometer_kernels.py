"""Magnetometers: the Earth's field at the place of the sensor."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.clock_kernels import ClockSettings, SampleEvents
from simwarp.sensors.motion.geodesy_kernels import GeoFrame, earth_centred
from simwarp.sensors.motion.mount_motion_kernels import MountArrays, mount_position, mount_rotation
from simwarp.sensors.noise_kernels import NoiseArrays
from simwarp.sensors.vector_sensor_kernels import write_vector

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FIELD_RADIUS = wp.constant(wp.float64(6371200.0))  # reference radius of geomagnetic models [m]


@wp.kernel
def sample_magnetometer(
    # inputs
    worlds: WorldRange,
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
    world = worlds.first + wp.tid()
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
