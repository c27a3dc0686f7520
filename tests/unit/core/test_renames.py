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
    with pytest.warns(FutureWarning, match="CameraConfig: reach is now called far"):
        assert sw.sensors.load_config(path).far == 10.0


def test_a_camera_config_reads_its_old_name() -> None:
    with pytest.warns(FutureWarning, match="CameraConfig: reach is now called far"):
        assert sw.sensors.CameraConfig(reach=3.0) == sw.sensors.CameraConfig(far=3.0)  # type: ignore[call-arg]


def test_arrays_and_methods_are_read_under_their_old_names() -> None:
    builder = sw.ModelBuilder()
    ball = builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
    with pytest.warns(FutureWarning, match="ModelBuilder: add_turn is now called add_joint_relative_rotation"):
        builder.add_turn("turn", sw.WORLD, ball, axis=(0.0, 0.0, 1.0))  # type: ignore[attr-defined]
    assert builder.joints[0].type is sw.JointType.RELATIVE_ROTATION is sw.JointType.TURN
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    with pytest.warns(FutureWarning, match="Diagnostics: bounded_residual is now called cone_residual"):
        assert sim.diagnostics.bounded_residual is sim.diagnostics.cone_residual
    with pytest.warns(FutureWarning, match="State: bounded_impulse is now called box_impulse"):
        assert sim.state.bounded_impulse is sim.state.box_impulse


def test_a_task_that_equips_is_attached(monkeypatch: pytest.MonkeyPatch) -> None:
    from simwarp import tasks

    kind = tasks.task_class("pendulum")
    monkeypatch.setattr(kind, "equip", lambda self, model: tasks.Attachments(), raising=False)
    with pytest.warns(FutureWarning, match="PendulumTask: equip is now called attach"):
        tasks.make("pendulum", 1)
    with pytest.warns(FutureWarning, match="tasks: Equipment is now called Attachments"):
        assert tasks.Equipment is tasks.Attachments


def test_a_task_option_is_read_under_its_old_name(capsys: pytest.CaptureFixture[str]) -> None:
    from simwarp.cli.options import parse_options
    from simwarp.tasks.cart_pole_base import CartPoleConfig

    assert parse_options(CartPoleConfig, ["--quirks"], "simwarp").legacy_compat
    assert "simwarp: --quirks is now called --legacy-compat; the old name goes" in capsys.readouterr().err
