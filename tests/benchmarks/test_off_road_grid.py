"""Off-road over obstacles, hills and soil: its points, rows that are kept, the table and the picture made of them."""

import csv
import dataclasses
import json
from pathlib import Path

import pytest
from PIL import Image

from benchmarks import off_road_grid, robustness
from benchmarks.off_road_grid import GROUNDS, HILLS, OBSTACLES, cells_of, main, marginal, name_of, places, point_at
from benchmarks.robustness_points import COLUMNS, nominal_config
from simwarp.statistics.proportions import wilson_interval
from simwarp.tasks.driving.soil import SoilKind
from simwarp.train.networks.policies import find_policy


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(off_road_grid, "RESULTS", tmp_path / "rows")
    monkeypatch.setattr(off_road_grid, "PICTURES", tmp_path)
    (tmp_path / "rows").mkdir()
    return tmp_path


def write(counts):
    with (off_road_grid.RESULTS / "camera.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for place, successes in counts.items():
            reasons = json.dumps({"goal": successes, "collision": 10 - successes})
            writer.writerow(("abc", name_of(place), 10, successes, 0, 0, 1.0, 90.0, reasons, 1.0))


def test_points_are_all_combinations():
    assert len({name_of(place) for place in places()}) == len(OBSTACLES) * len(HILLS) * len(GROUNDS)
    assert [place[0] for place in places(["soft"])] == ["soft"] * len(OBSTACLES) * len(HILLS)


def test_a_point_changes_obstacles_hills_and_soil_alone():
    config = nominal_config(find_policy("off-road", Path("shipped"), obs="camera"), "off-road")
    point = point_at(("soft", 1.0, 50), config)
    assert point.config == dataclasses.replace(config, obstacles=50, hills=1.0, soil=SoilKind.SOFT)
    assert point_at(("rigid", config.hills, config.obstacles), config).config == config
    assert point.label == "obstacles = 50, hills = 1, soil = soft"


def test_table_and_picture_are_made_of_the_rows_that_are_there(folder, capsys):
    grounds = ("rigid", "soft")
    write({place: 9 if place[0] == "rigid" else 4 for place in places(grounds)})
    assert main(["--report-only"]) == 0
    told = capsys.readouterr().out
    count = len(HILLS) * len(OBSTACLES)
    low, high = wilson_interval(9 * count, 10 * count)
    assert f"rigid 90.0 ({100 * low:.0f} to {100 * high:.0f})" in told
    assert "| soft | 1 | 40.0 (17 to 69) | 40.0 (17 to 69) | 40.0 (17 to 69) | 18, 0, 0, 0 of 30 |" in told
    assert "| hard |" not in told
    cells = cells_of("camera")
    assert marginal(cells, ground="hard") is None
    chosen = marginal(cells, obstacles=50, ground="soft")
    assert chosen is not None
    assert chosen["success"] == 0.4
    made = json.loads((folder / "rows" / "camera.json").read_text())
    assert made["command"] == "python benchmarks/off_road_grid.py"
    assert made["machine"]["cpu"]
    assert len(made["points"]) == 2 * count
    with Image.open(folder / "off_road_grid_camera.png") as image:
        assert image.size[0] > 500


def test_points_that_are_there_are_not_evaluated_again(folder, monkeypatch):
    seen = []

    def evaluate(task, policy, points, settings, *, after, **_):
        seen.append((task, [point.label for point in points], settings.episodes))

    monkeypatch.setattr(robustness, "evaluate_grid", evaluate)
    arguments = ["--grounds", "hard", "--episodes", "10"]
    assert main(arguments) == 0
    source = find_policy("off-road", Path("shipped"), obs="camera")
    write(dict.fromkeys(places(["hard"])[1:], 9))
    path = off_road_grid.RESULTS / "camera.csv"
    path.write_text(path.read_text().replace("abc", robustness.digest_of(source)))
    assert main(arguments) == 0
    assert main(["--grounds", "hard", "--episodes", "20"]) == 0
    assert [(task, len(points), episodes) for task, points, episodes in seen] == [
        ("off-road", 6, 10), ("off-road", 1, 10), ("off-road", 6, 20),
    ]  # fmt: skip
    assert seen[1][1] == ["obstacles = 0, hills = 0, soil = hard"]


def test_no_episodes_are_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["--episodes", "0"])
    assert "--episodes must be at least 1, got 0" in capsys.readouterr().err
