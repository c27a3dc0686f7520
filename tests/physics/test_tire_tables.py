"""The grips in docs/vehicles.md and the tire machine measure the same tires: their peaks agree."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from simwarp.vehicle import load_vehicle, with_options
from simwarp.vehicle.rigs import TireSweep, run_tire_rig

PAGE = Path(__file__).resolve().parents[2] / "docs" / "vehicles.md"
ROW = re.compile(r"^\| `([\w-]+)`(?:, (front|rear))? \| `(\w+)` \| ([^|]+) \| [^|]+ \| ([\d.]+) \| ([\d.]+) \|", re.M)


class Row(NamedTuple):
    vehicle: str
    axle: str
    tire: str
    load: float
    lateral: float
    braking: float


def rows() -> list[Row]:
    block = PAGE.read_text(encoding="utf-8").split("<!-- grips of tires -->")[1].split("<!-- end of grips -->")[0]
    return [
        Row(vehicle, axle, tire, 1e3 * float(load), float(lateral), float(braking))
        for vehicle, axle, tire, load, lateral, braking in ROW.findall(block)
    ]


def test_the_page_has_rows():
    assert len(rows()) > 15
    assert {row.tire for row in rows()} >= {"tmeasy", "fiala", "pacejka89", "pacejka2002", "lugre"}


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row.vehicle}-{row.axle}-{row.tire}")
def test_peaks_of_the_page_are_those_of_the_rig(row):
    """Numbers of the page have two digits, and loads three: half a digit of either, and the tables' own spacing."""
    tire = with_options(load_vehicle(row.vehicle), tire=row.tire).axles[-1 if row.axle == "rear" else 0].tire
    # the range of the sweep is small: peaks are found beyond it
    curves = run_tire_rig(tire, TireSweep(loads=(row.load,), slip=0.1, angle=0.1, points=3))
    lateral = np.maximum(curves.peak_left, curves.peak_right)
    assert float(lateral[0, 0, 0]) == pytest.approx(row.lateral, abs=0.008)
    assert float(curves.peak_braking[0, 0, 0]) == pytest.approx(row.braking, abs=0.008)
