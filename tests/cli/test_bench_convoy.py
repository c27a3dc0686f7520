"""`simwarp bench hmmwv-convoy`: rows with one vehicle in each world and with several, side by side."""

import pytest

from simwarp.bench.measure import Row, enter_cost_per_vehicle
from simwarp.bench.vehicle_rows import VehicleRun, VehicleScene


def test_rows_of_one_and_of_several(bench):
    code, result, err = bench("hmmwv-convoy", "--vehicles", "2", "--worlds", "2", "--threads", "1", "--dt", "0.003")
    assert code == 0, err
    one, two = result["rows"]
    assert (one["vehicles"], two["vehicles"]) == (1, 2)
    assert one["cost_per_vehicle"] == 1.0
    assert two["cost_per_vehicle"] == pytest.approx(one["steps_per_cpu_s"] / (2.0 * two["steps_per_cpu_s"]))
    # driver, vehicles, tires, step, motion; and collision, where there is more than one box
    assert (one["launches_per_step"], two["launches_per_step"]) == (5, 6)
    assert 1.8 * one["bytes_per_world"] < two["bytes_per_world"] < 2.2 * one["bytes_per_world"]
    assert "vehicles" in err
    assert "cost" in err


def test_costs_are_those_of_rows_alike():
    rows = [
        Row("simwarp", "hmmwv-convoy", worlds, 1e-3, steps_per_cpu_s=rate, vehicles=vehicles)
        for worlds, vehicles, rate in ((1, 1, 100.0), (8, 1, 160.0), (1, 4, 20.0), (8, 4, None), (16, 4, 10.0))
    ]
    enter_cost_per_vehicle(rows)
    assert [row.cost_per_vehicle for row in rows] == [1.0, 1.0, 1.25, None, None]


def test_a_convoy_on_soil_is_sound():
    run = VehicleRun(VehicleScene(name="hmmwv-convoy", vehicles=2, soil="mid", spacing=0.1), 1, "cpu", 3e-3)
    for _ in range(2000):
        run.single_step()
    vehicles = run.setup.vehicle
    x = vehicles.position.numpy()[0, :, 0]
    assert x[0] - x[1] == pytest.approx(10.0, abs=0.5)
    assert x[0] > 5.0
    # the second one drives in ruts that are there already, where less soil gives way
    assert (vehicles.tires.deflection.numpy() > 0.03).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("hmmwv", "--vehicles", "2"), "--vehicles is of convoys (hmmwv-convoy), and 'hmmwv' is none; leave it away"),
        (("hmmwv", "--soil", "mid"), "--soil is of convoys (hmmwv-convoy), and 'hmmwv' is none; leave it away"),
        (("hmmwv-convoy", "--vehicles", "0"), "vehicles must be a whole number from 1 to 64, got 0"),
        (("hmmwv-convoy", "--vehicles", "1.5"), "vehicles must be a whole number from 1 to 64, got 1.5"),
        (("hmmwv-convoy", "--vehicles", "inf"), "vehicles must be a whole number from 1 to 64, got inf"),
        (("hmmwv-convoy", "--soil", "mud"), "soil: preset must be soft, mid, hard, clay, snow, sand, got 'mud'"),
        (("hmmwv-convoy", "--spacing", "0.1"), "choose --soil mid"),
    ],
)
def test_bad_input_is_one_line(bench, arguments, words):
    code, _, err = bench(*arguments)
    assert code == 2
    assert words in err
    assert len(err.strip().splitlines()) == 1
