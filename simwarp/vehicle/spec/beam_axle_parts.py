"""Description of a beam axle: a tube led by rods, a triangular arm or leaf springs, with knuckles or without."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Literal, TypeAlias

from simwarp.core.constraints import COINCIDENT, Angle, Direction, NotNegative, Point, Positive
from simwarp.vehicle.spec.parts import ForceLine, RigidPart, Spec, SpecError, check_apart, refuse

Lean: TypeAlias = Annotated[float, Angle(0.25 * math.pi)]
"""Camber or toe [rad]."""

LED_BY_LINKS = 4
"""Rods and arms' rows that leave a tube its heave and its roll."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AxleRod(Spec):
    """A massless rod between two balls, one on the chassis and one on the tube."""

    chassis_point: Point
    axle_point: Point
    mirrored: bool = True
    """Whether there is one on each side; a Panhard rod is one, as it lies."""

    def check(self) -> None:
        """It has a length."""
        check_apart(self, ("chassis_point", "axle_point"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class TriangularArm(Spec):
    """A massless arm in the middle plane, hinged on the chassis about y, with a ball on the tube."""

    chassis_point: Point
    axle_point: Point

    def check(self) -> None:
        """It has a length, and lies in the plane across its hinge."""
        check_apart(self, ("chassis_point", "axle_point"))
        if self.chassis_point[1] != self.axle_point[1]:
            raise refuse("axle_point", f"at the y of chassis_point, {self.chassis_point[1]:g} m", self.axle_point)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BellCrank(Spec):
    """A lever that turns on the tube: a drag link moves it, and it moves the tie rods."""

    part: RigidPart
    pivot: Point
    axis: Direction = (0.0, 0.0, 1.0)
    draglink: Point
    tierod: Point
    """Ball of the left knuckle's tie rod."""

    def check(self) -> None:
        """Both of its arms have a length."""
        check_apart(self, ("pivot", "draglink"), ("pivot", "tierod"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeamAxle(Spec):
    """A tube between two wheels, with springs to the chassis; `axle_tube` and a bell crank are not mirrored.

    What leads it: four rods, two rods and a triangular arm, a ball on the chassis with a rod or a Watt linkage, or with
    `guide` "leaf-springs" the springs themselves, which let it rise and roll; "plane" lets it move sideways too, which
    a Panhard rod then takes. Rods have no mass: their masses are those of what they hang on.

    A drag link moves a knuckle, the left one where its ball is on the left, or a bell crank. A tie rod joins both
    knuckles; with `crossed_tierods` there is none, and the bell crank has a rod to each. With `tierod_chassis` there is
    no drag link: each knuckle has a rod to the steering. Without `knuckle` the wheels turn in the tube.
    """

    template: Literal["beam-axle"] = "beam-axle"
    camber: Lean = 0.0
    """[rad], as built."""
    toe: Lean = 0.0
    spindle: RigidPart
    axle_tube: RigidPart
    axle_inertia: Positive
    springs: tuple[ForceLine, ...]
    """Between chassis and tube."""
    guide: Literal["links", "leaf-springs", "plane"] = "links"
    rods: tuple[AxleRod, ...] = ()
    arm: TriangularArm | None = None
    ball: Point | None = None
    """Of a tube that ends in a ball on the chassis: a push pipe."""
    watt: Point | None = None
    """Middle of a Watt linkage, which keeps this point of the tube at its place across the chassis."""
    roll_stiffness: NotNegative = 0.0
    """Of an anti-roll bar between chassis and tube [N·m/rad]; with a guide."""
    roll_damping: NotNegative = 0.0
    knuckle: RigidPart | None = None
    knuckle_lower: Point | None = None
    knuckle_upper: Point | None = None
    tierod_knuckle: Point | None = None
    draglink_chassis: Point | None = None
    draglink_knuckle: Point | None = None
    """Ball on a knuckle; with a bell crank its own point takes its place."""
    bell_crank: BellCrank | None = None
    crossed_tierods: bool = False
    tierod_chassis: Point | None = None
    """Ball of each knuckle's tie rod on the steering."""

    def check(self) -> None:
        """Something leads the tube, and a knuckle has an axis and what steers it."""
        rows = sum(2 if rod.mirrored else 1 for rod in self.rods) + (0 if self.arm is None else 2)
        rows += (0 if self.ball is None else 3) + (0 if self.watt is None else 1)
        if self.guide == "links" and rows < LED_BY_LINKS:
            rule = f"{LED_BY_LINKS} or more with the two of an arm and the three of a ball where guide is 'links'"
            raise refuse("rods", rule, rows, "add rods or an arm, or set guide to 'leaf-springs'")
        if self.guide == "leaf-springs" and not self.springs:
            rule = "one or more where guide is 'leaf-springs'"
            raise refuse("springs", rule, self.springs, "give a leaf's stiffness")
        if self.guide == "links" and (self.roll_stiffness or self.roll_damping):
            raise refuse("roll_stiffness", "0 where guide is 'links'", self.roll_stiffness, "give an antiroll_bar")
        self._check_steering()

    @property
    def is_steered(self) -> bool:
        """Whether it has knuckles."""
        return self.knuckle is not None

    @property
    def draglink(self) -> Point | None:
        """Ball of the drag link that is not on the steering."""
        return self.draglink_knuckle if self.bell_crank is None else self.bell_crank.draglink

    def _check_steering(self) -> None:
        rods = "draglink_chassis" if self.tierod_chassis is None else "tierod_chassis"
        needed = ("knuckle_lower", "knuckle_upper", "tierod_knuckle", rods)
        if self.knuckle is None:
            for name in (*needed, "draglink_chassis", "draglink_knuckle", "bell_crank"):
                if getattr(self, name) is not None:
                    raise refuse(name, "left out without a knuckle", getattr(self, name), "give 'knuckle'")
            return
        for name in needed:
            if getattr(self, name) is None:
                raise SpecError(f"{name}: must be given beside a knuckle, got None; give its place [m]")
        check_apart(self, ("knuckle_upper", "knuckle_lower"))
        if self.tierod_chassis is not None:
            self._check_own_tierods()
            return
        if (self.bell_crank is None) == (self.draglink_knuckle is None):
            rule = "given either as draglink_knuckle or as bell_crank: the drag link holds one of them"
            raise refuse("draglink_knuckle", rule, self.draglink_knuckle)
        if self.crossed_tierods and self.bell_crank is None:
            raise refuse("crossed_tierods", "false without a bell_crank", True)
        ends = self.draglink, self.draglink_chassis
        if ends[0] is not None and ends[1] is not None and math.dist(ends[0], ends[1]) < COINCIDENT:
            raise refuse("draglink_chassis", "apart from its other end", self.draglink_chassis)

    def _check_own_tierods(self) -> None:
        """Knuckles with a rod each have nothing else that steers them."""
        check_apart(self, ("tierod_knuckle", "tierod_chassis"))
        for name in ("draglink_chassis", "draglink_knuckle", "bell_crank"):
            if getattr(self, name) is not None:
                rule = "left out beside tierod_chassis, where each knuckle has a rod of its own"
                raise refuse(name, rule, getattr(self, name), "leave out one of them")
        if self.crossed_tierods:
            raise refuse("crossed_tierods", "false beside tierod_chassis", True)
