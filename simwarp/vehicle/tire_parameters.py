"""Parameters of tires by name, one class per model; `spec.Tire.parameters` holds them, beside its radius and width.

Every model takes those of `CommonParameters` and its own. Units are SI.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar, Literal, TypeAlias

from simwarp.vehicle.spec import Spec, refuse

Pair: TypeAlias = tuple[float, float]
"""Values at the nominal and at twice the nominal load, or two limits."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CommonParameters(Spec):
    """What every model takes."""

    POSITIVE: ClassVar = frozenset(
        {"reference_friction", "friction_limits", "camber_limit", "bristle_stiffness", "blend"}
    )
    NOT_NEGATIVE: ClassVar = frozenset({"rolling_resistance", "bristle_damping"})

    contact: Literal["single-point", "four-point", "envelope"] = "single-point"
    """How the ground is sampled (kernels/tires/patch.py)."""
    reference_friction: float = 0.8
    """Friction of the road on which the parameters were measured."""
    friction_limits: Pair = (0.1, 1.0)
    """The road's friction is clamped to them."""
    camber_limit: float | None = None
    """Camber beyond it counts as it [rad]; None: what is usual for the model."""
    rolling_resistance: float | None = None
    """Coefficient; None: what is usual for the model."""
    measured_side: Literal["left", "right"] | None = None
    """Side on which an asymmetric tire was measured; on the other one it is mirrored. None: never."""
    bristle_stiffness: float = 1.0e5
    """Of what holds the standing wheel [N/m]."""
    bristle_damping: float = 5.0e3
    """[N·s/m]."""
    blend: Pair = (1.0, 3.0)
    """Speeds between which the law of slip replaces the bristle [m/s]."""

    def check(self) -> None:
        """Limits are in order."""
        for key in ("friction_limits", "blend"):
            low, high = getattr(self, key)
            if not low < high:
                raise refuse(key, "two increasing numbers", (low, high))


@dataclasses.dataclass(frozen=True, kw_only=True)
class TmeasyParameters(Spec):
    """TMeasy: a pattern and the rated load, or all values; values that are given replace those of the pattern."""

    POSITIVE: ClassVar = frozenset(
        {
            "load", "rim_radius", "design_pressure", "use_pressure", "damping_ratio", "nominal_load", "load_limit",
            "vertical_stiffness", "bottom_deflection", "slope_x", "max_x", "slide_x", "max_slip_x", "slide_slip_x",
            "slope_y", "max_y", "slide_y", "max_slip_y", "slide_slip_y", "trail_zero_slip", "trail_end_slip",
        }
    )  # fmt: skip
    NOT_NEGATIVE: ClassVar = frozenset({"vertical_damping", "bottom_stiffness", "trail"})

    pattern: Literal["truck", "car"] | None = None
    """The typical tire from whose measured values this one is guessed."""
    load: float | None = None
    """Largest load [N]."""
    load_index: int | None = None
    rim_radius: float
    design_pressure: float = 1.0
    """Inflation at the rated load, and as it is used; only their ratio counts."""
    use_pressure: float = 1.0
    damping_ratio: float = 0.5
    """Of the tire's mass on its spring; larger damps more."""
    nominal_load: float | None = None
    load_limit: float | None = None
    """Largest load with which horizontal forces grow [N]."""
    vertical_stiffness: float | None = None
    vertical_stiffness_square: float = 0.0
    """[N/m²]."""
    vertical_damping: float | None = None
    bottom_deflection: float | None = None
    """Where the rim touches [m]; None: 10 mm before the rim."""
    bottom_stiffness: float | None = None
    """None: five times the vertical stiffness [N/m]."""
    slope_x: Pair | None = None
    """Initial slope of the force over slip [N]."""
    max_x: Pair | None = None
    """Largest force [N], and its slip."""
    slide_x: Pair | None = None
    """Force of full sliding [N], and the slip from which it slides."""
    max_slip_x: Pair | None = None
    slide_slip_x: Pair | None = None
    slope_y: Pair | None = None
    max_y: Pair | None = None
    slide_y: Pair | None = None
    max_slip_y: Pair | None = None
    slide_slip_y: Pair | None = None
    trail: Pair | None = None
    """Pneumatic trail over the patch's length at no slip; the slips where it changes its sign and where it ends."""
    trail_zero_slip: Pair | None = None
    trail_end_slip: Pair | None = None
