"""A task whose physics are MuJoCo's: everything but the steps of the simulation is the task's own.

MuJoCo's state is written into the task's simulation after each step, without stepping it, so that observations,
rewards, commands, resets and the reasons to end are the same code on another simulator's bodies. A policy that was
trained here meets soft contacts, another integrator and another solver: a check of what it relies on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.actuators import Actuators
from simwarp.core.types import WorldStatus
from simwarp.exporters.mjcf_writer import SOFTNESS, mjcf_of
from simwarp.exporters.mujoco_world import BodyState, Inputs, MujocoWorld

from ..framework.errors import InputError
from ..framework.task import Task

__all__ = ["SOFTNESS", "STEPS", "MujocoSimulation", "put_in_mujoco"]

STEPS: Final = 2
"""Steps of MuJoCo in one sub-step of the task."""
_WATCHED: Final = ("body_x", "body_rot", "body_v", "body_omega", "joint_qd")
"""What is taken over where somebody else has written it."""
_STATE: Final = (
    *_WATCHED, "joint_x", "body_omega_last", "body_v_low", "body_omega_low", "world_time", "world_status",
)  # fmt: skip
_CONTROL: Final = (
    "joint_force", "joint_target_q", "joint_target_qd", "body_force", "body_torque", "body_force_b", "body_torque_b",
    "element_force", "element_torque", "element_joint_force",
)  # fmt: skip


class MujocoSimulation:
    """The simulation of a task with MuJoCo's steps in the place of its own.

    Other attributes and methods are those of the simulation. Bodies, coordinates, contact forces of bodies and shapes,
    and the time are written into it; single contacts and diagnostics are not. Efforts along the coordinates of floating
    bodies and balls have no effect. What anybody sets in it between two steps
    (resets, joint states, pushes) is taken over by the next one.

    Args:
        simulation: of the task, on the CPU.
        steps: of MuJoCo in one sub-step.
        softness: time constant of MuJoCo's contacts, stops and dry friction [s].

    Raises:
        InputError: the simulation is on a GPU, or has force elements other than actuators.
        ModelError: the model is no tree that MJCF can hold.
    """

    def __init__(self, simulation: Any, steps: int = STEPS, softness: float = SOFTNESS) -> None:
        self._inner = simulation
        if not simulation.model.device.is_cpu:
            raise InputError(f"physics of MuJoCo: the task must be on the CPU, got {simulation.model.device}")
        for element in simulation.elements:
            if not isinstance(element, Actuators):
                kind = type(element).__name__
                raise InputError(f"physics of MuJoCo: force elements must be Actuators, got {kind}; take another task")
        self._steps, self._softness = steps, softness
        self._part = simulation.dt / simulation.substeps
        self._actuating = [command for part in simulation.elements for command in part.record(simulation, self._part)]
        contacts, model = simulation.contacts, simulation.model
        self._state = {name: getattr(simulation.state, name).numpy() for name in _STATE}
        self._control = {name: getattr(simulation.control, name).numpy() for name in _CONTROL}
        self._forces = (contacts.body_contact_force.numpy(), contacts.shape_contact_force.numpy())
        own = [name for name in model.FIELDS if 1 < getattr(model, name).shape[0] == model.world_count]
        self._parameters = {name: getattr(model, name).numpy() for name in own}
        self._kept: dict[str, npt.NDArray[Any]] = {}
        self._written: dict[str, npt.NDArray[Any]] = {}
        self._compiled: dict[str, Any] = {}
        self.worlds = [self._made(world) for world in range(model.world_count)]
        """MuJoCo's worlds."""
        self._written = {name: array.copy() for name, array in self._parameters.items()}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def _made(self, world: int) -> MujocoWorld:
        """A world as its parameters are now; those of equal parameters share MuJoCo's model."""
        model = self._inner.model
        mjcf = mjcf_of(model, world=world, timestep=self._part / self._steps, softness=self._softness)
        made = MujocoWorld(model, mjcf, self._compiled.get(mjcf.text))
        if not self._parameters:
            self._compiled[mjcf.text] = made.model
        return made

    def step(self, steps: int = 1) -> None:
        """Advance every world by so many steps."""
        for _ in range(steps):
            self._copy_set_worlds()
            for _ in range(self._inner.substeps):
                for command in self._actuating:
                    command.launch()
                for index, world in enumerate(self.worlds):
                    world.step(self._inputs(index), self._steps)
                self._give_back()

    def advance(self, steps: int) -> None:
        """Take so many steps: another name for `step(steps)`."""
        self.step(steps)

    def _inputs(self, world: int) -> Inputs:
        values = {name: array[world] for name, array in self._control.items() if array.shape[0] > world}
        effort, force, torque = values["joint_force"], values["body_force"], values["body_torque"]
        if self._inner.elements:
            effort = effort + values["element_joint_force"]
            force, torque = force + values["element_force"], torque + values["element_torque"]
        own = [values["body_force_b"], values["body_torque_b"]]
        if any(part.any() for part in own):
            turned = Rotation(self._state["body_rot"][world])
            force, torque = force + turned.apply(own[0]), torque + turned.apply(own[1])
        return Inputs(values["joint_target_q"], values["joint_target_qd"], effort, force, torque)

    def _copy_set_worlds(self) -> None:
        """Hand MuJoCo the state of worlds that somebody has set since the last step, and the parameters drawn there."""
        changed = _differing(self._state, self._kept, _WATCHED, len(self.worlds))
        drawn = _differing(self._parameters, self._written, tuple(self._parameters), len(self.worlds))
        for world in np.flatnonzero(changed | drawn).tolist():
            if drawn[world]:
                self.worlds[world] = self._made(world)
            values = [self._state[name][world] for name in ("body_x", "body_rot", "body_v", "body_omega", "joint_x")]
            values.append(self._state["joint_qd"][world])
            self.worlds[world].set_state(BodyState(*(value.astype(np.float64) for value in values)))
        if drawn.any():
            self._written = {name: array.copy() for name, array in self._parameters.items()}

    def _give_back(self) -> None:
        """Publish MuJoCo's state in the task's simulation."""
        arrays, (bodies, shapes) = self._state, self._forces
        for index, world in enumerate(self.worlds):
            state = world.state()
            arrays["body_x"][index], arrays["body_rot"][index] = state.x, state.rotation
            arrays["body_v"][index], arrays["body_omega"][index] = state.v, state.omega
            if not world.is_sound:
                arrays["world_status"][index] |= int(WorldStatus.NON_FINITE)
        arrays["body_omega_last"][...] = arrays["body_omega"]
        arrays["body_v_low"][...], arrays["body_omega_low"][...] = 0.0, 0.0
        arrays["world_time"] += self._part
        self._inner.measure(None, sensors=False)
        # Behind it, which forgets contacts, and before sensors, which may read their forces
        bodies[...], shapes[...] = 0.0, 0.0
        for index, world in enumerate(self.worlds):
            world.add_contact_forces(bodies[index], shapes[index])
        if self._inner.sensors:
            self._inner.begin_sensors()
        self._kept = {name: arrays[name].copy() for name in _WATCHED}


def _differing(
    present: dict[str, npt.NDArray[Any]], kept: dict[str, npt.NDArray[Any]], names: Sequence[str], worlds: int
) -> npt.NDArray[np.bool_]:
    """(worlds,) True where an array of a world is not what was kept, or nothing was."""
    found = np.zeros(worlds, bool)
    for name in names:
        found |= name not in kept or (present[name] != kept[name]).reshape(worlds, -1).any(axis=1)
    return found


def put_in_mujoco(task: Task[Any], steps: int = STEPS, softness: float = SOFTNESS) -> MujocoSimulation:
    """Replace the physics of a task by MuJoCo's, for good; the task begins anew with its next restart.

    Args:
        task: on the CPU, whose model is a tree.
        steps: of MuJoCo in one sub-step of the task.
        softness: time constant of MuJoCo's contacts, stops and dry friction [s]; smaller ones need shorter steps.

    Raises:
        InputError: the task has no physics, is on a GPU, or has force elements other than actuators.
        ModelError: the model is no tree that MJCF can hold.
    """
    if task.simulation is None:
        raise InputError(f"task '{task.name}' has no physics that MuJoCo could take the place of")
    made = MujocoSimulation(task.simulation, steps, softness)
    task.simulation = made
    task.capture = False
    task.guard = None
    task._physics = None  # the author's methods are called instead of their launches
    return made
