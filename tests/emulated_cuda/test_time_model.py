"""The model of an H100 against kernels of an H200 that it was fitted to, and what any such model must say."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from tests.emulated_cuda.counts.launch_counts import KernelCount
from tests.emulated_cuda.counts.scene_counts import SAMPLE
from tests.emulated_cuda.counts.time_model import H100, Gpu, kernel_seconds, occupancy


@dataclasses.dataclass(frozen=True)
class Measured:
    """A kernel in a step of so many worlds, counted and measured."""

    worlds: int
    count: KernelCount
    registers: int
    microseconds: float

    def model(self, gpu: Gpu) -> float:
        """Time by model [us]."""
        warps = max(1, round(self.count.warps / self.count.launches * self.worlds / SAMPLE))
        return 1e6 * kernel_seconds(gpu, self.count, warps=warps, registers=self.registers, block=BLOCK)


BLOCK: Final = 32
DATA: dict[str, Any] = json.loads((Path(__file__).parents[1] / "data" / "gpu_model.json").read_text(encoding="utf-8"))
RUNS: Final = {
    (run["scene"], run["worlds"]): [
        Measured(run["worlds"], KernelCount(**row["count"]), row["registers"], row["measured_us"])
        for row in run["kernels"]
    ]
    for run in DATA["runs"]
}
COUNTS: Final = {scene: [each.count for each in kernels] for (scene, _), kernels in RUNS.items()}
LONG: Final = 15.0
"""Shorter kernels [us] are mostly their launch."""


def errors(gpu: Gpu, *, without: object = None, only: object = None) -> np.ndarray:
    """Logarithms of model over measurement."""
    runs = [kernels for name, kernels in RUNS.items() if name != without and only in (None, name)]
    long = [each for each in itertools.chain.from_iterable(runs) if each.microseconds > LONG]
    return np.array([math.log(each.model(gpu) / each.microseconds) for each in long])


def factor(found: np.ndarray) -> float:
    """By how much a kernel is off on average."""
    return math.exp(float(np.abs(found).mean()))


def fitted(without: object = None) -> Gpu:
    """Least squares of the logarithms over the two constants."""
    grid = itertools.product(np.arange(1.0, 2.5, 0.2).round(1), np.arange(0.8, 2.3, 0.2).round(1))
    tried = [dataclasses.replace(H100, latency_factor=float(f), sector_cycles=float(s)) for f, s in grid]
    return min(tried, key=lambda gpu: float(np.square(errors(gpu, without=without)).sum()))


@pytest.mark.parametrize("run", RUNS, ids=str)
def test_a_step_is_as_long_as_measured(run):
    model, measured = (sum(times) for times in zip(*((k.model(H100), k.microseconds) for k in RUNS[run]), strict=True))
    assert model == pytest.approx(measured, rel=0.3)


def test_its_constants_are_those_of_a_fit_that_holds_for_what_was_left_out():
    """A kernel is off by a factor of 1.34 on average, and so it is in steps that the fit did not see."""
    assert fitted() == H100
    assert factor(errors(H100)) < 1.36
    unseen = np.concatenate([errors(fitted(without=run), only=run) for run in RUNS])
    assert factor(unseen) < 1.4


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
