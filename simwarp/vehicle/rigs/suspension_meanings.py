"""What the characteristic values of a suspension mean: definitions and signs, for tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

SHARED: Final = {
    "reference_travel": "from the state as built to that of reference, upwards",
    "wheel_load": "on each wheel of the standing vehicle",
    "toe": "positive inwards",
    "camber": "positive where the top leans outwards",
    "caster": "positive where the top of the steering axis leans back",
    "kingpin_inclination": "positive where that top leans inwards",
    "scrub_radius": "from the steering axis out to the contact point",
    "trail": "from the contact point forwards to the steering axis",
    "roll_centre_height": "above the ground",
    "anti_dive": "share of the load transfer in braking that links bear",
    "into_stop": "of the spring; bump positive, rebound negative, 0 free",
    "motion_ratio": "compression of the spring or damper per travel",
    "toe_gain": "toe per travel of both wheels upwards; positive: they toe in as they rise",
    "camber_gain": "camber per travel of both wheels upwards; negative: tops lean in as they rise",
    "track_gain": "track of the contact points per travel of both wheels upwards; positive: it widens",
    "wheel_rate": "wheel load per travel of both wheels, with stops that are engaged",
    "free_wheel_rate": "the same without what stops add",
    "roll_stiffness": "moment per roll of the chassis, with stops that are engaged",
    "free_roll_stiffness": "the same without what stops add",
    "roll_steer": "mean heading to the left per lean of the chassis to the left",
    "roll_camber": "camber of the left wheel, against the chassis, per lean of the chassis to the left",
}
"""By the name of a value without its unit; of axles wherever they are."""
UNDERSTEERS: Final = "positive understeers"
OVERSTEERS: Final = "positive oversteers"


def suspension_meanings(names: Mapping[str, float], *, front: bool) -> dict[str, str]:
    """Definitions of characteristic values by their keys; values that are not known have none.

    Args:
        names: parameters of a run, whose keys end in their units.
        front: whether the axle is ahead of the middle of all axles.
    """
    own = SHARED | {
        "roll_steer": f"{SHARED['roll_steer']}; {UNDERSTEERS if front else OVERSTEERS}",
        "anti_lift": f"share of the load transfer in {'driving' if front else 'braking'} that links bear",
        "anti_squat": "share of the load transfer in driving that links bear",
    }
    found = {}
    for key in names:
        fitting = [name for name in own if key == name or key.startswith((f"{name}_", f"{name}0", f"{name}1"))]
        if fitting:
            found[key] = own[max(fitting, key=len)]
    return found
