"""Trim of a wheeled vehicle: free lengths of springs and lengths of tie rods for the state that it is to stand in.

Unknown are, per axle, how far its springs are to lift it, the turn of its uprights that another tie rod makes, and the
seat of its spindles. Each rules one reading of the standing vehicle nearly alone, so that Broyden's method, from
slopes of one, needs a handful of equilibria of the static solver.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from simwarp.core.types import formatted
from simwarp.vehicle.spec.parts import Array, ForceLine, SpecError
from simwarp.vehicle.spec.reach import AROUND_WHEEL
from simwarp.vehicle.spec.vehicle_spec import Axle, DoubleWishbone, VehicleSpec
from simwarp.vehicle.stances import AxleStance, Stance, sprung, stance, stop_at
from simwarp.vehicle.suspensions.alignment import (
    has_tierod,
    with_camber_changed,
    with_free_lengths,
    with_tierod_turned,
)
from simwarp.vehicle.suspensions.kinematics import spring_lengths

DESIGN: Final = "design"
"""The ride height at which an axle's wheels stand where they are built."""

Height: TypeAlias = float | Literal["design"]
Heights: TypeAlias = Height | Sequence[Height | None] | None
Angles: TypeAlias = float | Sequence[float | None] | None

HEIGHT_TOLERANCE: Final = 5.0e-5
"""Error of a ride height that may be left [m]."""
ANGLE_TOLERANCE: Final = 3.0e-5
"""Error of toe or camber that may be left [rad]: 0.002°."""
MOST_STEPS: Final = 15
"""Of Broyden's method, one equilibrium each."""
LARGEST_LIFT: Final = 0.1
"""Change of a travel in one step, as a part of the tire's radius: springs with stops are no straight lines."""
LARGEST_TURN: Final = 0.1
"""Change of an upright's or a seat's angle in one step [rad]."""
SEARCHED: Final = 0.8
"""Travel up and down in which a suspension is looked at, as a part of the tire's radius."""
GRID: Final = 161
"""Travels there."""
LARGEST_ANGLE: Final = math.radians(20.0)
"""Of toe and camber that can be asked for [rad]."""
CLEARANCE: Final = 0.05
"""That a stop which is moved leaves to its spring at the asked height, as a part of the tire's radius."""
STOP_KEYS: Final = {"bump": "min_length", "rebound": "max_length"}
"""Key of a spring that has the length at which it meets a stop."""


class Reading(enum.Enum):
    """What can be asked for."""

    RIDE_HEIGHT = "ride_height"
    TOE = "toe"
    CAMBER = "camber"


@dataclasses.dataclass(frozen=True)
class _Wish:
    """One reading of one axle that is to have a value."""

    reading: Reading
    axle: int
    target: float | Literal["design"]

    @property
    def tolerance(self) -> float:
        """Error that may be left [m or rad]."""
        return HEIGHT_TOLERANCE if self.reading is Reading.RIDE_HEIGHT else ANGLE_TOLERANCE

    def error(self, found: Stance) -> float:
        """What a state lacks, positive where it lies too high [m or rad]."""
        axle = found.axles[self.axle]
        if self.target == DESIGN:
            return -axle.travel
        return float(getattr(axle, self.reading.value)) - self.target


@dataclasses.dataclass(frozen=True)
class _Travel:
    """Lengths of an axle's springs over the travel between its stops."""

    travels: Array
    """(n,) rising, around that as built [m]."""
    lengths: Array
    """(n, k) [m]."""

    def change(self, start: float, by: float) -> Array:
        """(k,) change of each length from a travel on [m]; beyond the table its last slopes go on."""
        return self._at(start + by) - self._at(start)

    def _at(self, travel: float) -> Array:
        place = float(np.clip(travel, self.travels[0], self.travels[-1]))
        index = min(max(int(np.searchsorted(self.travels, place)), 1), len(self.travels) - 1)
        low, high = self.lengths[index - 1], self.lengths[index]
        slope = (high - low) / (self.travels[index] - self.travels[index - 1])
        return np.asarray(low + slope * (travel - self.travels[index - 1]))


def trim(
    spec: VehicleSpec, *, ride_height: Heights = None, toe: Angles = None, camber: Angles = None,
    move_stops: bool = False, device: str = "cpu",
) -> VehicleSpec:  # fmt: skip
    """The vehicle with springs and tie rods with which it stands as asked for.

    It stands on level ground with straight steering, every wheel on a plate that slides freely (`stance`), so that no
    side forces hold it. One value is for all axles that can be adjusted; a sequence has one per axle, from the
    front, None where an axle is to stay as it is. What is not asked for stays as it is built: other heights bring
    another toe with them.

    Args:
        spec: the vehicle, which is left as it is.
        ride_height: one or (axles,), of its frame of reference above the ground over an axle's wheels as built [m];
            "design": where the wheels stand in the frame as they are built. The free lengths of springs are changed.
        toe: one or (axles,), positive where the wheels' fronts point inwards [rad]. The lengths of tie rods are
            changed: uprights, with what they hold, stand turned about their kingpins.
        camber: one or (axles,), positive where the wheels' tops lean outwards [rad]. The seats of spindles in uprights
            are changed.
        move_stops: a stop (`min_length`, `max_length`) that a spring would stand on at the asked height is moved, to a
            twentieth of the tire's radius behind it. Without, such a height is refused.
        device: device of the simulations.

    Returns:
        A description that settles within 0.05 mm and 0.002° of what is asked for; the same one where it does already.

    Raises:
        SpecError: an axle has no springs, or nothing to adjust an angle by; a height is out of the suspension's travel
            or behind a stop; the values are not finite, or not one per axle; the vehicle does not come to rest.
    """
    wishes = [
        *_wishes(spec, Reading.RIDE_HEIGHT, ride_height, lambda axle: sprung(spec, axle), "has no springs"),
        *_wishes(spec, Reading.TOE, toe, lambda axle: _aligned(spec, axle), "has no tie rod to set its toe by"),
        *_wishes(spec, Reading.CAMBER, camber, lambda axle: _aligned(spec, axle), "is rigid: its camber is as built"),
    ]
    if not wishes:
        raise SpecError(f"{spec.name}: one of ride_height, toe and camber must be given to trim it; got none")
    found = stance(spec, device=device)
    heights = [wish for wish in wishes if wish.reading is Reading.RIDE_HEIGHT]
    if move_stops:
        for wish in heights:
            if abs(_asked_travel(wish, found)) > SEARCHED * spec.all_axles[wish.axle].tire.radius:
                _travel(spec, wish, found, device)  # no stop is what is in the way: it refuses the height at once
        freed = _with_stops_moved(spec, heights, found, device)
        spec, found = (spec, found) if freed == spec else (freed, stance(freed, device=device))
    if _arrived(wishes, found):
        return spec
    travels = {wish.axle: _travel(spec, wish, found, device) for wish in heights}
    return _solve(spec, wishes, travels, found, device)


def _aligned(spec: VehicleSpec, axle: int) -> bool:
    return has_tierod(spec.all_axles[axle].suspension)


def _wishes(
    spec: VehicleSpec, reading: Reading, values: Any, adjustable: Callable[[int], bool], why: str
) -> list[_Wish]:
    """What is asked for of each axle, or a SpecError that says why it cannot be had."""
    key, count = reading.value, len(spec.all_axles)
    if values is None:
        return []
    if isinstance(values, (list, tuple, np.ndarray)):
        if len(values) != count:
            raise SpecError(f"{key}: must be one value, or one per axle of '{spec.name}' ({count}), got {len(values)}")
        asked = [(axle, value) for axle, value in enumerate(values) if value is not None]
        for axle, _ in asked:
            if not adjustable(axle):
                template = spec.all_axles[axle].suspension.template
                raise SpecError(f"{key}: must be left out of axle {axle} of '{spec.name}', which {why} ({template})")
    else:
        asked = [(axle, values) for axle in range(count) if adjustable(axle)]
        if not asked:
            templates = ", ".join(dict.fromkeys(axle.suspension.template for axle in spec.all_axles))
            raise SpecError(f"{key}: must be left out of '{spec.name}', every axle of which {why} ({templates})")
    return [_Wish(reading, axle, _target(reading, value)) for axle, value in asked]


def _target(reading: Reading, value: Any) -> float | Literal["design"]:
    """A value that can be asked for."""
    key = reading.value
    if reading is Reading.RIDE_HEIGHT and isinstance(value, str) and value == DESIGN:
        return DESIGN
    number = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)
    if not number or not math.isfinite(value):
        rule = "a height [m] or 'design'" if reading is Reading.RIDE_HEIGHT else "an angle [rad]"
        raise SpecError(f"{key}: must be {rule}, got {formatted(value)}")
    if reading is not Reading.RIDE_HEIGHT and abs(value) > LARGEST_ANGLE:
        raise SpecError(f"{key}: must be within {LARGEST_ANGLE:.3g} rad, got {value:.4g}; angles are in radians")
    return float(value)


def _asked_travel(wish: _Wish, found: Stance) -> float:
    """The travel of an axle's wheels at the height that is asked for, on tires that stay as flat as they are [m]."""
    now = found.axles[wish.axle]
    return 0.0 if wish.target == DESIGN else now.travel + now.ride_height - wish.target


def _lengths_at(spec: VehicleSpec, axle: int, travels: Sequence[float] | Array, device: str) -> Array:
    """(n, k) lengths of an axle's lines at some travels [m]; NaN where the linkage does not close."""
    return spring_lengths(_with_hinges(spec), axle, travels, device=device)


def _with_stops_moved(spec: VehicleSpec, heights: Sequence[_Wish], found: Stance, device: str) -> VehicleSpec:
    """The vehicle with the stops out of the way that its springs would stand on at the heights asked for."""
    axles = list(spec.all_axles)
    for wish in heights:
        axle: Any = axles[wish.axle]
        lengths = _lengths_at(spec, wish.axle, [_asked_travel(wish, found)], device)[0]
        moved = {index: {key: to} for index, _, key, to in _blocking(axle, lengths)}
        springs = tuple(dataclasses.replace(line, **moved.get(i, {})) for i, line in enumerate(axle.suspension.springs))
        axles[wish.axle] = dataclasses.replace(axle, suspension=dataclasses.replace(axle.suspension, springs=springs))
    return spec.with_axles(axles)


def _blocking(axle: Axle, lengths: Array) -> list[tuple[int, str, str, float]]:
    """Springs that stand on a stop at some lengths: index, stop, its key, and the value that leaves a clearance [m]."""
    found = []
    lines: tuple[ForceLine, ...] = getattr(axle.suspension, "springs", ())
    for index, (line, length) in enumerate(zip(lines, lengths.tolist(), strict=True)):
        stop = stop_at(line, length)[0]
        if line.bump_curve is not None and stop in STOP_KEYS:
            room = CLEARANCE * axle.tire.radius
            clear = length + room if stop == "rebound" else max(length - room, 0.5 * length)
            found.append((index, stop, STOP_KEYS[stop], clear))
    return found


def _travel(spec: VehicleSpec, wish: _Wish, found: Stance, device: str) -> _Travel:
    """The travel of an axle between its stops and where its linkage locks, if it has the height that is asked for."""
    axle, now = spec.all_axles[wish.axle], found.axles[wish.axle]
    reach, asked = SEARCHED * axle.tire.radius, _asked_travel(wish, found)
    travels = np.linspace(-reach, reach, GRID)
    if abs(asked) < reach:  # a state of its own: a stop may be nearer to it than to the next state of the grid
        travels = np.sort(np.append(travels[np.abs(travels - asked) > 0.5 * reach / GRID], asked))
    lengths = _lengths_at(spec, wish.axle, travels, device)
    free = np.array([_free(axle, row) for row in lengths])
    middle = int(np.flatnonzero(free)[np.abs(travels[free]).argmin()]) if free.any() else 0
    low, high = middle, middle
    while low > 0 and free[low - 1]:
        low -= 1
    while high < len(free) - 1 and free[high + 1]:
        high += 1
    if high > low and travels[low] <= asked <= travels[high]:
        return _Travel(travels[low : high + 1], lengths[low : high + 1])
    whose = f"axle {wish.axle} of '{spec.name}'"
    if high == low:
        rule = f"left out of {whose}, which has no travel between its stops"
    else:
        lowest, highest = (now.ride_height + now.travel - travels[end] for end in (high, low))
        rule = f"from {lowest:.4g} to {highest:.4g} m at {whose}, where its suspension moves freely"
    target = f"'{DESIGN}'" if wish.target == DESIGN else f"{wish.target:.4g}"
    raise SpecError(f"ride_height: must be {rule}, got {target}; {_why_not(spec, wish.axle, asked, device)}")


def _why_not(spec: VehicleSpec, index: int, travel: float, device: str) -> str:
    """What keeps an axle from a travel, and the remedy."""
    axle = spec.all_axles[index]
    away = f"that is {abs(travel):.3g} m from where its wheels are built; ask for less, or build them elsewhere"
    if abs(travel) > 2.0 * AROUND_WHEEL * axle.tire.radius:
        return away  # further than any linkage is long: a bench would try for minutes
    lengths = _lengths_at(spec, index, [travel], device)[0]
    if not np.isfinite(lengths).all():
        return "there its linkage does not close; ask for less, or change its hardpoints"
    stops = _blocking(axle, lengths)
    if not stops:
        return away
    number, stop, key, clear = stops[0]
    line: Any = getattr(axle.suspension, "springs", ())[number]
    return (
        f"there springs[{number}] is {lengths[number]:.4g} m long and stands on its {stop} stop, {key} "
        f"{getattr(line, key):.4g}: move it by --move-stops (move_stops=True), or set "
        f"axles[{index}].suspension.springs[{number}].{key} to {clear:.4g}"
    )


def _with_hinges(spec: VehicleSpec) -> VehicleSpec:
    """The vehicle with hinges in the place of bushings, which hold an arm by forces and not on a bench."""
    axles = []
    for axle in spec.all_axles:
        suspension = axle.suspension
        if isinstance(suspension, DoubleWishbone):
            suspension = dataclasses.replace(suspension, upper_arm_bushing=None, lower_arm_bushing=None)
        axles.append(dataclasses.replace(axle, suspension=suspension))
    return spec.with_axles(axles)


def _free(axle: Axle, lengths: Array) -> bool:
    """Whether a linkage closes at some lengths of its lines, none of which has run into the stop of a spring."""
    return bool(np.isfinite(lengths).all()) and not _blocking(axle, lengths)


def _solve(
    spec: VehicleSpec, wishes: Sequence[_Wish], travels: dict[int, _Travel], found: Stance, device: str
) -> VehicleSpec:
    """Broyden's method from slopes of one: lifted springs raise a height, turned uprights a toe."""
    begin = found.axles
    x, slope = np.zeros(len(wishes)), np.eye(len(wishes))
    errors = np.array([wish.error(found) for wish in wishes])
    trimmed, best = spec, errors
    limits = np.array([_limit(spec, wish) for wish in wishes])
    for _ in range(MOST_STEPS):
        step = -np.linalg.lstsq(slope, errors, rcond=1e-6)[0]
        step *= min(1.0, float((limits / np.maximum(np.abs(step), 1e-30)).min()))
        x = x + step
        trimmed = _adjusted(spec, wishes, x, travels, begin)
        found = stance(trimmed, device=device)
        before, errors = errors, np.array([wish.error(found) for wish in wishes])
        if _arrived(wishes, found):
            return trimmed
        slope = slope + np.outer(errors - before - slope @ step, step) / max(float(step @ step), 1e-30)
        best = errors if np.abs(errors).max() < np.abs(best).max() else best
    worst = int(np.abs(best).argmax())
    wish = wishes[worst]
    unit = "m" if wish.reading is Reading.RIDE_HEIGHT else "rad"
    raise SpecError(
        f"{wish.reading.value}: '{spec.name}' does not settle as asked for at axle {wish.axle}: {best[worst]:+.2g} "
        f"{unit} are left after {MOST_STEPS} steps{_stops_met(found)}; ask for less, or for one thing at a time"
    )


def _stops_met(found: Stance) -> str:
    """The stops that springs stand on, for a message."""
    met = [
        f"springs[{number}] of axle {index} stands {1e3 * line.into_stop:.2g} mm on its {line.stop} stop"
        for index, axle in enumerate(found.axles)
        for number, line in enumerate(axle.lines)
        if line.stop in STOP_KEYS
    ]
    return f", where {' and '.join(met)}" if met else ""


def _limit(spec: VehicleSpec, wish: _Wish) -> float:
    """Of one step of an unknown [m or rad]."""
    return LARGEST_LIFT * spec.all_axles[wish.axle].tire.radius if wish.reading is Reading.RIDE_HEIGHT else LARGEST_TURN


def _arrived(wishes: Sequence[_Wish], found: Stance) -> bool:
    return all(abs(wish.error(found)) <= wish.tolerance for wish in wishes)


def _adjusted(
    spec: VehicleSpec, wishes: Sequence[_Wish], x: Array, travels: dict[int, _Travel], begin: Sequence[AxleStance]
) -> VehicleSpec:
    """The vehicle with lifted springs, turned uprights and other seats of its spindles."""
    axles = list(spec.all_axles)
    for wish, value in zip(wishes, x.tolist(), strict=True):
        suspension = axles[wish.axle].suspension
        match wish.reading:
            case Reading.RIDE_HEIGHT:
                changes = travels[wish.axle].change(begin[wish.axle].travel, -value)
                suspension = with_free_lengths(suspension, changes)
            case Reading.TOE:
                suspension = with_tierod_turned(suspension, value)
            case Reading.CAMBER:
                suspension = with_camber_changed(suspension, value)
        axles[wish.axle] = dataclasses.replace(axles[wish.axle], suspension=suspension)
    return spec.with_axles(axles)
