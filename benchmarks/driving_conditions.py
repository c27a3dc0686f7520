"""What the policy's camera sees in conditions of driving: one picture for each, as a contact sheet.

    python benchmarks/driving_conditions.py                     # writes docs/images/driving_conditions.jpg
    python benchmarks/driving_conditions.py --output sheet.png

Cameras have twice or more the pixels of a policy's image, so that people see something; noise and contrast act on each
of them as on the policy's own.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.tasks import make  # noqa: E402

PICTURE: Final = ROOT / "docs" / "images" / "driving_conditions.jpg"
SIZE: Final = (240, 135)
CAPTION: Final = 17
COLUMNS: Final = 4
GAP: Final = 4
SHEETS: Final[Mapping[str, Mapping[str, Any]]] = {
    "obstacle-avoidance": {},
    "off-road": {"obstacles": 30, "hills": 0.5},
}
"""Tasks, and fields of their configurations."""
SEED: Final = 4


@dataclasses.dataclass(frozen=True)
class Frame:
    """A picture: its caption, and what the conditions are."""

    caption: str
    conditions: Mapping[str, Any]


FRAMES: Final = (
    Frame("nominal", {}),
    Frame("sun 12° high, from the left", {"sun_elevation": math.radians(12.0), "sun_azimuth": math.radians(90.0)}),
    Frame("light 0.35, sun 8° high", {"light": 0.35, "sun_elevation": math.radians(8.0)}),
    Frame("fog 0.03 /m: sight 130 m", {"fog": 0.03}),
    Frame("noise 0.05", {"image_noise": 0.05}),
    Frame("contrast 0.5", {"contrast": 0.5}),
    Frame("fog 0.02 /m, light 0.5", {"fog": 0.02, "light": 0.5}),
    Frame("--task.conditions random", {"conditions": "random"}),
)


def image_of(task_name: str, conditions: Mapping[str, Any]) -> npt.NDArray[np.uint8]:
    """Return (height, width, 3), what the camera sees at the start of an episode."""
    fields: dict[str, Any] = {"obs": "camera", "camera_width": SIZE[0], "camera_height": SIZE[1]}
    task = make(task_name, 1, seed=SEED, **fields, **SHEETS[task_name], **conditions)
    seen: npt.NDArray[np.uint8] = task.observe()["camera"][0].numpy()
    return seen


def contact_sheet(frames: Sequence[Frame], tasks: Sequence[str]) -> Image.Image:
    """Return the pictures of all tasks, a few beside each other, with captions below."""
    rows = -(-len(frames) // COLUMNS)
    wide, high = SIZE[0] + GAP, SIZE[1] + CAPTION
    sheet = Image.new("RGB", (COLUMNS * wide - GAP, len(tasks) * rows * high), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for block, task in enumerate(tasks):
        for index, frame in enumerate(frames):
            row, column = divmod(index, COLUMNS)
            place = (column * wide, (block * rows + row) * high)
            sheet.paste(Image.fromarray(image_of(task, frame.conditions)), place)
            pen.text((place[0] + 2, place[1] + SIZE[1] + 1), frame.caption, fill="#1f2933", font=font)
    return sheet


def main() -> None:
    """Write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=PICTURE)
    options = parser.parse_args()
    start_warp()
    contact_sheet(FRAMES, tuple(SHEETS)).save(options.output, quality=82)
    print(f"wrote {options.output}: {options.output.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
