"""Pictures of vehicles that have no body of their own: their links are where the description has them."""

import dataclasses
import typing

import numpy as np
import pytest

import simwarp as sw
from simwarp.scenery.suspension_visuals import LINKS, UPRIGHTS, BarKind, add_suspension_visuals, suspension_bars
from simwarp.sensors.scene import Visuals
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension
from simwarp.vehicle.spec.vehicle_spec import PinnedAxle, RigidSuspension, Suspension
from tests.physics.sample_vehicles import shipped

NAMES = ("hmmwv", "hmmwv-reduced", "sedan", "gator", "artcar", "skid-steer")
TEMPLATES = typing.get_args(typing.get_args(Suspension)[0])


def test_every_template_with_links_is_drawn():
    linkless = {RigidSuspension, PinnedAxle, TabulatedSuspension}
    assert set(LINKS) == set(TEMPLATES) - linkless
    for table in (LINKS, UPRIGHTS):
        for template, names in table.items():
            fields = {field.name for field in dataclasses.fields(template)} | {"spindle"}
            assert {each for name in names for each in ((name,) if isinstance(name, str) else name)} <= fields


@pytest.mark.parametrize("name", NAMES)
def test_bars_are_mirrored_and_reach_the_wheels(name):
    for axle in shipped(name).axles:
        bars = suspension_bars(axle)
        ends = np.array([[bar.start, bar.end] for bar in bars])
        hub = np.add(axle.location, axle.suspension.spindle.com)
        assert np.linalg.norm(ends - hub, axis=2).min() == pytest.approx(0.0, abs=1e-12)
        # mirrored: for every point of the left side there is one of the right side
        points, other = ends.reshape(-1, 3), ends.reshape(-1, 3) * (1.0, -1.0, 1.0)
        away = np.linalg.norm(points[:, None] - other, axis=2).min(axis=1)
        assert away.max() == pytest.approx(0.0, abs=1e-12)
        springs = sum(bar.kind is BarKind.SPRING for bar in bars)
        assert springs == 2 * len(getattr(axle.suspension, "springs", ()))


def test_capsules_end_at_the_hardpoints():
    spec = dataclasses.replace(shipped("hmmwv"), name="truck")
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec)
    visuals = Visuals(builder)
    found = [visuals.instances[index] for index in add_suspension_visuals(visuals, parts)]
    bars = [bar for axle in spec.axles for bar in suspension_bars(axle)]
    assert len(found) == len(bars)
    assert {each.body for each in found} == {parts.chassis}
    for each, bar in zip(found, bars, strict=True):
        middle = parts.reference + 0.5 * (bar.start + bar.end)
        np.testing.assert_allclose(each.pose.position, middle, atol=1e-12)
