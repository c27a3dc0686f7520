"""`simwarp bench`: cold starts, wrong input, sensors and threads."""

import json
import math
import subprocess
import sys

import pytest

from simwarp import cli
from simwarp.bench import workloads


@pytest.mark.slow
def test_cold_start_is_measured_in_a_new_process(bench):
    code, result, _ = bench("simple-pendulum", "--worlds", "1", "--compile")
    assert code == 0
    row = result["rows"][0]
    assert row["compile_source"] == "cold process"
    assert row["compile_s"] > 3.0 * row["compile_warm_s"] > 0.0
    assert row["compile_cpu_s"] > row["compile_warm_s"]


@pytest.mark.slow
def test_the_last_of_many_models_compiles_nothing(tmp_path):
    file = tmp_path / "models.json"
    done = subprocess.run(
        [sys.executable, "benchmarks/hundred_models.py", "--models", "6", "--max-bodies", "3", "--json", str(file)],
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(file.read_text(encoding="utf-8"))
    assert result["rows"][0]["compiled"] >= 1
    assert result["last_compiled"] == 0


@pytest.mark.slow
def test_the_script_writes_tables_and_what_the_time_goes_to(tmp_path):
    done = subprocess.run(
        [
            sys.executable, "benchmarks/contact_peers.py", "--scenes", "ant", "--seconds", "0.02", "--no-peers",
            "--out", str(tmp_path),
        ],
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "ant.json").read_text(encoding="utf-8"))
    assert [row["worlds"] for row in result["rows"]] == [1, 256, 1024, 4096]
    parts = result["breakdown_us"]
    assert all(parts[key] > 0.0 for key in ("whole", "motion", "collision", "free_motion"))
    # differences of times, which have any sign where other work runs beside
    assert all(math.isfinite(parts[key]) for key in ("contact_rows", "solve"))


# ---- wrong input -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "which scene?"),
        (["pendulm"], "did you mean pendulum"),
        (["fast-taks"], "did you mean"),
        (["hexapood"], "did you mean hexapod"),
        (["stak"], "did you mean stack"),
        (["camra"], "did you mean camera"),
        (["pendulum", "--worlds", "0"], "at least 1"),
        (["pendulum", "--worlds", "-4"], "at least 1"),
        (["pendulum", "--worlds", "1,,2"], "whole numbers"),
        (["pendulum", "--worlds", "1e3"], "whole numbers"),
        (["pendulum", "--worlds", "99999999999"], "use fewer worlds"),
        (["pendulum", "--device", "tpu"], "device 'tpu' is not available"),
        (["pendulum", "--dt", "0"], "dt must be a positive number"),
        (["pendulum", "--dt", "nan"], "dt must be a finite number"),
        (["pendulum", "--seconds", "-1"], "seconds must be a positive number"),
        (["pendulum", "--world", "1"], "did you mean --worlds?"),
        (["pendulum", "--json", "/no/such/folder/x.json"], "does not exist"),
    ],
)
def test_one_line_and_exit_code_2(capfd, arguments, words):
    assert cli.main(["bench", *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert words in err


def test_help_lists_the_scenes(capfd):
    assert cli.main(["bench", "--help"]) == 0
    out = capfd.readouterr().out
    assert all(name in out for name in ("linkage", "pendulum", "pendulum-task", "fast"))


@pytest.mark.quick("camera-flat", "lidar")
@pytest.mark.parametrize("name", [name for name in workloads.SENSOR_SCENES if name != "rays"])
def test_every_sensor_is_timed_on_frames_that_show_something(bench, name, row_keys):
    code, result, err = bench(name, "--worlds", "2")
    assert code == 0, err
    (row,) = result["rows"]
    assert set(row) >= row_keys
    assert (result["kind"], row["scene"], row["valid"]) == ("sensor", name, True)
    assert row["bytes_per_world"] > 0


@pytest.mark.slow
def test_rays_are_timed_beside_embree_on_the_same_hits(bench):
    pytest.importorskip("embreex")
    code, result, err = bench("rays", "--worlds", "2", "--peers")
    assert code == 0, err
    assert [row["scene"] for row in result["rows"]] == ["rays-10k", "rays-200k"]
    assert [(row["engine"], row["valid"]) for row in result["peers"]] == [("embree", True)] * 2
    # geometry is shared: a world has a place in it, no copy (a mesh of 10 k triangles takes half a megabyte)
    assert all(row["bytes_per_world"] < 100_000 for row in result["rows"])
    assert result["rows"][1]["bytes_shared"] > 5 * result["rows"][0]["bytes_shared"]
    assert "rays-200k" in err


def test_rows_of_threads(bench):
    code, result, err = bench("pendulum", "--worlds", "1,12", "--threads", "1,2", "--peers")
    assert code == 0, err
    assert [(row["worlds"], row["threads"]) for row in result["rows"]] == [(1, 1), (1, 2), (12, 1), (12, 2)]
    assert [(row["worlds"], row["threads"]) for row in result["peers"]] == [(1, 1), (1, 2), (12, 1), (12, 2)]
    # the motion is the same, so are its residuals; launches are counted over all worlds
    assert result["rows"][2]["residual"] == result["rows"][3]["residual"]
    assert {row["launches_per_step"] for row in result["rows"]} == {1}


def test_by_default_one_thread_and_all(bench, monkeypatch):
    monkeypatch.setenv("SIMWARP_THREADS", "3")
    _, result, err = bench("pendulum", "--worlds", "12")
    assert [row["threads"] for row in result["rows"]] == [1, 3]
    assert "threads" in err


@pytest.mark.parametrize(("text", "message"), [
    ("0", "threads must each be at least 1, got '0'"), ("two", "threads must be whole numbers with commas"),
    ("4096", "threads must each be at most 1024, got '4096'"),
])  # fmt: skip
def test_threads_that_are_none(bench, text, message):
    code, _, err = bench("pendulum", "--threads", text)
    assert code == 2
    assert message in err
