"""SolverOptions: the numbers of the solver, checked where they are written."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

from simwarp.core.readable import ReadableFields
from simwarp.core.types import ConeSolver, ContactModel, FrictionLaw, ModelError, formatted, number
from simwarp.kernels.core.tables import StepConfig
from simwarp.model.checks import checked_choice, checked_flag, not_negative, whole_number
from simwarp.model.model import Model

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
class SolverOptions(ReadableFields):
    """Numbers of the solver (docs/theory.md). Every field is checked when the options are written.

    Attributes:
        max_depenetration_velocity: fastest correction of a penetration or of a joint's position error, >= 0 [m/s].
        max_depenetration_rate: the same for angles, >= 0 [rad/s].
        position_projection: passes that move positions onto the joints after each step, 0 to 1000; None: 0. Joints are
            held to second order in the step without them.
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

    max_depenetration_velocity: float = 0.6
    max_depenetration_rate: float = 3.0
    position_projection: int | None = None
    refinement: int | None = None
    pivot_tolerance: float = 1.0e-4
    max_iterations: int = 1000
    tolerance: float = 1.0e-5
    row_tolerance: float = 5.0e-6
    gyroscopic: bool = True
    solver: str = "apgd"
    fallback: bool | None = None
    friction_law: str = "exact"
    contact_model: str = "rigid"
    restitution_threshold: float = 0.15
    contact_margin: float = 1.0e-3
    dense_rows: int = 128

    def __post_init__(self) -> None:
        thing = "SolverOptions"
        units = {
            "max_depenetration_velocity": "m/s", "max_depenetration_rate": "rad/s", "tolerance": "m/s",
            "row_tolerance": "m/s", "restitution_threshold": "m/s", "contact_margin": "m",
        }  # fmt: skip
        checked: dict[str, Any] = {
            field: not_negative(thing, field, getattr(self, field), unit, f"the default is {_default(field)}")
            for field, unit in units.items()
        }
        if not 0.0 <= number(self.pivot_tolerance) < 1.0:
            raise ModelError(
                f"{thing}: pivot_tolerance must be >= 0 and < 1, got {formatted(self.pivot_tolerance)}; try 1e-4"
            )
        checked["pivot_tolerance"] = number(self.pivot_tolerance)
        for field, least, most in (
            ("position_projection", 0, MOST_PASSES), ("refinement", 0, MOST_PASSES),
            ("max_iterations", 1, MOST_ITERATIONS), ("dense_rows", 0, MOST_DENSE_ROWS),
        ):  # fmt: skip
            if getattr(self, field) is not None or _default(field) is not None:
                remedy = f"the default is {_default(field)}"
                checked[field] = whole_number(thing, field, getattr(self, field), least, most, remedy)
        for field in ("gyroscopic", "fallback"):
            if getattr(self, field) is not None or _default(field) is not None:
                checked[field] = checked_flag(thing, field, getattr(self, field))
        for field, known in (("solver", SOLVERS), ("friction_law", FRICTION_LAWS), ("contact_model", CONTACT_MODELS)):
            checked[field] = checked_choice(thing, field, getattr(self, field), known)
        for field, value in checked.items():  # numbers of NumPy become Python's
            object.__setattr__(self, field, value)


def _default(field: str) -> Any:
    return SolverOptions.__dataclass_fields__[field].default


def needs_all_solvers(model: Model, options: SolverOptions) -> bool:
    """Whether other solvers than accelerated gradient descent may run."""
    fallback = model.shape_count > 0 and model.mass_ratio > REFINED_MASS_RATIO
    other = options.solver != ConeSolver.APGD.name.lower()
    return other or (fallback if options.fallback is None else options.fallback)


def step_config(options: SolverOptions, dt: float, mass_ratio: float, *, reactions: bool, accelerations: bool) -> Any:
    """The numbers of a sub-step of `dt` [s] as kernels read them.

    Args:
        options: of the solver.
        dt: of the sub-step [s].
        mass_ratio: of the heaviest to the lightest body.
        reactions: record the joints' reactions.
        accelerations: record the coordinates' accelerations.
    """
    config: Any = StepConfig()
    config.dt = dt
    for name in (
        "max_depenetration_velocity", "max_depenetration_rate", "pivot_tolerance", "max_iterations", "tolerance",
        "row_tolerance", "restitution_threshold", "contact_margin", "dense_rows",
    ):  # fmt: skip
        setattr(config, name, getattr(options, name))
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
