"""Lidars by name: the files in `data/lidar`."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, Final

from simwarp.sensors.beams import Beam, BeamTable, beam_grid
from simwarp.sensors.contract import Schedule
from simwarp.sensors.lidar import LidarConfig, LidarNoise
from simwarp.types import ModelError

FOLDER: Final = Path(__file__).parent / "data" / "lidar"


def lidar_names() -> tuple[str, ...]:
    """The lidars that `lidar_preset` knows."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.json")))


def lidar_preset(name: str, **changes: Any) -> LidarConfig:
    """A lidar by name; `changes` replace fields of its `LidarConfig`.

    "vlp-16", "hdl-32e" and "generic" have the numbers of Project Chrono's sensor files: 20 Hz sweeps over a full turn
    with 900 x 16 and 1080 x 32 beams of 3 mrad, and 30 Hz at once with 4500 x 32. "hdl-32e-lasers" has the elevations
    of the manual, which the regular grid of "hdl-32e" rounds; those of the VLP-16 are regular.

    Raises:
        ModelError: no lidar has this name, or a change breaks a rule.
    """
    if name not in lidar_names():
        raise ModelError(f"lidar_preset: there is no '{name}'; known: {', '.join(lidar_names())}")
    data = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    config = LidarConfig(
        schedule=Schedule(rate=data["rate"], window=data["window"], lag=data["lag"]),
        beams=_beams(data),
        beam=Beam(divergence=data["divergence"], radius=data["radius"]),
        mode=data["mode"],
        far=data["far"],
        noise=LidarNoise(**data["noise"]),
    )
    return dataclasses.replace(config, **changes)


def _beams(data: dict[str, Any]) -> BeamTable:
    """A full turn; elevations of the first and the last row, or of all of them."""
    elevation = tuple(data["elevation"])
    grid = beam_grid(data["columns"], data["rows"], elevation=(elevation[0], elevation[-1]))
    return grid if len(elevation) == 2 else BeamTable(azimuth=grid.azimuth, elevation=elevation)
