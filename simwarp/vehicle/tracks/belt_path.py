"""The way of a belt around its wheels at rest as built: radii, length, place of the idler and tension, in float64."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.vehicle.spec.belt_parts import BeltTrack
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.track_parts import SinglePinShoe
from simwarp.vehicle.tracks.shoe_construction import drum_radius

SOLVED: Final = 1.0e-9
"""Of lengths [m]."""
MOST_STEPS: Final = 100
"""Of Newton; a handful is usual."""
CLEARANCE: Final = 0.01
"""Of idler and road wheel as near as they may come [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RestingBelt:
    """A belt around wheels that stand as built; x towards the sprocket, z up, from the track's origin.

    Attributes:
        forward: 1 with the sprocket in front, -1 with it behind.
        centers: (n + 2, 2) of sprocket, road wheels from its end on, and idler at its place [m].
        radii: (n + 2,) of the belt's path [m].
        slide: (2,) direction in which the idler's coordinate grows.
        idler: its coordinate [m].
        length: of the belt without tension [m].
        stretch: of the belt, per tension [m/N].
        tension: [N].
    """

    forward: float
    centers: Array
    radii: Array
    slide: Array
    idler: float
    length: float
    stretch: float
    tension: float


def wrapped_radius(distance: float, pitch: float) -> float:
    """Radius of the circle that shoes are as long around as around a wheel on which their middles lie.

    Args:
        distance: from the wheel's axis to the line through a shoe's pins [m].
        pitch: of the shoes [m].
    """
    return 0.5 * pitch / math.atan(0.5 * pitch / distance)


def running_radius(track: BeltTrack, resting: RestingBelt) -> float:
    """Way of the belt per angle of its sprocket [m]: a tooth takes a shoe along, a drum its surface."""
    if track.belt.smooth_sprocket:
        return float(resting.radii[0])
    return track.sprocket.teeth * track.shoe.pitch / (2.0 * math.pi)


def way_around(centers: Array, radii: Array) -> tuple[float, Array, Array]:
    """Length of a belt around circles [m], directions of its straight parts (n, 2), and angles around circles (n,).

    The circles are in order, clockwise. A straight part leads from its circle to the next one.
    """
    way = np.roll(centers, -1, axis=0) - centers
    drop = radii - np.roll(radii, -1)
    square = np.maximum(np.sum(way * way, axis=1), SOLVED)
    length = np.sqrt(np.maximum(square - drop * drop, 0.0))
    along = (
        np.stack([way[:, 0] * length + way[:, 1] * drop, way[:, 1] * length - way[:, 0] * drop], 1) / square[:, None]
    )
    before = np.roll(along, 1, axis=0)
    turns = -np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], np.sum(before * along, axis=1))
    for end in (0, -1):
        turns[end] += 2.0 * math.pi if turns[end] < -0.5 * math.pi else 0.0
    return float(np.sum(length) + np.sum(radii * turns)), along, turns


def rest_belt(track: BeltTrack) -> RestingBelt:
    """Places the idler of a belt around wheels that stand as built.

    Raises:
        SpecError: the belt is too short to go around, or so long that the tensioner does not reach it.
    """
    shoe, tensioner = track.shoe, track.idler.tensioner
    assert isinstance(shoe, SinglePinShoe)  # of BeltTrack.check
    top = shoe.wheel_pad.top
    origin = np.array(track.sprocket_location)[[0, 2]]
    forward = 1.0 if track.sprocket_location[0] >= track.idler_location[0] else -1.0
    to_plane = np.array([forward, 1.0])
    mounts = track.road_wheels if forward > 0.0 else track.road_wheels[::-1]
    wheels = np.array([[mount.location[0], mount.location[2]] for mount in mounts])
    built = (np.array(track.idler_location)[[0, 2]] - origin) * to_plane
    slide = np.array([math.cos(track.idler.slide_angle), math.sin(track.idler.slide_angle)]) * to_plane
    radii = np.array([
        wrapped_radius(drum_radius(track.shoe_track()) + top, shoe.pitch),
        *(mount.suspension.wheel.radius + top for mount in mounts),
        wrapped_radius(track.idler.wheel.radius + top, shoe.pitch),
    ])  # fmt: skip
    sign = math.copysign(1.0, tensioner.chassis_point[0] - tensioner.carrier_point[0])
    length = track.shoes * shoe.pitch
    stretch, idler, tension = 0.0, 0.0, 0.0

    def centers_at(coordinate: float) -> Array:
        return np.concatenate([np.zeros((1, 2)), (wheels - origin) * to_plane, [built + coordinate * slide]])

    for _ in range(MOST_STEPS):
        around, along, turns = way_around(centers_at(idler), radii)
        # shoes sink where they press: tension times pitch over radius each
        stretch = track.belt.wheel_sink * shoe.pitch * float(np.sum(np.maximum(turns[1:], 0.0) / radii[1:]))
        lever = float((along[-1] - along[-2]) @ slide)
        tension = (sign * tensioner.force + tensioner.stiffness * idler) / lever
        move = (around - length - stretch * tension) / (lever + stretch * tensioner.stiffness / lever)
        idler += float(np.clip(move, -0.05, 0.05))
        if abs(move) < SOLVED:
            break
    resting = RestingBelt(
        forward=forward, centers=centers_at(idler), radii=radii, slide=slide, idler=idler, length=length,
        stretch=stretch, tension=tension,
    )  # fmt: skip
    _check(track, resting, centers_at)
    return resting


def _check(track: BeltTrack, resting: RestingBelt, centers_at: object) -> None:
    pitch = track.shoe.pitch
    gap = float(np.linalg.norm(resting.centers[-1] - resting.centers[-2]))
    least = track.idler.wheel.radius + track.road_wheels[-1].suspension.wheel.radius + CLEARANCE
    if gap < least or resting.centers[-1][0] > resting.centers[-2][0]:
        missing = 2.0 * (least - gap) if gap < least else 2.0 * least
        raise SpecError(
            f"belt: {track.shoes} shoes of {pitch:g} m do not go around, some {missing:.4g} m are missing: the idler "
            f"would stand in the road wheel next to it; use {track.shoes + math.ceil(missing / pitch)} shoes"
        )
    if not resting.tension > 0.0:
        tensioner = track.idler.tensioner
        over = 2.0 * abs(resting.idler) - 2.0 * tensioner.force / max(tensioner.stiffness, SOLVED)
        raise SpecError(
            f"belt: must be tightened by its tensioner, got a tension of {resting.tension:.4g} N: {track.shoes} shoes "
            f"of {pitch:g} m are {over:.4g} m too long; use fewer, or more preload"
        )
