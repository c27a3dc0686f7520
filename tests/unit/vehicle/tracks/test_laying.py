"""Chains as they are laid: closed, of equal shoes, where the recorded ones lie, and refused where they do not close."""

import dataclasses
import math
import re
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.tracks.laying import TrackCourse, lay_chain

PITCH = 0.154
ROUNDING = 1e-9
"""Sums of some hundred lengths of a metre in float64 lose 1e-14; what is laid closes by far more than that."""
PRINTED = 6e-5
"""The recorded positions have four to six digits."""

LEFT = TrackCourse(
    sprocket=(0.0, 0.0), sprocket_radius=0.245, idler=(-3.95, -0.12), idler_radius=0.309, wheel_front=(-0.655, -0.215),
    wheel_rear=(-3.322, -0.215), wheel_radius=0.359,
)  # fmt: skip
RIGHT = dataclasses.replace(LEFT, wheel_front=(-0.740, -0.215), wheel_rear=(-3.407, -0.215))

# Shoe -> centre (x, z) [m]: Project Chrono, M113, single pin (its vehicle stands at x = -60, z = 0.62)
RECORDED = {
    "left": (LEFT, 63, {
        0: (0.0731, -0.2208), 4: (0.0607, 0.224512), 5: (-0.0906, 0.243532), 31: (-4.0841, 0.149739),
        36: (-3.9674, -0.407892), 40: (-3.3656, -0.537184), 58: (-0.5956, -0.554508), 62: (-0.0571, -0.2967),
    }),
    "right": (RIGHT, 64, {
        37: (-3.8164, -0.435808), 41: (-3.2187, -0.574883), 60: (-0.2978, -0.637662), 63: (-0.037, -0.312531),
    }),
}  # fmt: skip


def gaps(pins):
    return np.linalg.norm(np.roll(pins, -1, axis=0) - pins, axis=1)


@pytest.mark.parametrize("side", RECORDED)
def test_a_recorded_chain(side):
    course, shoes, centres = RECORDED[side]
    laid = lay_chain(course, lengths=(PITCH,), shoes=shoes)
    assert laid.pins.shape == (shoes, 2)
    np.testing.assert_allclose(gaps(laid.pins), PITCH, rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(laid.pins[0], (0.0, -0.245), atol=ROUNDING)
    along = np.roll(laid.pins, -1, axis=0) - laid.pins
    np.testing.assert_allclose(along, PITCH * np.stack([np.cos(laid.angles), np.sin(laid.angles)], 1), atol=ROUNDING)
    for shoe, centre in centres.items():
        np.testing.assert_allclose(laid.centres[shoe], centre, atol=PRINTED, err_msg=f"shoe {shoe}")


def random_course(rng):
    """A track of any size whose parts stand clear of each other."""
    size = rng.uniform(0.3, 3.0)
    length = size * rng.uniform(2.0, 6.0)
    sprocket, idler, wheel = (size * rng.uniform(0.15, 0.35) for _ in range(3))
    course = TrackCourse(
        sprocket=(rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)), sprocket_radius=sprocket,
        idler=(0.0, 0.0), idler_radius=idler, wheel_front=(0.0, 0.0), wheel_rear=(0.0, 0.0), wheel_radius=wheel,
    )  # fmt: skip
    x, z = course.sprocket
    low = z - size * rng.uniform(0.4, 0.7)
    return dataclasses.replace(
        course, idler=(x - length, z - size * rng.uniform(0.0, 0.15)),
        wheel_front=(x - 0.2 * length, low), wheel_rear=(x - 0.8 * length, low),
    ), size * rng.uniform(0.05, 0.2)  # fmt: skip


@pytest.mark.parametrize("share", [1.0, 0.65])
@pytest.mark.parametrize("seed", range(20))
def test_any_course_closes_with_the_shoes_that_its_error_asks_for(seed, share):
    """Of shoes with one pin, and of shoes and connectors in turn."""
    course, pitch = random_course(np.random.default_rng(seed))
    lengths = (pitch,) if share == 1.0 else (share * pitch, (1.0 - share) * pitch)
    with pytest.raises(SpecError, match="does not close") as error:
        lay_chain(course, lengths=lengths, shoes=3)
    found = re.search(r"use (\d+) shoes", str(error.value))
    assert found is not None
    shoes = int(found.group(1))
    laid = lay_chain(course, lengths=lengths, shoes=shoes)
    np.testing.assert_allclose(gaps(laid.pins), lengths * shoes, rtol=0.0, atol=ROUNDING)
    with pytest.raises(SpecError, match="does not close"):
        lay_chain(course, lengths=lengths, shoes=shoes - 2)


@pytest.mark.parametrize("seed", range(5))
def test_a_sprocket_behind_is_the_mirror_image(seed):
    course, pitch = random_course(np.random.default_rng(100 + seed))

    def mirrored(point):
        return -point[0], point[1]

    behind = dataclasses.replace(
        course, **{name: mirrored(getattr(course, name)) for name in ("sprocket", "idler", "wheel_front", "wheel_rear")}
    )
    with pytest.raises(SpecError) as error:
        lay_chain(course, lengths=(pitch,), shoes=3)
    shoes = int(re.findall(r"use (\d+) shoes", str(error.value))[0])
    there, here = (lay_chain(each, lengths=(pitch,), shoes=shoes) for each in (course, behind))
    np.testing.assert_allclose(here.pins, there.pins * (-1.0, 1.0), atol=ROUNDING)
    np.testing.assert_allclose(np.cos(here.angles), -np.cos(there.angles), atol=ROUNDING)
    np.testing.assert_allclose(np.sin(here.angles), np.sin(there.angles), atol=ROUNDING)


def test_what_is_missing_is_told():
    """Of 62 shoes on the left, two are left for the way from the last level one, to the second digit after 60."""
    last = lay_chain(LEFT, lengths=(PITCH,), shoes=63).pins[59] + (
        PITCH,
        0.0,
    )  # an odd number is left: one more is level
    missing = math.dist(last, (0.0, -0.245)) - 2 * PITCH
    with pytest.raises(SpecError, match=rf"62 shoes of 0\.154 m does not close, {missing:.4g} m are missing; use 64"):
        lay_chain(LEFT, lengths=(PITCH,), shoes=62)


def test_shoes_that_lie_in_each_other():
    with pytest.raises(SpecError, match=r"80 shoes .* more than the way around, and lie in each other"):
        lay_chain(LEFT, lengths=(PITCH,), shoes=80)


MISTAKES: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "no pitch": ({}, {"lengths": (0.0,)}, "pitch must be > 0 m, got 0"),
    "an endless pitch": ({}, {"lengths": (0.1, math.inf)}, "pitch must be > 0 m, got inf"),
    "two shoes": ({}, {"shoes": 2}, "shoes must be a whole number >= 3, got 2"),
    "half a shoe": ({}, {"shoes": 63.5}, "shoes must be a whole number >= 3, got 63.5"),
    "no sprocket": ({"sprocket_radius": 0.0}, {}, "sprocket_radius must be > 0 m, got 0"),
    "a sunken wheel": ({"wheel_radius": -0.3}, {}, "wheel_radius must be > 0 m, got -0.3"),
    "a small idler": ({"idler_radius": 0.07}, {}, "idler_radius must be more than half the pitch"),
    "an endless track": ({"wheel_front": (math.inf, 0.0)}, {}, "wheel_front must be two finite numbers"),
    "millimetres": ({"idler": (-3950.0, -120.0)}, {}, "the way around takes more than 4000 links"),
    "an idler in the sprocket": ({"idler": (0.0, -1.0)}, {}, "sprocket and idler must not have the same x"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(mistake):
    course, arguments, message = MISTAKES[mistake]
    given: dict[str, Any] = {"lengths": (PITCH,), "shoes": 63, **arguments}
    with pytest.raises(SpecError, match=f"track: {message}"):
        lay_chain(dataclasses.replace(LEFT, **course), **given)
