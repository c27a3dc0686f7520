"""The shipped sensors, one line each: the files in `data`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

DATA: Final = Path(__file__).parent / "data"


def sensor_names() -> list[str]:
    """Names of the shipped sensors."""
    return sorted(path.stem for path in DATA.glob("*.json"))


def catalogue() -> dict[str, str]:
    """Summaries of the shipped sensors by name."""
    return {name: json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))["summary"] for name in sensor_names()}
