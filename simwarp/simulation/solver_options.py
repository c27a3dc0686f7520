"""SolverOptions: the numbers of the solver, checked where they are written."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, Final

from simwarp.core.constraints import Ge, Le, Lt, Meaning, NotNegative
from simwarp.core.types import ConeSolver, ContactModel, FrictionLaw, ModelError
from simwarp.kernels.core.tables import StepConfig
from simwarp.model.model import Model
from simwarp.model.rules import Configuration, Flag, word_of
from simwarp.simulation.flexible_options import FlexibleOptions

SOLVERS: Final = tuple(solver.name.lower() for solver in ConeSolver)
FRICTION_LAWS: Final = tuple(law.name.lower() for law in FrictionLaw)
CONTACT_MODELS: Final = tuple(model.name.lower() for model in ContactModel)

REFINED_MASS_RATIO: Final = 100.0
"""Masses that differ by more get a pass of refinement and the fallback solver, unless the options say otherwise."""
CURVATURE_SHARE: Final = 1.0 / 3.0
"""Of the error that a step adds to a moving joint: what keeps the energy best without position projection, which wants
all of it (docs/theory.md)."""

MOST_ITERATIONS: Final = 10_000_000
"""Forty gradient steps may stand for each one: their number stays below 2^31."""
MOST_PASSES: Final = 1000
MOST_DENSE_ROWS: Final = 32_768
"""Of a matrix of 4 GiB, whose entries kernels number with 32 bits."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SolverOptions(Configuration):
    """Numbers of the solver (docs/theory.md). Every field is checked when the options are written.

    Attributes:
        max_depenetration_velocity: fastest correction of a penetration or of a joint's position error, >= 0 [m/s].
        max_depenetration_rate: the same for angles, >= 0 [rad/s].
        position_projection: passes that move positions onto the joints after each step, 0 to 1000; None: 0. Joints are
            held to second order in the step without them.
        numerical_damping: of springs, dampers and drives, 0 to 1 (docs/integrators.md). 1: backward Euler, of first
            order; 0: the trapezoidal rule, of second order, which damps nothing; 0.1: damps what is too fast for the
            step, and little else. An oscillation of w [rad/s] decays by numerical_damping · dt · w² / 2 per second more
            than its dampers make it.
        refinement: passes of iterative refinement on the free motion, 0 to 1000; when None, 1 for models whose heaviest
            body has more than 100 times the mass of the lightest, else 0.
        pivot_tolerance: a row whose pivot falls below this share of its diagonal counts as redundant; >= 0 and < 1.
        max_iterations: of the solve of limits, friction and contacts, 1 to 10 000 000.
        tolerance: residual at which it stops, >= 0 [m/s or rad/s].
        row_tolerance: residual above which bilateral rows are solved a second time, >= 0 [m/s or rad/s].
        gyroscopic: True if spinning bodies precess.
        solver: of limits, friction and contacts: "apgd", "psor", "spg", "padmm" or "interior_point". The last two need
            a dense Schur complement: islands with more rows than `dense_rows` are solved by "apgd" in their place.
        fallback: let the interior point solve what is left above the tolerance in islands with a dense Schur
            complement; when None, where models have contacts and masses that differ by more than 100.
        friction_law: "exact" (Coulomb) or "convex" (its relaxation: what slides hovers by friction x speed x step, and
            what begins to slide at a closed gap is thrown off with friction x speed; docs/theory.md).
        contact_model: "rigid" (unilateral rows), "smooth" or "smooth_hooke" (penalty forces by the law of Hertz or
            Hooke from Young's modulus and Poisson's ratio; dt has to resolve the collision time).
        restitution_threshold: restitution acts where the rebound is faster than this, >= 0 [m/s].
        contact_margin: a contact takes part if its gap, after a step without contacts, would be below this, >= 0 [m].
        dense_rows: most rows for which the Schur complement of the contacts of an island is formed, 0 to 32 768; larger
            ones apply it row by row. 0: all do.

    Raises:
        ModelError: a value lies outside its domain.
    """

    max_depenetration_velocity: Annotated[NotNegative, Meaning("m/s, 0.6 by default")] = 0.6
    max_depenetration_rate: Annotated[NotNegative, Meaning("rad/s, 3 by default")] = 3.0
    position_projection: Annotated[int, Ge(0), Le(MOST_PASSES), Meaning("passes, or None")] | None = None
    numerical_damping: Annotated[float, Ge(0.0), Le(1.0), Meaning("a share, 1 by default")] = 1.0
    refinement: Annotated[int, Ge(0), Le(MOST_PASSES), Meaning("passes, or None")] | None = None
    pivot_tolerance: Annotated[float, Ge(0.0), Lt(1.0), Meaning("a share, 1e-4 by default")] = 1.0e-4
    max_iterations: Annotated[int, Ge(1), Le(MOST_ITERATIONS), Meaning("1000, the default")] = 1000
    tolerance: Annotated[NotNegative, Meaning("m/s, 1e-5 by default")] = 1.0e-5
    row_tolerance: Annotated[NotNegative, Meaning("m/s, 5e-6 by default")] = 5.0e-6
    gyroscopic: Flag = True
    solver: Annotated[str, word_of(*SOLVERS)] = "apgd"
    fallback: Flag | None = None
    friction_law: Annotated[str, word_of(*FRICTION_LAWS)] = "exact"
    contact_model: Annotated[str, word_of(*CONTACT_MODELS)] = "rigid"
    restitution_threshold: Annotated[NotNegative, Meaning("m/s, 0.15 by default")] = 0.15
    contact_margin: Annotated[NotNegative, Meaning("m, 1e-3 by default")] = 1.0e-3
    dense_rows: Annotated[int, Ge(0), Le(MOST_DENSE_ROWS), Meaning("rows, 128 by default")] = 128


def spring_average(numerical_damping: float) -> float:
    """Beta of the rule for springs, the least that is stable at any frequency (simwarp/kernels/dynamics/efforts.py)."""
    return max(0.0, (1.0 - 2.0 * numerical_damping) / 4.0)


def flexible_average(numerical_damping: float) -> float:
    """Beta of the rule for elastic joints: what damps oscillations that are too fast for the step most (elastic.py)."""
    return (1.0 - numerical_damping) ** 2 / 4.0


def needs_all_solvers(model: Model, options: SolverOptions) -> bool:
    """Whether other solvers than accelerated gradient descent may run."""
    fallback = model.shape_count > 0 and model.mass_ratio > REFINED_MASS_RATIO
    other = options.solver != ConeSolver.APGD.name.lower()
    return other or (fallback if options.fallback is None else options.fallback)


def check_contact_model(model: Model, options: SolverOptions) -> None:
    """The model's contacts have the law that is wanted.

    Raises:
        ModelError: there are none by it.
    """
    if model.topology.face_count and options.contact_model != ContactModel.RIGID.name.lower():
        raise ModelError(
            f"Simulation: contact_model must be rigid where faces of meshes touch, got {options.contact_model}; "
            "add the meshes with contact='nodes'"
        )


def step_config(
    options: SolverOptions, flex: FlexibleOptions, dt: float, mass_ratio: float, *, reactions: bool, accelerations: bool
) -> Any:
    """The numbers of a sub-step of `dt` [s] as kernels read them.

    Args:
        options: of the solver.
        flex: of flexible parts.
        dt: of the sub-step [s].
        mass_ratio: of the heaviest to the lightest body.
        reactions: record the joints' reactions.
        accelerations: record the coordinates' accelerations.
    """
    config: Any = StepConfig()
    config.dt = dt
    for name in (
        "max_depenetration_velocity", "max_depenetration_rate", "pivot_tolerance", "max_iterations", "tolerance",
        "row_tolerance", "restitution_threshold", "contact_margin", "dense_rows", "numerical_damping",
    ):  # fmt: skip
        setattr(config, name, getattr(options, name))
    config.spring_average = spring_average(options.numerical_damping)
    config.flexible_damping = flex.numerical_damping
    config.flexible_average = flexible_average(flex.numerical_damping)
    config.projection_iterations = options.position_projection or 0
    config.curvature_share = CURVATURE_SHARE if config.projection_iterations == 0 else 1.0
    refined = int(mass_ratio > REFINED_MASS_RATIO)
    config.refinement = refined if options.refinement is None else options.refinement
    config.reactions, config.accelerations = int(reactions), int(accelerations)
    config.gyroscopic = int(options.gyroscopic)
    config.friction_law = FRICTION_LAWS.index(options.friction_law)
    config.solver = SOLVERS.index(options.solver)
    config.contact_model = CONTACT_MODELS.index(options.contact_model)
    return config
