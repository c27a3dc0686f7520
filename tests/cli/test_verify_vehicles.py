"""`simwarp verify vehicles`: what is compared, and that a difference shows. The runs themselves: tests/physics."""

import dataclasses
import json

import numpy as np
import pytest

from scripts.pack_vehicle_runs import pack_runs
from simwarp import verify
from simwarp.cli import main
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.verify import known, vehicle_cases, vehicle_runs as vehicles
from simwarp.verify.check_result import below
from simwarp.verify.vehicle_cases import COLUMNS, LOADS, SHIPPED, Case, case_of, cases_in, read_folder, read_shipped


@pytest.fixture(scope="module")
def shipped():
    return {case.name: (case, run) for case, run in read_shipped().items()}


def changed(run: Run, **columns) -> Run:
    return Run({**run.columns, **columns})


def missed(case, known, ours) -> set[str]:
    """Quantities that fail, without their units."""
    return {row.quantity.split("[")[0].strip(" ,") for row in vehicles.compare(case, known, ours) if not row.passed}


def test_shipped_runs_are_those_of_the_contract(shipped):
    assert {case.title for case, _ in shipped.values()} == {
        "hmmwv tmeasy accel", "hmmwv tmeasy steer", "hmmwv tmeasy brake", "hmmwv tmeasy steer 2 ms",
        "hmmwv fiala steer", "hmmwv pacejka89 accel", "hmmwv pacejka2002 accel", "hmmwv-reduced tmeasy accel",
        "hmmwv-reduced tmeasy steer", "gator tmeasy accel", "artcar tmeasy accel",
    }  # fmt: skip
    assert SHIPPED.stat().st_size < 500_000
    with np.load(SHIPPED) as file:
        assert "7689fbc" in str(file["header.scale"])
    # numbers that the recording's own summary tells
    _, steer = shipped["f_full_TMEASY_steer_it500"]
    late = steer["t_s"] > 22.0
    assert steer["yawrate_radps"][late].mean() == pytest.approx(0.4731, abs=5e-4)
    assert steer["speed_mps"][late].mean() == pytest.approx(11.925, abs=5e-3)
    _, gator = shipped["f_gator_TMEASY_accel"]
    assert gator["speed_mps"].max() == pytest.approx(7.94, abs=0.01)


def test_names_of_recorded_runs():
    assert case_of("f_full_TMEASY_steer_dt2000us") == Case(
        "f_full_TMEASY_steer_dt2000us", "hmmwv", "tmeasy", "reference-steer", None, 2e-3, 0
    )
    case = case_of("f_full_PAC89_simplemap_brake_it500")
    assert case is not None
    assert (case.tire, case.powertrain, case.maneuver, case.iterations) == (
        "pacejka89", "simplemap", "reference-brake", 500
    )  # fmt: skip
    for name in ("f_info_full", "f_full_RIGID_accel", "f_iteration_convergence", "d_dpend_RK4_reference"):
        assert case_of(name) is None
    names = ["f_full_TMEASY_accel", "f_full_TMEASY_accel_it500", "f_full_TMEASY_accel_it150", "f_full_FIALA_accel"]
    assert {case.name for case in cases_in(names)} == {"f_full_TMEASY_accel_it500", "f_full_FIALA_accel"}


def test_a_run_agrees_with_itself(shipped):
    for case, run in shipped.values():
        assert missed(case, run, run) == set()


def test_every_difference_shows(shipped):
    case, run = shipped["f_full_TMEASY_steer_it500"]
    t, speed, yaw = run["t_s"], run["speed_mps"], run["yawrate_radps"]
    faster = changed(run, speed_mps=1.02 * speed)
    assert {"speed, RMS", "distance"} <= missed(case, run, faster)
    assert {"yaw rate, RMS", "v x yaw rate, RMS"} <= missed(case, run, changed(run, yawrate_radps=1.08 * yaw))
    heavy = changed(run, Fz_RL_N=run["Fz_RL_N"] + 300.0)
    assert missed(case, run, heavy) == {"load RL, RMS"}
    # a rattle beyond the low-pass is none of it
    rattling = changed(run, Fz_FL_N=run["Fz_FL_N"] + 600.0 * (-1.0) ** np.arange(len(t)))
    assert missed(case, run, rattling) == set()
    late = changed(run, gear=np.interp(t - 0.06, t, run["gear"]).round())
    assert missed(case, run, late) == {"gear change 1 at", "gear change 2 at"}
    assert missed(case, run, changed(run, gear=np.minimum(run["gear"], 2.0))) == {"gear changes"}
    short = Run({name: values[:-200] for name, values in run.columns.items()})
    assert "time compared" in missed(case, run, short)
    # the settling before t = 0 does not count
    settling = {name: np.where(t < 0.0, run[name] + 100.0, run[name]) for name in ("speed_mps", *LOADS)}
    assert missed(case, run, changed(run, **settling)) == set()


def test_straight_runs_have_absolute_tolerances(shipped):
    case, run = shipped["f_full_TMEASY_accel_it500"]
    assert missed(case, run, changed(run, yawrate_radps=run["yawrate_radps"] + 0.005)) == set()
    assert missed(case, run, changed(run, yawrate_radps=run["yawrate_radps"] + 0.03)) == {
        "yaw rate, RMS", "v x yaw rate, RMS"
    }  # fmt: skip


def test_low_pass_passes_below_and_stops_above_its_cutoff():
    t = np.arange(0.0, 10.0, 0.01)
    for frequency, gain in ((0.5, 1.0), (10.0, 0.5), (35.0, 0.005)):
        wave = np.sin(2.0 * np.pi * frequency * t + 0.3)
        assert vehicles.rms(vehicle_cases.low_pass(wave, 0.01)[200:-200]) == pytest.approx(gain * 0.5**0.5, abs=0.02)
    assert vehicle_cases.low_pass(np.full(50, 3.0), 0.01) == pytest.approx(3.0)


def test_a_folder_of_files_and_plots(tmp_path, capsys, monkeypatch, shipped):
    case, run = shipped["f_gator_TMEASY_accel"]
    short = Run({name: np.interp(np.arange(-1.0, 2.005, 0.01), run["t_s"], run[name]) for name in COLUMNS})
    table = np.array([short[name] for name in COLUMNS]).T
    np.savetxt(tmp_path / f"{case.name}.csv", table, delimiter=",", header=",".join(COLUMNS), comments="")
    monkeypatch.setattr(vehicles, "repeat", lambda case, device: short)
    arguments = ["verify", "vehicles", "--reference", str(tmp_path), "--plots", str(tmp_path / "new"), "--json", "-"]
    assert main(arguments) == 0
    content = json.loads(capsys.readouterr().out)
    assert {row["scene"] for row in content["rows"]} == {"vehicles: gator tmeasy accel"}
    assert set(content["rows"][0]) == {"scene", "quantity", "expected", "got", "tolerance", "pass", "known"}
    assert (tmp_path / "new" / f"{case.name}.png").read_bytes()[:4] == b"\x89PNG"


def test_the_engine_repeats_a_run(shipped):
    case, known = shipped["f_gator_TMEASY_accel"]
    ours = vehicles.repeat(dataclasses.replace(case, dt=2e-3), "cpu")
    assert (ours["t_s"][0], ours["t_s"][-1]) == (-1.0, 20.0)
    assert "speed, RMS" not in missed(case, known, ours)


def test_wrong_folders_are_one_line(tmp_path, capsys):
    for folder, words in ((tmp_path / "none", "no folder"), (tmp_path, "no recorded run")):
        assert main(["verify", "vehicles", "--reference", str(folder)]) == 2
        assert words in capsys.readouterr().err
    (tmp_path / "f_full_TMEASY_accel.csv").write_text("t_s,speed_mps\n0,1\n")
    with pytest.raises(SpecError, match="lacks the column yawrate_radps"):
        read_folder(tmp_path)
    assert main(["verify", "pendulum", "--plots", str(tmp_path)]) == 2
    assert "belong to the scene 'vehicles'" in capsys.readouterr().err


def test_the_table_is_packed_and_read_back(tmp_path, monkeypatch, shipped):
    case, run = shipped["f_artcar_TMEASY_accel"]
    table = np.array([run[name] for name in COLUMNS]).T
    np.savetxt(tmp_path / f"{case.name}.csv", table, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.7g")
    pack_runs(tmp_path, tmp_path / "packed.npz")
    monkeypatch.setattr(vehicle_cases, "SHIPPED", tmp_path / "packed.npz")
    ((again, packed),) = read_shipped().items()
    assert again == case
    for name in COLUMNS:
        assert packed[name] == pytest.approx(run[name], abs=0.011)


YAW, OTHER = "yaw rate, RMS [rad/s]", "distance [m]"
"""Of the Gator: one that is listed as known up to 0.03 rad/s, with a tolerance of 0.02, and one that is not."""


@pytest.mark.parametrize(
    ("got", "other", "code", "counts", "words"),
    [
        (0.028, 0.5, 0, (1, 1, 0), "1 passed, 1 known deviation, 0 failed"),
        (0.035, 0.5, 1, (1, 0, 1), f"{YAW} is a known deviation that has got worse"),
        (float("nan"), 0.5, 1, (1, 0, 1), "0 known deviations, 1 failed"),
        (0.015, 0.5, 0, (2, 0, 0), f"{YAW} is within its tolerance now: take it off the list"),
        (0.028, 1.5, 1, (0, 1, 1), "0 passed, 1 known deviation, 1 failed"),
    ],
)
def test_known_deviations_are_told_apart_from_failures(monkeypatch, capsys, got, other, code, counts, words):
    def runs(device: str, **options: object) -> list:
        """One quantity that is listed as known and one that is not."""
        return [
            below("vehicles: gator tmeasy accel", YAW, got, 0.02),
            below("vehicles: gator tmeasy accel", OTHER, other, 1.0),
        ]

    monkeypatch.setitem(verify.SCENES, "vehicles", runs)
    assert main(["verify", "vehicles", "--json", "-"]) == code
    captured = capsys.readouterr()
    content = json.loads(captured.out)
    assert tuple(content[key] for key in ("passed", "known", "failed")) == counts
    assert words in " ".join(captured.err.split())
    first, second = content["rows"]
    assert "docs/decisions.md" in first["known"]
    assert second["known"] is None
    assert (first["pass"], second["pass"]) == (got <= 0.02, other <= 1.0)


def test_known_deviations_are_of_runs_and_quantities_that_there_are_and_beyond_their_tolerances(shipped):
    names = {f"vehicles: {case.title}": (case, run) for case, run in shipped.values()}
    for (scene, quantity), (most, _) in known.KNOWN.items():
        rows = {row.quantity.partition(" [")[0]: row for row in vehicles.compare(*names[scene], names[scene][1])}
        assert rows[quantity].tolerance < most


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lambda table: table[:0], "must have rows"),
        (lambda table: table[150:], "t_s: must increase from before"),
        (lambda table: table[::-1], "t_s: must increase"),
        (lambda table: np.where(np.arange(9) == 1, 3.0, table), "speed_mps: must change"),
        (lambda table: np.where(np.arange(9) == 4, np.nan, table), "finite numbers"),
    ],
)
def test_records_that_nothing_can_be_compared_with_are_one_line(tmp_path, capsys, shipped, harm, words):
    case, run = shipped["f_gator_TMEASY_accel"]
    table = harm(np.array([run[name] for name in COLUMNS]).T)
    np.savetxt(tmp_path / f"{case.name}.csv", table, delimiter=",", header=",".join(COLUMNS), comments="")
    assert main(["verify", "vehicles", "--reference", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
