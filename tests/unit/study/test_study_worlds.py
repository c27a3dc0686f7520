"""Worlds of a study against their runs alone, for every kind of number that a vehicle's file has."""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from simwarp.core.threads import default_threads
from simwarp.study import world_runs
from simwarp.study.monte_carlo import MonteCarlo
from simwarp.study.study_error import StudyError
from simwarp.study.varied_vehicle import friction_of, maneuver_of, spec_of, varied_vehicle
from simwarp.study.world_runs import WorldRuns
from simwarp.vehicle.assessment.maneuver_variants import Outcome
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle

DT = 2e-3
SHORT = {"speed": 14.0, "duration": 0.4}
"""Two seconds of rolling and the entry of ISO 3888-2."""
BESIDE = (
    "chassis.components[0].mass=1400..1700",
    "chassis.components[0].inertia[1]=-5%..20%",
    "axles[*].suspension.springs[0].stiffness=-20%..20%",
    "axles[0].suspension.springs[1].damping=5000..20000",
    "axles[1].suspension.springs[0].rest_length=-1%..1%",
    "axles[*].suspension.upright.mass=1..2",
    "axles[*].suspension.tierod_chassis[1]=-0.5%..0.5%",
    "axles[*].wheel.mass=10..20",
    "axles[*].tire.parameters.slope_y=-10%..10%",
    "axles[*].tire.radius=-1%..1%",
    "ground.friction=0.5..1",
    "maneuver.speed=12,14,16",
)
"""Numbers in which worlds of one simulation differ."""
ALONE = (
    "chassis.components[0].com[2]=0.5..0.8",
    "steerings[0].steering.max_angle=-20%..20%",
    "axles[*].brake.max_torque=1000..4000",
)
"""Numbers that worlds of one simulation share."""
REDUCED_BESIDE = (
    "chassis.components[0].inertia[1]=-5%..20%",
    "axles[*].tire.parameters.slope_y=-10%..10%",
    "axles[0].tire.radius=-1%..1%",
    "ground.friction=0.5..1",
    "maneuver.speed=10,11,12",
)
"""The same of a vehicle whose suspensions are tables, which all worlds share,"""
REDUCED_ALONE = (
    "chassis.components[0].mass=2000..2800",
    "axles[0].suspension.left.mass=-10%..10%",
    "axles[*].tire.mass=-10%..10%",
    "axles[1].tire.inertia[1]=-10%..10%",
    "driveline.driveshaft_inertia=-20%..20%",
)
"""and what acts on them."""


def sedan(*texts, options=SHORT):
    return varied_vehicle(load_vehicle("sedan"), "iso-3888-2", texts, options=options, friction=0.9)


def reduced(*texts):
    return varied_vehicle(
        load_vehicle("hmmwv-14dof"), "iso-3888-2", texts, options={"speed": 12.0, "duration": 0.4}, friction=0.9
    )


def driven(runs: WorldRuns, documents: Sequence[Any]) -> list[Outcome]:
    """What worlds came to, none of which is without a vehicle."""
    found = runs.run(documents)
    assert all(isinstance(each, Outcome) for each in found)
    return [each for each in found if isinstance(each, Outcome)]


def columns(run):
    return np.stack(list(run.columns.values()))


def run_alone(document):
    spec = spec_of(document)
    what = maneuver_of("iso-3888-2", spec, document)
    return Drive(set_up(spec, what, device="cpu", dt=DT, friction=friction_of(document))).run()


def check_worlds(vehicle, in_one):
    """Both ends of a key in one batch, and each as the vehicle's own file would be driven."""
    (key,) = vehicle.keys
    documents = [vehicle.changed(vehicle.drawn([share])) for share in (0.0, 1.0)]
    runs = WorldRuns(vehicle=vehicle, dt=DT, device="cpu")
    built = {index: runs._built(document) for index, document in enumerate(documents)}
    parts = list(runs._parts(built))
    assert (len(parts) == 1) == in_one
    found = driven(runs, documents)
    assert not np.array_equal(columns(found[0].run), columns(found[1].run)), key.name
    for document, outcome in zip(documents, found, strict=True):
        alone = run_alone(document)
        length = len(outcome.run["t_s"])
        assert length >= 238
        assert np.array_equal(columns(outcome.run), columns(alone)[:, :length]), key.name


@pytest.mark.slow
@pytest.mark.parametrize("text", BESIDE)
def test_a_world_is_its_own_run_bit_by_bit(text):
    check_worlds(sedan(text), in_one=True)


@pytest.mark.slow
@pytest.mark.parametrize("text", ALONE)
def test_what_worlds_share_is_driven_alone_and_is_its_own_run(text):
    check_worlds(sedan(text), in_one=False)


@pytest.mark.quick("maneuver.speed=10,11,12")
@pytest.mark.parametrize("text", REDUCED_BESIDE)
def test_a_reduced_world_is_its_own_run_bit_by_bit(text):
    check_worlds(reduced(text), in_one=True)


@pytest.mark.quick("axles[*].tire.mass=-10%..10%")
@pytest.mark.parametrize("text", REDUCED_ALONE)
def test_what_the_tables_of_a_reduced_vehicle_hold_is_driven_alone(text):
    check_worlds(reduced(text), in_one=False)


def test_a_mass_and_a_friction_are_a_world_of_one_simulation():
    """The quick one of the above: two keys at once."""
    vehicle = sedan(BESIDE[0], "ground.friction=0.5..1", options={"speed": 14.0, "duration": 0.1})
    documents = [vehicle.changed(vehicle.drawn(shares)) for shares in ([0.1, 0.7], [0.9, 0.2])]
    found = driven(WorldRuns(vehicle=vehicle, dt=DT, device="cpu"), documents)
    for document, outcome in zip(documents, found, strict=True):
        length = len(outcome.run["t_s"])
        assert np.array_equal(columns(outcome.run), columns(run_alone(document))[:, :length])


def rows(vehicle, worlds=7, seed=1, batch=None):
    study = MonteCarlo(vehicle, worlds=worlds, seed=seed, dt=DT, device="cpu", batch=batch)
    study.drive_nominal()
    *_, result = study.steps()
    return result.rows


@pytest.mark.slow
def test_rows_do_not_depend_on_batches_and_threads():
    vehicle = sedan(BESIDE[0], ALONE[0], options={"speed": 14.0, "duration": 0.2})
    together = rows(vehicle)
    assert [row.world for row in together] == list(range(7))
    assert repr(rows(vehicle, batch=3)) == repr(together)
    assert repr(rows(vehicle, worlds=5)) == repr(together[:5])
    with default_threads(2):
        assert repr(rows(vehicle)) == repr(together)
    assert repr(rows(vehicle, seed=2)) != repr(together)


@pytest.mark.slow
def test_quantiles_of_a_monotone_figure_are_single_runs():
    """Of 21 worlds 5, 50 and 95 % are worlds themselves: those of the 2nd, 11th and 20th smallest friction."""
    spec = load_vehicle("sedan")
    vehicle = varied_vehicle(
        spec, "braking", ["ground.friction=0.05..0.2"], options={"speed": 6.0, "duration": 1.0}, friction=0.9
    )
    study = MonteCarlo(vehicle, worlds=21, seed=0, dt=DT, device="cpu")
    study.drive_nominal()
    *_, result = study.steps()
    summary = next(each for each in result.summaries() if each.figure.key == "final_speed")
    assert summary.correlations == pytest.approx((-1.0,))
    drawn = np.sort([row.values[0] for row in result.rows])
    for part, index in ((5, 1), (50, 10), (95, 19)):
        (alone,) = driven(study.runs, [vehicle.changed([drawn[::-1][index]])])
        value = next(item.value for item in alone.results if item.key == "final_speed")
        # interpolated at a place that is a whole number but for rounding
        assert summary.quantiles[part] == pytest.approx(value, rel=1e-12)


def test_a_world_that_diverges_or_cannot_be_built_is_marked_and_counted(monkeypatch):
    vehicle = sedan("chassis.components[0].mass=1400..1700", options={"speed": 14.0, "duration": 0.1})
    study = MonteCarlo(vehicle, worlds=3, seed=0, dt=DT, device="cpu")
    study.drive_nominal()
    real, count = world_runs.outcomes, itertools.count()

    def second_diverges(drive, variants):
        return [dataclasses.replace(each, broken=next(count) == 1) for each in real(drive, variants)]

    monkeypatch.setattr(world_runs, "outcomes", second_diverges)
    changed, third = type(vehicle).changed, rows_drawn(study)[2]
    monkeypatch.setattr(
        type(vehicle), "changed",
        lambda self, values: changed(self, [-1.0]) if values == third else changed(self, values),
    )  # fmt: skip
    *_, result = study.steps()
    assert [row.sound for row in result.rows] == [True, False, False]
    assert result.rows[1].trouble.startswith("diverged at ")
    assert "mass" in result.rows[2].trouble
    passes = result.passes()
    assert passes is not None
    good, of, _ = passes
    assert of == 3
    assert good <= 1
    assert all(each.count <= 1 for each in result.summaries())


def rows_drawn(study):
    from simwarp.study.draws import drawn_worlds

    return drawn_worlds(study.vehicle, study.seed, 0, study.worlds)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("axles[0].antiroll_bar.stiffness=1..2", "unknown"),
        ("chasis.components[0].mass=1..2", "did you mean chassis.components[0].mass"),
        ("chassis.components[0].mass=-5..1500", "-5: chassis.components[0].mass: must be"),
        ("chassis.components[0].mass=-150%..0%", "mass: must be"),
        ("axles[*].suspension.springs[0].stiffness=-200%..0%", "stiffness: must be"),
        ("ground.friction=0..1", "friction: must be"),
        ("maneuver.speed=-3..12", "speed"),
        ("maneuver.radius=1..2", "unknown"),
        ("axles[0].suspension=1..2", "must be a number or a table"),
        ("axles[0].tire.parameters.slope_y=1..2", "is a table, which takes changes in %"),
        ("axles[0].location[1]=-10%..10%", "a factor of 0 is 0"),
        ("maneuver.duration=-10%..10%", "needs a value"),
        ("mass", "must be KEY=LOW..HIGH"),
        ("=1..2", "must be KEY=LOW..HIGH"),
    ],
)
def test_keys_that_cannot_be_varied_are_refused_in_one_line(text, said):
    with pytest.raises(StudyError, match=r"^--vary") as error:
        sedan(text, options={"speed": 14.0})
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_number_is_varied_once():
    with pytest.raises(StudyError, match="already"):
        sedan("axles[*].wheel.mass=1..2", "axles[1].wheel.mass=12..13")


def test_numbers_are_values_and_changes_in_per_cent_are_factors():
    vehicle = sedan("chassis.components[0].mass=1400..1700", "axles[*].wheel.mass=10..20", "axles[0].tire.mass=0%..10%",
                    "axles[*].suspension.springs[0].rest_length=0.5..0.6")  # fmt: skip
    assert [key.factor for key in vehicle.keys] == [False, False, True, False]
    # of numbers that differ there is no one value as built
    assert vehicle.nominal()[:3] == (1550.0, 13.2, 1.0)
    assert math.isnan(vehicle.nominal()[3])
    changed = vehicle.changed((1600.0, 15.0, 1.1, None))
    assert changed["chassis"]["components"][0]["mass"] == 1600.0
    assert [axle["wheel"]["mass"] for axle in changed["axles"]] == [15.0, 15.0]
    assert [axle["tire"]["mass"] for axle in changed["axles"]] == pytest.approx([1.1 * 11.5, 11.5])
    lengths = [axle["suspension"]["springs"][0]["rest_length"] for axle in changed["axles"]]
    assert lengths == [0.52648, 0.52585]
    assert vehicle.document["axles"][0]["wheel"]["mass"] == 13.2
