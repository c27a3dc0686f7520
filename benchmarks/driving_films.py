"""Films of the driving tasks, driven by camera by the shipped policies, and one picture of moments of them.

    python benchmarks/driving_films.py [TASK ...]

Writes docs/films/TASK.mp4 with `simwarp play`, and docs/images/driving_by_camera.jpg from all films that are there.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import imageio.v3 as iio
import numpy as np
from PIL import Image

ROOT: Final = Path(__file__).resolve().parents[1]
FILMS: Final = ROOT / "docs" / "films"
PICTURE: Final = ROOT / "docs" / "images" / "driving_by_camera.jpg"
SIZE: Final = (480, 320)
TASKS: Final[Mapping[str, tuple[str, ...]]] = {
    "obstacle-avoidance": ("--seconds", "9"),
    "off-road": ("--seconds", "10", "--task.hills", "1", "--task.obstacles", "50"),
    "convoy": ("--seconds", "12"),
    "hallway": ("--seconds", "12"),
    "barrier-track": ("--seconds", "12"),
}
"""Options of each film."""
MOMENTS: Final = (0.1, 0.5, 0.9)
"""Of a film, as shares of its length."""


def film(task: str) -> None:
    """Film a task."""
    FILMS.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "simwarp", "play", task, "--checkpoint", "shipped", *TASKS[task],
               "--size", *map(str, SIZE), "--video", str(FILMS / f"{task}.mp4")]  # fmt: skip
    subprocess.run(command, check=True, cwd=ROOT)


def moments(path: Path) -> np.ndarray:
    """Return moments of a film beside each other, (height, width, 3) uint8."""
    images = iio.imread(path)
    return np.hstack([images[round(share * (len(images) - 1))] for share in MOMENTS])


def main() -> None:
    """Make the films that are asked for, then the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"of {', '.join(TASKS)}; by default all")
    wanted = parser.parse_args().tasks or list(TASKS)
    for task in wanted:
        if task not in TASKS:
            parser.error(f"TASK must be of {', '.join(TASKS)}, got {task}")
    for task in wanted:
        film(task)
    rows = [moments(FILMS / f"{task}.mp4") for task in TASKS if (FILMS / f"{task}.mp4").is_file()]
    Image.fromarray(np.vstack(rows)).save(PICTURE, quality=85)
    print(f"wrote {PICTURE}")


if __name__ == "__main__":
    main()
