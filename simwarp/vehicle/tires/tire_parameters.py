"""Parameters of tires by name; `spec.Tire.parameters` holds them, beside its radius and width.

A model takes the keys of several classes here: `CommonParameters` and those that `MODELS` of parameter_vector.py names.
Units are SI, but for the coefficients of Pacejka 89.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Literal, TypeAlias

from simwarp.core.constraints import Angle, Curve, Ge, Le, NotNegative, Positive
from simwarp.vehicle.spec.vehicle_spec import Spec, refuse

PositivePair: TypeAlias = tuple[Positive, Positive]
"""Values at the nominal and at twice the nominal load, or along x and y, or two limits."""
NotNegativePair: TypeAlias = tuple[NotNegative, NotNegative]


@dataclasses.dataclass(frozen=True, kw_only=True)
class RigidParameters(Spec):
    """All that a rigid tire takes."""

    friction: NotNegative = 0.9
    restitution: NotNegative = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlexibleParameters(Spec):
    """All that a tire of flexible triangles takes."""

    pressure: NotNegative = 2.4e5
    """Of the air inside [Pa]."""
    friction: NotNegative = 0.9
    rim_radius: Positive = 0.2286
    """Where its beads sit on the rim [m]."""
    thickness: Positive = 0.012
    """Of the carcass, one layer [m]; its density is what gives the tire its mass."""
    young: Positive = 4.0e7
    """[Pa]"""
    poisson: Annotated[NotNegative, Le(0.49)] = 0.3
    damping_time: NotNegative = 2.0e-3
    """Stress per strain rate over stress per strain [s]."""
    squareness: Annotated[float, Ge(2.0), Le(8.0)] = 3.0
    """Exponent of the section: 2 is an ellipse, more is a flatter tread."""
    around: Annotated[int, Ge(8), Le(180)] = 45
    """Cells around the wheel."""
    across: Annotated[int, Ge(4), Le(24)] = 8
    """Cells from bead to bead."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilRigidParameters(Spec):
    """All that a rigid tire on deformable soil takes."""

    crown: NotNegative = 0.0
    """Radius of the tread across [m]; 0: it is flat."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CommonParameters(Spec):
    """Parameters of every model."""

    contact: Literal["single-point", "four-point", "envelope"] = "single-point"
    """Method by which the ground is sampled (patch_kernels.py)."""
    reference_friction: Positive = 0.8
    """Friction of the road on which the parameters were measured."""
    friction_limits: PositivePair = (1.0e-4, 1.0)
    """The road's friction is clamped to them; by default as low as a road of a manoeuvre can have."""
    camber_limit: Annotated[Positive, Angle(0.5 * math.pi)] | None = None
    """Camber beyond it counts as it [rad]; None: 4° for TMeasy and TMsimple, 3° for the others."""
    rolling_resistance: NotNegative | None = None
    """Torque over load and radius (Fiala: torque over load [m]); None: 0.015, or that of the property file."""
    measured_side: Literal["left", "right", "either"] | None = None
    """Side on which an asymmetric tire was measured; on the other one it is mirrored. "either": never mirrored. None:
    the TYRESIDE of a property file, else never.
    """
    relaxation_length: PositivePair | None = None
    """Way over which the slips of the contact follow those of the wheel, along x and y [m]. None: that of a property
    file whose USE_MODE asks for it, else the tire answers at once.
    """
    bristle_stiffness: Positive = 1.0e5
    """Of what holds the standing wheel [N/m]."""
    bristle_damping: NotNegative = 5.0e3
    """[N·s/m]."""
    blend: PositivePair = (1.0, 3.0)
    """Speeds between which the law of slip replaces the bristle [m/s]."""

    def check(self) -> None:
        """Limits are in order."""
        for key in ("friction_limits", "blend"):
            low, high = getattr(self, key)
            if not low < high:
                raise refuse(key, "two increasing numbers", (low, high))


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerticalParameters(Spec):
    """A linear spring, or a table; and a damper."""

    vertical_stiffness: Positive | None = None
    vertical_damping: NotNegative = 0.0
    vertical_curve: Curve | None = None
    """(deflection [m], force [N]); replaces the stiffness."""
    load_limit: Positive | None = None
    """Largest load with which horizontal forces grow [N]; None: for Pacejka 89 where they are largest, else none."""

    def check(self) -> None:
        """One of the two springs is there."""
        if self.vertical_stiffness is None and self.vertical_curve is None:
            raise refuse("vertical_stiffness", "given, or vertical_curve", None)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RatedParameters(Spec):
    """The pattern and the rated load from which a tire is guessed, and its vertical law, which they give otherwise."""

    pattern: Literal["truck", "car"] | None = None
    """The typical tire whose measured values this one takes."""
    load: Positive | None = None
    """Largest load [N]."""
    load_index: int | None = None
    rim_radius: Positive
    design_pressure: Positive = 1.0
    """Inflation at the rated load, and as it is used; only their ratio counts."""
    use_pressure: Positive = 1.0
    damping_ratio: Positive = 0.5
    """Of the tire's mass on its spring."""
    nominal_load: Positive | None = None
    load_limit: Positive | None = None
    """Largest load with which horizontal forces grow [N]."""
    vertical_stiffness: Positive | None = None
    vertical_stiffness_square: float = 0.0
    """[N/m²]."""
    vertical_damping: NotNegative | None = None
    bottom_deflection: Positive | None = None
    """Deflection at which the rim touches [m]; None: 10 mm before the rim."""
    bottom_stiffness: NotNegative | None = None
    """None: five times the vertical stiffness [N/m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TmsimpleParameters(Spec):
    """Characteristic values of TMsimple; those that are given replace those of the pattern."""

    slope_x: PositivePair | None = None
    """Initial slope of the force over slip [N]."""
    max_x: PositivePair | None = None
    """Largest force [N]."""
    slide_x: PositivePair | None = None
    """Force of full sliding [N]."""
    slope_y: PositivePair | None = None
    max_y: PositivePair | None = None
    slide_y: PositivePair | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class TmeasyParameters(TmsimpleParameters):
    """Characteristic values of TMeasy: those of TMsimple, and the slips to them."""

    max_slip_x: PositivePair | None = None
    """Slip of the largest force."""
    slide_slip_x: PositivePair | None = None
    """Slip from which the tire slides."""
    max_slip_y: PositivePair | None = None
    slide_slip_y: PositivePair | None = None
    trail: NotNegativePair | None = None
    """Pneumatic trail over the patch's length at no slip; the slips where it changes its sign and where it ends."""
    trail_zero_slip: PositivePair | None = None
    trail_end_slip: PositivePair | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class FialaParameters(Spec):
    """Fiala's brush."""

    slip_stiffness: Positive
    """Longitudinal force over slip [N] (CSLIP)."""
    cornering_stiffness: Positive
    """Lateral force over slip angle [N/rad] (CALPHA)."""
    friction_sliding: Positive
    """At full slip (UMIN)."""
    friction_static: Positive
    """Without slip (UMAX)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pacejka89Parameters(Spec):
    """Coefficients of Pacejka 89, in kN, degrees and percent."""

    lateral_stiffness: Positive
    """Of the carcass [N/m]."""
    lateral: tuple[float, ...]
    """a0 to a13."""
    longitudinal: tuple[float, ...]
    """b0 to b10."""
    aligning: tuple[float, ...]
    """c0 to c17."""

    def check(self) -> None:
        """All coefficients are there."""
        for key, count in (("lateral", 14), ("longitudinal", 11), ("aligning", 18)):
            if len(getattr(self, key)) != count:
                raise refuse(key, f"{count} numbers", getattr(self, key))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pacejka2002Parameters(Spec):
    """Pacejka 2002 from a property file.

    Recorded runs of Project Chrono come out with argument_limit = pi/2 - 0.01 and rolling_resistance = 0: there the
    argument of the formula is clamped, and QSY1 does not act. They come out with combined = "friction-ellipse", too.
    """

    tir: dict[str, float | str]
    """KEY -> value of the file; {"file": "NAME.tir"} stands for them."""
    mode: int | None = None
    """0: vertical force only, 1: F_x, 2: F_y and M_z, 3: both, 4: combined; 10 more: with relaxation lengths; None:
    USE_MODE of the file.
    """
    combined: Literal["friction-ellipse", "weights"] | None = None
    """None: weights, as the formula has them, where the file has their coefficients, else the ellipse."""
    argument_limit: Positive | None = None
    """|B x| is clamped to it before the formula bends it; None: it is not."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LugreParameters(Spec):
    """LuGre; the defaults are those with which Project Chrono modelled the HMMWV."""

    bristle_rate: PositivePair = (181.0, 60.0)
    """sigma0 along x and y: force over load and deflection [1/m]."""
    bristle_viscosity: NotNegativePair = (1.0, 0.1)
    """sigma1 [s/m]."""
    viscosity: NotNegativePair = (0.02, 0.002)
    """sigma2 [s/m]."""
    kinetic_friction: Positive = 0.75
    static_friction: Positive = 0.84
    stribeck_speed: Positive = 0.035
    """[m/s]."""
    carry_off: NotNegative = 1.2
    """Rate at which bristles leave the rolling patch, in |omega r| over its length; 0: they do not."""
    disc_count: Annotated[int, Ge(1), Le(16)] = 3
    disc_spacing: NotNegative | None = None
    """[m]; None: the outer discs are 0.4 width from the middle."""
