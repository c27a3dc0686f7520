"""Encoders, tachometers, speedometers: a turntable, a rolling wheel, a reference, counts, lags, worlds of their own."""

import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import Material
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.encoders import (
    Encoder,
    EncoderConfig,
    Speedometer,
    SpeedometerConfig,
    Tachometer,
    TachometerConfig,
)
from simwarp.sensors.noise import BoundedDrift, NormalNoise, Quantisation, Saturation
from simwarp.sensors.presets import load_sensor
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.vehicle import PER_WORLD, VEHICLE_SOLVER, Vehicle
from tests.reference.sensors.encoders import Encoder as ReferenceStep
from tests.reference.sensors.sensor_noise import Stage, frame_key

DT = 0.001
EVERY = Schedule(rate=1000.0)


def mechanism(worlds: int = 1) -> sw.Model:
    """A hinge about z at (0.5, 0, 0), a slide along x, and a shaft; nothing brakes them."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    table = builder.add_body("table", mass=2.0, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_revolute("hinge", sw.WORLD, table, axis=(0.0, 0.0, 1.0))
    sledge = builder.add_body("sledge", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 2.0, 0.0)))
    builder.add_joint_prismatic("slide", sw.WORLD, sledge, axis=(1.0, 0.0, 0.0))
    builder.add_shaft("crank", inertia=0.5)
    arm = builder.add_body("arm", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 4.0, 0.0)))
    builder.add_joint_spherical("shoulder", sw.WORLD, arm, anchor=(0.0, 4.0, 0.0))
    return builder.finalize(worlds, "cpu")


def simulate(model: sw.Model, rates: Any, *sensors, **options) -> sw.Simulation:
    """The mechanism with given rates of hinge, slide and crank in every world."""
    sim = sw.Simulation(model, DT, sensors=sensors, **options)
    rows = np.zeros((model.world_count, model.dof_count))
    rows[:, :3] = rates
    sim.set_joint_state(None, None, rows)
    return sim


def run(sim: sw.Simulation, steps: int, *sensors) -> list[np.ndarray]:
    """(steps + 1, channels) of world 0 for each sensor, the frame of the beginning first."""
    found = [[sensor.data.numpy()[0].copy()] for sensor in sensors]
    for _ in range(steps):
        sim.step()
        for rows, sensor in zip(found, sensors, strict=True):
            rows.append(sensor.data.numpy()[0].copy())
    return [np.array(rows, np.float64) for rows in found]


def test_a_turntable_in_all_its_readings():
    model, omega = mechanism(), 7.0
    config: Any = {"schedule": EVERY}
    position = Encoder(model, "hinge", EncoderConfig(**config), name="position")
    geared = Encoder(model, "hinge", EncoderConfig(ratio=-3.0, **config), name="geared")
    counts = Encoder(
        model, ["hinge", "crank"], EncoderConfig(reading="counts", counts_per_turn=(360.0, 1000.0), **config), name="c"
    )
    speed = Encoder(model, ("hinge", "slide", "crank"), EncoderConfig(reading="speed", **config), name="speed")
    rpm = Tachometer(model, Mount("table"), TachometerConfig(**config), name="rpm")
    across = Tachometer(model, Mount("table"), TachometerConfig(axis=(1.0, 0.0, 0.0), **config), name="across")
    shaft = Tachometer(model, "crank", TachometerConfig(unit="rad/s", **config), name="shaft")
    rim = Speedometer(model, Mount("table", sw.pose((0.0, -0.4, 0.0))), SpeedometerConfig(**config), name="rim")
    sensors = (position, geared, counts, speed, rpm, across, shaft, rim)
    sim = simulate(model, [omega, 0.5, -2.0], *sensors)
    found = run(sim, 2000, *sensors)
    # the solver's rates stay within some float32 roundings of where they were set
    angle = omega * DT * np.arange(2001)
    assert found[0][:, 0] == pytest.approx(angle, abs=1e-5)
    assert found[1][:, 0] == pytest.approx(-3.0 * angle, abs=3e-5)
    turned = sim.state.joint_x.numpy()[0]
    assert found[2][-1].tolist() == [
        math.floor(turned[0] / math.tau * 360.0 + 0.5), math.floor(turned[2] / math.tau * 1000.0 + 0.5)
    ]  # fmt: skip
    assert found[2][-1] == pytest.approx([14.0 / math.tau * 360.0, -4.0 / math.tau * 1000.0], abs=0.51)
    assert found[3] == pytest.approx(np.tile([omega, 0.5, -2.0], (2001, 1)), abs=1e-5)
    assert found[4] == pytest.approx(np.full((2001, 1), omega * 30.0 / math.pi), abs=1e-4)
    assert np.abs(found[5]).max() < 1e-4
    assert found[6] == pytest.approx(np.full((2001, 1), -2.0), abs=1e-6)
    assert found[7] == pytest.approx(np.full((2001, 1), 0.4 * omega), abs=1e-5)


def test_a_wheel_that_rolls():
    """v = omega r of the axle, of the distance and of the pulses; sliding first, then rolling."""
    radius, grip = 0.3, Material(friction=0.8)
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=grip, name="road")
    cart = builder.add_body("cart", mass=5.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, radius)))
    builder.add_joint_planar("way", sw.WORLD, cart, normal=(0.0, 1.0, 0.0))
    wheel = builder.add_solid(
        "wheel", "sphere", radius, mass=2.0, pose=sw.pose((0.0, 0.0, radius)), material=grip, omega=(0.0, 20.0, 0.0)
    )
    builder.add_joint_revolute("axle", cart, wheel, axis=(0.0, 1.0, 0.0))
    model = builder.finalize(1, "cpu")
    distance = Encoder(model, "axle", EncoderConfig(schedule=EVERY, ratio=radius), name="distance")
    pulses = Encoder(model, "axle", EncoderConfig(schedule=EVERY, reading="counts", counts_per_turn=100), name="pulses")
    tacho = Tachometer(model, Mount(wheel), TachometerConfig(schedule=EVERY, unit="rad/s", axis=(0.0, 1.0, 0.0)))
    speedo = Speedometer(model, Mount(cart), SpeedometerConfig(schedule=EVERY))
    sim = sw.Simulation(model, DT, sensors=[distance, pulses, tacho, speedo])
    for _ in range(800):
        sim.step()
    start, travelled = sim.state.body_x.numpy()[0, cart, 0], distance.data.numpy()[0, 0]
    assert speedo.data.numpy()[0, 0] > 0.5
    first = pulses.data.numpy()[0, 0]
    for _ in range(500):
        sim.step()
    speed = speedo.data.numpy()[0, 0]
    # rolling to the solver's tolerance of 1e-5 m/s
    assert tacho.data.numpy()[0, 0] == pytest.approx(speed / radius, abs=2e-4)
    way = sim.state.body_x.numpy()[0, cart, 0] - start
    # the hinge angle is the wheel's own: nothing drives or brakes the axle, so that the cart does not pitch
    assert distance.data.numpy()[0, 0] - travelled == pytest.approx(way, abs=1e-4)
    assert (pulses.data.numpy()[0, 0] - first) * math.tau * radius / 100 == pytest.approx(way, abs=0.02)


def test_wheels_of_a_vehicle_that_coasts():
    builder = sw.ModelBuilder()
    spec = load_vehicle("sedan")
    parts = add_vehicle(builder, spec, speed=10.0)
    model = builder.finalize(1, "cpu", per_world=PER_WORLD)
    wheels = [f"axle{axle}.{side}.spin" for axle in (0, 1) for side in ("left", "right")]
    pulses = load_sensor("wheel-encoder", model, wheels)
    speed = Speedometer(model, Mount("chassis"), SpeedometerConfig(schedule=EVERY))
    tacho = Tachometer(model, Mount("axle0.left.spindle"), TachometerConfig(unit="rad/s", axis=(0.0, 1.0, 0.0)))
    sensors: Any = [pulses, speed, tacho]
    sim = sw.Simulation(model, DT, elements=[Vehicle(parts, model)], sensors=sensors, solver=VEHICLE_SOLVER)
    start = sim.state.body_x.numpy()[0, 0, 0]
    for _ in range(500):
        sim.step()
    assert speed.data.numpy()[0, 0] == pytest.approx(sim.state.body_v.numpy()[0, 0, 0], rel=1e-3)
    # tires roll on somewhat less than their unloaded radius; a count is 0.4 % of what they turn in half a second
    radius = spec.axles[0].tire.radius
    way = sim.state.body_x.numpy()[0, 0, 0] - start
    assert pulses.data.numpy()[0] * math.tau / 96.0 * radius == pytest.approx([way] * 4, rel=0.03)
    assert tacho.data.numpy()[0, 0] * radius == pytest.approx(speed.data.numpy()[0, 0], rel=0.03)


CASES = [
    ("position", {"rate": 250.0, "lag": 0.006}, {"step": 0.01}),
    ("position", {"rate": 125.0, "window": 0.004, "lag": 0.009}, {}),
    ("counts", {"rate": 500.0, "lag": 0.003}, {"counts_per_turn": 720.0, "ratio": -2.5}),
    ("speed", {"rate": 100.0, "window": 0.005, "lag": 0.004}, {"counts_per_turn": 4096.0}),
    ("speed", {"rate": 100.0, "window": 0.01}, {"step": 0.002, "ratio": 4.0}),
    ("speed", {"rate": 200.0, "lag": 0.02}, {}),
]


@pytest.mark.parametrize(("reading", "schedule", "options"), CASES)
@pytest.mark.parametrize("noise", [False, True])
def test_readings_are_those_of_the_reference(reading, schedule, options, noise):
    model, worlds = mechanism(3), 3
    noises = (NormalNoise(std=(0.02, 0.05), mean=0.01), BoundedDrift(std=0.1, time=0.05)) if noise else ()
    config = EncoderConfig(schedule=Schedule(**schedule), reading=reading, noise=noises, **options)
    sensor = Encoder(model, ["hinge", "crank"], config, name="e", seed=4)
    sim = simulate(model, [[3.0, 0.0, 11.0], [-5.0, 0.0, 0.3], [0.7, 0.0, -20.0]], sensor)
    episodes = 2  # the simulation's own beginning, then that of the rates
    x, v = [sim.state.joint_x.numpy().copy()], [sim.state.joint_qd.numpy().copy()]
    found = [sensor.data.numpy().copy()]
    for step in range(120):
        sim.control.joint_force[:, 2] = 4.0 * math.sin(0.1 * step)
        sim.step()
        x.append(sim.state.joint_x.numpy().copy())
        v.append(sim.state.joint_qd.numpy().copy())
        found.append(sensor.data.numpy().copy())
    positions, rates = np.array(x), np.array(v, np.float64)
    period, window, lag = sensor.frames.steps
    count = float(options.get("step", math.tau / options["counts_per_turn"] if "counts_per_turn" in options else 0.0))
    reference = ReferenceStep(reading, period, window, lag, DT, options.get("ratio", 1.0), count)
    unit = 1.0 if reading == "counts" else count / (window * DT if reading == "speed" and window else 1.0)
    for world in range(worlds):
        keys = [frame_key(4, "e", world, episodes, number) for number in range(130)]
        for channel, column in enumerate((0, 2)):
            stages = [Stage("normal", 0.01, (0.02, 0.05)[channel]), Stage("drift", 0.1, 0.05)] if noise else []
            expected = reference.series(positions[:, world, column].tolist(), rates[:, world, column].tolist(), stages,
                                        keys, channel, 2)  # fmt: skip
            off = np.abs(np.array(found)[:, world, channel] - expected)
            # float32 of what is read; at the edge of a count the float32 noise may tip one over
            fine = off < 2e-6 * np.maximum(np.abs(expected), 1.0) + (2e-6 if noise else 0.0)
            assert (fine | (np.abs(off - unit) < 1e-5 * max(unit, 1.0))).all()
            assert fine.all() or (noise and (~fine).mean() < 0.02)


def test_counts_begin_at_nought_wherever_the_joint_stands():
    model = mechanism(2)
    counts = Encoder(model, "hinge", EncoderConfig(schedule=EVERY, reading="counts", counts_per_turn=100.0))
    sim = sw.Simulation(model, DT, sensors=[counts])
    q = np.zeros((2, model.dof_count))
    q[:, 0] = [1.0, -2.0]
    qd = np.zeros_like(q)
    qd[:, 0] = [10.0, 10.0]
    sim.set_joint_state(None, q, qd)
    assert counts.data.numpy().tolist() == [[0.0], [0.0]]
    for _ in range(100):
        sim.step()
    expected = [[round((s + 1.0) * 100 / math.tau) - round(s * 100 / math.tau)] for s in (1.0, -2.0)]
    assert counts.data.numpy().tolist() == expected
    assert counts.truth.numpy() == pytest.approx(np.full((2, 1), 100.0 / math.tau), abs=1e-4)


def test_many_turns_lose_no_count():
    # 4096 counts in each of 1200 turns: positions of 7500 rad to 1e-9, counts below 2^24
    model = mechanism()
    counts = Encoder(model, "crank", EncoderConfig(schedule=EVERY, reading="counts", counts_per_turn=4096.0))
    sim = sw.Simulation(model, DT, sensors=[counts])
    sim.set_joint_state(None, None, [[0.0, 0.0, 5000.0, *[0.0] * (model.dof_count - 3)]])
    for _ in range(1500):
        sim.step()
    assert counts.data.numpy()[0, 0] == math.floor(sim.state.joint_x.numpy()[0, 2] * 4096.0 / math.tau + 0.5)
    assert counts.data.numpy()[0, 0] == pytest.approx(7500.0 * 4096.0 / math.tau, rel=1e-6)


def test_counting_makes_slow_speeds_grainy():
    """A window of 10 ms and 0.02 rad per count: speeds come in steps of 2 rad/s, and are right on average."""
    model, omega = mechanism(), 3.3
    config = EncoderConfig(schedule=Schedule(rate=100.0, window=0.01), reading="speed", step=0.02)
    speed = Encoder(model, "hinge", config)
    sim = simulate(model, [omega, 0.0, 0.0], speed)
    (found,) = run(sim, 2000, speed)
    shown = found[10::10, 0]
    assert shown / 2.0 == pytest.approx(np.round(shown / 2.0), abs=1e-6)
    assert set(np.round(shown).tolist()) == {2.0, 4.0}
    assert shown.mean() == pytest.approx(omega, abs=0.02 / 2.0)  # one count over the whole time
    assert speed.truth.numpy()[0, 0] == pytest.approx(omega, abs=1e-4)


@pytest.mark.parametrize("lag", [0, 1, 7, 25])
@pytest.mark.parametrize("window", [0, 1, 5])
def test_lags_and_windows_to_the_step(lag, window):
    """On a shaft whose angle tells the step: 1 rad after each. A tachometer's frame is the mean over its window."""
    model = mechanism()
    schedule = Schedule(rate=100.0, window=window * DT, lag=lag * DT)
    position = Encoder(model, "crank", EncoderConfig(schedule=schedule))
    tacho = Tachometer(model, "slide", TachometerConfig(schedule=schedule, unit="rad/s"))
    sim = simulate(model, [0.0, 0.0, 1000.0], position, tacho)
    rates = [0.0]
    for step in range(1, 80):
        sim.control.joint_force[:, 1] = 10.0
        sim.step()
        rates.append(float(sim.state.joint_qd.numpy()[0, 1]))
        done = (step - lag - window) // 10 * 10 + window
        if done <= 0:
            done = 0
        assert position.data.numpy()[0, 0] == pytest.approx(float(done), abs=1e-4)
        assert position.timestamp.numpy()[0] == pytest.approx(done * DT, abs=1e-6)
        expected = np.mean(rates[done - window + 1 : done + 1]) if window and done else rates[done]
        assert tacho.data.numpy()[0, 0] == pytest.approx(expected, abs=1e-6)


def test_noise_saturation_and_steps_of_meters():
    n = 1500
    model = mechanism(n)
    noise = (NormalNoise(std=0.5, mean=1.0), Saturation(lower=0.0, upper=8.0), Quantisation(step=0.25))
    tacho = Tachometer(model, "hinge", TachometerConfig(unit="rad/s", noise=noise))
    speedo = Speedometer(model, Mount("sledge"), SpeedometerConfig(noise=(NormalNoise(std=0.2),)))
    simulate(model, [7.0, 2.0, 0.0], tacho, speedo)
    values = tacho.data.numpy()[:, 0]
    assert np.array_equal(values, np.round(values * 4.0) / 4.0)
    # the upper bound is the mean of what is measured: half of it is cut
    assert values.max() == 8.0
    assert (values == 8.0).mean() == pytest.approx(0.5 + 0.0987, abs=5.0 * 0.5 / math.sqrt(n))  # and the last half step
    assert values.mean() == pytest.approx(8.0 - 0.5 / math.sqrt(2.0 * math.pi), abs=5.0 * 0.3 / math.sqrt(n))
    speeds = speedo.data.numpy()[:, 0].astype(float)
    assert speeds.mean() == pytest.approx(2.0, abs=5.0 * 0.2 / math.sqrt(n))
    assert speeds.std() == pytest.approx(0.2, rel=5.0 / math.sqrt(2.0 * n))
    assert tacho.truth.numpy() == pytest.approx(np.full((n, 1), 7.0), abs=1e-6)


NOISY = Schedule(rate=250.0, window=0.002, lag=0.006, phase="random")


def noisy_run(worlds: int, disturbed: int | None = None) -> np.ndarray:
    """(50, worlds, 7) data and truth after each step; one world may be pushed and reset in between."""
    model = mechanism(worlds)
    noise = (NormalNoise(std=0.1), BoundedDrift(std=0.3, time=0.02))
    sensors = [
        Encoder(model, ("hinge", "crank"), EncoderConfig(schedule=NOISY, noise=noise, step=0.001), name="e", seed=1),
        Encoder(model, "hinge", EncoderConfig(schedule=NOISY, reading="counts", step=0.001), name="c", seed=1),
        Encoder(model, "hinge", EncoderConfig(schedule=NOISY, reading="speed", noise=noise), name="s", seed=1),
        Tachometer(model, Mount("table"), TachometerConfig(schedule=NOISY, noise=noise), seed=1),
        Speedometer(model, Mount("sledge"), SpeedometerConfig(schedule=NOISY, noise=noise), seed=1),
    ]
    sim = simulate(model, [7.0, 2.0, 5.0], *sensors)
    found = []
    for step in range(50):
        if disturbed is not None and step in (10, 30):
            mask = np.arange(worlds) == disturbed
            sim.control.joint_force[disturbed, 0] = 500.0
            sim.reset(mask & (step == 30))
        sim.step()
        found.append(np.concatenate([a.numpy() for s in sensors for a in (s.data, s.truth)], axis=1))
    return np.array(found)


def test_worlds_do_not_depend_on_one_another():
    alone, disturbed, few = noisy_run(6), noisy_run(6, disturbed=3), noisy_run(2)
    others = [0, 1, 2, 4, 5]
    assert np.array_equal(alone[:, others], disturbed[:, others])
    assert not np.array_equal(alone[:, 3], disturbed[:, 3])
    assert np.array_equal(alone[:, :2], few)
    assert np.array_equal(alone, noisy_run(6))
    # worlds have numbers of their own
    assert np.abs(np.diff(np.sort(alone[-1, :, 6]))).min() > 0.0


def test_a_snapshot_repeats_the_readings_bit_by_bit():
    model = mechanism(3)
    noise = (BoundedDrift(std=0.3, time=0.02),)
    counts = Encoder(model, "hinge", EncoderConfig(schedule=NOISY, reading="counts", step=0.001, noise=noise), name="c")
    speed = Encoder(model, "hinge", EncoderConfig(schedule=NOISY, reading="speed", step=0.001, noise=noise), name="s")
    tacho = Tachometer(model, "crank", TachometerConfig(schedule=NOISY, noise=noise))
    sim = simulate(model, [7.0, 2.0, 5.0], counts, speed, tacho)
    for _ in range(13):
        sim.step()
    kept = sim.snapshot()
    runs = []
    for _ in range(2):
        sim.restore(kept)
        found = []
        for step in range(30):
            sim.step()
            if step == 15:
                sim.reset(np.array([True, False, True]))
            found.append(np.concatenate([sensor.data.numpy() for sensor in (counts, speed, tacho)], axis=1))
        runs.append(np.array(found))
    assert np.array_equal(runs[0], runs[1])


def test_every_world_may_have_its_own_numbers():
    model = mechanism(3)
    encoder = Encoder(
        model, ["hinge", "slide"], EncoderConfig(schedule=EVERY, step=0.01, noise=(NormalNoise(std=0.0),)),
        randomised=True,
    )  # fmt: skip
    tacho = Tachometer(model, Mount("table"), TachometerConfig(schedule=EVERY, unit="rad/s"), randomised=True)
    speedo = Speedometer(model, Mount("table"), SpeedometerConfig(schedule=EVERY), randomised=True)
    sim = simulate(model, [10.0, 1.0, 0.0], encoder, tacho, speedo)
    encoder.step[:, 0] = np.array([0.0, 0.4, 0.25])
    encoder.ratio[2] = 2.0
    encoder.noise.parameter(0, "mean")[1] = 0.05
    tacho.mount.rotation[1] = np.array([1.0, 0.0, 0.0, 0.0])  # upside down
    speedo.mount.position[:] = np.array([[0.0, -0.1, 0.0], [0.0, -0.2, 0.0], [0.0, 0.3, 0.0]])
    for _ in range(100):
        sim.step()
    # hinges at 1 rad, slides at 0.1 m; 1.05 rad are 2.6 counts of 0.4 rad
    assert encoder.data.numpy() == pytest.approx(np.array([[1.0, 0.1], [1.2, 0.15], [2.0, 0.2]]), abs=1e-5)
    assert tacho.data.numpy()[:, 0] == pytest.approx([10.0, -10.0, 10.0], abs=1e-5)
    assert speedo.data.numpy()[:, 0] == pytest.approx([1.0, 2.0, -3.0], abs=1e-5)


def test_a_ratio_written_in_the_middle_of_an_episode_acts_on_the_whole_of_it():
    """Another gear at once, as if it had been there from the beginning: no travel comes from the change alone."""
    model, omega = mechanism(3), 10.0
    schedule = Schedule(rate=100.0, window=0.01)
    encoders = [
        Encoder(model, "hinge", EncoderConfig(schedule=schedule, reading="speed"), name="speed", randomised=True),
        Encoder(
            model, "hinge", EncoderConfig(schedule=EVERY, reading="counts", step=0.01), name="counts", randomised=True,
        ),
    ]  # fmt: skip
    sim = sw.Simulation(model, DT, sensors=encoders)
    rows = np.zeros((3, model.dof_count))
    rows[:, 0] = omega
    sim.set_joint_state(None, np.tile(np.eye(1, model.dof_count) * 0.5, (3, 1)), rows)
    for _ in range(25):
        sim.step()
    for encoder in encoders:
        encoder.ratio[1] = 3.0
        encoder.ratio[2] = -1.0
    for _ in range(5):
        sim.step()
    speed, counts = (encoder.data.numpy()[:, 0] for encoder in encoders)
    assert speed == pytest.approx([omega, 3.0 * omega, -omega], abs=1e-4)
    # 0.3 rad of travel; floor(x + 1/2) of values on a count may fall to either side
    assert counts == pytest.approx([30, 90, -30], abs=1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m: Encoder(m, "hing"), "sensor 'encoder': model has no joint 'hing'; did you mean 'hinge'"),
        (lambda m: Encoder(m, "shoulder"), "sensor 'encoder': joint 'shoulder' has 3 coordinates, not one"),
        (lambda m: Encoder(m, 99), "a coordinate must be the name of a joint or a column below 6, got 99"),
        (lambda m: Encoder(m, True), "a coordinate must be the name of a joint or a column below 6, got True"),
        (lambda m: Encoder(m, []), "sensor 'encoder': coordinates must name at least one, got none; give a joint"),
        (
            lambda m: Encoder(m, "slide", EncoderConfig(counts_per_turn=100)),
            "sensor 'encoder': counts_per_turn needs a rotation, but joint 'slide' slides; give step",
        ),
        (
            lambda m: Encoder(m, "slide", EncoderConfig(step=(0.1, 0.2))),
            "sensor 'encoder': step must be one number or 1, got 2; give one for all",
        ),
        (
            lambda m: Encoder(m, "slide", EncoderConfig(noise=(NormalNoise(std=(0.1, 0.2)),))),
            "sensor 'encoder': noise: std of NormalNoise must be one number or 1, got ",
        ),
        (lambda m: EncoderConfig(reading="angle"), "EncoderConfig: reading must be one of 'position', 'counts', "),  # type: ignore[arg-type]
        (lambda m: EncoderConfig(reading="counts"), "EncoderConfig: reading counts needs something to count; give "),
        (lambda m: EncoderConfig(counts_per_turn=100, step=0.1), "EncoderConfig: give either counts_per_turn or step"),
        (lambda m: EncoderConfig(counts_per_turn=0), "EncoderConfig: counts_per_turn must be positive, got 0"),
        (lambda m: EncoderConfig(step=-0.1), "EncoderConfig: step must be positive, got -0.1"),
        (lambda m: EncoderConfig(ratio=(1.0, 0.0)), "EncoderConfig: ratio must be not 0, one number or one per joint"),
        (lambda m: EncoderConfig(ratio="two"), "EncoderConfig: ratio must be a number or a list, got 'two'"),  # type: ignore[arg-type]
        (lambda m: Encoder(m, "slide", EncoderConfig(schedule=100.0)), "schedule must be a Schedule, got 100.0"),  # type: ignore[arg-type]
        (lambda m: Tachometer(m, Mount("wheel")), "sensor 'tachometer': model has no body 'wheel'"),
        (lambda m: Tachometer(m, "wheel"), "sensor 'tachometer': model has no joint 'wheel'"),
        (lambda m: TachometerConfig(unit="rps"), "TachometerConfig: unit must be one of 'rpm', 'rad/s',"),  # type: ignore[arg-type]
        (lambda m: TachometerConfig(axis=(0.0, 0.0, 0.0)), "TachometerConfig: axis must "),
        (lambda m: Speedometer(m, Mount("car")), "sensor 'speedometer': model has no body 'car'"),
        (lambda m: Speedometer(m, "slide"), "sensor 'speedometer': mount must be a Mount, got 'slide'"),  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_mistakes_are_one_clear_error(make, message):
    with pytest.raises(sw.ModelError) as caught:
        make(mechanism())
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
