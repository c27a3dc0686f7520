"""Logs: units, rates, empty cells, and one clear line for whatever is wrong with them."""

import numpy as np
import pytest

from simwarp.identify import FitError, fit_config, read_fit
from simwarp.identify.log_checks import check_speed
from simwarp.identify.logs import RunLog, Signal, read_run

BASE = {
    "target": "hmmwv", "runs": [{"file": "log.csv"}], "readings": {"speed_mps": {"column": "v"}},
    "parameters": {"chassis.components[0].mass": {}},
}  # fmt: skip


def run_of(folder, text, **changes):
    (folder / "log.csv").write_text(text)
    config = fit_config({**BASE, **changes}, folder=str(folder))
    return read_run(config, config.runs[0])


def test_units_become_si_and_empty_cells_are_no_samples(tmp_path):
    text = "t,v,w\n0,36,\n500,,1\n1000,72,2\n1500,,3\n2000,36,4\n"
    run = run_of(
        tmp_path, text, time={"column": "t", "unit": "ms"},
        readings={"speed_mps": {"column": "v", "unit": "km/h"}, "yawrate_radps": {"column": "w", "unit": "deg/s"}},
    )  # fmt: skip
    np.testing.assert_allclose(run.readings["speed_mps"].value, [10.0, 20.0, 10.0])
    np.testing.assert_allclose(run.readings["speed_mps"].time, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(run.readings["yawrate_radps"].value, np.radians([1.0, 2.0, 3.0, 4.0]))
    assert (run.begin, run.end) == (0.5, 2.0)


def test_files_of_a_run_have_rates_and_clocks_of_their_own(tmp_path):
    np.savez(tmp_path / "fast.npz", t_s=np.arange(0.0, 2.0, 0.001), steer=np.zeros(2000))
    run = run_of(
        tmp_path, "t_s,v\n0,1\n1,2\n2,3\n2.4,3\n", inputs={"steering": "steer"},
        runs=[{"file": ["log.csv", "fast.npz"], "clock": [0.0, 0.5]}],
    )  # fmt: skip
    assert run.begin == 0.5
    assert run.inputs["steering"].time[0] == 0.5


def test_held_inputs_stay_and_others_are_linear():
    signal = Signal(np.array([0.0, 1.0]), np.array([2.0, 4.0]))
    np.testing.assert_allclose(signal.at(np.array([-1.0, 0.25, 0.999, 1.0, 3.0])), [2.0, 2.5, 3.998, 4.0, 4.0])
    np.testing.assert_allclose(signal.at(np.array([-1.0, 0.25, 0.999, 1.0, 3.0]), hold=True), [2, 2, 2, 4, 4])


@pytest.mark.parametrize(
    ("text", "changes", "words"),
    [
        ("t_s,speed\n0,1\n1,2\n", {}, "readings.speed_mps: there must be a column 'v'"),
        ("time,v\n0,1\n1,2\n", {}, "time: there must be a column 't_s'"),
        ("t_s,v\n0,1\n1,nan\n", {}, "line 3: column 'v' must be a finite number"),
        ("t_s,v\n0,1\n1,inf\n", {}, "line 3: column 'v' must be a finite number"),
        ("t_s,v\n0,1\n1,fast\n", {}, "must be a finite number, or empty where there is no sample, got 'fast'"),
        ("t_s,v\n0,1\n1\n", {}, "line 3: must have 2 cells as the header has names, got 1"),
        ("t_s,v\n0,1\n0,2\n", {}, "time: must rise from row to row, got 0 s after 0 s"),
        ("t_s,v\n,1\n1,2\n", {}, "time: column 't_s' must have no empty cells"),
        ("t_s,v,v\n0,1,1\n1,2,2\n", {}, "column 'v': given twice"),
        ("t_s,v\n", {}, "must have a header and 2 rows"),
        ("t_s,v\n0,1\n1,2\n2,3\n", {"runs": [{"file": "log.csv", "begin": 5.0}]}, "must have 2 values from 5 to 2 s"),
        ("t_s,v\n0,1\n1,2\n", {"runs": [{"file": "no.csv"}]}, "no.csv: cannot be read"),
        ("t_s,v\n0,1\n1,2\n", {"readings": {"speed_mps": {"column": "v", "unit": "kmh"}}}, "unit must be one that is"),
    ],
)
def test_a_bad_log_is_one_line(tmp_path, text, changes, words):
    with pytest.raises(FitError) as error:
        run_of(tmp_path, text, **changes)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_clocks_that_do_not_overlap_are_told_with_their_spans(tmp_path):
    np.savez(tmp_path / "late.npz", t_s=np.arange(100.0, 103.0), steer=np.zeros(3))
    with pytest.raises(FitError, match=r"clocks must overlap, got columns from 0 to 2 s, 100 to 102 s; give clock"):
        run_of(
            tmp_path, "t_s,v\n0,1\n1,2\n2,3\n", inputs={"steering": "steer"}, runs=[{"file": ["log.csv", "late.npz"]}]
        )  # fmt: skip


@pytest.mark.parametrize("array", [np.array([0.0, np.nan]), np.array([np.inf, 1.0])])
def test_numbers_of_npz_files_are_finite(tmp_path, array):
    np.savez(tmp_path / "log.npz", t_s=np.arange(2.0), v=array)
    config = fit_config({**BASE, "runs": [{"file": "log.npz"}]}, folder=str(tmp_path))
    with pytest.raises(FitError, match="array 'v' must have finite numbers"):
        read_run(config, config.runs[0])


def circle(factor):
    """A log of a circle at 10 m/s with a speed that is some times too large."""
    times = np.arange(0.0, 10.0, 0.02)
    signals = {
        "speed_mps": np.full(len(times), 10.0 * factor), "x_m": 30.0 * np.sin(times / 3.0),
        "y_m": 30.0 * (1.0 - np.cos(times / 3.0)), "yawrate_radps": np.full(len(times), 1.0 / 3.0),
        "latacc_com_mps2": np.full(len(times), 10.0 / 3.0),
    }  # fmt: skip
    return {name: Signal(times, values) for name, values in signals.items()}


def log_of(readings):
    return RunLog(config=fit_config(BASE).runs[0], readings=readings, inputs={}, begin=0.0, end=9.98)


@pytest.mark.parametrize(("factor", "unit"), [(3.6, "km/h"), (1.0 / 0.44704, "mph")])
@pytest.mark.parametrize("beside", [("x_m", "y_m"), ("yawrate_radps", "latacc_com_mps2")])
def test_a_speed_in_another_unit_is_guessed(factor, unit, beside):
    readings = {name: signal for name, signal in circle(factor).items() if name in ("speed_mps", *beside)}
    with pytest.raises(FitError, match=f'it looks like {unit}; give unit = "{unit}"'):
        check_speed(log_of(readings))


def test_a_right_speed_passes():
    check_speed(log_of(circle(1.0)))
    check_speed(log_of({"speed_mps": circle(3.6)["speed_mps"]}))  # nothing beside it tells


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"reading": {}}, "reading: unknown key"),
        ({"sample": 0.0105}, "sample: must be a whole multiple of dt"),
        ({"runs": [{"file": "log.csv", "held_out": True}]}, "runs: must have one that is not held out"),
        ({"runs": []}, "runs"),
        ({"runs": [{"file": ["a.csv", "b.csv"], "clock": [0.0]}]}, "clock: must have a number for each of 2 files"),
        ({"runs": [{"file": "a.csv", "begin": 2.0, "end": 1.0}]}, "end: must be above begin"),
        ({"parameters": {"mass": {"prior": [1.0, 0.0]}}}, "a mean and a standard deviation above 0"),
        ({"search": {"method": "newton"}}, "search.method"),
        ({"readings": {"speed_mps": {"noise": -1.0}}}, "readings.speed_mps.noise"),
    ],
)
def test_a_bad_configuration_is_one_line(changes, words):
    with pytest.raises(FitError) as error:
        fit_config({**BASE, **changes})
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("fit.toml", "target = ", "fit.toml: must be TOML"),
        ("fit.json", "[1]", "fit.json: must be a table of keys"),
        ("fit.toml", 'target = "hmmwv"\nfolder = "/"', "fit.toml: folder: unknown key"),
        ("fit.toml", 'target = "hmmwv"', "fit.toml: "),
    ],
)
def test_a_bad_file_is_named(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(FitError) as error:
        read_fit(tmp_path / name)
    assert words in str(error.value)
