"""Verdicts on vehicles of files: every rule finds what breaks it, and the bicycle is that of the books."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from scripts.chrono_fleet import verdict
from scripts.chrono_fleet_driving import GRAVITY, PROBE, Driven, Turn, bicycle_curvature
from simwarp.vehicle.rigs.tire_rig import tire_forces
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle

CRAWL = Turn(speed=3.0, curvature=0.03, bicycle=0.031, wheels=0.031, bias=0.0, tightest=(0.12, 0.12))
FAST = Turn(speed=12.0, curvature=0.0135, bicycle=0.014, wheels=0.015, bias=0.0, tightest=(0.0135, 0.0135))
DRIVEN = Driven(
    weight=20000.0, loads=np.array([5500.0, 5500.0, 4500.0, 4500.0]), tilt=0.01, moving=1e-4, reached=20.0,
    sideways=0.01, crawl=CRAWL, turn=FAST, braked_from=12.0, stopping=9.0, brake_limit=5.0,
)  # fmt: skip


def changed(**fields: Any) -> Driven:
    """A vehicle that drives otherwise; fields of a turn in a dict."""
    turns = {name: dataclasses.replace(getattr(DRIVEN, name), **value) for name, value in fields.items()
             if name in ("crawl", "turn")}  # fmt: skip
    return dataclasses.replace(DRIVEN, **(fields | turns))


def test_a_plausible_vehicle_has_no_faults():
    assert DRIVEN.faults() == []
    assert DRIVEN.understeer == pytest.approx(0.1)
    assert DRIVEN.little_steering == ""


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"loads": np.array([5500.0, 5500.0, 4500.0, 4400.0])}, "its tires bear 0.9950 of the weight"),
        ({"loads": np.array([10000.0, 10000.0, 0.0, 0.0])}, "a wheel hangs in the air"),
        ({"tilt": 0.1}, "it stands 5.7° out of level"),
        ({"moving": 0.05}, "it moves by 0.05 m/s at rest"),
        ({"reached": 0.6}, "full throttle for 15 s takes it to 0.6 m/s"),
        ({"reached": 200.0}, "full throttle for 15 s takes it to 2e+02 m/s"),
        ({"reached": np.nan}, "full throttle for 15 s takes it to nan m/s"),
        ({"sideways": 0.2}, "it drifts 20% sideways under throttle"),
        ({"crawl": {"curvature": -0.03}}, "steered to the left it turns to the right at a crawl"),
        ({"crawl": {"curvature": 0.02}}, "it turns by 0.65 of what its wheels' headings ask for at a crawl"),
        ({"turn": {"curvature": np.nan}}, "steered to the left it turns to the right at speed"),
        ({"turn": {"bicycle": np.nan}}, "it turns by nan of what its wheels' headings ask for at speed"),
        ({"crawl": {"bias": 0.02}}, "it turns by 0.0200/m with straight steering at a crawl"),
        ({"turn": {"wheels": 0.0135 * 0.98, "bicycle": 0.0128}}, "understeer has the wrong sign: -0.02 for 0.03"),
        ({"stopping": np.inf}, "it does not stop"),
        ({"stopping": 5.0}, "it stops in 5.0 m, sooner than friction allows"),
        ({"stopping": 20.0}, "it stops in 20.0 m, 14.4 m would do"),
    ],
)  # fmt: skip
def test_every_rule_finds_what_breaks_it(fields, fault):
    assert fault in changed(**fields).faults()


@pytest.mark.parametrize(
    ("tightest", "text"),
    [((0.1, 0.02), "steers little to the right"), ((-0.001, 0.1), "steers little to the left"),
     ((0.02, 0.03), "steers little"), ((0.04, 0.04), "")],
)  # fmt: skip
def test_wide_circles_are_named_by_side(tightest, text):
    assert changed(crawl={"tightest": tightest}).little_steering == text
    assert verdict(changed(crawl={"tightest": tightest})) == (f"yes, but {text}" if text else "yes")


def test_a_verdict_is_the_first_fault():
    assert verdict(changed(tilt=0.1, moving=0.05)) == "no: it stands 5.7° out of level"
    assert verdict(None) == "no"


@pytest.mark.parametrize("loads", [(5500.0, 4500.0), (4500.0, 5500.0)])
def test_the_bicycle_of_two_axles_is_that_of_the_books(loads):
    """Curvature δ / (L + K v²) with K = m (b / C_f - a / C_r) / L; a and b are where the forces act, behind the wheels
    by their trails, and L between them.
    """
    spec = with_options(load_vehicle("hmmwv"), tire="tmeasy")
    wheels = np.repeat(loads, 2)
    front = 2.5 * loads[1] / sum(loads)
    ahead = np.array([front, front, front - 2.5, front - 2.5])
    heading = np.array([0.02, 0.02, 0.0, 0.0])
    speed, mass = 12.0, wheels.sum() / GRAVITY
    probes = [tire_forces(spec.axles[0].tire, slip_angle=PROBE, load=load, speed=speed, friction=0.9) for load in loads]
    stiffness = [2.0 * abs(float(probe.fy)) / PROBE for probe in probes]
    trail = [abs(float(probe.mz) / float(probe.fy)) for probe in probes]
    # moments about the centre of mass: forces act at a' = a - trail ahead of it and at b' = b + trail behind it
    a, b = front - trail[0], 2.5 - front + trail[1]
    force = mass * speed**2  # per curvature, shared by the levers: slip of an axle is force times share over stiffness
    slip = [force * b / (a + b) / stiffness[0], force * a / (a + b) / stiffness[1]]
    expected = 0.02 / (2.5 + slip[0] - slip[1])
    assert bicycle_curvature(spec, wheels, ahead, heading, speed, 0.9) == pytest.approx(expected, rel=1e-6)
    # at a crawl its axles alone count, wherever the forces act
    assert bicycle_curvature(spec, wheels, ahead, heading, 0.0, 0.9) == pytest.approx(0.02 / 2.5, rel=1e-6)


def test_a_vehicle_on_two_wheels_has_no_bicycle():
    spec = load_vehicle("hmmwv")
    loads = np.array([9000.0, 0.0, 9000.0, 0.0])
    assert np.isnan(bicycle_curvature(spec, loads, np.zeros(4), np.zeros(4), 5.0, 0.9))
