"""Descriptions of steerings, drivelines, engines and transmissions, one dataclass per template."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Literal, TypeAlias

from simwarp.core.constraints import (
    Angle,
    Curve,
    Direction,
    Fraction,
    MinLen,
    NotNegative,
    Point,
    Positive,
    Tagged,
)
from simwarp.vehicle.spec.parts import RigidPart, Spec, SpecError, check_apart, refuse


@dataclasses.dataclass(frozen=True, kw_only=True)
class PitmanArm(Spec):
    """Pitman arm on the left, massless idler on the right, steering link between. Points in the steering's frame."""

    template: Literal["pitman-arm"] = "pitman-arm"
    max_angle: Annotated[Positive, Angle(0.5 * math.pi)]
    """Of the arm at full steering [rad]."""
    link: RigidPart
    arm: RigidPart
    arm_chassis: Point
    arm_axis: Direction = (0.0, 0.0, 1.0)
    arm_link: Point
    universal_axis_arm: Direction = (0.0, 0.0, 1.0)
    universal_axis_link: Direction = (1.0, 0.0, 0.0)
    idler_chassis: Point
    idler_axis: Direction = (0.0, 0.0, 1.0)
    idler_link: Point

    def check(self) -> None:
        """Arm and idler have a length."""
        check_apart(self, ("arm_link", "arm_chassis"), ("idler_link", "idler_chassis"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RackPinion(Spec):
    """A rack that slides along Y by pinion_radius x max_angle x steering."""

    template: Literal["rack-pinion"] = "rack-pinion"
    max_angle: Annotated[Positive, Angle(4.0 * math.pi)]
    """Of the pinion at full steering [rad]; it may turn more than once."""
    pinion_radius: Positive
    link: RigidPart
    """Its centre of mass lies on the rack's axis."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RotaryArm(Spec):
    """An arm that turns about its axis by max_angle x steering; tie rods hang on it."""

    template: Literal["rotary-arm"] = "rotary-arm"
    max_angle: Annotated[Positive, Angle(0.5 * math.pi)]
    arm: RigidPart
    arm_chassis: Point
    arm_axis: Direction = (0.0, 0.0, 1.0)


Steering: TypeAlias = Annotated[PitmanArm | RackPinion | RotaryArm, Tagged("template")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShaftsDriveline2WD(Spec):
    """Drive shaft, bevel gear, differential with a locking clutch."""

    template: Literal["shafts-2wd"] = "shafts-2wd"
    axle: int = -1
    """Driven axle; -1 is the last."""
    driveshaft_inertia: Positive
    box_inertia: Positive
    gear_ratio: Positive
    """Box speed per drive shaft speed."""
    locking_limit: NotNegative = 0.0
    """Largest torque of the locked clutch [N·m]."""
    lockable: bool = False
    """If true, a clutch is built that `Vehicle.lock` can close."""
    slip_torque: NotNegative = 0.0
    """Torque that a limited-slip differential always holds between its wheels [N·m]."""
    reaction: float = 0.0
    """Torque on the chassis about x per torque of the drive shaft; 0 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShaftsDriveline4WD(Spec):
    """Central differential to two shafts, bevel gears and axle differentials with locking clutches."""

    template: Literal["shafts-4wd"] = "shafts-4wd"
    axles: tuple[int, int] = (0, 1)
    driveshaft_inertia: Positive
    front_shaft_inertia: Positive
    rear_shaft_inertia: Positive
    front_box_inertia: Positive
    rear_box_inertia: Positive
    front_gear_ratio: Positive
    rear_gear_ratio: Positive
    axle_locking_limit: NotNegative = 0.0
    central_locking_limit: NotNegative = 0.0
    lockable: bool = False
    """If true, clutches are built that `Vehicle.lock` can close."""
    axle_slip_torque: NotNegative = 0.0
    """Torque that limited-slip differentials of the axles always hold between their wheels [N·m]."""
    central_slip_torque: NotNegative = 0.0
    """The same of the central one, between the front and the rear shaft."""
    reaction: float = 0.0
    """Torque on the chassis about x per torque of the drive shaft; 0 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimpleDriveline(Spec):
    """Splits the torque by a fixed fraction and biasing differentials, without shafts of its own."""

    template: Literal["simple"] = "simple"
    axles: tuple[int, int] = (0, 1)
    front_torque_fraction: Fraction
    front_gear_ratio: Positive
    rear_gear_ratio: Positive
    front_max_bias: Positive = 1.0
    rear_max_bias: Positive = 1.0
    reaction: float = 1.0
    """Share of the wheels' driving torque that acts back on the chassis; 1 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MultiAxleDriveline(Spec):
    """Splits the torque equally among any number of axles with biasing differentials, without shafts of its own."""

    template: Literal["simple-multi-axle"] = "simple-multi-axle"
    axles: Annotated[tuple[int, ...], MinLen(1)]
    gear_ratio: Positive = 1.0
    """Wheel speed per drive shaft speed."""
    max_bias: Positive = 1.0
    """Of the differentials between the wheels of an axle."""
    reaction: float = 1.0
    """Share of the wheels' driving torque that acts back on the chassis; 1 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DifferentialDrive(Spec):
    """An electric motor on each side turns all wheels of that side; different speeds steer. There is neither engine,
    transmission nor steering.

    A direct-current motor whose torque falls from `stall_torque` at rest to nothing at `no_load_speed`, and a
    controller that holds the speed asked for with what the motor can give (docs/vehicles.md).
    """

    template: Literal["differential-drive"] = "differential-drive"
    motor_inertia: Positive
    """Of a motor's rotor [kg·m²]."""
    stall_torque: Positive
    """Of a motor [N·m]."""
    no_load_speed: Positive
    """Of a motor that nothing resists, at full voltage [rad/s]."""
    gear_ratio: Positive
    """Wheel speed per motor speed."""
    max_speed: Positive
    """Of a motor at full throttle, or at full steering on the spot [rad/s]."""
    gain: Positive | None = None
    """Torque of the voltage per error of the speed [N·m·s/rad]; None: the speed is held exactly as long as the torque
    does.
    """

    def check(self) -> None:
        """A speed that the motor can reach."""
        if self.max_speed > self.no_load_speed:
            raise refuse("max_speed", f"at most no_load_speed, {self.no_load_speed:g} rad/s", self.max_speed)


Driveline: TypeAlias = Annotated[
    ShaftsDriveline2WD | ShaftsDriveline4WD | SimpleDriveline | MultiAxleDriveline | DifferentialDrive,
    Tagged("template"),
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineSimple(Spec):
    """Constant torque up to constant power up to the largest speed [N·m, W, rad/s]."""

    template: Literal["simple"] = "simple"
    max_torque: Positive
    max_power: Positive
    max_speed: Positive


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineMap(Spec):
    """Torque [N·m] over speed [rad/s] at full and at zero throttle, mixed by the throttle."""

    template: Literal["map"] = "map"
    max_speed: Positive
    full_throttle: Curve
    zero_throttle: Curve


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineShafts(Spec):
    """Torque x throttle + losses [N·m] over speed [rad/s], on the shaft of the transmission."""

    template: Literal["shafts"] = "shafts"
    inertia: Positive
    """Crankshaft and flywheel [kg·m²]; see `Vehicle` for when it acts."""
    torque: Curve
    losses: Curve


Engine: TypeAlias = Annotated[EngineSimple | EngineMap | EngineShafts, Tagged("template")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AutomaticMap(Spec):
    """Gear ratios (drive shaft per engine speed) with the engine speeds at which it shifts down and up [rad/s]."""

    template: Literal["automatic-map"] = "automatic-map"
    forward_ratios: Annotated[tuple[Positive, ...], MinLen(1)]
    reverse_ratio: float
    shift_points: tuple[tuple[float, float], ...]
    """(down, up) for every forward gear."""

    def check(self) -> None:
        """Shift points for every gear."""
        if len(self.shift_points) != len(self.forward_ratios):
            raise refuse("shift_points", f"one pair for each of {len(self.forward_ratios)} gears", self.shift_points)


@dataclasses.dataclass(frozen=True, kw_only=True)
class AutomaticShafts(Spec):
    """Torque converter and gear box on shafts."""

    template: Literal["automatic-shafts"] = "automatic-shafts"
    motorshaft_inertia: Positive
    input_inertia: Positive
    """Between converter and gears [kg·m²]."""
    driveshaft_inertia: Positive
    capacity_factor: Curve
    """K over the speed ratio: the impeller takes (speed / K)² [N·m]."""
    torque_ratio: Curve
    forward_ratios: Annotated[tuple[Positive, ...], MinLen(1)]
    reverse_ratio: float
    upshift_speed: Positive
    """Of the shaft between converter and gears [rad/s]."""
    downshift_speed: Positive
    shift_latency: NotNegative = 0.5
    """Least time between two shifts [s]."""
    reaction: float = 0.0
    """Torque on the chassis about x per torque of the drive shaft; 0 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ManualShafts(Spec):
    """A clutch with a torque limit, and gears that the driver chooses."""

    template: Literal["manual-shafts"] = "manual-shafts"
    motorshaft_inertia: Positive
    input_inertia: Positive
    driveshaft_inertia: Positive
    clutch_limit: Positive
    forward_ratios: Annotated[tuple[Positive, ...], MinLen(1)]
    reverse_ratio: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class AutomaticCVT(Spec):
    """A ratio that moves linearly with the drive shaft's speed [rad/s]."""

    template: Literal["cvt"] = "cvt"
    min_ratio: Positive
    max_ratio: Positive
    speed_begin: Positive
    speed_end: Positive
    efficiency: Positive = 1.0


Transmission: TypeAlias = Annotated[AutomaticMap | AutomaticShafts | ManualShafts | AutomaticCVT, Tagged("template")]


def check_powertrain(engine: Engine | None, transmission: Transmission | None, driveline: object | None) -> None:
    """Checks that an engine has a transmission and a driveline, and a transmission an engine.

    Raises:
        SpecError: it has not; says which part is missing.
    """
    if (engine is None) != (transmission is None):
        key, rule = "transmission", "an engine"
        if transmission is None:
            key, rule = "engine", "a transmission"
        raise SpecError(f"{key}: must be given together with {rule}; add one, or leave out {key}")
    if engine is not None and driveline is None:
        raise refuse("driveline", "given for an engine to drive", None)
