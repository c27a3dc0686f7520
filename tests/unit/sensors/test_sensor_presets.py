"""Sensors by name and from files: the shipped ones, those of users, and what is wrong with a file."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.cli.listing import catalogue as listed
from simwarp.core.schema import field_hints
from simwarp.sensors.cameras.camera import Camera
from simwarp.sensors.cameras.lenses import Pinhole, Radial
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.encoders import Encoder
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.noise import BoundedDrift, NormalNoise, Quantisation, Saturation
from simwarp.sensors.presets import KINDS, load_config, load_sensor, make_sensor
from simwarp.sensors.ranging.beams import HDL_32E_ELEVATION, VLP_16_ELEVATION, BeamTable
from simwarp.sensors.ranging.lidar import Lidar, LidarNoise
from simwarp.sensors.ranging.radar import Clusters
from simwarp.sensors.scene import Scene, Visuals
from simwarp.sensors.shipped import catalogue, sensor_names

LIDARS = {"vlp-16": (16, 900), "hdl-32e": (32, 1080), "hdl-32e-lasers": (32, 1080), "generic-lidar": (32, 4500)}


def cart() -> tuple[sw.Model, Scene]:
    """A box on a post, which a hinge holds, above the ground."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    box = builder.add_solid("box", "box", (0.5, 0.3, 0.1), mass=2.0, pose=sw.pose((0.0, 0.0, 1.0)))
    builder.add_joint_revolute("post", sw.WORLD, box, axis=(0.0, 0.0, 1.0))
    visuals = Visuals(builder)
    visuals.add_sphere(sw.WORLD, radius=1.0, pose=sw.pose((4.0, 0.0, 1.0)), name="lamp")
    model = builder.finalize(2, "cpu")
    return model, visuals.finalize(model)


def place_of(sort: str) -> Any:
    """Where a sensor of a sort sits on the cart."""
    return "post" if sort in ("encoder", "load-cell") else Mount("box", sw.pose((0.0, 0.0, 0.2)))


def test_every_shipped_sensor_is_told_in_a_line_and_can_be_loaded():
    lines = listed("simwarp.sensors.shipped")  # as `simwarp list` does
    assert lines == catalogue()
    assert list(lines) == sensor_names()
    assert {type(load_config(name)) for name in lines} == {kind.config for kind in KINDS.values()}
    for name, line in lines.items():
        assert 10 < len(line) <= 110, name
        assert "\n" not in line


@pytest.mark.parametrize("name", [name for name in sensor_names() if name not in LIDARS and name != "generic-camera"])
def test_shipped_sensors_run(name):
    """Two steps each; lidars and the large camera have tests of their own."""
    model, scene = cart()
    sort = next(sort for sort, kind in KINDS.items() if type(load_config(name)) is kind.config)
    sensor = load_sensor(name, scene, place_of(sort), seed=3)
    assert sensor.name == name
    sim = sw.Simulation(model, 0.01, sensors=[sensor], joint_reactions=True)
    for _ in range(2):
        sim.step()
    assert sensor.valid.numpy().all()
    assert np.isfinite(sensor.data.numpy()).all()


def test_lidars_are_those_of_their_makers():
    for name, shape in LIDARS.items():
        preset = load_config(name)
        assert preset.beams.shape == shape
        assert preset.far == 100.0
        assert preset.schedule.lag == 0.01
        assert preset.mode == "strongest"
        assert len(preset.beam.offsets()) == 9
    one = load_config("vlp-16", miss="far")
    assert one.miss == "far"
    assert (one.schedule.rate, one.schedule.window) == (20.0, 0.05)
    assert one.noise == LidarNoise(range=0.01, azimuth=0.001, elevation=0.001, intensity=0.01)
    assert one.beams.angles()[1][:, 0] == pytest.approx(VLP_16_ELEVATION, abs=1e-6)
    lasers = load_config("hdl-32e-lasers").beams.angles()[1][:, 0]
    assert lasers == pytest.approx(HDL_32E_ELEVATION, abs=1e-6)
    # the regular grid rounds them to some hundredths of a degree
    assert load_config("hdl-32e").beams.angles()[1][:, 0] == pytest.approx(lasers, abs=math.radians(0.02))


def test_names_may_be_written_as_people_do():
    assert load_config("VLP16").beams.shape == load_config("vlp_16").beams.shape == (16, 900)
    assert isinstance(load_sensor("Hood_Camera", cart()[1], Mount("box")), Camera)


def test_the_camera_of_the_gym():
    camera = load_config("hood-camera")
    assert (camera.width, camera.height, camera.lens) == (80, 45, Pinhole(fov=math.pi / 3.0))
    assert camera.outputs == ("rgb",)


def test_sensors_are_made_from_configurations_with_their_options():
    model, scene = cart()
    imu = make_sensor(load_config("mems-imu", outputs=("gyroscope",)), model, Mount("box"), seed=1, randomised=True)
    assert isinstance(imu, Imu)
    assert (imu.name, imu.copies, imu.data.shape) == ("imu", 2, (2, 3))
    lidar = make_sensor(load_config("vlp-16"), scene, Mount("box"), name="roof", per_world=("range",))
    assert isinstance(lidar, Lidar)
    assert (lidar.name, lidar.noise["range"].shape) == ("roof", (2,))
    encoder = load_sensor("joint-encoder", model, ["post"], name="turn")
    assert isinstance(encoder, Encoder)
    assert encoder.step.numpy()[0, 0] == pytest.approx(math.tau / 4096.0, rel=1e-12)


# ---- files of users --------------------------------------------------------------------------------------------------


def written(folder: Path, value: Any) -> Path:
    path = folder / "mine.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_a_file_of_ones_own(tmp_path):
    path = written(tmp_path, {
        "sensor": "imu", "schedule": {"rate": 200, "window": 0.005, "lag": 0.01, "phase": "random"},
        "outputs": ["gyroscope"],
        "gyroscope_noise": [
            {"kind": "normal", "std": [0.1, 0.2, 0.3]}, {"kind": "bounded-drift", "std": 1, "time": 60},
            {"kind": "quantisation", "step": 0.01}, {"kind": "saturation", "upper": 8.5},
        ],
    })  # fmt: skip
    expected = ImuConfig(
        schedule=Schedule(rate=200.0, window=0.005, lag=0.01, phase="random"), outputs=("gyroscope",),
        gyroscope_noise=(
            NormalNoise(std=(0.1, 0.2, 0.3)), BoundedDrift(std=1.0, time=60.0), Quantisation(step=0.01),
            Saturation(upper=8.5),
        ),
    )  # fmt: skip
    assert load_config(path) == load_config(str(path)) == expected
    assert load_sensor(path, cart()[0], Mount("box")).name == "mine"


def test_lenses_beams_and_clusters(tmp_path):
    camera = load_config(written(tmp_path, {
        "sensor": "camera", "lens": {"kind": "radial", "fov": 1.2, "k1": -0.1}, "width": 64, "height": 48,
        "outputs": ["rgb", "depth"], "imaging": {"noise_sigma": [0.01, 0.02, 0.03], "exposure": 2},
    }))  # fmt: skip
    assert camera.lens == Radial(fov=1.2, k1=-0.1)
    assert camera.imaging.noise_sigma == (0.01, 0.02, 0.03)
    radar = {"sensor": "radar", "schedule": {"rate": 20}, "rays": {"azimuth": [0.1, 0.0, -0.1], "elevation": [0.0]}}
    table = load_config(written(tmp_path, radar)).rays
    assert isinstance(table, BeamTable)
    assert table.shape == (1, 3)
    assert load_config(written(tmp_path, radar)).clusters is None
    assert load_config(written(tmp_path, {**radar, "clusters": None})).clusters is None
    assert load_config(written(tmp_path, {**radar, "clusters": {"least": 3}})).clusters == Clusters(least=3)
    grid = {"columns": 3, "rows": 3, "azimuth": [0.2, -0.2], "elevation": [0.3, 0.1, 0.0]}
    angles = load_config(written(tmp_path, {**radar, "rays": grid})).rays.angles()
    assert angles[0][1] == pytest.approx([0.2, 0.0, -0.2])
    assert angles[1][:, 0].tolist() == [0.3, 0.1, 0.0]


LIDAR = {
    "sensor": "lidar", "schedule": {"rate": 20.0}, "beams": {"columns": 4, "rows": 2, "elevation": [0.1, -0.1]},
}  # fmt: skip


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({}, "sensor: missing; give one of camera, lidar, radar, imu,"),
        ({"sensor": "lydar"}, "sensor: must be one of camera, lidar, radar,"),
        ({"sensor": "imu", "summary": 3}, "summary: must be a text"),
        ({**LIDAR, "schedle": {}}, "schedle: unknown key (did you mean 'schedule'?); known: schedule, beams,"),
        ({"sensor": "lidar", "beams": LIDAR["beams"]},
         "schedule: missing; give an object with the keys of Schedule"),
        ({"sensor": "lidar", "schedule": {"rate": 5}}, "beams: missing; give an object with the keys of BeamLayout"),
        ({**LIDAR, "schedule": {"window": 0.1}}, "schedule.rate: missing; give frames per second [Hz]"),
        ({**LIDAR, "schedule": 20}, "schedule: must be an object with the keys of Schedule, got 20"),
        ({**LIDAR, "schedule": {"rate": "20"}}, "schedule.rate: must be a number, got '20'"),
        ({**LIDAR, "schedule": {"rate": True}}, "schedule.rate: must be a number, got True"),
        ({**LIDAR, "schedule": {"rate": 0}}, "schedule.rate: must be positive, got 0; give frames per second [Hz]"),
        ({**LIDAR, "schedule": {"rate": 5, "lag": -1}}, "schedule.lag: must be zero or positive, got -1; give seconds"),
        ({**LIDAR, "schedule": {"rate": 5, "phase": "late"}}, "schedule.phase: must be one of 'zero', 'random'"),
        ({**LIDAR, "far": None}, "far: must be a number, got None"),
        ({**LIDAR, "far": 1e999}, "far: must be a finite number, got inf"),
        ({**LIDAR, "mode": "loudest"}, "mode: must be one of 'strongest', 'first', 'last', 'mean', 'dual', got"),
        ({**LIDAR, "outputs": 5}, "outputs: must be a list, got 5"),
        ({**LIDAR, "sweep": 1}, "sweep: must be true or false, got 1"),
        ({**LIDAR, "beam": {"divergence": [0.1, 0.2, 0.3]}},
         "beam.divergence: must be a number or a list of 2 items, got [0.1, 0.2, 0.3]"),
        ({**LIDAR, "noise": {"dropout": 2}}, "noise.dropout: must be in [0, 1], got 2"),
        ({**LIDAR, "noise": {"rnge": 2}}, "noise.rnge: unknown key (did you mean 'range'?)"),
        ({**LIDAR, "beams": {"columns": 4, "elevation": [0]}},
         "beams: needs rows too; a grid has columns, rows, azimuth, elevation"),
        ({**LIDAR, "beams": {"columns": 4, "rows": 1.5, "elevation": [0, 0]}},
         "beams.rows: must be a whole number, got 1.5"),
        ({**LIDAR, "beams": {"columns": 4, "rows": 0, "elevation": [0, 0]}},
         "beams.rows: must be at least 1, got 0"),
        ({**LIDAR, "beams": {"columns": 4, "rows": 4, "elevation": [0, 0, 0]}},
         "beams: elevation must be the first and the last row's, or 4 angles [rad], got 3"),
        ({**LIDAR, "beams": {"azimuth": [0.0]}},
         "beams.elevation: missing; give a list"),
        ({**LIDAR, "beams": {"azimuth": "all", "elevation": [0]}},
         "beams.azimuth: must be a list"),
        ({"sensor": "camera", "lens": {"fov": 1.0}}, "lens.kind: missing; give one of pinhole, fish-eye, radial"),
        ({"sensor": "camera", "lens": {"kind": "fisheye"}},
         "lens.kind: must be one of pinhole, fish-eye, radial, got 'fisheye' (did you mean 'fish-eye'?)"),
        ({"sensor": "camera", "lens": {"kind": "pinhole", "fov": 90}},
         "lens.fov: must be in (0, 3.14159), got 90; give radians, FishEye"),
        ({"sensor": "camera", "width": 0}, "width: must be at least 1, got 0"),
        ({"sensor": "camera", "outputs": ["colour"]}, "outputs[0]: must be one of 'rgb', 'grey', "),
        ({"sensor": "camera", "imaging": {"vignetting": 2}}, "imaging.vignetting: must be in [0, 1], got 2"),
        ({"sensor": "imu", "gyroscope_noise": [{"std": 1}]}, "gyroscope_noise[0].kind: missing; give one of normal,"),
        ({"sensor": "imu", "gyroscope_noise": {"kind": "normal"}}, "gyroscope_noise: must be a list, got {'kind'"),
        ({"sensor": "imu", "gyroscope_noise": [{"kind": "normal"}]},
         "gyroscope_noise[0].std: missing; give a number or a list"),
        ({"sensor": "imu", "gyroscope_noise": [{"kind": "normal", "std": -1}]},
         "gyroscope_noise[0].std: must be zero or positive, got -1"),
        ([1, 2], "must be an object, got [1, 2]"),
        ('{"sensor": "imu", "sensor": "gps"}', "sensor: given twice in one object; give it once"),
        ('{"sensor": }', "line 1 column 12: broken JSON: Expecting value"),
    ],
)  # fmt: skip
def test_mistakes_name_file_and_key(tmp_path, value, message):
    with pytest.raises(sw.ModelError) as caught:
        load_config(written(tmp_path, value))
    assert str(caught.value).startswith(f"mine.json: {message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: load_config("vlp-17"),
         "sensor 'vlp-17': not shipped (did you mean 'vlp-16'?); known: contact-sensor, "),
        (lambda: load_config("none/such.json"), "none/such.json: cannot be read: No such file or directory"),
        (lambda: load_config(16), "sensor: must be a name or the path of a JSON file, got 16"),  # type: ignore[arg-type]
        (lambda: load_config("vlp-16", fra=3), "vlp-16: there is no 'fra' to change (did you mean 'far'?); schedule, "),
        (lambda: load_config("vlp-16", far=-1.0), "LidarConfig: far must be positive, got -1.0"),
        (lambda: load_sensor("vlp-16", cart()[0], Mount()), "lidar 'vlp-16': world must be a Scene, got "),
        (lambda: load_sensor("generic-imu", "cart", Mount()),  # type: ignore[arg-type]
         "imu 'generic-imu': world must be a Model or a Scene, got 'cart'"),
        (lambda: make_sensor("vlp-16", cart()[1], Mount()),
         "make_sensor: config must be one of CameraConfig, LidarConfig"),
        (lambda: load_sensor("vlp-16", cart()[1], Mount("roof")), "sensor 'vlp-16': model has no body 'roof'"),
        (lambda: load_sensor("wheel-encoder", cart()[1], "axle"), "sensor 'wheel-encoder': model has no joint 'axle'"),
    ],
)  # fmt: skip
def test_mistakes_in_calls_are_one_clear_error(make, message):
    with pytest.raises(sw.ModelError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_every_field_of_every_configuration_can_stand_in_a_file():
    """A type that the reader does not know would be found by a user only."""
    from simwarp.model.rules import RULES

    for kind in KINDS.values():
        for name, hint in field_hints(kind.config).items():
            with pytest.raises(sw.ModelError, match=name):
                RULES.load(kind.config, {name: {"no such": object}})
            with pytest.raises(sw.ModelError):
                RULES.load(hint, {"no such": object})
