"""Force sensors: weights, impacts, stacks and beams; what is felt at rest, on a turntable, and world by world."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.core.types import Material
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.force_sensor import ContactSensor, ContactSensorConfig, LoadCell, LoadCellConfig
from simwarp.sensors.noise import BoundedDrift, NormalNoise, Quantisation, Saturation
from tests.reference.sensors.forces import body_force, in_axes, means

G = 9.81
DT = 0.001
EVERY = Schedule(rate=1000.0)
TIGHT = sw.SolverOptions(tolerance=1e-6)
TILT = np.array([0.3, -0.2, 0.5, 0.7]) / np.linalg.norm([0.3, -0.2, 0.5, 0.7])


def boxes(worlds: int = 1, masses: tuple[float, ...] = (3.0,)) -> sw.Model:
    """A pile of cubes of 0.2 m on the ground, the lowest first."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    for index, mass in enumerate(masses):
        at = sw.pose((0.0, 0.0, 0.1 + 0.2 * index))
        builder.add_solid(f"box{index}", "box", (0.1, 0.1, 0.1), mass=mass, pose=at)
    builder.add_body("ghost", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((5.0, 0.0, 1000.0)))
    return builder.finalize(worlds, "cpu")


def simulate(model: sw.Model, *sensors, **options) -> sw.Simulation:
    return sw.Simulation(model, DT, sensors=sensors, solver=TIGHT, **options)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), tuple(TILT)])
def test_a_box_at_rest_is_pushed_by_its_weight(turn):
    model = boxes()
    felt = ContactSensor(model, Mount("box0", sw.pose(rotation=turn)), ContactSensorConfig(schedule=EVERY))
    sim = simulate(model, felt)
    # no step has been made: nothing is known of contacts
    assert felt.data.numpy().tolist() == [[0.0, 0.0, 0.0]]
    assert felt.touch.numpy().tolist() == [0]
    for _ in range(300):
        sim.step()
    # the solver's tolerance of 1e-6 m/s on 3 kg over 1 ms: 3e-3 N
    assert matrix_of(np.array(turn)) @ felt.data.numpy()[0] == pytest.approx([0.0, 0.0, 3.0 * G], abs=5e-3)
    assert felt.touch.numpy().tolist() == [1]
    assert np.array_equal(felt.data.numpy(), felt.truth.numpy())


def test_in_a_pile_the_forces_of_both_sides_add_up():
    model = boxes(masses=(3.0, 2.0, 1.0))
    felt = [ContactSensor(model, Mount(f"box{k}"), ContactSensorConfig(schedule=EVERY), name=f"{k}") for k in range(3)]
    sim = simulate(model, *felt)
    for _ in range(400):
        sim.step()
    for sensor, mass in zip(felt, (3.0, 2.0, 1.0), strict=True):
        assert sensor.data.numpy()[0] == pytest.approx([0.0, 0.0, mass * G], abs=0.02)


def test_an_impact_is_the_change_of_momentum_over_the_window():
    """A ball falls from 0.2 m and stays: the force sums up to what gravity gave, window by window."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    builder.add_solid("ball", "sphere", 0.1, mass=2.0, pose=sw.pose((0.0, 0.0, 0.3)), material=Material())
    model = builder.finalize(1, "cpu")
    config = ContactSensorConfig(schedule=Schedule(rate=10.0, window=0.1, lag=0.01))
    mean = ContactSensor(model, Mount("ball"), config, name="mean")
    each = ContactSensor(model, Mount("ball"), ContactSensorConfig(schedule=EVERY), name="each")
    sim = simulate(model, mean, each)
    forces = []
    for _ in range(410):
        sim.step()
        forces.append(each.data.numpy()[0].astype(float))
        if len(forces) % 100 == 10 and len(forces) > 110:
            window = np.mean(forces[len(forces) - 110 : len(forces) - 10], axis=0)
            assert mean.data.numpy()[0] == pytest.approx(window, rel=1e-6, abs=1e-5)
    total = np.sum(forces, axis=0) * DT
    # all that gravity gave in 0.41 s was taken
    assert total == pytest.approx([0.0, 0.0, 2.0 * G * 0.41], abs=1e-4)
    assert np.max(forces) > 50.0 * 2.0 * G


@pytest.mark.parametrize(("window", "lag"), [(0, 0), (4, 3), (10, 12)])
def test_a_tumbling_box_feels_what_the_reference_adds_up(window, lag):
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    box = builder.add_solid(
        "box", "box", (0.1, 0.15, 0.2), mass=1.0, pose=sw.pose((0.0, 0.0, 0.25), TILT), velocity=(1.0, 0.0, -1.0),
        omega=(3.0, 9.0, -4.0),
    )  # fmt: skip
    model = builder.finalize(1, "cpu")
    schedule = Schedule(rate=100.0, window=window * DT, lag=lag * DT)
    felt = ContactSensor(model, Mount(box, sw.pose(rotation=TILT)), ContactSensorConfig(schedule=schedule))
    sim = simulate(model, felt)
    owners = model.topology.shape_body.numpy()
    q, forces, found = [], [np.zeros(3)], [felt.data.numpy()[0].copy()]
    for _ in range(250):
        q.append(sim.state.body_rot.numpy()[0, box].copy())
        sim.step()
        contacts, count = sim.contacts, int(sim.contacts.contact_count.numpy()[0])
        pairs = [owners[getattr(contacts, f"contact_shape{side}").numpy()[0, :count]] for side in (0, 1)]
        total = body_force(box, pairs[0], pairs[1], contacts.contact_force_w.numpy()[0, :count])
        forces.append(in_axes(q[-1], TILT, total))
        found.append(felt.data.numpy()[0].copy())
    expected = means(np.array(forces), 10, window, lag)
    assert np.linalg.norm(expected, axis=1).max() > 5.0
    # float32 of forces of some 100 N
    assert np.array(found) == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_touch_is_told_by_the_measured_force():
    n = 400
    model = boxes(n)
    weight = 3.0 * G
    config = ContactSensorConfig(schedule=EVERY, threshold=weight, noise=(NormalNoise(std=(0.0, 0.0, 2.0)),))
    noisy = ContactSensor(model, Mount("box0"), config, name="noisy")
    config = ContactSensorConfig(schedule=EVERY, threshold=weight + 1.0)
    heavy = ContactSensor(model, Mount("box0"), config, name="heavy")
    config = ContactSensorConfig(schedule=EVERY, noise=(Saturation(upper=20.0), Quantisation(step=8.0)))
    cut = ContactSensor(model, Mount("box0"), config, name="cut")
    sim = simulate(model, noisy, heavy, cut)
    for _ in range(50):
        sim.step()
    values = noisy.data.numpy()[:, 2].astype(float)
    assert values.mean() == pytest.approx(weight, abs=5.0 * 2.0 / math.sqrt(n))
    assert values.std() == pytest.approx(2.0, rel=5.0 / math.sqrt(2.0 * n))
    assert np.array_equal(noisy.touch.numpy() == 1, np.linalg.norm(noisy.data.numpy(), axis=1) >= np.float32(weight))
    assert 0.3 < noisy.touch.numpy().mean() < 0.7
    assert not heavy.touch.numpy().any()
    assert (cut.data.numpy() == [0.0, 0.0, 24.0]).all()  # 20 N is nearest to 3 steps, halves up
    assert cut.touch.numpy().all()


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), tuple(TILT)])
def test_a_clamped_beam_carries_its_weight_and_its_moment(turn):
    builder = sw.ModelBuilder()
    beam = builder.add_body("beam", mass=2.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.7, 0.0, 1.0)))
    builder.add_joint_fixed("clamp", sw.WORLD, beam, anchor=(0.0, 0.0, 1.0))
    model = builder.finalize(2, "cpu")
    cell = LoadCell(model, "clamp", LoadCellConfig(schedule=EVERY), rotation=turn)
    sim = simulate(model, cell, joint_reactions=True)
    assert not cell.data.numpy().any()
    for _ in range(20):
        sim.step()
    axes = matrix_of(np.array(turn))
    force, torque = (axes @ part for part in np.split(cell.data.numpy()[1].astype(float), 2))
    assert force == pytest.approx([0.0, 0.0, 2.0 * G], abs=1e-3)
    # the clamp holds the weight at 0.7 m: r x F about the anchor
    assert torque == pytest.approx([0.0, -2.0 * G * 0.7, 0.0], abs=1e-3)


def test_a_hinge_pulls_what_turns_about_it():
    """m omega² r towards the axis, in axes that turn along."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    bob = builder.add_body("bob", mass=2.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.5, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", sw.WORLD, bob, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 0.0))
    model = builder.finalize(1, "cpu")
    cell = LoadCell(model, 0, LoadCellConfig(schedule=EVERY))
    sim = simulate(model, cell, joint_reactions=True)
    sim.set_joint_state(None, None, [[6.0]])
    for _ in range(300):
        sim.step()
    # (omega dt)² / 24 of it; velocities of 3 m/s are rounded in float32 to 2e-7 m/s, over 1 ms
    assert cell.data.numpy()[0] == pytest.approx([-2.0 * 36.0 * 0.5, 0.0, 0.0, 0.0, 0.0, 0.0], abs=2e-3)


NOISY = Schedule(rate=250.0, window=0.002, lag=0.006, phase="random")


def noisy_run(worlds: int, disturbed: int | None = None) -> np.ndarray:
    """(40, worlds, 10) data, truth and touch after each step; one world may be pushed and reset in between."""
    model = boxes(worlds, masses=(3.0, 1.0))
    noise = (NormalNoise(std=0.1), BoundedDrift(std=0.3, time=0.02))
    felt = ContactSensor(model, Mount("box0", sw.pose(rotation=TILT)), ContactSensorConfig(schedule=NOISY, noise=noise))
    plain = ContactSensor(model, Mount("box1"), ContactSensorConfig(schedule=NOISY, threshold=9.0), name="plain")
    sim = simulate(model, felt, plain)
    found = []
    for step in range(40):
        if disturbed is not None and step in (10, 25):
            mask = np.arange(worlds) == disturbed
            sim.state.body_v.assign(np.where(mask[:, None, None], 0.5, sim.state.body_v.numpy()))
            sim.reset(mask & (step == 25))
        sim.step()
        arrays = [a.numpy() for sensor in (felt, plain) for a in (sensor.data, sensor.truth)]
        found.append(np.concatenate([*arrays, plain.touch.numpy()[:, None]], axis=1))
    return np.array(found)


def test_worlds_do_not_depend_on_one_another():
    alone, disturbed, few = noisy_run(6), noisy_run(6, disturbed=3), noisy_run(2)
    others = [0, 1, 2, 4, 5]
    assert np.array_equal(alone[:, others], disturbed[:, others])
    assert not np.array_equal(alone[:, 3], disturbed[:, 3])
    assert np.array_equal(alone[:, :2], few)
    assert np.array_equal(alone, noisy_run(6))
    assert np.abs(np.diff(np.sort(alone[-1, :, 0]))).min() > 0.0


def test_a_snapshot_repeats_the_readings_bit_by_bit():
    model = boxes(2)
    noise = (NormalNoise(std=0.1), BoundedDrift(std=0.3, time=0.02))
    felt = ContactSensor(model, Mount("box0"), ContactSensorConfig(schedule=NOISY, noise=noise, threshold=29.4))
    sim = simulate(model, felt)
    for _ in range(13):
        sim.step()
    kept, runs = sim.snapshot(), []
    for _ in range(2):
        sim.restore(kept)
        found = []
        for _ in range(30):
            sim.step()
            found.append([*felt.data.numpy().ravel(), *felt.touch.numpy(), *felt.timestamp.numpy()])
        runs.append(found)
    assert runs[0] == runs[1]


def test_every_world_may_have_its_own_axes_and_noise():
    builder = sw.ModelBuilder()
    post = builder.add_body("post", mass=1.0, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_fixed("foot", sw.WORLD, post)
    model = builder.finalize(3, "cpu")
    config = LoadCellConfig(schedule=EVERY, noise=(NormalNoise(std=0.0),), torque_noise=(NormalNoise(std=0.0),))
    cell = LoadCell(model, "foot", config, randomised=True)
    sim = simulate(model, cell, joint_reactions=True)
    cell.mount.rotation[1] = np.array([1.0, 0.0, 0.0, 0.0])
    cell.noise.parameter(0, "mean")[2] = 1.5
    cell.torque_noise.parameter(0, "mean")[2, 1] = -2.5
    for _ in range(10):
        sim.step()
    expected = [[0.0, 0.0, G, 0.0, 0.0, 0.0], [0.0, 0.0, -G, 0.0, 0.0, 0.0], [1.5, 1.5, G + 1.5, 0.0, -2.5, 0.0]]
    assert cell.data.numpy() == pytest.approx(np.array(expected), abs=1e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda m: ContactSensor(m, Mount("boxx0")),
            "sensor 'contact': model has no body 'boxx0'; did you mean 'box0'",
        ),
        (
            lambda m: ContactSensor(m, Mount()),
            "sensor 'contact': body must have a shape, got -1; add one with add_shape_",
        ),
        (lambda m: ContactSensor(m, Mount("ghost")), "sensor 'contact': body must have a shape, got 'ghost'"),
        (
            lambda m: ContactSensorConfig(threshold=-1.0),
            "ContactSensorConfig: threshold must be zero or positive, got -1.0; give newtons, 0 for any force",
        ),
        (lambda m: LoadCell(m, "clamp"), "sensor 'load_cell': model has no joint 'clamp'"),
        (lambda m: LoadCell(m, 7), "sensor 'load_cell': joint must be a name or an index below 1, got 7; take what"),
        (
            lambda m: simulate(m, LoadCell(m, "weld")),
            "sensor 'load_cell': reactions must be recorded",
        ),
        (
            lambda m: LoadCell(m, 0, LoadCellConfig(torque_noise=(NormalNoise(std=(1.0, 2.0)),))),
            "sensor 'load_cell': torque_noise: std of NormalNoise must be one number or 3, got ",
        ),
    ],
)
def test_mistakes_are_one_clear_error(make, message):
    builder = sw.ModelBuilder()
    box = builder.add_solid("box0", "box", (0.1, 0.1, 0.1), mass=1.0)
    builder.add_body("ghost", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_fixed("weld", sw.WORLD, box)
    model = builder.finalize(1, "cpu")
    with pytest.raises(sw.ModelError) as caught:
        make(model)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
