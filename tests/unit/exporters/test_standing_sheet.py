"""A vehicle as built beside the vehicle at rest: numbers of the table against the model, and what is said first."""

import dataclasses
import functools
import math

import numpy as np
import pytest

from simwarp.exporters.standing_sheet import standing_notes, standing_sheet
from simwarp.exporters.vehicle_sheet import TIRE_UNITS, tire_unit, vehicle_sheet
from simwarp.vehicle.rigs.spring_rates import rate_range, spring_rate, without_stops
from simwarp.vehicle.spec.parts import BUMP_STOP, ForceLine
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.stances import AxleStance, LineStance, Stance, stance
from simwarp.vehicle.tires import tire_parameters
from tests.physics.sample_vehicles import shipped

GRAVITY = 9.81
WITHOUT_UNIT = {
    "reference_friction", "rolling_resistance", "load_index", "design_pressure", "use_pressure", "damping_ratio",
    "friction_sliding", "friction_static", "mode", "argument_limit", "kinetic_friction", "static_friction", "carry_off",
    "disc_count", "friction", "restitution", "poisson", "squareness", "around", "across",
}  # fmt: skip


def axle_stance(travel=0.0, ride_height=0.5, lines=()) -> AxleStance:
    return AxleStance(
        ride_height=ride_height, travel=travel, toe=0.01, camber=-0.02, track=1.7, load=5000.0, side_force=0.0,
        tierod=None, lines=tuple(lines),
    )  # fmt: skip


def hmmwv_stance(travel=0.0) -> Stance:
    lines = [LineStance(length=0.29, free_length=0.34, force=1e4, stop="", into_stop=0.0)] * 2
    stopped = LineStance(length=0.3564, free_length=0.382, force=1e4, stop="rebound", into_stop=0.0064)
    axles = (axle_stance(travel, 0.48, lines), axle_stance(travel, 0.48, (stopped, lines[1])))
    return Stance(height=0.48, pitch=0.0, wheelbase=3.3, com_height=0.65, axles=axles)


@functools.cache
def table(travel: float) -> dict[str, tuple[str, str, str]]:
    rows = standing_sheet(load_vehicle("hmmwv"), hmmwv_stance(travel))
    return {row.label: (row.built, row.standing, row.unit) for row in rows}


def test_the_design_height_is_that_of_wheels_in_their_places():
    assert table(-0.1)["axle 0: frame above the ground"] == ("0.3800", "0.4800", "m")
    assert table(-0.1)["axle 0: wheels above their place in the frame"] == ("0.0", "-100.0", "mm")
    # the frame of the design is lower by the travel everywhere, and so is the centre of mass in it
    heights = [float(table(travel)["centre of mass above the ground"][0]) for travel in (0.0, -0.1)]
    assert heights[0] - heights[1] == pytest.approx(0.1, abs=1.1e-4)  # two numbers of four digits


def test_angles_and_distances_stand_beside_each_other_with_units():
    found = table(0.0)
    assert found["axle 1: toe, positive inwards"] == ("0.00", f"{math.degrees(0.01):.2f}", "°")
    assert found["axle 1: camber, positive outwards"][1:] == (f"{math.degrees(-0.02):.2f}", "°")
    assert found["axle 1: track"] == ("1.8194", "1.7000", "m")
    assert found["wheelbase"] == ("3.3020", "3.3000", "m")
    assert all(unit for _, _, unit in found.values())


@pytest.mark.slow
def test_a_vehicle_that_was_trimmed_stands_as_it_is_built():
    spec = shipped("sedan")
    for row in standing_sheet(spec, stance(spec)):
        if row.built:
            # it stands 0.05 mm and 0.002° from its design, and numbers are rounded
            away = {"m": 2e-4, "mm": 0.11, "°": 0.011}[row.unit]
            assert float(row.standing) == pytest.approx(float(row.built), abs=away), row.label


@pytest.mark.parametrize(("travel", "word"), [(0.1, "100 mm lower"), (-0.1, "100 mm higher")])
def test_a_vehicle_far_from_its_design_says_so(travel, word):
    notes = standing_notes(load_vehicle("hmmwv"), hmmwv_stance(travel))
    assert sum(word in note for note in notes) == 2
    assert any("spring 0 of axle 1 is 6.4 mm in its rebound stop" in note for note in notes)


def test_one_at_its_design_says_nothing_of_it():
    assert not any("description builds it" in note for note in standing_notes(load_vehicle("hmmwv"), hmmwv_stance()))


def test_a_curve_has_a_rate_where_the_spring_stands():
    front, rear = (
        {fact.label: (fact.value, fact.unit) for fact in section.facts}
        for section in vehicle_sheet(load_vehicle("hmmwv"), hmmwv_stance())
        if section.title.startswith("Axle")
    )
    # between two points of the curve: 8991.945 N at -40 mm, 17818.165 N at -60 mm
    value, unit = front["spring 0: rate at rest, 290.0 mm long"]
    assert (float(value), unit) == (pytest.approx((17818.165 - 8991.945) / 20.0, rel=1e-4), "N/mm")
    # 6.4 mm in a stop of 100 N/mm
    bare, stopped = (float(rear[f"spring 0: {text}"][0]) for text in (
        "rate at rest, 356.4 mm long", "the same with its rebound stop, 6.4 mm in"))  # fmt: skip
    assert stopped - bare == pytest.approx(100.0, abs=0.05)
    assert rear["spring 0: rates between its stops"][1] == "N/mm"
    built = {fact.label for section in vehicle_sheet(load_vehicle("hmmwv")) for fact in section.facts}
    assert any(label.startswith("spring 0: rate as built") for label in built)


def test_rates_are_slopes_between_the_stops():
    points = tuple((x, 1e4 * x + 1e6 * x**3) for x in np.linspace(-0.1, 0.1, 21).tolist())
    line = ForceLine(
        chassis_point=(0.0, 0.0, 0.5), arm_point=(0.0, 0.0, 0.0), rest_length=0.5, spring_curve=points,
        min_length=0.45, max_length=0.55, bump_curve=BUMP_STOP,
    )  # fmt: skip
    low, high = rate_range(line)
    # secants of a cubic over 10 mm about 0 and at 45 mm
    assert (low, high) == (pytest.approx(1e4 + 1e6 * 1e-4), pytest.approx(1e4 + 1e6 * (0.05**3 - 0.04**3) / 0.01))
    assert spring_rate(line, 0.444) - spring_rate(without_stops(line), 0.444) == pytest.approx(1e5, rel=1e-6)
    straight = dataclasses.replace(line, spring_curve=None, stiffness=3e4)
    assert rate_range(straight) == (3e4, 3e4)
    assert spring_rate(straight, 0.5) == pytest.approx(3e4, rel=1e-6)


def test_every_number_of_a_tire_has_its_unit():
    """Of all parameters that are one number: a unit, or it is known to have none."""
    numbers = ("Positive", "NotNegative", "float", "int")
    for kind in vars(tire_parameters).values():
        if not (dataclasses.is_dataclass(kind) and kind.__module__ == tire_parameters.__name__):
            continue
        for field in dataclasses.fields(kind):
            plain = str(field.type).removesuffix(" | None")
            if plain in numbers or plain.startswith("Annotated[int"):
                assert ("", field.name) in TIRE_UNITS or field.name in WITHOUT_UNIT, field.name
    assert (tire_unit("tmeasy", "load"), tire_unit("fiala", "rolling_resistance")) == ("N", "m")
    assert tire_unit("tmeasy", "rolling_resistance") == ""
