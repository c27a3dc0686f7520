"""The clock of sensors: windows, lags and phases to the sub-step, against an event list; resets, snapshots, batches."""

import itertools

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.sensors.interface import Mount, Schedule, body_index
from tests.reference.sensors.sensor_clock import Frame, frames, nearest, read
from tests.unit.sensors.sensor_probe import COUNT, GAPS, MODE, NUMBER, SPAN, SUBSTEPS, Probe, ball

DT = 0.001
BEGIN_MODE = 2

SCHEDULES = [  # rate [Hz], window [ms], lag [ms]
    (1000.0, 0, 0), (1000.0, 0, 3), (1000.0, 1, 0), (1000.0, 1, 5), (500.0, 1, 0), (500.0, 2, 7), (200.0, 0, 0),
    (200.0, 5, 0), (200.0, 5, 5), (200.0, 2, 13), (125.0, 8, 4), (50.0, 0, 20), (50.0, 20, 20), (50.0, 7, 1),
    (30.0, 33, 12), (20.0, 1, 70),
]  # fmt: skip
READS = [(1, 1), (1, 4), (3, 1), (2, 5), (1, 20), (7, 3)]  # sub-steps, read_every


def simulate(schedule: Schedule, substeps: int, every: int, phases: list[int], *, gradual: bool = False):
    """A simulation with a probe whose worlds have the given phases, and its probe."""
    model = ball(len(phases))
    probe = Probe(model, schedule, gradual=gradual)
    sim = sw.Simulation(model, DT * substeps, substeps=substeps, sensors=[probe], read_every=every)
    probe.frames.phase.assign(np.array(phases, np.int32))
    return sim, probe


def row(frame: Frame) -> list[float]:
    """What the probe writes for a frame."""
    return [frame.number, sum(frame.substeps), len(frame.substeps), 1.0, 0.0, 1.0]


@pytest.mark.parametrize("gradual", [False, True])
@pytest.mark.parametrize(("rate", "window", "lag"), SCHEDULES)
@pytest.mark.sweep
def test_readers_see_what_the_event_list_says(rate, window, lag, gradual):
    schedule = Schedule(rate=rate, window=window * DT, lag=lag * DT)
    period = nearest(str(1.0 / rate), str(DT))
    assert schedule.steps(DT) == (period, window, lag)
    phases = sorted({0, 1, period // 2, period - 1} & set(range(period)))
    for substeps, every in READS:
        sim, probe = simulate(schedule, substeps, every, phases, gradual=gradual)
        look = substeps * every
        looks = (2 * (period + window + lag) + 60) // look + 2
        lists = [frames(period, window, lag, phase, looks * look) for phase in phases]
        for k in range(1, looks + 1):
            for _ in range(every):
                sim.step()
            seen = [read(events, k * look) for events in lists]
            assert probe.valid.numpy().all()
            for world, frame in enumerate(seen):
                found = probe.data.numpy()[world]
                if frame.number == 0:
                    assert found[NUMBER] == 0
                    assert found[MODE] == BEGIN_MODE
                else:
                    # shares of the window are added up in float32: 1e-6 a term
                    assert found == pytest.approx(row(frame), abs=1e-4)
                # a sub-step of the world's clock is added in float64
                assert probe.timestamp.numpy()[world] == pytest.approx(frame.complete * DT, abs=1e-6)
        # nothing is taken in vain: beside the one of the beginning, frames that were or may still be seen
        for world, events in enumerate(lists):
            seen_ever = {read(events, k * look).number for k in range(1, looks + 1)} - {0}
            late = probe.taken.numpy()[world] - 1 - len(seen_ever)
            # completed but still on its way when the run ends: at most as many as fit into the lag, plus one look
            assert 0 <= late <= lag // period + 1


@pytest.mark.parametrize(("rate", "window", "lag"), SCHEDULES)
def test_the_next_frame_is_that_of_the_event_list(rate, window, lag):
    steps = Schedule(rate=rate, window=window * DT, lag=lag * DT).steps(DT)
    for phase in {0, 1, steps.period // 2, steps.period - 1} & set(range(steps.period)):
        until = 3 * steps.period + window + lag + phase
        # frame 0 is the one of the beginning
        published = [frame.published for frame in frames(*steps, phase, until) if frame.number]
        for count in range(published[-1]):
            assert steps.next_published(count, phase) == min(each for each in published if each > count)


def test_every_frame_that_nobody_sees_is_skipped():
    # 1000 Hz read every 20 ms, published on the spot: of 20 frames, one is seen
    sim, probe = simulate(Schedule(rate=1000.0), 20, 1, [0])
    for _ in range(10):
        sim.step()
    assert probe.taken.numpy()[0] == 1 + 10


@pytest.mark.parametrize(
    ("rate", "window", "lag"),
    [("100", "0.01", "0.01"), ("30", "0.0333", "0.015"), ("7", "0", "1"), ("1e6", "0", "0"), ("40", "0.025", "0.005")],
)
@pytest.mark.parametrize("dt", ["0.001", "0.002", "0.003", "0.01", "0.0167"])
def test_times_are_rounded_to_the_nearest_substep(rate, window, lag, dt):
    steps = Schedule(rate=float(rate), window=min(float(window), 1.0 / float(rate)), lag=float(lag)).steps(float(dt))
    period = nearest(str(1.0 / float(rate)), dt)
    assert steps.period == max(period, 1)
    assert steps.lag == nearest(lag, dt)
    assert steps.window == nearest(str(min(float(window), 1.0 / float(rate))), dt)
    assert steps.window <= steps.period


def test_a_reset_publishes_at_once_and_forgets_frames_on_their_way():
    sim, probe = simulate(Schedule(rate=200.0, window=0.003, lag=0.02), 1, 1, [0, 2, 4])
    for _ in range(37):
        sim.step()
    before = probe.data.numpy().copy()
    assert (before[:, NUMBER] > 0).all()
    sim.reset(np.array([False, True, False]))
    after = probe.data.numpy()
    assert after[1, [NUMBER, MODE]].tolist() == [0.0, BEGIN_MODE]
    assert probe.timestamp.numpy()[1] == 0.0
    assert probe.valid.numpy().all()
    assert np.array_equal(after[[0, 2]], before[[0, 2]])
    references = [frames(5, 3, 20, phase, 100) for phase in (0, 2, 4)]
    for k in range(1, 60):
        sim.step()
        counts = [37 + k, k, 37 + k]
        expected = [read(events, count).number for events, count in zip(references, counts, strict=True)]
        assert probe.data.numpy()[:, NUMBER].tolist() == expected


@pytest.mark.parametrize("setter", ["set_joint_state", "measure"])
def test_whoever_sets_a_state_begins_the_sensors(setter):
    sim, probe = simulate(Schedule(rate=100.0), 1, 1, [0, 0])
    for _ in range(25):
        sim.step()
    mask = np.array([True, False])
    if setter == "measure":
        sim.measure(mask)
    else:
        sim.set_joint_state(mask, None, None)
    assert probe.data.numpy()[:, NUMBER].tolist() == [0.0, 3.0]
    # the world's time goes on: it was not reset
    assert probe.timestamp.numpy() == pytest.approx([0.025, 0.02], abs=1e-6)


def test_random_phases_cover_the_period_and_differ_per_episode():
    model = ball(400)
    probe = Probe(model, Schedule(rate=100.0, phase="random"))
    sim = sw.Simulation(model, DT, sensors=[probe])
    first = probe.frames.phase.numpy().copy()
    assert set(first) == set(range(10))
    # multinomial: 40 of 400 a value, 6 of its standard deviation (6.0) either way
    assert np.bincount(first).max() < 40 + 36
    sim.reset()
    second = probe.frames.phase.numpy()
    assert 0.02 < (first == second).mean() < 0.25  # 0.1 with a standard deviation of 0.015
    # world k has its own, whatever stands beside it; another seed or name has others
    few = ball(7)
    alike, other, named = (
        Probe(few, Schedule(rate=100.0, phase="random"), **kw) for kw in ({}, {"seed": 1}, {"name": "b"})
    )
    sw.Simulation(few, DT, sensors=[alike, named])
    sw.Simulation(few, DT, sensors=[other])
    assert np.array_equal(alike.frames.phase.numpy(), first[:7])
    assert not np.array_equal(other.frames.phase.numpy(), first[:7])
    assert not np.array_equal(named.frames.phase.numpy(), first[:7])


def memory_of(sim: sw.Simulation) -> list[np.ndarray]:
    return [array.numpy().copy() for array in sim.memory]


def test_a_snapshot_holds_the_clock():
    sim, probe = simulate(Schedule(rate=70.0, window=0.005, lag=0.02, phase="random"), 2, 1, [3, 1, 0])
    for _ in range(20):
        sim.step()
    kept = sim.snapshot()

    def go_on() -> list[np.ndarray]:
        found = []
        for k in range(25):
            sim.step()
            if k == 12:
                sim.reset(np.array([True, False, False]))
            found += [*memory_of(sim), probe.data.numpy().copy()]
        return found

    first = go_on()
    sim.restore(kept)
    second = go_on()
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_a_frozen_world_keeps_its_frame_and_turns_invalid():
    sim, probe = simulate(Schedule(rate=200.0), 1, 1, [0, 0, 0])
    for _ in range(12):
        sim.step()
    velocity = sim.state.body_v.numpy()
    velocity[1] = np.nan
    sim.state.body_v.assign(velocity)
    for _ in range(10):
        sim.step()
    assert probe.valid.numpy().tolist() == [True, False, True]
    assert probe.data.numpy()[:, NUMBER].tolist() == [5.0, 3.0, 5.0]
    sim.reset(np.array([False, True, False]))
    assert probe.valid.numpy().all()


def test_frames_without_whole_words_are_copied():
    from simwarp.sensors.clock import Field, FrameBuffer

    model = ball(2)
    shaped = FrameBuffer("bytes", Schedule(rate=100.0, lag=0.01), model, {"data": Field((3, 5, 1), wp.uint8)})

    class Bytes(Probe):
        def __init__(self) -> None:
            super().__init__(model, Schedule(rate=100.0))
            self.frames = shaped

        def _sample(self, simulation):
            return []

    sim = sw.Simulation(model, DT, sensors=[Bytes()])
    ring = shaped.ring["data"]
    assert ring.shape == (2 * 2, 3, 5, 1)
    ring.assign(np.arange(ring.size, dtype=np.uint8).reshape(ring.shape))
    sim.reset(np.array([False, True]))
    assert not shaped.data["data"].numpy()[0].any()
    assert np.array_equal(shaped.data["data"].numpy()[1], ring.numpy()[2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, r"rate must be positive, got 0\.0; give frames per second \[Hz\]"),
        ({"rate": -1.0}, r"rate must be positive, got -1\.0; give frames per second \[Hz\]"),
        ({"rate": float("nan")}, r"rate must be a finite number, got nan; give frames per second \[Hz\]"),
        ({"rate": 10.0, "lag": -0.1}, r"lag must be zero or positive, got -0\.1; give seconds, 0 for none"),
        ({"rate": 10.0, "window": -0.1}, r"window must be zero or positive, got -0\.1; give seconds, 0 for none"),
        ({"rate": 10.0, "window": 0.2}, r"window must not be longer than a period \(1 / rate = 0.1 s\), got 0.2 s"),
        ({"rate": 10.0, "lag": float("inf")}, r"lag must be a finite number"),
        ({"rate": 10.0, "phase": "late"}, "phase must be one of 'zero', 'random', got 'late'"),
    ],
)
def test_a_schedule_that_cannot_be_kept(options, message):
    with pytest.raises(sw.ModelError, match=message) as caught:
        Schedule(**options)
    assert "\n" not in str(caught.value)


def test_mistakes_in_putting_sensors_together():
    model = ball(2)
    with pytest.raises(sw.ModelError, match="sensor 'imu': model has no body 'bal'; did you mean 'ball'"):
        body_index("imu", "bal", model)
    for wrong in (1, -2, 1.5, True, None):
        with pytest.raises(sw.ModelError, match=r"sensor 'imu': body must be WORLD \(-1\), an index below 1 or a name"):
            body_index("imu", wrong, model)  # type: ignore[arg-type]
    with pytest.raises(sw.ModelError, match="Mount: pose must be a Pose"):
        Mount(0, (1.0, 2.0, 3.0))  # type: ignore[arg-type]
    with pytest.raises(sw.ModelError, match="two sensors are called 'probe'"):
        sw.Simulation(model, DT, sensors=[Probe(model, Schedule(rate=10.0)) for _ in range(2)])
    with pytest.raises(sw.ModelError, match="read_every must be an integer >= 1, got 0"):
        sw.Simulation(model, DT, read_every=0)
    probe = Probe(model, Schedule(rate=10.0))
    sw.Simulation(model, DT, sensors=[probe])
    with pytest.raises(sw.ModelError, match="sensor 'probe': is part of a Simulation already"):
        sw.Simulation(model, DT, sensors=[probe])
    with pytest.raises(sw.ModelError, match="sensor 'probe': was made for another model"):
        sw.Simulation(ball(2), DT, sensors=[Probe(model, Schedule(rate=10.0))])
    with pytest.raises(sw.ModelError, match="schedule must be a Schedule"):
        Probe(model, 10.0)  # type: ignore[arg-type]
    with pytest.raises(sw.ModelError, match=r"seed must be an integer, got 0\.5"):
        Probe(model, Schedule(rate=10.0), seed=0.5)  # type: ignore[arg-type]


def test_the_columns_of_the_probe_are_told_apart():
    assert list(itertools.chain((NUMBER, COUNT, SUBSTEPS, SPAN, GAPS, MODE))) == list(range(6))
