"""Dry resistance of a belt at a sprocket with teeth, from its friction and profile: rollers slide in its gaps."""

from __future__ import annotations

import dataclasses
import math

from simwarp.vehicle.spec.belt_parts import BeltTrack
from simwarp.vehicle.spec.track_parts import SinglePinShoe, SinglePinSprocket
from simwarp.vehicle.tracks.belt_path import RestingBelt, way_around, wrapped_radius


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Seat:
    """Rollers in the gaps of a sprocket: in each the last one of a shoe and the first one of the next, beside a pin.

    Attributes:
        path: radius of the chain's path where pins lie in the middle of gaps [m].
        pitch: that at which shoes would follow each other as teeth do [m].
        touched: distance of the rollers' contacts from the axis [m].
        bottom: of the rollers' axes at the bottom of a gap, from the sprocket's axis [m].
        tilt: angle of the normals per way of a pin off the middle of its gap [rad/m].
        aside: of a roller from the pin next to it [m].
    """

    path: float
    pitch: float
    touched: float
    bottom: float
    tilt: float
    aside: float


def _seat(shoe: SinglePinShoe, sprocket: SinglePinSprocket) -> _Seat:
    half_angle = math.pi / sprocket.teeth
    roller = 0.5 * (shoe.roller_front - shoe.roller_rear)
    reach = sprocket.arc_radius - shoe.roller_radius
    ahead = sprocket.arc_center_radius * math.sin(half_angle) - roller
    down = math.sqrt(max(reach * reach - ahead * ahead, 0.0))
    distance = sprocket.arc_center_radius * math.cos(half_angle) - down
    contact = shoe.roller_radius / reach
    bottom = sprocket.arc_center_radius - reach
    return _Seat(
        path=wrapped_radius(distance, shoe.pitch), pitch=sprocket.teeth * shoe.pitch / (2.0 * math.pi),
        touched=math.hypot(roller - contact * ahead, distance - contact * down), bottom=bottom,
        tilt=1.0 / reach + 1.0 / bottom, aside=0.5 * shoe.pitch - roller,
    )  # fmt: skip


def gap_loss(track: BeltTrack, resting: RestingBelt) -> float:
    """Resistance of rollers that slide in a sprocket's gaps, per mean tension T of the two runs there.

    Where the chain's path has the radius R, less than the pitch radius r, the chain turns around the axis by v / R and
    the sprocket by v / r. A pin that is x off the middle of its gap lies higher, R = R0 + tilt x² / 2, so that over the
    angle around the sprocket x goes by the hyperbolic tangent towards where nothing slides. Its mean is where the
    normals lean as friction does, since both runs have one tension. The tension presses with T per angle.

    A shoe that turns onto the sprocket by δ, and off again, slides by δ times the roller's distance from the pin, with
    half of its T δ on average, on one of two rollers.

    Zero for a smooth sprocket.
    """
    shoe, sprocket = track.shoe, track.sprocket
    assert isinstance(shoe, SinglePinShoe)  # of BeltTrack.check
    assert isinstance(sprocket, SinglePinSprocket)
    if track.belt.smooth_sprocket:
        return 0.0
    seat, friction = _seat(shoe, sprocket), min(sprocket.friction, shoe.friction)
    turn = float(way_around(resting.centers, resting.radii)[2][0])
    path, slide = seat.path, 0.0
    if seat.pitch > seat.path:
        far = math.sqrt(2.0 * (seat.pitch - seat.path) / seat.tilt)
        lean = min(friction / (seat.tilt * far), 1.0)
        width = 0.25 * turn * seat.bottom * seat.tilt * far / seat.pitch
        middle = math.atanh(min(math.tanh(width * lean) / math.tanh(width), 1.0 - 1.0e-9))
        share = (math.tanh(middle + width) - math.tanh(middle - width)) / (2.0 * width)
        path = seat.pitch - share * (seat.pitch - seat.path)
        slide = seat.touched * (1.0 / path - 1.0 / seat.pitch)
    turned = shoe.pitch / path
    return friction * (turn * slide + 0.5 * turned * turned * seat.aside / shoe.pitch)
