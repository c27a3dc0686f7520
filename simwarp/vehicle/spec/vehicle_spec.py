"""What a wheeled vehicle is made of: typed, validated descriptions, one dataclass per template.

Units are SI. Points and centres of mass of a suspension are those of its LEFT side, in the frame of the axle, which is
parallel to the chassis frame (X forward, Y left, Z up); the right side mirrors y. Moments and products of inertia are
about the centre of mass: in axes of the vehicle, or in those of the arm (x from its back to its front pivot, z normal
to its plane) where `inertia_axes` says "arm".
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from simwarp.vehicle.spec.drivetrain_parts import (
    AutomaticCVT,
    AutomaticMap,
    AutomaticShafts,
    Driveline,
    Engine,
    EngineMap,
    EngineShafts,
    EngineSimple,
    ManualShafts,
    PitmanArm,
    RackPinion,
    RotaryArm,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
    Steering,
    Transmission,
)
from simwarp.vehicle.spec.parts import (
    BUMP_STOP,
    ZERO,
    Bushing,
    DamperMap,
    ForceLine,
    Points,
    RigidPart,
    Spec,
    SpecError,
    Vec3,
    check_curve,
    check_finite,
    check_map,
    merged,
    refuse,
)
from simwarp.vehicle.spec.plausibility import check_vehicle
from simwarp.vehicle.spec.suspension_parts import (
    AntirollBar,
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    PinnedAxle,
    RigidSuspension,
    SingleWishbone,
    SolidAxle,
    Suspension,
    TrailingArm,
)

__all__ = [
    "BUMP_STOP",
    "ZERO",
    "AntirollBar",
    "AutomaticCVT",
    "AutomaticMap",
    "AutomaticShafts",
    "Axle",
    "Brake",
    "Bushing",
    "Chassis",
    "DamperMap",
    "DoubleWishbone",
    "DoubleWishboneReduced",
    "Driveline",
    "Engine",
    "EngineMap",
    "EngineShafts",
    "EngineSimple",
    "ForceLine",
    "MacPhersonStrut",
    "ManualShafts",
    "MultiLink",
    "PinnedAxle",
    "PitmanArm",
    "Points",
    "RackPinion",
    "RigidPart",
    "RigidSuspension",
    "RotaryArm",
    "ShaftsDriveline2WD",
    "ShaftsDriveline4WD",
    "SimpleDriveline",
    "SingleWishbone",
    "SolidAxle",
    "Spec",
    "SpecError",
    "Steering",
    "SteeringMount",
    "Suspension",
    "Tire",
    "TrailingArm",
    "Transmission",
    "Vec3",
    "VehicleSpec",
    "Wheel",
    "check_curve",
    "check_finite",
    "check_map",
    "refuse",
]

INERTIA_SLACK = 1.01
"""Published tables are rounded."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Chassis(Spec):
    """The sprung body; further components are merged into one body.

    `com` of a component is in the vehicle's frame of reference. Drag: 0.5 · density · area · coefficient · v².
    """

    POSITIVE: ClassVar = frozenset({"size"})
    NOT_NEGATIVE: ClassVar = frozenset({"drag_coefficient", "drag_area", "air_density"})

    components: tuple[RigidPart, ...]
    drag_coefficient: float = 0.0
    drag_area: float = 0.0
    air_density: float = 1.2
    size: Vec3 = (3.0, 2.0, 0.2)
    """Of the box that stands for the body in contact and pictures [m]."""
    size_center: Vec3 = ZERO

    def check(self) -> None:
        """One or more components, whose inertia is that of a body."""
        if not self.components:
            raise refuse("components", "one or more rigid parts", self.components)
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

    POSITIVE: ClassVar = frozenset({"mass", "inertia"})

    mass: float
    inertia: Vec3
    offset: float = 0.0
    """Of the wheel's middle plane from the spindle's centre, outwards [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Brake(Spec):
    """Friction torque up to braking x max_torque [N·m]."""

    NOT_NEGATIVE: ClassVar = frozenset({"max_torque"})

    max_torque: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tire(Spec):
    """A tire: mass and inertia added to the spindle's, and the model with its parameters by name.

    `parameters` are those of the model (docs/vehicles.md): each model checks its own.
    """

    POSITIVE: ClassVar = frozenset({"mass", "inertia", "radius", "width"})

    template: str
    mass: float
    inertia: Vec3
    radius: float
    """Unloaded [m]."""
    width: float
    parameters: dict[str, object] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axle(Spec):
    """One axle: its suspension at `location` in the vehicle's frame, wheels, brakes, and what steers it."""

    location: Vec3
    suspension: Suspension
    wheel: Wheel
    tire: Tire
    brake: Brake | None = None
    steering: int | None = None
    """Which of the vehicle's steerings holds the tie rods; None: the chassis."""
    antiroll_bar: AntirollBar | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteeringMount(Spec):
    """A steering at a place [m] and orientation (xyzw) in the vehicle's frame."""

    steering: Steering
    location: Vec3
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class VehicleSpec(Spec):
    """A whole wheeled vehicle. Axles from front to rear."""

    name: str
    chassis: Chassis
    axles: tuple[Axle, ...]
    steerings: tuple[SteeringMount, ...] = ()
    driveline: Driveline | None = None
    engine: Engine | None = None
    transmission: Transmission | None = None
    wheelbase: float | None = None
    """Declared distance of the first and the last axle [m]: checked against their frames and their wheels."""
    start_height: float = 0.5
    """Of the frame of reference above the ground at the start [m]."""

    def check(self) -> None:
        """Axles, what steers and drives them, and the declared wheelbase fit together."""
        if not self.axles:
            raise refuse("axles", "one or more", self.axles)
        if (self.engine is None) != (self.transmission is None):
            key, rule = "transmission", "an engine"
            if self.transmission is None:
                key, rule = "engine", "a transmission"
            raise SpecError(f"{key}: must be given together with {rule}; add one, or leave out {key}")
        if self.engine is not None and self.driveline is None:
            raise refuse("driveline", "given for an engine to drive", None)
        check_vehicle(self)
        self._check_wheelbase()

    def _check_wheelbase(self) -> None:
        if self.wheelbase is None:
            return
        if len(self.axles) == 1:
            raise refuse("wheelbase", "left out of a vehicle with one axle", self.wheelbase)
        first, last = self.axles[0], self.axles[-1]
        frames = first.location[0] - last.location[0]
        wheels = frames + first.suspension.spindle.com[0] - last.suspension.spindle.com[0]
        if all(abs(found - self.wheelbase) > 0.02 * self.wheelbase for found in (frames, wheels)):
            rule = f"that of the axles within 2 %, {frames:.4g} m (their frames) or {wheels:.4g} m (their wheels)"
            raise refuse("wheelbase", rule, self.wheelbase)
