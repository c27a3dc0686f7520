"""Actuators on frames of bodies: wrenches, lengths and rates, against MuJoCo and the laws of momentum."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import Actuators, ActuatorSpec, SitePull
from simwarp.core.rotation import matrix_of

GEARS: Any = [(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.4, -1.1, 0.7, 0.0, 0.0, 0.0), (0.3, 0.2, -0.5, 0.8, -0.4, 0.6)]
REFERENCES = {"own axes": "", "world": 'refsite="ground"', "parent": 'refsite="hip"'}
DT = 1.0e-3


def arm(actuator: str) -> mujoco.MjModel:
    """Two bodies that move as they like against each other; frames are turned."""
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option gravity="0 0 0" timestep="{DT}"/>
      <worldbody>
        <site name="ground" pos="0.3 -0.2 0.5" quat="0.8 0.4 -0.2 0.4"/>
        <body name="one"><freejoint/><inertial pos="0 0 0" mass="2" diaginertia="0.2 0.3 0.4"/>
          <site name="hip" pos="0.1 0.2 -0.1" quat="0.6 0.0 0.8 0.0"/>
          <body name="two" pos="0 0 1"><joint type="ball"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.2 0.15"/>
            <site name="tip" pos="-0.2 0.1 0.4" quat="0.5 0.5 -0.5 0.5"/></body>
        </body>
      </worldbody>
      <actuator>{actuator}</actuator>
    </mujoco>""")


def pose(position: tuple[float, ...], wxyz: tuple[float, ...]) -> sw.Pose:
    return sw.pose(position, (*wxyz[1:], wxyz[0]))


TIP = pose((-0.2, 0.1, 0.4), (0.5, 0.5, -0.5, 0.5))
FRAMES: Any = {
    "own axes": {},
    "world": {"reference": sw.WORLD, "reference_pose": pose((0.3, -0.2, 0.5), (0.8, 0.4, -0.2, 0.4))},
    "parent": {"reference": 0, "reference_pose": pose((0.1, 0.2, -0.1), (0.6, 0.0, 0.8, 0.0))},
}


def free_bodies() -> sw.ModelBuilder:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("one", mass=2.0, inertia=(0.2, 0.3, 0.4))
    builder.add_body("two", mass=1.0, inertia=(0.1, 0.2, 0.15), pose=sw.pose((0.0, 0.0, 1.0)))
    return builder


@pytest.mark.parametrize("gear", GEARS)
@pytest.mark.parametrize("reference", REFERENCES)
def test_a_site_pulls_as_mujocos_does(reference: str, gear: Any) -> None:
    words = " ".join(map(str, gear))
    theirs = arm(
        f'<general site="tip" {REFERENCES[reference]} gear="{words}" gaintype="affine" gainprm="2 0 0" '
        'biastype="affine" biasprm="0.3 -1.5 -0.4"/>'
    )
    data = mujoco.MjData(theirs)
    rng = np.random.default_rng(7)
    data.qpos[:] = rng.normal(size=theirs.nq)
    mujoco.mj_normalizeQuat(theirs, data.qpos)
    data.qvel[:] = rng.normal(size=theirs.nv)
    data.ctrl[:] = 0.7
    mujoco.mj_forward(theirs, data)
    model = free_bodies().finalize(1, "cpu")
    site = SitePull(body=1, pose=TIP, gear=gear, **FRAMES[reference])
    spec = ActuatorSpec(name="a", site=site, gain=(2.0, 0.0, 0.0), bias=(0.3, -1.5, -0.4))
    actuators = Actuators(model, [spec])
    sim = sw.Simulation(model, DT, elements=[actuators], threads=1)
    sim.state.body_x.assign(data.xpos[None, 1:])
    sim.state.body_rot.assign(np.roll(data.xquat[None, 1:], -1, axis=-1))
    velocities = np.zeros((2, 6))
    for body in range(2):
        mujoco.mj_objectVelocity(theirs, data, mujoco.mjtObj.mjOBJ_XBODY, body + 1, velocities[body], 0)
    sim.state.body_v.assign(velocities[None, :, 3:])
    sim.state.body_omega.assign(velocities[None, :, :3])
    sim.measure()
    actuators.ctrl[:] = 0.7
    sim.step()
    # float32 sums of products of order one
    assert actuators.force.numpy()[0] == pytest.approx(data.actuator_force, abs=5e-6)
    efforts = np.zeros(theirs.nv)
    forces, torques = sim.control.element_force.numpy()[0], sim.control.element_torque.numpy()[0]
    for body in range(2):
        mujoco.mj_applyFT(
            theirs, data, forces[body].astype(float), torques[body].astype(float), data.xipos[body + 1], body + 1,
            efforts,
        )  # fmt: skip
    assert efforts == pytest.approx(data.qfrc_actuator, abs=1e-5)
    assert np.abs(efforts).max() > 0.1


def momentum(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular momentum after 0.4 s of a pull between two bodies."""
    model = free_bodies().finalize(1, "cpu")
    site = SitePull(body=1, pose=TIP, gear=GEARS[2], **FRAMES["parent"])
    actuators = Actuators(model, [ActuatorSpec(name="a", site=site)])
    sim = sw.Simulation(model, dt, elements=[actuators], threads=1)
    actuators.ctrl[:] = 3.0
    for _ in range(round(0.4 / dt)):
        sim.step()
    x, v = sim.state.body_x.numpy()[0], sim.state.body_v.numpy()[0].astype(float)
    omega, rotations = sim.state.body_omega.numpy()[0].astype(float), sim.state.body_rot.numpy()[0]
    assert np.abs(v).max() > 0.3
    linear, angular = np.zeros(3), np.zeros(3)
    for body, (mass, inertia) in enumerate(((2.0, (0.2, 0.3, 0.4)), (1.0, (0.1, 0.2, 0.15)))):
        axes = matrix_of(rotations[body])
        linear += mass * v[body]
        angular += axes @ np.diag(inertia) @ axes.T @ omega[body] + mass * np.cross(x[body], v[body])
    return linear, angular


def test_a_reference_takes_the_reaction() -> None:
    (linear, coarse), (_, fine) = momentum(1.0e-3), momentum(5.0e-4)
    # sums of 400 float32
    assert np.abs(linear).max() < 1e-5
    # of 3 N on levers of some 0.5 m for 0.4 s: what the step itself loses is of first order in it
    assert np.abs(coarse).max() < 5e-3
    assert np.abs(fine).max() < 0.6 * np.abs(coarse).max()


def test_pulls_on_one_body_add_up() -> None:
    """Two halves are the whole; the user's own force comes on top."""
    speeds = []
    for gears in ((1.0,), (0.5, 0.5)):
        model = free_bodies().finalize(1, "cpu")
        specs = [
            ActuatorSpec(name=f"a{k}", site=SitePull(body=0, gear=(gear, 0, 0, 0, 0, 2.0 * gear)))
            for k, gear in enumerate(gears)
        ]
        actuators = Actuators(model, specs)
        sim = sw.Simulation(model, DT, elements=[actuators], threads=1)
        actuators.ctrl[:] = 4.0
        sim.control.body_force[:, 0] = (0.0, 1.0, 0.0)
        for _ in range(10):
            sim.step()
        speeds.append((*sim.state.body_v.numpy()[0, 0], sim.state.body_omega.numpy()[0, 0, 2]))
    assert speeds[0] == pytest.approx(speeds[1], abs=1e-6)
    # F t / m along x while it has hardly turned; the turn after 10 ms is 8/0.4 · t²/2 = 1 mrad
    assert speeds[0] == pytest.approx((0.02, 0.005, 0.0, 0.2), abs=3e-5)
