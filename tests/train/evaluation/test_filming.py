"""`simwarp play` renders tasks: frames, motion, layout, lines; and what has no shape, no body."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from simwarp import cli
from simwarp.tasks import InputError, Task, make
from simwarp.train.evaluation.filming import Film, film_still, film_strip
from simwarp.train.evaluation.play import record, write_picture, write_video
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


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A pendulum that falls, filmed and photographed."""
    folder = tmp_path_factory.mktemp("film")
    task = make("pendulum", 2)
    shown = {}
    for name, write in (("a.gif", write_video), ("a.png", write_picture)):
        frames, _ = record(task, zero_policy(task), 0.6, 1, Film(task, video=name == "a.gif"))
        write(folder / name, frames, "pendulum")
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


def colors(path):
    """How many colours a picture has."""
    with Image.open(path) as image:
        return len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0))


def test_play_renders_what_can_be_seen(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["play", "pendulum", "--seconds", "0.2", "--num-envs", "1", "--video", "b.png", "--json", "-"]) == 0
    assert json.loads(capfd.readouterr().out)["video"] == "b.png"
    assert colors(tmp_path / "b.png") > 1000  # sky, shades and soft edges


def blue(images):
    """(H, W) bool where a picture is blue."""
    return images[..., 2].astype(int) - images[..., 0] > 100


def test_a_task_without_bodies_is_drawn_in_lines_on_the_ground():
    task: Any = make("fast", 1)
    film: Any = Film(task, video=True)
    task.position.copy_(torch.tensor([1.0, 1.0]))
    right_above = blue(film.take(0, 2, 0.0)[0])
    task.position.copy_(torch.tensor([-1.0, -1.0]))
    left_below = blue(film.take(1, 2, 1.0)[0])
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
    film: Any = Film(task, video=True)
    marked = film.take(0, 1, 0.0)
    monkeypatch.setattr(type(task), "drawing", Task.drawing)
    plain = film.take(0, 1, 0.0)
    changed = (marked != plain).any(axis=(0, -1))
    columns = np.nonzero(changed.any(axis=0))[0]
    half = changed.shape[1] // 2
    # an upright mark at either end of the rail
    assert 0 < (columns < half).sum() < 10
    assert 0 < (columns > half).sum() < 10
    assert changed.any(axis=1).sum() > 8


def test_what_comes_into_sight_later_keeps_its_colour(played, tmp_path):
    _, shown = played
    frames = [dataclasses.replace(frame, images=np.full_like(frame.images, 128)) for frame in shown["a.gif"]]
    blue = np.array([20, 60, 220])
    for frame in frames[-3:]:
        frame.images[:, 20:40, 20:40] = blue
    write_video(tmp_path / "late.gif", frames, "pendulum")
    last = images_of(tmp_path / "late.gif")[-1].astype(int)
    # a palette of 256 for a few colours
    assert (np.abs(last - blue).max(axis=-1) < 12).sum() >= 2 * 19 * 19


def test_films_are_lit_as_the_task_says():
    task = make("hallway", 1, obs="state")
    film, scene = Film(task, video=True), task.scene()
    assert scene is not None
    lit = film.take(0, 1, 0.0)
    assert lit is not None
    height, width = lit.shape[1:3]
    under_the_sun = FollowCamera(task.simulation, scene, task.shot(), width=width, height=height).take(0.0)
    # below a ceiling there is no sun
    assert lit.mean() > 1.5 * under_the_sun.mean()
