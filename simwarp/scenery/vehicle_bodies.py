"""Bodies of vehicles, in metres above the ground on which they stand, x = 0 in the middle between the axles."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.scenery.solids import Array, box, lathe, loft, moved, tone, tube, turned_about_y

Section = tuple[float, Sequence[tuple[float, float]]]
"""x, and the left half of the outline there from the bottom to the top: (y, z) [m]."""
Paint = dict[str, Array]

_DARK, _BLACK, _GLASS = tone("2b2b2b"), tone("151515"), tone("22303a")
_LAMP, _AMBER, _RED, _STEEL = tone("fdf8e0"), tone("f08a10"), tone("c81414"), tone("a8abae")
_SIDEWAYS: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns z to y."""
_AHEAD: Final = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns z to x."""
WHEEL_STEPS: Final = 14
"""Of the polygon of a wheel."""


def body_shell(sections: Sequence[Section], strips: Sequence[str], paint: Paint) -> VisualMesh:
    """A skin over sections that are symmetric about y = 0, closed at its ends in the colour of "p".

    Args:
        sections: from the rear to the front.
        strips: between two sections: letters of the cells from the bottom of the side to its top, of the top, and of
            the bottom.
        paint: colours of the letters.
    """
    rings = []
    for x, outline in sections:
        left = np.array([(x, y, z) for y, z in outline])
        rings.append(np.concatenate([left, left[::-1] * np.array([1.0, -1.0, 1.0])]))
    cells = []
    for strip in strips:
        side, top, bottom = strip[:-2], strip[-2], strip[-1]
        cells.append([paint[letter] for letter in (*side, top, *side[::-1], bottom)])
    return loft(rings, np.array(cells), caps=np.stack([0.9 * paint["p"]] * 2))


def _hull(x: float, arch: float, shoulder: float, top: float, *, wide: tuple[float, float], inner: float, floor: float,
          front: float = 1.0) -> Section:  # fmt: skip
    """A section of a body: a keel of half width `inner` from the floor up to the arch of the wheels, sides of half
    width `wide[0]` from there to the shoulder, a top of half width `wide[1]`; `front` narrows all.
    """
    w, t = wide[0] * front, wide[1] * front
    keel = min(inner, w - 0.01)
    return x, [(keel, min(floor, arch - 0.01)), (keel, arch), (w, arch), (w, shoulder), (t, top)]


def _disc(at: tuple[float, float, float], radius: float, color: Array, thick: float = 0.03) -> VisualMesh:
    """A round lamp that looks along x."""
    disc = lathe([(radius, -0.5 * thick), (radius, 0.5 * thick)], color, 8)
    return moved(moved(disc, turn=_AHEAD), at)


def _pair(half: tuple[float, float, float], color: Array, at: tuple[float, float, float]) -> list[VisualMesh]:
    """A box on either side."""
    return [box(half, color, (at[0], side * at[1], at[2])) for side in (1.0, -1.0)]


def _hmmwv(main: Array) -> list[VisualMesh]:
    """A wide flat truck with a slanted back, high above the ground."""
    paint = {"p": main, "t": np.minimum(1.08 * main, 1.0), "d": _DARK, "g": _GLASS}

    def hull(x: float, arch: float, shoulder: float, top: float) -> Section:
        return _hull(x, arch, shoulder, top, wide=(1.07, 0.97), inner=0.66, floor=0.45)

    lower = body_shell([
        hull(-2.36, 0.80, 1.10, 1.20), hull(-2.25, 0.72, 1.10, 1.20), hull(-1.98, 1.04, 1.10, 1.20),
        hull(-1.32, 1.04, 1.10, 1.20), hull(-1.05, 0.55, 1.10, 1.20), hull(0.85, 0.55, 1.11, 1.21),
        hull(1.05, 0.55, 1.11, 1.21), hull(1.32, 1.04, 1.10, 1.20), hull(1.98, 1.03, 1.08, 1.16),
        hull(2.24, 0.76, 1.05, 1.12), hull(2.30, 0.76, 1.02, 1.08),
    ], ["ddpptd"] * 10, paint)  # fmt: skip
    cab = [(1.0, 1.15), (0.985, 1.3), (0.87, 1.7), (0.8, 1.83)]
    low = [(1.0, 1.15), (0.985, 1.16), (0.95, 1.18), (0.93, 1.2)]
    upper = body_shell(
        [(-2.34, low), (-1.2, cab), (-1.02, cab), (-0.42, cab), (-0.3, cab), (0.36, cab), (0.46, cab), (0.82, low)],
        ["ppptd", "ppptd", "pgptd", "ppptd", "pgptd", "ppptd", "ppggd"], paint,
    )  # fmt: skip
    slots = [box((0.02, 0.03, 0.13), _BLACK, (2.3, 0.11 * k, 0.94)) for k in range(-3, 4)]
    lamps = [_disc((2.3, side * 0.62, 0.95), 0.1, _LAMP) for side in (1.0, -1.0)]
    return [
        lower, upper, *slots, *lamps,
        *_pair((0.02, 0.06, 0.04), _AMBER, (2.3, 0.88, 0.97)), box((0.07, 0.98, 0.08), _DARK, (2.33, 0.0, 0.66)),
        *_pair((0.02, 0.07, 0.07), _RED, (-2.37, 0.9, 1.0)), box((0.05, 0.95, 0.07), _DARK, (-2.4, 0.0, 0.68)),
        box((0.02, 0.6, 0.13), 0.75 * main, (-2.36, 0.0, 1.0)), box((0.17, 0.02, 0.26), main, (0.64, 0.0, 1.53)),
        *_pair((0.03, 0.1, 0.12), _DARK, (0.62, 1.14, 1.42)), box((0.4, 0.3, 0.03), 0.85 * main, (1.5, 0.0, 1.2)),
        tube([(0.95, -0.98, 1.0), (0.95, -0.98, 1.95), (0.85, -0.98, 2.02)], 0.05, _DARK, 5),
        box((0.5, 0.5, 0.06), _DARK, (1.65, 0.0, 0.45)), box((0.5, 0.5, 0.06), _DARK, (-1.65, 0.0, 0.45)),
        moved(box((0.01, 0.55, 0.24), _GLASS), (-1.79, 0.0, 1.525), turn=_pitch(math.atan2(1.14, 0.63))),
    ]  # fmt: skip


def _pitch(angle: float) -> Array:
    """Turns about y, x towards -z [rad]."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def _gator(main: Array) -> list[VisualMesh]:
    """A small green utility vehicle: a short hood, two yellow seats under a roll cage, an open box behind."""
    paint = {"p": main, "t": np.minimum(1.1 * main, 1.0), "d": _DARK}
    yellow = tone("f2c20a")

    def hull(x: float, arch: float, shoulder: float, top: float, front: float = 1.0) -> Section:
        return _hull(x, arch, shoulder, top, wide=(0.68, 0.55), inner=0.36, floor=0.3, front=front)

    hood = body_shell([
        hull(0.5, 0.4, 0.8, 0.9), hull(0.62, 0.4, 0.82, 0.92), hull(0.74, 0.66, 0.8, 0.9), hull(1.2, 0.66, 0.74, 0.82),
        hull(1.36, 0.42, 0.7, 0.76, 0.92), hull(1.42, 0.42, 0.64, 0.7, 0.85),
    ], ["ddpptd"] * 5, paint)  # fmt: skip
    frame = box((1.3, 0.34, 0.07), _DARK, (-0.05, 0.0, 0.37))
    floor = box((0.55, 0.66, 0.03), _DARK, (-0.02, 0.0, 0.42))
    base = box((0.25, 0.66, 0.1), main, (-0.25, 0.0, 0.55))
    seats = []
    for side in (0.32, -0.32):
        back = moved(box((0.05, 0.26, 0.24), yellow), (-0.47, side, 0.98), turn=_pitch(-0.2))
        seats += [box((0.24, 0.26, 0.06), yellow, (-0.22, side, 0.7)), back]
    bed = [
        box((0.45, 0.7, 0.03), 0.8 * main, (-0.98, 0.0, 0.72)),
        *_pair((0.45, 0.025, 0.14), main, (-0.98, 0.7, 0.86)),
        box((0.025, 0.7, 0.14), main, (-0.55, 0.0, 0.86)), box((0.025, 0.72, 0.14), main, (-1.42, 0.0, 0.86)),
        *_pair((0.02, 0.05, 0.05), _RED, (-1.45, 0.6, 0.86)),
    ]  # fmt: skip
    cage = []
    for side in (0.62, -0.62):
        line = [(0.58, side, 0.85), (0.3, 0.9 * side, 1.72), (-0.5, 0.9 * side, 1.76), (-0.58, side, 0.7)]
        cage.append(tube(line, 0.032, _BLACK, 4))
    cage += [tube([(x, 0.56, z), (x, -0.56, z)], 0.03, _BLACK, 4) for x, z in ((0.3, 1.72), (-0.5, 1.76))]
    roof = box((0.42, 0.58, 0.025), main, (-0.1, 0.0, 1.8))
    rim = turned_about_y([(0.15, -0.015), (0.18, -0.015), (0.18, 0.015), (0.15, 0.015)], _BLACK, 10)
    wheel = moved(moved(rim, turn=_SIDEWAYS), turn=_pitch(-0.5))
    lamps = [_disc((1.42, side * 0.4, 0.6), 0.07, _LAMP) for side in (1.0, -1.0)]
    return [
        hood, frame, floor, base, *seats, *bed, *cage, roof, moved(wheel, (0.25, 0.32, 1.0)),
        tube([(0.25, 0.32, 1.0), (0.52, 0.32, 0.82)], 0.025, _BLACK, 4), *lamps,
        box((0.02, 0.22, 0.08), _BLACK, (1.42, 0.0, 0.58)), box((0.04, 0.5, 0.05), _DARK, (1.44, 0.0, 0.42)),
        *_pair((0.3, 0.1, 0.02), main, (-0.97, 0.66, 0.69)), *_pair((0.24, 0.01, 0.03), yellow, (1.0, 0.665, 0.71)),
    ]  # fmt: skip


def _artcar(main: Array) -> list[VisualMesh]:
    """A radio-controlled buggy: a slim shell between large wheels, a wing behind."""
    paint = {"p": main, "w": tone("f4f4f0"), "d": _DARK, "g": _GLASS}

    def part(x: float, low: float, wide: float, high: float, roof: float) -> Section:
        return x, [(0.8 * wide, low), (wide, 0.5 * (low + high)), (0.9 * wide, high), (roof, high + 0.005)]

    shell = body_shell([
        part(-0.3, 0.09, 0.1, 0.15, 0.05), part(-0.22, 0.065, 0.11, 0.16, 0.05), part(0.1, 0.065, 0.11, 0.155, 0.05),
        part(0.2, 0.065, 0.09, 0.145, 0.04), part(0.32, 0.07, 0.06, 0.12, 0.03), part(0.36, 0.075, 0.045, 0.1, 0.02),
    ], ["dppwd"] * 5, paint)  # fmt: skip
    roof, low = [(0.1, 0.15), (0.07, 0.225), (0.045, 0.235)], [(0.1, 0.15), (0.08, 0.155), (0.045, 0.16)]
    cab = body_shell([(-0.25, low), (-0.12, roof), (-0.02, roof), (0.0, roof), (0.11, low)],
                     ["ppwd", "gpwd", "ppwd", "pggd"], paint)  # fmt: skip
    arms = []
    for x in (0.233, -0.233):
        arms += _pair((0.02, 0.05, 0.005), _DARK, (x, 0.1, 0.075))
        arms += [tube([(x - 0.02, side * 0.03, 0.17), (x - 0.02, side * 0.12, 0.08)], 0.009, tone("d8b020"), 5)
                 for side in (1.0, -1.0)]  # fmt: skip
    wing = [
        moved(box((0.05, 0.15, 0.004), main), (-0.36, 0.0, 0.245), turn=_pitch(-0.2)),
        *_pair((0.055, 0.004, 0.03), paint["w"], (-0.36, 0.15, 0.245)),
        *_pair((0.008, 0.006, 0.06), _DARK, (-0.33, 0.05, 0.19)),
    ]
    return [
        shell, cab, *arms, *wing, box((0.33, 0.08, 0.006), _BLACK, (0.02, 0.0, 0.058)),
        box((0.02, 0.12, 0.012), _DARK, (0.37, 0.0, 0.07)), box((0.02, 0.1, 0.012), _DARK, (-0.36, 0.0, 0.09)),
        *_pair((0.012, 0.02, 0.012), _LAMP, (0.335, 0.03, 0.11)),
        box((0.05, 0.05, 0.04), _DARK, (-0.28, 0.0, 0.1)),
        tube([(-0.2, -0.06, 0.16), (-0.24, -0.06, 0.34)], 0.003, _BLACK, 3),
    ]  # fmt: skip


def _sedan(main: Array) -> list[VisualMesh]:
    """A car with three boxes."""
    paint = {"p": main, "t": np.minimum(1.08 * main, 1.0), "d": _DARK, "g": _GLASS}

    def hull(x: float, arch: float, shoulder: float, top: float, front: float = 1.0) -> Section:
        return _hull(x, arch, shoulder, top, wide=(0.93, 0.78), inner=0.6, floor=0.19, front=front)

    lower = body_shell([
        hull(-2.42, 0.38, 0.72, 0.82, 0.9), hull(-2.36, 0.28, 0.86, 0.98, 0.95), hull(-2.05, 0.26, 0.9, 1.02),
        hull(-1.82, 0.26, 0.9, 1.03), hull(-1.62, 0.71, 0.9, 1.03), hull(-1.16, 0.71, 0.89, 1.02),
        hull(-0.96, 0.26, 0.88, 1.0), hull(0.96, 0.26, 0.86, 0.98), hull(1.16, 0.7, 0.84, 0.95),
        hull(1.62, 0.7, 0.79, 0.88), hull(1.82, 0.26, 0.76, 0.84), hull(2.16, 0.26, 0.7, 0.76, 0.96),
        hull(2.32, 0.28, 0.6, 0.66, 0.9), hull(2.36, 0.32, 0.5, 0.55, 0.86),
    ], ["ddpptd"] * 13, paint)  # fmt: skip
    roof = [(0.86, 0.9), (0.83, 0.98), (0.63, 1.37), (0.55, 1.44)]
    rear = [(0.84, 0.9), (0.82, 0.96), (0.72, 1.01), (0.66, 1.035)]
    front = [(0.84, 0.88), (0.82, 0.92), (0.75, 0.95), (0.7, 0.98)]
    upper = body_shell([
        (-1.8, rear), (-1.0, roof), (-0.86, roof), (-0.2, roof), (-0.08, roof), (0.3, roof), (0.38, roof),
        (1.12, front),
    ], ["ppggd", "ppptd", "pgptd", "ppptd", "pgptd", "ppptd", "pgggd"], paint)  # fmt: skip
    return [
        lower, upper, *_pair((0.08, 0.16, 0.05), _LAMP, (2.25, 0.6, 0.62)),
        *_pair((0.03, 0.15, 0.06), _RED, (-2.38, 0.66, 0.84)), box((0.02, 0.35, 0.06), _BLACK, (2.345, 0.0, 0.52)),
        box((0.03, 0.72, 0.05), _DARK, (2.36, 0.0, 0.36)), box((0.03, 0.74, 0.06), _DARK, (-2.42, 0.0, 0.42)),
        box((0.02, 0.26, 0.06), tone("e8e8e2"), (-2.41, 0.0, 0.66)),
        *_pair((0.06, 0.09, 0.06), main, (0.78, 0.97, 1.0)),
        *_pair((0.09, 0.01, 0.015), _STEEL, (-0.3, 0.93, 0.78)),
        *_pair((0.09, 0.01, 0.015), _STEEL, (0.45, 0.93, 0.78)),
        *_pair((0.006, 0.005, 0.26), 0.35 * main, (-0.15, 0.93, 0.58)),
        *_pair((0.006, 0.005, 0.26), 0.35 * main, (0.85, 0.93, 0.56)),
    ]  # fmt: skip


def _skid_steer(main: Array) -> list[VisualMesh]:
    """A flat robot between four wheels: a painted tub, a black deck with rails, tubes as bumpers, an emergency stop."""
    paint = {"p": main, "t": _DARK, "d": _DARK}

    def tub(x: float, low: float, high: float, wide: float = 1.0) -> Section:
        return x, [(0.15 * wide, low), (0.205 * wide, low + 0.04), (0.205 * wide, 0.27), (0.17 * wide, high)]

    shell = body_shell([
        tub(-0.43, 0.19, 0.3, 0.9), tub(-0.39, 0.14, 0.335), tub(-0.1, 0.13, 0.34), tub(0.1, 0.13, 0.34),
        tub(0.39, 0.14, 0.335), tub(0.43, 0.19, 0.3, 0.9),
    ], ["dpptd"] * 5, paint)  # fmt: skip
    bumpers = []
    for end in (1.0, -1.0):
        line = [(0.41 * end, 0.19, 0.2), (0.475 * end, 0.16, 0.21), (0.475 * end, -0.16, 0.21),
                (0.41 * end, -0.19, 0.2)]  # fmt: skip
        bumpers += [tube(line, 0.018, _BLACK, 6), box((0.006, 0.11, 0.045), _BLACK, (0.432 * end, 0.0, 0.245))]
    rails = [*_pair((0.31, 0.015, 0.015), _STEEL, (0.0, 0.135, 0.372)),
             *[box((0.015, 0.12, 0.012), _STEEL, (x, 0.0, 0.37)) for x in (0.28, -0.28)]]  # fmt: skip
    axles = [*_pair((0.03, 0.025, 0.03), _DARK, (0.256, 0.215, 0.165)),
             *_pair((0.03, 0.025, 0.03), _DARK, (-0.256, 0.215, 0.165))]  # fmt: skip
    stop = lathe([(0.022, 0.0), (0.022, 0.03), (0.028, 0.03), (0.028, 0.045)], _RED, 8)
    return [
        shell, *bumpers, *rails, *axles, box((0.36, 0.165, 0.008), _BLACK, (0.0, 0.0, 0.35)),
        moved(stop, (-0.36, 0.09, 0.352)), *_pair((0.008, 0.02, 0.012), _RED, (-0.433, 0.14, 0.26)),
        *_pair((0.008, 0.02, 0.012), _LAMP, (0.433, 0.14, 0.26)), *_pair((0.2, 0.004, 0.03), _DARK, (0.0, 0.206, 0.24)),
        tube([(-0.3, -0.13, 0.35), (-0.31, -0.13, 0.52)], 0.005, _BLACK, 4),
    ]  # fmt: skip


def _tractor(main: Array) -> list[VisualMesh]:
    """A cab over its engine on a frame, with a fifth wheel."""
    return [
        box((1.1, 1.22, 0.5), main, (2.1, 0.0, 1.2)), box((1.02, 1.2, 0.62), main, (2.08, 0.0, 2.32)),
        box((0.02, 1.06, 0.4), _GLASS, (3.11, 0.0, 2.25)), *_pair((0.4, 0.015, 0.32), _GLASS, (2.55, 1.21, 2.25)),
        box((0.02, 0.85, 0.25), _BLACK, (3.21, 0.0, 1.2)), *_pair((0.03, 0.2, 0.1), _LAMP, (3.2, 0.95, 0.85)),
        box((0.14, 1.2, 0.15), _DARK, (3.1, 0.0, 0.56)), *_pair((0.05, 0.08, 0.24), _BLACK, (3.05, 1.36, 2.2)),
        *_pair((0.04, 0.06, 0.02), _BLACK, (3.05, 1.25, 2.4)), box((0.5, 1.1, 0.2), main, (1.75, 0.0, 3.1)),
        *_pair((2.7, 0.05, 0.13), _DARK, (0.15, 0.4, 0.9)), *_pair((0.55, 0.26, 0.28), _STEEL, (0.15, 0.9, 0.72)),
        *_pair((0.66, 0.34, 0.02), _BLACK, (-1.85, 0.9, 1.12)), *_pair((0.03, 0.2, 0.07), _RED, (-2.55, 0.9, 0.85)),
        box((0.42, 0.45, 0.05), _BLACK, (-1.25, 0.0, 1.09)), box((0.05, 1.1, 0.06), _DARK, (-2.5, 0.0, 0.62)),
    ]  # fmt: skip


def _truck(main: Array) -> list[VisualMesh]:
    """The same with a loaded bed in place of the fifth wheel."""
    bed = np.minimum(1.1 * tone("8d9296"), 1.0)
    return [
        *_tractor(main)[:-2], box((2.1, 1.24, 0.05), bed, (-1.2, 0.0, 1.2)),
        *_pair((2.1, 0.03, 0.4), bed, (-1.2, 1.22, 1.6)), box((0.03, 1.2, 0.5), bed, (0.87, 0.0, 1.7)),
        box((0.03, 1.2, 0.4), bed, (-3.28, 0.0, 1.6)), box((2.0, 1.16, 0.3), tone("7c6a4e"), (-1.2, 0.0, 1.5)),
        *[box((0.03, 0.04, 0.42), _DARK, (x, side * 1.26, 1.6)) for x in (-2.6, -1.2, 0.2) for side in (1.0, -1.0)],
    ]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class BodyStyle:
    """Appearance of a vehicle, and the placement of its visual in its frame of reference.

    Attributes:
        parts: the body in the colour of its paint.
        color: of its paint.
        rim: colour of the rims.
        rim_share: radius of the rims over that of the tires.
        size: length, width without mirrors, and height [m].
        axles: heights of the wheels' middles, front and rear, in its frame of reference when it stands [m].
    """

    parts: Callable[[Array], list[VisualMesh]]
    color: Array
    rim: Array
    rim_share: float
    size: tuple[float, float, float]
    axles: tuple[float, float]


STYLES: Final = {
    # between the full model, whose springs hold it 0.16 m higher, and the reduced one
    "hmmwv": BodyStyle(_hmmwv, tone("b59a6a"), tone("8a7858"), 0.46, (4.85, 2.15, 1.84), (-0.03, -0.05)),
    "gator": BodyStyle(_gator, tone("2f7d32"), tone("f2c20a"), 0.45, (2.95, 1.54, 1.83), (-0.007, 0.0)),
    "artcar": BodyStyle(_artcar, tone("d3261f"), tone("e6e6e6"), 0.62, (0.81, 0.42, 0.26), (-0.037, -0.035)),
    "skid-steer": BodyStyle(_skid_steer, tone("f2c20a"), tone("6a6d70"), 0.5, (0.99, 0.685, 0.4), (0.0, 0.0)),
    "truck-semitrailer": BodyStyle(_tractor, tone("2b4d8f"), tone("c9ccd0"), 0.53, (6.0, 2.5, 3.3), (0.02, 0.02)),
    "truck": BodyStyle(_truck, tone("b3402a"), tone("c9ccd0"), 0.53, (6.5, 2.5, 3.3), (0.02, 0.02)),
    "sedan": BodyStyle(_sedan, tone("2f66b0"), tone("c9ccd0"), 0.7, (4.85, 1.86, 1.46), (0.13, 0.005)),
}
PLAIN_STYLE: Final = BodyStyle(lambda _: [], _DARK, _STEEL, 0.55, (0.0, 0.0, 0.0), (0.0, 0.0))
"""Of a vehicle without a body: its wheels."""


def wheel_mesh(style: BodyStyle, radius: float, width: float) -> VisualMesh:
    """A wheel that spins about y, its middle at the origin, its outer face towards +y.

    Treads and spokes alternate, so that a picture shows how it turns.
    """
    half, rim = 0.5 * width, style.rim_share * radius
    # clockwise with y to the right and the radius upwards: inner side, tread, outer side, seat of the rim
    outline = [(rim, -0.85 * half), (0.86 * radius, -half), (radius, -0.8 * half), (radius, 0.8 * half),
               (0.86 * radius, half), (rim, 0.85 * half)]  # fmt: skip
    odd = (np.arange(WHEEL_STEPS) % 2)[:, None, None]
    rubber = np.broadcast_to(tone("242424"), (WHEEL_STEPS, 6, 3)).copy()
    rubber[:, 1:4] = np.where(odd == 1, tone("161616"), tone("3c3c3c"))
    tire = turned_about_y(outline, rubber, WHEEL_STEPS)
    spoke = np.where((np.arange(WHEEL_STEPS) % 2 == 0)[:, None], style.rim, 0.45 * style.rim)
    profile = [(1.01 * rim, -0.7 * half), (1.01 * rim, 0.6 * half), (0.35 * rim, 0.3 * half), (0.3 * rim, 0.75 * half)]
    plain = np.broadcast_to(style.rim, spoke.shape)
    disc = lathe(profile, np.stack([0.5 * plain, spoke, plain]), WHEEL_STEPS)
    return joined([tire, moved(disc, turn=_SIDEWAYS)])
