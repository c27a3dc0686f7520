"""What `import simwarp as sw` offers: model, simulation, and the types that they take."""

from simwarp.builder import ModelBuilder
from simwarp.contacts import Contacts
from simwarp.diagnostics import Diagnostics
from simwarp.dynamics.cone_problems import ConeSolution, solve_cone_problems
from simwarp.model import Model
from simwarp.simulation import Simulation
from simwarp.snapshot import Snapshot
from simwarp.solver_options import SolverOptions
from simwarp.state import Control, State
from simwarp.types import (
    WORLD,
    Dof,
    JointType,
    Material,
    ModelError,
    Pose,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    ShapeType,
    VelocityMotor,
    WorldStatus,
    pose,
)

__all__ = [
    "WORLD",
    "ConeSolution",
    "Contacts",
    "Control",
    "Diagnostics",
    "Dof",
    "JointType",
    "Material",
    "Model",
    "ModelBuilder",
    "ModelError",
    "Pose",
    "PositionDrive",
    "PrescribedPosition",
    "PrescribedSpeed",
    "ShapeType",
    "Simulation",
    "Snapshot",
    "SolverOptions",
    "State",
    "VelocityMotor",
    "WorldStatus",
    "pose",
    "solve_cone_problems",
]
