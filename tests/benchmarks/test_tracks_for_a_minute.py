"""The minute of a tracked vehicle: what is measured of chains, and some seconds of it on each ground."""

import numpy as np
import pytest

from benchmarks.tracks_for_a_minute import GROUNDS, ChainWatch, run, simulation, turns_around


@pytest.mark.parametrize("start", [0, 5, 17])
@pytest.mark.parametrize("sense", [1, -1])
def test_a_chain_goes_around_what_is_in_it_once(start, sense):
    angle = sense * np.linspace(0.0, 2.0 * np.pi, 23, endpoint=False)
    chain = np.roll(np.stack([2.0 * np.cos(angle), 0.5 * np.sin(angle)], axis=1), start, axis=0)
    centers = np.array([[0.0, 0.0], [1.7, 0.1], [-1.9, 0.0], [0.0, 0.6], [5.0, 1.0]])
    np.testing.assert_allclose(turns_around(chain, centers), sense * np.array([1, 1, 1, 0, 0]), atol=1e-12)


def test_a_chain_beside_its_wheels_and_a_sprocket_that_turns_in_it_are_found():
    sim, vehicle, _ = simulation("plane")
    watch = ChainWatch(sim, vehicle)
    assert watch.read() == {"on": 1.0, "aside": pytest.approx(0.0, abs=1e-5), "skipped": pytest.approx(0.0, abs=1e-5)}
    side = vehicle.parts.chains[0]
    x, q = sim.state.body_x.numpy(), sim.state.joint_x.numpy()
    x[0, list(side.shoes), 1] += 0.05  # guides have a quarter of that
    q[0, sim.model.joint_dof_start[side.sprocket]] += 0.2 * np.pi  # one tooth of ten
    sim.state.body_x.assign(x)
    sim.state.joint_x.assign(q)
    found = watch.read()
    assert found["aside"] == pytest.approx(0.05, abs=1e-4)
    assert found["skipped"] == pytest.approx(1.0, abs=1e-4)
    x[0, list(side.shoes), 2] += 2.0  # above its wheels
    sim.state.body_x.assign(x)
    assert watch.read()["on"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("ground", GROUNDS)
def test_chains_hold_and_stay_on_their_wheels(ground):
    """Joints of the recorded run with a direct solver err by 7e-5 m; a guide has 13 mm to either side."""
    found = run(ground, 5.0)
    assert found["finite"]
    assert found["chains on all wheels"]
    assert found["joint error after it, at most [m]"] < 1e-4
    assert found["shoes aside, at most [m]"] < 0.02
    assert found["teeth between sprocket and chain, at most"] < 1.5
    assert found["way [m]"] > 1.0
