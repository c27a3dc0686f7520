"""A trim to a height behind a spring's stop: refused with the stop and the remedy, or the stop is moved."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle import SpecError, VehicleSpec, load_vehicle, stance, trim
from simwarp.vehicle.spec.parts import BUMP_STOP, ForceLine
from simwarp.vehicle.trimming import CLEARANCE, HEIGHT_TOLERANCE, STOP_KEYS


def stiffer(line: ForceLine, factor: float) -> ForceLine:
    curve = line.spring_curve
    return dataclasses.replace(
        line,
        stiffness=factor * line.stiffness,
        spring_curve=None if curve is None else tuple((x, factor * force) for x, force in curve),
    )


def with_springs(spec: VehicleSpec, change: Any) -> VehicleSpec:
    """The vehicle with `change(axle index, number, line)` in the place of its lines."""
    axles: list[Any] = list(spec.axles)
    for index, axle in enumerate(axles):
        lines = [change(index, number, line) for number, line in enumerate(getattr(axle.suspension, "springs", ()))]
        if lines:
            suspension = dataclasses.replace(axle.suspension, springs=tuple(lines))
            axles[index] = dataclasses.replace(axle, suspension=suspension)
    return dataclasses.replace(spec, axles=tuple(axles))


def heights(spec: VehicleSpec) -> list[float | None]:
    """At which it stands, of axles with springs."""
    return [
        found.ride_height if getattr(axle.suspension, "springs", ()) else None
        for axle, found in zip(spec.axles, stance(spec).axles, strict=True)
    ]


def with_a_stop(spec: VehicleSpec, stop: str) -> VehicleSpec:
    """The vehicle with a stop at its first spring, a hundredth of the radius behind where that stands."""
    length = stance(spec).axles[0].lines[0].length
    room = 0.01 * spec.axles[0].tire.radius
    at = length + room if stop == "rebound" else length - room

    def change(index: int, number: int, line: ForceLine) -> ForceLine:
        if (index, number) != (0, 0):
            return line
        stops: dict[str, Any] = {"max_length": None, "min_length": None, STOP_KEYS[stop]: at}
        return dataclasses.replace(line, bump_curve=BUMP_STOP, **stops)

    return with_springs(spec, change)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["artcar", "gator", "sedan", "hmmwv"])
def test_stiffer_springs_come_back_to_their_height(name: str) -> None:
    """With 1.3 times the rate everywhere: within the tolerance of the page, clear of all stops. The HMMWV's rear
    springs stand on their rebound stops as shipped.
    """
    spec = load_vehicle(name)
    asked = heights(spec)
    stiff = with_springs(spec, lambda index, number, line: stiffer(line, 1.3))
    trimmed = trim(stiff, ride_height=asked, move_stops=True)
    for found, height in zip(stance(trimmed).axles, asked, strict=True):
        if height is None:
            continue
        assert abs(found.ride_height - height) <= HEIGHT_TOLERANCE
        assert not any(line.stop in STOP_KEYS for line in found.lines)
    moved = [
        (index, number)
        for index, (old, new) in enumerate(zip(spec.axles, trimmed.axles, strict=True))
        for number, (line, other) in enumerate(
            zip(getattr(old.suspension, "springs", ()), getattr(new.suspension, "springs", ()), strict=True)
        )
        if (line.min_length, line.max_length) != (other.min_length, other.max_length)
    ]
    assert moved == ([(1, 0)] if name == "hmmwv" else [])
    assert trim(trimmed, ride_height=asked, move_stops=True) is trimmed


@pytest.mark.slow
@pytest.mark.parametrize("stop", ["bump", "rebound"])
@pytest.mark.parametrize("name", ["artcar", "sedan"])
def test_a_height_behind_a_stop_is_refused_with_the_remedy_and_the_remedies_work(name: str, stop: str) -> None:
    spec = with_a_stop(load_vehicle(name), stop)
    radius = spec.axles[0].tire.radius
    asked = (heights(spec)[0] or 0.0) + (0.08 if stop == "rebound" else -0.08) * radius
    with pytest.raises(SpecError) as caught:
        trim(spec, ride_height=(asked, None))
    text, key = str(caught.value), STOP_KEYS[stop]
    assert "\n" not in text
    said = re.fullmatch(
        rf"ride_height: must be from \S+ to \S+ m at axle 0 of '{name}', where its suspension moves freely, got \S+; "
        rf"there springs\[0\] is (\S+) m long and stands on its {stop} stop, {key} (\S+): move it by --move-stops "
        rf"\(move_stops=True\), or set axles\[0\]\.suspension\.springs\[0\]\.{key} to (\S+)",
        text,
    )
    assert said is not None, text
    length, at, clear = map(float, said.groups())
    first: Any = spec.axles[0].suspension
    # printed with four digits
    assert at == pytest.approx(getattr(first.springs[0], key), rel=1e-3)
    assert abs(clear - length) == pytest.approx(CLEARANCE * radius, abs=2e-4)
    assert (length > at) if stop == "rebound" else (length < at)

    by_hand = with_springs(
        spec, lambda i, n, line: dataclasses.replace(line, **{key: clear}) if (i, n) == (0, 0) else line
    )
    by_option = trim(spec, ride_height=(asked, None), move_stops=True)
    for trimmed in (trim(by_hand, ride_height=(asked, None)), by_option):
        found = stance(trimmed).axles[0]
        assert abs(found.ride_height - asked) <= HEIGHT_TOLERANCE
        assert found.lines[0].stop == ""
    springs: Any = by_option.axles[0].suspension
    assert getattr(springs.springs[0], key) == pytest.approx(clear, abs=1e-4)
    assert by_option.axles[1] == spec.axles[1]


@pytest.mark.slow
def test_stops_that_are_not_in_the_way_stay() -> None:
    spec = with_a_stop(load_vehicle("artcar"), "rebound")
    asked = (heights(spec)[0] or 0.0) - 0.002
    first: Any = trim(spec, ride_height=(asked, None), move_stops=True).axles[0].suspension
    old: Any = spec.axles[0].suspension
    assert first.springs[0].max_length == old.springs[0].max_length


def test_the_design_height_behind_a_stop_is_refused_too() -> None:
    spec = load_vehicle("artcar")
    built = [np.linalg.norm(np.subtract(line.chassis_point, line.arm_point)) for line in _lines(spec)]
    short = with_springs(
        spec,
        lambda i, n, line: (
            dataclasses.replace(line, bump_curve=BUMP_STOP, max_length=float(built[0]) - 0.01)
            if (i, n) == (0, 0)
            else line
        ),
    )
    with pytest.raises(
        SpecError, match=r"got 'design'; there springs\[0\] is .* stands on its rebound stop, max_length"
    ):
        trim(short, ride_height=("design", None))


def _lines(spec: VehicleSpec) -> tuple[ForceLine, ...]:
    suspension: Any = spec.axles[0].suspension
    return tuple(suspension.springs)


@pytest.mark.parametrize(
    ("height", "why"), [(0.7, "linkage does not close"), (-0.2, "from where its wheels are built")]
)
def test_heights_that_no_stop_bars_are_refused_with_their_reason(height: float, why: str) -> None:
    with pytest.raises(
        SpecError, match=rf"^ride_height: must be from .* got {height}; .*{why}.*; ask for less|ask for less"
    ):
        trim(load_vehicle("sedan"), ride_height=(height, None), move_stops=True)


def test_an_axle_of_dampers_alone_has_no_height_to_set() -> None:
    spec = with_springs(
        load_vehicle("artcar"),
        lambda i, n, line: dataclasses.replace(line, spring_curve=None, stiffness=0.0) if i == 0 else line,
    )
    with pytest.raises(SpecError, match="ride_height: must be left out of axle 0 of 'artcar', which has no springs"):
        trim(spec, ride_height=(0.12, None))


def test_a_height_out_of_all_reach_is_refused_before_stops_are_moved() -> None:
    """Millimetres in place of metres: the search for a state moved its stops, and then did not end for minutes."""
    with pytest.raises(SpecError, match=r"^ride_height: must be from .* m at axle 0 of 'gator', .* got 412; "):
        trim(load_vehicle("gator"), ride_height=(412.0, None), move_stops=True)
