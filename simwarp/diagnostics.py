"""What a step tells about itself, per world, readable at any time without stopping the run."""

from __future__ import annotations

import warp as wp

from simwarp.kernels.tables import Reports
from simwarp.model import Model


class Diagnostics:
    """Per-world reports of the last sub-step.

    Attributes:
        row_residual: (W,) largest speed error of the bilateral rows [m/s or rad/s].
        bounded_residual: (W,) natural residual of the bounded rows [m/s or rad/s].
        bounded_count: (W,) int32, bounded rows that took part.
        iterations: (W,) int32, of the bounded solve.
        position_error: (W,) largest joint violation [m or rad], at the step's start (after it when projected).
        joint_reaction_force, joint_reaction_torque: (W, J) vec3, what the joint applies to its second body at
            anchor 1, drives and limits included, world frame [N, N·m]; zeros unless the simulation records them.
    """

    NAMES = (
        "row_residual", "bounded_residual", "bounded_count", "iterations", "position_error", "joint_reaction_force",
        "joint_reaction_torque",
    )  # fmt: skip

    def __init__(self, model: Model, *, reactions: bool) -> None:
        worlds, device = model.world_count, model.device
        joints = (worlds if reactions else 0, model.joint_count)
        self.row_residual = wp.zeros(worlds, dtype=wp.float32, device=device)
        self.bounded_residual = wp.zeros(worlds, dtype=wp.float32, device=device)
        self.bounded_count = wp.zeros(worlds, dtype=wp.int32, device=device)
        self.iterations = wp.zeros(worlds, dtype=wp.int32, device=device)
        self.position_error = wp.zeros(worlds, dtype=wp.float32, device=device)
        self.joint_reaction_force = wp.zeros(joints, dtype=wp.vec3, device=device)
        self.joint_reaction_torque = wp.zeros(joints, dtype=wp.vec3, device=device)
        self.arrays = Reports()
        for name in self.NAMES:
            setattr(self.arrays, name, getattr(self, name))
