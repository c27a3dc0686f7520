"""A HMMWV on rigid wheels over mid soil, against a recorded run of Chrono's SCM and against itself at longer steps."""

from __future__ import annotations

import csv
import functools
import gzip
from pathlib import Path

import numpy as np
import pytest

from simwarp.soil import soil_under
from simwarp.vehicle import load_vehicle, with_options
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.verify.recorded_signs import with_iso_signs

RECORD = Path(__file__).parents[3] / "shared" / "reference" / "chrono" / "g_full_RIGID_scm.csv.gz"
WHEELS = ("FL", "FR", "RL", "RR")
STEADY = 2.5
"""From then on the speed changes by 3 % [s]."""


@functools.cache
def driven(dt: float, vehicle: str = "hmmwv", soil: str = "mid") -> Run:
    spec = with_options(load_vehicle(vehicle), tire="soil-rigid")
    setup = set_up(
        spec, maneuver("reference-soil", spec), device="cpu", dt=dt, elements=lambda car: [soil_under(car, soil)]
    )
    run = Drive(setup).run()
    assert setup.simulation.problems() == []
    return run


@pytest.fixture(scope="module")
def recorded() -> dict[str, np.ndarray]:
    if not RECORD.exists():
        pytest.skip("the recorded runs are not here")
    with gzip.open(RECORD, "rt") as file:
        rows = list(csv.DictReader(file))
    return with_iso_signs({name: np.array([float(row[name]) for row in rows]) for name in rows[0]})


@pytest.fixture(scope="module")
def ours(recorded) -> dict[str, np.ndarray]:
    columns = driven(1e-3).columns
    return {name: np.interp(recorded["t_s"], columns["t_s"], values) for name, values in columns.items()}


def steady(run: dict[str, np.ndarray], name: str) -> float:
    return float(run[name][run["t_s"] > STEADY].mean())


def test_speed_and_way(recorded, ours):
    assert ours["speed_mps"][-1] == pytest.approx(recorded["speed_mps"][-1], rel=0.03)
    ways = [run["x_m"] + 15.0 for run in (recorded, ours)]
    late = ways[0] > 0.75  # 2 cm of the first half metre, from rest, are more than 3 %
    assert np.abs(ways[1][late] / ways[0][late] - 1.0).max() < 0.03


def test_wheels(recorded, ours):
    for wheel in WHEELS:
        assert steady(ours, f"omega_{wheel}_radps") == pytest.approx(steady(recorded, f"omega_{wheel}_radps"), rel=0.03)
        assert steady(ours, f"Fz_{wheel}_N") == pytest.approx(steady(recorded, f"Fz_{wheel}_N"), rel=0.04)


def test_ruts_and_pitch(recorded, ours):
    for wheel in WHEELS:
        assert steady(ours, f"sink_{wheel}_m") == pytest.approx(steady(recorded, f"sink_{wheel}_m"), rel=0.12)
    assert steady(ours, "pitch_rad") == pytest.approx(steady(recorded, "pitch_rad"), abs=0.003)


def test_longer_steps_drive_as_fast():
    speeds = [float(driven(dt)["speed_mps"][-100:].mean()) for dt in (1e-3, 2e-3, 3e-3)]
    assert speeds == pytest.approx([speeds[0]] * 3, rel=0.01)


@pytest.mark.parametrize(("soil", "share"), [("soft", 0.02), ("mid", 0.01), ("hard", 0.04)])
def test_a_gator_drives_at_steps_of_2_5_ms(soil, share):
    """A light vehicle on small wheels. On hard soil it moves by a quarter of its contact within a step, at 6 m/s."""
    fine, coarse = (driven(dt, "gator", soil).columns for dt in (1e-3, 2.5e-3))
    late = fine["t_s"] > STEADY
    assert coarse["speed_mps"][late].mean() == pytest.approx(fine["speed_mps"][late].mean(), rel=share)
    for wheel in WHEELS:
        rut, load = f"sink_{wheel}_m", f"Fz_{wheel}_N"
        assert coarse[rut][late].mean() == pytest.approx(fine[rut][late].mean(), rel=0.03)
        assert coarse[load][late].mean() == pytest.approx(fine[load][late].mean(), rel=0.05)
