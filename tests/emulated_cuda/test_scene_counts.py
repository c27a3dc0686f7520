"""`simwarp bench SCENE --device emulated`: rows made of counts, refusals, a scene from the command to its JSON."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys

import pytest

from simwarp.cli import UsageError
from tests.emulated_cuda.counts.scene_counts import SAMPLE, make_row, make_run
from tests.emulated_cuda.emulated_runs import ROOT, skip_where_unavailable
from tests.emulated_cuda.test_time_model import COUNTS

STEP = COUNTS["ant"][0]
"""Counts of 64 worlds: two warps."""


@pytest.mark.parametrize(
    ("name", "spacing", "words"),
    [
        ("ant-task", None, "'ant-task' cannot be counted"),
        ("rays", None, "'rays' cannot"),
        ("ant", 0.1, "--spacing is of"),
    ],
)
def test_what_cannot_be_counted_is_refused(name, spacing, words):
    with pytest.raises(UsageError, match=words):
        make_run(name, 1, None, spacing)


def test_a_row_is_of_one_warp_and_its_time_of_all_worlds():
    row = make_row(STEP, 8192, {STEP.kernel: (200, 16)})
    assert (row.registers, row.spilled, row.warps_per_multiprocessor) == (200, 16, 65536 // (200 * 32))
    assert row.issue_slots == STEP.slots / STEP.warps
    assert row.bytes == STEP.bytes_of_memory / SAMPLE
    assert 0.0 < row.lanes <= 1.0
    assert row.model_us < make_row(STEP, 131072, {}).model_us
    twice = dataclasses.replace(
        STEP, **{key: 2 * getattr(STEP, key) for key in ("launches", "warps", "slots", "lane_slots", "rounds", "cycles",
                 "loads", "load_sectors", "stores", "store_sectors", "l1_misses", "l2_misses", "written_back")},
    )  # fmt: skip
    assert make_row(twice, 8192, {STEP.kernel: (200, 16)}).model_us == pytest.approx(2.0 * row.model_us)
    assert make_row(STEP, 8192, {}).registers is None


@pytest.mark.slow
def test_a_scene_is_counted_from_the_command_line_to_its_file(tmp_path):
    """The same counts twice: what is counted does not depend on addresses or time."""
    skip_where_unavailable()
    found = []
    for run in range(2):
        path = tmp_path / f"{run}.json"
        command = [
            sys.executable,
            "-m",
            "simwarp",
            "bench",
            "double-pendulum",
            "--device",
            "emulated",
            "--json",
            str(path),
        ]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1200, check=False)
        assert done.returncode == 0, done.stderr
        assert "by model" in done.stdout
        found.append(json.loads(path.read_text(encoding="utf-8")))
    rows = found[0]["rows"]
    assert {"kernel", "registers", "issue_slots", "sectors", "bytes", "model_us"} <= set(rows[0])
    assert {"load_state", "move_freely", "publish_bodies"} <= {row["kernel"] for row in rows}
    assert all(row["lanes"] > 0.9 for row in rows), "worlds of a pendulum do the same"
    for name in ("issue_slots", "lanes", "sectors"):
        assert [row[name] for row in found[1]["rows"]] == [row[name] for row in rows]
