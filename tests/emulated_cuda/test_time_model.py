"""The model of an H100 against the table that it was fitted to, and against what any such model must say."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from tests.emulated_cuda.counts.launch_counts import KernelCount
from tests.emulated_cuda.counts.time_model import H100, kernel_seconds, occupancy

DATA: dict[str, Any] = json.loads((Path(__file__).parents[1] / "data" / "gpu_model.json").read_text(encoding="utf-8"))
COUNTS = {scene: [KernelCount(**row) for row in rows] for scene, rows in DATA["counts"].items()}


@pytest.mark.parametrize("row", DATA["rates"], ids=lambda row: f"{row['scene']} {row['worlds']} {row['block']}")
def test_it_reproduces_the_table_that_it_was_fitted_to(row):
    """Within 30 %: two constants for eight figures, of which some that should be alike differ by a third."""
    options = {"warps": row["worlds"] // 32, "block": row["block"], "registers": DATA["registers"]}
    step = sum(each.launches * kernel_seconds(H100, each, **options) for each in COUNTS[row["scene"]])
    assert row["worlds"] / step / 1e6 == pytest.approx(row["rate"], rel=0.3)


@pytest.mark.parametrize(
    ("warps", "block", "registers", "expected"),
    [
        (256, 256, 255, (8, 1)),  # 32 blocks: 100 multiprocessors have none
        (256, 32, 255, (2, 1)),
        (1024, 32, 128, (8, 1)),
        (132 * 20, 32, 128, (16, 2)),  # 16 warps of 128 registers fill the registers
        (132 * 64, 1024, 32, (64, 1)),
    ],
)
def test_warps_spread_over_multiprocessors(warps, block, registers, expected):
    assert dataclasses.astuple(occupancy(H100, warps=warps, block=block, registers=registers)) == expected


@pytest.mark.parametrize("name", ["slots", "cycles", "rounds", "load_sectors", "store_sectors", "l2_misses"])
def test_more_of_anything_is_never_faster(name):
    row = COUNTS["ant"][0]
    more = dataclasses.replace(row, **{name: 4 * getattr(row, name)})
    for warps in (1, 256, 4096):
        less_time = kernel_seconds(H100, row, warps=warps, registers=128, block=32)
        assert kernel_seconds(H100, more, warps=warps, registers=128, block=32) >= less_time


def test_a_gpu_that_is_full_takes_time_in_proportion():
    row = COUNTS["ant"][0]
    full = [kernel_seconds(H100, row, warps=132 * 16 * k, registers=128, block=32) - H100.launch for k in (1, 2, 4)]
    assert full == pytest.approx([full[0], 2 * full[0], 4 * full[0]])
