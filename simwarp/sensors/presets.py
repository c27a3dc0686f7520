"""Sensors by name or from a file: `load_sensor("vlp-16", scene, Mount("roof"))`.

A file is one JSON object: the key "sensor" says what it is, and the other keys are the fields of its configuration,
whose own fields are objects in turn::

    {
      "sensor": "imu",
      "summary": "a line for people",
      "schedule": {"rate": 200.0, "window": 0.005},
      "gyroscope_noise": [{"kind": "normal", "std": 0.001}, {"kind": "saturation", "lower": -8.7, "upper": 8.7}]
    }

Lenses have a kind too ("pinhole", "fish-eye", "radial"), noises are "normal", "bias-walk", "bounded-drift",
"quantisation" or "saturation". Beams are {"columns": .., "rows": .., "azimuth": [first, last], "elevation": [first,
last]} (or all the rows' elevations), or tables of both angles. Units are SI, angles in rad, as in the configurations.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Final, NamedTuple

from simwarp.core.files import FileError, parse_json, read_text
from simwarp.core.schema import Place
from simwarp.core.types import ModelError, formatted
from simwarp.core.wording import nearest
from simwarp.model.model import Model
from simwarp.model.rules import RULES
from simwarp.sensors.cameras.camera import Camera, CameraConfig
from simwarp.sensors.interface import Sensor
from simwarp.sensors.motion.encoders import (
    Encoder,
    EncoderConfig,
    Speedometer,
    SpeedometerConfig,
    Tachometer,
    TachometerConfig,
)
from simwarp.sensors.motion.force_sensor import ContactSensor, ContactSensorConfig, LoadCell, LoadCellConfig
from simwarp.sensors.motion.gps import Gps, GpsConfig
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.motion.magnetometer import Magnetometer, MagnetometerConfig
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig
from simwarp.sensors.ranging.radar import Radar, RadarConfig
from simwarp.sensors.scene import Scene
from simwarp.sensors.shipped import DATA, sensor_names


class Kind(NamedTuple):
    """A sort of sensors."""

    config: type
    sensor: Any
    sees: bool = False


KINDS: Final = {
    "camera": Kind(CameraConfig, Camera, sees=True),
    "lidar": Kind(LidarConfig, Lidar, sees=True),
    "radar": Kind(RadarConfig, Radar, sees=True),
    "imu": Kind(ImuConfig, Imu),
    "gps": Kind(GpsConfig, Gps),
    "magnetometer": Kind(MagnetometerConfig, Magnetometer),
    "encoder": Kind(EncoderConfig, Encoder),
    "tachometer": Kind(TachometerConfig, Tachometer),
    "speedometer": Kind(SpeedometerConfig, Speedometer),
    "contact": Kind(ContactSensorConfig, ContactSensor),
    "load-cell": Kind(LoadCellConfig, LoadCell),
}
"""By the key "sensor" of a file."""

FOR_PEOPLE: Final = ("summary", "source", "$schema")
"""Keys beside those of the configuration: texts for people and their editors."""


def load_config(path_or_name: str | Path, **changes: Any) -> Any:
    """The configuration in a file, or of the shipped sensor of that name ("vlp-16", "VLP16", "hood-camera" ...).

    Args:
        path_or_name: a path ends in .json or has a folder; `simwarp list` shows the names.
        changes: replace fields of the configuration.

    Returns:
        A `CameraConfig`, `LidarConfig`, `ImuConfig` ... as the file says.

    Raises:
        ModelError: unknown name, unreadable file, an unknown or missing key, or a value that breaks a rule.
    """
    path = _path_of(path_or_name)
    place = Place(path.name, ModelError)
    if _is_of_chrono(path):
        raise place.error(
            "must be a file of simwarp, got one of Project Chrono; read it with "
            "simwarp.importers.chrono_sensors.load_chrono_sensor(path)"
        )
    members = _read_object(path)
    sort = members.pop("sensor", None)
    if sort is None:
        raise place.at("sensor").error(f"missing; give one of {', '.join(KINDS)}")
    if not isinstance(sort, str) or sort not in KINDS:
        raise place.at("sensor").error(
            f"must be one of {', '.join(KINDS)}, got {formatted(sort)}{nearest(sort, KINDS)}"
        )
    for key in FOR_PEOPLE:
        if not isinstance(members.pop(key, ""), str):
            raise place.at(key).error("must be a text")
    config = RULES.load(KINDS[sort].config, members, lambda fault: place.line(fault._replace(kind="value")))
    names = [field.name for field in dataclasses.fields(config)]
    for key in changes:
        if key not in names:
            raise ModelError(f"{path.stem}: there is no '{key}' to change{nearest(key, names)}; {', '.join(names)}")
    return dataclasses.replace(config, **changes)


def make_sensor(config: Any, world: Scene | Model, place: Any, *, name: str | None = None, **options: Any) -> Sensor:
    """The sensor that a configuration describes.

    Args:
        config: from `load_config`, from an importer, or made by hand.
        world: the `Scene` that it sees (camera, lidar, radar); the `Model` that it measures, or a Scene of it.
        place: a `Mount`; joints of an encoder; a mount or a joint of a tachometer; the joint of a load cell.
        name: unique in a Simulation; None: its sort ("lidar").
        options: further arguments of its class, such as `seed`, `randomised`, `per_world` or `lights`.

    Raises:
        ModelError: `config` is none, or the sensor cannot be made.
    """
    sort = next((sort for sort, kind in KINDS.items() if type(config) is kind.config), None)
    if sort is None:
        known = ", ".join(kind.config.__name__ for kind in KINDS.values())
        raise ModelError(
            f"make_sensor: config must be one of {known}, got {formatted(config)}; take what load_config returns"
        )
    kind, thing = KINDS[sort], f"{sort} '{name or sort}'"
    if kind.sees and not isinstance(world, Scene):
        raise ModelError(f"{thing}: world must be a Scene, got {formatted(world)}; write visuals.finalize(model)")
    if not isinstance(world, (Scene, Model)):
        raise ModelError(
            f"{thing}: world must be a Model or a Scene, got {formatted(world)}; take what finalize returned"
        )
    target = world if kind.sees or isinstance(world, Model) else world.model
    sensor: Sensor = kind.sensor(target, place, config, name=name or sort, **options)
    return sensor


def load_sensor(
    path_or_name: str | Path, world: Scene | Model, place: Any, *, name: str | None = None, **options: Any
) -> Sensor:
    """A sensor by name or from a file, on a body or a joint: `load_sensor("vlp-16", scene, Mount("roof"))`.

    Args:
        path_or_name: see `load_config`.
        world, place, options: see `make_sensor`.
        name: unique in a Simulation; None: the name of the file.

    Raises:
        ModelError: see `load_config` and `make_sensor`.
    """
    config = load_config(path_or_name)
    return make_sensor(config, world, place, name=name or _path_of(path_or_name).stem, **options)


def _read_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        ModelError: it cannot be read, is broken, or holds something else.
    """
    try:
        value = parse_json(read_text(path), path.name)
    except FileError as error:
        raise ModelError(f"{path}: cannot be read: {error.reason}" if error.reason else str(error)) from None
    if not isinstance(value, dict):
        raise ModelError(f"{path.name}: must be an object, got {formatted(value)}")
    return value


def _is_of_chrono(path: Path) -> bool:
    """True if a file has the keys of Chrono's sensor files."""
    try:
        text = read_text(path)
    except FileError:
        return False  # whoever reads it says so
    return all(f'"{key}"' in text for key in ("Type", "Template")) and '"sensor"' not in text


def _path_of(path_or_name: str | Path) -> Path:
    """The file of a name, in any case and with or without hyphens, or the path itself."""
    if not isinstance(path_or_name, (str, Path)):
        raise ModelError(
            f"sensor: must be a name or the path of a JSON file, got {formatted(path_or_name)}; `simwarp list` "
            "has names"
        )
    text = str(path_or_name)
    if isinstance(path_or_name, Path) or text.endswith(".json") or "/" in text or "\\" in text:
        return Path(path_or_name)
    names = {_plain(name): name for name in sensor_names()}
    if _plain(text) not in names:
        known = sorted(names.values())
        raise ModelError(f"sensor {formatted(text)}: not shipped{nearest(text, known)}; known: {', '.join(known)}")
    return DATA / f"{names[_plain(text)]}.json"


def _plain(name: str) -> str:
    return name.lower().replace("-", "").replace("_", "")
