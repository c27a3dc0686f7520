"""Model files: every number comes back bit by bit, and what is broken is refused in one line."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from hypothesis import HealthCheck, given, settings, strategies as st

import simwarp as sw
from simwarp import scenes
from tests.reference.contact_scenes import heap
from tests.reference.mechanisms import NAMED, random_mechanism
from tests.reference.random_scenes import random_scene


def bits(value):
    """A value with arrays as their bytes: equal ones are equal bit by bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, dict):
        return [(key, bits(item)) for key, item in value.items()]
    if isinstance(value, set):
        return sorted(value)
    if dataclasses.is_dataclass(value):
        return type(value).__name__, [bits(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, (tuple, list)):
        return [bits(item) for item in value]
    return repr(value) if value is None or isinstance(value, (str, bool, int)) else repr(float(value))


def content(builder):
    """All that a builder holds."""
    return {name: bits(value) for name, value in vars(builder).items()}


def arrays(owner, seen=None):
    """Every array of a model, by its path: those of its structs and groups, too."""
    seen = set() if seen is None else seen
    found = {}
    for name, value in vars(owner).items():
        if isinstance(value, (wp.array, np.ndarray)):
            whole = value.numpy() if isinstance(value, wp.array) else value
            if name != "mesh":  # ids of meshes on the device
                found[name] = (whole.dtype.str, whole.shape, whole.tobytes())
        elif hasattr(value, "__dict__") and id(value) not in seen and not isinstance(value, (wp.Mesh, wp.Device)):
            seen.add(id(value))
            found |= {f"{name}.{inner}": item for inner, item in arrays(value, seen).items()}
    return found


def finalized(builder):
    """Arrays of the model, or why there is none: some random couplings cannot be."""
    try:
        return arrays(builder.finalize(1, "cpu"))
    except sw.ModelError as error:
        return str(error)


def saved(builder, folder):
    """The builder after a file."""
    path = folder / "model.json"
    sw.save_model(builder, path)
    return sw.load_model(path)


def motion(builder, steps=20, dt=1e-3):
    """State after some steps, as bytes."""
    simulation = sw.Simulation(builder.finalize(2, "cpu"), dt=dt)
    for _ in range(steps):
        simulation.step()
    state = simulation.state
    return [getattr(state, name).numpy().tobytes() for name in ("body_x", "body_q", "body_v", "body_omega", "joint_q")]


def everything():
    """A builder that has each thing that a builder can hold, once at least."""
    builder = sw.ModelBuilder((0.1, -0.0, -9.8), friction_rule="product", pair_rule="either")
    base = builder.add_body("base", mass=1 / 3, inertia=[[1.0, 0.1, 0.2], [0.1, 1.1, 0.3], [0.2, 0.3, 0.9]],
                            pose=sw.pose((0.1, 0.2, 1.7), (0.1, 0.2, 0.3, 0.4)), velocity=(0.1, 0, 0))  # fmt: skip
    knuckle = builder.add_massless_body("knuckle", pose=sw.pose((0, 0, 1.1)))
    tip = builder.add_body("tip", mass=0.7, inertia=(0.01, 0.02, 0.025), pose=sw.pose((0, 0, 0.7)), omega=(1, 0, 0))
    builder.add_massless_body("marker", posed=True)
    table = ((-1.0, 0.1, 2.0), (-3.0, 0.0, 4.0))
    builder.add_joint_free("float", base, anchor=(0.1, 0.1, 1.6))
    first = builder.add_joint_revolute(
        "yaw", base, knuckle, axis=(0, 0, 1), limit=(-math.inf, 0.5), friction=0.1, armature=0.01,
        drive=sw.PositionDrive(stiffness=3.0, damping=0.1, effort_limit=(-2.0, math.inf)),
    )  # fmt: skip
    second = builder.add_joint_revolute(
        "pitch", knuckle, tip, axis=(0, 1, 0), damper_table=table, armature=0.01,
    )  # fmt: skip
    shaft = builder.add_shaft("shaft", inertia=0.1, position=0.3, speed=-2.0, drive=sw.VelocityMotor(effort_limit=3.0))
    other = builder.add_shaft("other", inertia=0.2, drive=sw.PrescribedSpeed(table=((0.0, 1.0), (0.0, 5.0))))
    builder.add_combination("tendon", [(first, 0.3), (second, -0.7)], stiffness=2.0, limit=(-2.0, 2.0))
    builder.add_coupling("gear", [(shaft, 2.0), (other, -1.0)], damping=0.2)
    builder.add_loop_joint("weld", sw.WORLD, tip, kind=sw.JointType.SPHERICAL, frame0=sw.pose((0, 0, 0.5)))
    builder.add_spring("spring", sw.WORLD, tip, anchor0=(1, 0, 0), anchor1=(0, 0, 0.6), stiffness=5.0,
                       damper_map=((0.0, 1.0), (-1.0, 1.0), ((0.0, 1.0), (2.0, 3.0))))  # fmt: skip
    rng = np.random.default_rng(3)
    ground = builder.add_shape_height_field(
        sw.WORLD, rng.normal(size=(4, 5)) / 50.0, size=(3.0, 2.7), name="ground", group=4, mask=7
    )
    hull = builder.add_shape_hull(base, rng.normal(size=(20, 3)), name="hull", margin=0.01, scale=(0.1, 0.2, 0.1))
    ball = builder.add_shape_sphere(
        tip,
        radius=0.1,
        name="ball",
        pose=sw.pose((-0.0, 0.0, 0.0)),
        material=sw.Material(friction=0.3, priority=-2, rolling_friction=0.01),
    )
    mesh = builder.add_shape_mesh(
        sw.WORLD, [(2, 0, 0), (3, 0, 0), (2, 1, 0), (3, 1, 0.1)], [(0, 1, 2), (1, 3, 2)], name="step"
    )
    builder.add_shape_sprocket(
        base, arc_center_radius=0.3, arc_radius=0.05, tip_radius=0.27, teeth=9, half_width=0.1, arc_offset=0.07,
        name="sprocket", group=8, mask=8,
    )  # fmt: skip
    builder.add_shape_groove(tip, radius=0.3, half_width=0.1, name="groove", group=8, mask=8)
    builder.exclude_collision(base, tip)
    assert isinstance(mesh, int)
    builder.exclude_shapes(ball, mesh)
    builder.add_shape_pair(hull, ground, material=sw.Material(friction=0.9))
    builder.add_shape_pair(hull, ball)
    return builder


def test_everything_comes_back_bit_by_bit(tmp_path):
    builder = everything()
    again = saved(builder, tmp_path)
    assert content(again) == content(builder)
    assert type(again.friction_rule) is sw.FrictionRule
    assert type(again.joints[0].type) is sw.JointType
    before, after = (arrays(made.finalize(2, "cpu")) for made in (builder, again))
    assert len(before) > 100
    assert before == after
    assert motion(again) == motion(builder)
    assert motion(builder) != motion(sw.load_model(_with(tmp_path, "bodies", 2, "mass", 0.70001)))


def _with(folder, *keys_and_value):
    """The file of `saved` with one value replaced, or taken out where it is None."""
    *keys, last, value = keys_and_value
    whole = json.loads((folder / "model.json").read_text())
    owner = whole
    for key in keys:
        owner = owner[key]
    owner[last] = value
    path = folder / "changed.json"
    path.write_text(json.dumps(whole))
    return path


@pytest.mark.parametrize("name", NAMED)
def test_named_mechanisms_come_back(name, tmp_path):
    builder = NAMED[name]()
    assert content(saved(builder, tmp_path)) == content(builder)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10**6), kind=st.sampled_from(["mechanism", "heap", "scene"]))
def test_random_models_come_back(tmp_path, seed, kind):
    if kind == "mechanism":
        builder = random_mechanism(seed, bounds=True, couplings=True)
    elif kind == "heap":
        builder = heap(np.random.default_rng(seed), "rcho")
    else:
        builder = random_scene(seed)[0]
    again = saved(builder, tmp_path)
    assert content(again) == content(builder)
    assert finalized(again) == finalized(builder)


@pytest.mark.parametrize("seed", range(3))
def test_random_models_move_as_before(tmp_path, seed):
    for builder in (random_mechanism(seed, bounds=True, couplings=True), heap(np.random.default_rng(seed), "rcho")):
        assert motion(saved(builder, tmp_path)) == motion(builder)


def test_scenes_with_assets_come_back(tmp_path):
    for builder in (scenes.ant(), scenes.pile()):
        assert content(saved(builder, tmp_path)) == content(builder)


BROKEN = [
    (("version", 2), "version: must be 1, got 2"),
    (("format", "other"), "format: must be 'simwarp model', got 'other'"),
    (("speed", 1), "speed: unknown key; known: format, version"),
    (("bodies", 0, "mass", -1.0), "bodies[0]: body 'base': mass must be finite and > 0 kg, got -1.0"),
    (("bodies", 0, "mass", math.nan), "bodies[0].mass: must be a finite number, got nan"),
    (("bodies", 0, "mass", "1"), "bodies[0].mass: must be a number, got '1'"),
    (("bodies", 0, "weight", 1.0), "bodies[0].weight: unknown key; known: name, mass"),
    (("bodies", 0, "rotation", [1.0, 1.0, 0.0, 0.0]), "body 'base': rotation must be a unit quaternion"),
    (("bodies", 1, "name", "base"), "bodies[1]: body 'base': the name must be unique"),
    (("bodies", 1, "inertia", [1.0, 1.0, 1.0]), "without mass the inertia must be 0"),
    (("bodies", 2, "inertia", [1.0, 1.0, -1.0]), "inertia must be positive definite"),
    (("bodies", 3, "mass", 1.0), "bodies[3]: body 'marker': mass must be 0 of a body that is posed, got 1.0; write 0"),
    (("joints", 1, "type", "revolut"), "type must be one of free, fixed"),
    (("joints", 1, "child", 9), "joints[1]: joint 'yaw': child must be an integer >= -1"),
    (("joints", 1, "child", 0), "parent and child must differ, got 0"),
    (("joints", 1, "offset", 1.0), "offset must be 0.0 in a joint of type revolute, got 1.0"),
    (("joints", 1, "closes_loop", True), "closes_loop must be False in a joint of type revolute"),
    (("joints", 1, "terms", [[0, 1.0]]), "terms must be () in a joint of type revolute"),
    (("joints", 1, "dofs", 0, "limit", [1.0, 0.0]), "limit must be (lower, upper) with lower < upper"),
    (("joints", 1, "dofs", 0, "limit", [1.0]), "joints[1].dofs[0].limit: must be a list of 2 items"),
    (("joints", 1, "dofs", 0, "drive", "kind", "servo"), "drive.kind: must be one of position, velocity"),
    (("joints", 1, "dofs", 0, "drive", "stiffness", -1.0), "drive.stiffness must be zero or positive"),
    (("joints", 3, "inertia", 0.0), "joint 'shaft': inertia must be finite and > 0"),
    (("joints", 5, "terms", [[99, 1.0]]), "a column of terms must be an integer"),
    (("joints", 5, "terms", []), "needs 1 to 12 terms, got 0"),
    (("couplings", 0, "terms", [[10, 1.0]]), "column 10 must not be that of a combination"),
    (("couplings", 0, "damping", -1.0), "couplings[0].damping: must be zero or positive"),
    (("shapes", 2, "type", "spere"), "type must be one of plane, sphere"),
    (("shapes", 2, "size", [0.0, 0.1, 0.1]), "every size"),
    (("shapes", 2, "asset", 0), "asset must be an integer >= -1"),
    (("shapes", 1, "asset", 1), "asset must be an integer >= 0"),
    (("shapes", 1, "mask", -1), "shapes[1].mask: must be zero or positive, got -1; give 31 bits"),
    (("shapes", 2, "material", "friction", -0.1), "material.friction: must be zero or positive, got -0.1"),
    (("shapes", 2, "material", "colour", 1), "shapes[2].material.colour: unknown key"),
    (("excluded_bodies", 0, [0, 7]), "excluded_bodies[0]: exclude_collision: body must be WORLD or in 0..3, got 7"),
    (("given_pairs", 0, "shapes", [2, 2]), "given_pairs[0]: add_shape_pair: shape0 and shape1 must differ"),
    (("excluded_shapes", 0, [0, 3]), "ok"),
    (("hulls", 0, "faces", 0, [0, 1, 2]), "a hull must be a closed polyhedron"),
    (("hulls", 0, "vertices", "dtype", "float32"), "hulls[0]: vertices must be float64 of shape (N, 3), got float32"),
    (("hulls", 0, "vertices", "base64", "AAAA"), "numbers, as its shape tells, got 3 bytes; the file may be cut off"),
    (("hulls", 0, "vertices", "base64", "!"), "vertices.base64 must be base64, got '!'"),
    (("hulls", 0, "vertices", "shape", [10**15, 3]), "must have 3000000000000000 numbers"),
    (("meshes", 0, "triangles", "shape", [2, 2]), "triangles must be int32 of shape (N, 3)"),
    (("sprocket_profiles", 0, "teeth", 2), "sprocket_profiles[0]: sprocket profile: teeth must be 3..10000, got 2"),
    (("sprocket_profiles", 0, "arc_radius", 0.5), "arcs must leave teeth between them"),
    (("height_fields", 0, "spacing", [0.0, 1.0]), "spacing[0]: must be positive, got 0.0; give metres"),
    (("gravity", [0.0, 0.0]), "gravity: must be a list of 3 items, got [0.0, 0.0]"),
    (("gravity", [0.0, 0.0, 1e39]), "beyond float32"),
    (("pair_rule", "or"), "pair_rule must be one of both, either, got 'or'"),
    (("shapes", [{"name": "a"}] * 70_000), "shapes: must be at most 65536 items"),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("model")
    sw.save_model(everything(), path / "model.json")
    return path


@pytest.mark.parametrize(("change", "message"), BROKEN, ids=lambda value: None if isinstance(value, tuple) else value)
def test_what_is_broken_is_refused_in_one_line(folder, change, message):
    path = _with(folder, *change)
    if message == "ok":
        sw.load_model(path)
        return
    with pytest.raises(sw.ModelError) as refused:
        sw.load_model(path)
    text = str(refused.value)
    assert message in text
    assert text.startswith("changed.json: ")
    assert "\n" not in text
    assert len(text) < 1000


def test_a_hull_that_is_not_convex_is_refused(folder):
    hull = everything().hulls[0]
    corners = hull.vertices.copy()
    corners[0] *= 0.2
    from simwarp.model.model_format import PackedArray

    path = _with(folder, "hulls", 0, "vertices", vars(PackedArray.of(corners)))
    with pytest.raises(sw.ModelError, match="a hull must be convex"):
        sw.load_model(path)


def test_files_that_are_cut_off_or_no_files(tmp_path, folder):
    text = (folder / "model.json").read_text()
    path = tmp_path / "cut.json"
    for share in (0.0, 0.1, 0.5, 0.99):
        path.write_text(text[: int(share * len(text))])
        with pytest.raises(sw.ModelError, match=r"cut\.json.*broken JSON"):
            sw.load_model(path)
    places: Any = ((tmp_path / "none.json", "No such file"), (tmp_path, "it is a folder"), (3, "path must be"))
    for wrong, message in places:
        with pytest.raises(sw.ModelError, match=message):
            sw.load_model(wrong)
    path.write_text("[" * 1000)
    with pytest.raises(sw.ModelError, match="nested too deep"):
        sw.load_model(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(sw.ModelError, match="UTF-8"):
        sw.load_model(path)


def test_a_file_that_is_there_survives_a_failure(tmp_path, monkeypatch):
    path = tmp_path / "model.json"
    sw.save_model(everything(), path)
    before = path.read_bytes()
    monkeypatch.setattr("simwarp.core.files.LARGEST_TEXT", 1000)
    with pytest.raises(sw.ModelError, match="simplify its meshes"):
        sw.save_model(everything(), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["model.json"]
