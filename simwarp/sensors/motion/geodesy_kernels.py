"""The world on the Earth: local axes, Earth-centred coordinates (x to longitude 0, z to the north pole), WGS84."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

MAJOR = wp.constant(wp.float64(6378137.0))  # WGS84 (NGA.STND.0036, 2014) [m]
FLATTENING = wp.constant(wp.float64(1.0 / 298.257223563))
MINOR = wp.constant(wp.float64(6378137.0 * (1.0 - 1.0 / 298.257223563)))
ECCENTRICITY2 = wp.constant(wp.float64((2.0 - 1.0 / 298.257223563) / 298.257223563))
SECOND_ECCENTRICITY2 = wp.constant(wp.float64(0.006739496742276435))
MEAN_RADIUS = wp.constant(wp.float64(6371000.0))  # of the spherical model [m]
DEGREE = wp.constant(wp.float64(0.017453292519943295))


@wp.struct
class GeoFrame:
    """Geodetic position and axes of the world's origin."""

    spherical: int  # 1: latitude and longitude by the radius of a sphere
    latitude: wp.float64  # [rad]
    longitude: wp.float64
    altitude: wp.float64  # above the ellipsoid [m]
    place: wp.vec3d  # Earth-centred [m]
    local: wp.mat33d  # world axes to east, north, up at the origin
    axes: wp.mat33d  # east, north, up at the origin to Earth-centred axes


@wp.func
def enu_axes(latitude: wp.float64, longitude: wp.float64) -> wp.mat33d:
    """East, north and up as columns, Earth-centred axes."""
    sp = wp.sin(latitude)
    cp = wp.cos(latitude)
    sl = wp.sin(longitude)
    cl = wp.cos(longitude)
    return wp.mat33d(-sl, -sp * cl, cp * cl, cl, -sp * sl, cp * sl, wp.float64(0.0), cp, sp)


@wp.func
def geodetic(p: wp.vec3d) -> wp.vec3d:
    """Latitude, longitude [rad] and height above the ellipsoid [m] of an Earth-centred point.

    Bowring's iteration (Survey Review 23, 1976): one pass is good to 1e-11 rad on the ground, each further one adds
    about eight digits; four serve from the ground to the satellites.
    """
    across = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    s = p[2]
    c = (wp.float64(1.0) - FLATTENING) * across
    north = wp.float64(0.0)
    out = wp.float64(1.0)
    for _ in range(4):
        length = wp.sqrt(s * s + c * c)
        s = s / length
        c = c / length
        north = p[2] + SECOND_ECCENTRICITY2 * MINOR * s * s * s
        out = across - ECCENTRICITY2 * MAJOR * c * c * c
        s = (wp.float64(1.0) - FLATTENING) * north
        c = out
    length = wp.sqrt(north * north + out * out)
    sp = north / length
    cp = out / length
    height = across * cp + p[2] * sp - MAJOR * wp.sqrt(wp.float64(1.0) - ECCENTRICITY2 * sp * sp)
    return wp.vec3d(wp.atan2(north, out), wp.atan2(p[1], p[0]), height)


@wp.func
def earth_centred(enu: wp.vec3d, frame: GeoFrame) -> wp.vec3d:
    """Earth-centred place of a point east, north and up of the origin [m]."""
    return frame.place + frame.axes * enu


@wp.func
def geographic(enu: wp.vec3d, frame: GeoFrame) -> wp.vec3d:
    """Latitude, longitude [rad] and altitude [m] of a point east, north and up of the origin [m]."""
    if frame.spherical == 1:
        latitude = frame.latitude + enu[1] / MEAN_RADIUS
        longitude = frame.longitude + enu[0] / (MEAN_RADIUS * wp.cos(latitude))
        return wp.vec3d(latitude, longitude, frame.altitude + enu[2])
    return geodetic(earth_centred(enu, frame))


@wp.func
def axes_at(place: wp.vec3d, frame: GeoFrame) -> wp.mat33d:
    """From east, north, up at the origin to those of a place (latitude, longitude) [rad]."""
    if frame.spherical == 1:
        return wp.identity(n=3, dtype=wp.float64)
    return wp.transpose(enu_axes(place[0], place[1])) * frame.axes
