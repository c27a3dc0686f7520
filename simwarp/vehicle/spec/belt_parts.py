"""Descriptions of tracks by belt: those of tracks shoe by shoe, and a block with what a belt takes besides."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, Final, Literal

from simwarp.core.constraints import Ge, Le, NotNegative, Positive
from simwarp.vehicle.spec.parts import Spec, SpecError
from simwarp.vehicle.spec.track_parts import ShoeTrack, SinglePinShoe, SinglePinSprocket, TrackLayout

MOST_POINTS: Final = 16
"""On a stretch of a belt."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeltLaw(Spec):
    """What a track by belt needs beside its wheels and shoes. Defaults are the M113's, as far as they are known."""

    friction: NotNegative | None = None
    """On hard ground, at most that of the ground; None: the shoes'."""
    width: Positive | None = None
    """Of a closed band that presses soil [m]; None: the shoes' pads do, with gaps between them, and their side pads
    once they touch it.
    """
    span_points: Annotated[int, Ge(0), Le(MOST_POINTS)] = 4
    """Points of contact between two neighbouring road wheels; each wheel has one besides."""
    ramp_points: Annotated[int, Ge(1), Le(MOST_POINTS)] = 4
    """Of the way from the first wheel to the sprocket, and from the last one to the idler; each has two besides."""
    ground_stiffness: Positive = 7.0e6
    """Of pads on hard ground, per length of the belt [N/m²]."""
    ground_damping_time: NotNegative = 0.005
    """Of pads on hard ground, damping over stiffness [s]."""
    shear_length: Positive = 0.005
    """Way over hard ground after which all friction acts [m]."""
    shear_damping_time: NotNegative = 0.01
    """Of friction below its limit, damping over stiffness [s]."""
    wheel_sink: NotNegative = 3.8e-7
    """Of a wheel in a shoe, per force [m/N]."""
    smooth_sprocket: bool = False
    """The sprocket is a drum (`SprocketContact.DRUM`): the belt runs at its radius, and nothing slides in gaps."""
    sprocket_loss: NotNegative | None = None
    """Resistance of rollers that slide through the sprocket's gaps, per mean tension of the two runs there; None: of
    its friction and profile (`belt_losses`), 0 of a smooth one.
    """
    dry_loss: NotNegative = 0.0023
    """Resistance of the belt to its motion, per tension."""
    rolling_loss: NotNegative = 0.017
    """The same, per load of the road wheels."""
    linear_loss: NotNegative = 0.0073
    """The same, per tension and speed [s/m]."""
    square_loss: NotNegative = 0.0
    """The same, per tension and square of the speed [s²/m²]."""
    loss_length: Positive = 0.002
    """Way over which the dry resistances come up [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeltTrack(TrackLayout):
    """One track by belt: the layout of the same track shoe by shoe, with `belt` besides.

    Its shoes are a belt of `shoes` times their pitch. Support rollers and springs at pins have no effect on it but by
    their mass.
    """

    track: Literal["belt"] = "belt"
    belt: BeltLaw = dataclasses.field(default_factory=BeltLaw)

    def check(self) -> None:
        """What holds of shoes holds of the belt that stands for them; and its sprocket has one arc in a gap.

        Raises:
            SpecError: shoes and sprocket do not fit, or have two pins.
        """
        super().check()
        if not isinstance(self.shoe, SinglePinShoe) or not isinstance(self.sprocket, SinglePinSprocket):
            raise SpecError(f"shoe: '{self.shoe.template}' is not there yet for belts; use 'track-single-pin'")

    def shoe_track(self) -> ShoeTrack:
        """Return the description of the same track shoe by shoe."""
        return ShoeTrack(**_layout(self))


def belt_of(track: ShoeTrack | BeltTrack, **values: Any) -> BeltTrack:
    """The belt of a track that is described shoe by shoe, or a belt made anew.

    Args:
        track: its wheels, sprocket and shoes.
        values: fields of `BeltLaw` other than its defaults.

    Raises:
        SpecError: a value breaks a rule.
    """
    unknown = sorted(set(values) - {field.name for field in dataclasses.fields(BeltLaw)})
    if unknown:
        names = ", ".join(field.name for field in dataclasses.fields(BeltLaw))
        raise SpecError(f"belt: must have fields of BeltLaw, got {unknown[0]!r}; they are {names}")
    return BeltTrack(**_layout(track), belt=BeltLaw(**values))


def _layout(track: TrackLayout) -> dict[str, Any]:
    """What a track shoe by shoe and one by belt have alike."""
    return {field.name: getattr(track, field.name) for field in dataclasses.fields(TrackLayout)}
