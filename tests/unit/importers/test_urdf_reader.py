"""URDF files: masses, kinematics and inverse mass against MuJoCo's own reader, and what each element becomes."""

import warnings
from typing import Any

import mujoco
import numpy as np
import pytest

from simwarp.importers import load_urdf
from tests.reference.imported_robots import (
    ROBOTS,
    column_order,
    energy_norm_error,
    full_mass,
    inverse_mass,
    link_poses,
    mujoco_urdf,
    random_positions,
    without_geometry,
)

FILES: dict[str, tuple[str, Any]] = {
    "irb120": ("urdf/abb_irb120_support/urdf/irb120_3_58.urdf", "fixed"),
    "r2d2": ("urdf/r2d2/r2d2.urdf", "floating"),
    "quadruped": ("urdf/newton/quadruped.urdf", "floating"),
    "cartpole": ("urdf/newton/cartpole.urdf", "fixed"),
}


@pytest.fixture(params=FILES)
def robot(request, tmp_path):
    """A published robot without its geometry, ours and MuJoCo's."""
    name, base = FILES[request.param]
    if not (ROBOTS / name).is_file():
        pytest.skip("the published model files are not here")
    text = (ROBOTS / name).read_bytes()
    file = tmp_path / "robot.urdf"
    file.write_bytes(without_geometry(text))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours = load_urdf(file, base=base)
    theirs = mujoco_urdf(text, base)
    names = ["the_base" if name.endswith("_floating") else name for name in ours.dofs]
    return ours, theirs, column_order(theirs, names)


def test_masses_of_all_links_are_there(robot):
    ours, theirs, _ = robot
    assert ours.mass == pytest.approx(theirs.body_mass.sum(), rel=1e-12)
    assert set(ours.frames) == {theirs.body(i).name for i in range(1, theirs.nbody)} - {"world"}


def test_links_stand_where_mujoco_has_them(robot):
    ours, theirs, (positions, _) = robot
    qpos = random_positions(theirs, 64, 0)
    np.testing.assert_allclose(
        ours.qpos_from(ours.q_from(qpos[:, positions])) * sign(qpos[:, positions], ours), qpos[:, positions], atol=1e-6
    )
    data = mujoco.MjData(theirs)
    found = link_poses(ours, qpos[:, positions])
    for world in range(64):
        data.qpos[:] = qpos[world]
        mujoco.mj_kinematics(theirs, data)
        for name, (place, turn) in found.items():
            body = theirs.body(name).id
            # 1e-6 m and rad: float32 coordinates of up to 3 rad and 2 m
            np.testing.assert_allclose(place[world], data.xpos[body], atol=1e-6, err_msg=name)
            np.testing.assert_allclose(turn[world].reshape(-1), data.xmat[body], atol=1e-6, err_msg=name)


def sign(qpos, ours):
    """A quaternion and its negative are one rotation."""
    factors = np.ones_like(qpos)
    if ours.coordinates.position_count > ours.coordinates.rate_count:
        factors[:, 3:7] = np.sign(np.einsum("ij,ij->i", ours.qpos_from(ours.q_from(qpos))[:, 3:7], qpos[:, 3:7]))[
            :, None
        ]
    return factors


def test_inverse_mass_is_that_of_mujoco(robot):
    ours, theirs, (positions, rates) = robot
    for qpos in random_positions(theirs, 2, 1):
        mass = full_mass(theirs, qpos)[np.ix_(rates, rates)]
        # float32 rates: 1e-5 is the bound of the import for 30 coordinates or less
        assert energy_norm_error(inverse_mass(ours, qpos[positions]), mass) < 1e-5
