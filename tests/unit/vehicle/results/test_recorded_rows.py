"""Rows of a record: made many at a time, of many worlds, and of steps that nobody looks at in between."""

import numpy as np
import pytest
import warp as wp

from simwarp.core.host_views import HostViews
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results import channels
from simwarp.vehicle.results.channels import Recorder
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle

DT = 2e-3


def drive(name="hmmwv-14dof", worlds=1, seconds=0.3, dt=DT, channels=()):
    spec = load_vehicle(name)
    what = maneuver("double-lane-change", spec, speed=10.0, duration=seconds)
    setup = set_up(spec, what, worlds=worlds, device="cpu", dt=dt)
    return Drive(setup, worlds=slice(0, worlds), channels=channels)


@pytest.mark.quick("hmmwv-14dof")
@pytest.mark.parametrize("name", ["hmmwv-14dof", "gator"])
def test_rows_made_many_at_a_time_are_those_made_one_by_one(monkeypatch, name):
    """Bit by bit, beside recorders of each world alone, with the inputs of the step after and without."""
    made = drive(name, worlds=3)
    simulation, vehicle = made.setup.simulation, made.setup.vehicle
    vehicle.input.assign(np.array([[0.1, 0.5, 0.0, 0.0], [-0.1, 0.6, 0.0, 0.0], [0.0, 0.7, 0.0, 0.0]], np.float32))
    together, at_once = (Recorder(simulation, vehicle, slice(0, 3)) for _ in range(2))
    single = [Recorder(simulation, vehicle, slice(world, world + 1)) for world in range(3)]
    for sample in range(9):
        for each in (together, *single):
            each.sample()
            assert each._taken
        with monkeypatch.context() as patched:
            patched.setattr(channels, "MOST_TAKEN", 1)
            at_once.sample()
        assert not at_once._taken
        simulation.step(3)
        if sample % 2:
            for each in (together, at_once, *single):
                each.record_inputs()
        if sample == 4:
            assert len(together.rows) == 5  # a look in between
    table = together.table()
    assert table.shape == (9, 3, len(together.names))
    assert np.array_equal(table, at_once.table())
    assert np.array_equal(table, np.concatenate([each.table() for each in single], axis=1))
    assert not np.array_equal(table[:-1], table[1:])
    # accelerations are differences of velocities, and rows are of their times
    assert np.all(np.diff(together.column("t_s"), axis=0) == pytest.approx(3 * DT))


def test_steps_at_once_are_steps_one_by_one():
    quick, slow, seen = drive(), drive(), []
    slow.after_step = lambda: seen.append(float(slow.setup.simulation.time.numpy()[0]))
    found, wanted = quick.run(), slow.run()
    assert found.columns.keys() == wanted.columns.keys()
    for name, values in wanted.columns.items():
        assert np.array_equal(found[name], values), name
    total = round((quick.setup.maneuver.start + quick.setup.maneuver.duration) / DT)
    assert len(seen) == total
    assert len(found["t_s"]) == total // 5 + 1


def test_a_step_that_does_not_divide_the_time_between_rows_is_recorded_each_time():
    made = drive(seconds=0.05, dt=3e-3)
    made.after_step = None
    run = made.run()
    assert np.diff(run["t_s"]) == pytest.approx(0.01)
    assert len(made.recorder.rows) == round((made.setup.maneuver.start + 0.05) / 3e-3 + 0.49) + 1


def test_runs_of_all_worlds_are_those_of_each():
    made = drive(worlds=2, seconds=0.05)
    made.run()
    for world, run in enumerate(made.results()):
        alone = made.result(world)
        assert all(np.array_equal(run[name], values) for name, values in alone.columns.items())


def test_views_of_arrays_go_on_with_them():
    views, array = HostViews(), wp.zeros(3, dtype=float, device="cpu")
    first = views.of(array)
    array.fill_(2.0)
    assert views.of(array) is first
    assert first.tolist() == [2.0, 2.0, 2.0]
    # arrays that are made anew do not pile up
    for _ in range(1000):
        assert views.of(wp.zeros(1, dtype=float, device="cpu")).tolist() == [0.0]
    assert len(views._views) <= 256
