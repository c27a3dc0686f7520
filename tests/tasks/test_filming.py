"""`simwarp play` renders tasks that have something to see: frames, motion, layout; others stay line drawings."""

import dataclasses
import json

import numpy as np
import pytest
from PIL import Image

from simwarp import cli
from simwarp.tasks import make
from simwarp.train.filming import film_of, film_still, film_strip
from simwarp.train.play import record, write_picture, write_video
from simwarp.train.policies import zero_policy
from simwarp.viewer import Studio


def images_of(path):
    """(frames, height, width, 3) of a GIF."""
    with Image.open(path) as image:
        frames = []
        for index in range(getattr(image, "n_frames", 1)):
            image.seek(index)
            frames.append(np.asarray(image.convert("RGB")))
    return np.stack(frames)


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A pendulum that falls, filmed and photographed."""
    folder = tmp_path_factory.mktemp("film")
    task = make("pendulum", 2)
    shown = {}
    for name, write in (("a.gif", write_video), ("a.png", write_picture)):
        film = film_of(task, video=name == "a.gif")
        assert film is not None
        frames, drawing, _ = record(task, zero_policy(task), 0.6, 1, film)
        write(folder / name, task, drawing, frames, "pendulum")
        shown[name] = frames
    return folder, shown


@pytest.mark.slow
def test_a_video_has_every_frame_and_moves(played):
    folder, shown = played
    frames = shown["a.gif"]
    assert all(frame.images is not None for frame in frames)
    video = images_of(folder / "a.gif")
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


def test_a_picture_is_a_strip_of_moments(played):
    folder, shown = played
    taken = [frame for frame in shown["a.png"] if frame.images is not None]
    assert [frame.time for frame in taken] == pytest.approx(np.round(np.linspace(0, 15, 7)[1:]) * 0.04)
    with Image.open(folder / "a.png") as image:
        width, height = image.size
    worlds, tall, wide = taken[0].images.shape[:3]
    assert worlds == 2
    # a row for each world, a column for each moment, gaps of four pixels, a line of text above
    assert width == 6 * wide + 7 * 4
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


@pytest.mark.parametrize("video", [False, True])
def test_a_task_without_shapes_has_no_film(video):
    assert film_of(make("fast", 2), video) is None


def colors(path):
    """How many colours a picture has."""
    with Image.open(path) as image:
        return len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0))


def test_play_renders_what_can_be_seen(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["play", "pendulum", "--seconds", "0.2", "--num-envs", "1", "--video", "b.png", "--json", "-"]) == 0
    assert json.loads(capfd.readouterr().out)["video"] == "b.png"
    assert colors(tmp_path / "b.png") > 1000  # sky, shades and soft edges


def test_a_task_without_shapes_is_drawn_in_lines(tmp_path):
    task = make("fast", 1)
    frames, drawing, _ = record(task, zero_policy(task), 0.2, 1, film_of(task, False))
    assert all(frame.images is None for frame in frames)
    write_picture(tmp_path / "c.png", task, drawing, frames, "fast")
    assert colors(tmp_path / "c.png") < 400  # a few lines on white


def test_what_comes_into_sight_later_keeps_its_colour(played, tmp_path):
    _, shown = played
    task = make("pendulum", 2)
    _, drawing, _ = record(task, zero_policy(task), 0.1, 1, None)
    frames = [dataclasses.replace(frame, images=np.full_like(frame.images, 128)) for frame in shown["a.gif"]]
    blue = np.array([20, 60, 220])
    for frame in frames[-3:]:
        frame.images[:, 20:40, 20:40] = blue
    write_video(tmp_path / "late.gif", task, drawing, frames, "pendulum")
    last = images_of(tmp_path / "late.gif")[-1].astype(int)
    # a palette of 256 for a few colours
    assert (np.abs(last - blue).max(axis=-1) < 12).sum() >= 2 * 19 * 19


def test_films_are_lit_as_the_task_says():
    task = make("hallway", 1, obs="state")
    film, scene = film_of(task, video=True), task.scene()
    assert film is not None
    assert scene is not None
    lit = film.take(0, 1, 0.0)
    assert lit is not None
    height, width = lit.shape[1:3]
    under_the_sun = Studio(task.simulation, scene, task.shot(), width=width, height=height).take(0.0)
    # below a ceiling there is no sun
    assert lit.mean() > 1.5 * under_the_sun.mean()
