"""Specification of a wheeled vehicle: typed, validated descriptions, one dataclass per template.

Units are SI. Points and centres of mass of a suspension are those of its LEFT side, in the frame of the axle, which is
parallel to the chassis frame (X forward, Y left, Z up); the right side mirrors y. Moments and products of inertia are
about the centre of mass: in axes of the vehicle, or in those of the arm (x from its back to its front pivot, z normal
to its plane) where `inertia_axes` says "arm".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Final

from simwarp.core.constraints import MinLen
from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.vehicle.spec.beam_axle_parts import AxleRod, BeamAxle, BellCrank, TriangularArm
from simwarp.vehicle.spec.drivetrain_parts import (
    AutomaticCVT,
    AutomaticMap,
    AutomaticShafts,
    DifferentialDrive,
    Driveline,
    Engine,
    EngineMap,
    EngineShafts,
    EngineSimple,
    ManualShafts,
    MultiAxleDriveline,
    PitmanArm,
    RackPinion,
    RotaryArm,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
    Steering,
    Transmission,
    check_powertrain,
)
from simwarp.vehicle.spec.maneuver_defaults import NONE_GIVEN, ManeuverDefaults
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
    check_map,
    refuse,
)
from simwarp.vehicle.spec.plausibility import check_vehicle
from simwarp.vehicle.spec.reach import check_reach
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
    ThreeLink,
    TrailingArm,
)
from simwarp.vehicle.spec.tabulated_suspension import REDUCED, TabulatedSuspension
from simwarp.vehicle.spec.trailer_parts import Hitch, Trailer, Unit, moved_axle, units_of
from simwarp.vehicle.spec.vehicle_parts import Axle, Brake, Chassis, SteeringMount, Tire, Wheel

__all__ = [
    "BUMP_STOP",
    "ZERO",
    "AntirollBar",
    "AutomaticCVT",
    "AutomaticMap",
    "AutomaticShafts",
    "Axle",
    "AxleRod",
    "BeamAxle",
    "BellCrank",
    "Brake",
    "Bushing",
    "Chassis",
    "DamperMap",
    "DifferentialDrive",
    "DoubleWishbone",
    "DoubleWishboneReduced",
    "Driveline",
    "Engine",
    "EngineMap",
    "EngineShafts",
    "EngineSimple",
    "ForceLine",
    "Hitch",
    "MacPhersonStrut",
    "ManeuverDefaults",
    "ManualShafts",
    "MultiAxleDriveline",
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
    "TabulatedSuspension",
    "ThreeLink",
    "Tire",
    "Trailer",
    "TrailingArm",
    "Transmission",
    "TriangularArm",
    "Unit",
    "Vec3",
    "VehicleSpec",
    "Wheel",
    "check_map",
    "refuse",
]

FULL_TRAIN: Final = "a reduced vehicle tows none: take the full vehicle"


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class VehicleSpec(Readable, Spec):
    """A whole wheeled vehicle. Axles from front to rear."""

    name: str
    chassis: Chassis
    axles: Annotated[tuple[Axle, ...], MinLen(1)]
    steerings: tuple[SteeringMount, ...] = ()
    driveline: Driveline | None = None
    engine: Engine | None = None
    transmission: Transmission | None = None
    wheelbase: float | None = None
    """Declared distance of the first and the last axle [m]: checked against their frames and their wheels."""
    start_height: float = 0.5
    """Of the frame of reference above the ground at the start [m]."""
    maneuver_defaults: ManeuverDefaults = NONE_GIVEN
    """Speeds and radii of tests that suit it, where nothing else is asked for."""
    trailers: tuple[Trailer, ...] = ()
    """Each is held by the vehicle or by the trailer before it."""

    @property
    def units(self) -> tuple[Unit, ...]:
        """The vehicle without its trailers, then these."""
        return units_of(self.chassis, self.axles, self.trailers)

    @property
    def all_axles(self) -> tuple[Axle, ...]:
        """Axles of the vehicle, then of its trailers, which are placed in the vehicle's frame of reference as built."""
        behind = (moved_axle(axle, unit.origin) for unit in self.units[1:] for axle in unit.axles)
        return (*self.axles, *behind) if self.trailers else self.axles

    def with_axles(self, axles: Sequence[Axle]) -> VehicleSpec:
        """The vehicle with other parts at all of its axles, which stay in their places.

        Args:
            axles: as many as `all_axles` has, in that order.

        Raises:
            SpecError: they do not fit.
        """
        left = iter(axles)
        own = tuple(next(left) for _ in self.axles)
        trailers = []
        for trailer in self.trailers:
            changed = tuple(
                dataclasses.replace(next(left), location=axle.location, antiroll_bar=axle.antiroll_bar)
                for axle in trailer.axles
            )
            trailers.append(dataclasses.replace(trailer, axles=changed))
        return dataclasses.replace(self, axles=own, trailers=tuple(trailers))

    @property
    def full_name(self) -> str:
        """The name, of a reduced vehicle that of the full one."""
        return self.name.removesuffix(REDUCED)

    def require_linkages(self, what: str) -> None:
        """Refuses a reduced vehicle where its suspensions, steering or shafts are asked for.

        Raises:
            SpecError: it is one.
        """
        if self.is_reduced:
            raise SpecError(f"'{self.name}' is reduced to tables, and {what} needs linkages; take the full vehicle")

    def check(self) -> None:
        """Checks that axles, what steers and drives them, and the declared wheelbase fit together.

        Raises:
            SpecError: they do not; says which part breaks which rule.
        """
        check_powertrain(self.engine, self.transmission, self.driveline)
        if isinstance(self.driveline, DifferentialDrive):
            self._check_differential_drive(self.driveline)
        check_vehicle(self)
        for unit in self.units:
            check_reach(unit.axles, unit.key)
        self._check_wheelbase()
        self._check_tables()

    @property
    def is_reduced(self) -> bool:
        """Whether its suspensions are tables (`simwarp.vehicle.reduced`)."""
        return all(isinstance(axle.suspension, TabulatedSuspension) for axle in self.axles)

    @property
    def has_gears(self) -> bool:
        """Whether a driver chooses among reverse, neutral and forward."""
        return self.transmission is not None or isinstance(self.driveline, DifferentialDrive)

    def _readable_title(self) -> str:
        behind = f", {plural(len(self.trailers), 'trailer')}" if self.trailers else ""
        return f" '{self.name}': {plural(len(self.all_axles), 'axle')}{behind}"

    def _readable_rows(self) -> dict[str, Row]:
        """The templates of its parts."""
        axles, mounts = self.all_axles, self.steerings
        parts = {"driveline": self.driveline, "engine": self.engine, "transmission": self.transmission}
        return {
            "suspensions": Names(len(axles), (axle.suspension.template for axle in axles)),
            "tires": Names(len(axles), (axle.tire.template for axle in axles)),
            "steerings": Names(len(mounts), (mount.steering.template for mount in mounts)),
            **{name: part.template for name, part in parts.items() if part is not None},
        }

    def _check_differential_drive(self, driveline: DifferentialDrive) -> None:
        for key in ("engine", "transmission", "steerings"):
            if getattr(self, key):
                rule = f"left out beside the driveline '{driveline.template}', whose motors drive and steer"
                raise SpecError(f"{key}: must be {rule}; leave it out, or take another driveline")
        radii = sorted({axle.tire.radius for axle in self.axles})
        if radii[-1] > 1.02 * radii[0]:
            rule = f"given tires of one radius within 2 % beside '{driveline.template}', which turns them alike"
            raise refuse("axles", rule, radii)

    def _check_tables(self) -> None:
        tables = [isinstance(axle.suspension, TabulatedSuspension) for axle in self.axles]
        if not any(tables):
            return
        if not all(tables) or len(tables) != 2:
            found = ", ".join(axle.suspension.template for axle in self.axles)
            raise SpecError(f"axles: must be two of tables or none, got {found}; tables are those of a whole vehicle")
        if isinstance(self.driveline, (DifferentialDrive, MultiAxleDriveline)):
            raise refuse("driveline", "one of an engine and up to two axles beside tables", self.driveline.template)
        if self.trailers:
            raise SpecError(f"trailers: must be left out beside tables, got {len(self.trailers)}; {FULL_TRAIN}")

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
