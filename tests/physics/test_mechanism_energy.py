"""Passive mechanisms of joints never gain energy under the default options, and lose little of it."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.model.builder import ModelBuilder
from tests.reference.planar_chain import PlanarChain

GRAVITY = 9.81
LARGEST_GAIN = 0.01
"""Of the energy above the least that can be reached. Nothing seen is above 1e-3 of it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Chain:
    """A random chain of rods: how many, how long [m], whether its far end is held and whether it stays in a plane."""

    seed: int
    links: int
    length: float
    closed: bool
    planar: bool

    def builder(self) -> ModelBuilder:
        """At rest, bent at random; hinges in the plane, else hinges about random axes, ball and universal joints."""
        rng = np.random.default_rng(self.seed)
        builder = ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
        points, along = [np.zeros(3)], np.array([1.0, 0.0, 0.0])
        for _ in range(self.links):
            turn = 0.5 * rng.normal(size=3)
            if self.planar:
                turn[1] = 0.0
            along = (along + turn) / np.linalg.norm(along + turn)
            points.append(points[-1] + self.length * along)
        parent = sw.WORLD
        for k, (start, end) in enumerate(itertools.pairwise(points)):
            mass = float(np.exp(rng.uniform(np.log(0.05), np.log(0.5))))
            x = (end - start) / self.length
            inertia = mass * self.length**2 / 12.0 * (np.eye(3) - 0.9 * np.outer(x, x))
            rod = builder.add_body(f"rod{k}", mass=mass, inertia=inertia, pose=sw.pose(0.5 * (start + end)))
            self._add_joint(builder, rng, f"joint{k}", parent, rod, start)
            parent = rod
        if self.closed and self.planar:
            builder.add_joint_revolute("end", parent, sw.WORLD, axis=(0.0, 1.0, 0.0), anchor=points[-1])
        elif self.closed:
            builder.add_joint_spherical("end", parent, sw.WORLD, anchor=points[-1])
        return builder

    def _add_joint(
        self, builder: ModelBuilder, rng: np.random.Generator, name: str, parent: int, rod: int, anchor: np.ndarray
    ) -> None:
        axis = rng.normal(size=3)
        other = np.cross(axis, rng.normal(size=3))
        kind = 0 if self.planar else int(rng.integers(3))
        if kind == 0:
            axis = np.array([0.0, 1.0, 0.0]) if self.planar else axis
            builder.add_joint_revolute(name, parent, rod, axis=axis, anchor=anchor)
        elif kind == 1:
            builder.add_joint_spherical(name, parent, rod, anchor=anchor)
        else:
            builder.add_joint_universal(name, parent, rod, anchor=anchor, axis0=axis, axis1=other)


def random_chain(seed: int) -> Chain:
    """Everything follows from the seed: 4 to 60 links of 5 cm to half a metre."""
    rng = np.random.default_rng(1000 + seed)
    return Chain(
        seed=seed, links=int(rng.integers(4, 61)), length=float(np.exp(rng.uniform(np.log(0.05), np.log(0.5)))),
        closed=bool(rng.integers(2)), planar=bool(rng.integers(2)),
    )  # fmt: skip


def pinned_chain(*, links: int = 50, length: float = 0.1, mass: float = 0.1, sag: float = 0.9) -> ModelBuilder:
    """A chain of hinges between two points `sag` of its length apart, released from a V."""
    half = links // 2
    down = np.array([sag, 0.0, -np.sqrt(1.0 - sag**2)])
    up = down * (1.0, 1.0, -1.0)
    points = [np.zeros(3)]
    for k in range(links):
        points.append(points[-1] + length * (down if k < half else up))
    builder, parent = ModelBuilder(gravity=(0.0, 0.0, -GRAVITY)), sw.WORLD
    for k, (start, end) in enumerate(itertools.pairwise(points)):
        x = (end - start) / length
        inertia = mass * length**2 / 12.0 * (np.eye(3) - 0.9 * np.outer(x, x))
        rod = builder.add_body(f"rod{k}", mass=mass, inertia=inertia, pose=sw.pose(0.5 * (start + end)))
        builder.add_joint_revolute(f"hinge{k}", parent, rod, axis=(0.0, 1.0, 0.0), anchor=start)
        parent = rod
    builder.add_joint_revolute("end", parent, sw.WORLD, axis=(0.0, 1.0, 0.0), anchor=points[-1])
    return builder


def energy(simulation: sw.Simulation, mass: np.ndarray) -> float:
    """Energy [J] at one instant: the velocities of a state are those of the middle of a step, half a step before its
    poses, which is h m g v / 2 of the weights' energy.
    """
    rising = float(np.sum(mass * simulation.state.body_v.numpy()[0, :, 2]))
    return float(simulation.measure_energy().numpy()[0]) - 0.5 * simulation.dt * GRAVITY * rising


def least_energy(builder: ModelBuilder) -> float:
    """Energy [J] of the mechanism after its motion was taken away often enough for it to settle."""
    simulation = sw.Simulation(builder.finalize(1, "cpu"), 2e-3)
    state = simulation.state
    for _ in range(1200):
        simulation.step(10)
        state.body_v.assign(0.9 * state.body_v.numpy())
        state.body_omega.assign(0.9 * state.body_omega.numpy())
    return float(simulation.measure_energy().numpy()[0])


def largest_gain(builder: ModelBuilder, dt: float, seconds: float) -> tuple[float, float]:
    """Most that the energy rises above its start, and what it has lost in the end [J]."""
    simulation = sw.Simulation(builder.finalize(1, "cpu"), dt)
    mass = np.array([body.mass for body in builder.bodies])
    start = float(simulation.measure_energy().numpy()[0])
    steps, now, gain = round(0.05 / dt), start, 0.0
    for _ in range(round(seconds / (steps * dt))):
        simulation.step(steps)
        now = energy(simulation, mass)
        gain = max(gain, now - start)
    assert not np.isnan(now)
    return gain, start - now


@pytest.mark.parametrize(
    ("seed", "dt"),
    [
        (3, 4e-3), (4, 2e-3),
        *(pytest.param(seed, dt, marks=pytest.mark.slow) for seed in range(24) for dt in (5e-4, 1e-3, 2e-3, 4e-3)),
    ],
)  # fmt: skip
def test_random_chains_gain_nothing(seed: int, dt: float, request: pytest.FixtureRequest) -> None:
    builder = random_chain(seed).builder()
    slow = request.node.get_closest_marker("slow") is not None
    gain, _ = largest_gain(builder, dt, 60.0 if slow else 10.0)
    above = float(sw.Simulation(builder.finalize(1, "cpu"), dt).measure_energy().numpy()[0]) - least_energy(builder)
    assert gain <= LARGEST_GAIN * above, f"{random_chain(seed)}: gains {gain:.4g} J of {above:.4g} J"


@pytest.mark.parametrize(("dt", "seconds"), [(2e-3, 12.0), pytest.param(1e-3, 60.0, marks=pytest.mark.slow)])
def test_a_chain_pinned_at_both_ends_gains_nothing(dt: float, seconds: float) -> None:
    builder = pinned_chain()
    start = float(sw.Simulation(builder.finalize(1, "cpu"), dt).measure_energy().numpy()[0])
    gain, _ = largest_gain(builder, dt, seconds)
    assert gain <= LARGEST_GAIN * (start - least_energy(builder))


def chain_drift(share: float, passes: int, dt: float) -> float:
    """Change of the energy [J] of a chain of ten rods in its first second, float64."""
    chain = PlanarChain(0.2, 0.5, False, np.linspace(0.0, 0.8, 10), share, passes)
    start = chain.energy(dt)
    for _ in range(round(1.0 / dt)):
        chain.step(dt)
    return chain.energy(dt) - start


def test_a_third_of_the_curvature_keeps_the_energy() -> None:
    """With the share s of a step's curvature, joints do the work of (3 s - 1) or (2 s - 1) times a positive number,
    according to what changes the curvature, velocities or poses. A third is the largest share that never gains.
    """
    dt = 1e-3
    none, third, whole = (chain_drift(share, 0, dt) for share in (0.0, 1.0 / 3.0, 1.0))
    assert none < 0.0
    # the next order is a share of h w, here some 10 rad/s, and of its number of links
    assert -0.1 <= third / none <= 1.0 / 3.0 + 0.1
    assert 1.0 - 0.1 <= -whole / none <= 2.0 + 0.1
    assert chain_drift(0.0, 1, dt) > 0.0  # one pass of projection from a start without it
    order = np.log2(none / chain_drift(0.0, 0, 0.5 * dt))
    assert order == pytest.approx(3.0, abs=0.35)  # 2.8; between halves of that, 2.7


@pytest.mark.parametrize("speed", [50.0, 200.0])
def test_a_fast_body_stays_on_its_hinge(speed: float) -> None:
    """A mass at 0.1 m, free to turn: its hinge must give what bends its path, whatever corrections are limited to. At
    200 rad/s that is h/2 w² r = 2 m/s, more than `max_depenetration_velocity`.
    """
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    radius, dt = 0.1, 1e-3
    body = builder.add_body(
        "mass", mass=1.0, inertia=(0.001, 0.001, 0.001), pose=sw.pose((radius, 0.0, 0.0)), omega=(0.0, 0.0, speed),
        velocity=(0.0, radius * speed, 0.0),
    )  # fmt: skip
    builder.add_joint_revolute("hinge", sw.WORLD, body, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 0.0))
    simulation = sw.Simulation(builder.finalize(1, "cpu"), dt)
    simulation.step(1000)
    distance = float(np.linalg.norm(simulation.state.body_x.numpy()[0, 0]))
    turning = float(simulation.state.body_omega.numpy()[0, 0, 2])
    assert 0.8 * speed < turning < speed  # 17 % are lost at 0.2 rad in a step, 0.2 % at 0.05
    # two thirds of h²/2 w² r are left, and a share of (h w)² more
    assert distance - radius == pytest.approx(dt**2 * turning**2 * radius / 3.0, rel=0.1)


def test_normal_modes_of_a_double_pendulum_keep_their_frequencies() -> None:
    """Two rods of 1 m: M q'' = -K q about the vertical, both modes at once, small."""
    mass_matrix = np.array([[4.0 / 3.0, 0.5], [0.5, 1.0 / 3.0]])
    stiffness = np.diag([1.5 * GRAVITY, 0.5 * GRAVITY])
    wanted = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass_matrix, stiffness)).real)
    builder = scenes.double_pendulum()
    dt, count = 1e-3, 60_000
    simulation = sw.Simulation(builder.finalize(1, "cpu"), dt)
    q = np.array([[0.5 * np.pi + 0.01, 0.005]])
    simulation.set_joint_state(np.array([True]), q, np.zeros((1, 2)))
    angles = np.empty(count // 10)
    for k in range(len(angles)):
        simulation.step(10)
        angles[k] = simulation.state.joint_q.numpy()[0, 0] - 0.5 * np.pi
    spectrum = np.abs(np.fft.rfft(angles * np.hanning(len(angles)), 64 * len(angles)))
    frequency = 2.0 * np.pi * np.fft.rfftfreq(64 * len(angles), 10 * dt)
    for w in wanted:
        near = np.abs(frequency - w) < 0.1 * w
        found = frequency[near][np.argmax(spectrum[near])]
        assert found == pytest.approx(w, rel=1e-3)  # semi-implicit steps: 1 + (h w)²/24, and amplitudes of 1e-4 rad²


@pytest.mark.parametrize(
    ("scene", "most"),
    [("four_bar", 0.11), ("double_pendulum", 0.033), ("linkage", 0.18)],
)
def test_mechanisms_lose_little(scene: str, most: float) -> None:
    """What ten seconds of 1 ms may lose [J]; the energies are 22 J, 0 J (19.6 J above the least) and 125 kJ.

    Bounds: a tenth more than a step with one pass of position projection loses (four-bar 0.1 J, linkage 0.16 J from
    its second on), and than C/h alone does in trees.
    """
    builder = getattr(scenes, scene)()
    simulation = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    mass = np.array([body.mass for body in builder.bodies])
    simulation.step(500)
    start = energy(simulation, mass)
    simulation.step(9500)
    assert start - energy(simulation, mass) <= most
