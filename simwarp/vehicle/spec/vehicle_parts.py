"""The parts that a vehicle is put together of: chassis, wheels, brakes, tires, axles, mounts of steerings."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np

from simwarp.core.constraints import Inertia, MinLen, NotNegative, Point, Positive
from simwarp.vehicle.spec.drivetrain_parts import Steering
from simwarp.vehicle.spec.parts import ZERO, RigidPart, Spec, SpecError, merged
from simwarp.vehicle.spec.suspension_parts import AntirollBar, Suspension

INERTIA_SLACK = 1.01
"""Published tables are rounded."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Chassis(Spec):
    """The sprung body; further components are merged into one body.

    `com` of a component is in the vehicle's frame of reference. Drag: 0.5 · density · area · coefficient · v².
    """

    components: Annotated[tuple[RigidPart, ...], MinLen(1)]
    drag_coefficient: NotNegative = 0.0
    drag_area: NotNegative = 0.0
    air_density: NotNegative = 1.2
    size: tuple[Positive, Positive, Positive] = (3.0, 2.0, 0.2)
    """Of the box that stands for the body in contact and pictures [m]."""
    size_center: Point = ZERO

    @property
    def drag_factor(self) -> float:
        """Drag over the square of the speed [kg/m]."""
        return 0.5 * self.air_density * self.drag_coefficient * self.drag_area

    def check(self) -> None:
        """The components' inertia is that of a body."""
        _, _, inertia = merged(self.components)
        least, middle, largest = np.linalg.eigvalsh(inertia).tolist()
        if largest > INERTIA_SLACK * (least + middle):
            key = "components[0].inertia" if len(self.components) == 1 else "components"
            rule = "the inertia of a body: no principal moment above the sum of the others"
            found = f"{least:.4g}, {middle:.4g} and {largest:.4g} kg·m²"
            raise SpecError(f"{key}: must be {rule}, got {found}; check units and the order Ixx, Iyy, Izz")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Wheel(Spec):
    """Rim: mass [kg] and inertia [kg·m²] added to the spindle's; y is the axis of rotation."""

    mass: Positive
    inertia: Inertia
    offset: float = 0.0
    """Of the wheel's middle plane from the spindle's centre, outwards [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Brake(Spec):
    """Friction torque up to braking x max_torque [N·m]."""

    max_torque: NotNegative


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tire(Spec):
    """A tire: mass and inertia added to the spindle's, and the model with its parameters by name.

    `parameters` are those of the model (docs/vehicles.md): each model checks its own.
    """

    template: str
    mass: Positive
    inertia: Inertia
    radius: Positive
    """Unloaded [m]."""
    width: Positive
    parameters: dict[str, object] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axle(Spec):
    """One axle: its suspension at `location` in the vehicle's frame, wheels, brakes, and what steers it."""

    location: Point
    suspension: Suspension
    wheel: Wheel
    tire: Tire
    brake: Brake | None = None
    steering: int | None = None
    """Index of the vehicle's steering that holds the tie rods; None: the chassis."""
    antiroll_bar: AntirollBar | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteeringMount(Spec):
    """A steering at a place [m] and orientation (xyzw) in the vehicle's frame."""

    steering: Steering
    location: Point
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
