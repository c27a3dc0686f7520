"""Actuators of a task, made so that its configuration may randomise them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import simwarp as sw

from ..framework.task import Task
from ..randomisation.actuator_randomisation import own_arrays


def actuators_of(
    task: Task[Any], model: sw.Model, specs: Iterable[sw.actuators.ActuatorSpec], *, per_world: Iterable[str] = ()
) -> sw.actuators.Actuators:
    """Return the actuators of a task, for its ``attach``: with the time of a sub-step, which delays need, and with a
    row for each world of what ``randomise`` names: ``actuator_strength``, ``actuator_stiffness``,
    ``actuator_damping`` (factors) and ``actuator_delay`` [s].

        def attach(self, model):
            self.motors = actuators_of(self, model, [pd_actuator(name, model.dof(name), ...) for name in JOINTS])
            return Attachments(elements=[self.motors])

    Args:
        task: that they belong to.
        model: of the task.
        specs: the actuators, in the order of their controls.
        per_world: arrays that the task writes itself, world by world, see ``simwarp.actuators.PER_WORLD``.

    Raises:
        ModelError: an actuator does not fit the model.
    """
    drawn = own_arrays(task.config.uncertainty.randomise)
    return sw.actuators.Actuators(
        model, specs, per_world={*per_world, *drawn}, dt=task.config.dt / task.config.substeps
    )
