"""Names of before: read for one release, with one warning that says the new one."""

import dataclasses
import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core import renames


@pytest.fixture(autouse=True)
def _nothing_told_yet(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(renames, "_told", set())
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        yield


def named(name: str, value: Any) -> dict[str, Any]:
    return {name: value}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("recovery_speed", "max_depenetration_velocity"),
        ("recovery_rate", "max_depenetration_rate"),
        ("contact_envelope", "contact_margin"),
        ("bounce_speed", "restitution_threshold"),
    ],
)
def test_solver_options_read_their_old_names(old: str, new: str) -> None:
    with pytest.warns(FutureWarning, match=f"SolverOptions: {old} is now called {new}") as told:
        options = sw.SolverOptions(**named(old, 0.125))
    assert len(told) == 1
    assert told[0].filename == __file__  # it blames the line that uses the old name
    assert options == sw.SolverOptions(**named(new, 0.125))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # told once
        assert getattr(options, old) == 0.125
        assert dataclasses.replace(options, **named(new, 0.5)) != options


def test_both_names_are_refused() -> None:
    with pytest.raises(sw.ModelError, match="bounce_speed is the old name of restitution_threshold, got both; give"):
        sw.SolverOptions(bounce_speed=0.1, restitution_threshold=0.1)  # type: ignore[call-arg]


def test_an_unknown_name_stays_unknown() -> None:
    with pytest.raises(TypeError, match="recovery"):
        sw.SolverOptions(recovery=1.0)  # type: ignore[call-arg]
    with pytest.raises(AttributeError, match="'SolverOptions' object has no attribute 'recovery'"):
        _ = sw.SolverOptions().recovery  # type: ignore[attr-defined]


def test_a_function_reads_the_old_name_of_an_option() -> None:
    problem: dict[str, Any] = {
        "N": np.eye(1, dtype=np.float32)[None],
        "r": -np.ones((1, 1), dtype=np.float32),
        "mu": np.zeros(0),
    }
    new = sw.solve_cone_problems(**problem, limit_count=1, fallback=False, device="cpu")
    with pytest.warns(FutureWarning, match="solve_cone_problems: rescue is now called fallback"):
        old = sw.solve_cone_problems(**problem, limit_count=1, rescue=False, device="cpu")  # type: ignore[call-arg]
    assert np.array_equal(old.impulse, new.impulse)


def test_a_sensor_file_reads_the_old_key(tmp_path: Path) -> None:
    path = tmp_path / "depth.json"
    path.write_text(json.dumps({"sensor": "camera", "reach": 10.0}))
    with pytest.warns(FutureWarning, match="depth.json: reach is now called far"):
        assert sw.sensors.load_config(path).far == 10.0


def test_a_camera_config_reads_its_old_name() -> None:
    with pytest.warns(FutureWarning, match="CameraConfig: reach is now called far"):
        assert sw.sensors.CameraConfig(reach=3.0) == sw.sensors.CameraConfig(far=3.0)  # type: ignore[call-arg]
