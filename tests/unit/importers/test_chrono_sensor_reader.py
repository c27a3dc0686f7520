"""Chrono's sensor files, as they are: the shipped sensors, units converted, mistakes named.

`chrono_sensor_files.json` holds values of Project Chrono's data/sensor/json (BSD-3-Clause): path -> file.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simwarp.core.types import ModelError
from simwarp.importers.chrono_sensors import load_chrono_sensor
from simwarp.sensors.cameras.lenses import FishEye, Pinhole
from simwarp.sensors.interface import Schedule
from simwarp.sensors.motion.imu import ImuConfig
from simwarp.sensors.noise import BiasWalk, NormalNoise
from simwarp.sensors.presets import load_config

VALUES = json.loads((Path(__file__).parent / "chrono_sensor_files.json").read_text(encoding="utf-8"))
VLP, CAMERA, GPS, GYRO = "Velodyne/VLP-16.json", "generic/Camera.json", "generic/GPS.json", "generic/Gyroscope.json"


class Folder:
    """One of Chrono's files in a temporary folder, to be changed."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def read(self, path: str, **changes: Any) -> Any:
        """The configuration; changes of its properties (None: without), or of `Filters`."""
        value = json.loads(json.dumps(VALUES[path]))
        for key, change in changes.items():
            inside = value if key in ("Filters", "Type", "Template", "Properties") else value["Properties"]
            name = key.replace("_", " ")
            if change is None:
                del inside[name]
            else:
                inside[name] = change
        file = self.root / Path(path).name
        file.write_text("// a comment\n" + json.dumps(value, indent=2).replace("{", "{ /* more */", 1))
        return load_chrono_sensor(file)

    def error(self, path: str, **changes: Any) -> str:
        with pytest.raises(ModelError) as caught:
            self.read(path, **changes)
        assert "\n" not in str(caught.value)
        return str(caught.value)


@pytest.fixture
def chrono(tmp_path):
    return Folder(tmp_path)


def plain(config: Any) -> Any:
    """A configuration as dictionaries of plain values, to be compared."""
    if hasattr(config, "__dataclass_fields__"):
        return {name: plain(getattr(config, name)) for name in config.__dataclass_fields__}
    if isinstance(config, np.ndarray):
        return config.tolist()
    return tuple(plain(item) for item in config) if isinstance(config, tuple) else config


def spread(config: dict[str, Any]) -> dict[str, Any]:
    """Noises with a number for each axis."""
    found = dict(config)
    for key, value in config.items():
        if key.endswith("noise") and isinstance(value, tuple):
            found[key] = tuple(
                {name: v if isinstance(v, tuple) else (v,) * 3 for name, v in stage.items()} for stage in value
            )
    return found


def differences(a: Any, b: Any, place: str = "") -> list[str]:
    """Where two values differ by more than a billionth."""
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        return [line for key in a for line in differences(a[key], b[key], f"{place}.{key}")]
    if isinstance(a, (tuple, list)) and isinstance(b, (tuple, list)) and len(a) == len(b):
        return [line for k, (x, y) in enumerate(zip(a, b, strict=True)) for line in differences(x, y, f"{place}[{k}]")]
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return [] if abs(a - b) <= 1e-9 * max(abs(a), abs(b), 1e-30) or abs(a - b) < 1e-11 else [f"{place}: {a}, {b}"]
    return [] if a == b else [f"{place}: {a!r}, {b!r}"]


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("Velodyne/VLP-16.json", "vlp-16"),
        ("Velodyne/HDL-32E.json", "hdl-32e"),
        ("generic/Lidar.json", "generic-lidar"),
        ("generic/Camera.json", "generic-camera"),
        ("generic/GPS.json", "generic-gps"),
        ("generic/Magnetometer.json", "generic-magnetometer"),
    ],
)
def test_the_files_are_the_shipped_sensors(chrono, path, name):
    theirs, ours = spread(plain(chrono.read(path))), spread(plain(load_config(name)))
    assert differences(theirs, ours) == []


def test_accelerometer_and_gyroscope_are_the_shipped_unit_together(chrono):
    ours = load_config("generic-imu")
    for part in ("accelerometer", "gyroscope"):
        theirs = chrono.read(f"generic/{part.capitalize()}.json")
        assert isinstance(theirs, ImuConfig)
        assert theirs.outputs == (part,)
        assert theirs.schedule == ours.schedule == Schedule(rate=100.0, window=0.01, lag=0.01)
        assert getattr(theirs, f"{part}_noise") == (NormalNoise(std=(0.001,) * 3, mean=(0.0,) * 3),)


def test_noise_models(chrono):
    def noise(**model: Any) -> Any:
        return chrono.read("generic/Gyroscope.json", Noise_Model=model).gyroscope_noise

    spreads = {"Mean": [0.1, 0.2, 0.3], "Standard Deviation": [1.0, 2.0, 3.0]}
    normal = NormalNoise(mean=(0.1, 0.2, 0.3), std=(1.0, 2.0, 3.0))
    assert noise(**{"Noise Type": "ChNoiseNone"}) == ()
    assert noise(**{"Noise Type": "ChNoiseNormal"}, **spreads) == (normal,)
    drift = {"Noise Type": "ChNoiseNormalDrift", "Update Rate": 50.0, "Tau Drift": 0.25, **spreads}
    # b sqrt(1 / (f tau)) per sample, f samples a second: b / sqrt(tau) per root second
    assert noise(**drift, **{"Bias Drift": 0.02}) == (normal, BiasWalk(rate=0.04))
    assert noise(**drift, **{"Drift Bias": 0.02}) == (normal, BiasWalk(rate=0.04))
    assert noise(**drift, **{"Drift Bias": 0.0}) == (normal,)
    assert chrono.read("generic/Gyroscope.json", Noise_Model=None).gyroscope_noise == ()
    gps = {"Noise Type": "ChNoiseNormal", "Mean": [1.0, 1.0, 1.0], "Standard Deviation": [2.0, 3.0, 1.0]}
    path = "generic/GPS.json"
    assert chrono.read(path, GPS_Noise_Model=None, Noise_Model=gps, Filters=[]).noise == chrono.read(path).noise
    field = chrono.read("generic/Magnetometer.json").noise[0]
    assert field.std == pytest.approx((1e-7,) * 3)


def test_lags_windows_and_lenses(chrono):
    camera, lidar, gyro = "generic/Camera.json", "generic/Lidar.json", "generic/Gyroscope.json"
    # what casts rays is a period late where the file does not tell, the others are not late
    assert chrono.read(camera, Lag=None).schedule == Schedule(rate=30.0, lag=1.0 / 30.0)
    assert chrono.read(lidar, Lag=None, Collection_Time=None).schedule == Schedule(rate=30.0, lag=1.0 / 30.0)
    assert chrono.read(gyro, Lag=None).schedule == Schedule(rate=100.0, window=0.01)
    assert chrono.read(camera, Exposure_Time=0.01).schedule.window == 0.01
    assert chrono.read(camera).lens == chrono.read(camera, Lens_Model="FOV_LENS").lens == FishEye(fov=1.408)
    assert chrono.read(camera, Lens_Model=None).lens == Pinhole(fov=1.408)
    assert chrono.read(camera, Filters=[{"Filter": "ChFilterRGBA8Access"}]).outputs == ("rgb",)
    constant = [{"Filter": "ChFilterCameraNoiseConstNormal", "Mean": 0.01, "Standard Deviation": 0.02, "Name": "n"}]
    imaging = chrono.read(camera, Filters=constant).imaging
    assert (imaging.noise_mean, imaging.noise_sigma, imaging.noise_slope) == (0.01, 0.02, 0.0)


def test_beams(chrono):
    vlp = "Velodyne/VLP-16.json"
    angles = {"Vertical Divergence Angle": 0.001, "Horizontal Divergence Angle": 0.002}
    config = chrono.read(vlp, Divergence_Angle=None, **angles, Return_Mode="DUAL_RETURN", Near_Clip=0.2)
    assert config.beam.divergence == (0.002, 0.001)
    assert (config.mode, config.near) == ("dual", 0.2)
    narrow = chrono.read(vlp, Horizontal_Field_of_View=1.0, Width=3, Height=2)
    assert narrow.beams.angles()[0][0] == pytest.approx([0.5, 0.0, -0.5])
    assert narrow.beams.angles()[1][:, 0] == pytest.approx([0.261799, -0.261799])
    properties = {
        "Update Rate": 20, "Width": 5, "Height": 3, "Horizontal Field of View": 0.8, "Vertical Field of View": 0.2,
        "Max Distance": 80.0, "Collection Window": 0.01,
    }  # fmt: skip
    radar = chrono.read(vlp, Template="Radar", Properties=properties, Filters=None)
    assert radar.rays.angles()[0][0] == pytest.approx([0.4, 0.2, 0.0, -0.2, -0.4])
    assert radar.rays.angles()[1][:, 0] == pytest.approx([0.1, 0.0, -0.1], abs=1e-15)
    assert radar.clusters.distance == 1.0
    assert radar.schedule == Schedule(rate=20.0, window=0.01, lag=0.05)
    assert math.isclose(radar.far, 80.0)


@pytest.mark.parametrize(
    ("path", "changes", "message"),
    [
        (VLP, {"Max_Rnge": 3}, "Properties.Max Rnge: unknown key (did you mean 'Max Distance'?); known: "),
        (VLP, {"Lags": 3}, "Properties.Lags: unknown key (did you mean 'Lag'?); known: "),
        (VLP, {"Update_Rate": None}, "Properties.Update Rate: missing; give a number [Hz]"),
        (VLP, {"Update_Rate": 0}, "Properties: Schedule: rate must be positive, got 0.0"),
        (VLP, {"Lag": -0.1}, "Properties: Schedule: lag must be zero or positive, got -0.1"),
        (VLP, {"Width": 9.5}, "Properties.Width: must be a whole number, got 9.5"),
        (VLP, {"Height": 0}, "Properties: beam_grid: rows must be at least 1, got 0"),
        (VLP, {"Collection_Time": 0.01},
         "Properties.Collection Time: stands beside 'Collection Window', which means the same; give one"),
        (VLP, {"Return_Mode": "STRONG"},
         "Properties.Return Mode: must be one of STRONGEST_RETURN, FIRST_RETURN"),
        (VLP, {"Filters": [{"Filter": "ChFilterLidarNoise"}]},
         "Filters[0].Filter: must be one of ChFilterLidarNoiseXYZI, "),
        (VLP, {"Filters": [{"Filter": "ChFilterDIAccess", "Gain": 2}]}, "Filters[0].Gain: unknown key"),
        (VLP, {"Filters": 3}, "Filters: must be a list of objects, got 3"),
        (VLP, {"Type": "Vehicle"}, "Type: must be one of Sensor, got 'Vehicle'"),
        (VLP, {"Template": "Sonar"}, "Template: must be one of Camera, Lidar, Radar, GPS, "),
        (CAMERA, {"Width": 0}, "Properties: CameraConfig: width must be at least 1, got 0"),
        (CAMERA, {"Horizontal_Field_of_View": 7.0}, "Properties: FishEye: fov must be in (0, "),
        (CAMERA, {"Filters": [{"Filter": "ChFilterCameraNoisePixDep", "Gain": 0.0}]},
         "Filters[0].Variance Slope: missing"),
        (CAMERA, {"Filters": [{"Filter": "ChFilterGrayscale"}] * 2},
         "Filters[1].Filter: ChFilterGrayscale stands here twice; give it once"),
        (GPS, {"GPS_Reference": [1, 2]}, "Properties.GPS Reference: must be a list of 3 numbers"),
        (GPS, {"GPS_Reference": [0, 91, 0], "Filters": []},
         "Properties: GeoOrigin: latitude must be in [-90, 90], got 91.0"),
        (GYRO, {"Noise_Model": {"Noise Type": "Normal"}},
         "Properties.Noise Model.Noise Type: must be one of ChNoiseNone, ChNoiseNormal, "),
    ],
)  # fmt: skip
def test_mistakes_name_file_and_key(chrono, path, changes, message):
    assert chrono.error(path, **changes).startswith(f"{Path(path).name}: {message}")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ModelError, match=r"nothing.json: cannot be read: No such file"):
        load_chrono_sensor(tmp_path / "nothing.json")
    (tmp_path / "broken.json").write_text('{"Type": }')
    with pytest.raises(ModelError, match=r"broken.json: line 1 column 10: broken JSON: Expecting value"):
        load_chrono_sensor(tmp_path / "broken.json")
