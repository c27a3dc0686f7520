"""`numerical_damping`: orders, decay and resonance against closed forms; gaps and joints as before.

Positions belong to steps and velocities to the middle between them, so that runs start with the velocity half a step
before the start. Where a closed form gives none, `start_between` makes it, as docs/integrators.md does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp

import simwarp as sw
from simwarp import scenes
from simwarp.model.builder import ModelBuilder
from tests.reference.planar import G, double_pendulum_rate, four_bar_crank
from tests.reference.spring_rule import oscillate

Array = np.ndarray


def simulation(builder: ModelBuilder, h: float, damping: float, worlds: int = 1) -> sw.Simulation:
    solver = sw.SolverOptions(numerical_damping=damping)
    return sw.Simulation(builder.finalize(worlds, "cpu"), h, solver=solver, check_start=False)


# ---- linear systems ------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Linear:
    """M q̈ + D q̇ + K q = 0 in the coordinates of a model's joints, with the exact solution."""

    build: Callable[[], ModelBuilder]
    mass: Array
    damping: Array
    stiffness: Array
    start: Array  # at rest
    duration: float
    steps: tuple[float, ...]  # [s]

    def exact(self, t: float) -> tuple[Array, Array]:
        """Coordinates and rates at a time."""
        n = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]])
        both = scipy.linalg.expm(a * t) @ np.concatenate([self.start, np.zeros(n)])
        return both[:n], both[n:]

    def started(self, h: float, damping: float) -> sw.Simulation:
        sim = simulation(self.build(), h, damping)
        sim.set_joint_state(None, self.start[None], self.exact(-0.5 * h)[1][None])
        return sim

    def errors(self, damping: float) -> Array:
        """Largest error of the coordinates at the end, for each step size."""
        found = []
        for h in self.steps:
            sim = self.started(h, damping)
            sim.step(round(self.duration / h))
            found.append(np.abs(sim.state.joint_x.numpy()[0] - self.exact(self.duration)[0]).max())
        return np.array(found)


def slider(mass: float, **law: object) -> ModelBuilder:
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("mass", mass=mass, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0), **law)  # type: ignore[arg-type]
    return builder


SPRUNG, UNSPRUNG, SPRING, TIRE, SHOCK = 375.0, 40.0, 20e3, 200e3, 700.0
"""A quarter car [kg, N/m, N·s/m]: its wheel hops at 11.7 Hz."""


def quarter_car(*, road: bool = False) -> ModelBuilder:
    """Wheel on a tire's spring, body on spring and shock absorber; the ground is a body that moves, or the world."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    ground, axis = sw.WORLD, (0.0, 0.0, 1.0)
    if road:
        ground = builder.add_body("road", mass=1.0, inertia=(1.0, 1.0, 1.0))
        builder.add_joint_prismatic("road", sw.WORLD, ground, axis=axis, drive=sw.PrescribedPosition())
    wheel = builder.add_body("wheel", mass=UNSPRUNG, inertia=(1.0, 1.0, 1.0))
    body = builder.add_body("body", mass=SPRUNG, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("tire", ground, wheel, axis=axis, stiffness=TIRE)
    builder.add_joint_prismatic("suspension", wheel, body, axis=axis, stiffness=SPRING, damping=SHOCK)
    return builder


def halvings(longest: float) -> tuple[float, ...]:
    return tuple(longest / 2**k for k in range(4))


SERVO = sw.PositionDrive(stiffness=4e4, damping=80.0)  # 200 rad/s, a fifth of critical damping
LINEAR = {
    "spring-mass": Linear(
        lambda: slider(1.0, stiffness=400.0, damping=4.0), np.eye(1), 4.0 * np.eye(1), 400.0 * np.eye(1),
        np.array([0.1]), 0.8, halvings(0.008),
    ),
    "quarter car": Linear(
        quarter_car, np.array([[UNSPRUNG + SPRUNG, SPRUNG], [SPRUNG, SPRUNG]]), np.diag([0.0, SHOCK]),
        np.diag([TIRE, SPRING]), np.array([0.02, -0.03]), 0.4, halvings(0.004),
    ),
    "stiff drive": Linear(
        lambda: slider(1.0, drive=SERVO), np.eye(1), 80.0 * np.eye(1), 4e4 * np.eye(1), np.array([0.1]), 0.04,
        halvings(0.001),
    ),
}  # fmt: skip


def orders(errors: Array) -> Array:
    """Observed orders between step sizes that halve."""
    return np.log2(errors[:-1] / errors[1:])


@pytest.mark.parametrize("name", LINEAR)
def test_without_numerical_damping_the_step_is_of_second_order(name: str) -> None:
    # ω h is at most 0.4 in the last two refinements: terms of higher order move the order by less than 0.1
    np.testing.assert_allclose(orders(LINEAR[name].errors(0.0))[1:], 2.0, atol=0.1)


@pytest.mark.parametrize("name", LINEAR)
def test_with_it_the_step_is_of_first_order(name: str) -> None:
    coarse, fine = LINEAR[name].errors(1.0)[-2:]
    assert 0.7 < np.log2(coarse / fine) < 1.2  # ω² h is no small number yet
    assert fine > 10.0 * LINEAR[name].errors(0.0)[-1]


# ---- nonlinear motions ---------------------------------------------------------------------------------------------


def start_between(sim: sw.Simulation) -> None:
    """Velocities of the present state become those half a step before it: less half of what a step adds."""
    state, before = sim.state, sim.snapshot()
    v, omega = (array.numpy().astype(float) for array in (state.body_v, state.body_omega))
    sim.step()
    dv, domega = state.body_v.numpy() - v, state.body_omega.numpy() - omega
    sim.restore(before)
    state.body_v.assign((v - 0.5 * dv).astype(np.float32))
    state.body_omega.assign((omega - 0.5 * domega).astype(np.float32))
    state.body_omega_last.assign((omega - 1.5 * domega).astype(np.float32))
    sim.measure()


REST, ELASTIC, LOSS = 1.0, 400.0, 2.0


def elastic_pendulum() -> ModelBuilder:
    """1 kg on a damped spring from the origin, released along +X."""
    builder = ModelBuilder()
    bob = builder.add_body("bob", mass=1.0, inertia=(0.01,) * 3, pose=sw.pose((REST, 0.0, 0.0)))
    builder.add_spring("spring", sw.WORLD, bob, anchor0=(0, 0, 0), anchor1=(REST, 0, 0), stiffness=ELASTIC,
                       rest=REST, damping=LOSS)  # fmt: skip
    return builder


def elastic_rate(_: float, y: Array) -> Array:
    """Rates of (x, z, vx, vz)."""
    length = float(np.hypot(*y[:2]))
    n = y[:2] / length
    pull = ELASTIC * (length - REST) + LOSS * float(n @ y[2:])
    return np.concatenate([y[2:], -pull * n - np.array([0.0, G])])


def rotating_slide() -> ModelBuilder:
    """A damped, sprung mass that slides along an arm, which turns freely about the vertical."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), omega=(0.0, 0.0, 6.0))
    mass = builder.add_body("mass", mass=1.0, inertia=(1e-3,) * 3, pose=sw.pose((0.5, 0.0, 0.0)),
                            velocity=(0.0, 3.0, 0.0), omega=(0.0, 0.0, 6.0))  # fmt: skip
    builder.add_joint_revolute("pivot", sw.WORLD, arm, axis=(0.0, 0.0, 1.0))
    builder.add_joint_prismatic("slide", arm, mass, axis=(1.0, 0.0, 0.0), anchor=(0.5, 0.0, 0.0), stiffness=200.0,
                                damping=4.0)  # fmt: skip
    return builder


def rotating_rate(_: float, y: Array) -> Array:
    """Rates of (angle, slide) and of their rates."""
    (_, s, w, u), r, inertia = y, 0.5 + y[1], 0.101
    return np.array([w, u, -2.0 * r * u * w / (inertia + r * r), r * w * w - 200.0 * s - 4.0 * u])


def solved(rate: Callable[[float, Array], Array], start: list[float], t: float) -> Array:
    """The motion at a time, by a method of eighth order."""
    found: Array = solve_ivp(rate, (0.0, t), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return found


def joint_coordinates(sim: sw.Simulation) -> Array:
    found: Array = sim.state.joint_x.numpy()[0]
    return found


@dataclasses.dataclass(frozen=True)
class Motion:
    """A motion whose end is known."""

    build: Callable[[], ModelBuilder]
    end: Callable[[], Array | float]
    read: Callable[[sw.Simulation], Array | float]
    duration: float
    steps: tuple[float, ...]

    def errors(self, damping: float, *, between: bool = True) -> Array:
        found, end = [], self.end()
        for h in self.steps:
            sim = simulation(self.build(), h, damping)
            if between:
                start_between(sim)
            sim.step(round(self.duration / h))
            found.append(np.abs(self.read(sim) - end).max())
        return np.array(found)


def two_angles() -> Array:
    a, b = solved(lambda _, y: double_pendulum_rate(y), [0.0] * 4, 1.28)[:2]
    return np.array([a, b - a])


def crank_angle(t: float) -> float:
    """Angle of the free crank of `scenes.slider_crank`, which starts with 2π rad/s, by conservation of energy."""
    r, length = 0.5, 1.5

    def energies(a: float) -> tuple[float, float]:
        """Twice the kinetic energy over the square of the rate, and the potential one [J]."""
        rod = -np.arcsin(r * np.sin(a) / length)
        turn = -r * np.cos(a) / (length * np.cos(rod))
        pin = r * np.array([-np.sin(a), np.cos(a)])
        along = length * turn * np.array([-np.sin(rod), np.cos(rod)])
        centre, end = pin + 0.5 * along, pin + along
        kinetic = r**2 / 3.0 + 2.0 * (centre @ centre + length**2 / 12.0 * turn**2) + 3.0 * end @ end
        return float(kinetic), G * (0.5 * r * np.sin(a) + 2.0 * (r * np.sin(a) + 0.5 * length * np.sin(rod)))

    total = 0.5 * energies(0.0)[0] * (2.0 * np.pi) ** 2

    def rate(_: float, y: Array) -> Array:
        kinetic, potential = energies(float(y[0]))
        return np.array([np.sqrt(2.0 * (total - potential) / kinetic)])

    return float(solved(rate, [0.0], t)[0])


MOTIONS = {
    "elastic pendulum": Motion(
        elastic_pendulum, lambda: solved(elastic_rate, [REST, 0.0, 0.0, 0.0], 0.8)[:2],
        lambda sim: sim.state.body_x.numpy()[0, 0, [0, 2]], 0.8, halvings(0.008),
    ),
    "slide on a turning arm": Motion(
        rotating_slide, lambda: solved(rotating_rate, [0.0, 0.0, 6.0, 0.0], 0.8)[:2], joint_coordinates, 0.8,
        halvings(0.008),
    ),
    "pendulum": Motion(
        scenes.pendulum, lambda: solved(lambda _, y: np.array([y[1], G * np.cos(y[0])]), [0.0, 0.0], 0.64)[0],
        lambda sim: joint_coordinates(sim)[0], 0.64, halvings(0.032),
    ),
    "double pendulum": Motion(scenes.double_pendulum, two_angles, joint_coordinates, 1.28, halvings(0.008)),
    "four-bar": Motion(
        scenes.four_bar, lambda: four_bar_crank(scenes.FourBar(), 0.9, 12.0, np.array([0.0, 0.8]))[-1] - 0.9,
        lambda sim: joint_coordinates(sim)[0], 0.8, halvings(0.002),
    ),
    "slider-crank": Motion(
        lambda: scenes.slider_crank(speed=None), lambda: crank_angle(0.16), lambda sim: joint_coordinates(sim)[0], 0.16,
        halvings(0.004),
    ),
}  # fmt: skip
WITHOUT_SPRINGS = ("pendulum", "double pendulum", "four-bar", "slider-crank")


@pytest.mark.parametrize("name", [name for name in MOTIONS if name not in WITHOUT_SPRINGS])
def test_springs_that_turn_are_of_second_order(name: str) -> None:
    np.testing.assert_allclose(orders(MOTIONS[name].errors(0.0))[1:], 2.0, atol=0.1)
    assert orders(MOTIONS[name].errors(1.0))[-1] < 1.3


@pytest.mark.parametrize("name", WITHOUT_SPRINGS)
def test_joints_are_of_second_order_whatever_the_damping(name: str) -> None:
    """Gyroscopic and curvature terms belong to the middle of a step; a start that does not makes it first."""
    motion = MOTIONS[name]
    np.testing.assert_allclose(orders(motion.errors(1.0))[1:], 2.0, atol=0.1)
    assert orders(motion.errors(1.0, between=False))[-1] < 1.3


# ---- decay and resonance -------------------------------------------------------------------------------------------


def decay_rate(times: Array, x: Array) -> float:
    """Decay of an oscillation about zero [1/s], from its extremes."""
    peaks = np.flatnonzero((np.abs(x[1:-1]) >= np.abs(x[:-2])) & (np.abs(x[1:-1]) > np.abs(x[2:]))) + 1
    # a parabola through three samples finds the extreme between them
    left, mid, right = (np.abs(x[peaks + k]) for k in (-1, 0, 1))
    top = mid + (right - left) ** 2 / (8.0 * (2.0 * mid - left - right))
    return float(-np.polyfit(times[peaks], np.log(top), 1)[0])


OMEGA, RATE = 20.0 * np.pi, 9.9
"""An oscillator of 10 Hz [rad/s] whose damper makes it decay with 9.9/s."""


def sprung_decay(damping: float, *, rate: float = RATE, h: float = 1e-3, steps: int = 400) -> float:
    """Decay of the oscillator [1/s]."""
    sim = simulation(slider(1.0, stiffness=OMEGA**2 + rate**2, damping=2.0 * rate), h, damping)
    sim.set_joint_state(None, np.array([[0.1]]), np.zeros((1, 1)))
    x = []
    for _ in range(steps):
        sim.step()
        x.append(float(sim.state.joint_x.numpy()[0, 0]))
    return decay_rate(h * np.arange(1, steps + 1), np.array(x))


@pytest.mark.parametrize("damping", [0.0, 0.1, 0.5, 1.0])
def test_a_spring_decays_by_half_the_damping_times_h_omega_squared(damping: float) -> None:
    """The law's next term is of the order of (ω h)² = 0.4 % of it; the fit finds 0.2 %."""
    law = 0.5 * damping * 1e-3 * OMEGA**2
    assert sprung_decay(damping, rate=0.0) == pytest.approx(law, rel=0.03, abs=3e-3)


@pytest.mark.parametrize(("damping", "ratio", "allowed"), [(0.0, 1.0, 5e-3), (0.1, 1.02, 5e-3), (1.0, 1.2, 0.02)])
def test_a_damped_spring_decays_as_it_should(damping: float, ratio: float, allowed: float) -> None:
    """The ratio to the exact decay is 1 + damping h ω²/2 / 9.9; what remains is of second order."""
    assert sprung_decay(damping, steps=300) / RATE == pytest.approx(ratio, abs=allowed)


FREQUENCIES = np.linspace(10.5, 12.5, 21)


def wheel_hop(damping: float, h: float = 1e-3, duration: float = 3.0) -> Array:
    """Amplitude of the wheel over that of the road, for each of `FREQUENCIES` [Hz], one in each world."""
    sim = simulation(quarter_car(road=True), h, damping, worlds=len(FREQUENCIES))
    w, height = 2.0 * np.pi * FREQUENCIES, 0.01
    target, rate = np.zeros((2, len(w), 3), np.float32)
    rows = []
    for step in range(round(duration / h)):
        target[:, 0] = height * np.sin(w * step * h)
        rate[:, 0] = (height * np.sin(w * (step + 1) * h) - target[:, 0]) / h
        sim.control.joint_target_q.assign(target)
        sim.control.joint_target_qd.assign(rate)
        sim.step()
        if (step + 1) * h > duration - 1.0:
            x = sim.state.joint_x.numpy()
            rows.append(np.concatenate([[(step + 1) * h], x[:, 0] + x[:, 1]]))
    found = np.array(rows)
    waves = [np.stack([np.sin(each * found[:, 0]), np.cos(each * found[:, 0])], axis=1) for each in w]
    fits = [np.linalg.lstsq(wave, found[:, 1 + k], rcond=None)[0] for k, wave in enumerate(waves)]
    return np.hypot(*np.array(fits).T) / height


def wheel_hop_exact() -> Array:
    """The same from the equations of motion."""
    s = 2j * np.pi * FREQUENCIES
    link = SHOCK * s + SPRING
    body = SPRUNG * s**2 + link
    wheel: Array = np.abs(TIRE / (UNSPRUNG * s**2 + link + TIRE - link**2 / body))
    return wheel


def test_the_second_resonance_of_a_quarter_car() -> None:
    exact = wheel_hop_exact().max()
    assert wheel_hop(0.0).max() / exact == pytest.approx(1.0, abs=0.02)
    assert wheel_hop(0.1).max() / exact == pytest.approx(1.0, abs=0.04)
    assert wheel_hop(1.0).max() / exact < 0.8


@pytest.mark.parametrize("damping", [0.0, 0.1, 0.4, 0.5, 0.8, 1.0])
def test_a_batch_of_masses_follows_the_rule_step_by_step(damping: float) -> None:
    """Against the rule in float64, for springs from soft to far too stiff for the step; steps round by 1e-7 each."""
    h, steps, stiffness = 1e-3, 100, np.array([1e2, 1e5, 1e7])
    model = slider(1.0, stiffness=1.0, damping=3.0).finalize(3, "cpu", per_world=["joint_stiffness"])
    model.joint_stiffness.assign(stiffness[:, None].astype(np.float32))
    sim = sw.Simulation(model, h, solver=sw.SolverOptions(numerical_damping=damping), check_start=False)
    sim.set_joint_state(None, np.full((3, 1), 0.1), np.zeros((3, 1)))
    sim.step(steps)
    exact = [oscillate(damping, h, steps, mass=1.0, stiffness=k, damping=3.0, x=0.1, u=0.0) for k in stiffness]
    for world, (x, u) in enumerate(exact):
        largest = max(np.abs(u).max(), 1e-3)
        assert sim.state.joint_x.numpy()[world, 0] == pytest.approx(x[-1, 0], abs=steps * h * 4e-7 * largest + 1e-7)
        assert sim.state.joint_qd.numpy()[world, 0] == pytest.approx(u[-1, 0], abs=steps * 4e-7 * largest)


# ---- energy, gaps and joints ---------------------------------------------------------------------------------------


def middle_energies(damping: float, h: float, steps: int, stiffness: float) -> Array:
    """Energy of an undamped mass of 1 kg in the middles of the steps [J], with the mean of both positions."""
    sim = simulation(slider(1.0, stiffness=stiffness), h, damping)
    sim.set_joint_state(None, np.array([[0.1]]), np.zeros((1, 1)))
    last, found = 0.1, []
    for _ in range(steps):
        sim.step()
        x, u = float(sim.state.joint_x.numpy()[0, 0]), float(sim.state.joint_qd.numpy()[0, 0])
        found.append(0.5 * u * u + 0.5 * stiffness * (0.5 * (x + last)) ** 2)
        last = x
    return np.array(found)


@pytest.mark.parametrize("stiffness", [400.0, 4e6])
def test_the_trapezoidal_rule_keeps_the_energy_of_the_middle(stiffness: float) -> None:
    """It does so exactly at ω h = 0.02 and 2: rounding walks, at most by one eps per step."""
    energy = middle_energies(0.0, 1e-3, 2000, stiffness)
    np.testing.assert_allclose(energy, energy[0], rtol=2000 * 6e-8)


@pytest.mark.parametrize("damping", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("stiffness", [400.0, 4e6])
def test_numerical_damping_takes_energy_and_gives_none(damping: float, stiffness: float) -> None:
    """From swing to swing. Within one, that energy breathes by the share damping · ω h of itself."""
    energy = middle_energies(damping, 1e-3, 2000, stiffness)
    swing = max(4, round(np.pi / np.sqrt(stiffness) / 1e-3))
    means = energy[: len(energy) // swing * swing].reshape(-1, swing).mean(axis=1)
    assert np.all(np.diff(means) <= 1e-6 * means[0])
    # an energy decays twice as fast as its amplitude, damping h ω² (to (ω h)² of it); the stiff one is gone
    law = damping * 1e-3 * stiffness * (len(means) - 1) * swing * 1e-3
    assert means[-1] / means[0] < max(np.exp(-0.99 * law), 1e-6)


@pytest.mark.parametrize("damping", [0.0, 0.1, 1.0])
def test_a_sprung_ball_rests_at_a_closed_gap(damping: float) -> None:
    """It is pressed on the floor: x⁺ = x + h v⁺ closes the gap to the solver's tolerance in one step."""
    builder = ModelBuilder()
    builder.add_shape_plane(sw.WORLD)
    ball = builder.add_body("ball", mass=1.0, inertia=(0.01,) * 3, pose=sw.pose((0.0, 0.0, 0.3)))
    builder.add_shape_sphere(ball, radius=0.1)
    builder.add_joint_prismatic("guide", sw.WORLD, ball, axis=(0.0, 0.0, 1.0), stiffness=400.0, rest=-0.05, damping=0.5)
    sim = simulation(builder, 2e-3, damping)
    sim.control.joint_force.fill_(-150.0)
    least = 0.0
    for _ in range(500):
        sim.step()
        least = min(least, float(sim.state.body_x.numpy()[0, 0, 2]) - 0.1)
    assert least > -2e-3 * 1e-5 - 1e-8  # tolerance 1e-5 m/s times the step
    force = sim.contacts.contact_impulse.numpy()[0, 0, 0] / 2e-3
    # the spring is 0.15 m short: weight and push less its 60 N; half a percent: it still breathes at 0
    assert force == pytest.approx(G + 150.0 - 60.0, rel=5e-3)


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_loop_with_a_spring_in_it_stays_closed(damping: float) -> None:
    """A joint keeps ⅓ h² κ of its curvature: a tenth more where the motion is damped less."""

    def worst(numerical: float) -> tuple[float, float]:
        builder = scenes.four_bar()
        builder.add_spring("spring", 0, 1, anchor0=(0.1, 0.0, 0.1), anchor1=(0.3, 0.0, 0.8), stiffness=500.0,
                           damping=1.0, rest=0.7)  # fmt: skip
        sim = simulation(builder, 1e-3, numerical)
        rows = []
        for _ in range(1000):
            sim.step()
            rows.append([sim.diagnostics.position_error.numpy()[0], sim.diagnostics.row_residual.numpy()[0]])
        error, residual = np.max(rows, axis=0)
        return float(error), float(residual)

    (error, residual), (usual, _) = worst(damping), worst(1.0)
    assert error < 1.1 * usual
    assert residual < 5e-6  # `row_tolerance`
