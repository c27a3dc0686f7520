"""Fits of a robot to its own motion, of a soil to a wheeled vehicle's ruts, and of a vehicle to recorded runs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from simwarp.identify import Fit, fit_config
from simwarp.identify.document_numbers import replaced
from simwarp.identify.fit_config import of_target
from simwarp.identify.model_target import ModelTarget
from simwarp.identify.vehicle_target import VehicleTarget
from simwarp.identify.world_numbers import World

SHARED = Path(__file__).parents[3] / "shared" / "reference"
GO2 = SHARED / "robots" / "mjcf" / "go2" / "go2.xml"
RECORDED = SHARED / "chrono"


@pytest.mark.slow
@pytest.mark.skipif(not GO2.is_file(), reason="needs the robot's own file")
def test_inertias_of_a_quadruped_come_from_its_motion(tmp_path):
    """The trunk of the Go2: mass, centre and six entries of the inertia, told by a flight with legs that swing."""
    config = dataclasses.replace(of_target(str(GO2)), dt=0.002, sample=0.01)
    target = ModelTarget(config, "cpu", 1)
    trunk = next(name for name in target.model_names().body_names if "base" in name or "trunk" in name)
    index = next(i for i, body in enumerate(target.document["bodies"]) if body["name"] == trunk)
    joints = [name for name in target.model_names().joint_names if name.endswith("joint")]
    assert len(joints) == 12
    inertia = np.array(target.document["bodies"][index]["inertia"], float)
    inertia = np.diag(inertia) if inertia.ndim == 1 else inertia
    truth = {
        ("bodies", index, "mass"): 1.25 * target.document["bodies"][index]["mass"],
        ("bodies", index, "inertia"): (1.3 * inertia + np.diag([0.004, 0.0, 0.002])).tolist(),
        ("bodies", index, "com_shift", 0): 0.02,
    }
    document = replaced(target.document, truth)
    axes = [f"body_{kind}:{trunk}.{axis}" for kind in ("velocity", "rate") for axis in "xyz"]
    readings = [*axes, *(f"joint_{kind}:{name}" for name in joints for kind in ("position", "velocity"))]
    inputs = [f"joint_force:{name}" for name in joints]
    samples, steps = 60, 300
    times = 0.002 * np.arange(steps)
    rng = np.random.default_rng(5)
    push = np.stack([
        rng.uniform(1.0, 3.0) * np.sin(rng.uniform(12.0, 40.0) * times + rng.uniform(0.0, 6.0)) for _ in joints
    ], axis=1)  # fmt: skip
    start = {f"body_position:{trunk}.z": 2.0, f"body_rate:{trunk}.x": 1.5, f"body_rate:{trunk}.z": -1.0}
    differing = target.numbers(target.document, {}).different(target.numbers(document, {}))
    rollout = target.rollout(1, differing, readings, inputs)
    record = rollout.run([World(target.numbers(document, start), push, start)], samples)[:, 0]
    np.savez(tmp_path / "motion.npz", t_s=0.01 * np.arange(samples + 1), **dict(zip(readings, record.T, strict=True)))
    ends = np.append(times, [0.6])
    np.savez(tmp_path / "push.npz", t_s=ends, **dict(zip(inputs, np.vstack([push, push[-1:]]).T, strict=True)))
    fit = Fit(
        fit_config(
            {
                "target": str(GO2), "dt": 0.002, "sample": 0.01,
                "runs": [{"file": ["motion.npz", "push.npz"], "start": {f"body_position:{trunk}.z": 2.0}}],
                "readings": {name: {} for name in readings}, "inputs": {name: {"hold": True} for name in inputs},
                "parameters": {
                    f"bodies[{trunk}].mass": {}, f"bodies[{trunk}].inertia": {"meant": "inertia"},
                    f"bodies[{trunk}].com_shift[0]": {"low": -0.1, "high": 0.1, "scale": 0.01},
                },
            },
            folder=str(tmp_path),
        ),
        device="cpu", threads=1,
    )  # fmt: skip
    found = fit.run()
    body = next(each for each in found.document["bodies"] if each["name"] == trunk)
    assert found[f"bodies[{trunk}].mass"] == pytest.approx(truth["bodies", index, "mass"], rel=1e-3)
    assert found[f"bodies[{trunk}].com_shift[0]"] == pytest.approx(0.02, abs=2e-5)
    # a thousandth of the largest moment
    wanted = np.array(truth["bodies", index, "inertia"])
    np.testing.assert_allclose(np.array(body["inertia"], float), wanted, atol=1e-3 * wanted.max())


@pytest.mark.slow
def test_a_soil_comes_from_ruts_and_pull(tmp_path):
    """Exponent and frictional modulus from the depth of ruts, and from how the truck gains speed under throttle."""
    base = dataclasses.replace(of_target("hmmwv", soil="mid"), dt=0.002, sample=0.02)
    target = VehicleTarget(base, "cpu", 1)
    truth: dict[tuple[str | int, ...], float] = {("soil", "k_phi"): 1.2e6, ("soil", "exponent"): 0.95}
    document = replaced(target.document, truth)
    readings = ["speed_mps", *(f"sink_{wheel}_m" for wheel in ("FL", "FR", "RL", "RR"))]
    steps, samples = 600, 60
    times = 0.002 * np.arange(steps + 1)
    push = np.stack([np.clip(times - 0.4, 0.0, 0.7), np.zeros(steps + 1)], axis=1)
    rollout = target.rollout(1, {"soil"}, readings, ["throttle", "braking"])
    start = {"speed_mps": 2.0}
    record = rollout.run([World(target.numbers(document, start), push, start)], samples)[:, 0]
    np.savez(tmp_path / "ruts.npz", t_s=0.02 * np.arange(samples + 1), **dict(zip(readings, record.T, strict=True)))
    np.savez(tmp_path / "pedals.npz", t_s=times, throttle=push[:, 0], braking=push[:, 1])
    fit = Fit(
        fit_config(
            {
                "target": "hmmwv", "soil": "mid", "dt": 0.002, "sample": 0.02, "warmup": 0.0,
                "runs": [{"file": ["ruts.npz", "pedals.npz"], "start": start}],
                "readings": {name: {} for name in readings}, "inputs": {"throttle": {}, "braking": {}},
                "parameters": {"soil.k_phi": {}, "soil.exponent": {"low": 0.5, "high": 1.5}},
            },
            folder=str(tmp_path),
        ),
        device="cpu", threads=1,
    )  # fmt: skip
    found = fit.run()
    assert found["soil.k_phi"] == pytest.approx(1.2e6, rel=1e-3)
    assert found["soil.exponent"] == pytest.approx(0.95, rel=1e-3)


@pytest.mark.slow
@pytest.mark.skipif(not RECORDED.is_dir(), reason="needs the recorded runs of the reference")
def test_a_vehicle_fitted_to_recorded_runs_predicts_another():
    """Brakes and acceleration tell mass and engine; the step steer, which was held out, is predicted."""
    fit = Fit(
        fit_config(
            {
                "target": "hmmwv-reduced", "dt": 0.002, "sample": 0.02, "warmup": 1.0,
                "runs": [
                    {"file": "f_reduced_TMEASY_accel.csv", "name": "accel", "end": 10.0, "start": {"speed_mps": 0.0}},
                    {"file": "f_reduced_TMEASY_steer_it500.csv", "name": "steer", "held_out": True,
                     "start": {"speed_mps": 0.0}},
                ],
                "readings": {name: {} for name in ("speed_mps", "yawrate_radps", "engine_radps")},
                "inputs": {"steering": "steer", "throttle": {}, "braking": "brake"},
                "parameters": {
                    "chassis.components[0].mass": {"start": 1900.0, "prior": [2086.5, 200.0]},
                    "engine.torque": {"prior": [1.0, 0.05]},
                },
                "search": {"iterations": 8},
            },
            folder=str(RECORDED),
        ),
        device="cpu", threads=1,
    )  # fmt: skip
    found = fit.run()
    # force over mass is what an acceleration tells; of the two alone the priors decide
    assert found["chassis.components[0].mass"] / found["engine.torque"] == pytest.approx(2086.5, rel=0.05)
    held = {each.reading: each for each in found.readings if each.held_out}
    # the bounds of `verify vehicles`: 5 % of the steady yaw rate and of the speed
    for name in ("speed_mps", "yawrate_radps"):
        steady = held[name].time > 22.0
        assert held[name].predicted[steady].mean() == pytest.approx(held[name].measured[steady].mean(), rel=0.05)
