"""Contacts against known answers: friction, rolling, impacts, stacks and piles (docs/theory.md)."""

from __future__ import annotations

import math

import numpy as np

from simwarp import scenes
from simwarp.core.types import WORLD, Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import SolverOptions
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.probe import Probe

G = 9.81
TOUCHING = 1e-3
"""Velocity below which something counts as at rest [m/s]."""


def _penetration(probe: Probe) -> float:
    return float(probe.sim.contacts.penetration.numpy()[0])


def _box_on_plane(half: tuple[float, float, float], mass: float, friction: float, speed: float = 0.0) -> ModelBuilder:
    """A box at rest on level ground, or sliding along X."""
    builder = ModelBuilder()
    material = Material(friction=friction)
    builder.add_shape_plane(WORLD, material=material)
    x, y, z = (2.0 * h for h in half)
    inertia = (mass * (y * y + z * z) / 12.0, mass * (x * x + z * z) / 12.0, mass * (x * x + y * y) / 12.0)
    box = builder.add_body(
        "box", mass=mass, inertia=inertia, pose=pose((0.0, 0.0, half[2])), velocity=(speed, 0.0, 0.0)
    )
    builder.add_shape_box(box, half=half, material=material)
    return builder


def incline(device: str = "cpu") -> list[CheckResult]:
    """A box on a tilted plane over a grid of friction and angle: it sticks below atan(mu), else it slides.

    Sliding for 1 s at 1 ms covers a t²/2 and, as steps add velocity first, a h t/2 more, plus what the first step needs
    to build the impulse up: 2e-3 of the distance. Sticking means that it creeps by less than the solver's tolerance
    (1e-6 m/s) for a second. Exact Coulomb does not lift off: the gap stays below 1e-5 m, rounding of the narrow phase
    and the same tolerance.
    """
    rows = []
    for friction in (0.2, 0.5, 0.9):
        for share in (0.5, 0.95, 1.05, 1.5):
            angle = math.atan(friction * share)
            probe = Probe(scenes.incline(angle=angle, friction=friction), 1e-3, device)
            start = probe.x[0]
            probe.run(1.0)
            moved = probe.x[0] - start
            along = float(moved @ np.array([math.cos(angle), 0.0, -math.sin(angle)]))
            away = float(moved @ np.array([math.sin(angle), 0.0, math.cos(angle)]))
            acceleration = max(0.0, G * (math.sin(angle) - friction * math.cos(angle)))
            name = f"mu {friction}, {math.degrees(angle):.1f} deg"
            expected = 0.5 * acceleration * 1.001
            rows.append(near("incline", f"{name}: distance in 1 s [m]", expected, along, 2e-3 * expected + 2e-6))
            rows.append(below("incline", f"{name}: lift [m]", away, 1e-5))
    return rows


def rolling_ball(device: str = "cpu") -> list[CheckResult]:
    """A ball of 0.2 m radius slides onto the ground with 2 m/s, friction 0.3: it rolls after 2 v0 / (7 mu g) at 5/7 v0.

    The time is found to a step of 1 ms; the speed follows from angular momentum about the contact alone, to rounding.
    """
    radius, speed, friction = 0.2, 2.0, 0.3
    builder = ModelBuilder()
    material = Material(friction=friction)
    builder.add_shape_plane(WORLD, material=material)
    ball = builder.add_body(
        "ball", mass=1.0, inertia=(0.4 * radius**2,) * 3, pose=pose((0.0, 0.0, radius)), velocity=(speed, 0.0, 0.0)
    )
    builder.add_shape_sphere(ball, radius=radius, material=material)
    probe = Probe(builder, 1e-3, device)
    rolling = float("nan")
    for step in range(1000):
        probe.step()
        if math.isnan(rolling) and abs(probe.v[0, 0] - radius * probe.omega[0, 1]) < TOUCHING:
            rolling = (step + 1) * 1e-3
    return [
        near("rolling-ball", "time until it rolls [s]", 2.0 * speed / (7.0 * friction * G), rolling, 1.001e-3),
        near("rolling-ball", "speed then [m/s]", 5.0 / 7.0 * speed, probe.v[0, 0], 1e-4),
        near("rolling-ball", "spin then [rad/s]", 5.0 / 7.0 * speed / radius, probe.omega[0, 1], 5e-4),
        near("rolling-ball", "height of the centre [m]", radius, probe.x[0, 2], 1e-6),
    ]


def rolling_box(device: str = "cpu") -> list[CheckResult]:
    """A 10 kg box under 25 balls is pushed with 150 N: it slides, they roll. Accelerations after 0.5 s at 1 ms.

    Hwangbo et al., SimBenchmark. Friction and rolling act from the first step, so that speed / time is the
    acceleration; 0.5 % covers the first steps, in which the balls start.
    """
    probe = Probe(scenes.rolling_box(), 1e-3, device)
    force = np.zeros((1, 26, 3), np.float32)
    force[0, 0] = 150.0 * np.array([0.5, math.sqrt(0.75), 0.0])
    probe.sim.control.body_force.assign(force)
    probe.run(0.5)
    speeds = np.linalg.norm(probe.v[:, :2], axis=1) / 0.5
    return [
        near("rolling-box", "acceleration of the box [m/s²]", 0.7385, speeds[0], 0.005 * 0.7385),
        near("rolling-box", "acceleration of the balls, mean [m/s²]", 0.2110, speeds[1:].mean(), 0.005 * 0.2110),
        below("rolling-box", "spread of the balls' acceleration [m/s²]", float(np.ptp(speeds[1:])), 0.01 * 0.211),
    ]


def heavy_on_light(device: str = "cpu") -> list[CheckResult]:
    """A cube on a cube of 1 kg, up to 1000 times as heavy, 0.6 s at 5 ms: the ground gives less than 0.1 mm."""
    rows = []
    for ratio in (1.0, 100.0, 1000.0):
        probe = Probe(scenes.heavy_on_light(ratio=ratio), 5e-3, device)
        probe.run(0.6)
        sunk = 0.25 - float(probe.x[0, 2])
        rows.append(below("heavy-on-light", f"ratio {ratio:g}: the lower cube has sunk [m]", sunk, 1e-4))
        rows.append(below("heavy-on-light", f"ratio {ratio:g}: deepest penetration [m]", _penetration(probe), 1e-4))
    return rows


def stopping(device: str = "cpu") -> list[CheckResult]:
    """A box slides with 2 m/s on friction 0.5 and stops after 0.4027 m at 5 ms.

    v²/(2 mu g) less mu g h²/2 per step: velocity first. The last step is a part of one: mu g h² of distance, 1.2e-4 m.
    """
    probe = Probe(_box_on_plane((0.25, 0.25, 0.05), 1.0, 0.5, speed=2.0), 5e-3, device)
    probe.run(1.0)
    return [
        near("stopping", "distance [m]", 0.4027, probe.x[0, 0], 1.2e-4),
        below("stopping", "speed afterwards [m/s]", float(np.linalg.norm(probe.v[0])), 1e-5),
        below("stopping", "height [m]", float(probe.x[0, 2]) - 0.05, 1e-5),
    ]


def _stands(
    name: str, builder: ModelBuilder, dt: float, duration: float, bound: float, device: str
) -> list[CheckResult]:
    probe = Probe(builder, dt, device)
    start = probe.x
    worst = 0.0
    for _ in range(10):
        probe.run(0.1 * duration)
        worst = max(worst, float(np.linalg.norm(probe.x - start, axis=1).max()))
    return [
        below(name, f"largest motion in {duration:g} s [m]", worst, bound),
        below(name, "deepest penetration [m]", _penetration(probe), 1e-4),
    ]


def stack(device: str = "cpu") -> list[CheckResult]:
    """Ten cubes on top of each other stand for 60 s at 5 ms: they drift by less than 1 mm.

    What the solver leaves, 1e-5 m/s, comes back as a gap of the next step and is taken out there.
    """
    return _stands("stack", scenes.stack(), 5e-3, 60.0, 1e-3, device)


BEST_PENETRATION = {0.01: 4.2e-7, 1.0 / 240.0: 9.0e-7, 0.001: 4.2e-7}
"""[m] deepest at the end of `cube_stack`, by step [s]: the best solver of Project Chrono 10 on it."""


def cube_stack(device: str = "cpu") -> list[CheckResult]:
    """Ten cubes of 1 m and 1 kg, 2 s at three steps: no deeper than the best run of an independent engine.

    Gaps follow the velocities that the solver leaves, 1e-6 m/s here times the step, and the rounding of the narrow
    phase, 6e-8 m at 1 m.
    """
    rows = []
    for dt, bound in BEST_PENETRATION.items():
        options = SolverOptions(tolerance=1e-6)
        probe = Probe(scenes.stack(half=0.5), dt, device, solver=options)
        probe.run(2.0)
        rows.append(below("cube-stack", f"dt {1e3 * dt:.3g} ms: deepest penetration [m]", _penetration(probe), bound))
        sunk = 9.5 - float(probe.x[9, 2])
        rows.append(below("cube-stack", f"dt {1e3 * dt:.3g} ms: the top has sunk [m]", sunk, bound))
    return rows


def wall(device: str = "cpu") -> list[CheckResult]:
    """A wall of twenty bricks stands for 60 s at 5 ms and drifts by less than 1 mm, for the reason at `stack`."""
    return _stands("wall", scenes.wall(), 5e-3, 60.0, 1e-3, device)


def card_house(device: str = "cpu") -> list[CheckResult]:
    """Three levels of leaning cards stand for 10 s at 2 ms, held by friction alone: nothing moves by 5 mm."""
    return _stands("card-house", scenes.card_house(), 2e-3, 10.0, 5e-3, device)


def arch(device: str = "cpu") -> list[CheckResult]:
    """Fifteen wedges hold each other for 10 s at 2 ms: their faces carry the thrust, and nothing moves by 5 mm."""
    return _stands("arch", scenes.arch(), 2e-3, 10.0, 5e-3, device)


def bouncing(device: str = "cpu") -> list[CheckResult]:
    """49 balls bounce for 20 s at 1 ms with restitution 1, E0 = 24 034.5 J.

    A step of flight, which moves with the new velocity, loses m g² h²/2, together the law m g² h T / 2. An impact
    reverses the velocity of the step's start and then moves with it, which gives m g h v back: over a flight of
    2 v / g as much as was lost. What is left over is held to 5 % of the law.
    """
    dt, duration = 1e-3, 20.0
    probe = Probe(scenes.bouncing_balls(), dt, device)
    start = probe.energy()
    squares = 0.0
    for _ in range(200):
        probe.run(0.1)
        squares += (probe.energy() - start) ** 2 / 200.0
    law = 49 * 10.0 * G**2 * dt * duration / 2.0
    return [
        below("bouncing", "energy lost [J]", start - probe.energy(), 0.05 * law),
        below("bouncing", "root mean square error of the energy [J]", math.sqrt(squares), 0.05 * law),
    ]


def three_balls(device: str = "cpu") -> list[CheckResult]:
    """A ball hits two that touch, all in line, restitution 1: Newton's law at both contacts gives (-1/3, 2/3, 2/3).

    The bound is ten times the solver's tolerance here.
    """
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    material = Material(friction=0.3, restitution=1.0)
    for index, x in enumerate((-0.25, 0.0, 0.2)):
        ball = builder.add_body(
            f"ball{index}", mass=1.0, inertia=(0.004,) * 3, pose=pose((x, 0.0, 0.0)),
            velocity=(1.0 if index == 0 else 0.0, 0.0, 0.0),
        )  # fmt: skip
        builder.add_shape_sphere(ball, radius=0.1, material=material)
    probe = Probe(builder, 1e-3, device, solver=SolverOptions(tolerance=1e-6))
    probe.run(0.1)
    return [
        near("three-balls", f"speed of ball {index} [m/s]", expected, probe.v[index, 0], 1e-5)
        for index, expected in enumerate((-1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0))
    ]


def pile(device: str = "cpu") -> list[CheckResult]:
    """216 balls of 10 kg fall in a block, without friction or restitution, 10 s at 1 ms: the mean over time of the sum
    of squared penetrations. Published: RaiSim 1.35e-4, ODE 1.55e-4, Bullet 0.38, MuJoCo 0.095 m².
    """
    probe = Probe(scenes.pile(), 1e-3, device)
    mean = 0.0
    samples = 1000
    for _ in range(samples):
        probe.step(10)
        count = int(probe.sim.contacts.contact_count.numpy()[0])
        gaps = probe.sim.contacts.contact_gap.numpy()[0, :count].astype(float)
        mean += float(np.sum(np.minimum(gaps, 0.0) ** 2)) / samples
    overflow = int(probe.sim.contacts.contact_overflow.numpy()[0])
    return [
        below("pile", "mean sum of squared penetrations [m²]", mean, 1.3e-4),
        below("pile", "contacts left out", overflow, 0.0),
    ]


def smooth(device: str = "cpu") -> list[CheckResult]:
    """A ball of 1 kg on the ground in the smooth model, E 2e6 Pa, at 0.1 ms: it sinks in by Hertz' depth, and bounces
    with its restitution; a box of the same model sticks on a slope below the friction angle.

    Depth (3 m g / (4 E* sqrt(R)))^(2/3) at rest to 1 %, which the last oscillation leaves. Tsuji's damping gives the
    restitution up to some hundredths, since force must not pull at the end of an impact.
    """
    rows = []
    for restitution, height in ((0.1, 0.1), (0.7, 0.6)):
        material = Material(friction=0.5, restitution=restitution, young_modulus=2e6, poisson_ratio=0.3)
        builder = ModelBuilder()
        builder.add_shape_plane(WORLD, material=material)
        builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=pose((0.0, 0.0, height)), material=material)
        probe = Probe(builder, 1e-4, device, solver=SolverOptions(contact_model="smooth"))
        if height > 0.1:
            impact = math.sqrt(2.0 * G * (height - 0.1))
            speeds = []
            for _ in range(5000):
                probe.step()
                speeds.append(float(probe.v[0, 2]))
            rows.append(near("smooth", "restitution 0.7", restitution, max(speeds) / impact, 0.05))
        else:
            probe.run(2.0)
            modulus = 1.0 / (2.0 * (1.0 - 0.3**2) / 2e6)
            depth = (3.0 * G / (4.0 * modulus * math.sqrt(0.1))) ** (2.0 / 3.0)
            rows.append(near("smooth", "depth at rest [m]", depth, 0.1 - float(probe.x[0, 2]), 0.01 * depth))
    builder = scenes.incline(angle=math.atan(0.5 * 0.8), friction=0.5)
    probe = Probe(builder, 1e-4, device, solver=SolverOptions(contact_model="smooth"))
    probe.run(0.5)
    start = probe.x
    probe.run(0.5)
    rows.append(below("smooth", "creep on a slope in 0.5 s [m]", float(np.linalg.norm(probe.x - start)), 1e-4))
    return rows


def convex_law(device: str = "cpu") -> list[CheckResult]:
    """The convex relaxation makes what slides hover: a gap of mu |v| h, 0.5 · 6.94 m/s · 1 ms after 1 s at 45 degrees.

    The speed at the end is a t; 2 % for the growth of the gap lagging by a step.
    """
    angle = math.radians(45.0)
    options = SolverOptions(friction_law="convex")
    probe = Probe(scenes.incline(angle=angle, friction=0.5), 1e-3, device, solver=options)
    start = probe.x[0]
    probe.run(2.0)
    lift = float((probe.x[0] - start) @ np.array([math.sin(angle), 0.0, math.cos(angle)]))
    expected = 0.5 * G * (math.sin(angle) - 0.5 * math.cos(angle)) * 2.0 * 1e-3
    return [near("convex-law", "gap after 2 s [m]", expected, lift, 0.02 * expected)]
