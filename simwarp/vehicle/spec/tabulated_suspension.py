"""A suspension as tables: where the wheel is, how it leans and what springs and dampers do, over travel and steering.

`simwarp reduce` measures them on the linkage of a full vehicle (`simwarp.vehicle.reduced.reduction`). Travel is that of
the wheel's centre upwards, from the state in which the full vehicle is built; the steering goes from -1 to 1, positive
to the left. Points are in the vehicle's frame of reference; both sides are described, nothing is mirrored.
"""

from __future__ import annotations

import dataclasses
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np

from simwarp.core.constraints import MinLen, NotNegative, Point, Positive
from simwarp.vehicle.spec.parts import RigidPart, Spec, refuse

Values: TypeAlias = tuple[float, ...]
Grid: TypeAlias = tuple[tuple[float, ...], ...]
"""A row for each travel."""

REDUCED: Final = "-14dof"
"""Ends the names of reduced vehicles."""
OVER_STEERING: Final = ("ahead", "aside", "axis_x", "axis_z", "windup", "spring_load")
"""Fields of `WheelTable` over travel and steering."""
EVEN: Final = 1.0e-6
"""Spacings of a table's places are equal within this share."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WheelTable(Spec):
    """One wheel of an axle. Grids have a row for each travel and a column for each steering, or for each rate."""

    height: float
    """Of the wheel's centre at no travel, in the vehicle's frame of reference [m]."""
    ahead: Grid
    """The centre's x [m]."""
    aside: Grid
    """The centre's y [m]."""
    axis_x: Grid
    """x of the wheel's axis, a unit vector to the left."""
    axis_z: Grid
    windup: Grid
    """Turn of the brake's caliper about the wheel's axis per travel [rad/m]."""
    spring_load: Grid
    """Vertical force on the wheel that holds the springs there [N]."""
    damper_load: Grid
    """Vertical force on the wheel that moves the dampers, over travel and its rate [N]."""
    bar_twist: Values
    """Twist of the anti-roll bar by this wheel's travel [rad]."""
    mass: Positive
    """Kinetic energy of wheel and links, without the tire, is half of this times the square of the travel's rate."""
    momentum: Point
    """Their momentum per rate of the travel [kg]."""
    moment: Point
    """Their moment of momentum about the origin of the vehicle's frame of reference per rate of the travel [kg·m]."""
    spin_inertia: Positive
    """About the wheel's axis, without the tire [kg·m²]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TabulatedSuspension(Spec):
    """An independent suspension, or a wheel that does not travel, by tables of both wheels."""

    template: Literal["tabulated"] = "tabulated"
    spindle: RigidPart
    """The wheel's bearing of the left side as built; its mass is among the chassis' components."""
    travel: Annotated[Values, MinLen(2)]
    """Places of the tables' rows, equally spaced [m]."""
    steering: Annotated[Values, MinLen(1)]
    """Places of the columns, equally spaced from -1 to 1; one number of an axle that is not steered."""
    rate: Annotated[Values, MinLen(2)]
    """Of the travel: places of the dampers' columns, equally spaced [m/s]."""
    standing: float
    """Travel under the standing vehicle, where masses are measured [m]."""
    fixed: bool = False
    """The wheels do not travel."""
    left: WheelTable
    right: WheelTable
    bar_stiffness: NotNegative = 0.0
    """Of the anti-roll bar [N·m/rad]."""
    bar_damping: NotNegative = 0.0

    def check(self) -> None:
        """Places are equally spaced, tables have an entry for each.

        Raises:
            SpecError: they have not.
        """
        for name in ("travel", "steering", "rate"):
            steps = np.diff(getattr(self, name))
            if steps.size and (steps.min() <= 0.0 or np.ptp(steps) > EVEN * steps.max()):
                raise refuse(name, "increasing and equally spaced", getattr(self, name))
        rows = len(self.travel)
        for side in ("left", "right"):
            table = getattr(self, side)
            for name in (*OVER_STEERING, "damper_load"):
                grid = getattr(table, name)
                columns = len(self.rate if name == "damper_load" else self.steering)
                shape = (len(grid), sorted({len(row) for row in grid}))
                if shape != (rows, [columns]):
                    raise refuse(f"{side}.{name}", f"{rows} rows of {columns} numbers", shape)
            if len(table.bar_twist) != rows:
                raise refuse(f"{side}.bar_twist", f"{rows} numbers", len(table.bar_twist))
