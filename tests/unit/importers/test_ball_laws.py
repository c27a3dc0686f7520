"""Springs, dampers and actuators of MJCF's balls and floating bodies, against MuJoCo: torques, and short motions."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import Actuators
from simwarp.importers import load_mjcf

mujoco: Any = pytest.importorskip("mujoco")

DT = 1.0e-4
SCENE = """
<mujoco>
  <option gravity="0 0 -3" timestep="{dt}" integrator="implicitfast"><flag contact="disable"/></option>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" quat="0.8 0.4 -0.2 0.4">{root}
      <inertial pos="0.02 0.01 -0.03" mass="2" diaginertia="0.2 0.3 0.4"/>
      <body name="arm" pos="0 0.1 0.4" quat="0.6 0 0.8 0">
        <joint name="ball" type="ball" pos="0.05 0 0" {ball}/>
        <inertial pos="0.1 0.2 0.1" mass="1" diaginertia="0.1 0.2 0.15"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>"""
ROOTS = {"world": '<joint name="root" type="ball"/>', "floating": '<freejoint name="root"/>', "fixed": ""}
ACTUATORS = {
    "motor": '<motor name="a" {joint} gear="0.5 -1 0.7"/>',
    "position": '<position name="a" {joint} gear="0.5 -1 0.7" kp="3" kv="0.2"/>',
    "general": '<general name="a" {joint} gear="0.5 -1 0.7" gaintype="affine" gainprm="2 0.3 0.1" biastype="affine"'
    ' biasprm="0.3 -1.5 -0.4"/>',
}
PLACES = {f"{where} {name}": f'{where}="{name}"' for where in ("joint", "jointinparent") for name in ("ball", "root")}


def loaded(folder: Path, xml: str) -> tuple[Any, Any, sw.importers.Imported]:
    path = folder / "scene.xml"
    path.write_text(xml)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of integrator and contact flag, which nothing here is about
        robot = load_mjcf(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    data.qpos[:] = rng.normal(size=model.nq)
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qvel[:] = 0.5 * rng.normal(size=model.nv)
    data.ctrl[:] = 0.7
    return model, data, robot


def simulated(robot: sw.importers.Imported, data: Any) -> sw.Simulation:
    model = robot.builder.finalize(1, "cpu")
    actuators = Actuators(model, robot.actuators)
    sim = sw.Simulation(model, DT, elements=[actuators], threads=1)
    sim.set_joint_state(None, robot.q_from(data.qpos)[None], robot.qd_from(data.qvel, data.qpos)[None])
    actuators.ctrl.assign(np.full((1, len(robot.actuators)), 0.7, np.float32))
    return sim


def world_torque(model: Any, data: Any, joint: str) -> np.ndarray:
    """What the actuators apply about a ball, from its parent to its child, world axes."""
    index = model.joint(joint).id
    first = model.jnt_dofadr[index] + (3 if model.jnt_type[index] == mujoco.mjtJoint.mjJNT_FREE else 0)
    turned = data.xmat[model.jnt_bodyid[index]].reshape(3, 3)
    return turned @ data.qfrc_actuator[first : first + 3]


@pytest.mark.parametrize("actuator", ACTUATORS)
@pytest.mark.parametrize("place", PLACES)
def test_an_actuator_on_a_ball_has_the_torque_of_mujocos(tmp_path, place, actuator):
    xml = SCENE.format(dt=DT, root=ROOTS["world"], ball="", actuators=ACTUATORS[actuator].format(joint=PLACES[place]))
    theirs, data, robot = loaded(tmp_path, xml)
    assert not robot.report.refused
    mujoco.mj_forward(theirs, data)
    sim = simulated(robot, data)
    sim.step()
    torques = sim.control.element_torque.numpy()[0]
    at_root, at_ball = (world_torque(theirs, data, joint) for joint in ("root", "ball"))
    # float32 of numbers of size 1 to 5
    np.testing.assert_allclose(torques[robot.bodies["arm"]], at_ball, atol=5e-6)
    np.testing.assert_allclose(torques[robot.bodies["base"]], at_root - at_ball, atol=5e-6)
    assert np.linalg.norm(torques) > 0.1


@pytest.mark.parametrize(
    ("gear", "where"),
    [("0 0 0 0.5 -1 0.7", "joint"), ("1 -2 0.5 0 0 0", "joint"), ("1 -2 0.5 0.5 -1 0.7", "jointinparent")],
)
def test_an_actuator_on_a_floating_body_has_the_wrench_of_mujocos(tmp_path, gear, where):
    xml = SCENE.format(
        dt=DT, root=ROOTS["floating"], ball="", actuators=f'<motor name="a" {where}="root" gear="{gear}"/>'
    )
    theirs, data, robot = loaded(tmp_path, xml)
    mujoco.mj_forward(theirs, data)
    sim = simulated(robot, data)
    sim.step()
    base = robot.bodies["base"]
    force = data.qfrc_actuator[:3]
    arm = data.xipos[1] - data.xpos[1]
    np.testing.assert_allclose(sim.control.element_force.numpy()[0, base], force, atol=5e-6)
    torque = world_torque(theirs, data, "root") - np.cross(arm, force)
    np.testing.assert_allclose(sim.control.element_torque.numpy()[0, base], torque, atol=5e-6)


def test_a_wrench_of_two_frames_is_refused(tmp_path):
    xml = SCENE.format(
        dt=DT, root=ROOTS["floating"], ball="", actuators='<motor name="a" joint="root" gear="1 0 0 1 0 0"/>'
    )
    with pytest.raises(sw.ModelError, match="actuator on ball or free joint"):
        loaded(tmp_path, xml)


@pytest.mark.parametrize("rest", [(1.0, 0.0, 0.0, 0.0), (0.8, 0.3, -0.4, 0.33)])
@pytest.mark.parametrize("law", ["ball", "floating"])
def test_springs_and_dampers_move_as_mujocos_do(tmp_path, law, rest, monkeypatch):
    """0.3 s at 0.1 ms: either integrator is of first order, and is off by some 1e-4 of the motion. MuJoCo's compiler
    has no attribute for the rest of a ball's spring, but its model does.
    """
    spring = 'stiffness="6" damping="0.15" armature="0.02"'
    roots = {"ball": ROOTS["fixed"], "floating": f'<joint name="root" type="free" {spring}/>'}
    xml = SCENE.format(dt=DT, root=roots[law], ball=spring if law == "ball" else "", actuators="")
    joint = "ball" if law == "ball" else "root"
    compiled = mujoco.MjSpec.compile

    def with_rest(spec):
        model = compiled(spec)
        end = model.joint(joint).qposadr[0] + (4 if law == "ball" else 7)
        model.qpos_spring[end - 4 : end] = np.array(rest) / np.linalg.norm(rest)
        return model

    monkeypatch.setattr(mujoco.MjSpec, "compile", with_rest)
    theirs, data, robot = loaded(tmp_path, xml)
    theirs.qpos_spring[:] = with_rest(mujoco.MjSpec.from_string(xml)).qpos_spring
    sim = simulated(robot, data)
    for _ in range(3000):
        mujoco.mj_step(theirs, data)
    sim.step(3000)
    found = robot.qpos_from(sim.state.joint_q.numpy()[0])
    for place in range(theirs.nq):  # a quaternion and its opposite are the same
        assert np.isfinite(found[place])
    sign = np.sign(found[-4:] @ data.qpos[-4:])
    np.testing.assert_allclose(sign * found[-4:], data.qpos[-4:], atol=1e-3)
