"""Sprockets and grooves at work: swings in an arc, a rack carried along, momentum, batches, what never meets."""

import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.model import model as model_module

PROFILE: dict[str, Any] = {
    "arc_center_radius": 0.3,
    "arc_radius": 0.089,
    "tip_radius": 0.2605,
    "teeth": 10,
    "half_width": 0.05,
}
FACING_DOWN = (-0.5, 0.5, 0.5, 0.5)
"""Turns z to y and the first gap, on x, to -z."""
ROLLER = 0.015
SLIPPERY = sw.Material(friction=0.0)


def simulation(builder: sw.ModelBuilder, worlds: int = 1, dt: float = 1e-3, **options) -> sw.Simulation:
    return sw.Simulation(builder.finalize(worlds, "cpu"), dt, check_start=False, **options)


def pendulum(angle: float, friction: float = 0.0) -> sw.Simulation:
    """A ball in the lowest arc of a sprocket that stands, `angle` to the side of the arc's middle and in contact."""
    length, turned = PROFILE["arc_radius"] - ROLLER, sw.pose((0.0, 0.0, 0.0), FACING_DOWN)
    at = (length * math.sin(angle), 0.0, -0.3 + length * math.cos(angle))
    # the arc's centre is below the bottom of the gap: what swings in it, swings upside down
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 9.81))
    builder.add_shape_sprocket(sw.WORLD, **PROFILE, pose=turned, material=sw.Material(friction=friction))
    inertia = 0.4 * 1.0 * ROLLER**2
    ball = builder.add_body("ball", mass=1.0, inertia=(inertia, inertia, inertia), pose=sw.pose(at))
    builder.add_shape_sphere(ball, radius=ROLLER, material=sw.Material(friction=friction))
    return simulation(builder, dt=5e-4)


def swing(sim: sw.Simulation, seconds: float) -> np.ndarray:
    """(steps, 2) angle of the ball about the arc's centre [rad], and its energy [J]."""
    rows = []
    for _ in range(round(seconds / sim.dt)):
        sim.step()
        x, v = sim.state.body_x.numpy()[0, 0], sim.state.body_v.numpy()[0, 0].astype(float)
        omega = sim.state.body_omega.numpy()[0, 0].astype(float)
        energy = 0.5 * v @ v + 0.2 * ROLLER**2 * omega @ omega - 9.81 * x[2]
        rows.append((math.atan2(x[0], x[2] + 0.3), energy))
    return np.array(rows)


def period(angles: np.ndarray, dt: float) -> float:
    """Mean time between upward zero crossings [s]."""
    before, after = angles[:-1], angles[1:]
    steps = np.flatnonzero((before < 0.0) & (after >= 0.0))
    times = (steps + before[steps] / (before[steps] - after[steps])) * dt
    return float(np.diff(times).mean())


@pytest.mark.parametrize(("friction", "inertia_factor"), [(0.0, 1.0), (0.8, 1.4)], ids=["slides", "rolls"])
def test_a_ball_swings_in_an_arc_like_a_pendulum(friction, inertia_factor):
    """Of length a - r; a ball that rolls carries 2/5 more inertia. The first term of the series in the amplitude,
    angle²/16, is in; the step adds some (w dt)²/24, 1.4e-6 here. Contacts open and close by what a ball falls in a
    step, g dt²: by so much its height is not that of a pendulum."""
    start = 0.1
    sim = pendulum(start, friction)
    rows = swing(sim, 1.45)
    length = PROFILE["arc_radius"] - ROLLER
    wanted = 2.0 * math.pi * math.sqrt(inertia_factor * length / 9.81) * (1.0 + start**2 / 16.0)
    assert period(rows[:, 0], sim.dt) == pytest.approx(wanted, rel=5e-5)
    np.testing.assert_allclose(rows[:, 1], rows[0, 1], atol=2.0 * 9.81 * 9.81 * sim.dt**2)


def rack(worlds: int = 1, *, pitch: float = 0.15, rollers: int = 40, depth: float = 0.235) -> sw.Simulation:
    """A sprocket on an axle and, below it, a row of rollers on a braked sled: coordinates "axle" and "rail"."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    wheel = builder.add_body("sprocket", mass=5.0, inertia=(0.2, 0.2, 0.2))
    builder.add_joint_revolute("axle", sw.WORLD, wheel, axis=(0.0, 1.0, 0.0))
    surface = sw.Material(friction=0.4)
    builder.add_shape_sprocket(wheel, **PROFILE, pose=sw.pose((0.0, 0.0, 0.0), FACING_DOWN), material=surface)
    sled = builder.add_body("sled", mass=20.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, -depth)))
    builder.add_joint_prismatic("rail", sw.WORLD, sled, axis=(-1.0, 0.0, 0.0), damping=200.0)
    for k in range(rollers):
        place = sw.pose(((k - 2) * pitch, 0.0, 0.0))
        builder.add_shape_sphere(sled, radius=ROLLER, pose=place, material=surface, name=f"roller{k}")
    sim = simulation(builder, worlds)
    force = sim.control.joint_force.numpy()
    force[:, 0] = 100.0
    sim.control.joint_force.assign(force)
    return sim


def touching(sim: sw.Simulation) -> dict[int, int]:
    """Feature of the contact of each roller that has one."""
    count = int(sim.contacts.contact_count.numpy()[0])
    pairs = zip(
        sim.contacts.contact_shape1.numpy()[0, :count].tolist(),
        sim.contacts.contact_feature.numpy()[0, :count].tolist(), strict=True,
    )  # fmt: skip
    return dict(pairs)


def test_a_sprocket_carries_a_rack_tooth_by_tooth():
    """Two turns: one roller a tooth, whatever the radius at which it is pushed. Where flanks take over from each other
    is the same in each turn, so that whole turns from turn to turn have no more error than a roller's clearance."""
    sim, pitch, teeth = rack(), 0.15, PROFILE["teeth"]
    features: dict[int, int] = {}
    marks: list[float] = []
    for _ in range(3000):
        sim.step()
        for roller, feature in touching(sim).items():
            assert features.setdefault(roller, feature) == feature, "a roller stays in its arc"
        turns = sim.joint_position("axle") / (2.0 * math.pi)
        if turns >= 1 + len(marks):
            marks.append(sim.joint_position("rail"))
        if len(marks) == 2:
            break
    # a step's way is 0.25 mm a thousandth of a turn
    assert marks[1] - marks[0] == pytest.approx(teeth * pitch, abs=0.005)
    arcs = [features[roller] for roller in sorted(features)]
    assert set(np.diff(arcs) % (2 * teeth)) == {2 * teeth - 2}, "roller after roller takes the next arc"


def test_worlds_of_sprockets_do_not_matter_to_each_other():
    alone, three = rack(), rack(3)
    for sim in (alone, three):
        sim.step(300)
    for name in ("body_x", "body_v", "body_omega"):
        rows = getattr(three.state, name).numpy()
        for world in range(3):
            np.testing.assert_array_equal(rows[world], getattr(alone.state, name).numpy()[0])


def test_momentum_is_kept():
    """Three balls and a sprocket, all free: what they exchange is equal and opposite, and along one line. Rounding of
    float32 velocities of 3 m/s, over 400 steps."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    wheel = builder.add_body("sprocket", mass=5.0, inertia=(0.2, 0.2, 0.3), omega=(0.1, -0.2, 6.0))
    builder.add_shape_sprocket(wheel, **PROFILE, material=sw.Material(friction=0.4))
    builder.add_shape_groove(wheel, radius=0.26, half_width=0.02)
    for k, (x, y, v) in enumerate([(0.24, 0.0, -1.0), (-0.05, 0.24, -2.0), (-0.2, -0.14, 1.5)]):
        ball = builder.add_body(f"ball{k}", mass=0.5, inertia=(1e-4, 1e-4, 1e-4), pose=sw.pose((x, y, 0.0)),
                                velocity=(v, 0.3 * v, 0.4))  # fmt: skip
        builder.add_shape_sphere(ball, radius=ROLLER, material=sw.Material(friction=0.8))
    sim = simulation(builder)
    mass = np.array([body.mass for body in builder.bodies])
    inertia = [np.asarray(body.inertia, float) for body in builder.bodies]

    def momenta() -> np.ndarray:
        x, v = sim.state.body_x.numpy()[0], sim.state.body_v.numpy()[0].astype(float)
        omega = sim.state.body_omega.numpy()[0].astype(float)
        spin = np.zeros(3)
        for k, place in enumerate(inertia):
            q = sim.state.body_rot.numpy()[0, k]
            turn = np.array([sw.core.rotation.rotate(q, axis) for axis in np.eye(3)]).T
            spin += turn @ place @ turn.T @ omega[k]
        return np.concatenate([mass @ v, (mass[:, None] * np.cross(x, v)).sum(axis=0) + spin])

    before, touched = momenta(), 0
    for _ in range(400):
        sim.step()
        touched += int(sim.contacts.contact_count.numpy()[0])
    assert touched > 20
    np.testing.assert_allclose(momenta(), before, atol=400 * 5.0 * 3.0 * 1.2e-7)


def test_a_groove_keeps_a_ball_in():
    """A load of ten times its weight along the axis, to one side and the other: it stays between the discs, to what a
    step moves it, and slides along them freely; beyond their radius it goes where it likes."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_shape_groove(sw.WORLD, radius=0.3, half_width=0.0255)
    ball = builder.add_body("ball", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), pose=sw.pose((-0.25, 0.0, 0.0)),
                            velocity=(0.4, 0.0, 0.0))  # fmt: skip
    builder.add_shape_sphere(ball, radius=0.0057, material=SLIPPERY)
    sim = simulation(builder)
    free, wrench = 0.0255 - 0.0057, sim.control.body_force.numpy()
    for k in range(130):
        wrench[0, 0, 2] = 100.0 * (-1.0) ** (k // 20)
        sim.control.body_force.assign(wrench)
        sim.step(10)
        assert abs(sim.state.body_x.numpy()[0, 0, 2]) < free + 1e-4
        assert sim.state.body_v.numpy()[0, 0, 0] == pytest.approx(0.4, abs=1e-6)
    sim.step(400)
    assert sim.state.body_x.numpy()[0, 0, 0] > 0.3
    assert abs(sim.state.body_x.numpy()[0, 0, 2]) > 2.0 * free


@pytest.mark.parametrize("in_grid", [False, True])
def test_they_meet_spheres_only(in_grid, monkeypatch):
    """Everything in one place: contacts are those of the ball alone, with a list of pairs and with a grid."""
    if in_grid:
        monkeypatch.setattr(model_module, "LISTED_PAIRS", 0)
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    kinds = ("sprocket", "groove", "box", "hull", "mesh", "field", "capsule", "cylinder", "cone", "ellipsoid", "ball")
    apart = dict(zip(kinds, range(len(kinds)), strict=True))
    bodies = {
        kind: builder.add_body(kind, mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.0, 0.0, 1e-3 * number)))
        for kind, number in apart.items()
    }
    narrow: dict[str, Any] = {"group": 1, "mask": 2 | 1}
    rest: dict[str, Any] = {"group": 2, "mask": 1}
    corners = np.vstack([np.eye(3), -np.eye(3)])
    builder.add_shape_sprocket(bodies["sprocket"], **PROFILE, **narrow, name="sprocket")
    builder.add_shape_groove(bodies["groove"], radius=0.3, half_width=0.05, **narrow, name="groove")
    builder.add_shape_plane(**rest)
    builder.add_shape_box(bodies["box"], half=(0.3, 0.3, 0.3), **rest)
    builder.add_shape_hull(bodies["hull"], 0.3 * corners, **rest)
    builder.add_shape_mesh(bodies["mesh"], 0.3 * corners, [[0, 1, 2], [3, 5, 4]], **rest)
    builder.add_shape_height_field(bodies["field"], np.zeros((3, 3)), size=(1.0, 1.0), **rest)
    for kind in ("capsule", "cylinder", "cone"):
        getattr(builder, f"add_shape_{kind}")(bodies[kind], radius=0.3, half_length=0.3, **rest)
    builder.add_shape_ellipsoid(bodies["ellipsoid"], half=(0.3, 0.2, 0.3), **rest)
    ball = builder.add_shape_sphere(bodies["ball"], radius=ROLLER, pose=sw.pose((0.2255, 0.0, 0.03)), **rest)
    sim = simulation(builder)
    assert (sim.model.topology.grid_buckets > 0) is in_grid
    sim.step()
    count = int(sim.contacts.contact_count.numpy()[0])
    first, second = (getattr(sim.contacts, name).numpy()[0, :count] for name in ("contact_shape0", "contact_shape1"))
    assert sorted(zip(first.tolist(), second.tolist(), strict=True)) == [(0, ball), (1, ball)]
