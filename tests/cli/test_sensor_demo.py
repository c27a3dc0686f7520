"""`simwarp sensor-demo`: one picture of all sensors, its numbers, one clear line for each mistake."""

import json

import numpy as np
import pytest
from PIL import Image

from simwarp import cli
from simwarp.viewer.demo import sheet as sheets
from simwarp.viewer.demo.sensor_plots import CLASSES, radar_panel
from simwarp.viewer.demo.sheet import BLANK, Bar, Panel, Sheet

PANEL = 128
"""The smallest pictures: the drive takes as long as ever, rays take a tenth."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Picture, measurements, JSON and what was printed, of one run."""
    folder = tmp_path_factory.mktemp("demo")
    files = [str(folder / name) for name in ("a.png", "a.NPZ", "a.json")]
    code = cli.main([
        "sensor-demo", "--panel", str(PANEL), "--out", files[0], "--data", files[1], "--json", files[2],
        "--device", "cpu",
    ])  # fmt: skip
    assert code == 0
    with np.load(files[1]) as data, Image.open(files[0]) as image:
        return np.asarray(image), dict(data), json.loads((folder / "a.json").read_text())


@pytest.mark.slow
def test_the_picture_has_all_panels(made):
    picture, _, content = made
    small = 2 * round(PANEL * 9 / 32)
    rows = 6 * (small + sheets.CAPTION + sheets.GAP) + round(0.72 * PANEL) + sheets.CAPTION
    head = picture.shape[0] - rows - sheets.MARGIN
    assert head > sheets.HEAD  # the note takes more than one line
    assert (head - sheets.HEAD) % sheets.LINE == 0
    assert picture.shape[1] == 4 * PANEL + 3 * sheets.GAP + 2 * sheets.MARGIN
    for row in range(7):  # no cell is left as paper
        top = head + row * (small + sheets.CAPTION + sheets.GAP) + sheets.CAPTION
        for column in range(4):
            left = sheets.MARGIN + column * (PANEL + sheets.GAP)
            cell = picture[top + 4 : top + small - 4, left + 4 : left + PANEL - 4]
            assert cell.std() > 5.0, (row, column)
    assert content["picture"].endswith("a.png")
    assert content["seed"] == 0


def test_the_cameras_saw_the_same_moment(made):
    _, data, _ = made
    instance, depth, labels = (data[name][..., 0] for name in ("instance", "depth", "semantic"))
    sky = instance < 0
    assert 0.05 < sky.mean() < 0.6
    assert sky[0].mean() > sky[-1].mean()  # above
    assert (depth[sky] == 400.0).all()
    assert depth[~sky].min() > 1.0
    np.testing.assert_allclose(np.linalg.norm(data["normals"][~sky], axis=-1), 1.0, atol=1e-4)  # float32, turned twice
    # the truck is in front of its own camera, in the lower half
    assert (labels[len(labels) // 2 :] == 11).mean() > 0.1
    assert set(np.unique(labels[~sky])) <= set(CLASSES)
    assert not np.array_equal(data["pinhole"], data["radial"])
    assert data["fog"].std() < data["pinhole"].std()
    assert data["noise"].mean() < data["pinhole"].mean()


def test_measurements_are_near_the_truth(made):
    _, data, content = made
    assert data["imu_time"][0] == pytest.approx(0.01)
    assert np.diff(data["imu_time"]) == pytest.approx(0.01)
    # white noise of 0.25 m/s² and 0.015 rad/s, drifts of 0.15 and 0.01, a bias of 0.03 on one of three axes
    assert 0.24 < content["accelerometer_rms"] < 0.5
    assert 0.02 < content["gyroscope_rms"] < 0.04
    # 0.3 m of noise and a drift of 0.8 m along each of two axes
    assert 0.4 < content["gps_rms_m"] < 2.5
    assert data["imu_truth"][200:, 2].mean() == pytest.approx(9.81, abs=0.1)  # no net climb
    # the truck holds 7 m/s as its driver can, and its wheel's encoder tells the same within two counts of 100 in 0.1 s
    speed = data["speedometer_truth"][200:, 0]
    assert abs(speed.mean() - 7.0) < 0.5
    wheel = 0.467 * np.abs(data["encoder_data"][20:, 0])
    assert np.median(wheel) == pytest.approx(np.median(speed), abs=0.6)


def test_lidar_and_radar_meet_the_scene(made):
    _, data, content = made
    points = data["lidar_points"]
    assert points.shape == (16, 900, 4)
    assert (points[..., 3] > 0).sum() == content["lidar_returns"] > 5000
    # 1.8 m above the truck's frame, 0.47 m above the ground: the lowest beams meet it near 2.3 / sin 15° = 8.8 m
    ranges = data["lidar_ranges"][-1, :, 0]
    assert np.median(ranges[ranges > 0]) == pytest.approx(8.8, rel=0.25)
    moving = data["radar_clusters"][: content["radar_clusters"], 3]
    assert np.median(moving) == pytest.approx(-6.4, abs=0.8)  # what stands comes closer at the truck's speed
    assert moving.min() < -13.0  # the car comes towards it


@pytest.mark.slow
def test_the_same_seed_gives_the_same_drive(made, tmp_path, monkeypatch):
    # of the instruments alone: the pictures are tested where cameras are
    from simwarp.viewer.demo import sensor_suite

    _, data, _ = made
    monkeypatch.setattr(sensor_suite.SensorSuite, "sensors", property(lambda rig: list(rig.traced.values())))
    world = devices_world()
    rig = sensor_suite.make_sensor_suite(world, 0, PANEL)
    found, _ = sensor_suite.drive(world, rig, lambda what, share: None)
    np.testing.assert_array_equal(found["imu"]["data"], data["imu_data"])
    np.testing.assert_array_equal(found["gps"]["data"], data["gps_data"])


def devices_world():
    from simwarp.viewer.demo.landscape import make_world

    return make_world(0, "cpu")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--out", "a.jpg"], "must end in .png"),
        (["--out", "nowhere/a.png"], "folder nowhere does not exist"),
        (["--data", "a.txt"], "must end in .npz"),
        (["--panel", "10"], "panel must be at least 128 pixels, got 10"),
        (["--panel", "100000"], "panel must be at most 2048 pixels, got 100000"),
        (["--seed", "-1"], "--seed must be a whole number from 0"),
        (["--sed", "1"], "unknown option --sed"),
        (["--device", "tpu"], "tpu"),
        (["--json", "nowhere/a.json"], "nowhere"),
    ],
)
def test_a_mistake_gives_one_line(arguments, told, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["sensor-demo", *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert told in err
    assert not list(tmp_path.iterdir())


def test_a_caption_gives_way_to_its_colour_bar():
    # 128 pixels do not hold a title, a long note and a bar: the note is left out, nothing overlaps
    image = np.zeros((54, PANEL, 3), np.uint8)
    bar = Bar("viridis", 0.0, 60.0, "m")
    papers = []
    for note in ("", "a note that is much too long for so small a panel"):
        sheet = Sheet(PANEL, [54], 1, "title", "note")
        sheet.put(0, 0, Panel("depth", note, image, bar))
        papers.append(sheet.picture())
    np.testing.assert_array_equal(papers[0], papers[1])


def ink(paper, background=sheets.PAPER):
    """(H, W) bool where there is something on the paper."""
    return (np.abs(paper.astype(int) - background) > 24).any(axis=-1)


@pytest.mark.parametrize("panel", [128, 200, 320])
def test_no_label_of_a_sheet_is_cut(panel):
    note = "one drive of a truck over hills, measured by all its sensors, inertial unit and satellite receiver"
    sheet = Sheet(panel, [54], 2, "simwarp sensor-demo", note)
    image = np.zeros((54, panel, 3), np.uint8)
    sheet.put(0, 0, Panel("exposure 1.9, vignetting", "", image))
    sheet.put(0, 1, Panel("lidar range image", "", image, Bar("viridis", 0.0, 60.0, "m")))
    paper = ink(sheet.picture())
    margin = sheets.MARGIN
    # letters end before the margin, and the title of the left panel before the right panel
    assert not paper[: sheet.head, -margin:].any()
    caption = paper[sheet.head : sheet.head + sheets.CAPTION]
    assert not caption[:, margin + panel : margin + panel + sheets.GAP].any()
    assert not caption[:, -margin:].any()
    # every word of the note is there: as many inked columns as in one line of a sheet that is wide enough
    wide = ink(Sheet(1200, [54], 2, "simwarp sensor-demo", note).picture())[33:56]
    lines = paper[33 : sheet.head - 1]
    assert lines.sum() == pytest.approx(wide.sum(), rel=0.1)  # letters lie otherwise among the pixels of a line


@pytest.mark.parametrize("height", [86, 200])
def test_the_axes_of_the_radar_have_names_that_fit(height):
    returns = np.zeros((1, 6)) - 1.0
    image = radar_panel(returns, np.zeros((0, 6)), 7.0, 410, height).image
    marked = ink(image, np.array([250, 250, 249]))
    assert not marked[0].any()
    assert not marked[-1].any()
    assert not marked[:, 0].any()


def test_a_bar_paints_what_is_not_seen_dark():
    bar = Bar("viridis", 0.0, 2.0, "m")
    painted = bar.paint(np.array([[0.0, 2.0, 5.0, 1.0]]), np.array([[True, True, True, False]]))
    assert painted[0, 3].tolist() == list(BLANK)
    assert painted[0, 1].tolist() == painted[0, 2].tolist()  # beyond its end: as at its end
    assert painted[0, 0].tolist() == [68, 1, 84]  # the first colour of viridis
