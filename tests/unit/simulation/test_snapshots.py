"""Snapshots: restored only where they belong, written to files and read back bit by bit, never pickled."""

from __future__ import annotations

import copy
import json
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.files import FileError
from simwarp.core.types import WORLD, Dof, Material, PositionDrive, pose
from simwarp.model.builder import ModelBuilder
from simwarp.sensors.interface import Mount
from simwarp.sensors.motion.imu import Imu

CUBE = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
HILLS = np.zeros((4, 4))
DT = 2e-3


def scene(change: Callable[[dict[str, Any]], None] = lambda parts: None, **finalize: Any) -> sw.Model:
    """Two bodies on the ground with a hinge; `change` alters what they are made of."""
    parts: dict[str, Any] = {
        "names": ("a", "b"), "joint": "hinge", "law": {"limit": (-1.0, 1.0)}, "kind": "revolute", "hull": CUBE,
        "heights": HILLS, "size": 0.1, "mass": 1.0, "group": 1, "material": Material(), "gear": False, "apart": False,
    }  # fmt: skip
    change(parts)
    builder = ModelBuilder()
    for index, name in enumerate(parts["names"]):
        builder.add_body(name, mass=parts["mass"], inertia=(0.1, 0.1, 0.1), pose=pose((0.5 * index, 0, 0.15)))
    getattr(builder, f"add_joint_{parts['kind']}")(parts["joint"], 0, 1, axis=(0, 1, 0), **parts["law"])
    shaft = builder.add_shaft("shaft", inertia=0.1, speed=1.0)
    if parts["gear"]:
        builder.add_gear("gear", 0, shaft, ratio=2.0)
    builder.add_shape_hull(0, parts["hull"], name="hull", material=parts["material"])
    builder.add_shape_box(1, half=(parts["size"],) * 3, name="box", group=parts["group"])
    builder.add_shape_height_field(WORLD, parts["heights"], size=(4.0, 4.0), name="ground")
    if parts["apart"]:
        builder.exclude_collision(0, 1)
    arguments: dict[str, Any] = {"world_count": 2, "device": "cpu"} | finalize
    return builder.finalize(**arguments)


def run(sim: sw.Simulation, steps: int) -> None:
    for _ in range(steps):
        sim.step()


def contents(sim: sw.Simulation) -> dict[str, bytes]:
    """Everything that a snapshot holds."""
    return {name: array.numpy().tobytes() for name, array in sim.snapshot().arrays().items()}


def sensing(model: sw.Model) -> sw.Simulation:
    return sw.Simulation(model, DT, sensors=[Imu(model, Mount("a"))])


@pytest.fixture(scope="module")
def model() -> sw.Model:
    return scene()


@pytest.fixture(scope="module")
def moving(model: sw.Model) -> sw.Simulation:
    """With contacts, a sensor's memory and controls other than zero."""
    sim = sensing(model)
    sim.control.joint_force[:, 0] = 0.3
    run(sim, 40)
    return sim


# ---- where a snapshot belongs ----------------------------------------------------------------------------------------


def changed(**parts: Any) -> Callable[[dict[str, Any]], None]:
    return lambda given: given.update(parts)


OTHERS: dict[str, tuple[Callable[[], sw.Model], str]] = {
    "another name": (lambda: scene(changed(names=("a", "c"))), "bodies: here 'c', there 'b'"),
    "more bodies": (lambda: scene(changed(names=("a", "b", "c"))), "bodies: here 3, there 2"),
    "another joint": (lambda: scene(changed(kind="prismatic")), "joints: here 'hinge' (prismatic 0 to 1"),
    "a joint's name": (lambda: scene(changed(joint="knee")), "joints: here 'knee'"),
    "no stop": (lambda: scene(changed(law={})), "joints: here 'hinge' (revolute 0 to 1)"),
    "friction": (lambda: scene(changed(law={"limit": (-1.0, 1.0), "friction": 0.1})), "joints: here"),
    "a drive": (lambda: scene(changed(law={"drive": PositionDrive(stiffness=1.0)})), "joints: here"),
    "a table": (lambda: scene(changed(law={"limit": (-1, 1), "spring_table": ((0, 1), (0, 1))})), "joints: here"),
    "a coupling": (lambda: scene(changed(gear=True)), "couplings: here 1, there 0"),
    "another group": (lambda: scene(changed(group=2)), "shapes: here 'box' (box on 1, group 2"),
    "another hull": (lambda: scene(changed(hull=CUBE * 1.01)), "geometries: here hull of 8 points"),
    "other hills": (lambda: scene(changed(heights=HILLS + 0.01)), "geometries: here height field of (4, 4)"),
    "a pair apart": (lambda: scene(changed(apart=True)), "excluded pairs: here 1, there 0"),
    "rolling": (lambda: scene(changed(material=Material(rolling_friction=0.01))), "rolling friction: here True"),
    "capacity": (lambda: scene(contact_capacity=7), "contact capacity: here 7, there"),
    "worlds": (lambda: scene(world_count=3), "worlds: here 3, there 2"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "told"), OTHERS.values(), ids=OTHERS)
def test_a_snapshot_of_another_model_changes_nothing(moving, make, told, tmp_path):
    sim = sensing(make())
    run(sim, 2)
    before = contents(sim)
    with pytest.raises(sw.ModelError) as caught:
        sim.restore(moving.snapshot())
    assert told in str(caught.value)
    assert str(caught.value).isprintable()
    assert contents(sim) == before


SAME: dict[str, Callable[[], sw.Model]] = {
    "built again": scene,
    "another mass": lambda: scene(changed(mass=2.0)),
    "another size": lambda: scene(changed(size=0.11)),
    "another friction": lambda: scene(changed(material=Material(friction=0.1))),
    "other stops": lambda: scene(changed(law={"limit": (-0.5, 0.5)})),
    "parameters of its own": lambda: scene(per_world=("body_mass",)),
    "tables as arrays": scene,
}


@pytest.mark.parametrize("make", SAME.values(), ids=SAME)
def test_what_may_differ_per_world_is_no_part_of_the_identity(moving, make):
    sim = sensing(make())
    sim.restore(moving.snapshot())
    assert contents(sim) == contents(moving)


def test_equal_tables_are_equal_however_they_are_written():
    tables = [((0, 1), (0, 1)), ([0.0, 1.0], [0.0, 1.0]), (np.array([0, 1]), np.array([0.0, 1.0]))]
    models = [scene(changed(law={"spring_table": table})) for table in tables]
    assert len({each.identity.digest for each in models}) == 1


def test_sensors_elements_and_their_clock_belong_to_the_identity(moving, model):
    kept = moving.snapshot()
    plain = sw.Simulation(model, DT)
    other_name = sw.Simulation(model, DT, sensors=[Imu(model, Mount("a"), name="second")])
    slower = sw.Simulation(model, 2 * DT, sensors=[Imu(model, Mount("a"))])
    for sim, told in (
        (plain, "sensors: here 0, there 1"),
        (other_name, "sensors: here Imu 'second', there Imu 'imu'"),
        (slower, "clock of the sensors: here sub-steps of 0.004 s"),
    ):
        before = contents(sim)
        with pytest.raises(sw.ModelError, match="restore: the snapshot must be of") as caught:
            sim.restore(kept)
        assert told in str(caught.value)
        assert contents(sim) == before


def test_other_options_of_the_solver_take_the_same_snapshot(model):
    one = sw.Simulation(model, DT)
    run(one, 5)
    other = sw.Simulation(model, 2 * DT, solver=sw.SolverOptions(solver="psor", dense_rows=0))
    other.restore(one.snapshot())
    assert contents(other) == contents(one)


# ---- files -----------------------------------------------------------------------------------------------------------


def test_saved_loaded_restored_and_stepped_it_is_bitwise_the_same(moving, tmp_path):
    path = tmp_path / "state.npz"
    moving.snapshot().save(path)
    kept = contents(moving)
    again = sensing(scene())
    again.restore(sw.Snapshot.load(path, again))
    assert contents(again) == kept
    other = moving.snapshot()
    run(moving, 20)
    run(again, 20)
    assert contents(again) == contents(moving) != kept
    moving.restore(other)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["state.npz"]


def test_a_model_is_enough_where_there_are_no_sensors(model, moving, tmp_path):
    sim = sw.Simulation(model, DT)
    run(sim, 3)
    sim.snapshot().save(tmp_path / "state.npz")
    loaded = sw.Snapshot.load(tmp_path / "state.npz", model)
    again = sw.Simulation(model, DT)
    again.restore(loaded)
    assert contents(again) == contents(sim)
    moving.snapshot().save(tmp_path / "sensed.npz")
    with pytest.raises(sw.ModelError, match="sensors: here 0, there 1"):
        sw.Snapshot.load(tmp_path / "sensed.npz", model)


def test_a_file_of_another_model_is_refused(moving, tmp_path):
    moving.snapshot().save(tmp_path / "state.npz")
    sim = sensing(scene(changed(size=0.1, names=("a", "c"))))
    before = contents(sim)
    with pytest.raises(sw.ModelError, match=r"of another simulation \(bodies: here 'c', there 'b'\)"):
        sw.Snapshot.load(tmp_path / "state.npz", sim)
    assert contents(sim) == before


def refusal(path: Any, sim: sw.Simulation) -> str:
    with pytest.raises((FileError, sw.ModelError)) as caught:
        sw.Snapshot.load(path, sim)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 400
    return message


def test_flipped_bits_truncated_and_foreign_files_are_refused(moving, tmp_path):
    good = tmp_path / "good.npz"
    moving.snapshot().save(good)
    data, bad = good.read_bytes(), tmp_path / "bad.npz"
    before = contents(moving)
    random = np.random.default_rng(1)
    told: list[str] = []
    for place in random.integers(0, len(data), 60):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(random.integers(8))
        bad.write_bytes(flipped)
        try:
            loaded = sw.Snapshot.load(bad, moving)
        except (FileError, sw.ModelError) as error:
            told.append(str(error))
        else:  # a bit that means nothing, such as a date in the archive
            values = {name: array.numpy().tobytes() for name, array in loaded.arrays().items()}
            assert values == before
    assert len(told) > 40
    assert all(line.isprintable() for line in told)
    for length in (0, 1, 30, len(data) // 2, len(data) - 1):
        bad.write_bytes(data[:length])
        assert "snapshot" in refusal(bad, moving)
    for content in (b"PK\x03\x04", b"text", bytes(1000), data + data):
        bad.write_bytes(content)
        if content != data + data:  # an archive may have anything in front
            assert "snapshot" in refusal(bad, moving)
    assert contents(moving) == before


def rewritten(good: Path, bad: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    with np.load(good) as archive:
        values = dict(archive)
    change(values)
    np.savez(bad, **values)
    return bad


def header(**changes: Any) -> Callable[[dict[str, Any]], None]:
    def change(values: dict[str, Any]) -> None:
        given = json.loads(values["header"].tobytes())
        given.update(changes)
        values["header"] = np.frombuffer(json.dumps(given).encode(), np.uint8)

    return change


WRONG: dict[str, Callable[[dict[str, Any]], Any]] = {
    "an array less": lambda values: values.pop("state.body_x"),
    "no header": lambda values: values.pop("header"),
    "header of text": lambda values: values.update(header=np.array("text")),
    "header of numbers": lambda values: values.update(header=np.ones((2, 2))),
    "header of a list": lambda values: values.update(header=np.frombuffer(b"[1]", np.uint8)),
    "deep header": lambda values: values.update(header=np.frombuffer(b"[" * 100_000, np.uint8)),
    "another format": header(format="simwarp snapshot 9"),
    "identity of text": header(identity="x"),
    "identity of numbers": header(identity={"bodies": [1, None]}),
    "identity of nulls": header(identity={"bodies": None}),
    "no checksum": header(checksum=None),
    "other numbers": lambda values: values.update({"state.body_x": values["state.body_x"] + 1.0}),
    "another dtype": lambda values: values.update({"state.body_x": values["state.body_x"].astype(np.float32)}),
    "another shape": lambda values: values.update({"state.body_x": values["state.body_x"][:1]}),
    "objects": lambda values: values.update({"state.body_x": np.array([{}], object)}),
    "a huge array": lambda values: values.update({"state.body_x": np.zeros(3_000_000)}),
}


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG)
def test_wrong_contents_are_refused(moving, tmp_path, change):
    moving.snapshot().save(tmp_path / "good.npz")
    bad = rewritten(tmp_path / "good.npz", tmp_path / "bad.npz", change)
    before = contents(moving)
    assert "snapshot" in refusal(bad, moving)
    assert contents(moving) == before


def test_an_array_that_unpacks_to_more_than_belongs_there(moving, tmp_path):
    """A few kilobytes on the disk, a gigabyte in memory."""
    moving.snapshot().save(tmp_path / "good.npz")
    with zipfile.ZipFile(tmp_path / "good.npz") as good:
        names = {name: good.read(name) for name in good.namelist()}
    bomb = tmp_path / "bomb.npz"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in names.items():
            archive.writestr(name, bytes(2**26) if name == "state.body_x.npy" else content)
    assert bomb.stat().st_size < 10**6
    assert "more than" in refusal(bomb, moving)


@pytest.mark.parametrize("path", ["", "no such file.npz", ".", "a\0b", "n" * 300, None, 3, b"state.npz"])
def test_paths_that_are_none(moving, tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    refusal(path, moving)
    if path != "no such file.npz":
        with pytest.raises((FileError, sw.ModelError)) as caught:
            moving.snapshot().save(path)
        assert str(caught.value).isprintable()
    assert list(tmp_path.iterdir()) == []


def test_only_simulations_and_models_are_targets(moving, tmp_path):
    moving.snapshot().save(tmp_path / "state.npz")
    targets: list[Any] = [None, "model", moving.state, moving.snapshot()]
    for target in targets:
        with pytest.raises(sw.ModelError, match=r"Snapshot.load: target must be a Simulation or a Model, got"):
            sw.Snapshot.load(tmp_path / "state.npz", target)


# ---- pickling --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [pickle.dumps, copy.copy, copy.deepcopy], ids=["pickle", "copy", "deepcopy"])
def test_pickling_says_what_to_do_instead(moving, way):
    for thing, remedy in (
        (moving, r"snapshot\(\)\.save\(path\)"),
        (moving.model, "ModelBuilder"),
        (moving.snapshot(), r"snapshot\.save\(path\)"),
    ):
        with pytest.raises(TypeError, match=remedy) as caught:
            way(thing)
        assert f"a {type(thing).__name__} cannot be pickled or copied" in str(caught.value)


def test_a_builder_can_be_pickled_instead():
    builder = ModelBuilder()
    body = builder.add_body("a", mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_spherical("ball", WORLD, body, anchor=(0, 0, 1), dofs=[Dof(damping=1.0)] * 3)
    builder.add_shape_hull(body, CUBE)
    again = pickle.loads(pickle.dumps(builder))
    assert again.finalize(1, "cpu").identity == builder.finalize(1, "cpu").identity
    assert isinstance(again.finalize(1, "cpu").body_mass, wp.array)
