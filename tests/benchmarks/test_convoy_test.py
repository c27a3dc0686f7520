"""The convoy test: rows of a short run, what is left to run, numbers and the table made of rows."""

import itertools
import json
import math

import pytest

from benchmarks import convoy_test
from benchmarks.convoy_test import (
    COLUMNS,
    COUNTED,
    Kind,
    Runs,
    draw,
    left,
    numbers_of,
    paired,
    path_of,
    read_rows,
    report,
    table,
    vehicle_numbers,
    write_rows,
)


def row(run, vehicle, reason, seconds=50.0, deviation=1.0):
    values = (run, vehicle, reason, seconds, deviation, 2.0 * deviation, 9.0, 200.0)
    return dict(zip(COLUMNS, values, strict=True))


BY_CAMERA = Kind("camera", drive_on=True, scattered=30)


def counted_row(run, vehicle, reason, largest, hits, bumps=0):
    return row(run, vehicle, reason) | dict(zip(COUNTED, (largest, hits, bumps), strict=True))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(convoy_test, "RESULTS", tmp_path)
    monkeypatch.setattr(convoy_test, "PICTURES", tmp_path)
    return tmp_path


def test_a_run_has_a_row_of_each_vehicle(folder):
    rows = Runs("reduced", "rigid", 7, 2, max_episode_steps=12).play()
    assert [(each["run"], each["vehicle"]) for each in rows] == [(run, v) for run in (7, 8) for v in range(4)]
    assert [each["reason"] for each in rows] == 2 * ["driver", "time_limit", "time_limit", "time_limit"]
    assert all(each["seconds"] == pytest.approx(2.4) for each in rows)
    assert all(0.0 <= each["deviation"] < 0.5 for each in rows)
    # Vehicles are a twentieth of the path apart, of more than 200 m
    ways = [each["way"] for each in rows[:4]]
    assert all(5.0 < ahead - behind < 20.0 for ahead, behind in itertools.pairwise(ways))
    write_rows(folder / "reduced.rigid.csv", rows)
    back = read_rows(folder / "reduced.rigid.csv")
    assert all(math.isnan(one["distance"]) == (one["vehicle"] == 0) for one in back)
    assert [{**one, "distance": 0} for one in back] == [{**one, "distance": 0} for one in rows]


def test_what_is_there_is_not_run_again(folder):
    write_rows(folder / "reduced.soft.csv", [row(run, vehicle, "goal") for run in range(2) for vehicle in range(4)])
    assert list(left(["reduced"], ["rigid", "soft"], 3, 2)) == [
        ("reduced", "rigid", 0, 2), ("reduced", "rigid", 2, 1), ("reduced", "soft", 2, 1),
    ]  # fmt: skip


def test_numbers_of_a_vehicle_and_who_failed_first():
    rows = [row(run, 0, "driver") for run in range(4)]
    rows += [row(0, 1, "goal"), row(0, 2, "goal"), row(1, 1, "collision", 20.0), row(1, 2, "bumped", 23.0)]
    rows += [row(2, 1, "goal"), row(2, 2, "lost", 30.0), row(3, 1, "lost", 40.0), row(3, 2, "collision", 12.0)]
    first, second = (vehicle_numbers(rows, vehicle) for vehicle in (1, 2))
    assert first["touches"]["count"] == 1
    assert first["lost"]["count"] == 1
    assert first["first"] == 2
    assert second["touches"]["share"] == 0.5
    assert second["lost"]["count"] == 1
    assert second["first"] == 2, "in run 1 the one ahead had failed before"
    assert second["touches"]["low"] < 0.5 < second["touches"]["high"]
    assert second["deviation"] == {"mean": 1.0, "low": 1.0, "high": 1.0}


def test_grounds_are_compared_run_by_run(folder):
    for ground, off in (("rigid", 0.0), ("hard", 0.25), ("soft", -0.5)):
        rows = [row(run, v, "goal", deviation=1.0 + run + off) for run in range(3) for v in range(4)]
        write_rows(folder / f"full.{ground}.csv", rows[:8] if ground == "soft" else rows)
    found = {(each["ground"], each["vehicle"]): each for each in paired("full", "deviation")}
    assert found["hard", 2]["mean"] == found["hard", 2]["low"] == 0.25
    assert found["hard", 2]["runs"] == 3
    assert found["soft", 0]["mean"] == -0.5
    assert found["soft", 0]["runs"] == 2, "only runs that are there on both grounds"


def test_table_and_picture_are_made_of_rows(folder):
    for ground in ("rigid", "hard", "soft"):
        rows = [row(run, v, "goal" if v else "driver", deviation=1.0 + v + run) for run in range(3) for v in range(4)]
        write_rows(folder / f"reduced.{ground}.csv", rows)
    numbers = numbers_of(["reduced", "full"], ["rigid", "hard", "soft"])
    assert json.loads(json.dumps(numbers)) == numbers
    lines = table(numbers).splitlines()
    assert len(lines) == 2 + 12
    assert "| reduced | hard | 2 | 3 | 0.0 % (0.0 to 56.1) |" in lines[2 + 4 + 2]
    draw(numbers, folder / "picture.png")
    assert (folder / "picture.png").stat().st_size > 1000


def test_followers_by_camera_drive_on_and_their_touches_are_in_the_rows(folder):
    rows = Runs("reduced", "rigid", 7, 2, BY_CAMERA, max_episode_steps=8).play()
    assert [(each["run"], each["vehicle"]) for each in rows] == [(run, v) for run in (7, 8) for v in range(4)]
    assert all(tuple(each) == (*COLUMNS, *COUNTED) for each in rows)
    assert all(each["largest"] >= each["deviation"] for each in rows)
    assert [each["hits"] for each in rows if each["vehicle"]] == 6 * [0.0]
    assert all(math.isnan(each["hits"]) for each in rows if not each["vehicle"]), "a driver's are not counted"
    path = path_of("reduced", "rigid", BY_CAMERA)
    assert path.name == "reduced.rigid.camera.on.scattered-30.csv"
    assert path_of("reduced", "rigid").name == "reduced.rigid.csv"
    write_rows(path, rows)
    assert [tuple(each) for each in read_rows(path)] == [tuple(each) for each in rows]
    assert list(left(["reduced"], ["rigid"], 9, 9, BY_CAMERA)) == [("reduced", "rigid", 0, 9)]


def test_touches_are_counted_and_the_largest_distance_is_that_of_all(folder, capsys):
    rows = [counted_row(run, 0, "driver", 0.5, math.nan, math.nan) for run in range(4)]
    rows += [counted_row(run, 1, "goal", 1.0 + run, run, bumps=int(run == 0)) for run in range(4)]
    found = vehicle_numbers(rows, 1)
    assert found["most"] == 4.0
    assert found["largest"]["mean"] == 2.5
    assert found["hits"]["mean"] == 1.5
    assert found["bumps"]["mean"] == 0.25
    assert found["touches"]["count"] == 4, "runs with a touch of anything"
    assert "hits" not in vehicle_numbers(rows, 0)
    for ground in ("rigid", "soft"):
        more = [counted_row(run, vehicle, "goal", 2.0, 1) for run in range(4) for vehicle in (2, 3)]
        write_rows(path_of("reduced", ground, BY_CAMERA), rows + more)
    report(BY_CAMERA)
    told = capsys.readouterr().out
    assert "| reduced | soft | 1 | 4 | 100.0 % (51.0 to 100.0) | 0.0 % (0.0 to 49.0) | 1.50 (" in told
    assert "reduced hits of vehicle 1, soft less rigid: +0.000 (+0.000 to +0.000), 4 runs" in told
    assert "hits of vehicle 0" not in told
    assert (folder / "convoy_test_camera_on_scattered-30.json").is_file()
    assert (folder / "convoy_test_camera_on_scattered-30.png").stat().st_size > 1000
