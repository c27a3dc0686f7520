"""Whatever a user prints first says what it holds, in at most 12 lines of 120 columns, and reads no device."""

import dataclasses
import hashlib
import importlib
import inspect
import pkgutil
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
import simwarp.simulation.readings as readings_module
from simwarp import actuators, sensors, vehicle
from simwarp.core.object_repr import MOST_LINES, WIDEST, Readable, ReadableFields
from simwarp.core.types import ModelError, formatted
from simwarp.geometry.assets import triangle_mesh
from simwarp.model.identity import _surface_line
from simwarp.train import default_config, find_policy, random_policy
from simwarp.train.evaluation.evaluation import Evaluation, evaluate
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.training import TrainResult

ARM = """<mujoco><worldbody><body name="arm"><joint name="hinge" axis="0 1 0" damping=".05"/>
  <geom name="rod" type="capsule" fromto="0 0 0 .5 0 0" size=".03"/></body></worldbody>
  <actuator><motor name="motor" joint="hinge" ctrlrange="-1 1"/></actuator></mujoco>"""


def cart_and_pole():
    builder = sw.ModelBuilder()
    cart = builder.add_body("cart", mass=1.0, inertia=(1, 1, 1))
    pole = builder.add_body("pole", mass=0.8, inertia=(0.3, 0.3, 0.01), pose=sw.pose((0, 0, 0.5)))
    builder.add_joint_prismatic("slide", sw.WORLD, cart, axis=(1, 0, 0), limit=(-2, 2))
    builder.add_joint_revolute("hinge", cart, pole, anchor=(0, 0, 0), axis=(0, 1, 0))
    builder.add_shape_sphere(pole, radius=0.1, name="bob")
    builder.add_shape_plane(name="ground")
    return builder


@pytest.fixture(scope="module")
def things(tmp_path_factory):
    """Every kind of object that is met early, by name."""
    builder = cart_and_pole()
    visuals = sensors.Visuals(builder)
    model = builder.finalize(3, "cpu", per_world=["body_mass", "gravity"])
    scene, mount = visuals.finalize(model), sensors.Mount("pole")
    spec = actuators.ActuatorSpec(name="motor", terms=((model.dof("hinge"), 1.0),), ctrl_range=(-1.0, 1.0))
    motors = actuators.Actuators(model, [spec])
    fitted: dict[str, Any] = {
        f"sensor {name}": sensors.load_sensor(name, scene, mount, name=name)
        for name in ("vlp-16", "generic-radar", "generic-camera")
    }
    fitted |= {
        f"sensor {type(sensor).__name__}": sensor
        for sensor in (
            sensors.Imu(model, mount), sensors.Gps(model, mount), sensors.Magnetometer(model, mount),
            sensors.Encoder(model, "hinge"), sensors.Tachometer(model, "hinge"), sensors.Speedometer(model, mount),
            sensors.ContactSensor(model, mount), sensors.LoadCell(model, "hinge"),
        )
    }  # fmt: skip
    sim = sw.Simulation(model, 0.001, elements=[motors], sensors=list(fitted.values()), joint_reactions=True, threads=1)
    description = vehicle.load("hmmwv")
    chassis = sw.ModelBuilder()
    parts = vehicle.add_vehicle(chassis, description)
    cars = chassis.finalize(2, "cpu", per_world=vehicle.per_world())
    file = tmp_path_factory.mktemp("robots") / "arm.xml"
    file.write_text(ARM, encoding="utf-8")
    robot = sw.importers.load_mjcf(file)
    task = sw.tasks.make("fast", 4)
    source = find_policy("pendulum", None, tmp_path_factory.mktemp("runs"))
    pendulum = sw.tasks.make("pendulum", 2)
    return fitted | {f"{name} config": each.config for name, each in fitted.items()} | {
        "empty builder": sw.ModelBuilder(), "builder": builder, "visuals": visuals, "model": model, "scene": scene,
        "actuator": spec, "actuators": motors, "simulation": sim, "state": sim.state, "control": sim.control,
        "contacts": sim.contacts, "diagnostics": sim.diagnostics, "snapshot": sim.snapshot(), "identity": sim.identity,
        "time": sim.time, "array": sim.state.body_q, "mount": mount, "solver": sw.SolverOptions(), "dof": sw.Dof(),
        "material": sw.Material(), "body": builder.bodies[1], "joint": builder.joints[1], "shape": builder.shapes[0],
        "mesh": triangle_mesh(np.eye(3), [[0, 1, 2]]),
        "volume mesh": sw.flex.box((1, 2, 3), 2), "pose": sw.pose((1, 2, 3)), "lighting": sensors.Lighting(),
        "vehicle description": description, "axle": description.axles[0], "vehicle builder": chassis,
        "vehicle parts": parts, "vehicle model": cars, "vehicle": vehicle.Vehicle(parts, cars),
        "vehicles": vehicle.Vehicles([parts], cars),
        "convoy": vehicle.set_up_convoy(
            description, vehicle.maneuver("step-steer", description), vehicles=1, device="cpu"
        ),
        "script": vehicle.ScriptSpec(), "path": vehicle.circle(10.0),
        "lights": sensors.Lights(sensors.Lighting(), 2, "cpu"),
        "tires": vehicle.Vehicle(parts, cars).tires, "random": pendulum.random, "gym env": sw.tasks.TaskEnv("fast"),
        "scripted": vehicle.ScriptedDriver(vehicle.Vehicle(parts, cars), vehicle.ScriptSpec()),
        "frames": fitted[next(iter(fitted))].frames, "camera": sw.viewer.FreeCamera(scene, [0], sensors.CameraConfig()),
        "robot": robot, "report": robot.report,
        "keyframe": sw.importers.imported.Keyframe(np.zeros(50), np.zeros(50), np.zeros(12)),
        "task": task, "task config": task.config, "result": task.step(torch.zeros(4, task.action_size)),
        "task with physics": pendulum, "summary": task.drain_statistics(),
        "policy source": source, "policy": network_policy(source.content, pendulum),
        "training config": default_config(type(pendulum)), "ppo config": default_config(type(pendulum)).ppo,
        "training": TrainResult("fast", "runs/fast", "a.pt", None, 1, 2, 3.0, 4.0, 5.0, 6.0, False),
        "evaluation": evaluate(task, random_policy(task), 4, 0),
    }  # fmt: skip


FRONT = (
    "simwarp", "simwarp.actuators", "simwarp.analysis", "simwarp.exporters", "simwarp.flex", "simwarp.importers",
    "simwarp.kinematics", "simwarp.mcap", "simwarp.motions", "simwarp.planning",
    "simwarp.scenery", "simwarp.sensors", "simwarp.soil", "simwarp.tasks", "simwarp.tasks.driving", "simwarp.train",
    "simwarp.vehicle", "simwarp.viewer",
)  # fmt: skip


@pytest.mark.parametrize("package", FRONT)
def test_every_public_class_prints_more_than_its_address(package):
    module = importlib.import_module(package)
    kinds = {name: getattr(module, name) for name in module.__all__}
    bare = [
        name for name, kind in kinds.items()
        if inspect.isclass(kind) and kind.__repr__ is object.__repr__ and not getattr(kind, "_is_protocol", False)
    ]  # fmt: skip
    assert bare == []


def test_everything_prints_in_twelve_lines(things):
    for name, thing in things.items():
        lines = repr(thing).splitlines()
        assert len(lines) <= MOST_LINES, name
        assert max(map(len, lines)) <= WIDEST, name
        assert " object at 0x" not in repr(thing), name
        assert "(incomplete)" not in repr(thing), name


def test_nothing_is_read_or_launched_to_print(things, monkeypatch):
    """As on a GPU: there reading an array waits for the device."""

    def refuse(*_args, **_options):
        raise AssertionError("read")

    monkeypatch.setattr(wp.array, "numpy", refuse)
    for name in ("launch", "copy", "to_torch", "from_torch", "zeros", "synchronize"):
        monkeypatch.setattr(wp, name, refuse)
    assert "(incomplete)" in repr(things["simulation"])  # the time of worlds on the CPU is read
    monkeypatch.setattr(readings_module, "on_host", lambda array: False)
    for name, thing in things.items():
        assert "(incomplete)" not in repr(thing), name
    assert "time" not in repr(things["simulation"])


def test_a_result_on_another_device_prints_shapes(things):
    result = things["result"]
    assert "mean" in repr(result)

    def away(value):
        if isinstance(value, dict):
            return {name: tensor.to("meta") for name, tensor in value.items()}
        return None if value is None else value.to("meta")  # has no numbers: whoever reads one gets an error

    moved = {field.name: away(getattr(result, field.name)) for field in dataclasses.fields(result)}
    assert repr(dataclasses.replace(result, **moved)).splitlines()[:3] == [
        "StepResult: 4 worlds on meta",
        "  rewards       (4,) float32",
        f"  terms         (4, {result.reward_terms.shape[1]}) float32",
    ]


def test_the_numbers_of_a_result_are_those_of_its_tensors(things):
    flags = torch.tensor([True, False, True, True])
    result = dataclasses.replace(
        things["result"], rewards=torch.tensor([1.0, 2.0, 3.0, 6.0]), terminated=flags, truncated=~flags,
        success=flags & False, non_finite=flags,
    )  # fmt: skip
    assert repr(result).splitlines()[1:3] == [
        "  rewards       mean 3, from 1 to 6",
        "  ended         3 terminated, 1 truncated, 0 successful, 3 non-finite",
    ]


def test_the_tables_say_what_there_is(things):
    assert repr(things["builder"]) == (
        "ModelBuilder: gravity [0.0, 0.0, -9.81] m/s²\n"
        "  bodies  2: cart, pole\n"
        "  joints  2: slide (prismatic), hinge (revolute)\n"
        "  shapes  2: bob (sphere on pole), ground (plane on WORLD)"
    )
    assert repr(things["empty builder"]) == "ModelBuilder: empty, gravity [0.0, 0.0, -9.81] m/s²"
    printed = repr(things["model"])
    assert printed.startswith("Model: 3 worlds on cpu\n  bodies       2: cart, pole\n")
    assert printed.endswith("\n  per world    2: gravity, body_mass")
    assert repr(things["robot"]).splitlines()[1:] == [
        "  bodies     1: arm",
        "  dofs       1: hinge",
        "  shapes     1: rod",
        "  actuators  1: motor",
        "  report     4 held, 0 near, 0 refused; print(report) lists them",
    ]
    assert repr(things["sensor Imu"]).startswith(
        "Imu 'imu' on 'pole': 100 Hz, 3 worlds on cpu\n  data   (3, 6) float32"
    )
    assert repr(things["policy source"]).startswith("PolicySource for task 'pendulum': policy shipped with simwarp\n")


def test_worlds_with_times_of_their_own_print_both_ends():
    sim = sw.Simulation(cart_and_pole().finalize(3, "cpu"), 0.01, threads=1)
    sim.step(5)
    assert repr(sim).splitlines()[-1] == "  time    0.05 s"
    sim.reset(np.array([True, False, False]))
    sim.step(5)
    assert repr(sim).splitlines()[-1] == "  time    0.05 to 0.1 s"


def every_class(base):
    """A class and all below it, after all modules of the package are imported."""
    for part in pkgutil.walk_packages(sw.__path__, "simwarp."):
        if (
            not part.name.endswith("__main__")
            and ".kernels." not in part.name
            and not part.name.endswith("_kernels")
            and ".cli" not in part.name
        ):
            try:
                importlib.import_module(part.name)
            except ImportError:
                continue  # needs an extra
    waiting, found = [base], set()
    while waiting:
        for kind in waiting.pop().__subclasses__():
            if kind.__module__.startswith("simwarp") and kind not in found:
                found.add(kind)
                waiting.append(kind)
    return sorted(found, key=lambda kind: kind.__qualname__)


@pytest.mark.parametrize("base", [Readable, ReadableFields])
def test_half_built_objects_print(base):
    kinds = every_class(base)
    assert len(kinds) > 15
    for kind in kinds:
        text = repr(kind.__new__(kind)) if not getattr(kind, "__abstractmethods__", None) else ""
        assert len(text.splitlines()) <= MOST_LINES, kind
        assert all(len(line) <= WIDEST for line in text.splitlines()), kind


def test_what_a_failed_construction_leaves_prints():
    left = []

    class Kept(sw.Simulation):
        def __init__(self, *args, **options):
            left.append(self)
            super().__init__(*args, **options)

    model = cart_and_pole().finalize(1, "cpu")
    same = [sensors.Imu(model, sensors.Mount("pole")) for _ in range(2)]
    with pytest.raises(ModelError, match="two sensors"):
        Kept(model, 0.01, sensors=same)
    assert repr(left[0]) == "Kept (incomplete)"


def test_errors_name_the_class_and_not_the_table(things):
    for name in ("builder", "model", "simulation", "state", "task", "robot", "scene"):
        text = formatted(things[name])
        assert text.split()[0] in ("a", "an")
        assert text.split()[1:] == [type(things[name]).__name__]


def test_snapshots_know_surfaces_by_their_first_words():
    # the words of the dataclass when snapshots were first written: files of them are to be read
    words = (
        "Material(friction=0.25, rolling_friction=0.0, spinning_friction=0.0, restitution=0.0, cohesion=0.0, "
        "compliance=0.0, damping=0.0, young_modulus=200000.0, poisson_ratio=0.3, priority=0)"
    )
    digest = hashlib.blake2b(words.encode(), digest_size=16).hexdigest()[:8]
    assert _surface_line(sw.Material(friction=0.25)) == f" with surface {digest}"


def test_an_evaluation_prints_its_numbers(things):
    assert isinstance(things["evaluation"], Evaluation)
    assert "episodes=4" in repr(things["evaluation"])
