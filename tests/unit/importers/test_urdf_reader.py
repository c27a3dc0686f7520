"""URDF files: masses, kinematics and inverse mass against MuJoCo's own reader, and what each element becomes."""

import warnings
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
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


# ---- every type of joint, in frames that are turned ------------------------------------------------------------------

AXES = {"z": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0), "across": (0.6, -0.5, 0.3)}
CASES = [
    *((kind, "across") for kind in ("revolute", "continuous", "prismatic", "fixed")),
    *(("planar", a) for a in AXES),
]


def turned_chain(kind, axis):
    """URDF of three links: a hinge, then a joint of a type about an axis in a turned frame, then another hinge."""
    inertia = '<inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="0.1 0 0"/><mass value="2"/>{inertia}</inertial>'
    limit = '<limit lower="-2" upper="2" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    links = "".join(f'<link name="{name}">{inertial}</link>' for name in ("base", "a", "b", "c"))
    return f"""<robot name="turned">{links}
      <joint name="first" type="continuous"><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 1.1"/><parent link="base"/>
        <child link="a"/><axis xyz="0 1 0"/></joint>
      <joint name="middle" type="{kind}"><origin xyz="-0.2 0.1 0.4" rpy="1.2 0.3 -0.7"/><parent link="a"/>
        <child link="b"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>{limit}</joint>
      <joint name="last" type="continuous"><origin xyz="0.3 0 0.1" rpy="0.2 0.9 0.1"/><parent link="b"/>
        <child link="c"/><axis xyz="1 0 0"/></joint></robot>"""


@pytest.mark.parametrize(("kind", "axis"), CASES)
def test_every_joint_moves_along_the_axes_of_its_own_frame(kind, axis, tmp_path):
    text = turned_chain(kind, AXES[axis])
    file = tmp_path / "turned.urdf"
    file.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ours = load_urdf(file, base="fixed")
    theirs = mujoco_urdf(text.encode(), "fixed")
    assert ours.coordinates.position_count == theirs.nq
    data = mujoco.MjData(theirs)
    qpos = random_positions(theirs, 8, 3)
    found = link_poses(ours, qpos)
    for world in range(8):
        data.qpos[:] = qpos[world]
        mujoco.mj_kinematics(theirs, data)
        for name, (place, turn) in found.items():
            body = theirs.body(name).id
            # 1e-6 m and rad: float32 coordinates of up to 2 rad and 2 m
            np.testing.assert_allclose(place[world], data.xpos[body], atol=1e-6, err_msg=name)
            np.testing.assert_allclose(turn[world].reshape(-1), data.xmat[body], atol=1e-6, err_msg=name)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -1.1, 2.0)], ids=["upright", "turned"])
def test_a_planar_joint_in_a_turned_frame_slides_along_its_x_and_y(turn, tmp_path):
    """Closed form: the child stands at R (x, y, 0), turned by R about the normal, also where the robot is placed."""
    file = tmp_path / "flat.urdf"
    file.write_text(
        f"""<robot name="flat"><link name="base"/><link name="puck"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1"/></inertial></link><joint name="table" type="planar">
        <origin rpy="{turn[0]} {turn[1]} {turn[2]}"/><parent link="base"/><child link="puck"/><axis xyz="0 0 1"/>
        </joint></robot>"""
    )
    placed = Rotation.from_rotvec([0.4, 0.1, -0.8])
    robot = load_urdf(file, base="fixed", pose=sw.pose((1.0, 0.0, 0.0), placed.as_quat()))
    place, found = link_poses(robot, np.array([[0.7, -0.4, 0.9]]))["puck"]
    frame = placed * Rotation.from_euler("xyz", turn)
    # 1e-6: float32 coordinates
    np.testing.assert_allclose(place[0], np.array([1.0, 0.0, 0.0]) + frame.apply([0.7, -0.4, 0.0]), atol=1e-6)
    wanted = frame * Rotation.from_rotvec([0.0, 0.0, 0.9])
    np.testing.assert_allclose(found[0], wanted.as_matrix(), atol=1e-6)


def test_a_floating_joint_in_a_turned_frame_has_the_pose_of_its_child(tmp_path):
    """As built it stands in the joint's frame, and its position and quaternion are those of the world."""
    file = tmp_path / "flying.urdf"
    file.write_text(
        """<robot name="flying"><link name="base"/><link name="kite"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1"/></inertial></link><joint name="air" type="floating">
        <origin xyz="1 2 3" rpy="0.3 -1.1 2.0"/><parent link="base"/><child link="kite"/></joint></robot>"""
    )
    robot = load_urdf(file, base="fixed")
    frame = Rotation.from_euler("xyz", (0.3, -1.1, 2.0))
    built = link_poses(robot, robot.coordinates.initial[None])["kite"]
    np.testing.assert_allclose(built[0][0], (1.0, 2.0, 3.0), atol=1e-6)
    np.testing.assert_allclose(built[1][0], frame.as_matrix(), atol=1e-6)
    turn = Rotation.from_rotvec([0.4, 1.3, -0.6])
    moved = link_poses(robot, np.array([[0.5, 0.6, 0.7, *np.roll(turn.as_quat(), 1)]]))["kite"]
    np.testing.assert_allclose(moved[0][0], (0.5, 0.6, 0.7), atol=1e-6)
    np.testing.assert_allclose(moved[1][0], turn.as_matrix(), atol=1e-6)
