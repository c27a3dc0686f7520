"""Laws that motion with contacts obeys, whatever solver is behind it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import Material
from tests.reference.contact_scenes import heap
from tests.reference.contact_step import mixed

G = 9.81
TIGHT = sw.SolverOptions(tolerance=1e-6)


def simulate(builder: sw.ModelBuilder, dt: float = 1e-3, **options: Any) -> sw.Simulation:
    options.setdefault("solver", TIGHT)
    return sw.Simulation(builder.finalize(1, "cpu"), dt, **options)


def run(sim: sw.Simulation, time: float) -> None:
    for _ in range(round(time / sim.dt)):
        sim.step()


def v(sim: sw.Simulation, body: int = 0) -> np.ndarray:
    return sim.state.body_v.numpy()[0, body].astype(float)


def omega(sim: sw.Simulation, body: int = 0) -> np.ndarray:
    return sim.state.body_omega.numpy()[0, body].astype(float)


def force(sim: sw.Simulation, body: int = 0) -> np.ndarray:
    return sim.contacts.body_contact_force.numpy()[0, body].astype(float)


def ball_on_ground(material: Material, *, mass: float = 1.0, radius: float = 0.25, **options: Any) -> sw.ModelBuilder:
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=material, name="ground")
    at = sw.pose((0.0, 0.0, radius))
    builder.add_solid("ball", "sphere", radius, mass=mass, pose=at, material=material, **options)
    return builder


# ---- momentum and energy ---------------------------------------------------------------------------------------------


def cluster(rng: np.random.Generator, material: Material) -> sw.ModelBuilder:
    """Balls and boxes without weight that fly at each other."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    for index in range(6):
        direction = rng.normal(size=3)
        at = 0.45 * (np.array([index % 2, index // 2 % 2, index // 4]) - 0.5) + 0.01 * rng.normal(size=3)
        kind, size = ("sphere", 0.2) if index % 2 else ("box", (0.12, 0.11, 0.13))
        builder.add_solid(
            f"b{index}", kind, size, mass=float(rng.uniform(0.5, 2.0)), pose=sw.pose(at), material=material,
            velocity=-2.0 * at + 0.2 * direction, omega=rng.normal(size=3),
        )  # fmt: skip
    return builder


def momenta(sim: sw.Simulation) -> tuple[np.ndarray, np.ndarray, float]:
    """Linear and angular momentum about the origin, and kinetic energy."""
    s, mass = sim.state, sim.model.body_mass.numpy()[0].astype(float)
    inertia = sim.model.body_inertia_b.numpy()[0].astype(float)
    x, q = s.body_x.numpy()[0], s.body_rot.numpy()[0]
    speed = s.body_v.numpy()[0].astype(float)
    turning = s.body_omega.numpy()[0].astype(float)
    spin = []
    for k in range(len(mass)):
        r = np.stack([sw_rotate(q[k], axis) for axis in np.eye(3)], axis=1)
        spin.append(r @ inertia[k] @ r.T @ turning[k])
    linear = np.sum(mass[:, None] * speed, axis=0)
    angular = np.sum(np.array(spin) + mass[:, None] * np.cross(x, speed), axis=0)
    energy = 0.5 * float(np.sum(mass * np.sum(speed**2, axis=1)) + np.sum(turning * np.array(spin)))
    return linear, angular, energy


def sw_rotate(q: np.ndarray, a: np.ndarray) -> np.ndarray:
    t = 2.0 * np.cross(q[:3], a)
    return a + q[3] * t + np.cross(q[:3], t)


@pytest.mark.parametrize("seed", [0, 1])
def test_momentum_of_colliding_bodies_and_their_energy(seed: int) -> None:
    sim = simulate(cluster(np.random.default_rng(seed), Material(friction=0.5)))
    linear, angular, energy = momenta(sim)
    met, lever = 0, 0.0
    for _ in range(300):
        sim.step()
        count = int(sim.contacts.contact_count.numpy()[0])
        impulse = sim.contacts.contact_impulse.numpy()[0, :count]
        met += int(np.sum(impulse[:, 0] > 0.0))
        # friction acts at two points as far apart as the gap: a couple of that lever
        lever += float(np.abs(sim.contacts.contact_gap.numpy()[0, :count]) @ np.linalg.norm(impulse[:, 1:], axis=1))
        new_linear, new_angular, new_energy = momenta(sim)
        # what is pushed out of a penetration of micrometres gains a little energy; the rest is rounding
        assert new_energy <= energy + 1e-3 * energy
        energy = min(energy, new_energy)
    assert met > 20
    # 300 steps of rounding at momenta of 1 kg m/s
    assert np.allclose(new_linear, linear, atol=2e-5)
    assert np.allclose(new_angular, angular, atol=2e-5 + lever)


@pytest.mark.parametrize("masses", [(1.0, 1.0), (1.0, 3.0)])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_head_on_pair(restitution: float, masses: tuple[float, float]) -> None:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    material = Material(restitution=restitution)
    for index, (mass, speed) in enumerate(zip(masses, (2.0, -1.0), strict=True)):
        at = sw.pose(((-0.3, 0.3)[index], 0.0, 0.0))
        velocity = (speed, 0.0, 0.0)
        builder.add_solid(f"b{index}", "sphere", 0.25, mass=mass, pose=at, velocity=velocity, material=material)
    sim = simulate(builder)
    run(sim, 0.1)
    mean = (2.0 * masses[0] - masses[1]) / sum(masses)
    for body, before in enumerate((2.0, -1.0)):
        # Newton: speeds about the common one change sign, times e
        expected = mean - restitution * (before - mean)
        # the gap is corrected to float32 of 0.25 m: 3e-8 m within a step
        assert v(sim, body)[0] == pytest.approx(expected, abs=1e-5 + 3e-8 / sim.dt)


@pytest.mark.parametrize("restitution", [0.3, 0.7, 1.0])
def test_rebound_of_a_touching_ball(restitution: float) -> None:
    sim = simulate(ball_on_ground(Material(restitution=restitution), velocity=(0.0, 0.0, -2.0)))
    sim.step()
    assert v(sim)[2] == pytest.approx(2.0 * restitution, abs=1e-5)  # ten tolerances


def test_height_of_an_elastic_rebound() -> None:
    material = Material(restitution=1.0, friction=0.0)
    height = 0.5
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=material)
    builder.add_solid("ball", "sphere", 0.1, mass=2.0, pose=sw.pose((0.0, 0.0, 0.1 + height)), material=material)
    sim = simulate(builder)
    run(sim, 0.33)
    assert v(sim)[2] > 0.0
    top = 0.0
    for _ in range(400):
        sim.step()
        top = max(top, float(sim.state.body_x.numpy()[0, 0, 2]) - 0.1)
    # the ball turns up to a step early, at 3 m/s, and the step loses g h t on the way
    assert top == pytest.approx(height, abs=5e-3)


def test_slow_impacts_do_not_bounce() -> None:
    builder = ball_on_ground(Material(restitution=1.0), velocity=(0.0, 0.0, -0.1))
    sim = simulate(builder)
    sim.step()
    assert abs(v(sim)[2]) < 1e-5  # the solver's tolerance; 0.1 m/s is less than the restitution threshold


# ---- the contact law itself ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["exact", "convex"])
def test_cone_and_complementarity(law: str) -> None:
    sliding = 0
    for seed in range(4):
        builder = heap(np.random.default_rng(seed))
        sim = simulate(builder, solver=sw.SolverOptions(tolerance=1e-6, friction_law=law))
        for _ in range(10):
            sim.step()
            sliding += check_contacts(builder, sim, law)
    assert sliding > 10


def check_contacts(builder: sw.ModelBuilder, sim: sw.Simulation, law: str) -> int:
    """Checks every contact of the last step; returns how many slid."""
    c, sliding = sim.contacts, 0
    for k in range(int(c.contact_count.numpy()[0])):
        s0, s1 = int(c.contact_shape0.numpy()[0, k]), int(c.contact_shape1.numpy()[0, k])
        friction = mixed(builder.shapes[s0].material, builder.shapes[s1].material).friction
        impulse = c.contact_impulse.numpy()[0, k].astype(float)
        normal, gap = c.contact_normal_w.numpy()[0, k].astype(float), float(c.contact_gap.numpy()[0, k])
        speed = np.zeros(3)
        for sign, shape, arms in ((-1.0, s0, c.contact_arm0), (1.0, s1, c.contact_arm1)):
            body = builder.shapes[shape].body
            if body != sw.WORLD:
                speed += sign * (v(sim, body) + np.cross(omega(sim, body), arms.numpy()[0, k]))
        overlaps = gap < -0.02 * 0.6 * sim.dt  # the row only holds, and the overlap recovers by moving alone
        u = float(normal @ speed) + (0.0 if overlaps else max(gap / sim.dt, -0.6))
        slide = float(np.linalg.norm(speed - normal * (normal @ speed)))
        across = float(np.hypot(impulse[1], impulse[2]))
        assert impulse[0] >= 0.0
        assert across <= friction * impulse[0] * (1.0 + 1e-6) + 1e-9  # rounding
        # gaps are float32: 3e-8 m over a step of 1 ms, and the tolerance
        if impulse[0] <= 1e-4:
            assert u >= -1e-4
        elif slide >= 1e-3:
            sliding += 1
            assert u == pytest.approx(friction * slide if law == "convex" else 0.0, abs=1e-4)
            assert across == pytest.approx(friction * impulse[0], rel=1e-3)
        else:
            assert u == pytest.approx(0.0, abs=2e-3)  # at the threshold of sliding
    return sliding


@pytest.mark.parametrize("direction", [0.0, 1.0, 2.5, 4.0])
def test_friction_opposes_sliding(direction: float) -> None:
    course = np.array([math.cos(direction), math.sin(direction), 0.0])
    sim = simulate(ball_on_ground(Material(friction=0.4), mass=2.0, velocity=3.0 * course))
    sim.step()
    # the first step slides; impulses of 0.02 N·s to 1e-6 m/s
    assert np.allclose(force(sim), 2.0 * G * np.array([0.0, 0.0, 1.0]) - 0.4 * 2.0 * G * course, atol=5e-3)


def test_sliding_ball_starts_to_roll() -> None:
    sim = simulate(ball_on_ground(Material(friction=0.3), velocity=(2.0, 0.0, 0.0)))
    rolls = 2.0 * 2.0 / (7.0 * 0.3 * G)
    run(sim, 0.9 * rolls)
    assert v(sim)[0] - 0.25 * omega(sim)[1] > 0.05
    run(sim, 0.3 * rolls)
    assert v(sim)[0] == pytest.approx(5.0 / 7.0 * 2.0, rel=1e-4)  # a step's friction at most is lost: 1e-3 of 3 m/s²
    assert v(sim)[0] == pytest.approx(0.25 * omega(sim)[1], abs=1e-4)


@pytest.mark.parametrize("kind", ["sphere", "box", "cylinder", "capsule", "cone"])
def test_weight_of_a_resting_body(kind: str) -> None:
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    size = 0.2 if kind in ("sphere", "box") else (0.2, 0.2)
    height = 0.4 if kind == "capsule" else 0.2
    builder.add_solid("body", kind, size, mass=3.0, pose=sw.pose((0.0, 0.0, height)))
    sim = simulate(builder)
    run(sim, 0.2)
    weight = 3.0 * G
    assert np.allclose(force(sim), [0.0, 0.0, weight], atol=1e-4 * weight + 3.0 * 1e-6 / sim.dt)  # residual times m / h
    shapes = sim.contacts.shape_contact_force.numpy()[0]
    assert np.allclose(shapes[0], -shapes[1], atol=1e-5)  # the same sum twice
    assert np.allclose(shapes[1], force(sim), atol=1e-5)


def test_third_law_between_bodies() -> None:
    builder = heap(np.random.default_rng(2))
    sim = simulate(builder)
    sim.step()
    shapes = sim.contacts.shape_contact_force.numpy()[0]
    assert np.abs(shapes).max() > 1.0
    assert np.allclose(shapes.sum(axis=0), 0.0, atol=1e-5 * np.abs(shapes).max())  # float32 sums
    for body in range(len(builder.bodies)):
        mine = [k for k, shape in enumerate(builder.shapes) if shape.body == body]
        assert np.allclose(force(sim, body), shapes[mine].sum(axis=0), atol=1e-6 * np.abs(shapes).max())


def test_mirrored_scene_mirrors_the_motion() -> None:
    flip = np.array([1.0, -1.0, 1.0])

    def scene(mirrored: bool) -> sw.Simulation:
        builder = sw.ModelBuilder()
        builder.add_shape_plane()
        rng = np.random.default_rng(5)
        for index in range(3):
            at = np.array([0.05 * index, 0.03 * index, 0.15 + 0.3 * index])
            speed, turn, q = rng.normal(size=3), rng.normal(size=3), rng.normal(size=4)
            if mirrored:
                at, speed, turn, q = at * flip, speed * flip, -turn * flip, q * [-1.0, 1.0, -1.0, 1.0]
            kind, size = ("box", (0.1, 0.12, 0.14)) if index != 1 else ("sphere", 0.12)
            builder.add_solid(f"b{index}", kind, size, mass=1.0, pose=sw.pose(at, q), velocity=speed, omega=turn)
        return simulate(builder)

    one, two = scene(False), scene(True)
    for _ in range(60):
        one.step()
        two.step()
    # impacts of tumbling boxes enlarge rounding: some hundred of 1e-7
    assert np.allclose(one.state.body_x.numpy()[0], two.state.body_x.numpy()[0] * flip, atol=1e-4)
    assert np.allclose(one.state.body_v.numpy()[0], two.state.body_v.numpy()[0] * flip, atol=2e-3)


# ---- rolling, spinning, cohesion, compliance -------------------------------------------------------------------------


def test_rolling_resistance() -> None:
    """m a = F and I a/r = rho m g - F r give a = rho g / (r (1 + I/(m r²))) = 5 rho g / (7 r)."""
    rho, radius, speed = 0.01, 0.25, 1.0
    material = Material(friction=0.8, rolling_friction=rho)
    builder = ball_on_ground(material, velocity=(speed, 0.0, 0.0), omega=(0.0, speed / radius, 0.0))
    sim = simulate(builder)
    slowing = 5.0 * rho * G / (7.0 * radius)
    run(sim, 1.0)
    assert v(sim)[0] == pytest.approx(speed - slowing * 1.0, rel=1e-3)  # the solver's 1e-6 m/s a thousand times
    assert v(sim)[0] == pytest.approx(radius * omega(sim)[1], abs=1e-4)
    run(sim, speed / slowing)
    assert np.abs(v(sim)).max() < 1e-4, "and it stays where it stopped"


def test_spinning_friction_stops_a_ball() -> None:
    """I omega' = -sigma m g: it stands after 2 r² omega / (5 sigma g)."""
    sigma, radius, rate = 0.02, 0.25, 5.0
    builder = ball_on_ground(Material(spinning_friction=sigma), omega=(0.0, 0.0, rate))
    sim = simulate(builder)
    stop = 0.4 * radius**2 * rate / (sigma * G)
    run(sim, 0.5 * stop)
    assert omega(sim)[2] == pytest.approx(0.5 * rate, rel=4e-3)  # half a step of 0.32 s
    run(sim, 0.5 * stop + 3e-3)
    assert abs(omega(sim)[2]) < 1e-4


@pytest.mark.parametrize(("share", "holds"), [(1.1, True), (0.9, False)])
def test_cohesion_holds_a_ball_under_a_ceiling(share: float, holds: bool) -> None:
    builder = sw.ModelBuilder()
    material = Material(cohesion=share * 2.0 * G)
    ceiling = sw.pose((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0))
    builder.add_shape_plane(pose=ceiling, material=material)
    builder.add_solid("ball", "sphere", 0.1, mass=2.0, pose=sw.pose((0.0, 0.0, 0.9)), material=material)
    sim = simulate(builder)
    run(sim, 0.01)
    if holds:
        run(sim, 0.3)
        assert abs(v(sim)[2]) < 1e-5
        assert force(sim)[2] == pytest.approx(2.0 * G, rel=1e-3)  # residual times m / h
    else:
        # within the envelope it pulls with what it has; beyond, the ball falls freely
        assert v(sim)[2] < -0.5 * (1.0 - share) * G * 0.01
        run(sim, 0.3)
        assert v(sim)[2] < -1.0


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_compliant_contact_sinks_by_its_load(damping: float) -> None:
    compliance, mass = 1e-5, 2.0  # the sum of two materials; sinks by 0.2 mm, less than a step takes back
    builder = ball_on_ground(Material(compliance=0.5 * compliance, damping=damping), mass=mass)
    sim = simulate(builder)
    run(sim, 0.5)
    sunk = 0.25 - float(sim.state.body_x.numpy()[0, 0, 2])
    assert sunk == pytest.approx(compliance * mass * G, rel=1e-3)  # gaps in float32: 3e-8 of 2e-4 m
    assert force(sim)[2] == pytest.approx(mass * G, rel=1e-3)


# ---- joints and contacts ---------------------------------------------------------------------------------------------


def arm(tip: float = 0.1, **options: Any) -> sw.ModelBuilder:
    """1 m long, 2 kg, hinged at (0, 0, tip); a ball of radius 0.1 m at its end touches the ground."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    body = builder.add_body("arm", mass=2.0, inertia=(0.01, 0.17, 0.17), pose=sw.pose((0.5, 0.0, tip)))
    builder.add_shape_sphere(body, radius=0.1, pose=sw.pose((0.5, 0.0, 0.0)), name="tip")
    builder.add_joint_revolute("hinge", sw.WORLD, body, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, tip), **options)
    return builder


@pytest.mark.parametrize("limit", [None, (-1.0, 1.0)])
def test_arm_rests_on_the_ground(limit: tuple[float, float] | None) -> None:
    # 1e-7 m/s of 2 kg in 1 ms are 2e-4 N, far below what is asked of the balance
    exact = sw.SolverOptions(tolerance=1e-7)
    sim = simulate(arm() if limit is None else arm(limit=limit), joint_reactions=True, solver=exact)
    run(sim, 0.3)
    # the tip carries half of the weight; friction along the arm has a lever of the ball's radius
    weight = np.array([0.0, 0.0, -2.0 * G])
    reaction = sim.diagnostics.joint_reaction_force.numpy()[0, 0].astype(float)
    assert force(sim)[2] + 0.1 * force(sim)[0] == pytest.approx(G, rel=1e-3)  # residual times m / h
    assert np.allclose(reaction + force(sim) + weight, 0.0, atol=5e-3)
    torque = sim.diagnostics.joint_reaction_torque.numpy()[0, 0].astype(float)
    about_hinge = torque + np.cross([1.0, 0.0, -0.1], force(sim)) + np.cross([0.5, 0.0, 0.0], weight)
    assert np.allclose(about_hinge, 0.0, atol=1e-2)


def test_limit_keeps_the_arm_off_the_ground() -> None:
    sim = simulate(arm(0.1 + 1e-4, limit=(-1.0, 0.0)))
    run(sim, 0.3)
    assert np.allclose(force(sim), 0.0, atol=1e-6)
    assert np.abs(sim.state.box_impulse.numpy()[0]).max() == pytest.approx(G * 1e-3, rel=1e-3)  # 2 kg at half a metre


def test_limit_and_contact_share_the_load() -> None:
    """Both hold at once: whatever the shares, moments about the hinge balance."""
    sim = simulate(arm(limit=(-1.0, 0.0)))
    run(sim, 0.3)
    held = float(np.abs(sim.state.box_impulse.numpy()[0]).max()) / sim.dt + force(sim)[2] + 0.1 * force(sim)[0]
    assert held == pytest.approx(G, rel=2e-3)
    assert np.abs(v(sim)).max() < 1e-5


def test_motor_presses_with_its_limit() -> None:
    torque = 5.0
    sim = simulate(arm(drive=sw.VelocityMotor(effort_limit=torque)))
    sim.control.joint_target_qd.fill_(1.0)
    run(sim, 0.3)
    assert force(sim)[2] + 0.1 * force(sim)[0] == pytest.approx(G + torque, rel=1e-3)
    assert abs(float(sim.state.joint_qd.numpy()[0, 0])) < 1e-5


# ---- far away --------------------------------------------------------------------------------------------------------


def test_ten_kilometres_from_the_origin() -> None:
    away = np.array([10000.0, -10000.0, 0.0])

    def scene(offset: np.ndarray) -> sw.Simulation:
        builder = sw.ModelBuilder()
        builder.add_shape_plane()
        rng = np.random.default_rng(3)
        for index in range(3):
            kind, size = ("box", (0.1, 0.12, 0.14)) if index != 1 else ("sphere", 0.12)
            at = np.array([0.05 * index, 0.03 * index, 0.2 + 0.3 * index])
            q = np.array([0.05, 0.02, 0.1 * index, 1.0])
            builder.add_solid(
                f"b{index}", kind, size, mass=1.0, pose=sw.pose(at + offset, q), velocity=0.3 * rng.normal(size=3)
            )
        return simulate(builder)

    near, far = scene(np.zeros(3)), scene(away)
    for _ in range(100):
        near.step()
        far.step()
    moved = far.state.body_x.numpy()[0] - away
    assert np.allclose(moved, near.state.body_x.numpy()[0], atol=1e-5)
    assert np.allclose(far.state.body_v.numpy()[0], near.state.body_v.numpy()[0], atol=1e-3)  # impacts enlarge rounding


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("phase", range(5))
def test_a_rebound_does_not_depend_on_where_the_step_falls(restitution: float, phase: int) -> None:
    """2 mm of travel per step; a step that stops short of the ground must not brake first."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    material = Material(restitution=restitution)
    builder.add_shape_plane(material=material)
    at = sw.pose((0.0, 0.0, 0.12 + 0.0004 * phase))
    builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=at, velocity=(0.0, 0.0, -2.0), material=material)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    run(sim, 0.05)
    assert v(sim)[2] == pytest.approx(2.0 * restitution, abs=2e-5)  # twice the solver's tolerance


def test_a_bounce_on_a_compliant_surface_does_not_sink_in() -> None:
    material = Material(restitution=0.5, compliance=5e-6)
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=material)
    at = sw.pose((0.0, 0.0, 0.101))
    builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=at, velocity=(0.0, 0.0, -3.0), material=material)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    for _ in range(20):
        sim.step()
        assert sim.contacts.penetration.numpy()[0] < 1e-5


def test_compliance_carries_any_load() -> None:
    """C m g = 9.8e-4 m; a clamp at the depenetration velocity would cap the force and let the ball sink through."""
    builder = sw.ModelBuilder()
    material = Material(compliance=5e-5)
    builder.add_shape_plane(material=material)
    at = sw.pose((0.0, 0.0, 0.1))
    builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=at, material=material)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    run(sim, 2.0)
    sunk = 0.1 - float(sim.state.body_x.numpy()[0, 0, 2])
    assert sunk == pytest.approx(1e-4 * 9.81, rel=1e-2)  # the implicit spring is damped, not yet at rest to 1 %


def test_cohesion_does_not_hold_in_mid_air() -> None:
    builder = sw.ModelBuilder()
    material = Material(cohesion=50.0)
    builder.add_shape_plane(material=material)
    at = sw.pose((0.0, 0.0, 0.6))
    builder.add_solid("ball", "sphere", 0.1, mass=1.0, pose=at, velocity=(0.0, 0.0, -10.0), material=material)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 5e-3)
    run(sim, 0.5)
    assert float(sim.state.body_x.numpy()[0, 0, 2]) == pytest.approx(0.1, abs=1e-5)  # the solver's tolerance times h


def test_reset_clears_the_forces() -> None:
    sim = simulate(ball_on_ground(Material()))
    run(sim, 0.05)
    assert np.any(sim.contacts.body_contact_force.numpy() != 0.0)
    sim.reset()
    for name in ("body_contact_force", "shape_contact_force", "penetration", "contact_count", "contact_overflow"):
        assert not np.any(getattr(sim.contacts, name).numpy()), name


def test_contact_forces_add_up_to_those_of_bodies() -> None:
    sim = simulate(ball_on_ground(Material()))
    run(sim, 0.05)
    count = int(sim.contacts.contact_count.numpy()[0])
    total = sim.contacts.contact_force_w.numpy()[0, :count].sum(axis=0)
    np.testing.assert_allclose(total, sim.contacts.body_contact_force.numpy()[0, 0], rtol=1e-6)
