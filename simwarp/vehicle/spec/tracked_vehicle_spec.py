"""Specification of a tracked vehicle: a chassis between two tracks, shoe by shoe or by belt, and what drives them."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, TypeAlias

from simwarp.core.constraints import Positive, Tagged
from simwarp.core.object_repr import Readable, Row
from simwarp.vehicle.spec.belt_parts import BeltTrack, belt_of
from simwarp.vehicle.spec.drivetrain_parts import Engine, Transmission, check_powertrain
from simwarp.vehicle.spec.parts import Spec, refuse
from simwarp.vehicle.spec.track_parts import ShoeTrack, TrackDriveline
from simwarp.vehicle.spec.vehicle_parts import Chassis
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

Track: TypeAlias = Annotated[ShoeTrack | BeltTrack, Tagged("track")]


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class TrackedVehicleSpec(Readable, Spec):
    """A whole tracked vehicle. Its frame of reference is that of the left track, in the vehicle's middle."""

    name: str
    chassis: Chassis
    left: Track
    right: Track
    """Described as a left one."""
    track_offset: Positive
    """Of the middle of each track from the vehicle's middle [m]."""
    driveline: TrackDriveline | None = None
    engine: Engine | None = None
    transmission: Transmission | None = None
    start_height: float = 1.0
    """Of the frame of reference above the ground at the start [m]."""

    def check(self) -> None:
        """Two tracks of one kind; an engine with a transmission, and a driveline behind them.

        Raises:
            SpecError: they are not; says which part breaks which rule.
        """
        if self.left.track != self.right.track:
            raise refuse("right.track", f"'{self.left.track}' as that of the left one", self.right.track)
        check_powertrain(self.engine, self.transmission, self.driveline)

    @property
    def has_gears(self) -> bool:
        """A driver chooses among gears, reverse at least."""
        return self.transmission is not None

    @property
    def on_belts(self) -> bool:
        """Its tracks are belts."""
        return isinstance(self.left, BeltTrack)

    def _readable_title(self) -> str:
        return f" '{self.name}': {self.left.shoes} and {self.right.shoes} shoes{', as belts' if self.on_belts else ''}"

    def _readable_rows(self) -> dict[str, Row]:
        """The templates of its parts."""
        parts = {"driveline": self.driveline, "engine": self.engine, "transmission": self.transmission}
        return {
            "shoes": self.left.shoe.template,
            "sprockets": self.left.sprocket.template,
            **{name: part.template for name, part in parts.items() if part is not None},
        }


def with_belts(spec: TrackedVehicleSpec, **values: Any) -> TrackedVehicleSpec:
    """The vehicle with belts in the place of its chains.

    Args:
        spec: shoe by shoe, or on belts already, which are made anew.
        values: fields of `BeltLaw` other than its defaults.

    Raises:
        SpecError: a value breaks a rule, or its shoes have two pins.
    """
    return dataclasses.replace(spec, left=belt_of(spec.left, **values), right=belt_of(spec.right, **values))


AnyVehicleSpec: TypeAlias = VehicleSpec | TrackedVehicleSpec
"""Of a vehicle on wheels or tracks."""
