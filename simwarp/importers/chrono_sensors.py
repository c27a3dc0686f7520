"""Sensors of Project Chrono: its JSON files, as they are, to our configurations.

    config = load_chrono_sensor("data/sensor/json/Velodyne/VLP-16.json")
    lidar = make_sensor(config, scene, Mount("roof"))

Comments are allowed. Filters that show, save or hand over data are left out; any other unknown key or filter is an
error that names the file. Where Chrono's own reader passes over what its files say ("Collection Time", "Divergence
Angle", "Lens Model"; a standard deviation that it reads from the mean), the file counts. Beams are in our order: from
left to right and from the top, over a full turn none twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from simwarp.core.types import ModelError, formatted
from simwarp.importers.chrono_json import Node
from simwarp.importers.chrono_vehicle import expect
from simwarp.sensors.cameras.camera import CameraConfig
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import FishEye, Lens, Pinhole
from simwarp.sensors.interface import Schedule
from simwarp.sensors.motion.gps import GeoOrigin, GpsConfig
from simwarp.sensors.motion.imu import ImuConfig
from simwarp.sensors.motion.magnetometer import MagnetometerConfig
from simwarp.sensors.noise import BiasWalk, Noise, NormalNoise
from simwarp.sensors.ranging.beams import Beam, BeamTable, beam_grid
from simwarp.sensors.ranging.lidar import LidarConfig, LidarNoise
from simwarp.sensors.ranging.radar import Clusters, RadarConfig
from simwarp.vehicle.spec.vehicle_spec import SpecError

GAUSS: Final = 1.0e-4
"""One gauss, the unit of Chrono's magnetometers [T]."""
DIVERGENCE: Final = 0.003
"""Of Chrono's lidars where the file gives none [rad]."""

WINDOWS: Final = ("Collection Window", "Collection Time", "Exposure Time")
LENSES: Final[dict[str, Callable[..., Lens]]] = {
    "PINHOLE": Pinhole, "FOV_LENS": FishEye, "SPHERICAL": FishEye,
}  # fmt: skip
"""SPHERICAL is the former name of FOV_LENS."""
MODES: Final = {f"{mode.upper()}_RETURN": mode for mode in ("strongest", "first", "last", "mean", "dual")}
PASSED_OVER: Final[dict[str, tuple[str, ...]]] = {
    "ChFilterVisualize": ("Width", "Height"),
    "ChFilterVisualizePointCloud": ("Width", "Height", "Zoom"),
    "ChFilterSave": ("Data Path",),
    "ChFilterSavePtCloud": ("Data Path",),
    "ChFilterPCfromDepth": (),
    **{f"ChFilter{kind}Access": () for kind in ("RGBA8", "R8", "DI", "XYZI", "GPS", "Accel", "Gyro", "Magnet")},
}
"""Filters that change no number, with their keys."""


def load_chrono_sensor(path: str | Path) -> Any:
    """The configuration in a Chrono file of type Sensor.

    Returns:
        By the file's template: `CameraConfig`, `LidarConfig`, `RadarConfig`, `GpsConfig`, `ImuConfig` (accelerometer or
        gyroscope alone) or `MagnetometerConfig`, for `simwarp.sensors.presets.make_sensor` or their own classes.

    Raises:
        ModelError: a file that cannot be read, an unknown key, template or filter, or a value that breaks a rule.
    """
    if not isinstance(path, (str, Path)):
        raise ModelError(f"Chrono sensor: must be the path of a JSON file, got {formatted(path)}; pass a str or a Path")
    try:
        node = Node.of_file(Path(path))
        template = expect(node, "Sensor", TEMPLATES)
        properties = node.child("Properties")
        filters = _filters(node, FILTERS.get(template, ()))
        config = TEMPLATES[template](properties, filters)
        node.finish()
    except SpecError as error:
        raise ModelError(str(error)) from None
    return config


def _camera(node: Node, filters: Mapping[str, Node]) -> CameraConfig:
    """Camera. The picture is kept beside its grey version."""
    lens = node.choice("Lens Model", LENSES) if "Lens Model" in node else "PINHOLE"
    imaging: dict[str, Any] = {}
    for name, keys in NOISE_OF_PICTURES.items():
        if name in filters:
            imaging |= {field: filters[name].number(key) for key, field in keys.items()}
    return _made(
        node, CameraConfig,
        schedule=_schedule(node, lag=None),
        width=node.whole("Width"),
        height=node.whole("Height"),
        lens=_made(node, LENSES[lens], fov=node.number("Horizontal Field of View", "rad")),
        outputs=("rgb", "grey") if "ChFilterGrayscale" in filters else ("rgb",),
        samples=node.whole("Supersample Factor") if "Supersample Factor" in node else 1,
        imaging=_made(node, Imaging, **imaging),
    )  # fmt: skip


def _lidar(node: Node, filters: Mapping[str, Node]) -> LidarConfig:
    """Lidar."""
    both = node.number("Divergence Angle", "rad", DIVERGENCE)
    divergence = tuple(node.number(f"{side} Divergence Angle", "rad", both) for side in ("Horizontal", "Vertical"))
    radius = node.whole("Sample Radius") if "Sample Radius" in node else 1
    mode = MODES[node.choice("Return Mode", MODES)] if "Return Mode" in node else "strongest"
    noise = {}
    if "ChFilterLidarNoiseXYZI" in filters:
        found = filters["ChFilterLidarNoiseXYZI"]
        noise = {field: found.number(f"Standard Deviation {key}") for key, field in NOISE_OF_LIDARS.items()}
    return _made(
        node, LidarConfig,
        schedule=_schedule(node, lag=None),
        beams=_grid(node, node.number("Max Vertical Angle", "rad"), node.number("Min Vertical Angle", "rad")),
        beam=_made(node, Beam, divergence=both if divergence == (both, both) else divergence, radius=radius),
        mode=mode,
        far=node.number("Max Distance", "m"),
        noise=_made(node, LidarNoise, **noise),
        **_near(node),
    )  # fmt: skip


def _radar(node: Node, filters: Mapping[str, Node]) -> RadarConfig:
    """Radar; Chrono gathers returns within 1 m."""
    half = 0.5 * node.number("Vertical Field of View", "rad")
    return _made(
        node, RadarConfig, schedule=_schedule(node, lag=None), rays=_grid(node, half, -half),
        far=node.number("Max Distance", "m"), clusters=Clusters(distance=1.0), **_near(node),
    )  # fmt: skip


def _gps(node: Node, filters: Mapping[str, Node]) -> GpsConfig:
    """GPS, on Chrono's sphere. In older files a filter has noise of its own, which counts."""
    update = filters.get("ChFilterGPSUpdate")
    origin, noise = _origin(node), _noise(node)
    if update is not None:
        origin, noise = _origin(update), _noise(update)
    return _made(node, GpsConfig, schedule=_schedule(node), origin=origin, earth="sphere", noise=noise)


def _inertial(output: str) -> Callable[[Node, Mapping[str, Node]], ImuConfig]:
    """Accelerometer or gyroscope."""

    def read(node: Node, filters: Mapping[str, Node]) -> ImuConfig:
        noise = {f"{output}_noise": _noise(node)}
        return _made(node, ImuConfig, schedule=_schedule(node), outputs=(output,), **noise)

    return read


def _magnetometer(node: Node, filters: Mapping[str, Node]) -> MagnetometerConfig:
    """Magnetometer, gauss to tesla."""
    noise = _noise(node, GAUSS)
    return _made(node, MagnetometerConfig, schedule=_schedule(node), origin=_origin(node), noise=noise)


TEMPLATES: Final[dict[str, Callable[[Node, Mapping[str, Node]], Any]]] = {
    "Camera": _camera,
    "Lidar": _lidar,
    "Radar": _radar,
    "GPS": _gps,
    "Accelerometer": _inertial("accelerometer"),
    "Gyroscope": _inertial("gyroscope"),
    "Magnetometer": _magnetometer,
}
NOISE_OF_PICTURES: Final = {
    "ChFilterCameraNoiseConstNormal": {"Mean": "noise_mean", "Standard Deviation": "noise_sigma"},
    "ChFilterCameraNoisePixDep": {"Variance Slope": "noise_slope", "Variance Intercept": "noise_intercept"},
}
NOISE_OF_LIDARS: Final = {
    "Range": "range", "Vertical Angle": "elevation", "Horizontal Angle": "azimuth", "Intensity": "intensity",
}  # fmt: skip
FILTERS: Final = {
    "Camera": (*NOISE_OF_PICTURES, "ChFilterGrayscale"),
    "Lidar": ("ChFilterLidarNoiseXYZI",),
    "GPS": ("ChFilterGPSUpdate",),
}
"""Filters that change numbers, by template."""


# ---- parts -----------------------------------------------------------------------------------------------------------


def _filters(node: Node, known: tuple[str, ...]) -> dict[str, Node]:
    """The filters that change numbers, by name."""
    found: dict[str, Node] = {}
    for entry in node.each("Filters") if "Filters" in node else ():
        name = entry.choice("Filter", (*known, *PASSED_OVER))
        entry.skip(*PASSED_OVER.get(name, ()))
        if name in found:
            raise entry.place.at("Filter").error(f"{name} stands here twice; give it once")
        if name in known:
            found[name] = entry
    return found


def _schedule(node: Node, lag: float | None = 0.0) -> Schedule:
    """Schedule of a sensor; `lag` where the file gives none (None: one period, as Chrono's ray casters)."""
    rate = node.number("Update Rate", "Hz")
    windows = [key for key in WINDOWS if key in node]
    if len(windows) > 1:
        raise node.place.at(windows[1]).error(f"stands beside {windows[0]!r}, which means the same; give one of them")
    if lag is None and "Lag" not in node:
        lag = 1.0 / rate if rate > 0.0 else 0.0
    found: Schedule = _made(
        node, Schedule, rate=rate, window=node.number(windows[0], "s") if windows else 0.0,
        lag=node.number("Lag", "s", lag),
    )  # fmt: skip
    return found


def _grid(node: Node, top: float, bottom: float) -> BeamTable:
    """Directions of lidar and radar."""
    half = 0.5 * node.number("Horizontal Field of View", "rad")
    found: BeamTable = _made(
        node, beam_grid, columns=node.whole("Width"), rows=node.whole("Height"),
        azimuth=(half, -half), elevation=(top, bottom),
    )  # fmt: skip
    return found


def _near(node: Node) -> dict[str, float]:
    return {"near": node.number("Near Clip", "m")} if "Near Clip" in node else {}


def _origin(node: Node) -> GeoOrigin:
    """Longitude, latitude, altitude."""
    longitude, latitude, altitude = node.numbers("GPS Reference", 3, "deg, deg, m")
    found: GeoOrigin = _made(node, GeoOrigin, latitude=latitude, longitude=longitude, altitude=altitude)
    return found


def _noise(node: Node, unit: float = 1.0) -> tuple[Noise, ...]:
    """A noise model: none, normal, or normal with a walking bias of b sqrt(1 / (f tau)) per sample."""
    old = "GPS Noise Model" in node
    if not old and "Noise Model" not in node:
        return ()
    model = node.child("GPS Noise Model" if old else "Noise Model")
    kinds = ("ChGPSNoiseNone", "ChGPSNoiseNormal") if old else ("ChNoiseNone", "ChNoiseNormal", "ChNoiseNormalDrift")
    kind = model.choice("Noise Model" if old else "Noise Type", kinds)
    if kind.endswith("None"):
        return ()
    mean, std = (tuple(unit * v for v in model.numbers(key, 3)) for key in ("Mean", "Standard Deviation"))
    normal = _made(model, NormalNoise, mean=mean, std=std)
    if not kind.endswith("Drift"):
        return (normal,)
    model.skip("Update Rate")  # cancels: f samples a second, each of variance b² / (f tau)
    bias = unit * model.number("Drift Bias" if "Drift Bias" in model else "Bias Drift")
    tau = model.number("Tau Drift", "s")
    if not tau > 0.0:
        raise model.place.at("Tau Drift").error(f"must be > 0 s, got {formatted(tau)}")
    return (normal, _made(model, BiasWalk, rate=bias / math.sqrt(tau))) if bias else (normal,)


def _made(node: Node, cls: Callable[..., Any], **fields: Any) -> Any:
    """Result of a class or function; its errors name the file."""
    try:
        return cls(**fields)
    except ModelError as error:
        raise node.place.error(str(error)) from None
