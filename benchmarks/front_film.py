"""The moving picture of the front page: trucks in their ruts, a quadruped on stairs, a wall of worlds.

    python benchmarks/front_film.py [--output docs/images/front.gif] [--frames FOLDER]

Shipped policies act in all of it, but for the first three trucks, which a driver steers along the convoy's path. The
pictures come from simwarp's own cameras. It takes some ten minutes of one core, most of them for rays.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image

from simwarp import WORLD
from simwarp.scenery import GroundKind
from simwarp.sensors import Lighting, Scene, Sun, Visuals
from simwarp.tasks import Task, make
from simwarp.tasks.locomotion.velocity import QuadrupedVelocity, RoughConfig
from simwarp.train import find_policy
from simwarp.viewer import FollowCamera, Shot, paint

Picture = npt.NDArray[np.uint8]

OUTPUT: Final = Path(__file__).resolve().parents[1] / "docs" / "images" / "front.gif"
WIDTH, HEIGHT = 640, 320
TILE: Final = (240, 120)
"""Width and height of a world of the wall [pixels], before it is made smaller."""
PERIOD: Final = 0.08
"""From frame to frame [s]."""
SUN: Final = Lighting(
    suns=(Sun(direction=(-1.0, -0.25, 0.38), color=(1.45, 1.2, 0.86)),),
    ambient=(0.3, 0.36, 0.48), sky=(0.16, 0.36, 0.72), horizon=(0.8, 0.84, 0.88),
)  # fmt: skip
"""Low, so that ruts and stairs have shadows."""
ON_STAIRS: Final = dataclasses.replace(SUN, suns=(Sun(direction=(0.55, -0.6, 0.75), color=(1.3, 1.12, 0.86)),))
WALL: Final[tuple[tuple[str, dict[str, Any]], ...]] = (
    ("quadruped-velocity", {"obs": "scan", "ground": "rough"}),
    ("off-road", {"obs": "state", "hills": 1.0, "obstacles": 50}),
    ("racer3-reach", {}),
    ("hallway", {"obs": "state"}),
    ("ant", {}),
    ("convoy", {"obs": "state"}),
    ("hexapod", {}),
    ("barrier-track", {"obs": "state"}),
    ("obstacle-avoidance", {"obs": "state"}),
)
"""Tasks of the wall, with their options: as many as it has rows and columns. The first stands in the middle."""
SIDE: Final = len(WALL)
ZOOMING: Final = 1.25
"""Time in which the wall comes into sight [s]."""
NEAR: Final = 12
"""Change of a colour, of 255, that a GIF leaves away."""


class Player:
    """A task under its shipped policy.

    Args:
        name: of the task.
        worlds: number of them.
        seed: of the worlds.
        hold: control steps that an action lasts, for tasks that are stepped more often than they were trained for.
        command: called before each control step.
        options: of the task.
    """

    def __init__(
        self, name: str, worlds: int, seed: int, *, hold: int = 1, command: Callable[[Task[Any]], None] | None = None,
        **options: Any,
    ) -> None:  # fmt: skip
        self.task = make(name, worlds, seed=seed, **options)
        obs = options.get("obs")
        self._policy = find_policy(name, Path("shipped"), obs=obs).policy(self.task)
        self._hold, self._command = hold, command
        self._observations = self.task.restart(seed=seed)
        self._steps = 0

    def play(self, until: float) -> None:
        """Step until a time since the start [s]."""
        while (self._steps + 0.5) * self.task.config.control_dt < until:
            if self._command is not None:
                self._command(self.task)
            if self._steps % self._hold == 0:
                self._action = self._policy(self._observations).clone()
            self._observations = self.task.step(self._action).observations
            self._steps += 1

    def camera(
        self, scene: Scene, shot: Shot, size: tuple[int, int], light: Lighting | None, samples: int
    ) -> FollowCamera:
        """A camera that sees all worlds."""
        worlds = range(self.task.num_worlds)
        return FollowCamera(
            self.task.simulation, scene, shot, worlds=worlds, width=size[0], height=size[1], samples=samples,
            lighting=light,
        )  # fmt: skip


def times(start: float, end: float) -> npt.NDArray[np.float64]:
    """Times of frames [s]."""
    return np.arange(start, end - 1e-6, PERIOD)


def trucks() -> Iterator[Picture]:
    """Four trucks on soft soil turn in front of a camera that stands still."""
    # Frames come more often than the policy acts
    player = Player(
        "convoy", 1, 3, hold=5, first_world=3, obs="state", leaders="simulated", leading=3, followers=1, soil="soft",
        soil_spacing=0.04, decimation=16, max_episode_steps=1550, latest_start=0.1,
    )  # fmt: skip
    scene = player.task.scene()
    assert scene is not None
    target, eye = np.array((27.5, 17.0, 1.0)), np.array((20.5, 46.5, 5.2))
    shot = Shot(body=WORLD, target=tuple(target), eye=tuple(eye - target), fov=0.58)
    camera = player.camera(scene, shot, (WIDTH, HEIGHT), SUN, 2)
    for time in times(23.6, 27.9):
        player.play(time)
        yield camera.render(time)[0]


def go_ahead(task: Task[Any]) -> None:
    """Command a walk along x."""
    x, y, z, w = task.views.body_q[:, 0, 3:].unbind(1)
    heading = torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    commands = task.commands()
    commands["ahead"].values.copy_(torch.where(heading.abs() < 0.3, 0.8, 0.0))
    commands["left"].values.zero_()
    commands["turn"].values.copy_((-2.0 * heading - task.views.body_q[:, 0, 1]).clamp(-1.0, 1.0))


def stairs() -> tuple[Player, FollowCamera]:
    """A quadruped that climbs stairs of 13 cm, and a camera beside it."""
    rough = RoughConfig(kinds=(GroundKind.STAIRS_UP,), level=8)
    player = Player(
        "quadruped-velocity", 1, 3, command=go_ahead, obs="scan", ground="rough", push_speed=0.0, rough=rough
    )
    task = player.task
    assert isinstance(task, QuadrupedVelocity)
    assert task.builder is not None
    visuals = Visuals(task.builder)
    visuals.show(task.ground.shape, color=(0.5, 0.44, 0.36))
    task.visuals(visuals)
    paint(visuals)
    scene = visuals.finalize(task.simulation.model)
    shot = Shot(body=0, target=(0.12, 0.0, -0.12), eye=(0.45, -2.75, 1.1), fov=0.66, calm=0.6)
    return player, player.camera(scene, shot, (WIDTH, HEIGHT), ON_STAIRS, 2)


class Wall:
    """Worlds side by side, each task along diagonals, around one that is filmed alone first."""

    def __init__(self, middle: Player) -> None:
        self._middle = middle
        self._players = [Player(name, SIDE, 1, **options) for name, options in WALL]
        self._cameras = []
        for player in self._players:
            scene = player.task.scene()
            assert scene is not None
            self._cameras.append(player.camera(scene, player.task.shot(), TILE, player.task.lighting(), 1))

    def render(self, time: float) -> Picture:
        """The whole wall."""
        rows = []
        for player, camera in zip(self._players, self._cameras, strict=True):
            player.play(time)
            tiles = camera.render(time)
            tiles[:, :1], tiles[:, -1:], tiles[:, :, :1], tiles[:, :, -1:] = (255,) * 4
            rows.append(tiles)
        middle = SIDE // 2
        # (row + 2 column) mod 9 never puts a task beside or above itself
        order = [[(row - middle + 2 * (column - middle)) % SIDE for column in range(SIDE)] for row in range(SIDE)]
        return np.vstack([np.hstack([rows[kind][row] for kind in kinds]) for row, kinds in enumerate(order)])


def zoomed(wall: Picture, middle: Picture, across: float) -> Picture:
    """The part of a wall that has so many worlds across, with a sharp picture of the one in the middle."""
    width, height = TILE[0] * SIDE, TILE[1] * SIDE
    half = 0.5 * min(across / SIDE, 1.0)
    low, high = max(0.5 - half, 0.0), min(0.5 + half, 1.0)
    box = (low * width, low * height, high * width, high * height)
    seen = Image.fromarray(wall).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS, box=box)
    size = (round(WIDTH / across), round(HEIGHT / across))
    place = ((WIDTH - size[0]) // 2, (HEIGHT - size[1]) // 2)
    seen.paste(Image.fromarray(middle).resize(size, Image.Resampling.LANCZOS), place)
    return np.asarray(seen)


def stairs_and_wall() -> Iterator[Picture]:
    """The quadruped alone, then among ever more worlds."""
    player, camera = stairs()
    alone, joined, end = 4.6, 7.2, 10.1
    for time in times(alone, joined):
        player.play(time)
        yield camera.render(time)[0]
    wall = Wall(player)
    for index, time in enumerate(times(joined, end)):
        share = min((time - joined) / ZOOMING, 1.0)
        # All of the wall changes in every frame: at half the rate once it stands still, or the file would be too large
        if share < 1.0 or index % 2 == 0:
            player.play(time)
            across = math.exp(math.log(SIDE) * share * share * (3.0 - 2.0 * share))
            picture = zoomed(wall.render(time - joined + 1.0), camera.render(time)[0], across)
        yield picture


def write_gif(path: Path, pictures: list[Picture]) -> None:
    """Write a GIF that repeats; pixels that hardly change are left as they are."""
    some = [pictures[round(index)] for index in np.linspace(0, len(pictures) - 1, 12)]
    palette = Image.fromarray(np.concatenate(some)).quantize(255, Image.Quantize.MEDIANCUT)
    entries = (palette.getpalette() or [])[: 3 * 255]
    colours = np.array(entries, np.int16).reshape(-1, 3)
    frames: list[Image.Image] = []
    before: npt.NDArray[np.uint8] | None = None
    for picture in pictures:
        found = np.asarray(Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)).copy()
        if before is None:
            shown, written = found, found
        else:
            same = np.abs(picture.astype(np.int16) - colours[before]).max(axis=-1) <= NEAR
            shown = np.where(same, before, found)
            written = np.where(shown == before, 255, shown).astype(np.uint8)
        before = shown
        frame = Image.fromarray(written, mode="P")
        frame.putpalette([*entries, 0, 0, 0])
        frames.append(frame)
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=round(1000.0 * PERIOD), loop=0, transparency=255,
        disposal=1, optimize=False,
    )  # fmt: skip


def main() -> None:
    """Make the film."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=OUTPUT, help="file of the GIF")
    parser.add_argument("--frames", type=Path, help="folder for the frames as PNG")
    arguments = parser.parse_args()
    pictures = []
    for index, picture in enumerate(itertools.chain(trucks(), stairs_and_wall())):
        pictures.append(picture)
        if arguments.frames is not None:
            arguments.frames.mkdir(parents=True, exist_ok=True)
            Image.fromarray(picture).save(arguments.frames / f"{index:03d}.png")
    write_gif(arguments.output, pictures)
    print(f"wrote {arguments.output}: {len(pictures)} frames, {arguments.output.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
