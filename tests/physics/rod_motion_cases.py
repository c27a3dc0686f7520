"""Rods in motion with known answers: what moves, how it begins, what is measured, how closely, and who says so.

As in `tests.physics.rod_cases`, nothing here is computed with elements, except tables that say so. Velocities are those
of the nodes in the world, (N, 6): of the position [m/s] and the spin [rad/s].
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from tests.physics.rod_cases import (
    STEEL,
    Array,
    Beam,
    End,
    Section,
    Shape,
    Vector,
    round_numbers,
    straight,
)

DENSITY = 7850.0
GRAVITY: Vector = (0.0, 0.0, -9.81)


@dataclasses.dataclass(frozen=True)
class VibrationCase:
    """A mode of small amplitude, begun by its velocities.

    Attributes:
        name: of the case.
        beam: at rest in its rest shape.
        velocities: (N, 6) at the start, of the parts (N,) of the length.
        node: that is observed.
        component: of its velocity, 0 to 5, whose up-crossings are timed.
        frequency: [Hz].
        tolerance: relative.
        step: [s], with a numerical damping of zero.
        periods: to observe.
        source: who says so.
    """

    name: str
    beam: Beam
    velocities: Callable[[Array], Array]
    node: int
    component: int
    frequency: float
    tolerance: float
    step: float
    periods: int
    source: str


def cantilever_mode(root: float) -> Callable[[Array], Array]:
    """Transverse mode of a clamped rod along Z, tip 2 mm/s times its sign, and the spin of its sections."""
    ratio = (math.cosh(root) + math.cos(root)) / (math.sinh(root) + math.sin(root))

    def velocities(s: Array) -> Array:
        x = root * s
        out = np.zeros((len(s), 6))
        out[:, 2] = 1e-3 * (np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x)))
        out[:, 4] = -1e-3 * root * (np.sinh(x) + np.sin(x) - ratio * (np.cosh(x) - np.cos(x)))
        return out

    return velocities


def free_mode(root: float) -> Callable[[Array], Array]:
    """Transverse mode of a free rod of 1 m along Z."""
    ratio = (math.cosh(root) - math.cos(root)) / (math.sinh(root) - math.sin(root))

    def velocities(s: Array) -> Array:
        x = root * s
        out = np.zeros((len(s), 6))
        out[:, 2] = 1e-3 * (np.cosh(x) + np.cos(x) - ratio * (np.sinh(x) + np.sin(x)))
        out[:, 4] = -1e-3 * root * (np.sinh(x) - np.sin(x) - ratio * (np.cosh(x) + np.cos(x)))
        return out

    return velocities


def quarter_wave(component: int) -> Callable[[Array], Array]:
    """Fixed at the start, free at the end: the sine of a quarter."""

    def velocities(s: Array) -> Array:
        out = np.zeros((len(s), 6))
        out[:, component] = 1e-3 * np.sin(0.5 * math.pi * s)
        return out

    return velocities


ROD = round_numbers(0.01)
ROD_AREA, ROD_SECOND = ROD.sizes[0], ROD.sizes[1]
CANTILEVER = Beam(straight(1.0), ROD, STEEL)
SOUND = math.sqrt(STEEL / DENSITY)
SHEAR_SOUND = math.sqrt(STEEL / 2.6 / DENSITY)


def bending_frequency(root: float) -> float:
    """Of `CANTILEVER`'s section and length, Euler and Bernoulli [Hz]."""
    return root**2 / (2.0 * math.pi) * math.sqrt(STEEL * ROD_SECOND / (DENSITY * ROD_AREA))


CANTILEVER_ROOTS = (1.8751041, 4.6940911, 7.8547574)


def vibration_cases() -> list[VibrationCase]:
    """Bending, stretch, torsion."""
    bend = "roots of cos x cosh x = -1 (clamped), 1 (free)"
    free = dataclasses.replace(CANTILEVER, start=End.LOOSE)
    first = [
        VibrationCase(
            f"cantilever, mode {k + 1}",
            CANTILEVER,
            cantilever_mode(root),
            -1,
            2,
            bending_frequency(root),
            (0.003, 0.01, 0.02)[k],
            1e-4,
            5,
            bend,
        )
        for k, root in enumerate(CANTILEVER_ROOTS)
    ]
    wave = "c / 4 L"
    return [
        *first,
        VibrationCase(
            "free, mode 1", free, free_mode(4.7300407), -1, 2, bending_frequency(4.7300407), 0.01, 1e-4, 5, bend
        ),
        VibrationCase("stretch", CANTILEVER, quarter_wave(0), -1, 0, SOUND / 4.0, 0.003, 2e-6, 5, wave),
        VibrationCase("torsion", CANTILEVER, quarter_wave(3), -1, 3, SHEAR_SOUND / 4.0, 0.003, 4e-6, 5, wave),
    ]


def decay(numerical_damping: float, step: float, frequency: float, damping_time: float = 0.0) -> float:
    """Rate at which an amplitude falls [1/s]: zeta h w^2 / 2 + tau w^2 / 2."""
    return 0.5 * (numerical_damping * step + damping_time) * (2.0 * math.pi * frequency) ** 2


DECAYS = ((1.0, 1e-4, 0.0), (0.1, 1e-3, 0.0), (0.02, 1e-3, 0.0), (0.0, 1e-4, 1e-4))
"""Numerical damping, step [s], damping time [s] of cases whose decay is that of `decay` to 3 % (the third: 8 %)."""


# Rotation


@dataclasses.dataclass(frozen=True)
class SpinUp:
    """A flexible arm that is turned about Z: J.C. Simo, L. Vu-Quoc, J. Appl. Mech. 53 (1986) 849.

    Attributes:
        beam: clamped to what turns.
        rate: at the end [rad/s].
        duration: of the speeding up [s].
        extension: of the tip in steady rotation, rho A w^2 L^3 / 3 E A [m].
        deflection: largest displacement of the tip against the rotation, while it speeds up [m]; by the reference's own
            elements.
    """

    beam: Beam
    rate: float = 6.0
    duration: float = 15.0
    extension: float = 1.2 * 36.0 * 1000.0 / (3.0 * 2.8e7)
    deflection: float = 0.577

    def angle(self, t: float) -> float:
        """Prescribed [rad]."""
        end = self.duration
        if t >= end:
            return self.rate * (t - 0.5 * end)
        return (
            self.rate / end * (0.5 * t * t + (end / (2.0 * math.pi)) ** 2 * (math.cos(2.0 * math.pi * t / end) - 1.0))
        )


SPIN_UP = SpinUp(
    Beam(
        straight(10.0, 10),
        Section(Shape.NUMBERS, (0.4, 2e-4, 2e-4, 4e-4, 1.0 / 1.4, 1.0 / 1.4)),
        7e7,
        poisson=0.0,
        density=3.0,
    )
)
"""E A 2.8e7 N, E I 1.4e4 N m^2, k G A 1e7 N, rho A 1.2 kg/m."""


SPINNING = Beam(straight(1.0), ROD, 1e7, density=1000.0, start=End.CLAMP)
"""A soft rod turned about its start: w 10 rad/s stretches it by rho w^2 L^3 / 3 E = 3.33 mm. It begins stretched, as by
`spinning_positions`: one that begins straight sways for long, by Coriolis' force, and its stretch with it.
"""
SPINNING_RATE = 10.0
SPINNING_EXTENSION = math.tan(0.1) / 0.1 - 1.0
"""tan(k) / k - 1 with k^2 = rho w^2 L^2 / E, of which 0.4 % is beyond the linear k^2 / 3 [m]."""


def spinning_positions(s: Array) -> Array:
    """(N, 3) of `SPINNING` in steady rotation, by the parts (N,) of the length: sin(k s) / k cos(k), along X [m]."""
    along = np.sin(0.1 * s) / (0.1 * math.cos(0.1))
    return np.stack([along, 0.0 * s, 0.0 * s], axis=1)


def stretch_bias(numerical_damping: float, step: float, rate: float, damping_time: float = 0.0) -> float:
    """Strain that a step adds in steady rotation, beside the forces: (beta + zeta / 2 + tau / h) (h w)^2."""
    beta = (1.0 - numerical_damping) ** 2 / 4.0
    return (beta + 0.5 * numerical_damping + damping_time / step) * (step * rate) ** 2


FREE_SPIN_RATE = 20.0
"""Of the free steel rod about Z: L_z stays to 1e-6 per turn [rad/s]."""


# Pendulums and mechanisms

PENDULUM = Beam(straight(1.0), round_numbers(0.01), 1e6, density=1000.0, start=End.HINGE)
"""A rubber rod, horizontal at rest at the start; the hinge holds the position alone. Chrono's runs have 10 elements."""
PENDULUM_TIPS = (
    (0.995729, -0.049134),
    (0.945388, -0.196311),
    (0.804792, -0.427657),
    (0.492844, -0.832861),
    (-0.199665, -0.948704),
    (-0.645134, -0.7124),
    (-0.884836, -0.501003),
    (-0.922248, -0.332918),
    (-0.932118, -0.183055),
    (-0.929823, -0.097453),
)
"""Tip (x, z) every 0.1 s, by 160 elements of the reference at 0.1 ms and a numerical damping of 0.1 [m]."""


@dataclasses.dataclass(frozen=True)
class SliderCrank:
    """A crank turned at a fixed rate, a flexible rod, a slider on X: J.P. Meijaard, Multibody Syst. Dyn. 1 (1997).

    At the start the crank points along X and the mechanism moves as if it were rigid.

    Attributes:
        beam: the rod, from the crank pin; hinged at both ends, about Z, the second end on X.
        crank: radius [m].
        rate: [rad/s].
        slider: mass [kg].
    """

    beam: Beam
    crank: float = 0.15
    rate: float = 150.0
    slider: float = 0.033

    def pin(self, t: float) -> Vector:
        """Of the crank [m]."""
        return (self.crank * math.cos(self.rate * t), self.crank * math.sin(self.rate * t), 0.0)

    def rigid_slider(self, t: float) -> float:
        """Where a rigid rod puts the slider [m]."""
        x, y, _ = self.pin(t)
        return x + math.sqrt(self.beam.length**2 - y * y)

    def velocities(self) -> Array:
        """(N, 6) at the start: the rod turns about the slider."""
        points = np.array(self.beam.points)
        parts = 1.0 - (points[:, 0] - points[0, 0]) / self.beam.length
        out = np.zeros((len(points), 6))
        out[:, 1] = self.crank * self.rate * parts
        out[:, 5] = -self.crank * self.rate / self.beam.length
        return out


SLIDER_CRANK_DEFLECTIONS = (
    (0.000793, 0.003605, 0.0044415, 0.0024741, 0.0016034, 0.0019887, 0.0011959, -0.0001952, -2e-05, 0.0009097),
    (
        0.0002652,
        -0.0011669,
        -0.0010273,
        -6.39e-05,
        -0.0007492,
        -0.0027772,
        -0.0036464,
        -0.003111,
        -0.0029487,
        -0.0022729,
    ),
    (0.0002487, 0.0023579, 0.0027853, 0.0033344, 0.0037486, 0.0023806, 0.0005208, 0.0003357, 0.0011774, 0.0008348),
    (
        -0.0004512,
        -0.0006139,
        0.0001437,
        -0.0001626,
        -0.0013679,
        -0.0016947,
        -0.0015884,
        -0.0029618,
        -0.0044512,
        -0.0030794,
    ),
)
"""Middle of the rod off the line of its ends, to the left of pin to slider, every 2 ms: 160 elements at 0.1 ms and a
numerical damping of 0.1 [m]."""


def slider_crank(young: float = 2e11, elements: int = 20) -> SliderCrank:
    """Steel of 6 mm."""
    points = tuple((0.15 + x, y, z) for x, y, z in straight(0.3, elements))
    return SliderCrank(Beam(points, round_numbers(0.003), young, density=7870.0, start=End.HINGE, end=End.GUIDE))


@dataclasses.dataclass(frozen=True)
class CableCase:
    """A thin cable with a body at its end, let go from a small angle.

    Attributes:
        beam: straight, at `angle` from the vertical in the XZ plane, hinged at the top.
        body: point mass at the end [kg].
        angle: [rad].
        period: of the rigid pendulum of the stretched length [s].
    """

    beam: Beam
    body: float
    angle: float
    period: float


def cable_case(body: float) -> CableCase:
    """Steel rope of 2 m and 79 g/m, of E A 1.1e6 N, small E I, in 20 elements: 10 or 100 kg."""
    angle, length, axial, line = 0.05, 2.0, 1.13e6, 0.079
    points = tuple((x * math.sin(angle), 0.0, -x * math.cos(angle)) for x, _, _ in straight(length))
    area = 1e-5
    young = axial / area
    section = Section(Shape.NUMBERS, (area, 1e-12, 1e-12, 2e-12, 0.9, 0.9))
    beam = Beam(points, section, young, density=line / area, up=(0.0, 1.0, 0.0), start=End.HINGE)
    stretched = length * (1.0 + (body + 0.5 * line * length) * 9.81 / axial)
    rope = line * length
    inertia = body * stretched**2 + rope * stretched**2 / 3.0
    period = 2.0 * math.pi * math.sqrt(inertia / ((body + 0.5 * rope) * 9.81 * stretched)) * (1.0 + angle**2 / 16.0)
    return CableCase(beam, body, angle, period)


@dataclasses.dataclass(frozen=True)
class WallCase:
    """A bar flies along X and hits a wall with its far end.

    Attributes:
        beam: free; its far end is `gap` before the wall.
        speed: [m/s].
        gap: [m].
        contact_time: 2 L / c [s], and the bar leaves with its speed.
    """

    beam: Beam
    speed: float
    gap: float
    contact_time: float


WALL = WallCase(dataclasses.replace(CANTILEVER, start=End.LOOSE), 1.0, 1e-5, 2.0 / SOUND)


@dataclasses.dataclass(frozen=True)
class FourBar:
    """Three rods with pins about Z, in the XY plane; the first is turned at a fixed rate.

    Attributes:
        joints: the four pins at the start; the first and the last are on the ground [m].
        rate: of the first rod [rad/s].
        section: of all rods.
        young: [Pa].
    """

    joints: tuple[Vector, Vector, Vector, Vector] = ((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), (0.3, 0.2, 0.0), (0.3, 0.0, 0.0))
    rate: float = 2.0 * math.pi
    section: Section = dataclasses.field(default_factory=lambda: round_numbers(0.005))
    young: float = STEEL

    def coupler_end(self, t: float) -> Vector:
        """The third pin of rigid bars [m]."""
        start, pin, second, last = (np.array(joint)[:2] for joint in self.joints)
        radius = float(np.linalg.norm(pin - start))
        angle = math.atan2(*(pin - start)[::-1]) + self.rate * t
        pin_now = start + radius * np.array([math.cos(angle), math.sin(angle)])
        coupler, rocker = float(np.linalg.norm(second - pin)), float(np.linalg.norm(second - last))
        apart = last - pin_now
        size = float(np.linalg.norm(apart))
        along = (coupler**2 - rocker**2 + size**2) / (2.0 * size)
        unit = apart / size
        end = pin_now + along * unit + math.sqrt(coupler**2 - along**2) * np.array([-unit[1], unit[0]])
        return (float(end[0]), float(end[1]), 0.0)


@dataclasses.dataclass(frozen=True)
class LeafSpring:
    """A flat leaf between a fixed eye and an eye on a shackle, loaded in the middle.

    Attributes:
        beam: along X, hinged about Y at the start; its end hangs on the shackle.
        shackle: point of the frame to which a link of this length goes up from the end [m].
        force: along -Z on the middle node [N].
        sag: of the middle, F L^3 / 48 E I + F L / 4 k G A [m]; small, so that the shackle stays upright.
    """

    beam: Beam
    shackle: Vector
    force: float
    sag: float


def leaf_spring(elements: int = 20) -> LeafSpring:
    """1.2 m, 60 mm wide, 12 mm high."""
    width, height, length, force = 0.06, 0.012, 1.2, 500.0
    section = Section(Shape.RECTANGLE, (width, height))
    beam = Beam(straight(length, elements), section, STEEL, start=End.HINGE)
    sag = force * length**3 / (48.0 * STEEL * width * height**3 / 12.0)
    sag += force * length / (4.0 * 5.0 / 6.0 * width * height * STEEL / 2.6)
    return LeafSpring(beam, (length, 0.0, 0.1), force, sag)


@dataclasses.dataclass(frozen=True)
class Capstan:
    """A rope over a fixed cylinder slides when the pulls differ by e^(mu theta); to 5 %.

    Attributes:
        radius: of the cylinder, whose axis is Y [m].
        friction: Coulomb's.
        wrap: angle theta [rad].
        hold: the smaller pull [N].
    """

    radius: float = 0.1
    friction: float = 0.3
    wrap: float = math.pi
    hold: float = 20.0

    @property
    def pull(self) -> float:
        """At which the rope begins to slide [N]."""
        return self.hold * math.exp(self.friction * self.wrap)


def michell_twist(poisson: float = 0.3) -> float:
    """Twist at which a ring bent from a straight round rod writhes, 2 pi sqrt(3) E I / G J [rad]: J.H. Michell 1889,
    A. Goriely, J. Elasticity 84 (2006) 281.
    """
    return 2.0 * math.pi * math.sqrt(3.0) * (1.0 + poisson)


# Measures


def up_crossings(times: Array, values: Array) -> Array:
    """Times at which values go from below zero to above, between samples by a straight line."""
    at = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    part = -values[at] / (values[at + 1] - values[at])
    return times[at] + part * (times[at + 1] - times[at])


def mean_frequency(times: Array, values: Array) -> float:
    """From the first to the last up-crossing [Hz]."""
    crossings = up_crossings(times, values)
    return float((len(crossings) - 1) / (crossings[-1] - crossings[0]))


def decay_rate(times: Array, values: Array) -> float:
    """Slope of the logarithm of the peaks of both signs [1/s]."""
    size = np.abs(values)
    at = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    before, peak, after = size[at - 1], size[at], size[at + 1]
    peak = peak + (after - before) ** 2 / (8.0 * (2.0 * peak - before - after))  # of the parabola through three samples
    return -float(np.polyfit(times[at], np.log(peak), 1)[0])
