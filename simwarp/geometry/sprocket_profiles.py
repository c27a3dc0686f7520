"""Profiles of sprockets as assets of the collision kernels: concave arcs between teeth, around z."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import warp as wp

from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import ModelError, formatted
from simwarp.kernels.collision.shape import Assets

FEWEST_TEETH: Final = 3
"""Of a sprocket."""
MOST_TEETH: Final = 10000
"""Of a sprocket: beyond that float32 no longer tells arcs apart."""


@dataclasses.dataclass(frozen=True)
class SprocketProfile(ReadableFields):
    """Gaps at angles k 2 pi / teeth about z, the first on x, each with one concave arc, or two beside its middle.

    Attributes:
        teeth: and gaps.
        arc_center_radius: of the circle on which the centres of the arcs lie, in radii of the tips.
        arc_radius: of the arcs, in radii of the tips.
        arc_offset: angle of an arc's centre from the middle of its gap [rad]; 0: one arc a gap.
    """

    teeth: int
    arc_center_radius: float
    arc_radius: float
    arc_offset: float = 0.0


def checked_profile(thing: str, profile: SprocketProfile) -> SprocketProfile:
    """The profile, of which teeth are left.

    Raises:
        ModelError: arcs that do not reach below the tips, or that leave no teeth.
    """
    center, arc, offset = profile.arc_center_radius, profile.arc_radius, profile.arc_offset
    if not FEWEST_TEETH <= profile.teeth <= MOST_TEETH:
        raise ModelError(
            f"{thing}: teeth must be {FEWEST_TEETH}..{MOST_TEETH}, got {formatted(profile.teeth)}; count its gaps"
        )
    if not 0.0 < center - arc < 1.0:
        raise ModelError(
            f"{thing}: the arcs' bottom, arc_center_radius - arc_radius, must lie between 0 and tip_radius, got "
            f"{center - arc:.4g} of it; change one of them"
        )
    if offset == 0.0 and not center + arc >= 1.0:  # of two arcs, the room between them leads to the tips
        raise ModelError(
            f"{thing}: the arcs must reach the tips: arc_center_radius + arc_radius >= tip_radius, got "
            f"{center + arc:.4g} of it; lower the tips"
        )
    # where they are widest as seen from the axis, or at the tips if these are lower
    tangent = math.sqrt(center * center - arc * arc)
    half = math.asin(arc / center) if tangent < 1.0 else math.acos((center**2 + 1.0 - arc**2) / (2.0 * center))
    if not offset >= 0.0:
        raise ModelError(f"{thing}: arc_offset must be >= 0 rad, got {formatted(offset)}; it is to either side")
    if not offset + half < math.pi / profile.teeth:
        raise ModelError(
            f"{thing}: arcs must leave teeth between them: less than {math.pi / profile.teeth:.4g} rad to either side "
            f"of a gap's middle, got {offset + half:.4g}; take fewer teeth or a smaller arc_radius"
        )
    return profile


def add_profile_assets(assets: Assets, profiles: Sequence[SprocketProfile], device: wp.DeviceLike = None) -> None:
    """Puts profiles into `assets`; their order gives the asset indices."""
    teeth = np.array([profile.teeth for profile in profiles], np.int32)
    arcs = np.array([(p.arc_center_radius, p.arc_radius, p.arc_offset) for p in profiles], np.float32).reshape(-1, 3)
    assets.sprocket_teeth = wp.array(teeth, dtype=wp.int32, device=device)
    assets.sprocket_arc = wp.array(arcs, dtype=wp.vec3, device=device)
