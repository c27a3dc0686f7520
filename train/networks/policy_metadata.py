"""What a controller must know of a task to run its policy, as plain values: names, orders, scales, gains, rate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from simwarp import PositionDrive
from simwarp.tasks import Task

if TYPE_CHECKING:
    from simwarp import Model


def policy_metadata(task: Task[Any]) -> dict[str, Any]:
    """Return the metadata of a task's policies; what the task does not have is left out.

    Returns:
        ``observations`` (name, shape and dtype of the groups, in the order of the file's inputs), ``observation_names``
        (group -> names of its components), ``action_names``, ``action_scale``, ``joint_names`` (that actions move),
        ``default_joint_pos`` [rad or m], ``joint_stiffness`` [N·m/rad or N/m], ``joint_damping``,
        ``joint_effort_limit`` [N·m or N], ``control_rate`` [1/s].
    """
    groups = task.observation_shapes
    dtypes = task.observation_dtypes
    found: dict[str, Any] = {
        "observations": [
            {"name": name, "shape": list(shape), "dtype": str(dtypes[name]).removeprefix("torch.")}
            for name, shape in groups.items()
        ],
        "observation_names": {name: list(names) for name, names in task.observation_names.items()},
        "action_names": list(task.action_names or task.action_joints),
        "action_scale": [float(scale) for scale in task.action_scale],
        "joint_names": list(task.action_joints),
        "control_rate": 1.0 / task.config.control_dt,
    }
    if found["joint_names"]:
        found |= _joints_alike(task, found["joint_names"])
    return {name: value for name, value in found.items() if value not in ([], {})}


def _joints_alike(task: Task[Any], names: Sequence[str]) -> dict[str, Any]:
    """Return what all models of the task have alike of their joints."""
    first, *others = (
        _joints(group.task.simulation.model, names, group.task.default_positions) for group in task.model_groups
    )
    return {name: value for name, value in first.items() if all(other.get(name) == value for other in others)}


def _joints(model: Model, names: Sequence[str], positions: Sequence[float]) -> dict[str, Any]:
    """Return default positions, and gains where all of the joints have position drives."""
    joints = [model.builder.joints[model.joint_names.index(name)] for name in names]
    found: dict[str, Any] = {"default_joint_pos": [float(q) for q in positions] or [float(j.initial_q) for j in joints]}
    drives = [drive for joint in joints for dof in joint.dofs if isinstance(drive := dof.drive, PositionDrive)]
    if len(drives) == len(joints):
        found["joint_stiffness"] = [float(drive.stiffness) for drive in drives]
        found["joint_damping"] = [float(drive.damping) for drive in drives]
        limits = [limit for drive in drives if isinstance(limit := drive.effort_limit, int | float)]
        if len(limits) == len(drives):
            found["joint_effort_limit"] = [float(limit) for limit in limits]
    return found
