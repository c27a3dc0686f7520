"""Sensors on a chassis by names on the command line: `--sensors vlp-16@0:0:1.2,mems-imu`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from simwarp.cli import UsageError

if TYPE_CHECKING:
    from simwarp.sensors.scene import Scene
    from simwarp.simulation.attachments import Sensor

SENSORS_HINT: Final = "(default: none)"

ROOF: Final = (0.0, 0.0, 1.5)
"""Where cameras, lidars and radars are unless it is said, from the chassis' centre of mass [m]."""


def words_of(text: str | None) -> list[str]:
    """Sensors in the text of the option, each with its place."""
    return [word.strip() for word in (text or "").split(",") if word.strip()]


def placed(word: str) -> tuple[str, tuple[float, ...] | None]:
    """Name and place of a sensor.

    Raises:
        UsageError: the place is none.
    """
    name, found, text = word.partition("@")
    try:
        place = tuple(float(number) for number in text.split(":"))
    except ValueError:
        place = ()
    if found and not (len(place) == 3 and all(map(math.isfinite, place))):
        raise UsageError(f"--sensors: a place must be x:y:z in metres, got '{text}' of '{name}'; write {name}@0:0:1.2")
    return name, place if found else None


def mounted_sensors(text: str | None, vehicle: Any, scene: Scene, seed: int = 0) -> list[Sensor]:
    """Sensors on the chassis of a vehicle.

    Args:
        text: of the option; None: there are none.
        vehicle: whose chassis it is.
        scene: that they see.
        seed: of their noise.

    Raises:
        UsageError: a place is none.
        ModelError: there is no such sensor.
    """
    from simwarp.core.types import pose
    from simwarp.sensors import CameraConfig, LidarConfig, Mount, RadarConfig, load_config, make_sensor

    words, found = words_of(text), []
    for number, (name, place) in enumerate(map(placed, words)):
        config = load_config(name)
        usual = ROOF if isinstance(config, (CameraConfig, LidarConfig, RadarConfig)) else (0.0, 0.0, 0.0)
        mount = Mount(vehicle.parts.chassis, pose(usual if place is None else place))
        earlier = sum(placed(other)[0] == name for other in words[:number])
        title = Path(name).stem if not earlier else f"{Path(name).stem}-{earlier + 1}"
        found.append(make_sensor(config, scene, mount, name=title, seed=seed))
    return found
