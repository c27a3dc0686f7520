"""Models that are written as MJCF, and both simulators in the same state."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp import scenes
from simwarp.exporters import Mjcf, mjcf_of


def zoo() -> sw.ModelBuilder:
    """A floating tree with every joint that MJCF can hold, forwards and backwards, and all linear laws."""
    builder = sw.ModelBuilder()
    rng = np.random.default_rng(5)
    count = 0

    def body(at: Any) -> int:
        nonlocal count
        count += 1
        a = rng.normal(size=(3, 3)) * 0.1
        inertia = np.diag((0.02, 0.025, 0.03)) + 0.05 * a @ a.T
        turned = Rotation.random(random_state=count).as_quat()
        return builder.add_body(f"body{count}", mass=1.0 + 0.3 * count, inertia=inertia, pose=sw.pose(at, turned))

    trunk = body((0.1, -0.2, 1.0))
    builder.add_joint_free("base", trunk, anchor=(0.15, -0.1, 1.1))
    law: dict[str, Any] = {
        "armature": 0.02,
        "stiffness": 3.0,
        "rest": 0.2,
        "damping": 0.1,
        "friction": 0.05,
        "limit": (-2.5, 2.0),
    }
    drive = sw.PositionDrive(stiffness=20.0, damping=0.5, effort_limit=4.0)
    hinged = body((0.5, -0.2, 1.0))
    builder.add_joint_revolute("hinge", trunk, hinged, axis=(1, 2, 3), anchor=(0.3, -0.2, 1.05), drive=drive, **law)
    back = body((0.8, -0.3, 1.2))  # a child that carries its parent
    builder.add_joint_revolute("back", back, hinged, axis=(0, 1, 1), anchor=(0.6, -0.2, 1.1), armature=0.01)
    sliding = body((-0.3, 0.1, 0.9))
    builder.add_joint_prismatic("slide", trunk, sliding, axis=(1, 0, 1), anchor=(-0.1, 0.0, 1.0), stiffness=30.0)
    behind = body((-0.5, 0.3, 0.9))
    builder.add_joint_prismatic("slide back", behind, sliding, axis=(0, 1, 0.3), armature=0.1)
    ball = body((0.1, 0.3, 1.3))
    dofs = [sw.Dof(damping=0.05, armature=0.01)] * 3
    builder.add_joint_spherical("ball", trunk, ball, anchor=(0.1, 0.1, 1.2), dofs=dofs)
    tube = body((0.1, 0.5, 1.5))
    builder.add_joint_cylindrical("tube", ball, tube, axis=(0, 1, 1), anchor=(0.1, 0.4, 1.4))
    cardan = body((0.4, 0.1, 0.6))
    builder.add_joint_universal("cardan", trunk, cardan, anchor=(0.2, 0.0, 0.8), axis0=(1, 0, 0), axis1=(0, 1, 0.0))
    turned = body((0.6, 0.2, 0.4))
    builder.add_joint_universal("cardan back", turned, cardan, anchor=(0.5, 0.1, 0.5), axis0=(0, 0, 1), axis1=(1, 0, 0))
    flat = body((-0.2, -0.5, 0.7))
    builder.add_joint_planar("plane", trunk, flat, normal=(0, 0.2, 1), anchor=(-0.1, -0.3, 0.8))
    above = body((-0.3, -0.7, 0.5))
    builder.add_joint_planar("plane back", above, flat, normal=(1, 0.2, 0), anchor=(-0.2, -0.6, 0.6))
    builder.add_joint_fixed("weld", flat, body((-0.2, -0.5, 0.3)))
    return builder


def gimbal() -> sw.ModelBuilder:
    """A body on three hinges with massless frames between them, on the world."""
    builder = sw.ModelBuilder()
    ring = builder.add_massless_body("ring", pose=sw.pose((0, 0, 1), (0, 0, 1, 1)))
    fork = builder.add_massless_body("fork", pose=sw.pose((0, 0, 1)))
    top = builder.add_body("top", mass=2.0, inertia=(0.02, 0.03, 0.04), pose=sw.pose((0.1, 0.05, 0.8), (1, 0, 0, 2)))
    options: dict[str, Any] = {"armature": 0.01, "damping": 0.02}
    builder.add_joint_revolute("yaw", sw.WORLD, ring, axis=(0, 0, 1), anchor=(0, 0, 1), **options)
    builder.add_joint_revolute("pitch", fork, ring, axis=(0, 1, 0), anchor=(0, 0.1, 1), **options)
    builder.add_joint_revolute("roll", fork, top, axis=(1, 0, 0), anchor=(0.05, 0, 1), **options)
    return builder


def servo_hexapod() -> sw.ModelBuilder:
    """The hexapod on its floor, with servos."""
    return scenes.hexapod(drive=sw.PositionDrive(stiffness=12.0, damping=0.2, effort_limit=1.5))


def on_pillar() -> sw.ModelBuilder:
    """An arm on the world."""
    return scenes.robot_arm(scenes.IRB120)


BUILDERS = {
    "ant": lambda: scenes.ant(ground=False),
    "hexapod": lambda: scenes.hexapod(ground=False),
    "arm": on_pillar,
    "zoo": zoo,
    "gimbal": gimbal,
}


class Both:
    """A model in both simulators.

    Args:
        builder: of the model.
        dt: of a step of ours, and of MuJoCo [s].
    """

    def __init__(self, builder: sw.ModelBuilder, dt: float = 1e-4) -> None:
        self.model = builder.finalize(world_count=1, device="cpu")
        self.sim = sw.Simulation(self.model, dt, joint_accelerations=True)
        self.mjcf: Mjcf = mjcf_of(self.model, timestep=dt)
        self.theirs: Any = mujoco.MjModel.from_xml_string(self.mjcf.text)
        self.data: Any = mujoco.MjData(self.theirs)
        self.bodies = [
            (index, self.theirs.body(name).id)
            for index, name in enumerate(self.model.body_names) if self.model.has_mass[index]
        ]  # fmt: skip

    def set_random(self, seed: int, rate: float = 1.0) -> None:
        """The same random coordinates, poses and rates in both."""
        rng = np.random.default_rng(seed)
        q = rng.uniform(-0.6, 0.6, (1, self.model.dof_count))
        self.sim.set_joint_state(None, q, rate * rng.normal(size=q.shape))
        state = self.sim.state
        x, rot = state.body_x.numpy()[0], state.body_rot.numpy()[0]
        v, omega = state.body_v.numpy()[0].astype(float), state.body_omega.numpy()[0].astype(float)
        q, qd = state.joint_x.numpy()[0], state.joint_qd.numpy()[0]
        for joint in self.mjcf.joints:
            place = self.theirs.joint(joint.name)
            at, speed = place.qposadr[0], place.dofadr[0]
            if joint.kind in ("hinge", "slide"):
                self.data.qpos[at], self.data.qvel[speed] = q[joint.dof], qd[joint.dof]
                continue
            turned = Rotation(rot[joint.body])
            if joint.kind == "free":
                arm = turned.apply(joint.origin)
                self.data.qpos[at : at + 7] = [*(x[joint.body] + arm), *np.roll(rot[joint.body], 1)]
                self.data.qvel[speed : speed + 3] = v[joint.body] + np.cross(omega[joint.body], arm)
                self.data.qvel[speed + 3 : speed + 6] = turned.inv().apply(omega[joint.body])
            else:  # a rotation vector in the axes that the world had as built: there it is seen from the child
                built = Rotation(self.model.builder.bodies[joint.body].pose.rotation)
                vector = Rotation.from_rotvec(q[joint.dof : joint.dof + 3])
                self.data.qpos[at : at + 4] = np.roll((built.inv() * vector * built).as_quat(canonical=True), 1)
                carrier = self.model.builder.joints[self.model.joint_names.index(joint.name)].parent
                self.data.qvel[speed : speed + 3] = turned.inv().apply(omega[joint.body] - omega[carrier])
        mujoco.mj_forward(self.theirs, self.data)

    def pose_errors(self) -> tuple[float, float]:
        """Largest distance of centres [m], and largest angle [rad], over the bodies."""
        mine = self.sim.state
        place = max(
            float(np.linalg.norm(mine.body_x.numpy()[0, own] - self.data.xipos[other])) for own, other in self.bodies
        )
        turned = max(
            (Rotation(mine.body_rot.numpy()[0, own]).inv() * Rotation(np.roll(self.data.xquat[other], -1))).magnitude()
            for own, other in self.bodies
        )
        return place, float(turned)
