"""Files that a version wrote whose fields and modules had other names: all of them are still read."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import simwarp as sw
from simwarp.tasks.framework.replay import replay
from simwarp.tasks.pendulum import CartPoleConfig
from simwarp.train.config import task_config_from_plain
from simwarp.train.datasets.dataset_formats import load_trajectories
from simwarp.train.runs.checkpoint import load_checkpoint

BEFORE = Path(__file__).parents[2] / "data" / "before"


def test_a_checkpoint_is_read() -> None:
    content = load_checkpoint(BEFORE / "checkpoint.pt")
    assert "quirks" in content["task_config"]
    from simwarp.tasks import task_class

    config = task_config_from_plain(task_class("pendulum"), content["task_config"])
    assert isinstance(config, CartPoleConfig)
    assert not config.legacy_compat


def test_a_run_goes_on(tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(BEFORE / "run", run)
    from simwarp.train.runs.run_folder import open_run

    saved = open_run(run).load_config()
    assert saved["task_config"]["quirks"] is True
    from simwarp.cli.training import run as command

    assert command(["pendulum", "--resume", str(run), "--iterations", "3"]) == 0
    rows = (run / "progress.csv").read_text().splitlines()
    assert len(rows) == 4  # two iterations of before, one of now, below the names of the columns


def test_trajectories_are_read() -> None:
    assert len(load_trajectories(BEFORE / "trajectories.npz", "pendulum").actions) == 2000


def test_a_dump_is_replayed() -> None:
    assert replay(BEFORE / "dump.npz").reproduced


def scene() -> sw.ModelBuilder:
    """A spring, a rotation between bodies, a limit with friction, contact: all that has another name now."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(sw.WORLD, name="ground")
    arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.5, 0.0, 1.0)))
    box = builder.add_body("box", mass=2.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((2.0, 0.0, 0.49)))
    builder.add_shape_box(box, half=(0.5, 0.5, 0.5), name="box")
    builder.add_joint_revolute(
        "hinge", sw.WORLD, arm, axis=(0, 1, 0), anchor=(0, 0, 1), limit=(-0.05, 0.05), friction=0.1
    )
    builder.add_spring(
        "spring", sw.WORLD, arm, anchor0=(0.5, 0.0, 2.0), anchor1=(0.5, 0.0, 1.0), stiffness=50.0, damping=1.0
    )
    builder.add_joint_relative_rotation("turn", sw.WORLD, box, axis=(0, 0, 1))
    return builder


def test_a_snapshot_goes_on_as_it_did() -> None:
    sim = sw.Simulation(scene().finalize(2, "cpu"), 1e-3)
    sim.restore(sw.Snapshot.load(BEFORE / "snapshot.npz", sim))
    assert np.abs(sim.state.box_impulse.numpy()).max() > 0.0  # the warm start of the limit, under its new name
    for _ in range(20):
        sim.step()
    with np.load(BEFORE / "snapshot_after.npz") as after:
        # positions move by less than 0.1 m in 20 steps; float32 velocities of another processor differ by 1e-7
        np.testing.assert_allclose(sim.state.body_x.numpy(), after["x"], atol=1e-6)
        np.testing.assert_allclose(sim.state.joint_q.numpy(), after["q"], atol=1e-6)


def test_a_vehicle_and_a_sensor_are_read() -> None:
    read, gator = sw.vehicle.load(BEFORE / "vehicle.json"), sw.vehicle.load("gator")
    # files of before have no defaults of manoeuvres
    assert dataclasses.replace(read, maneuver_defaults=gator.maneuver_defaults) == gator
    assert "reach" in json.loads((BEFORE / "sensor.json").read_text())
    config = sw.sensors.load_config(BEFORE / "sensor.json")
    assert (config.far, config.width) == (10.0, 32)


def test_a_key_and_its_old_name_are_refused_together(tmp_path: Path) -> None:
    (tmp_path / "both.json").write_text(json.dumps({"sensor": "camera", "far": 5.0, "reach": 10.0}))
    with pytest.raises(sw.ModelError, match="unknown key"):
        sw.sensors.load_config(tmp_path / "both.json")
