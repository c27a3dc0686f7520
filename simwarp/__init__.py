"""simwarp: thousands of non-smooth multibody worlds at once, in NVIDIA Warp kernels, on a GPU or a CPU."""

from simwarp.builder import ModelBuilder
from simwarp.diagnostics import Diagnostics
from simwarp.model import Model
from simwarp.simulation import Simulation, Snapshot, SolverOptions
from simwarp.state import Control, State
from simwarp.types import (
    WORLD,
    Dof,
    JointType,
    ModelError,
    Pose,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
    WorldStatus,
    pose,
)

__all__ = [
    "WORLD",
    "Control",
    "Diagnostics",
    "Dof",
    "JointType",
    "Model",
    "ModelBuilder",
    "ModelError",
    "Pose",
    "PositionDrive",
    "PrescribedPosition",
    "PrescribedSpeed",
    "Simulation",
    "Snapshot",
    "SolverOptions",
    "State",
    "VelocityMotor",
    "WorldStatus",
    "pose",
]
