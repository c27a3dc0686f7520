"""Noise of sensors: the random numbers, moments, drift and walk against theory, cuts and steps, worlds of their own."""

import hashlib
import math

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.noise import BiasWalk, BoundedDrift, NormalNoise, Quantisation, Saturation
from simwarp.sensors.random_kernels import draw_normals, draw_uniform, frame_key
from tests.reference.sensors import sensor_noise as reference
from tests.unit.sensors.sensor_probe import ball

DT = 0.01


@wp.kernel(enable_backward=False)
def draw(stream: wp.uint64, episode: int, out: wp.array2d[float]):
    world, frame = wp.tid()  # type: ignore[misc]
    key = frame_key(stream, world, episode, frame)
    pair = draw_normals(key, 7)
    out[world, 3 * frame] = draw_uniform(key, 7)  # type: ignore[index]
    out[world, 3 * frame + 1] = pair[0]  # type: ignore[index]
    out[world, 3 * frame + 2] = pair[1]  # type: ignore[index]


def drawn(worlds: int, frames: int, *, stream: int = 12345, episode: int = 2) -> np.ndarray:
    """(worlds, frames, 3) uniform and two normal numbers."""
    out = wp.zeros((worlds, 3 * frames), dtype=float, device="cpu")
    wp.launch(draw, dim=(worlds, frames), inputs=[wp.uint64(stream), episode], outputs=[out], device="cpu")
    return np.asarray(out.numpy(), np.float64).reshape(worlds, frames, 3)


def gyroscope(worlds: int, *noise, rate: float = 100.0, name: str = "gyro", seed: int = 0, lag: float = 0.0, every=1):
    """A simulation of still bodies with gyroscopes that show their noise alone."""
    model = ball(worlds, gravity=(0.0, 0.0, 0.0))
    config = ImuConfig(schedule=Schedule(rate=rate, lag=lag), outputs=("gyroscope",), gyroscope_noise=noise)
    imu = Imu(model, Mount("ball"), config, name=name, seed=seed)
    return sw.Simulation(model, DT, sensors=[imu], read_every=every), imu


def series(worlds: int, frames: int, *noise, **options) -> np.ndarray:
    """(frames + 1, worlds, 3) readings, the one of the beginning first."""
    sim, imu = gyroscope(worlds, *noise, **options)
    found = [imu.data.numpy().copy()]
    for _ in range(frames):
        sim.step()
        found.append(imu.data.numpy().copy())
    return np.array(found, np.float64)


def test_random_numbers_are_those_of_the_reference():
    stream = int.from_bytes(hashlib.blake2b(b"3/gyro", digest_size=8).digest(), "little")
    found = drawn(4, 5, stream=stream)
    for world in range(4):
        for frame in range(5):
            key = reference.frame_key(3, "gyro", world, 2, frame)
            expected = [reference.uniform(key, 7), *reference.normals(key, 7)]
            # logarithm, root and sine in float32
            assert found[world, frame] == pytest.approx(expected, abs=2e-6)


def test_moments_and_independence_of_the_draws():
    n = 200 * 500
    values = drawn(200, 500)
    uniform, normal = values[..., 0], values[..., 1:].reshape(n, 2)
    five = 5.0 / math.sqrt(n)  # five standard errors of a mean of unit variance: one in a million
    assert abs(uniform.mean() - 0.5) < five * math.sqrt(1.0 / 12.0)
    assert abs(uniform.var() - 1.0 / 12.0) < five * math.sqrt(1.0 / 180.0)
    assert np.abs(normal.mean(axis=0)).max() < five
    assert np.abs(normal.var(axis=0) - 1.0).max() < five * math.sqrt(2.0)
    assert np.abs((normal**3).mean(axis=0)).max() < five * math.sqrt(15.0)
    assert np.abs((normal**4).mean(axis=0) - 3.0).max() < five * math.sqrt(96.0)
    # within a pair, from frame to frame, from world to world
    grid = values[..., 1]
    for product in (normal[:, 0] * normal[:, 1], grid[:, 1:] * grid[:, :-1], grid[1:] * grid[:-1]):
        assert abs(product.mean()) < 5.0 / math.sqrt(product.size)
    # beyond 3 sigma: 0.27 %
    beyond = (np.abs(normal) > 3.0).mean()
    assert abs(beyond - 0.0026998) < 5.0 * math.sqrt(0.0027 / (2 * n))


def test_a_chain_of_all_stages_is_that_of_the_reference():
    stages = (
        NormalNoise(std=(0.1, 0.2, 0.3), mean=0.05), BiasWalk(rate=0.4, initial_std=0.2),
        BoundedDrift(std=0.5, time=(0.05, 0.5, 5.0)), Saturation(lower=-0.4, upper=(0.3, 0.4, 0.5)),
        Quantisation(step=0.01),
    )  # fmt: skip
    chains = [
        [
            reference.Stage("normal", 0.05, (0.1, 0.2, 0.3)[axis]), reference.Stage("walk", 0.4, 0.2),
            reference.Stage("drift", 0.5, (0.05, 0.5, 5.0)[axis]),
            reference.Stage("saturation", -0.4, (0.3, 0.4, 0.5)[axis]),
            reference.Stage("quantisation", 0.01),
        ]
        for axis in range(3)
    ]  # fmt: skip
    found = series(3, 30, *stages, seed=11, rate=50.0)[:, 2]
    expected = np.zeros((31, 3))
    for frame in range(16):
        # number 1 would be the frame of the instant 0, in whose place there is the one of the beginning
        key = reference.frame_key(11, "gyro", 2, 1, frame + 1 if frame else 0)
        for axis, chain in enumerate(chains):
            value = 0.0
            for index, stage in enumerate(chain):
                value = stage.apply(value, None if frame == 0 else 0.02, reference.normals(key, 3 * index + axis)[0])
            expected[2 * frame : 2 * frame + 2, axis] = value
    # float32 biases: 1e-6; at the edge of a step of 0.01 that may tip one over
    off = np.abs(found - expected)
    assert ((off < 1e-5) | (np.abs(off - 0.01) < 1e-5)).all()
    assert (off > 1e-5).mean() < 0.02


def test_moments_of_normal_noise():
    values = series(500, 40, NormalNoise(std=(0.1, 0.2, 0.0), mean=(0.0, -1.0, 2.0)))
    n = values.shape[0] * values.shape[1]
    assert values.mean(axis=(0, 1)) == pytest.approx([0.0, -1.0, 2.0], abs=5.0 * 0.2 / math.sqrt(n))
    assert values.std(axis=(0, 1)) == pytest.approx([0.1, 0.2, 0.0], abs=5.0 * 0.2 / math.sqrt(2 * n))
    assert (values[:, :, 2] == 2.0).all()


def test_bounded_drift_is_stationary_and_forgets():
    std, time = 0.3, 0.2
    values = series(400, 200, BoundedDrift(std=std, time=time))[:, :, 0]
    # 201 frames of 10 ms are 10 correlation times of two-sided length 2·time: 400 (1 + 5) independent values or more
    independent = 400 * (1 + 2.0 / (2.0 * time))
    assert abs(values.mean()) < 5.0 * std / math.sqrt(independent)
    assert values.std() == pytest.approx(std, rel=5.0 / math.sqrt(2.0 * independent))
    # from the beginning of an episode on
    assert values[0].std() == pytest.approx(std, rel=5.0 / math.sqrt(2.0 * 400))
    for lag in (1, 10, 40):
        found = np.mean([np.corrcoef(values[0], values[lag])[0, 1], np.corrcoef(values[100], values[100 + lag])[0, 1]])
        expected = math.exp(-lag * DT / time)
        assert found == pytest.approx(expected, abs=5.0 * (1.0 - expected**2) / math.sqrt(800) + 1e-3)


def test_skipped_frames_leave_the_law_as_it_is():
    # read every 20 frames: the same spread, and the correlation of 0.2 s between two looks
    sim, imu = gyroscope(2000, BoundedDrift(std=0.3, time=0.2), BiasWalk(rate=0.5), every=20)
    looks = [imu.data.numpy()[:, 0].copy()]
    for _ in range(2):
        for _ in range(20):
            sim.step()
        looks.append(imu.data.numpy()[:, 0].copy())
    for k, look in enumerate(looks):
        expected = math.sqrt(0.3**2 + 0.5**2 * 0.2 * k)
        assert look.std() == pytest.approx(expected, rel=5.0 / math.sqrt(4000))
    change = (looks[1] - looks[0]).var()
    expected = 2.0 * 0.3**2 * (1.0 - math.exp(-1.0)) + 0.25 * 0.2
    assert change == pytest.approx(expected, rel=5.0 * math.sqrt(2.0 / 2000))


def test_a_walking_bias_spreads_with_the_root_of_time():
    values = series(1000, 64, BiasWalk(rate=0.2, initial_std=0.1))[:, :, 1]
    for frame in (0, 1, 4, 16, 64):
        expected = math.sqrt(0.1**2 + 0.2**2 * frame * DT)
        assert values[frame].std() == pytest.approx(expected, rel=5.0 / math.sqrt(2000))


def drift_theory(std: float, time: float, tau: float) -> float:
    """Allan variance of a Gauss-Markov process of first order (IEEE 952-2020, annex C)."""
    r = tau / time
    return 2.0 * std**2 / r * (1.0 - (3.0 - 4.0 * math.exp(-r) + math.exp(-2.0 * r)) / (2.0 * r))


def test_allan_deviation_of_drift_walk_and_white_noise():
    std, time, rate, white = 0.3, 0.5, 0.2, 0.1
    lengths = [4, 16, 64, 256]
    worlds, frames = 24, 2048
    noises = {"drift": BoundedDrift(std=std, time=time), "walk": BiasWalk(rate=rate), "white": NormalNoise(std=white)}
    for kind, noise in noises.items():
        values = series(worlds // 3, frames, noise)[1:].reshape(frames, -1)
        found = np.array([reference.allan_deviation(column.tolist(), DT, lengths) for column in values.T])
        for column, length in enumerate(lengths):
            tau = length * DT
            if kind == "white":
                theory = white * math.sqrt(DT / tau)
            elif kind == "walk":
                # of the sampled process: rate² tau / 3 (1 + 1 / (2 m²))
                theory = rate * math.sqrt(tau / 3.0 * (1.0 + 0.5 / length**2))
            else:
                theory = math.sqrt(drift_theory(std, time, tau))
            # a variance over T / tau independent stretches in each of 24 channels; 5 standard errors, and the 0.3 %
            # by which samples of a continuous process differ from its means
            error = 5.0 / math.sqrt(2.0 * worlds * (frames / length - 1)) + 0.003
            assert math.sqrt((found[:, column] ** 2).mean()) == pytest.approx(theory, rel=error), (kind, tau)


def test_steps_and_cuts():
    values = series(50, 20, NormalNoise(std=1.0), Quantisation(step=0.25))
    assert np.array_equal(values, np.round(values / 0.25) * 0.25)
    # an even spread within a step adds step²/12
    n = values.size
    assert values.var() == pytest.approx(1.0 + 0.25**2 / 12.0, rel=5.0 * math.sqrt(2.0 / n))
    cut = series(50, 20, NormalNoise(std=1.0), Saturation(lower=(-1.0, -math.inf, 0.5), upper=(1.0, 0.2, math.inf)))
    assert np.abs(cut[..., 0]).max() == 1.0
    assert cut[..., 1].max() == pytest.approx(0.2)
    assert cut[..., 2].min() == 0.5
    # 31.7 % of a normal distribution lies beyond 1
    beyond = (np.abs(cut[..., 0]) == 1.0).mean()
    assert beyond == pytest.approx(0.3173, abs=5.0 * math.sqrt(0.22 / cut[..., 0].size))


def test_seeds_names_worlds_and_episodes_have_numbers_of_their_own():
    noise = NormalNoise(std=1.0)
    base = series(40, 10, noise)
    assert np.array_equal(base, series(40, 10, noise))
    assert np.array_equal(base[:, :7], series(7, 10, noise))
    for other in (series(40, 10, noise, seed=1), series(40, 10, noise, name="other")):
        assert abs(np.corrcoef(base.ravel(), other.ravel())[0, 1]) < 5.0 / math.sqrt(base.size)
    sim, imu = gyroscope(40, noise)
    first = [imu.data.numpy().copy()]
    sim.reset()
    second = imu.data.numpy().copy()
    assert abs(np.corrcoef(first[0].ravel(), second.ravel())[0, 1]) < 5.0 / math.sqrt(120)


def test_numbers_of_a_stage_can_be_written_between_steps():
    model = ball(3, gravity=(0.0, 0.0, 0.0))
    config = ImuConfig(
        schedule=Schedule(rate=100.0), outputs=("gyroscope",),
        gyroscope_noise=(NormalNoise(std=0.0), Saturation(lower=-5.0, upper=5.0)),
    )  # fmt: skip
    own, shared = Imu(model, Mount(0), config, name="own", randomised=True), Imu(model, Mount(0), config, name="shared")
    sim = sw.Simulation(model, DT, sensors=[own, shared])
    own.gyroscope_noise.parameter(0, "mean")[:] = np.array([[1.0], [2.0], [3.0]])
    own.gyroscope_noise.parameter(1, "upper")[2] = 2.5
    shared.gyroscope_noise.parameter(0, "mean")[:, 1] = -1.0
    sim.step()
    assert own.data.numpy()[:, 0].tolist() == [1.0, 2.0, 2.5]
    assert shared.data.numpy().tolist() == [[0.0, -1.0, 0.0]] * 3
    for stage, name in ((0, "upper"), (2, "std"), (-1, "std")):
        with pytest.raises(
            sw.ModelError, match=f"no stage {stage} with a number '{name}'; there are 0: mean, std; 1: "
        ):
            own.gyroscope_noise.parameter(stage, name)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: NormalNoise(std=-0.1), r"NormalNoise: std must be zero or positive, got -0\.1"),
        (lambda: NormalNoise(std=math.nan), "NormalNoise: std must be a finite number"),
        (lambda: NormalNoise(std=0.1, mean="big"), "NormalNoise: mean must be a number or a list, got 'big'"),  # type: ignore[arg-type]
        (lambda: BoundedDrift(std=0.1, time=0.0), r"BoundedDrift: time must be positive, got 0\.0"),
        (lambda: BiasWalk(rate=(0.1, -0.1)), r"BiasWalk: rate must be zero or positive, got \(0"),
        (lambda: Quantisation(step=0.0), r"Quantisation: step must be positive, got 0\.0"),
        (lambda: Saturation(lower=1.0, upper=1.0), "Saturation: lower must be below upper, got 1.0 and 1.0"),
    ],
)
def test_noise_that_cannot_be(make, message):
    with pytest.raises(sw.ModelError, match=message):
        make()
