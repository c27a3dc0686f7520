"""State and Control: the arrays that change, world first, shared with whoever looks at them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from simwarp.core.arrays import FixedAttributes, WritableArray, writable
from simwarp.core.types import ArrayLayout
from simwarp.kernels.core.tables import ControlArrays, StateArrays
from simwarp.model.model import Model


class State(FixedAttributes):
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

    body_x: wp.array
    body_rot: wp.array
    body_q: wp.array
    body_v: wp.array
    body_omega: wp.array
    body_omega_last: wp.array
    body_v_low: wp.array
    body_omega_low: wp.array
    joint_x: wp.array
    joint_q: wp.array
    joint_qd: wp.array
    bounded_impulse: wp.array
    world_time: wp.array
    world_status: wp.array

    def __init__(self, model: Model) -> None:
        self.arrays = StateArrays()
        for name, layout in self.layouts(model).items():
            array = writable(layout.shape, layout.dtype, model.device, label=f"state.{name}")
            setattr(self, name, array)
            setattr(self.arrays, name, array)
        self._fix()

    @classmethod
    def layouts(cls, model: Model) -> dict[str, ArrayLayout]:
        """The arrays of a model's state."""
        worlds = model.world_count
        bodies, dofs = (worlds, model.body_count), (worlds, model.dof_count)
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "body_x": (bodies, wp.vec3d),
            "body_rot": (bodies, wp.quatd),
            "body_q": (bodies, wp.transform),
            "joint_x": (dofs, wp.float64),
            "joint_q": (dofs, wp.float32),
            "joint_qd": (dofs, wp.float32),
            "bounded_impulse": ((worlds, model.bounded_count), wp.float32),
            "world_time": ((worlds,), wp.float64),
            "world_status": ((worlds,), wp.int32),
        }
        return {name: ArrayLayout(*shapes.get(name, (bodies, wp.vec3))) for name in cls.NAMES}

    def copy_from(self, other: State) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))


class Control(FixedAttributes):
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

    joint_force: WritableArray
    joint_target_q: WritableArray
    joint_target_qd: WritableArray
    body_force: WritableArray
    body_torque: WritableArray
    body_force_b: WritableArray
    body_torque_b: WritableArray
    element_force: WritableArray
    element_torque: WritableArray
    element_joint_force: WritableArray

    def __init__(self, model: Model, *, elements: bool = False) -> None:
        self.arrays = ControlArrays()
        for name, layout in self.layouts(model, elements).items():
            array = writable(layout.shape, layout.dtype, model.device, label=f"control.{name}")
            setattr(self, name, array)
            setattr(self.arrays, name, array)
        self._fix()

    @classmethod
    def layouts(cls, model: Model, elements: bool) -> dict[str, ArrayLayout]:
        """The arrays of a model's control; `elements`: whether it has force elements."""

        def layout(name: str) -> ArrayLayout:
            worlds = model.world_count if elements or not name.startswith("element") else 1
            if "joint" in name:
                return ArrayLayout((worlds, model.dof_count), wp.float32)
            return ArrayLayout((worlds, model.body_count), wp.vec3)

        return {name: layout(name) for name in cls.NAMES}

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
