"""The road of `simwarp drive` from the command line: random ones, files, and patches of friction."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final, TypeAlias

from simwarp.cli import UsageError
from simwarp.vehicle.driving.maneuver_spec import FrictionPatch, Maneuver
from simwarp.vehicle.results.road import CELL, check_own_ground, road_window
from simwarp.vehicle.results.runs import FRICTION
from simwarp.vehicle.roads.road_files import check_road_word, road_of
from simwarp.vehicle.roads.road_surface import RoadSurface
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec

Patch: TypeAlias = tuple[float, float, float, float, float]
"""First and last x, first and last y [m], friction."""

OPTION: Final = "--friction-patch"
METAVAR: Final = "X0 X1 Y0 Y1 MU"
MOST_CELLS: Final = 4_000_000
"""Of the map of friction that holds all patches."""


def check_patches(patches: Sequence[Patch]) -> None:
    """Refuses rectangles that are none, and frictions that no ground has.

    Raises:
        UsageError: names the option, the rule, the value and the remedy.
    """
    for x0, x1, y0, y1, friction in patches:
        for name, low, high in (("X0 and X1", x0, x1), ("Y0 and Y1", y0, y1)):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise UsageError(f"{OPTION} {METAVAR}: {name} must rise [m], got {low:g} and {high:g}; swap them")
        if not FRICTION[0] <= friction <= FRICTION[1]:
            raise UsageError(
                f"{OPTION} {METAVAR}: MU must be from {FRICTION[0]:g} to {FRICTION[1]:g}, got {friction:g}"
            )
    if patches:
        spans = [max(p[k + 1] for p in patches) - min(p[k] for p in patches) for k in (0, 2)]
        cells = spans[0] * spans[1] / CELL**2
        if cells > MOST_CELLS:
            size = f"{spans[0]:g} m x {spans[1]:g} m"
            most = MOST_CELLS * CELL**2
            raise UsageError(f"{OPTION}: all patches must lie within {most:g} m², got {size}; take smaller ones")


def with_patches(
    maneuver: Maneuver, patches: Sequence[Patch], friction: float, vehicle: AnyVehicleSpec
) -> Maneuver:  # fmt: skip
    """The manoeuvre on a road with further patches, which lie on those of its own.

    Args:
        maneuver: to be driven.
        patches: of `check_patches`.
        friction: of the road beside them.
        vehicle: that drives it.

    Raises:
        UsageError: it has tracks.
    """
    if not patches:
        return maneuver
    if isinstance(vehicle, TrackedVehicleSpec):
        raise UsageError(f"{OPTION}: '{vehicle.name}' has tracks, which do not read it; leave it out")
    laid = tuple(
        FrictionPatch(x=(x0, x1), y=(y0, y1), factor=value / friction) for x0, x1, y0, y1, value in patches
    )  # fmt: skip
    return dataclasses.replace(maneuver, patches=(*maneuver.patches, *laid))


def check_road_option(word: str | None) -> None:
    """Refuses what names no road.

    Raises:
        UsageError: names the option, the rule, the value and the remedy.
    """
    if word is None:
        return
    try:
        check_road_word(word)
    except SpecError as error:
        raise UsageError(f"--{error}") from None


def road_below(maneuver: Maneuver, word: str | None, soil: str | None) -> RoadSurface | None:
    """The road that a manoeuvre is driven on; None: its plane.

    Args:
        maneuver: with its extent.
        word: of `check_road_option`; None: there is none.
        soil: that is chosen for the whole ground.

    Raises:
        UsageError: the road cannot be read, or names soils beside a chosen one.
        SpecError: the manoeuvre has a ground of its own.
    """
    if word is None:
        return None
    check_own_ground(maneuver)
    try:
        road = road_of(word, road_window(maneuver))
    except SpecError as error:
        raise UsageError(f"--road: {str(error).removeprefix('road: ')}") from None
    if road.soils and soil is not None:
        raise UsageError(f"--soil: the road '{word}' has soils of its own; leave --soil out")
    return road
