"""State and Control: the arrays that change, world first, shared with whoever looks at them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from simwarp.arrays import writable
from simwarp.kernels.tables import ControlArrays, StateArrays
from simwarp.model import Model


class State:
    """State of all worlds. Angular and linear parts are separate arrays; everything is in the world frame.

    Attributes:
        body_x: (W, B) vec3d, position of record of the centre of mass [m].
        body_rot: (W, B) quatd xyzw, orientation of record.
        body_q: (W, B) transform, float32 view of both, published each step.
        body_v: (W, B) vec3, velocity of the centre of mass [m/s].
        body_omega: (W, B) vec3, angular velocity [rad/s].
        body_omega_last: (W, B) vec3, the same one sub-step before: the gyroscopic torque extrapolates.
        body_v_low, body_omega_low: (W, B) vec3, what float32 rounding kept back from the velocities (compensated
            summation): many equal increments do not round the same way.
        joint_x: (W, dofs) float64, coordinates of record, turns counted [m or rad].
        joint_q, joint_qd: (W, dofs) float32, coordinates and their rates.
        bounded_impulse: (W, bounded rows), warm start of limits, friction and motors [N·s or N·m·s].
        world_time: (W,) float64 [s].
        world_status: (W,) int32, bits of `WorldStatus`.
    """

    NAMES = (
        "body_x", "body_rot", "body_q", "body_v", "body_omega", "body_omega_last",
        "body_v_low", "body_omega_low", "joint_x", "joint_q", "joint_qd",
        "bounded_impulse", "world_time", "world_status",
    )  # fmt: skip

    def __init__(self, model: Model) -> None:
        worlds, device = model.world_count, model.device

        def zeros(count: int, dtype: Any) -> wp.array:
            return wp.zeros((worlds, count), dtype=dtype, device=device)

        self.body_x = zeros(model.body_count, wp.vec3d)
        self.body_rot = zeros(model.body_count, wp.quatd)
        self.body_q = zeros(model.body_count, wp.transform)
        self.body_v = zeros(model.body_count, wp.vec3)
        self.body_omega = zeros(model.body_count, wp.vec3)
        self.body_omega_last = zeros(model.body_count, wp.vec3)
        self.body_v_low = zeros(model.body_count, wp.vec3)
        self.body_omega_low = zeros(model.body_count, wp.vec3)
        self.joint_x = zeros(model.dof_count, wp.float64)
        self.joint_q = zeros(model.dof_count, wp.float32)
        self.joint_qd = zeros(model.dof_count, wp.float32)
        self.bounded_impulse = zeros(model.bounded_count, wp.float32)
        self.world_time = wp.zeros(worlds, dtype=wp.float64, device=device)
        self.world_status = wp.zeros(worlds, dtype=wp.int32, device=device)
        self.arrays = StateArrays()
        for name in self.NAMES:
            setattr(self.arrays, name, getattr(self, name))

    def copy_from(self, other: State) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))


class Control:
    """Inputs of a step; whoever writes them (Warp, torch) writes the memory that the kernels read.

    Attributes:
        joint_force: (W, dofs) [N or N·m], along each coordinate.
        joint_target_q, joint_target_qd: (W, dofs), of drives and of motions without a table.
        body_force, body_torque: (W, B) vec3 at the centre of mass, world frame [N, N·m].
        body_force_b, body_torque_b: (W, B) vec3, the same in the body frame (thrusters, propellers).
        element_force, element_torque, element_joint_force: what the force elements of a model, such as tires and
            engines, add to `body_force`, `body_torque` and `joint_force`; leading dimension 1 without such elements.
            They write them every step.
    """

    NAMES = (
        "joint_force", "joint_target_q", "joint_target_qd", "body_force", "body_torque", "body_force_b",
        "body_torque_b", "element_force", "element_torque", "element_joint_force",
    )  # fmt: skip

    def __init__(self, model: Model, *, elements: bool = False) -> None:
        joint_shape, body_shape = (model.world_count, model.dof_count), (model.world_count, model.body_count)
        copies = model.world_count if elements else 1
        self.element_force = writable((copies, model.body_count), wp.vec3, model.device)
        self.element_torque = writable((copies, model.body_count), wp.vec3, model.device)
        self.element_joint_force = writable((copies, model.dof_count), wp.float32, model.device)
        self.joint_force = writable(joint_shape, wp.float32, model.device)
        self.joint_target_q = writable(joint_shape, wp.float32, model.device)
        self.joint_target_qd = writable(joint_shape, wp.float32, model.device)
        self.body_force = writable(body_shape, wp.vec3, model.device)
        self.body_torque = writable(body_shape, wp.vec3, model.device)
        self.body_force_b = writable(body_shape, wp.vec3, model.device)
        self.body_torque_b = writable(body_shape, wp.vec3, model.device)
        self.arrays = ControlArrays()
        for name in self.NAMES:
            setattr(self.arrays, name, getattr(self, name))

    def clear(self) -> None:
        """Zeroes every input."""
        for name in self.NAMES:
            getattr(self, name).zero_()


def initial_arrays(model: Model) -> State:
    """The state as built, the same in every world; coordinates still to be measured."""
    state = State(model)
    for name, values in model.initial.items():
        array = getattr(state, name)
        if values.size:
            array.assign(np.repeat(values[None], model.world_count, axis=0))
    return state
