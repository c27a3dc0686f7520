"""Whole manoeuvres: pass speeds, worlds of a batch, gradients of the bicycle, stops, hills and roads."""

import dataclasses
import math

import numpy as np
import pytest

from simwarp.vehicle.driving.maneuver_spec import FrictionPatch
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver
from simwarp.vehicle.results.results import results
from simwarp.vehicle.results.road import tire_ground
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.results.variants import drive_variants, highest_passed, set_up_variants
from simwarp.vehicle.results.verdicts import passed, verdicts
from simwarp.vehicle.spec.vehicle_files import load_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec

HMMWV, SEDAN, GATOR = (load_vehicle(name) for name in ("hmmwv", "sedan", "gator"))
NEW = tuple(MANEUVERS)[tuple(MANEUVERS).index("iso-3888-1") :]
"""Manoeuvres with verdicts or standards; the earlier ones have tests of their own."""


def driven(spec, name, dt=2e-3, friction=0.9, **options):
    """Results by key, verdicts and the run."""
    what = maneuver(name, spec, **options)
    run = Drive(set_up(spec, what, device="cpu", dt=dt, friction=friction)).run()
    return {item.key: item.value for item in results(run, what)}, verdicts(run, what), run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "name", "speeds"),
    [(HMMWV, "iso-3888-1", (12, 15, 18, 21, 24)), (SEDAN, "iso-3888-2", (10, 13, 16, 19))],
    ids=["hmmwv", "sedan"],
)
def test_slow_runs_pass_and_fast_ones_fail(spec, name, speeds):
    """The table is monotone: what is too fast stays too fast."""
    found = drive_variants(spec, [maneuver(name, spec, speed=float(v)) for v in speeds], device="cpu", dt=2e-3)
    kept = [bool(each.passed) for each in found]
    assert kept == sorted(kept, reverse=True)
    assert kept[0]
    assert not kept[-1]
    assert highest_passed(found) == speeds[sum(kept) - 1]


@pytest.mark.slow
def test_a_world_of_a_batch_is_the_run_alone():
    """Bit by bit, with a start in another gear than its neighbour's."""
    variants = [maneuver("iso-3888-2", SEDAN, speed=v) for v in (4.0, 14.0)]
    batch = drive_variants(SEDAN, variants, device="cpu", dt=2e-3)
    for each, what in zip(batch, variants, strict=True):
        # the driver's law is that of the first variant
        assert what.follow is not None
        assert variants[0].follow is not None
        alike = dataclasses.replace(
            what, follow=dataclasses.replace(what.follow, steering=variants[0].follow.steering)
        )  # fmt: skip
        alone = Drive(set_up(SEDAN, alike, device="cpu", dt=2e-3)).run()
        for name in ("x_m", "y_m", "speed_mps", "engine_radps", "gear"):
            assert np.array_equal(each.run[name][2:], alone[name][2 : len(each.run["t_s"])]), name


@pytest.mark.slow
def test_a_world_that_diverges_is_marked_and_the_others_go_on():
    variants = [maneuver("iso-3888-1", GATOR, speed=v, duration=1.0) for v in (5.0, 6.0, 7.0)]
    setup = set_up_variants(GATOR, variants, device="cpu", dt=2e-3)
    velocity = setup.simulation.state.body_v.numpy()
    velocity[1] = np.nan
    setup.simulation.state.body_v.assign(velocity)
    from simwarp.vehicle.results.variants import outcomes

    drive = Drive(setup, worlds=slice(0, 3))
    drive.run()
    found = outcomes(drive, variants)
    assert [each.broken for each in found] == [False, True, False]
    assert found[1].passed is False
    assert found[2].run["x_m"][-1] == pytest.approx(7.0 * 3.0, rel=0.05)


def test_variants_must_be_alike():
    with pytest.raises(SpecError, match="must be one or more, got none"):
        set_up_variants(SEDAN, [])
    with pytest.raises(SpecError, match="must have a driver on a path, got a script"):
        set_up_variants(SEDAN, [maneuver("acceleration", SEDAN)])
    with pytest.raises(SpecError, match=r"number 1 \(split-braking\): must have the name of the first one"):
        set_up_variants(SEDAN, [maneuver("braking", SEDAN), maneuver("split-braking", SEDAN)])


def cornering_stiffness(spec: VehicleSpec, axle: int, load: float) -> float:
    """Of both TMeasy tires of an axle at small slip [N/rad], each under half the load: Rill's parabola through 0, the
    slope at the nominal load and that at twice the nominal load.
    """
    parameters = spec.axles[axle].tire.parameters
    from simwarp.vehicle.tires.parameter_vector import tire_vector
    from simwarp.vehicle.tires.parameter_vector_kernels import Common, Tmeasy

    vector = tire_vector(spec.axles[axle].tire).values
    nominal = vector[Tmeasy.NOMINAL_LOAD]
    one, two = vector[Tmeasy.SLOPE_Y], vector[Tmeasy.SLOPE_Y + 1]
    share = 0.5 * load / nominal
    assert parameters
    assert Common.STIFFNESS >= 0
    return float(2.0 * share * (2.0 * one - 0.5 * two - (one - 0.5 * two) * share))


@pytest.mark.slow
def test_the_understeer_gradient_is_near_that_of_the_bicycle():
    """Without load transfer, roll steer and camber: a second computation from weights and tires alone."""
    found, _, run = driven(SEDAN, "slow-steer", speed=15.0, steering=0.2)
    still = run["t_s"] < -0.5
    front, rear = (sum(float(run[f"Fz_{end}{side}_N"][still].mean()) for side in "LR") for end in "FR")
    stiff = [cornering_stiffness(SEDAN, axle, load) for axle, load in ((0, front), (1, rear))]
    bicycle = (front / stiff[0] - rear / stiff[1]) / 9.81
    # camber and toe change with roll: their angles are of the order of the roll, 5e-3 rad per m/s², times 0.2
    assert found["understeer_gradient"] == pytest.approx(bicycle, abs=1.0e-3)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.9, 0.4])
def test_a_stop_takes_what_friction_allows(friction):
    """v² / (2 mu g) with the friction that the tires make of the road's; locked wheels slide below their peak."""
    found, judged, _ = driven(HMMWV, "braking", speed=15.0, friction=friction)
    ideal = found["braking_from"] ** 2 / (2.0 * friction * 9.81)
    # between the grip at the peak (a little above the nominal) and sliding tires, and 0.1 s of the foot's way
    assert 0.8 * ideal < found["stopping_distance"] < 1.6 * ideal + 1.5
    assert passed(judged) is True


@pytest.mark.slow
def test_split_friction_turns_towards_the_side_that_grips():
    """The left side slides on a third of the friction: the vehicle turns to the right, and stops later than on one."""
    split, _, run = driven(SEDAN, "split-braking", speed=12.0)
    assert split["yaw_after_1_s"] < -1.0
    even, _, _ = driven(SEDAN, "split-braking", speed=12.0, left=1.0)
    assert abs(even["yaw_deviation"]) < 1.0
    assert split["mean_deceleration"] < 0.9 * even["mean_deceleration"]
    assert run["t_s"][0] == pytest.approx(-2.0)


@pytest.mark.slow
def test_a_hill_is_held_and_left_upwards():
    for spec in (SEDAN, GATOR):
        found, judged, _ = driven(spec, "hill-start", slope=0.1)
        assert found["creep"] < 1.0
        assert passed(judged) is True
    steep, judged, _ = driven(SEDAN, "hill-start", slope=0.1, friction=0.05)
    assert steep["creep"] > 100.0
    assert passed(judged) is False


@pytest.mark.slow
def test_a_higher_bump_throws_more():
    low, high = (driven(SEDAN, "bump", height=height)[0] for height in (0.01, 0.04))
    assert high["peak_up"] > 1.5 * low["peak_up"]
    assert high["front_load"] > low["front_load"] > 1.0
    flat = driven(SEDAN, "bump", height=0.0)[0]
    assert flat["pitch_range"] < 0.3 * low["pitch_range"]


def test_patches_of_friction_are_where_they_were_laid():
    what = dataclasses.replace(
        maneuver("braking", SEDAN),
        patches=(FrictionPatch(x=(10.0, 20.0), y=(0.0, 5.0), factor=0.3), FrictionPatch(x=(12.0, 13.0), y=(0.0, 1.0),
                                                                                      factor=0.1)),
    )  # fmt: skip
    terrain = tire_ground(what, "cpu", np.array([0.0, 0.0, 0.0, 1.0]), -1)
    factors, origin, cell = terrain.friction_map.numpy(), terrain.friction_origin, terrain.friction_cell

    def factor(x, y):
        column, row = (math.floor((p - float(o)) / float(c)) for p, o, c in zip((x, y), origin, cell, strict=True))
        rows, columns = factors.shape
        return factors[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)]

    assert factor(15.0, 2.0) == pytest.approx(0.3)
    assert factor(12.5, 0.5) == pytest.approx(0.1)
    for x, y in ((9.9, 2.0), (20.1, 2.0), (15.0, -0.1), (15.0, 5.1), (0.0, 0.0), (500.0, 0.5)):
        assert factor(x, y) == 1.0, (x, y)


def test_roads_of_patches_and_bumps_need_tires_that_read_them():
    rigid = dataclasses.replace(SEDAN, axles=tuple(
        dataclasses.replace(axle, tire=dataclasses.replace(axle.tire, template="rigid", parameters={}))
        for axle in SEDAN.axles
    ))  # fmt: skip
    with pytest.raises(SpecError, match="split-braking: must be driven on tires that are force laws, got rigid"):
        set_up(rigid, maneuver("split-braking", rigid), device="cpu")


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", vehicle_names())
@pytest.mark.parametrize("name", NEW)
def test_every_vehicle_drives_every_manoeuvre(vehicle, name):
    """To its end, with finite positions and some result of its own."""
    spec = load_vehicle(vehicle)
    found, _, run = driven(spec, name, dt=1e-3 if vehicle == "artcar" else 2e-3)
    assert np.isfinite(run["x_m"]).all()
    assert run["t_s"][-1] == pytest.approx(maneuver(name, spec).duration, abs=0.011)
    assert len(found) > 4
