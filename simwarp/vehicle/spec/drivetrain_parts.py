"""Descriptions of steerings, drivelines, engines and transmissions, one dataclass per template."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar, Literal, TypeAlias

from simwarp.vehicle.spec.parts import Points, RigidPart, Spec, Vec3, check_apart, check_direction, refuse


@dataclasses.dataclass(frozen=True, kw_only=True)
class PitmanArm(Spec):
    """Pitman arm on the left, massless idler on the right, steering link between. Points in the steering's frame."""

    POSITIVE: ClassVar = frozenset({"max_angle"})

    template: Literal["pitman-arm"] = "pitman-arm"
    max_angle: float
    """Of the arm at full steering [rad]."""
    link: RigidPart
    arm: RigidPart
    arm_chassis: Vec3
    arm_axis: Vec3 = (0.0, 0.0, 1.0)
    arm_link: Vec3
    universal_axis_arm: Vec3 = (0.0, 0.0, 1.0)
    universal_axis_link: Vec3 = (1.0, 0.0, 0.0)
    idler_chassis: Vec3
    idler_axis: Vec3 = (0.0, 0.0, 1.0)
    idler_link: Vec3

    def check(self) -> None:
        """Arm and idler have a length, axes a direction."""
        check_direction(self, "arm_axis", "universal_axis_arm", "universal_axis_link", "idler_axis")
        check_apart(self, ("arm_link", "arm_chassis"), ("idler_link", "idler_chassis"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RackPinion(Spec):
    """A rack that slides along Y by pinion_radius x max_angle x steering."""

    POSITIVE: ClassVar = frozenset({"max_angle", "pinion_radius"})
    ANGLES: ClassVar = {"max_angle": 4.0 * math.pi}  # a pinion may turn more than once

    template: Literal["rack-pinion"] = "rack-pinion"
    max_angle: float
    pinion_radius: float
    link: RigidPart
    """Its centre of mass lies on the rack's axis."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RotaryArm(Spec):
    """An arm that turns about its axis by max_angle x steering; tie rods hang on it."""

    POSITIVE: ClassVar = frozenset({"max_angle"})

    template: Literal["rotary-arm"] = "rotary-arm"
    max_angle: float
    arm: RigidPart
    arm_chassis: Vec3
    arm_axis: Vec3 = (0.0, 0.0, 1.0)

    def check(self) -> None:
        """The axis has a direction."""
        check_direction(self, "arm_axis")


Steering: TypeAlias = PitmanArm | RackPinion | RotaryArm


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShaftsDriveline2WD(Spec):
    """Drive shaft, bevel gear, differential with a locking clutch."""

    POSITIVE: ClassVar = frozenset({"driveshaft_inertia", "box_inertia", "gear_ratio"})
    NOT_NEGATIVE: ClassVar = frozenset({"locking_limit", "slip_torque"})

    template: Literal["shafts-2wd"] = "shafts-2wd"
    axle: int = -1
    """Driven axle; -1 is the last."""
    driveshaft_inertia: float
    box_inertia: float
    gear_ratio: float
    """Box speed per drive shaft speed."""
    locking_limit: float = 0.0
    """Largest torque of the locked clutch [N·m]."""
    lockable: bool = False
    """If true, a clutch is built that `Vehicle.lock` can close."""
    slip_torque: float = 0.0
    """Torque that a limited-slip differential always holds between its wheels [N·m]."""
    reaction: float = 0.0
    """Torque on the chassis about x per torque of the drive shaft; 0 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShaftsDriveline4WD(Spec):
    """Central differential to two shafts, bevel gears and axle differentials with locking clutches."""

    POSITIVE: ClassVar = frozenset(
        {
            "driveshaft_inertia", "front_shaft_inertia", "rear_shaft_inertia", "front_box_inertia",
            "rear_box_inertia", "front_gear_ratio", "rear_gear_ratio",
        }
    )  # fmt: skip
    NOT_NEGATIVE: ClassVar = frozenset(
        {"axle_locking_limit", "central_locking_limit", "axle_slip_torque", "central_slip_torque"}
    )

    template: Literal["shafts-4wd"] = "shafts-4wd"
    axles: tuple[int, int] = (0, 1)
    driveshaft_inertia: float
    front_shaft_inertia: float
    rear_shaft_inertia: float
    front_box_inertia: float
    rear_box_inertia: float
    front_gear_ratio: float
    rear_gear_ratio: float
    axle_locking_limit: float = 0.0
    central_locking_limit: float = 0.0
    lockable: bool = False
    """If true, clutches are built that `Vehicle.lock` can close."""
    axle_slip_torque: float = 0.0
    """Torque that limited-slip differentials of the axles always hold between their wheels [N·m]."""
    central_slip_torque: float = 0.0
    """The same of the central one, between the front and the rear shaft."""
    reaction: float = 0.0
    """Torque on the chassis about x per torque of the drive shaft; 0 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimpleDriveline(Spec):
    """Splits the torque by a fixed fraction and biasing differentials, without shafts of its own."""

    POSITIVE: ClassVar = frozenset({"front_gear_ratio", "rear_gear_ratio", "front_max_bias", "rear_max_bias"})

    template: Literal["simple"] = "simple"
    axles: tuple[int, int] = (0, 1)
    front_torque_fraction: float
    front_gear_ratio: float
    rear_gear_ratio: float
    front_max_bias: float = 1.0
    rear_max_bias: float = 1.0
    reaction: float = 1.0
    """Share of the wheels' driving torque that acts back on the chassis; 1 closes the balance (docs/vehicles.md)."""

    def check(self) -> None:
        """A fraction is one."""
        if not 0.0 <= self.front_torque_fraction <= 1.0:
            raise refuse("front_torque_fraction", "between 0 and 1", self.front_torque_fraction)


Driveline: TypeAlias = ShaftsDriveline2WD | ShaftsDriveline4WD | SimpleDriveline


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineSimple(Spec):
    """Constant torque up to constant power up to the largest speed [N·m, W, rad/s]."""

    POSITIVE: ClassVar = frozenset({"max_torque", "max_power", "max_speed"})

    template: Literal["simple"] = "simple"
    max_torque: float
    max_power: float
    max_speed: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineMap(Spec):
    """Torque [N·m] over speed [rad/s] at full and at zero throttle, mixed by the throttle."""

    POSITIVE: ClassVar = frozenset({"max_speed"})
    CURVES: ClassVar = frozenset({"full_throttle", "zero_throttle"})

    template: Literal["map"] = "map"
    max_speed: float
    full_throttle: Points
    zero_throttle: Points


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineShafts(Spec):
    """Torque x throttle + losses [N·m] over speed [rad/s], on the shaft of the transmission."""

    POSITIVE: ClassVar = frozenset({"inertia"})
    CURVES: ClassVar = frozenset({"torque", "losses"})

    template: Literal["shafts"] = "shafts"
    inertia: float
    """Crankshaft and flywheel [kg·m²]; see `Vehicle` for when it acts."""
    torque: Points
    losses: Points


Engine: TypeAlias = EngineSimple | EngineMap | EngineShafts


@dataclasses.dataclass(frozen=True, kw_only=True)
class AutomaticMap(Spec):
    """Gear ratios (drive shaft per engine speed) with the engine speeds at which it shifts down and up [rad/s]."""

    POSITIVE: ClassVar = frozenset({"forward_ratios"})

    template: Literal["automatic-map"] = "automatic-map"
    forward_ratios: tuple[float, ...]
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

    POSITIVE: ClassVar = frozenset(
        {
            "motorshaft_inertia", "driveshaft_inertia", "input_inertia", "forward_ratios", "upshift_speed",
            "downshift_speed",
        }
    )  # fmt: skip
    NOT_NEGATIVE: ClassVar = frozenset({"shift_latency"})
    CURVES: ClassVar = frozenset({"capacity_factor", "torque_ratio"})

    template: Literal["automatic-shafts"] = "automatic-shafts"
    motorshaft_inertia: float
    input_inertia: float
    """Between converter and gears [kg·m²]."""
    driveshaft_inertia: float
    capacity_factor: Points
    """K over the speed ratio: the impeller takes (speed / K)² [N·m]."""
    torque_ratio: Points
    forward_ratios: tuple[float, ...]
    reverse_ratio: float
    upshift_speed: float
    """Of the shaft between converter and gears [rad/s]."""
    downshift_speed: float
    shift_latency: float = 0.5
    """Least time between two shifts [s]."""
    reaction: float = 0.0
    """Torque on the chassis about x per torque of the drive shaft; 0 closes the balance (docs/vehicles.md)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ManualShafts(Spec):
    """A clutch with a torque limit, and gears that the driver chooses."""

    POSITIVE: ClassVar = frozenset(
        {"motorshaft_inertia", "driveshaft_inertia", "input_inertia", "forward_ratios", "clutch_limit"}
    )

    template: Literal["manual-shafts"] = "manual-shafts"
    motorshaft_inertia: float
    input_inertia: float
    driveshaft_inertia: float
    clutch_limit: float
    forward_ratios: tuple[float, ...]
    reverse_ratio: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class AutomaticCVT(Spec):
    """A ratio that moves linearly with the drive shaft's speed [rad/s]."""

    POSITIVE: ClassVar = frozenset({"min_ratio", "max_ratio", "speed_begin", "speed_end", "efficiency"})

    template: Literal["cvt"] = "cvt"
    min_ratio: float
    max_ratio: float
    speed_begin: float
    speed_end: float
    efficiency: float = 1.0


Transmission: TypeAlias = AutomaticMap | AutomaticShafts | ManualShafts | AutomaticCVT
