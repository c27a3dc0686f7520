"""Public names of `import simwarp as sw`: model, simulation, and the types that they take."""

from simwarp.core.types import (
    WORLD,
    Dof,
    FrictionRule,
    JointType,
    Material,
    ModelError,
    PairRule,
    Pose,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    ShapeType,
    Vec3,
    VelocityMotor,
    WorldStatus,
    pose,
)
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.model.model_files import load_model, save_model
from simwarp.simulation.attachments import ForceElement, Sensor, StepContext
from simwarp.simulation.cone_problems import ConeSolution, solve_cone_problems
from simwarp.simulation.diagnostics import Diagnostics
from simwarp.simulation.simulation import Simulation
from simwarp.simulation.snapshot import Snapshot
from simwarp.simulation.solver_options import SolverOptions
from simwarp.simulation.state import Contacts, Control, State
from simwarp.simulation.state_check import InitialStateWarning, Overlap, PassedLimit, StateFaults

__all__ = [
    "WORLD",
    "ConeSolution",
    "Contacts",
    "Control",
    "Diagnostics",
    "Dof",
    "ForceElement",
    "FrictionRule",
    "InitialStateWarning",
    "JointType",
    "Material",
    "Model",
    "ModelBuilder",
    "ModelError",
    "Overlap",
    "PairRule",
    "PassedLimit",
    "Pose",
    "PositionDrive",
    "PrescribedPosition",
    "PrescribedSpeed",
    "Sensor",
    "ShapeType",
    "Simulation",
    "Snapshot",
    "SolverOptions",
    "State",
    "StateFaults",
    "StepContext",
    "Vec3",
    "VelocityMotor",
    "WorldStatus",
    "load_model",
    "pose",
    "save_model",
    "solve_cone_problems",
]
