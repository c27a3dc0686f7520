"""The tables of docs/sensors.md are those of the code, and its mistakes are told in its words."""

import dataclasses
import inspect
import re
import typing
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import simwarp as sw
import simwarp.sensors
from simwarp import WORLD, Simulation
from simwarp.core.types import ModelError
from simwarp.sensors import Mount, Schedule, noise as noises
from simwarp.sensors.cameras import lenses
from simwarp.sensors.cameras.appearance import ImageTexture
from simwarp.sensors.cameras.camera import OUTPUTS, Camera, CameraConfig
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.instances import Appearance
from simwarp.sensors.presets import KINDS, load_sensor
from simwarp.sensors.ranging.lidar import MODES
from simwarp.sensors.scene import PER_WORLD, Visuals
from simwarp.sensors.shipped import sensor_names

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "sensors.md").read_text(encoding="utf-8")
DTYPES = {"vec3d": wp.vec3d, "quat": wp.quat, "vec3": wp.vec3, "int32": wp.int32, "float32": wp.float32}
FLOATS = {wp.uint8: "uint8", wp.float32: "float32", wp.int32: "int32", wp.float64: "float64"}


def table(first):
    """Rows of the table whose head begins with a cell."""
    lines = iter(PAGE.splitlines())
    for line in lines:
        if line.startswith(f"| {first} |"):
            break
    next(lines)
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in re.split(r" \| ", line.strip().strip("|"))])
    assert rows, first
    return rows


def names(rows):
    """What stands in backticks in the first cells."""
    return [name for row in rows for name in re.findall(r"`([^`]+)`", row[0])]


def world():
    """A model with a body, and its visuals."""
    builder = sw.ModelBuilder()
    builder.add_body("roof", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_shape_sphere(0, radius=0.1)
    return builder, Visuals(builder), builder.finalize(2, "cpu", per_world=())


def test_every_sensor_is_listed():
    listed = {row[1].strip("`").rpartition(".") for row in table("sensor")}
    classes = {(kind.sensor.__module__, ".", kind.sensor.__name__) for kind in KINDS.values()}
    assert listed == classes


def test_every_sensor_and_its_configuration_are_public_names():
    public = {cls.__name__ for kind in KINDS.values() for cls in (kind.sensor, kind.config)}
    assert public <= set(simwarp.sensors.__all__)


def test_every_shipped_sensor_is_listed():
    assert sorted(names(table("name"))) == sensor_names()


def test_looks_and_arrays_of_a_scene():
    assert names(table("look")) == [field.name for field in dataclasses.fields(Appearance)]
    _, visuals, model = world()
    scene = visuals.finalize(model, per_world=("x",))
    rows = {row[0].strip("`"): row[1] for row in table("array")}
    assert tuple(rows) == PER_WORLD
    for name, shape in rows.items():
        array = getattr(scene, name)
        assert shape.split()[0:4] == ["(1", "or", "W,", "I)"]
        assert array.dtype is DTYPES[shape.split()[-1]], name
        assert array.shape == (2 if name == "x" else 1, 1)


def test_a_world_has_so_many_bytes_per_instance():
    _, visuals, model = world()
    for index in range(511):
        visuals.add_sphere(WORLD, radius=0.1, name=str(index))
    scene = visuals.finalize(model)
    arrays = [array for name, array in scene._placed.items() if name != "soil"]  # one for all worlds
    size = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    assert size / 2 / 512 == pytest.approx(128, rel=0.02)
    assert "128 bytes per instance" in PAGE


def test_outputs_of_a_camera():
    rows = {row[0].strip("`"): row[1].split() for row in table("output")}
    assert rows.keys() == OUTPUTS.keys()
    for name, (_, channels, dtype) in OUTPUTS.items():
        assert rows[name] == [str(channels), FLOATS[dtype]]


def test_lenses_and_modes_and_noises():
    for call in names(table("lens")):
        cls = getattr(lenses, call.partition("(")[0])
        assert [field.name for field in dataclasses.fields(cls)][1:] == re.findall(r"\w+", call.partition("(")[2])
    assert set(names(table("`mode`"))) == set(MODES)
    stages = {row[0].strip("`"): set(re.findall(r"`(\w+)`", row[1])) for row in table("stage")}
    assert stages == {
        cls.__name__: {field.name for field in dataclasses.fields(cls)} - {"kind"}
        for cls in typing.get_args(typing.get_args(noises.Noise)[0])
    }


def test_data_of_instruments():
    builder = sw.ModelBuilder()
    for index in range(2):
        builder.add_body(f"b{index}", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((index, 0.0, 0.0)))
        builder.add_shape_sphere(index, radius=0.1)
    builder.add_joint_revolute("hinge", 0, 1, axis=(0.0, 0.0, 1.0), anchor=(0.5, 0.0, 0.0))
    model = builder.finalize(2, "cpu")
    places = {"Encoder": "hinge", "LoadCell": "hinge"}
    rows = {row[0].strip("`"): row[1] for row in table("class")}
    assert rows.keys() == {kind.sensor.__name__ for kind in KINDS.values() if not kind.sees}
    for kind in KINDS.values():
        if kind.sees:
            continue
        name = kind.sensor.__name__
        data = kind.sensor(model, places.get(name, Mount("b0"))).data
        shape, dtype = rows[name].strip("(").split(") ")
        assert data.shape == tuple({"W": 2, "n": 1}.get(part) or int(part) for part in shape.split(", "))
        assert FLOATS[data.dtype] == dtype


def raise_of(code):
    """What a line of the table of mistakes says."""
    _, visuals, model = world()
    scene = visuals.finalize(model)
    image = visuals.texture(ImageTexture(image=np.zeros((4, 4, 3), np.uint8)))
    known = {
        "Camera": Camera, "CameraConfig": CameraConfig, "Mount": Mount, "Schedule": Schedule, "Pinhole": Pinhole,
        "load_sensor": load_sensor, "Simulation": Simulation, "WORLD": WORLD, "scene": scene, "model": model,
        "visuals": visuals, "image": image, "camera": Camera(scene, Mount("roof")),
        "corners": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], "triangles": [(0, 1, 2)],
    }  # fmt: skip

    def act():
        eval(code, known)  # the page's own code
        visuals.finalize(model)  # a texture is checked once all are known

    with pytest.raises(ModelError) as caught:
        act()
    return str(caught.value)


@pytest.mark.parametrize("row", table("mistake"), ids=lambda row: row[0][:30])
def test_a_mistake_is_told_in_the_words_of_the_page(row):
    code, wanted = row
    told = raise_of(code.strip("`"))
    assert "\n" not in told
    start, dots, _ = wanted.partition("...")
    assert told.startswith(start.strip()) if dots else told == wanted


def test_options_that_the_page_names_exist():
    assert {"per_world", "seed", "name"} <= set(inspect.signature(Camera).parameters)
    assert {"randomised", "seed", "name"} <= set(inspect.signature(KINDS["imu"].sensor).parameters)
    assert "read_every" in inspect.signature(Simulation).parameters
    assert {"begin_sensors", "reset"} <= set(dir(Simulation))


def test_the_noises_that_the_page_names_exist():
    builder = sw.ModelBuilder()
    body = builder.add_solid("b0", "sphere", 0.1, mass=1.0)
    builder.add_joint_revolute("hinge", WORLD, body, axis=(0.0, 0.0, 1.0))
    model = builder.finalize(2, "cpu")
    listed = {row[0].strip("`"): re.findall(r"\w+\.(\w*noise)", row[1]) for row in table("sensor's")}
    for kind in KINDS.values():
        if kind.sees:
            continue
        name = kind.sensor.__name__
        sensor = kind.sensor(model, "hinge" if name in ("Encoder", "LoadCell") else Mount("b0"))
        chains = {option for option in dir(sensor) if isinstance(getattr(sensor, option), noises.NoiseChain)}
        assert chains == set(listed.get(name, listed["other sensors"])), name
