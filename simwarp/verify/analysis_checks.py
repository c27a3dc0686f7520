"""Statics, linear models and modes against closed forms."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import roots_laguerre

from simwarp import scenes
from simwarp.analysis import modes, solve_static
from simwarp.core.types import WORLD, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.verify.check_result import CheckResult, near

GRAVITY = 9.81
LINKS = 20
STEP = 1e-3


def analysis(device: str = "cpu") -> list[CheckResult]:
    """Statics, linear models and modes of five mechanisms against closed forms.

    Bounds stand with each of them: what float32 leaves of a frequency, and what the tolerance of a static solve leaves.
    """
    return [*pendulum(device), *masses(device), *hanging_chain(device), *catenary(device), *half_car_modes(device)]


def pendulum(device: str = "cpu") -> list[CheckResult]:
    """A pendulum released horizontally comes to hang: angle to the tolerance over ω², frequency √(g/L).

    float32 leaves some 1e-5 of a frequency; 1e-3 of the tolerance of solve_static over ω² = 9.81 is 1e-4 rad.
    """
    sim = Simulation(scenes.pendulum().finalize(4, device), STEP)
    solve_static(sim)
    expected = math.sqrt(GRAVITY) / (2.0 * math.pi)
    return [
        near("analysis", "pendulum: angle at rest [rad]", math.pi / 2.0, float(sim.state.joint_q.numpy()[0, 0]), 1e-4),
        near("analysis", "pendulum: frequency [Hz]", expected, float(modes(sim).frequency[0]), 1e-4 * expected),
    ]


def two_masses(*, mass: float = 2.0, outer: float = 300.0, inner: float = 80.0, damping: float = 4.0) -> ModelBuilder:
    """Two masses on a line, each on a spring and damper to the ground, with a spring between them."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    bodies = [
        builder.add_body(f"mass{k}", mass=mass, inertia=(0.1, 0.1, 0.1), pose=pose((k + 1.0, 0.0, 0.0)))
        for k in range(2)
    ]
    for k, body in enumerate(bodies):
        builder.add_joint_prismatic(
            f"slide{k}", WORLD, body, axis=(1.0, 0.0, 0.0), anchor=(k + 1.0, 0.0, 0.0), stiffness=outer, damping=damping
        )
    builder.add_spring("between", *bodies, anchor0=(1.0, 0.0, 0.0), anchor1=(2.0, 0.0, 0.0), stiffness=inner)
    return builder


def masses(device: str = "cpu") -> list[CheckResult]:
    """Two coupled masses: ω1² = k/m, ω2² = (k + 2 k')/m, both with d/(2 m ω) of critical damping.

    Bounds: float32 leaves 1e-4 of a frequency, and 1e-3 1/s of a decay, which is a rate over a step of 1e-4 s.
    """
    m, k, inner, d = 2.0, 300.0, 80.0, 4.0
    found = modes(Simulation(two_masses().finalize(8, device), STEP))
    still = modes(found.linearisation, damped=False)
    rows = []
    for index, omega in enumerate((math.sqrt(k / m), math.sqrt((k + 2.0 * inner) / m))):
        ratio = d / (2.0 * m * omega)
        hertz = omega / (2.0 * math.pi)
        damped = hertz * math.sqrt(1.0 - ratio**2)
        rows += [
            near(
                "analysis",
                f"masses: frequency {index + 1} without dampers [Hz]",
                hertz,
                still.frequency[index],
                2e-4 * hertz,
            ),
            near("analysis", f"masses: frequency {index + 1} [Hz]", damped, found.frequency[index], 2e-4 * hertz),
            near("analysis", f"masses: decay {index + 1} [1/s]", d / (2.0 * m), found.decay[index], 2e-3),
        ]
    return rows


def chain_of_points(*, links: int = LINKS, length: float = 0.1) -> ModelBuilder:
    """Points on massless rods, hanging one below the other, hinged about +X."""
    builder = ModelBuilder()
    parent = WORLD
    for k in range(links):
        bob = builder.add_body(
            f"bob{k}", mass=1.0, inertia=(1e-7, 1e-7, 1e-7), pose=pose((0.0, 0.0, -(k + 1) * length))
        )
        builder.add_joint_revolute(f"hinge{k}", parent, bob, axis=(1.0, 0.0, 0.0), anchor=(0.0, 0.0, -k * length))
        parent = bob
    return builder


def hanging_chain(device: str = "cpu") -> list[CheckResult]:
    """A chain of 20 points: ω² = g/l times the zeros of the Laguerre polynomial L20; 1e-4 is what float32 leaves."""
    found = modes(Simulation(chain_of_points().finalize(40, device), STEP), damped=False)
    expected = np.sqrt(np.sort(roots_laguerre(LINKS)[0]) * GRAVITY / 0.1) / (2.0 * math.pi)
    return [
        near("analysis", f"chain of 20: frequency {k + 1} [Hz]", expected[k], found.frequency[k], 1e-4 * expected[k])
        for k in (0, 1, 9, LINKS - 1)
    ]


def hung_chain(*, links: int = 40, length: float = 2.0, span: float = 1.5) -> ModelBuilder:
    """Rods between two pins at one height, built as a V."""
    builder = ModelBuilder()
    rod, half = length / links, 0.5 * span
    depth = math.sqrt((0.5 * length) ** 2 - half**2)
    share = np.linspace(-1.0, 1.0, links + 1)
    points = np.stack([half * share, np.zeros(links + 1), depth * (np.abs(share) - 1.0)], axis=1)
    parent = WORLD
    for k, (start, end) in enumerate(itertools.pairwise(points)):
        angle = math.atan2(start[2] - end[2], end[0] - start[0])
        link = builder.add_body(
            f"link{k}", mass=0.1, inertia=(1e-6, 0.1 * rod**2 / 12.0, 0.1 * rod**2 / 12.0),
            pose=pose(tuple(0.5 * (start + end)), (0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle))),
        )  # fmt: skip
        builder.add_joint_revolute(f"hinge{k}", parent, link, axis=(0.0, 1.0, 0.0), anchor=tuple(start))
        parent = link
    builder.add_joint_revolute("end", parent, WORLD, axis=(0.0, 1.0, 0.0), anchor=(half, 0.0, 0.0))
    return builder


def hung_angles(links: int, rod: float, span: float) -> np.ndarray:
    """Slopes of the rods at rest: tan θ_k = (k - (n-1)/2) w/H, with the horizontal force H that closes the span."""
    k = np.arange(links) - 0.5 * (links - 1)
    return np.arctan(k * brentq(lambda share: rod * np.cos(np.arctan(k * share)).sum() - span, 1e-6, 1e3, xtol=1e-14))


def catenary(device: str = "cpu") -> list[CheckResult]:
    """Forty rods hung at both ends: places of all of them, in closed form; 1e-4 m is the tolerance of 1e-3 m/s²."""
    sim = Simulation(hung_chain().finalize(1, device), STEP)
    solve_static(sim)
    angle = hung_angles(40, 0.05, 1.5)
    steps = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = np.cumsum(steps, axis=0) - (0.75, 0.0)
    error = np.abs(sim.state.body_x.numpy()[0][:, [0, 2]] - (ends - 0.5 * steps)).max()
    return [
        near("analysis", "catenary: largest error of a place [m]", 0.0, float(error), 1e-4),
    ]


HALF_CAR = {
    "mass": 2087.0, "inertia": 3750.0, "front": 1.6, "rear": 1.7, "spring_front": 1.1e5, "spring_rear": 1.6e5,
    "axle": 140.0, "tire": 6.0e5,
}  # fmt: skip
"""Numbers of the size of a HMMWV's: sprung mass [kg], pitch inertia [kg·m²], axles from its centre [m], rates of
springs and tires of an axle [N/m], mass of an axle [kg]."""


def half_car() -> ModelBuilder:
    """A chassis that heaves and pitches on two axles, which stand on tires: four coordinates."""
    n = HALF_CAR
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    chassis = builder.add_body("chassis", mass=n["mass"], inertia=(3e3, n["inertia"], 3e3), pose=pose((0.0, 0.0, 1.0)))
    rail = builder.add_massless_body("rail", pose=pose((0.0, 0.0, 1.0)))
    builder.add_joint_prismatic("heave", WORLD, rail, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 1.0))
    builder.add_joint_revolute("pitch", rail, chassis, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 1.0))
    for name, x in (("front", n["front"]), ("rear", -n["rear"])):
        axle = builder.add_body(name, mass=n["axle"], inertia=(1.0, 1.0, 1.0), pose=pose((x, 0.0, 0.4)))
        builder.add_joint_prismatic(
            f"{name}_tire", WORLD, axle, axis=(0.0, 0.0, 1.0), anchor=(x, 0.0, 0.4), stiffness=n["tire"]
        )
        builder.add_spring(
            f"{name}_spring", axle, chassis, anchor0=(x, 0.0, 0.4), anchor1=(x, 0.0, 1.0), stiffness=n[f"spring_{name}"]
        )
    return builder


def half_car_modes(device: str = "cpu") -> list[CheckResult]:
    """Heave, pitch and the hops of two axles: four coordinates; 2e-4 of a frequency is twice what float32 leaves."""
    n = HALF_CAR
    found = modes(Simulation(half_car().finalize(16, device), STEP), damped=False)
    stiffness = np.diag([0.0, 0.0, n["tire"], n["tire"]])
    for k, (rate, arm) in enumerate(((n["spring_front"], -n["front"]), (n["spring_rear"], n["rear"]))):
        length = np.array([1.0, arm, -1.0 if k == 0 else 0.0, -1.0 if k == 1 else 0.0])  # by z, pitch, z of the axles
        stiffness += rate * np.outer(length, length)
    squares = eigh(stiffness, np.diag([n["mass"], n["inertia"], n["axle"], n["axle"]]), eigvals_only=True)
    expected = np.sqrt(squares) / (2.0 * math.pi)
    names = ("heave", "pitch", "hop of one axle", "hop of the other")
    return [
        near("analysis", f"half car: {name} [Hz]", expected[k], found.frequency[k], 2e-4 * expected[k])
        for k, name in enumerate(names)
    ]
