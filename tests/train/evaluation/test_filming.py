"""`simwarp play` renders tasks: frames, motion, layout, lines; and what has no shape, no body."""

import io
import itertools
import json
import sys
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from simwarp import cli
from simwarp.core.rotation import matrix_of
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.tasks import InputError, Task, make
from simwarp.train.evaluation.filming import TRAIL, Film, FilmOptions, Trails, View, film_still, film_strip
from simwarp.train.evaluation.gif import MOST_BYTES, gif_of
from simwarp.train.evaluation.play import Frame, record, write_picture, write_video
from simwarp.train.networks.policies import zero_policy
from simwarp.viewer import FollowCamera


def images_of(path):
    """(frames, height, width, 3) of a GIF."""
    with Image.open(path) as image:
        frames = []
        for index in range(getattr(image, "n_frames", 1)):
            image.seek(index)
            frames.append(np.asarray(image.convert("RGB")))
    return np.stack(frames)


def played(path, write):
    """A pendulum that falls, in a video or a picture; the frames of it."""
    task = make("pendulum", 2)
    frames, _ = record(task, zero_policy(task), 0.6, 1, Film(task, video=path.suffix == ".gif"))
    write(path, frames, "pendulum")
    return frames


@pytest.mark.slow
def test_a_video_has_every_frame_and_moves(tmp_path):
    frames = played(tmp_path / "a.gif", write_video)
    assert all(frame.images is not None for frame in frames)
    video = images_of(tmp_path / "a.gif")
    assert len(video) == len(frames) == 1 + round(0.6 * 25)
    height, width = frames[0].images.shape[1:3]
    assert video.shape[2] >= 2 * width  # two worlds side by side
    assert all(size % 2 == 0 for size in (*video.shape[1:3], height, width))
    # something moves between any two frames, and most of the picture, which is ground and sky, does not
    scene = np.stack([frame.images for frame in frames]).astype(int)
    changed = np.abs(np.diff(scene, axis=0)).max(axis=-1) > 30
    assert changed.any(axis=(1, 2, 3)).all()
    assert 0.0 < changed.mean() < 0.2
    # worlds start at different angles
    assert not np.array_equal(frames[0].images[0], frames[0].images[1])


def test_a_picture_is_a_strip_of_moments(tmp_path):
    taken = [frame for frame in played(tmp_path / "a.png", write_picture) if frame.images is not None]
    assert [frame.time for frame in taken] == pytest.approx([0.2, 0.4, 0.6])
    with Image.open(tmp_path / "a.png") as image:
        width, height = image.size
    worlds, tall, wide = taken[0].images.shape[:3]
    assert worlds == 2
    # a row for each world, a column for each moment, gaps of four pixels, a line of text above
    assert width == 3 * wide + 4 * 4
    assert 2 * tall + 3 * 4 < height < 2 * tall + 3 * 4 + 40


def test_one_world_fills_two_rows_and_a_still_names_its_worlds():
    moments = [(0.1 * k, np.full((1, 20, 30, 3), 20 * k, np.uint8)) for k in range(6)]
    strip = film_strip(moments, "title")
    assert strip.shape[1] == 3 * 30 + 4 * 4  # three columns
    single = film_strip(moments[:1], "title")
    assert single.shape[1] == 30 + 2 * 4
    still = film_still(np.zeros((3, 40, 60, 3), np.uint8), 1.5, "title")
    assert still.shape[1] == 2 * 60 + 3 * 4
    assert (still > 150).all(axis=-1).sum() > 100  # words and paper


def colors(path):
    """How many colours a picture has."""
    with Image.open(path) as image:
        return len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0))


def test_play_renders_what_can_be_seen(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["play", "pendulum", "--seconds", "0.2", "--num-envs", "1", "--video", "b.png", "--json", "-"]) == 0
    assert json.loads(capfd.readouterr().out)["video"] == "b.png"
    assert colors(tmp_path / "b.png") > 1000  # sky, shades and soft edges
    assert not list(tmp_path.glob("*.mp4"))


SMALL = ("--seconds", "0.12", "--size", "48", "32")


def test_play_holds_a_level_of_the_curriculum(tmp_path, monkeypatch, capfd):
    """What is seen and counted is that of the level, as in `eval`."""
    monkeypatch.chdir(tmp_path)
    held = []
    monkeypatch.setattr(Task, "set_level", lambda task, level: held.append(level))
    for words in ((), ("--level", "0.2")):
        assert cli.main(["play", "pendulum", *SMALL, "--video", "b.png", *words]) == 0
    assert held == [1.0, 0.2]
    assert cli.main(["play", "pendulum", *SMALL, "--video", "b.png", "--level", "1.5"]) == 2
    assert "[0, 1]" in capfd.readouterr().err


def test_play_writes_an_mp4_unasked(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["play", "fast", "--checkpoint", "none", *SMALL]) == 2
    capfd.readouterr()
    assert cli.main(["play", "pendulum", *SMALL, "--json", "-"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["video"] == "pendulum.mp4"
    assert told["return"] > 0.0
    assert (tmp_path / "pendulum.mp4").read_bytes()[4:8] == b"ftyp"  # the mark of its format


def test_without_an_encoder_play_writes_a_gif_and_says_so(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert cli.main(["play", "pendulum", *SMALL]) == 0
    out = capfd.readouterr().out
    assert out.count("no encoder for mp4 (pip install imageio-ffmpeg)") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["pendulum.gif"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--num-envs", "2", "--worlds", "2"), "worlds must be from 0 to 1, got 2; --num-envs plays more of them"),
        (("--worlds", "0", "0"), "worlds must be different ones, got 0 0"),
        (("--size", "33", "20"), "size must be two even numbers from 16 to 4096 pixels, got 33"),
        (("--size", "4096", "4096", "--seconds", "60"), "at most 8 GB of images, got 76 GB"),
        (("--zoom", "0"), "zoom must be from 0.1 to 20, got 0"),
        (("--camera", "moon"), "camera"),
    ],
)
def test_what_play_cannot_show_is_refused_in_one_line(options, told, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["play", "pendulum", *options]) == 2
    err = capfd.readouterr().err
    assert told in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_interruption_loses_no_frame(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    take, taken = Film.render, []

    def interrupted(film, index, count, time):
        if index == 3:
            raise KeyboardInterrupt
        taken.append(index)
        return take(film, index, count, time)

    monkeypatch.setattr(Film, "render", interrupted)
    assert cli.main(["play", "pendulum", "--seconds", "4", "--size", "48", "32", "--video", "a.gif"]) == 130
    assert "interrupted; wrote the 0.1 s so far to a.gif" in capfd.readouterr().out
    assert len(images_of(tmp_path / "a.gif")) == len(taken) == 3


def test_worlds_size_zoom_and_camera_are_as_asked():
    task = make("pendulum", 3)
    task.restart(seed=1)

    def look(**options: Any) -> Any:
        return Film(task, True, FilmOptions(size=(96, 64), trail=False, **options)).render(0, 1, 0.0)

    every, one = look(), look(worlds=(2,))
    assert every.shape == (3, 64, 96, 3)
    np.testing.assert_array_equal(one[0], every[2])
    reddish = [(image[..., 0].astype(int) - image[..., 2] > 60).sum() for image in (every[2], look(zoom=0.5)[2])]
    assert 0 < reddish[1] < 0.45 * reddish[0]  # half as large: a quarter of the area, but for edges
    views = [look(view=view)[0] for view in View]
    assert all(not np.array_equal(a, b) for a, b in itertools.combinations(views, 2))


def near(picture, color, reach=40):
    """(H, W) bool where a picture has nearly a colour."""
    return np.abs(picture.astype(int) - np.round(255.0 * np.array(color))).max(axis=-1) < reach


def test_the_trail_shows_where_a_body_went():
    task: Any = make("pendulum", 1)
    task.restart(seed=1)
    film: Any = Film(task, True, FilmOptions(size=(240, 160)))
    for index, position in enumerate(np.linspace(-1.0, 1.0, 21)):
        task.map_position = lambda at=position: torch.tensor([[at, -0.3, 0.6]])
        images = film.render(index, 21, 0.04 * index)
    assert images is not None
    camera = FollowCamera(task.simulation, task.scene(), task.shot(), width=240, height=160)
    pose = camera.aim(0.0)[0]
    matrix = Pinhole(fov=task.shot().fov).intrinsics(240, 160)
    for x in (-0.9, 0.0, 0.9):
        seen = (np.array([x, -0.3, 0.6]) - pose.position) @ matrix_of(pose.rotation)
        column, row, depth = matrix @ (-seen[1], -seen[2], seen[0])
        spot = images[0, int(row / depth) - 1 : int(row / depth) + 2, int(column / depth)]
        assert near(spot, TRAIL).any(), x


def test_a_trail_ends_where_its_world_was_reset():
    trails = Trails(1)
    for x in (0.0, 0.1, 0.2, 5.0, 5.1):
        trails.add(np.array([[x, 0.0, 0.0]]))
    np.testing.assert_allclose(trails.lines()[0][:, 0], [5.0, 5.1])


def test_a_goal_is_in_the_picture():
    task: Any = make("fast", 1)
    images: Any = Film(task, True, FilmOptions(size=(240, 240))).render(0, 1, 0.0)
    green = np.argwhere(near(images[0], (0.17, 0.63, 0.17)))
    # a ring of 0.2 m about the middle of a view that spans 4 m and more
    assert len(green) > 12
    assert np.abs(green.mean(axis=0) - 120.0).max() < 6.0


def test_a_gif_is_never_too_large():
    rng = np.random.default_rng(1)
    noise = [rng.integers(0, 256, (90, 120, 3), dtype=np.uint8) for _ in range(125)]  # the worst there is
    made = gif_of(noise * 2, 50.0)
    assert 0.2 * MOST_BYTES < len(made) <= MOST_BYTES
    with Image.open(io.BytesIO(made)) as video:
        assert getattr(video, "n_frames", 1) == 125
        assert video.info["duration"] == 40  # every second image, twice as long


def blue(images):
    """(H, W) bool where a picture is blue."""
    return images[..., 2].astype(int) - images[..., 0] > 100


def test_a_task_without_bodies_is_drawn_in_lines_on_the_ground():
    task: Any = make("fast", 1)
    film: Any = Film(task, video=True)
    task.position.copy_(torch.tensor([1.0, 1.0]))
    right_above = blue(film.render(0, 2, 0.0)[0])
    task.position.copy_(torch.tensor([-1.0, -1.0]))
    left_below = blue(film.render(1, 2, 1.0)[0])
    rows, columns = np.nonzero(right_above)
    height, width = right_above.shape
    assert len(rows) > 20
    assert rows.max() < 0.6 * height
    assert columns.min() > 0.4 * width
    rows, columns = np.nonzero(left_below)
    assert rows.min() > 0.4 * height
    assert columns.max() < 0.6 * width


def test_a_task_with_neither_bodies_nor_lines_is_refused(monkeypatch):
    task = make("fast", 1)
    monkeypatch.setattr(type(task), "drawing", Task.drawing)
    with pytest.raises(InputError, match="'fast' has nothing to draw; build bodies, or return lines from drawing"):
        Film(task, video=False)


def test_bodies_without_shapes_are_seen(monkeypatch):
    task = make("pendulum", 1)
    monkeypatch.setattr(type(task), "visuals", Task.visuals)
    scene = task.scene()
    assert scene is not None
    assert sorted(set(scene.body.tolist())) == [0, 1]


def test_the_lines_of_a_drawing_are_in_the_picture(monkeypatch):
    task = make("pendulum", 1)
    task.restart(seed=1)
    film: Any = Film(task, video=True, options=FilmOptions(trail=False))
    marked = film.render(0, 1, 0.0)
    monkeypatch.setattr(type(task), "drawing", Task.drawing)
    plain = film.render(0, 1, 0.0)
    changed = (marked != plain).any(axis=(0, -1))
    columns = np.nonzero(changed.any(axis=0))[0]
    half = changed.shape[1] // 2
    # an upright mark at either end of the rail
    assert 0 < (columns < half).sum() < 10
    assert 0 < (columns > half).sum() < 10
    assert changed.any(axis=1).sum() > 8


def test_what_comes_into_sight_later_keeps_its_colour(tmp_path):
    images = np.full((16, 2, 120, 160, 3), 128, np.uint8)
    blue = np.array([20, 60, 220])
    images[-3:, :, 20:40, 20:40] = blue
    frames = [Frame(0.04 * index, each) for index, each in enumerate(images)]
    write_video(tmp_path / "late.gif", frames, "pendulum")
    last = images_of(tmp_path / "late.gif")[-1].astype(int)
    # a palette of 256 for a few colours
    assert (np.abs(last - blue).max(axis=-1) < 12).sum() >= 2 * 19 * 19


def test_films_are_lit_as_the_task_says():
    task = make("hallway", 1, obs="state")
    film, scene = Film(task, video=True), task.scene()
    assert scene is not None
    lit = film.render(0, 1, 0.0)
    assert lit is not None
    height, width = lit.shape[1:3]
    under_the_sun = FollowCamera(task.simulation, scene, task.shot(), width=width, height=height).render(0.0)
    # below a ceiling there is no sun
    assert lit.mean() > 1.5 * under_the_sun.mean()
