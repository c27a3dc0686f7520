"""`simwarp bench --peers` of scenes with flexible bodies: MuJoCo beside, with an error of its own."""

import numpy as np
import pytest

from simwarp.bench import flexible_peers
from simwarp.bench.flexible_peers import PEERS, flexible_peer_notes, measure_flex
from simwarp.bench.workloads import bench_scenes


@pytest.mark.slow
def test_mujoco_stands_beside_the_rod_with_its_own_error(bench, row_keys):
    pytest.importorskip("mujoco")
    code, result, err = bench("rod", "--worlds", "2", "--threads", "1", "--peers")
    assert code == 0, err
    (row,) = result["peers"]
    assert set(row) >= row_keys
    assert row["engine"].startswith("mujoco ")
    assert row["valid"]
    # both against beam theory, of equal elements
    assert 0.0 < row["error"] < 0.01
    assert 0.0 < result["rows"][0]["error"] < 0.01
    assert any(note.startswith("peer pyelastica: ") for note in result["notes"])
    assert "error at rest: simwarp 0.000" in err
    assert ", mujoco " in err


@pytest.mark.parametrize("name", PEERS)
def test_scenes_of_mujoco_have_the_sizes_and_masses_of_ours(name):
    mujoco = pytest.importorskip("mujoco")
    builder = bench_scenes()[name].build()
    moving = mujoco.MjModel.from_xml_string(PEERS[name]().moving)
    data = mujoco.MjData(moving)
    mujoco.mj_forward(moving, data)
    meshes = builder.flexible_meshes
    places = meshes[0].places if meshes else np.array([body.pose.position for body in builder.bodies])
    free = np.array([body > 0 for body in moving.flex_vertbodyid])
    mass = sum(body.mass for body in builder.bodies)
    # pins take a share of the clamped rod's, whose node at the clamp has half of one
    assert moving.body_mass.sum() == pytest.approx(mass, rel=0.03)
    if name != "rod":
        assert len(places) == moving.nflexvert
        assert np.abs(np.ptp(data.flexvert_xpos, axis=0) - np.ptp(places, axis=0)).max() < 1e-9
    else:
        assert free.sum() == flexible_peers.CELLS
        # clamped in the middle of the first edge, a metre before the end
        assert data.flexvert_xpos[:2, 0].mean() == pytest.approx(0.0, abs=1e-12)
        assert data.flexvert_xpos[:, 0].max() == pytest.approx(1.0, rel=1e-12)


def test_a_peer_that_is_not_at_rest_where_its_error_is_told_is_refused(monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(flexible_peers, "_error_at_rest", lambda name: (0.01, 0.5))
    row = measure_flex(bench_scenes()["rod"], 1, "cpu", None, 0.01)
    assert not row.valid
    assert row.steps_per_s is None
    assert "not at rest" in row.problems[0]


def test_scenes_that_no_peer_has_say_so(monkeypatch):
    assert "no other engine has a model of 'tire' here" in flexible_peer_notes("tire")[0]
    monkeypatch.setattr(flexible_peers.importlib.util, "find_spec", lambda name: None)
    assert flexible_peer_notes("rod") == [
        "peer mujoco: not installed; pip install 'simwarp[import]'", "peer pyelastica: not installed"
    ]  # fmt: skip
