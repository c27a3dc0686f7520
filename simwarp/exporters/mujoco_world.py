"""One world of a model in MuJoCo C: its state taken from ours and given back, drives and forces as controls.

MuJoCo is an optional package (extra `import`); it is imported when the first world is made.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.core.types import ModelError
from simwarp.exporters.mjcf_writer import Mjcf
from simwarp.model.model import Model

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class BodyState:
    """Bodies and coordinates of one world, as `State` has them.

    Attributes:
        x: (B, 3) centres of mass [m], world.
        rotation: (B, 4) xyzw.
        v: (B, 3) of the centres [m/s], world.
        omega: (B, 3) [rad/s], world.
        q, qd: (dofs,) coordinates [m or rad] and rates.
    """

    x: npt.NDArray[Any]
    rotation: npt.NDArray[Any]
    v: npt.NDArray[Any]
    omega: npt.NDArray[Any]
    q: npt.NDArray[Any]
    qd: npt.NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Inputs:
    """Controls of one world, as `Control` has them.

    Attributes:
        target_q, target_qd: (dofs,) targets of drives [m or rad, per s].
        effort: (dofs,) along the coordinates of hinges and slides [N or N·m].
        force, torque: (B, 3) on the bodies at their centres of mass, world axes [N, N·m].
    """

    target_q: npt.NDArray[Any]
    target_qd: npt.NDArray[Any]
    effort: npt.NDArray[Any]
    force: npt.NDArray[Any]
    torque: npt.NDArray[Any]


class MujocoWorld:
    """A world of a model in MuJoCo C.

    Args:
        model: of ours.
        mjcf: what was written of it.
        compiled: MuJoCo's model, shared by worlds of the same text; None: it is made here.

    Attributes:
        model: MuJoCo's.
        data: MuJoCo's state.

    Raises:
        ModelError: MuJoCo is not installed or refuses the text, or the model has massless bodies.
    """

    def __init__(self, model: Model, mjcf: Mjcf, compiled: Any = None) -> None:
        try:
            import mujoco
        except ImportError:
            raise ModelError("MuJoCo is not installed; pip install 'simwarp[import]'") from None
        if not model.has_mass.all():
            name = model.body_names[int(np.argmin(model.has_mass))]
            raise ModelError(f"MuJoCo: body '{name}' is massless, which MuJoCo tells no pose of; give it mass")
        self._mujoco: Any = mujoco
        try:
            self.model: Any = mujoco.MjModel.from_xml_string(mjcf.text) if compiled is None else compiled
        except ValueError as error:
            raise ModelError(f"MuJoCo refuses the model: {' '.join(str(error).split())}") from error
        self.data: Any = mujoco.MjData(self.model)
        self._dof_count = model.dof_count
        self._bodies = np.array([self.model.body(name).id for name in model.body_names], np.int64)
        self._roots = self.model.body_rootid[self._bodies]
        slots = {name: index for index, name in enumerate(model.shape_names)}
        self._slots = [slots[self.model.geom(index).name] for index in range(self.model.ngeom)]
        places = [self.model.joint(joint.name) for joint in mjcf.joints]
        single = [(joint, place) for joint, place in zip(mjcf.joints, places, strict=True) if _is_single(joint.kind)]
        self._dofs = np.array([joint.dof for joint, _ in single], np.int64)
        self._q = np.array([place.qposadr[0] for _, place in single], np.int64)
        self._qd = np.array([place.dofadr[0] for _, place in single], np.int64)
        self._turning = [(j, p) for j, p in zip(mjcf.joints, places, strict=True) if not _is_single(j.kind)]
        self._index = {int(body): place for place, body in enumerate(self._bodies)}
        self._drives = [
            (self.model.actuator(joint.name).id, joint.dof, joint.driven) for joint in mjcf.joints if joint.driven
        ]  # fmt: skip
        self._leads = np.array([self._lead(actuator, driven) for actuator, _, driven in self._drives]).reshape(-1, 2)

    def _lead(self, actuator: int, driven: str) -> tuple[float, float]:
        """Factors of both targets in the control of a drive: effort = kp (control - q) - kv qd."""
        if driven == "velocity":
            return 0.0, 1.0
        _, kp, kv = self.model.actuator_biasprm[actuator][:3]
        return 1.0, float(kv / kp)

    def set_state(self, state: BodyState) -> None:
        """Set MuJoCo's state; forces of the solver start anew."""
        data = self.data
        self._mujoco.mj_resetData(self.model, data)
        data.qpos[self._q], data.qvel[self._qd] = state.q[self._dofs], state.qd[self._dofs]
        for joint, place in self._turning:
            at, rate = int(place.qposadr[0]), int(place.dofadr[0])
            turned = Rotation(state.rotation[joint.body])
            if joint.kind == "free":
                arm = turned.apply(joint.origin)
                data.qpos[at : at + 3] = state.x[joint.body] + arm
                data.qpos[at + 3 : at + 7] = np.roll(state.rotation[joint.body], 1)
                data.qvel[rate : rate + 3] = state.v[joint.body] + np.cross(state.omega[joint.body], arm)
                data.qvel[rate + 3 : rate + 6] = turned.apply(state.omega[joint.body], inverse=True)
                continue
            parent = self._index.get(int(self.model.body_parentid[self._bodies[joint.body]]), -1)
            carrier = Rotation.identity() if parent < 0 else Rotation(state.rotation[parent])
            built = Rotation(np.roll(self.model.body_quat[self._bodies[joint.body]], -1))
            data.qpos[at : at + 4] = np.roll(((carrier * built).inv() * turned).as_quat(canonical=True), 1)
            spin = state.omega[joint.body] - (0.0 if parent < 0 else state.omega[parent])
            data.qvel[rate : rate + 3] = turned.apply(spin, inverse=True)
        self.publish()

    def step(self, inputs: Inputs, steps: int = 1) -> None:
        """Advance by so many steps of MuJoCo, under the same controls."""
        data = self.data
        for (actuator, dof, _), (place, rate) in zip(self._drives, self._leads, strict=True):
            data.ctrl[actuator] = place * inputs.target_q[dof] + rate * inputs.target_qd[dof]
        data.qfrc_applied[self._qd] = inputs.effort[self._dofs]
        data.xfrc_applied[self._bodies, :3], data.xfrc_applied[self._bodies, 3:] = inputs.force, inputs.torque
        self._mujoco.mj_step(self.model, data, nstep=steps)
        self.publish()

    def publish(self) -> None:
        """Poses and velocities of the state as it is; contacts stay those of the last step."""
        for part in (self._mujoco.mj_kinematics, self._mujoco.mj_comPos, self._mujoco.mj_comVel):
            part(self.model, self.data)

    def state(self) -> BodyState:
        """The state as it is; of coordinates those of hinges and slides, the others are 0."""
        data, bodies = self.data, self._bodies
        omega = data.cvel[bodies, :3]
        # cvel is taken at the centre of mass of the whole tree
        v = data.cvel[bodies, 3:] + np.cross(omega, data.xipos[bodies] - data.subtree_com[self._roots])
        q, qd = np.zeros((2, self._dof_count))
        q[self._dofs], qd[self._dofs] = data.qpos[self._q], data.qvel[self._qd]
        rotation = np.roll(data.xquat[bodies], -1, axis=1)
        return BodyState(data.xipos[bodies].copy(), rotation, v, omega.copy(), q, qd)

    def add_contact_forces(self, bodies: npt.NDArray[Any], shapes: npt.NDArray[Any]) -> None:
        """Add the contact forces of the last step [N, world axes] to (B, 3) of the bodies and (S, 3) of the shapes."""
        data, wrench = self.data, np.zeros(6)
        for contact in range(data.ncon):
            self._mujoco.mj_contactForce(self.model, data, contact, wrench)
            force = wrench[:3] @ data.contact.frame[contact].reshape(3, 3)
            for geom, sign in zip(data.contact.geom[contact], (-1.0, 1.0), strict=True):
                shapes[self._slots[geom]] += sign * force
                body = self._index.get(int(self.model.geom_bodyid[geom]), -1)
                if body >= 0:
                    bodies[body] += sign * force

    @property
    def is_sound(self) -> bool:
        """False once MuJoCo's state became NaN, infinite or huge, and it began anew."""
        kinds = self._mujoco.mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        return not any(self.data.warning[int(kind)].number for kind in bad)


def _is_single(kind: str) -> bool:
    """True of joints whose coordinate is one number, the same in both."""
    return kind in ("hinge", "slide")
