"""`simwarp bench --peers`: other engines beside ours, on the same model, moving alike."""

import dataclasses

import numpy as np
import pytest

from simwarp import scenes
from simwarp.bench import measure
from simwarp.bench.workloads import bench_scenes


def test_mujoco_stands_beside_the_cart_pole_and_moves_alike(bench, row_keys):
    pytest.importorskip("mujoco")
    from simwarp.bench.peers import AGREEMENT, differs_by

    # both are first-order in the step, 1 ms, which the falling pole amplifies some twenty times in a second
    assert differs_by(bench_scenes()["pendulum"]) < 0.1 * AGREEMENT
    code, result, err = bench("pendulum", "--worlds", "1,5", "--peers")
    assert code == 0, err
    assert [row["worlds"] for row in result["peers"]] == [1, 5]
    assert all(set(row) >= row_keys and row["valid"] for row in result["peers"])
    assert all(row["engine"].startswith("mujoco ") for row in result["peers"])
    assert any("newton" in note for note in result["notes"])


def test_a_peer_with_another_model_is_refused(monkeypatch):
    pytest.importorskip("mujoco")
    from simwarp.bench import peers

    monkeypatch.setattr(peers, "POLE_MASS", 1.0)
    row = peers.measure_mujoco(bench_scenes()["pendulum"], 1, "cpu", None, 0.02)
    assert not row.valid
    assert row.steps_per_s is None
    assert "not the same motion" in row.problems[0]


def test_the_ant_of_mujoco_is_ours_in_the_air():
    pytest.importorskip("mujoco")
    from simwarp.bench.contact_peers import MuJoCoRun, start_of

    # without ground nothing but the model and its motors can differ
    scene = dataclasses.replace(bench_scenes()["ant"], build=lambda: scenes.ant(ground=False), settle=0.0)
    run = measure.SceneRun(scene, 3, "cpu", 1e-3)
    run.set_motion()
    theirs = MuJoCoRun(scene, start_of(run), run.dt, 500, True)
    theirs.model.geom_contype[:] = 0
    theirs.model.geom_conaffinity[:] = 0
    for _ in range(500):
        run.single_step()
    for _ in range(theirs.horizon_steps):
        theirs.step()
    mine = start_of(run)
    np.testing.assert_allclose(theirs.now[:, 1:16], mine.qpos, atol=2e-3)
    np.testing.assert_allclose(theirs.now[:, 16:], mine.qvel, atol=0.05)


@pytest.mark.parametrize("name", ["ant", *(pytest.param(name, marks=pytest.mark.slow) for name in ("stack", "pile"))])
def test_mujoco_stands_beside_scenes_with_contacts(bench, name, row_keys):
    pytest.importorskip("mujoco")
    code, result, err = bench(name, "--worlds", "2", "--peers")
    assert code == 0, err
    row = result["peers"][0]
    assert set(row) >= row_keys
    assert row["engine"].startswith("mujoco ")
    assert row["valid"]
    assert row["residual"] is None
    assert row["contacts"] > 2.0


def test_an_ant_with_weak_motors_is_no_peer(monkeypatch):
    pytest.importorskip("mujoco")
    from simwarp.bench import contact_peers

    text = contact_peers.model_text("ant").replace('kp="20"', 'kp="4"')
    monkeypatch.setattr(contact_peers, "model_text", lambda name: text)
    contact_peers.their_motion.cache_clear()
    row = contact_peers.measure_peer("mujoco", bench_scenes()["ant"], 1, "cpu", None, 0.02)
    contact_peers.their_motion.cache_clear()
    assert not row.valid
    assert row.steps_per_s is None
    assert "mean height" in row.problems[0]


@pytest.mark.parametrize("module", ["mujoco_warp", "newton"])
def test_the_other_engines_stand_beside_the_ant_where_they_are_installed(module):
    pytest.importorskip(module)
    from simwarp.bench import contact_peers

    row = contact_peers.measure_peer(module, bench_scenes()["ant"], 2, "cpu", None, 0.02)
    assert row.valid, row.problems


def test_scenes_without_a_peer_say_so(bench):
    code, result, err = bench("four-bar", "--worlds", "1", "--peers")
    assert code == 0
    assert result["peers"] == []
    assert "no other engine has a model of 'four-bar'" in err
