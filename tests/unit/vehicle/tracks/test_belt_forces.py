"""Forces of belts beside an independent float64 reference in random states, and beside closed forms."""

import math

import numpy as np
import pytest

from simwarp.core.rotation import matrix_of, rotate
from simwarp.soil.soil_parameters import soil_preset
from simwarp.vehicle.tracks.belt_path import way_around
from simwarp.vehicle.tracks.belt_tables_kernels import BeltParameter as P, WheelColumn as C
from tests.reference.belts import BeltForces, Shape
from tests.unit.vehicle.tracks.belt_vehicles import evaluate, vehicle

WHEEL = 1


def shape_of(belts, belt):
    p = belts.parameter.numpy()[0, belt].astype(float)
    rows = belts._tables.wheel.numpy()[belt].astype(float)
    return p, Shape(
        forward=float(belts._tables.forward.numpy()[belt]), hinges=rows[:, [C.HINGE_X, C.HINGE_Z]],
        arms=rows[:, [C.ARM_X, C.ARM_Z]], senses=rows[:, C.SENSE],
        radii=np.array([p[P.SPROCKET_RADIUS], *rows[:, C.RADIUS], p[P.IDLER_RADIUS]]),
        idler=p[[P.IDLER_X, P.IDLER_Z]], slide=p[[P.SLIDE_X, P.SLIDE_Z]], length=p[P.LENGTH], stretch=p[P.STRETCH],
        force=p[P.TENSIONER_FORCE], stiffness=p[P.TENSIONER_STIFFNESS], damping=p[P.TENSIONER_DAMPING],
        depth=p[P.DEPTH],
    )  # fmt: skip


def random_state(sim, parts, belts, rng, lower):
    """Puts the chassis near the ground, at any lean and motion, and the belts' memory anywhere near its usual."""
    builder, state = sim.model.builder, sim.state
    turn = rng.normal(size=3) * (0.05, 0.05, 1.0)
    q = np.array([*(0.5 * turn[:2]), math.sin(0.5 * turn[2]), math.cos(0.5 * turn[2])])
    q /= np.linalg.norm(q)
    for name, value in (
        ("body_x", np.array([*rng.normal(size=2) * 20.0, rng.uniform(0.8, 0.95) - lower])), ("body_rot", q),
        ("body_v", rng.normal(size=3) * (2.0, 0.3, 0.1)), ("body_omega", rng.normal(size=3) * 0.2),
    ):  # fmt: skip
        array = getattr(state, name).numpy().copy()
        array[0, parts.chassis] = value
        getattr(state, name).assign(array)
    x, qd = state.joint_x.numpy().copy(), state.joint_qd.numpy().copy()
    for side in (parts.left, parts.right):
        for arm in side.arms:
            x[0, builder.dof_start(arm)], qd[0, builder.dof_start(arm)] = rng.uniform(-0.25, 0.1), rng.normal()
        qd[0, builder.dof_start(side.sprocket)] = rng.normal() * 8.0
    state.joint_x.assign(x)
    state.joint_qd.assign(qd)
    memory = belts.memory
    for name, size in (("lift", 0.003), ("sinkage", 0.03)):
        memory[name].assign(np.abs(rng.normal(size=memory[name].shape)) * size)
    memory["shear"].assign(rng.normal(size=(*memory["shear"].shape, 2)) * 0.004)
    memory["loss_way"].assign(rng.uniform(-0.002, 0.002, size=(1, 2)))
    memory["bulge"].assign(rng.uniform(0.0, 0.002, size=(1, 2)))
    idlers = [
        shape_of(belts, belt)[1].solve(angles_of(sim, side), float(memory["bulge"].numpy()[0, belt]))
        for belt, side in enumerate((parts.left, parts.right))
    ]
    memory["idler"].assign(np.array([idlers]))


def angles_of(sim, side):
    dofs = [sim.model.builder.dof_start(arm) for arm in side.arms]
    return sim.state.joint_x.numpy()[0, dofs]


def expected(sim, parts, belts, belt, remembered, soil):
    """The reference of a belt on the plane z = 0."""
    builder, state = sim.model.builder, sim.state
    side = (parts.left, parts.right)[belt]
    p, shape = shape_of(belts, belt)
    rates = state.joint_qd.numpy()[0].astype(float)
    v, w = (getattr(state, name).numpy()[0, parts.chassis].astype(float) for name in ("body_v", "body_omega"))
    kinds = [getattr(belts._tables, name).numpy()[belt] for name in ("kind", "place", "share")]
    return BeltForces(
        shape=shape, law={name.name.lower(): float(p[name]) for name in P}, soil=soil, dt=sim.dt,
        x=state.body_x.numpy()[0, parts.chassis], axes=matrix_of(state.body_rot.numpy()[0, parts.chassis]), v=v, w=w,
        origin=side.origin, angles=angles_of(sim, side),
        rates=rates[[builder.dof_start(arm) for arm in side.arms]],
        speed=float(p[P.PITCH_RADIUS] * rates[builder.dof_start(side.sprocket)]),
        place=float(remembered["idler"][0, belt]), loss_way=float(remembered["loss_way"][0, belt]),
        lift=remembered["lift"][0, belt].astype(float), shear=remembered["shear"][0, belt].astype(float),
        sinkage=remembered["sinkage"][0, belt].astype(float),
        points=[(int(kind), int(at), float(share)) for kind, at, share in zip(*kinds, strict=True)],
    ).run()  # fmt: skip


@pytest.mark.parametrize("preset", [None, "soft", "clay"])
@pytest.mark.parametrize("seed", range(4))
def test_forces_are_those_of_the_reference(preset, seed):
    """Of 100 kN and more, made of lengths of some metres in float32 and springs of 1e6 N/m: 1e-6 m or some newtons of
    the tension, 1e-7 m or less of depths, which float64 carries; Newton's steps in soil leave less than 1e-3 of a load.
    The wheels' dampers add the tension's rate at 1.4e4 N·s/m."""
    rng = np.random.default_rng(seed)
    law = {"dry_loss": 0.02, "linear_loss": 0.003, "square_loss": 1e-3, "friction": 0.7}
    sim, parts, belts = vehicle(law=law, soil=preset)
    random_state(sim, parts, belts, rng, 0.0 if preset is None else 0.12)
    remembered = {name: array.numpy().copy() for name, array in belts.memory.items()}
    evaluate(sim, belts)
    joint_force = sim.control.element_joint_force.numpy()[0]
    total, moment = np.zeros(3), np.zeros(3)
    for belt, side in enumerate((parts.left, parts.right)):
        there = expected(sim, parts, belts, belt, remembered, None if preset is None else soil_preset(preset))
        force, torque, arms, shaft, tension = there.force, there.torque, there.arms, there.shaft, there.tension
        size = max(float(np.linalg.norm(force)), 1e4)
        assert belts.tension.numpy()[0, belt] == pytest.approx(tension, abs=10.0)
        np.testing.assert_allclose(belts.force.numpy()[0, belt], force, atol=1e-3 * size)
        np.testing.assert_allclose(belts.torque.numpy()[0, belt], torque, atol=2e-3 * size)
        dofs = [sim.model.builder.dof_start(arm) for arm in side.arms]
        np.testing.assert_allclose(joint_force[dofs], arms, atol=1e-3 * size)
        assert joint_force[sim.model.builder.dof_start(side.sprocket)] == pytest.approx(shaft, abs=1e-3 * size)
        total, moment = total + force, moment + torque
    assert np.abs(total).max() > 1e4, "the belts touch the ground"
    np.testing.assert_allclose(sim.control.element_force.numpy()[0, parts.chassis], total, atol=1e-3 * size)
    np.testing.assert_allclose(sim.control.element_torque.numpy()[0, parts.chassis], moment, atol=4e-3 * size)


def test_the_way_around_equal_wheels_is_the_hull_and_a_circle():
    """Circles of one radius: the polygon of their centres, and once around."""
    centers = np.array([[0.0, 0.0], [-1.0, -0.6], [-3.0, -0.7], [-4.0, -0.1]])
    length, along, turns = way_around(centers, np.full(4, 0.3))
    around = np.linalg.norm(np.roll(centers, -1, axis=0) - centers, axis=1).sum() + 2.0 * math.pi * 0.3
    assert length == pytest.approx(around, rel=1e-12)
    assert turns.sum() == pytest.approx(2.0 * math.pi, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0, rtol=1e-12)


def settled(seconds=4.0, **options):
    sim, parts, belts = vehicle(**options)
    sim.step(round(seconds / sim.dt))
    return sim, parts, belts


def imposed(sim, parts, yaw_rate, speed, left, right):
    """The chassis moves so, and the belts at such speeds, while forces are found."""
    omega, v = (getattr(sim.state, name).numpy().copy() for name in ("body_omega", "body_v"))
    q = sim.body_rotation("chassis")
    ahead = rotate(q, np.array([1.0, 0.0, 0.0]))
    ahead[2] = 0.0
    v[0, parts.chassis] = speed * ahead / np.linalg.norm(ahead)
    omega[0, parts.chassis] = (0.0, 0.0, yaw_rate)
    sim.state.body_omega.assign(omega)
    sim.state.body_v.assign(v)
    qd = np.zeros_like(sim.state.joint_qd.numpy())
    for side, belt_speed in ((parts.left, left), (parts.right, right)):
        radius = side.spec.sprocket.teeth * side.spec.shoe.pitch / (2.0 * math.pi)
        qd[0, sim.model.builder.dof_start(side.sprocket)] = belt_speed / radius
    sim.state.joint_qd.assign(qd)


def loads_and_places(sim, parts, belts):
    """(2, N) normal force of all points, and their places along the vehicle from its centre of mass [N, m]."""
    arm, force = belts.point_arm.numpy()[0], belts.point_force.numpy()[0]
    ahead = rotate(sim.body_rotation("chassis"), np.array([1.0, 0.0, 0.0]))
    return force[..., 2].astype(float), arm @ ahead


OFFSET = 1.0795
"""Of a track of the M113 [m]."""


def test_a_pivot_takes_the_moment_of_sliding_friction():
    """With belts that only slide sideways, M = mu sum N |x|; for loads spread evenly over a length L that is
    mu W L / 4. The M113's are heaped under three wheels, so that L is what their mean way from the middle makes it. A
    point that passed the middle by less than half the way to the one before still slides as that: 5 % of the moment."""
    sim, parts, belts = settled()
    rate = 0.5
    imposed(sim, parts, rate, 0.0, -rate * OFFSET, rate * OFFSET)
    evaluate(sim, belts, times=2000, dt=1e-3)  # half a radian: every point has slid 5 mm but one that stands near x = 0
    load, x = loads_and_places(sim, parts, belts)
    moment = -belts.torque.numpy()[0].sum(axis=0)[2]
    assert moment == pytest.approx(0.8 * np.sum(load * np.abs(x)), rel=0.05)
    assert np.abs(belts.traction.numpy()[0]).max() < 0.05 * 0.8 * load.sum()


@pytest.mark.parametrize("radius", [15.0, 40.0])
def test_a_turn_takes_less_moment_the_wider_it_is(radius):
    """Below the limit of friction, a point at x has come from the belt's beginning at x0, where it met the ground,
    and has slid (x0² - x²) / (2 R) sideways: M = mu sum N (x0² - x²) / (2 R K) x, if K is so long that nothing slides.
    The sum over points is the trapezoidal rule."""
    speed, length = 3.0, 0.5
    sim, parts, belts = settled(law={"shear_length": length, "shear_damping_time": 0.0})
    rate = speed / radius
    imposed(sim, parts, rate, speed, speed - rate * OFFSET, speed + rate * OFFSET)
    evaluate(sim, belts, times=4000, dt=1e-3)
    load, x = loads_and_places(sim, parts, belts)
    expected_moment = 0.0
    for belt in range(2):
        first = 0.0
        for point in range(1, load.shape[1]):
            if load[belt, point - 1] == 0.0:  # it meets the ground anew from here on
                first = x[belt, point - 1]
            slid = (first**2 - x[belt, point] ** 2) / (2.0 * (radius - (OFFSET if belt == 0 else -OFFSET)))
            expected_moment += 0.8 * load[belt, point] * slid / length * x[belt, point]
    moment = -belts.torque.numpy()[0].sum(axis=0)[2]
    assert moment == pytest.approx(expected_moment, rel=0.02)


def test_soil_bears_as_bekker_says():
    """Under a wheel that does not sink into the belt, pressure is (k_c / b + k_phi) z^n at the depth of the belt, until
    the soil is let go; then it is elastic, and gone after a small part of the depth."""
    soil = soil_preset("clay")
    sim, parts, belts = vehicle(soil=soil, law={"wheel_sink": 0.0, "width": 0.4})
    wheels = belts._tables.kind.numpy()[0] == WHEEL
    x = sim.state.body_x.numpy().copy()
    top = x[0, parts.chassis, 2] - 0.62 + 0.215 + 0.335 + 0.03  # belts touch the ground at their wheels
    for depth in (0.02, 0.05, 0.08, 0.0795):
        x[0, parts.chassis, 2] = top - depth
        sim.state.body_x.assign(x)
        evaluate(sim, belts, times=30)
    spacing = np.linalg.norm(np.diff(belts.point_arm.numpy()[0, 0], axis=0), axis=1)
    force = belts.point_force.numpy()[0, 0, wheels, 2]
    area = 0.4 * 0.5 * (np.append(spacing, 0.0) + np.insert(spacing, 0, 0.0))[wheels]
    most = (soil.k_c / 0.4 + soil.k_phi) * 0.08**soil.exponent
    pressure = most - soil.elastic * 0.0005
    assert pressure > 0.0
    np.testing.assert_allclose(force[1:-1], (area * pressure)[1:-1], rtol=2e-2)  # 1e-6 m of 1e8 Pa/m is 100 Pa of 2e4
    x[0, parts.chassis, 2] = top - 0.077
    sim.state.body_x.assign(x)
    evaluate(sim, belts, times=30)
    assert belts.point_force.numpy()[0, 0, wheels, 2][1:-1].max() == 0.0  # 2 mm of the depth were elastic
