"""Rods with known answers: geometry, section, supports, loads, what is expected, how closely, and who says so.

The module computes nothing with elements. Whatever simulates rods builds a `Beam`, applies the loads and compares: the
float64 reference in `tests/reference` as well as the engine. Node 0 is the first point.
Numbers of literature were computed again by `tests.reference.rod_continuum`, by shooting through the differential
equations of the exact rod (the same model without elements); `tests/physics/test_rod_statics.py` holds that.
"""

from __future__ import annotations

import dataclasses
import enum
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)
FREE = math.nan
"""A coordinate that a case says nothing about."""


class Shape(enum.Enum):
    """Kinds of sections; `Section.sizes` are."""

    ROUND = "round"
    """Radius [m]."""
    TUBE = "tube"
    """Outer and inner radius [m]."""
    RECTANGLE = "rectangle"
    """Width along the section's y and height along its z [m]."""
    NUMBERS = "numbers"
    """Area [m^2], second moments about y and z, torsion constant [m^4], shear factors along y and z."""


@dataclasses.dataclass(frozen=True)
class Section:
    """A section by its shape."""

    shape: Shape
    sizes: tuple[float, ...]


class End(enum.Enum):
    """What holds an end."""

    LOOSE = "loose"
    CLAMP = "clamp"
    HINGE = "hinge"
    """Position alone."""
    GUIDE = "guide"
    """Position across the X axis alone: the end slides along X, and turns."""


@dataclasses.dataclass(frozen=True)
class Beam:
    """One rod, in its rest shape.

    Attributes:
        points: nodes [m]; frames follow the points by the smallest rotation.
        section: across the rod.
        young: [Pa].
        poisson: Poisson's ratio.
        density: [kg/m^3].
        up: direction of the section's z axis at node 0, made perpendicular to the rod.
        start: what holds node 0.
        end: what holds the last node.
    """

    points: tuple[Vector, ...]
    section: Section
    young: float
    poisson: float = 0.3
    density: float = 7850.0
    up: Vector = (0.0, 0.0, 1.0)
    start: End = End.CLAMP
    end: End = End.LOOSE

    @property
    def length(self) -> float:
        """Sum of the segments [m]."""
        return float(np.linalg.norm(np.diff(np.array(self.points), axis=0), axis=1).sum())


@dataclasses.dataclass(frozen=True)
class Load:
    """A force and a moment on a node.

    Attributes:
        force: [N].
        moment: [N m].
        node: negative ones count from the end.
        follows: along the node's own axes, and not the world's.
    """

    force: Vector = ZERO
    moment: Vector = ZERO
    node: int = -1
    follows: bool = False


@dataclasses.dataclass(frozen=True)
class StaticCase:
    """A rod at rest under loads.

    Attributes:
        name: of the case.
        beam: what is loaded.
        loads: on nodes.
        gravity: [m/s^2].
        node: whose position is compared.
        expected: position [m], `FREE` where nothing is said.
        tolerance: of each coordinate [m].
        source: who says so, and what was computed again.
        steps: parts in which the load should grow, for solvers that follow it.
    """

    name: str
    beam: Beam
    expected: Vector
    tolerance: float
    source: str
    loads: tuple[Load, ...] = ()
    gravity: Vector = ZERO
    node: int = -1
    steps: int = 1


def straight(length: float, elements: int = 20) -> tuple[Vector, ...]:
    """Points along X."""
    return tuple((length * k / elements, 0.0, 0.0) for k in range(elements + 1))


def arc(radius: float, angle: float, elements: int = 20) -> tuple[Vector, ...]:
    """Points on a circle in the XY plane that starts along X and bends towards Y."""
    angles = [angle * k / elements for k in range(elements + 1)]
    return tuple((radius * math.sin(a), radius * (1.0 - math.cos(a)), 0.0) for a in angles)


def round_numbers(radius: float) -> Section:
    """A disc as numbers, with the factor 0.9 of shear: what a case expects then depends on no choice of a factor."""
    quarter = math.pi * radius**4 / 4.0
    return Section(Shape.NUMBERS, (math.pi * radius**2, quarter, quarter, 2.0 * quarter, 0.9, 0.9))


def rectangle_numbers(width: float, height: float, torsion: float, shear: float) -> Section:
    """A rectangle as numbers."""
    return Section(
        Shape.NUMBERS, (width * height, width * height**3 / 12.0, height * width**3 / 12.0, torsion, shear, shear)
    )


STEEL = 2.1e11
SMALL_LOADS = "linear theory of Timoshenko; nonlinear terms are below a hundredth of the tolerance"


def _tip_load(name: str, section: Section, second_moment: float, shear_area: float, direction: Vector) -> StaticCase:
    """A force that bends a cantilever of 1 m by about 0.1 mm: P L^3 / 3 E I + P L / k G A."""
    force = 3e-4 * STEEL * second_moment
    rigidity = shear_area * STEEL / 2.6
    bend = force / (3.0 * STEEL * second_moment) + force / rigidity
    expected = tuple(FREE if axis == 0.0 else axis * bend for axis in direction)
    return StaticCase(
        f"tip load, {name}",
        Beam(straight(1.0), section, STEEL),
        (expected[0], expected[1], expected[2]),
        0.002 * bend,
        SMALL_LOADS,
        loads=(Load((force * direction[0], force * direction[1], force * direction[2])),),
    )


def _tip_loads() -> list[StaticCase]:
    disc, ring = math.pi * 0.01**4 / 4.0, math.pi * (0.02**4 - 0.018**4) / 4.0
    ring_area = math.pi * (0.02**2 - 0.018**2)
    deep = rectangle_numbers(0.1, 0.3, 7.9e-5, 5.0 / 6.0)  # 1 m long: shear is 7 % of the deflection along z
    return [
        _tip_load("disc", Section(Shape.ROUND, (0.01,)), disc, 0.9 * math.pi * 0.01**2, (0.0, 0.0, -1.0)),
        _tip_load("tube", Section(Shape.TUBE, (0.02, 0.018)), ring, 0.5 * ring_area, (0.0, 1.0, 0.0)),
        _tip_load("flat, about its strong axis", deep, 0.1 * 0.3**3 / 12.0, 0.03 * 5.0 / 6.0, (0.0, 0.0, 1.0)),
        _tip_load("flat, about its weak axis", deep, 0.3 * 0.1**3 / 12.0, 0.03 * 5.0 / 6.0, (0.0, 1.0, 0.0)),
    ]


def _own_weight() -> StaticCase:
    section = round_numbers(0.01)
    area, second, shear = section.sizes[0], section.sizes[1], 0.9 * section.sizes[0]
    line = 7850.0 * area * 9.81 * 0.01
    sag = line / (8.0 * STEEL * second) + line / (2.0 * shear * STEEL / 2.6)
    return StaticCase(
        "own weight",
        Beam(straight(1.0), section, STEEL),
        (FREE, FREE, -sag),
        0.002 * sag,
        "q L^4 / 8 E I + q L^2 / 2 k G A; a hundredth of the earth's gravity, so that theory is linear",
        gravity=(0.0, 0.0, -0.0981),
    )


def _pull() -> StaticCase:
    section = round_numbers(0.01)
    force = 1e-4 * STEEL * section.sizes[0]
    expected = (1.0001, 0.0, 0.0)
    return StaticCase(
        "pull", Beam(straight(1.0), section, STEEL), expected, 1e-8, "P L / E A", loads=(Load((force, 0, 0)),)
    )


def _roll_up() -> StaticCase:
    """M = 2 pi E I / L bends a rod to a full circle."""
    section = round_numbers(0.01)
    moment = 2.0 * math.pi * STEEL * section.sizes[2] / 2.0
    return StaticCase(
        "roll-up",
        Beam(straight(2.0), section, STEEL),
        (0.0, 0.0, 0.0),
        2e-3,
        "a constant moment bends to a circle: the tip returns to the root (1e-3 of the length)",
        loads=(Load(moment=(0.0, 0.0, moment), follows=True),),
        steps=10,
    )


BEND_LENGTH = 100.0 * math.pi / 4.0
BEND_LITERATURE = {300.0: (58.84, 22.33, 40.08), 600.0: (47.23, 15.79, 53.37)}
"""Tips of the 45 degree bend with eight linear elements, by Simo and Vu-Quoc 1986: one per cent of the length."""


def _bends() -> list[StaticCase]:
    """The 45 degree bend of Bathe and Bolourchi: R 100, section 1 x 1, E 1e7, nu 0, force out of the plane."""
    exact = {300.0: (58.535709, 22.112514, 40.480757), 600.0: (46.891586, 15.557676, 53.607986)}
    return [
        StaticCase(
            f"45 degree bend, {force:.0f}",
            Beam(arc(100.0, math.pi / 4.0), rectangle_numbers(1.0, 1.0, 0.14057701, 5.0 / 6.0), 1e7, poisson=0.0),
            exact[force],
            0.002 * BEND_LENGTH,
            "shooting; K.J. Bathe, S. Bolourchi, IJNME 14 (1979) 961; J.C. Simo, L. Vu-Quoc, CMAME 58 (1986) 79",
            loads=(Load((0.0, 0.0, force)),),
            steps=6,
        )
        for force in (300.0, 600.0)
    ]


def _shear_cantilever() -> StaticCase:
    """A deep cantilever whose tip goes down by a third of its length; shear counts."""
    factor = 10.0 * 1.3 / (12.0 + 11.0 * 0.3)
    return StaticCase(
        "deep cantilever",
        Beam(straight(2.0), rectangle_numbers(0.5, 0.1, 1.4566e-4, factor), 2.07e11),
        (2.0 - 0.150971, 0.710568, 0.0),
        0.002,
        "K. Nachbagauer et al., Multibody Syst. Dyn. 26 (2011) 245, converged; shooting",
        loads=(Load((0.0, 6.25e7, 0.0)),),
        steps=4,
    )


ELASTICA = {
    0.01: (0.999993, -0.003333),
    0.1: (0.999335, -0.033295),
    1.0: (0.943567, -0.301721),
    3.0: (0.745580, -0.603253),
}
"""Tip (x, z) / L of an inextensible cantilever by P L^2 / E I."""


def _elastica() -> list[StaticCase]:
    """A slender square rod: L 1, 0.02 x 0.02, E 2.1e9, dead load along -Z."""
    second = 0.02**4 / 12.0
    return [
        StaticCase(
            f"elastica, {load:g}",
            Beam(straight(1.0), rectangle_numbers(0.02, 0.02, 2.2492e-8, 5.0 / 6.0), 2.1e9, density=1000.0),
            (x, 0.0, z),
            0.0015 * max(1.0, abs(z) / 0.3) if load > 0.5 else 0.003 * abs(z),
            "exact inextensible solution, by shooting",
            loads=(Load((0.0, 0.0, -load * 2.1e9 * second)),),
            steps=4,
        )
        for load, (x, z) in ELASTICA.items()
    ]


PRINCETON_FORCES = (4.448, 8.896, 13.345)
PRINCETON_ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
PRINCETON_EXACT = {
    4.448: (
        (0.507966086, 0.0, -0.005359545),
        (0.50745622, -0.02080109, -0.00521016),
        (0.50608321, -0.0399494, -0.00475107),
        (0.50425311, -0.05605519, -0.00396516),
        (0.50247294, -0.06812912, -0.00286221),
        (0.50119988, -0.0755715, -0.00150299),
        (0.500740054, -0.0780818677, 0.0),
    ),
    8.896: (
        (0.50786442, 0.0, -0.0107154128),
        (0.50575916, -0.04212522, -0.01062577),
        (0.50033918, -0.07945608, -0.01014724),
        (0.49361068, -0.10904157, -0.00888886),
        (0.48752682, -0.12992351, -0.00665436),
        (0.4834161, -0.14221442, -0.00356889),
        (0.481975771, -0.146259984, 0.0),
    ),
    13.345: (
        (0.507695189, 0.0, -0.0160651448),
        (0.50270162, -0.06449631, -0.01650289),
        (0.49083658, -0.11790226, -0.01677799),
        (0.47763889, -0.15658782, -0.01534226),
        (0.46679362, -0.18192119, -0.01171642),
        (0.45992539, -0.19612471, -0.00632844),
        (0.45759432, -0.200692911, 0.0),
    ),
}
"""Tips of the Princeton beam by force and angle, by shooting [m]."""
PRINCETON_ANSYS = {
    8.896: (
        (0.0, 0.04208232124, 0.07939482948, 0.108987937, 0.129887616, 0.14219437, 0.146245978),
        (0.0107141763, 0.01061328706, 0.0101116963, 0.008837226265, 0.006604665004, 0.003538889001, 0.0),
    ),
    13.345: (
        (0.0, 0.06435812858, 0.117735994, 0.156467239, 0.181861627, 0.196097131, 0.200677707),
        (0.01606423724, 0.01645825752, 0.01665873206, 0.0151861844, 0.011578375, 0.006248967384, 0.0),
    ),
}
"""Deflections across and along the flat by beam elements of ANSYS: L. Obrezkov et al., Nonlinear Dyn. 109 (2022)."""


def princeton(force: float, angle: float) -> StaticCase:
    """The Princeton beam: 7075 aluminium, 508 mm, 3.2024 mm x 12.377 mm, the load turned about the rod.

    Args:
        force: one of `PRINCETON_FORCES` [N].
        angle: one of `PRINCETON_ANGLES`, 0 bends about the strong axis [degrees].
    """
    turn = math.radians(angle)
    return StaticCase(
        f"Princeton beam, {force:g} N at {angle:g} degrees",
        Beam(straight(0.508), Section(Shape.RECTANGLE, (3.2024e-3, 12.377e-3)), 71.7e9, poisson=0.31, density=2810.0),
        PRINCETON_EXACT[force][PRINCETON_ANGLES.index(angle)],
        0.01 * float(np.linalg.norm(PRINCETON_EXACT[force][PRINCETON_ANGLES.index(angle)][1:])),
        "shooting; the experiment is E.H. Dowell, J.J. Traybar, AMS report 1194 (1975), whose figures are not here",
        loads=(Load((0.0, -force * math.sin(turn), -force * math.cos(turn))),),
        steps=3,
    )


def princeton_cases() -> list[StaticCase]:
    """All forces and angles."""
    return [princeton(force, angle) for force in PRINCETON_FORCES for angle in PRINCETON_ANGLES]


IMPERFECTION = 1e-4
"""Of the buckling rods: part of the length by which the tip is off the axis."""
BUCKLED = (0.905051457, 0.380392257, 0.0)
"""Tip of a perfect cantilever of 1 m (ROUND, 10 mm, steel) under 1.05 times its critical load, by shooting [m]."""


def buckling_load(young: float = STEEL, radius: float = 0.01) -> float:
    """pi^2 E I / 4 L^2 of a cantilever of 1 m [N]."""
    return math.pi**2 * young * math.pi * radius**4 / 16.0


def _buckling() -> list[StaticCase]:
    """Below the critical load an imperfection grows as 1 / (1 - P / P_c); above it the rod bends over."""
    parts = [k / 20.0 for k in range(21)]
    points = tuple((s, IMPERFECTION * (1.0 - math.cos(0.5 * math.pi * s)), 0.0) for s in parts)
    beam = Beam(points, round_numbers(0.01), STEEL)
    cases = (
        (0.95, (FREE, IMPERFECTION / 0.05, 0.0), 0.05 * IMPERFECTION / 0.05, "amplification 1 / (1 - P / P_c)"),
        (1.05, BUCKLED, 0.01, "shooting without the imperfection"),
    )
    return [
        StaticCase(
            f"buckling, {part:g}",
            beam,
            expected,
            tolerance,
            source,
            loads=(Load((-part * buckling_load(), 0.0, 0.0)),),
            steps=20,
        )
        for part, expected, tolerance, source in cases
    ]


CATENARY_SPAN, CATENARY_LENGTH, CATENARY_RADIUS, CATENARY_YOUNG = 8.0, 10.0, 0.002, 1e9
CATENARY_SAG = 2.654703497
"""Of the elastic catenary, by its equations [m]."""
CATENARY_FORCE = (0.416864386, 0.616380479)
"""Horizontal and vertical part of an end's support [N]; to 1 %."""


def catenary_case(elements: int = 20) -> StaticCase:
    """A rope of 10 m over a span of 8 m, hinged at both ends, built along its inextensible catenary (c of the curve is
    found to rounding), so that its rest shape is curved: that bends so little that the sag moves by 5e-5.
    """
    low, high = 0.1, 100.0
    for _ in range(200):
        c = 0.5 * (low + high)
        if 2.0 * c * math.sinh(0.5 * CATENARY_SPAN / c) > CATENARY_LENGTH:
            low = c
        else:
            high = c
    arcs = [CATENARY_LENGTH * (k / elements - 0.5) for k in range(elements + 1)]
    top = math.hypot(c, 0.5 * CATENARY_LENGTH)
    points = tuple((c * math.asinh(s / c) + 0.5 * CATENARY_SPAN, 0.0, math.hypot(c, s) - top) for s in arcs)
    return StaticCase(
        "catenary",
        Beam(
            points,
            round_numbers(CATENARY_RADIUS),
            CATENARY_YOUNG,
            density=1000.0,
            up=(0.0, 1.0, 0.0),
            start=End.HINGE,
            end=End.HINGE,
        ),
        (0.5 * CATENARY_SPAN, 0.0, -CATENARY_SAG),
        0.005 * CATENARY_SAG,
        "H.M. Irvine, Cable Structures, section 1.5: elastic catenary",
        gravity=(0.0, 0.0, -9.81),
        node=elements // 2,
    )


def static_cases() -> list[StaticCase]:
    """All but the Princeton beam and the catenary."""
    return [
        *_tip_loads(),
        _own_weight(),
        _pull(),
        _roll_up(),
        *_bends(),
        _shear_cantilever(),
        *_elastica(),
        *_buckling(),
    ]
