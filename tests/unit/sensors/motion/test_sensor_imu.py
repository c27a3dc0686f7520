"""Inertial units: at rest, in free fall, on a turntable, tumbling; means over the window, worlds of their own."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.noise import BoundedDrift, NormalNoise, Quantisation
from tests.reference.sensors.inertial import angular_velocity, specific_force
from tests.unit.sensors.sensor_probe import ball

G = 9.81
DT = 0.001
EVERY = ImuConfig(schedule=Schedule(rate=1000.0))
TILT = np.array([0.3, -0.2, 0.5, 0.7]) / np.linalg.norm([0.3, -0.2, 0.5, 0.7])


def turntable(offset: float = 0.0, **drive) -> tuple[sw.Model, int]:
    """A body whose centre of mass turns about z at a distance."""
    builder = sw.ModelBuilder()
    body = builder.add_body("table", mass=2.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((offset, 0.0, 0.0)))
    builder.add_joint_revolute("axis", sw.WORLD, body, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 0.0), **drive)
    return builder.finalize(1, "cpu"), body


def run(sim: sw.Simulation, imu: Imu, steps: int) -> np.ndarray:
    """(steps, channels) what world 0 reads after each step."""
    found = []
    for _ in range(steps):
        sim.step()
        found.append(imu.data.numpy()[0].copy())
    return np.array(found)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), tuple(TILT)])
@pytest.mark.parametrize("body", [sw.WORLD, "post"])
def test_at_rest_it_reads_gravity_upwards(turn, body):
    builder = sw.ModelBuilder()
    post = builder.add_body("post", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((1.0, 2.0, 3.0), turn))
    builder.add_joint_fixed("held", sw.WORLD, post)
    model = builder.finalize(2, "cpu")
    imu = Imu(model, Mount(body, sw.pose((0.1, 0.2, 0.3), turn)), EVERY)
    sim = sw.Simulation(model, DT, sensors=[imu])
    axes = matrix_of(np.array(turn)) @ matrix_of(np.array(turn)) if body == "post" else matrix_of(np.array(turn))
    up = axes.T @ [0.0, 0.0, G]
    assert imu.data.numpy()[0] == pytest.approx([*up, 0.0, 0.0, 0.0], abs=2e-6)  # a float32 of 9.81
    found = run(sim, imu, 20)
    # the solver's velocities of a fixed body are zero to the last bit or so: 1e-9 m/s over 1 ms
    assert found[:, :3] == pytest.approx(np.tile(up, (20, 1)), abs=1e-5)
    assert np.abs(found[:, 3:]).max() < 1e-7


def test_in_free_fall_it_reads_nothing():
    model = ball(1)
    imu = Imu(model, Mount("ball", sw.pose((0.2, 0.0, 0.1))), EVERY)
    sim = sw.Simulation(model, DT, sensors=[imu])
    # the velocity gains 9.81 mm/s a step, kept to 1e-10 m/s by the compensated sum
    assert np.abs(run(sim, imu, 500)[:, :3]).max() < 2e-6


@pytest.mark.parametrize(("offset", "projection"), [(0.0, 0), (0.5, 0), (0.5, 1)])
def test_on_a_turntable_it_reads_omega_and_omega_squared_r(offset, projection):
    model, body = turntable(offset)
    radius, omega = 0.3 + offset, 7.0
    imu = Imu(model, Mount(body, sw.pose((0.3, 0.0, 0.0))), EVERY)
    sim = sw.Simulation(model, DT, sensors=[imu], solver=sw.SolverOptions(position_projection=projection))
    sim.set_joint_state(None, None, [[omega]])
    found = run(sim, imu, 400)[5:]  # the first velocities are those of the start, not of the solver
    spin = found[:, 5]
    assert np.abs(spin - omega).max() < 2e-4
    # (omega dt)²/24 of omega² r; the solver works in float32, of whose last place (5e-7 of 5.6 m/s) two velocities may
    # be off by half each, over 1 ms, in the joint's feedback once more
    assert found[:, 0] == pytest.approx(-(spin**2) * radius, rel=5e-6, abs=1.5e-3)
    assert np.abs(found[:, 1]).max() < 1.5e-3
    assert found[:, 2] == pytest.approx(np.full(len(found), G), abs=1e-5)
    assert np.abs(found[:, 3:5]).max() < 1e-6


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), tuple(TILT)])
def test_on_an_accelerating_turntable_it_reads_alpha_r_too(turn):
    rate = 3.0  # rad/s², prescribed
    times = np.linspace(0.0, 4.0, 81)
    drive = sw.PrescribedSpeed(table=(times.tolist(), (rate * times).tolist()))
    model, body = turntable(0.2, drive=drive)
    imu = Imu(model, Mount(body, sw.pose((0.3, 0.1, 0.0), turn)), EVERY)
    sim = sw.Simulation(model, DT, sensors=[imu])
    found = run(sim, imu, 2000)
    axes = matrix_of(np.array(turn))
    arm = np.array([0.5, 0.1])
    for step in (500, 1000, 1999):
        omega = axes @ found[step, 3:]
        force = axes @ found[step, :3]
        assert omega == pytest.approx([0.0, 0.0, rate * step * DT], abs=2 * rate * DT)
        # the reading belongs to the start of its sub-step: omega is half a step on, 1.5e-3 rad/s of 6
        radial = -(omega[2] ** 2) * arm
        tangential = rate * np.array([-arm[1], arm[0]])
        # omega² r changes by 2 omega alpha dt r = 2e-2 in a sub-step
        assert force == pytest.approx([*(radial + tangential), G], abs=2e-2)


def test_tumbling_it_agrees_with_second_differences_of_positions():
    builder = sw.ModelBuilder()
    builder.add_body(
        "stone", mass=1.0, inertia=(0.4, 0.9, 1.1), velocity=(3.0, -2.0, 4.0), omega=(4.0, 3.0, -2.0),
        pose=sw.pose((1000.0, -500.0, 20.0), TILT),
    )  # fmt: skip
    model = builder.finalize(1, "cpu")
    point, turn = np.array([0.3, -0.2, 0.4]), np.array([0.1, 0.7, -0.1, 0.7])
    turn /= np.linalg.norm(turn)
    imu = Imu(model, Mount(0, sw.pose(point, turn)), EVERY)
    sim = sw.Simulation(model, DT, sensors=[imu])
    x, q = [sim.state.body_x.numpy()[0, 0].copy()], [sim.state.body_rot.numpy()[0, 0].copy()]
    found = []
    for _ in range(300):
        sim.step()
        x.append(sim.state.body_x.numpy()[0, 0].copy())
        q.append(sim.state.body_rot.numpy()[0, 0].copy())
        found.append(imu.data.numpy()[0].copy())
    reading = np.array(found)
    reference = specific_force(np.array(x), np.array(q), point, turn, np.array([0.0, 0.0, -G]), DT)
    # (omega dt)² ~ 3e-5 of omega² r ~ 16 m/s²; positions of 1 km in float64 add 1e-13 / dt² = 1e-7
    assert reading[1:, :3] == pytest.approx(reference, abs=1e-3)
    assert reading[:, 3:] == pytest.approx(angular_velocity(np.array(q), turn, DT), abs=2e-6)


@pytest.mark.parametrize("window", [1, 4, 10])
def test_a_frame_is_the_mean_over_its_window(window):
    model, body = turntable(0.0, damping=1.0)
    fast = Imu(model, Mount(body, sw.pose((0.3, 0.0, 0.0))), EVERY, name="fast")
    slow = Imu(
        model, Mount(body, sw.pose((0.3, 0.0, 0.0))),
        ImuConfig(schedule=Schedule(rate=100.0, window=window * DT, lag=0.003)), name="slow",
    )  # fmt: skip
    sim = sw.Simulation(model, DT, sensors=[fast, slow])
    sim.set_joint_state(None, None, [[9.0]])
    readings = []
    for step in range(1, 101):
        sim.step()
        readings.append(fast.data.numpy()[0].copy())
        done = (step - 3 - window) // 10 * 10 + window  # the latest completed window's end
        if step >= 3 + window:
            # sums in float64, results in float32: 1e-7 of 24
            assert slow.data.numpy()[0] == pytest.approx(np.mean(readings[done - window : done], axis=0), abs=4e-6)


def test_parts_alone_are_columns_of_both():
    model, body = turntable(0.1)
    mount = Mount(body, sw.pose((0.2, 0.1, 0.0), TILT))
    units = [
        Imu(model, mount, ImuConfig(schedule=Schedule(rate=500.0), outputs=outputs), name=str(outputs))
        for outputs in (
            ("accelerometer", "gyroscope"),
            ("accelerometer",),
            ("gyroscope",),
            ("gyroscope", "accelerometer"),
        )
    ]
    sim = sw.Simulation(model, DT, sensors=units)
    sim.set_joint_state(None, None, [[5.0]])
    for _ in range(11):
        sim.step()
    both, force, rate, swapped = (unit.data.numpy()[0] for unit in units)
    assert np.array_equal(both, [*force, *rate])
    assert np.array_equal(swapped, [*rate, *force])


NOISE = ImuConfig(
    schedule=Schedule(rate=250.0, window=0.002, lag=0.006, phase="random"),
    accelerometer_noise=(NormalNoise(std=(0.1, 0.2, 0.3)), BoundedDrift(std=0.5, time=0.1)),
    gyroscope_noise=(NormalNoise(std=0.05, mean=0.3), Quantisation(step=0.01)),
)


def noisy_run(worlds: int, disturbed: int | None = None) -> np.ndarray:
    """(60, worlds, 12) data and truth after each step; one world may be thrown about and reset in between."""
    model = ball(worlds)
    imu = Imu(model, Mount("ball", sw.pose((0.1, 0.0, 0.0))), NOISE, seed=5)
    sim = sw.Simulation(model, DT, sensors=[imu])
    found = []
    for step in range(60):
        if disturbed is not None and step in (10, 30):
            mask = np.arange(worlds) == disturbed
            sim.state.body_omega.assign(np.where(mask[:, None, None], 20.0, sim.state.body_omega.numpy()))
            sim.reset(mask & (step == 30))
        sim.step()
        found.append(np.concatenate([imu.data.numpy(), imu.truth.numpy()], axis=1))
    return np.array(found)


def test_worlds_do_not_depend_on_one_another():
    alone, disturbed, few = noisy_run(6), noisy_run(6, disturbed=3), noisy_run(2)
    others = [0, 1, 2, 4, 5]
    assert np.array_equal(alone[:, others], disturbed[:, others])
    assert not np.array_equal(alone[:, 3], disturbed[:, 3])
    assert np.array_equal(alone[:, :2], few)
    # worlds have numbers of their own
    assert np.abs(np.diff(alone[-1, :, 0])).min() > 1e-4


def test_a_snapshot_repeats_the_noise_bit_by_bit():
    model = ball(3)
    imu = Imu(model, Mount("ball", sw.pose((0.1, 0.0, 0.0))), NOISE, seed=5)
    sim = sw.Simulation(model, DT, sensors=[imu])
    for _ in range(23):
        sim.step()
    kept = sim.snapshot()
    runs = []
    for _ in range(2):
        sim.restore(kept)
        found = [imu.data.numpy().copy()]
        for step in range(40):
            sim.step()
            if step == 20:
                sim.reset(np.array([True, False, True]))
            found += [imu.data.numpy().copy(), imu.timestamp.numpy().copy()]
        runs.append(found)
    assert all(np.array_equal(a, b) for a, b in zip(*runs, strict=True))


def test_every_world_may_have_its_own_place_and_noise():
    builder = sw.ModelBuilder()
    builder.add_body("table", mass=2.0, inertia=(1.0, 1.0, 1.0), omega=(0.0, 0.0, 5.0))
    model = builder.finalize(3, "cpu")
    noise = ImuConfig(schedule=Schedule(rate=1000.0), gyroscope_noise=(NormalNoise(std=0.0),))
    imu = Imu(model, Mount(0), noise, randomised=True)
    sim = sw.Simulation(model, DT, sensors=[imu])
    imu.mount.position[:] = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.4, 0.0, 0.0]])
    imu.gyroscope_noise.parameter(0, "mean")[:] = np.array([[0.0] * 3, [1.0] * 3, [0.0, 0.0, 2.0]])
    for _ in range(5):
        sim.step()
    # 25 r towards the axis, to (omega dt)²/24
    assert imu.data.numpy()[:, 0] == pytest.approx([-2.5, -5.0, -10.0], rel=1e-5)
    assert imu.data.numpy()[:, 5] == pytest.approx([5.0, 6.0, 7.0], abs=1e-6)
    assert imu.truth.numpy()[:, 5] == pytest.approx([5.0] * 3, abs=1e-6)


def test_a_unit_that_is_mounted_elsewhere_reads_what_is_there():
    """Moving the mount between steps is no motion: not even the first frame may show a speed that was never there."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("table", mass=2.0, inertia=(1.0, 1.0, 1.0), omega=(0.0, 0.0, 5.0))
    model = builder.finalize(3, "cpu")
    imu = Imu(model, Mount(0, sw.pose((0.1, 0.0, 0.0))), EVERY, randomised=True)
    sim = sw.Simulation(model, DT, sensors=[imu])
    for _ in range(4):
        sim.step()
    imu.mount.position[1] = np.array([0.0, 0.4, 0.0])
    imu.mount.rotation[2] = np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
    sim.step()
    # 25 r towards the axis, to (omega dt)²/24; a jump of 0.4 m would be read as 5 x 0.4 / 0.001 = 2000 m/s²
    expected = [[-2.5, 0.0, 0.0], [0.0, -10.0, 0.0], [0.0, 2.5, 0.0]]
    assert imu.data.numpy()[:, :3] == pytest.approx(np.array(expected), abs=2e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mount": Mount("hull")}, "sensor 'imu': model has no body 'hull'; did you mean 'ball'"),
        ({"mount": Mount(3)}, r"sensor 'imu': body must be WORLD \(-1\), an index below 1 or a name, got 3"),
        ({"mount": 0}, "sensor 'imu': mount must be a Mount, got 0"),
        (
            {"outputs": ("gyro",)},
            r"ImuConfig: outputs\[0\] must be one of 'accelerometer', 'gyroscope'",
        ),
        ({"outputs": ()}, r"ImuConfig: outputs must be one or more, got \(\)"),
        (
            {"accelerometer_noise": (NormalNoise(std=(0.1, 0.2)),)},
            "sensor 'imu': accelerometer_noise: std of NormalNoise must be one number or 3, got ",
        ),
        ({"gyroscope_noise": (0.1,)}, r"ImuConfig: gyroscope_noise\[0\] must be an object with a kind, got 0\.1"),
    ],
)
def test_mistakes_are_one_clear_error(options, message):
    model = ball(1)
    mount = options.pop("mount", Mount("ball"))

    def make() -> Imu:
        return Imu(model, mount, ImuConfig(**options))

    with pytest.raises(sw.ModelError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
