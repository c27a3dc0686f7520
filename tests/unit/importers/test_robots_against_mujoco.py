"""Published robots against MuJoCo: positions, masses, inverse masses, accelerations, swings, pairs. Skipped where the
files are not here.
"""

import functools
import warnings
from pathlib import Path

import numpy as np
import pytest

import simwarp as sw
from simwarp.importers import load_mjcf

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("lxml")

from tests.reference import robots  # noqa: E402  needs mujoco

MJCF = Path(__file__).parents[4] / "shared" / "reference" / "robots" / "mjcf"
LOADED = {
    "2f85/2f85", "dm_control/acrobot", "dm_control/ball_in_cup", "dm_control/cartpole", "dm_control/cheetah",
    "dm_control/finger", "dm_control/hopper", "dm_control/humanoid", "dm_control/pendulum", "dm_control/point_mass",
    "dm_control/quadruped", "dm_control/reacher", "dm_control/walker", "go2/go2", "gymnasium/ant",
    "gymnasium/half_cheetah", "gymnasium/hopper", "gymnasium/humanoid", "gymnasium/inverted_double_pendulum",
    "gymnasium/inverted_pendulum", "gymnasium/pusher_v5", "gymnasium/reacher", "gymnasium/walker2d_v5",
    "mujoco_features/actuation/actuation", "mujoco_features/actuation/actuators", "mujoco_features/actuation/position",
    "mujoco_features/actuation/site", "mujoco_features/hfield/hfield", "mujoco_features/humanoid",
    "mujoco_features/tendon/fixed", "mujoco_features/tendon/tendon_limit", "panda/panda", "shadow_hand/right_hand",
    "ur5e/ur5e",
}  # fmt: skip
REFUSED = {
    "gymnasium/swimmer": ["density", "viscosity"],
    "mujoco_features/actuation/adhesion": ["adhesion"],
    "mujoco_features/actuation/muscle": ["muscle"],
    "mujoco_features/actuation/slidercrank": ["slidercrank"],
    "mujoco_features/actuation/tendon_force_limit": ["tendon actuatorfrcrange"],
    "mujoco_features/slider_crank": ["slidercrank"],
    "mujoco_features/tendon/armature": ["spatial tendon"],
    "mujoco_features/tendon/damping": ["spatial tendon"],
    "mujoco_features/tendon/fixed_site": ["spatial tendon"],
    "mujoco_features/tendon/pulley_fixed_site": ["spatial tendon"],
    "mujoco_features/tendon/pulley_site": ["spatial tendon"],
    "mujoco_features/tendon/pulley_site_fixed": ["spatial tendon"],
    "mujoco_features/tendon/pulley_wrap": ["spatial tendon"],
    "mujoco_features/tendon/site": ["spatial tendon"],
    "mujoco_features/tendon/site_fixed": ["spatial tendon"],
    "mujoco_features/tendon/wrap": ["spatial tendon"],
}
QUICK = ("2f85/2f85", "dm_control/humanoid", "go2/go2", "panda/panda", "gymnasium/walker2d_v5")
CLOSED = ("2f85/2f85", "dm_control/quadruped", "panda/panda")
"""With constraints that tie coordinates: MuJoCo's are soft, so that a swing differs by more than a step's error."""


def published(name):
    path = MJCF / f"{name}.xml"
    if not path.is_file():
        pytest.skip("the published model files are not here")
    return path


@functools.lru_cache(maxsize=2)
def both(name):
    path = published(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return robots.Pair(load_mjcf(path), mujoco.MjModel.from_xml_path(str(path)))


def test_every_file_is_loaded_or_refused():
    if not MJCF.is_dir():
        pytest.skip("the published model files are not here")
    found = {str(path.relative_to(MJCF).with_suffix("")) for path in MJCF.rglob("*.xml") if "common" not in path.parts}
    assert found == LOADED | set(REFUSED)


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_names_all_kinds_and_what_is_left_loads(name):
    path = published(name)
    with pytest.raises(sw.ModelError, match="refused") as caught:
        load_mjcf(path)
    assert str(caught.value).endswith(f"drop them with allow={REFUSED[name]!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = load_mjcf(path, allow=REFUSED[name])
    assert robot.builder.finalize(1, "cpu").body_count > 0


@pytest.mark.quick(*QUICK)
@pytest.mark.parametrize("name", sorted(LOADED))
def test_positions_and_masses(name):
    pair = both(name)
    qpos = pair.random_positions(64, 0)
    qvel = np.random.default_rng(0).normal(size=(64, pair.model.nv))
    assert np.abs(pair.mine.qpos_from(pair.mine.q_from(qpos)) - qpos).max() < 1e-12
    assert np.abs(pair.mine.qvel_from(pair.mine.qd_from(qvel, qpos), qpos) - qvel).max() < 1e-12
    place, turned = robots.pose_errors(pair, 64)
    assert place < 1e-6  # coordinates are set in float32
    assert turned < 1e-6
    assert robots.mass_errors(pair) < 1e-12


@pytest.mark.quick(*QUICK)
@pytest.mark.parametrize("name", sorted(LOADED))
def test_inverse_mass(name):
    pair = both(name)
    bound = 2e-5 if pair.model.nv > 30 else 1e-5  # float32, the more so the longer the sums
    assert robots.inverse_mass_error(pair) < bound


@pytest.mark.quick("dm_control/humanoid", "go2/go2", "gymnasium/walker2d_v5", "dm_control/point_mass")
@pytest.mark.parametrize("name", sorted(LOADED - set(CLOSED)))
def test_accelerations(name):
    # of a step of 1e-5 s, in which the poses move by as much of what turns them
    assert robots.acceleration_error(both(name)) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(LOADED - set(CLOSED)))
def test_a_free_swing(name):
    first, second, length = robots.swing_errors(both(name))
    assert first < 5e-3 * length
    assert second < 0.6 * first or second < 1e-5 * length  # of first order; or rounding


@pytest.mark.parametrize("name", sorted(LOADED))
def test_the_pairs_that_may_meet_are_those_of_mujoco(name):
    pair = both(name)
    assert robots.pairs_of_ours(pair) == robots.pairs_of_mujoco(pair)
