"""Vehicles as targets: what worlds may differ in, what they share, and a fit of the same vehicle without noise."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.identify import Fit, FitError, fit_config
from simwarp.identify.document_numbers import replaced, value_at
from simwarp.identify.fit_config import of_target
from simwarp.identify.fitted_parameters import FittedParameters
from simwarp.identify.segments import Segment, start_values
from simwarp.identify.vehicle_target import VehicleTarget
from simwarp.identify.world_numbers import World

BASE = {
    "target": "hmmwv-reduced", "dt": 0.002, "runs": [{"file": "log.npz"}], "readings": {"speed_mps": {}},
    "parameters": {"chassis.components[0].mass": {}},
}  # fmt: skip


@pytest.fixture(scope="module")
def target():
    return VehicleTarget(dataclasses.replace(of_target("hmmwv-reduced"), dt=0.002), "cpu", 1)


@pytest.fixture(scope="module")
def full():
    return VehicleTarget(dataclasses.replace(of_target("hmmwv"), dt=0.002), "cpu", 1)


def changed(target, parameters, vector):
    config = fit_config({**BASE, "parameters": parameters})
    return FittedParameters(config, target.document).changed(np.array(vector))


def different(target, parameters, vector):
    base = target.numbers(target.document, {})
    return base.different(target.numbers(changed(target, parameters, vector), {}))


@pytest.mark.parametrize(
    ("path", "vector", "wanted"),
    [
        ("chassis.components[0].mass", [2500.0], {"body_mass"}),
        ("axles[*].suspension.springs[0].stiffness", [1.2], {"joint_stiffness"}),
        ("ground.friction", [0.5], {"friction"}),
        ("axles[0].tire.parameters.slope_y", [0.8], {"tires"}),
        ("engine.torque", [1.2], {"gain"}),
        # brakes are dry friction, which inputs write anew in every step
        ("axles[*].brake.max_torque", [0.8], {"gain", "joint_friction"}),
    ],
)
def test_a_number_of_the_file_changes_what_it_stands_for(target, path, vector, wanted):
    assert different(target, {path: {}}, vector) == wanted


def test_a_centre_of_mass_takes_the_frame_of_reference_along(target):
    found = different(target, {"chassis.components[0].com[0]": {}}, [0.2])
    assert {"reference", "joint_anchor0"} <= found
    moved = target.numbers(changed(target, {"chassis.components[0].com[0]": {}}, [0.2]), {})
    before = target.numbers(target.document, {})
    # the frame of reference stays where it is on the chassis: 0.144 m further behind its centre of mass
    assert moved.others["reference"][0] - before.others["reference"][0] == pytest.approx(0.056 - 0.2)


def test_factors_of_what_worlds_share_are_gains_of_inputs(target):
    parameters: dict[str, Any] = {"engine.torque": {}, "axles[*].brake.max_torque": {}}
    gains = target.numbers(changed(target, parameters, [1.25, 0.5]), {}).others["gain"]
    np.testing.assert_allclose(gains, [1.0, 1.25, 0.5])


def test_a_factor_of_a_table_is_one_of_its_efforts(full):
    path, stop = (f"axles[0].suspension.springs[0].{name}" for name in ("spring_curve", "bump_curve"))
    before = full.numbers(full.document, {}).parameters["joint_stiffness"]
    after = full.numbers(changed(full, {path: {"also": [stop]}}, [1.3]), {}).parameters["joint_stiffness"]
    ratios = after[before != after] / before[before != after]
    np.testing.assert_allclose(ratios, [1.3, 1.3], rtol=1e-6)


@pytest.mark.parametrize(
    ("path", "vector", "words"),
    [
        ("axles[0].suspension.springs[0].spring_curve", [1.3], "take what else is in it along"),
        ("axles[0].brake.max_torque", [2000.0], "brakes: their torques: all worlds share it"),
        ("transmission.forward_ratios", [1.1], "transmission: all worlds share it"),
    ],
)
def test_what_worlds_share_is_refused(full, path, vector, words):
    with pytest.raises(FitError) as error:
        different(full, {path: {}}, vector)
    assert words in str(error.value)


def test_a_pattern_of_a_tire_is_written_out_and_means_the_same(full):
    parameters = value_at(full.document, ("axles", 0, "tire", "parameters"))
    assert "pattern" not in parameters
    spec = full.saved(full.document)
    assert "ground" not in spec
    again = sw.vehicle.load("hmmwv").axles[0].tire
    assert parameters["rolling_resistance"] == again.parameters["rolling_resistance"]


@pytest.mark.parametrize(
    ("readings", "inputs", "words"),
    [
        (["speed"], [], "readings: 'speed': no reading of a vehicle; did you mean"),
        (["speed_mps"], ["steer"], "inputs: 'steer': no input of a vehicle; did you mean steering"),
    ],
)
@pytest.mark.slow
def test_names_that_a_vehicle_does_not_have_are_one_line(target, readings, inputs, words):
    with pytest.raises(FitError) as error:
        target.check_names(readings, inputs)
    assert words in str(error.value)


def test_a_speed_within_noise_is_a_start_at_rest(target):
    gear = target.numbers(target.document, {"speed_mps": -0.01}).others["rolling"][0]
    assert gear == target.numbers(target.document, {}).others["rolling"][0] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("soil", [None, "mid"])
def test_a_rollout_remembers_nothing_of_the_one_before(soil):
    """What only a step computes, such as loads and depths, was that of the last run in the first reading."""
    target = VehicleTarget(dataclasses.replace(of_target("hmmwv", soil=soil), dt=0.002), "cpu", 1)
    readings = ("speed_mps", "Fz_FL_N", "drive_Nm", "engine_Nm", "sink_FL_m" if soil else "deflection_FL_m")
    rollout = target.rollout(2, {"body_mass"}, readings, ("throttle",))
    light = World(target.numbers(target.document, {}), np.full((100, 1), 0.5), {})
    heavy = target.numbers(changed(target, {"chassis.components[0].mass": {}}, [3000.0]), {"speed_mps": 5.0})
    first = rollout.run([light, light], 20)
    rollout.run([World(heavy, np.zeros((100, 1)), {"speed_mps": 5.0})] * 2, 20)
    assert np.array_equal(rollout.run([light, light], 20), first)


@pytest.fixture(scope="module")
def truck(target, tmp_path_factory):
    """A fit of three numbers to 2 s of a reduced HMMWV with others, without noise."""
    folder = tmp_path_factory.mktemp("truck")
    readings = ["speed_mps", "yawrate_radps", "latacc_com_mps2", "roll_rad", "pitch_rad", "engine_radps"]
    truth = {("chassis", "components", 0, "mass"): 2300.0, ("ground", "friction"): 0.7}
    document = replaced(target.document, truth)
    names = ("steering", "throttle", "braking")
    samples, steps = 200, 1000
    times = 0.002 * np.arange(steps + 1)
    inputs = np.stack([0.25 * np.sin(4.0 * times), np.where(times < 1.2, 0.5, 0.0), 0.2 * (times > 1.5)], axis=1)
    differing = target.numbers(target.document, {}).different(target.numbers(document, {}))
    rollout = target.rollout(1, differing, readings, names)
    start = {"speed_mps": 9.0}
    record = rollout.run([World(target.numbers(document, start), inputs, start)], samples)[:, 0]
    np.savez(folder / "log.npz", t_s=0.01 * np.arange(samples + 1), **dict(zip(readings, record.T, strict=True)))
    np.savez(folder / "pedals.npz", t_s=times, **dict(zip(names, inputs.T, strict=True)))
    return fit_config(
        {
            **BASE, "runs": [{"file": ["log.npz", "pedals.npz"], "start": start}], "warmup": 0.0,
            "readings": {name: {} for name in readings},
            "inputs": {name: {} for name in names},
            "parameters": {"chassis.components[0].mass": {}, "ground.friction": {},
                           "axles[*].suspension.springs[0].stiffness": {"start": 1.1}},
        },
        folder=str(folder),
    )  # fmt: skip


@pytest.fixture(scope="module")
def fitted_truck(truck, target):
    return Fit(truck, device="cpu", threads=1, target=target).run()


@pytest.mark.slow
def test_three_numbers_of_a_truck_come_back_from_its_own_run(fitted_truck):
    np.testing.assert_allclose(fitted_truck.values[:3], [2300.0, 0.7, 1.0], rtol=1e-3)


@pytest.mark.slow
def test_threads_and_an_interruption_change_no_bit_of_a_vehicles_fit(truck, fitted_truck, tmp_path):
    """Stopped after each batch in turn, and gone on with another number of threads."""
    threads, fit = 1, Fit(truck, device="cpu", threads=1)
    while not fit.done:
        fit.iterate()
        fit.save(tmp_path / "state.npz")
        threads = 3 - threads
        fit = Fit(truck, device="cpu", threads=threads)
        fit.resume(tmp_path / "state.npz")
    found = fit.result()
    assert np.array_equal(found.values, fitted_truck.values)
    assert np.array_equal(found.uncertainty.deviation, fitted_truck.uncertainty.deviation)
    assert (found.cost, found.iterations) == (fitted_truck.cost, fitted_truck.iterations)
    for mine, theirs in zip(found.readings, fitted_truck.readings, strict=True):
        assert np.array_equal(mine.predicted, theirs.predicted)


def test_a_given_start_counts_before_a_measured_one(tmp_path):
    from simwarp.identify.logs import RunLog, Signal

    config = fit_config({**BASE, "runs": [{"file": "log.npz", "start": {"speed_mps": 3.0}}]})
    times = np.arange(0.0, 1.0, 0.01)
    run = RunLog(config.runs[0], {"speed_mps": Signal(times, 5.0 + times)}, {}, 0.0, 0.99)
    assert start_values(run, Segment(0, 0.0, 0.0, 0.5), ["speed_mps"], True, True) == {"speed_mps": 3.0}
    later = start_values(run, Segment(0, 0.5, 0.5, 0.9), ["speed_mps"], False, True)
    assert later == {"speed_mps": pytest.approx(5.5)}
