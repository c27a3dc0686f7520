"""Bad input to sensors of every kind: one line each that names the thing, the rule, the value and the remedy."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.sensors.cameras.camera import CameraConfig
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.presets import KINDS, load_config, make_sensor
from simwarp.sensors.scene import Scene, Visuals

EXAMPLES = {
    "camera": "hood-camera", "lidar": "vlp-16", "radar": "generic-radar", "imu": "generic-imu", "gps": "generic-gps",
    "magnetometer": "generic-magnetometer", "encoder": "wheel-encoder", "tachometer": "tachometer",
    "speedometer": "speedometer", "contact": "contact-sensor", "load-cell": "load-cell",
}  # fmt: skip
ON_JOINTS = ("encoder", "load-cell")


def world() -> tuple[sw.ModelBuilder, Visuals]:
    builder = sw.ModelBuilder()
    wheel = builder.add_solid("wheel", "sphere", 0.3, mass=1.0)
    builder.add_joint_revolute("axle", sw.WORLD, wheel, axis=(0.0, 1.0, 0.0))
    return builder, Visuals(builder)


def scene() -> Scene:
    builder, visuals = world()
    return visuals.finalize(builder.finalize(1, "cpu"))


def right_place(sort: str) -> Any:
    return "axle" if sort in ON_JOINTS else Mount("wheel")


def message(make: Any) -> str:
    """What is wrong, in one line."""
    with pytest.raises(ModelError) as caught:
        make()
    found = str(caught.value)
    assert "\n" not in found
    return found


def test_there_is_an_example_of_every_kind():
    assert EXAMPLES.keys() == KINDS.keys()
    for sort, name in EXAMPLES.items():
        assert type(load_config(name)) is KINDS[sort].config


@pytest.mark.parametrize("sort", KINDS)
def test_a_sensor_on_what_is_not_there(sort):
    config, target = load_config(EXAMPLES[sort]), scene()
    if sort in ON_JOINTS:
        found = message(lambda: make_sensor(config, target, "axel", name="eye"))
        assert found == "sensor 'eye': model has no joint 'axel'; did you mean 'axle'?"
        found = message(lambda: make_sensor(config, target, 7, name="eye"))
        assert re.fullmatch(r"sensor 'eye': .* must be .* below 1, got 7; take .*", found)
        return
    found = message(lambda: make_sensor(config, target, Mount("wheeel"), name="eye"))
    assert found == "sensor 'eye': model has no body 'wheeel'; did you mean 'wheel'?"
    for body in (1, -2, True, 0.0, None):
        place = Mount(body)  # type: ignore[arg-type]
        found = message(lambda place=place: make_sensor(config, target, place, name="eye"))
        rule = "body must be WORLD (-1), an index below 1 or a name"
        assert found == f"sensor 'eye': {rule}, got {body!r}; take what add_body returned"
    found = message(lambda: make_sensor(config, target, ("wheel",), name="eye"))
    assert found.startswith("sensor 'eye': ")
    assert "got ('wheel',)" in found


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"rate": 0.0}, "Schedule: rate must be positive, got 0.0; give frames per second [Hz]"),
        ({"rate": -5.0}, "Schedule: rate must be positive, got -5.0; give frames per second [Hz]"),
        ({"rate": float("nan")}, "Schedule: rate must be a finite number, got nan; give frames per second [Hz]"),
        ({"rate": "fast"}, "Schedule: rate must be a number, got 'fast'; give frames per second [Hz]"),
        (
            {"rate": 10.0, "lag": -0.01},
            "Schedule: lag must be zero or positive, got -0.01; give seconds, 0 for none",
        ),
        (
            {"rate": 10.0, "lag": float("inf")},
            "Schedule: lag must be a finite number, got inf; give seconds, 0 for none",
        ),
        (
            {"rate": 10.0, "window": -0.01},
            "Schedule: window must be zero or positive, got -0.01; give seconds, 0 for none",
        ),
        (
            {"rate": 10.0, "window": 0.2},
            (
                "Schedule: window must not be longer than a period (1 / rate = 0.1 s), got 0.2 s; "
                "shorten it or lower the rate"
            ),
        ),
        ({"rate": 10.0, "phase": 0.5}, "Schedule: phase must be one of 'zero', 'random', got 0.5"),
    ],
)  # fmt: skip
def test_schedules_that_cannot_be(values, expected):
    assert message(lambda: Schedule(**values)) == expected


@pytest.mark.parametrize("sort", KINDS)
def test_a_schedule_that_is_none(sort):
    config = load_config(EXAMPLES[sort])
    found = message(
        lambda: make_sensor(dataclasses.replace(config, schedule=20.0), scene(), right_place(sort), name="eye")
    )
    assert re.fullmatch(r".*: schedule must be a Schedule, got 20.0", found)


@pytest.mark.parametrize("sort", KINDS)
def test_a_sensor_belongs_to_one_simulation_of_its_own_model(sort):
    target, other = scene(), scene()
    sensor = make_sensor(load_config(EXAMPLES[sort]), target, right_place(sort), name="eye")
    found = message(lambda: sw.Simulation(other.model, 0.01, sensors=[sensor], joint_reactions=True))
    assert found == "sensor 'eye': was made for another model than the Simulation's; use that one"
    sw.Simulation(target.model, 0.01, sensors=[sensor], joint_reactions=True)
    found = message(lambda: sw.Simulation(target.model, 0.01, sensors=[sensor], joint_reactions=True))
    assert found == "sensor 'eye': is part of a Simulation already; make one for each"


def test_two_sensors_of_one_name():
    target = scene()
    pair = [make_sensor(load_config(EXAMPLES[sort]), target, Mount("wheel"), name="eye") for sort in ("imu", "gps")]
    assert "'eye'" in message(lambda: sw.Simulation(target.model, 0.01, sensors=pair))


# ---- what cameras and lidars are to see ------------------------------------------------------------------------------


def test_meshes_that_cannot_be_read(tmp_path):
    (tmp_path / "garbage.glb").write_bytes(b"glTF nonsense")
    (tmp_path / "notes.txt").write_text("no mesh")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")

    def adding(path: Path) -> str:
        return message(lambda: world()[1].add_mesh(0, path, name="rim"))

    assert (
        adding(tmp_path / "none.obj")
        == f"mesh file: there must be a file, got '{tmp_path / 'none.obj'}'; check the path"
    )
    assert re.fullmatch(
        r"mesh file: 'garbage.glb' must be readable, got .*; export it again", adding(tmp_path / "garbage.glb")
    )
    assert re.fullmatch(
        r"mesh file: the format must be one of .obj, .*, got 'notes.txt'; convert it", adding(tmp_path / "notes.txt")
    )
    none, garbage = adding(tmp_path / "none.obj"), adding(tmp_path / "garbage.glb")
    assert none == f"mesh file: there must be a file, got '{tmp_path / 'none.obj'}'; check the path"
    assert re.fullmatch(r"mesh file: 'garbage.glb' must be readable, got .*; export it again", garbage)
    notes, points = adding(tmp_path / "notes.txt"), adding(tmp_path / "points.obj")
    assert re.fullmatch(r"mesh file: the format must be one of .obj, .*, got 'notes.txt'; convert it", notes)
    assert points.startswith("mesh file: 'points.obj' must ")


def test_textures_that_do_not_know_where_they_lie(tmp_path):
    PIL.Image.fromarray(np.full((2, 2, 3), 200, np.uint8)).save(tmp_path / "wood.png")
    (tmp_path / "wood.mtl").write_text("newmtl wood\nmap_Kd wood.png\n")
    (tmp_path / "plank.obj").write_text("mtllib wood.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wood\nf 1 2 3\n")
    assert message(lambda: world()[1].add_mesh(0, tmp_path / "plank.obj", name="rim")) == (
        "mesh file: 'plank.obj' has a texture, whose mesh must have texture coordinates (UVs), got none; "
        "unwrap it and export again"
    )


def test_a_camera_that_cannot_be():
    for changes, rule in (
        ({"width": 0}, "width must be at least 1, got 0"),
        ({"samples": 99}, "samples must be from 1 to 16, got 99"),
        ({"outputs": ("heat",)}, "outputs[0] must be one of 'rgb', 'grey', 'depth', 'range', "),
        ({"near": 3.0, "far": 2.0}, "0 <= near < far must hold, got near=3, far=2 m; swap them"),
    ):  # fmt: skip
        assert message(lambda changes=changes: CameraConfig(**changes)).startswith(f"CameraConfig: {rule}")
