"""Bodies of tracked vehicles, from the measures of their descriptions: hull, sprockets, wheels, shoes."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.scenery.solids import Array, box, lathe, loft, mirrored, moved, tone, tube
from simwarp.scenery.vehicle_bodies import PLAIN_STYLE, Section, body_shell, wheel_mesh
from simwarp.vehicle.spec.track_parts import (
    Shoe,
    SinglePinShoe,
    SinglePinSprocket,
    TrackSprocket,
    TrackWheel,
)
from simwarp.vehicle.spec.tracked_vehicle_spec import Track, TrackedVehicleSpec

OLIVE: Final = tone("5d6543")
_DARK, _BLACK, _RUBBER = tone("2b2b2b"), tone("151515"), tone("232323")
_STEEL, _GLASS, _LAMP = tone("5a5852"), tone("22303a"), tone("fdf8e0")
_SIDEWAYS: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns z to y."""
DISC: Final = 0.16
"""Thickness of a sprocket's disc over the distance of the two."""
TIP_CORNERS: Final = 9
"""Points of the outline of one gap between teeth."""
ROOF: Final = 0.47
"""Height of a hull's roof above the ground over the distance of sprocket and idler: that of an M113."""
OVERHANG: Final = (0.115, 0.11)
"""Of a hull in front of the foremost and behind the rearmost of sprocket and idler, over their distance."""


def sprocket_mesh(sprocket: TrackSprocket) -> VisualMesh:
    """Two toothed discs on a drum, which turn about y; a gap points down."""
    outline = tooth_outline(sprocket)
    half, apart = 0.5 * DISC * sprocket.separation, 0.5 * sprocket.separation
    discs = [_plate(outline, side * apart - half, side * apart + half, _STEEL) for side in (1.0, -1.0)]
    hub = 0.62 * sprocket.assembly_radius
    drum = moved(lathe([(hub, -1.15 * apart), (hub, 1.15 * apart)], 0.8 * OLIVE, 16), turn=_SIDEWAYS)
    caps = [_bolts(0.75 * hub, side * 1.2 * apart) for side in (1.0, -1.0)]
    return joined([*discs, drum, *caps])


def tooth_outline(sprocket: TrackSprocket) -> Array:
    """(teeth * 9, 2) x and z of a disc's edge, from the lowest gap on, counter-clockwise seen along -y."""
    pitch = 2.0 * math.pi / sprocket.teeth
    if isinstance(sprocket, SinglePinSprocket):
        center, radius = sprocket.arc_center_radius, sprocket.arc_radius
        # where the arc meets the circle of the tips
        cosine = (center**2 + radius**2 - sprocket.tip_radius**2) / (2.0 * center * radius)
        open_angle = math.acos(min(1.0, max(-1.0, cosine)))
        turn = np.linspace(-open_angle, open_angle, TIP_CORNERS)
        across, down = radius * np.sin(turn), center - radius * np.cos(turn)
    else:  # two arcs side by side, near a wave between seat and tips
        angle = np.linspace(-0.46, 0.46, TIP_CORNERS) * pitch
        seat = 0.88 * sprocket.assembly_radius
        reach = seat + (sprocket.tip_radius - seat) * np.sin(0.5 * math.pi * np.abs(angle) / (0.46 * pitch)) ** 2
        across, down = reach * np.sin(angle), reach * np.cos(angle)
    phi = pitch * np.arange(sprocket.teeth)[:, None]
    x = np.cos(phi) * across + np.sin(phi) * down
    z = np.sin(phi) * across - np.cos(phi) * down
    return np.stack([x.ravel(), z.ravel()], axis=1)


def _plate(outline: Array, low: float, high: float, color: Array) -> VisualMesh:
    """An outline in x and z, extruded along y."""
    rings = [np.stack([outline[:, 0], np.full(len(outline), y), outline[:, 1]], axis=1) for y in (high, low)]
    return loft(np.array(rings), color)


def _bolts(radius: float, y: float) -> VisualMesh:
    """A cap with a ring of bolts, which show how a wheel turns."""
    cap = moved(lathe([(radius, -0.01), (0.8 * radius, 0.015)], OLIVE, 12), turn=_SIDEWAYS)
    flip = cap if y > 0.0 else mirrored(cap)
    bolts = [
        box((0.012, 0.02, 0.012), _BLACK, (0.7 * radius * math.cos(a), 0.0, 0.7 * radius * math.sin(a)))
        for a in 2.0 * math.pi * np.arange(5) / 5.0
    ]
    return moved(joined([flip, *bolts]), (0.0, y, 0.0))


def track_wheel_mesh(wheel: TrackWheel, *, rubber: bool = True) -> VisualMesh:
    """A road wheel with rubber rims or a bare idler, about y; two discs where it has a gap."""
    style = dataclasses.replace(PLAIN_STYLE, rim=OLIVE if rubber else 0.9 * OLIVE, rim_share=0.86 if rubber else 0.95)
    if wheel.gap <= 0.0:
        return wheel_mesh(style, wheel.radius, wheel.width)
    disc = moved(wheel_mesh(style, wheel.radius, 0.5 * (wheel.width - wheel.gap)), (0.0, wheel.disc_offset, 0.0))
    hub = 0.3 * wheel.radius
    axle = moved(lathe([(hub, -0.5 * wheel.gap), (hub, 0.5 * wheel.gap)], _DARK, 10), turn=_SIDEWAYS)
    return joined([disc, mirrored(disc), axle])


def shoe_mesh(shoe: Shoe, width: float) -> VisualMesh:
    """A shoe in its own frame: a link of a width [m] with its pin, pads, and the guide between the wheels' discs."""
    long = shoe.pitch if isinstance(shoe, SinglePinShoe) else shoe.length
    thick = 0.32 * shoe.height
    ground, wheel = (
        box(tuple(0.5 * value for value in pad.size), color, pad.center)
        for pad, color in ((shoe.ground_pad, _RUBBER), (shoe.wheel_pad, 0.7 * _STEEL))
    )
    link = box((0.42 * long, 0.5 * width, 0.5 * thick), _STEEL)
    # across, as tubes of six corners: the edges of neighbouring shoes meet there
    pins = [
        tube([(x, 0.5 * width, 0.0), (x, -0.5 * width, 0.0)], 0.5 * thick, 0.6 * _STEEL, 6)
        for x in ((0.5 * long,) if isinstance(shoe, SinglePinShoe) else (0.5 * long, -0.5 * long))
    ]
    return joined([ground, wheel, link, *pins, _guide(shoe)])


def _guide(shoe: Shoe) -> VisualMesh:
    """A tooth from the upper pad to the guide's tip and as much beyond it."""
    x, y, tip = shoe.guide
    foot = shoe.wheel_pad.center[2] + 0.4 * shoe.wheel_pad.size[2]
    top = max(2.0 * tip, foot + 0.01)
    rings = []
    for z, long, wide in ((foot, 0.02, 0.012), (top, 0.01, 0.006)):
        rings.append([(x + a * long, y + b * wide, z) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))][::-1])
    return loft(np.array(rings), _STEEL)


def shoe_width(track: Track) -> float:
    """Across the whole shoe [m]: over both discs of the sprocket and some more."""
    shoe = track.shoe
    return max(1.65 * track.sprocket.separation, shoe.ground_pad.size[1], shoe.wheel_pad.size[1])


def hull_mesh(spec: TrackedVehicleSpec, color: Array) -> VisualMesh:
    """A box over both tracks with a wedge in front, as that of an M113, in the vehicle's frame of reference."""
    track, width = spec.left, shoe_width(spec.left)
    ends = sorted((track.sprocket_location[0], track.idler_location[0]))
    length = ends[1] - ends[0]
    back, front = ends[0] - OVERHANG[1] * length, ends[1] + OVERHANG[0] * length
    wheels = [mount.location[2] - mount.suspension.wheel.radius for mount in track.road_wheels]
    soil = min(wheels) - track.shoe.height
    floor = soil + 0.105 * length
    shelf = track.sprocket_location[2] + track.sprocket.assembly_radius + 1.4 * track.shoe.height
    roof = soil + ROOF * length
    inner, outer = spec.track_offset - 0.55 * width, spec.track_offset + 0.52 * width
    paint = {"p": color, "t": 1.06 * color, "d": 0.55 * color, "g": 0.97 * color}
    break_x = front - 0.29 * length

    def section(x: float, low: float, high: float) -> Section:
        return x, [(inner, low), (inner, shelf), (outer, shelf), (outer, high)]

    nose = shelf + 0.025 * length
    knee = roof + 0.59 * (nose - roof)
    shell = body_shell([
        section(back, floor + 0.05 * length, roof - 0.01 * length), section(back + 0.02 * length, floor, roof),
        section(break_x, floor, roof), section(front - 0.12 * length, floor, knee),
        section(front, shelf - 0.06 * length, nose),
    ], ["ddptd", "ddptd", "ddpgd", "ddpgd"], paint)  # fmt: skip
    slope = math.atan2(roof - nose, front - break_x)
    return joined([shell, *_front(break_x, roof, front, nose, outer, slope, color, length),
                   *_roof(back, break_x, roof, outer, color, length),
                   *_rear(back, floor, roof, inner, color, length)])  # fmt: skip


def _pitched(angle: float) -> Array:
    """Turns about y, x towards -z [rad]."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def _front(
    break_x: float, roof: float, front: float, nose: float, outer: float, slope: float, color: Array, unit: float
) -> list[VisualMesh]:
    """A board against waves and a hatch on the glacis, lamps beside them."""
    turn, middle = _pitched(slope), (0.5 * (break_x + front), 0.5 * (roof + nose))
    up = (0.012 * unit * math.sin(slope), 0.012 * unit * math.cos(slope))
    board = moved(
        box((0.075 * unit, 0.8 * outer, 0.006 * unit), 0.8 * color),
        (middle[0] + 0.06 * unit + up[0], 0.0, middle[1] - 0.06 * unit * math.tan(slope) + up[1]),
        turn=turn,
    )
    hatch = moved(
        box((0.05 * unit, 0.32 * outer, 0.006 * unit), 1.12 * color),
        (middle[0] - 0.08 * unit, -0.35 * outer, middle[1] + 0.08 * unit * math.tan(slope) + up[1]),
        turn=turn,
    )
    lamps = []
    for side in (1.0, -1.0):
        at = (front - 0.03 * unit, side * 0.78 * outer, nose + 0.03 * unit)
        disc = lathe([(0.018 * unit, -0.004 * unit), (0.018 * unit, 0.004 * unit)], _LAMP, 10)
        lamps.append(moved(disc, (at[0] + 0.012 * unit, *at[1:]), turn=np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])))
        lamps.append(box((0.01 * unit, 0.03 * unit, 0.022 * unit), 0.7 * color, at))
    return [board, hatch, *lamps]


def _roof(back: float, break_x: float, roof: float, outer: float, color: Array, unit: float) -> list[VisualMesh]:
    """Hatches, a cupola with a machine gun, the engine's grille, an antenna."""
    at = break_x - 0.3 * (break_x - back)
    ring, low = 0.085 * unit, 0.03 * unit
    cupola = lathe([(ring, 0.0), (ring, low), (0.8 * ring, 1.4 * low), (0.3 * ring, 1.6 * low)], 0.95 * color, 14)
    blocks = [
        moved(box((0.006 * unit, 0.025 * unit, 0.008 * unit), _GLASS), (
            at + ring * math.cos(a), ring * math.sin(a), roof + 0.6 * low), yaw=a)
        for a in 2.0 * math.pi * np.arange(8) / 8.0
    ]  # fmt: skip
    gun = [
        tube([(at + 0.06 * unit, 0.0, roof + 0.075 * unit), (at + 0.28 * unit, 0.0, roof + 0.08 * unit)], 0.006 * unit,
             _BLACK, 6),
        box((0.05 * unit, 0.012 * unit, 0.016 * unit), _DARK, (at + 0.06 * unit, 0.0, roof + 0.075 * unit)),
        box((0.006 * unit, 0.006 * unit, 0.03 * unit), _DARK, (at + 0.07 * unit, 0.0, roof + 0.05 * unit)),
    ]  # fmt: skip
    driver = lathe([(0.055 * unit, 0.0), (0.055 * unit, 0.02 * unit), (0.03 * unit, 0.025 * unit)], color, 12)
    slats = [
        box((0.006 * unit, 0.26 * outer, 0.004 * unit), _BLACK, (break_x - (0.04 + 0.02 * k) * unit, -0.5 * outer,
                                                                 roof + 0.003 * unit))
        for k in range(6)
    ]  # fmt: skip
    cargo = box((0.16 * unit, 0.5 * outer, 0.008 * unit), 1.1 * color, (back + 0.24 * unit, 0.0, roof + 0.006 * unit))
    mast = tube([(back + 0.12 * unit, 0.85 * outer, roof), (back + 0.1 * unit, 0.85 * outer, roof + 0.42 * unit)],
                0.003 * unit, _BLACK, 4)  # fmt: skip
    return [
        moved(cupola, (at, 0.0, roof)), *blocks, *gun, moved(driver, (break_x - 0.08 * unit, 0.5 * outer, roof)),
        *slats, cargo, mast,
    ]  # fmt: skip


def _rear(back: float, floor: float, roof: float, inner: float, color: Array, unit: float) -> list[VisualMesh]:
    """A ramp, and lamps."""
    height = 0.5 * (roof - floor)
    ramp = box((0.01 * unit, 0.85 * inner, 0.8 * height), 1.1 * color, (back - 0.005 * unit, 0.0, floor + 1.1 * height))
    lamps = [
        box((0.008 * unit, 0.02 * unit, 0.012 * unit), tone("c81414"), (back, side * 1.15 * inner, roof - 0.06 * unit))
        for side in (1.0, -1.0)
    ]
    return [ramp, *lamps]
