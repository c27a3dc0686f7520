"""A cart on a slide and a wheel on a hinge, which know nothing of each other: in simwarp and in MuJoCo."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

import simwarp as sw
from simwarp.actuators import Actuators, ActuatorSpec

SLIDE, HINGE = 0, 1
"""Columns of `joint_q`, and of MuJoCo's qpos."""
MASS, INERTIA = 2.0, 0.3


def bodies(**options: Any) -> sw.ModelBuilder:
    """The two bodies without weight; options of both coordinates."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    cart = builder.add_body("cart", mass=MASS, inertia=(1.0, 1.0, 1.0))
    wheel = builder.add_body("wheel", mass=1.0, inertia=(INERTIA,) * 3, pose=sw.pose((0.0, 0.0, 1.0)))
    builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1.0, 0.0, 0.0), **options)
    builder.add_joint_revolute("hinge", sw.WORLD, wheel, axis=(0.0, 0.0, 1.0), **options)
    return builder


def mjcf(actuators: str, *, dt: float, joint: str = "", tendon: str = "") -> Any:
    """The same in MuJoCo, with the lines of its actuators, attributes of both joints, and a tendon."""
    text = f"""
    <mujoco>
      <option gravity="0 0 0" timestep="{dt}" integrator="implicitfast"/>
      <worldbody>
        <body><joint name="slide" type="slide" axis="1 0 0" {joint}/>
          <inertial pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/></body>
        <body pos="0 0 1"><joint name="hinge" type="hinge" axis="0 0 1" {joint}/>
          <inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body>
      </worldbody>
      {tendon}
      <actuator>{actuators}</actuator>
    </mujoco>"""
    return mujoco.MjModel.from_xml_string(text)


def run(specs: list[ActuatorSpec], dt: float, worlds: int = 1, **options: Any) -> tuple[sw.Simulation, Actuators]:
    """A simulation of the two bodies with actuators; options of both coordinates."""
    model = bodies(**options).finalize(worlds, "cpu")
    actuators = Actuators(model, specs, dt=dt)
    return sw.Simulation(model, dt, elements=[actuators], threads=1), actuators


def start(sim: sw.Simulation, q: tuple[float, float], qd: tuple[float, float]) -> None:
    """Both coordinates and rates, in all worlds."""
    shape = sim.state.joint_q.shape
    sim.set_joint_state(None, np.broadcast_to(q, shape), np.broadcast_to(qd, shape))
