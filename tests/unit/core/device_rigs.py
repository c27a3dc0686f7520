"""Small things on a device, and a call of every public function that takes arrays: see `test_array_devices`."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Final, Protocol

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp import scenery, sensors, soil, vehicle
from simwarp.actuators import Actuators, ActuatorSpec
from simwarp.core.interop import array_over, from_torch, to_torch
from simwarp.kinematics import InverseKinematics
from simwarp.tasks import TaskEnv, TaskVectorEnv, make
from simwarp.train.algorithm.vec_env import TaskVecEnv
from simwarp.train.networks.augmentation import augment
from simwarp.vehicle.tires.tires import Mount as TireMount, tire_vector

WORLDS: Final = 3
SOME: Final = np.array([True, False, True])
Q: Final = np.array([[0.1, -0.2], [0.3, 0.4], [-0.5, 0.6]], np.float32)
PLACES: Final = np.array([(1.0, 2.0), (3.0, -2.0), (-5.0, 4.0)])


class Give(Protocol):
    """Makes an array of values; `dtype` is that of a Warp array."""

    def __call__(self, values: Any, dtype: Any = None) -> Any: ...


@dataclasses.dataclass(frozen=True)
class Call:
    """A call with arrays.

    Attributes:
        rig: what it is made on.
        does: makes it, and returns what came of it as NumPy.
        moves: arrays of another device are moved, otherwise they are refused.
        kinds: of arrays that it takes.
        captured: it may run while a graph is captured.
    """

    rig: str
    does: Callable[[Any, Give], Any]
    moves: bool = True
    kinds: tuple[str, ...] = ("warp", "torch", "numpy")
    captured: bool = False


# ---- what calls are made on ------------------------------------------------------------------------------------------


def arm_builder() -> sw.ModelBuilder:
    """Two bodies on two hinges."""
    builder = sw.ModelBuilder()
    for name in ("upper", "fore"):
        builder.add_body(name, mass=1.0, inertia=(1, 1, 1))
    builder.add_joint_revolute("shoulder", sw.WORLD, 0, axis=(0, 1, 0), anchor=(0, 0, 1))
    builder.add_joint_revolute("elbow", 0, 1, axis=(0, 1, 0), anchor=(0, 0, -1))
    return builder


class Arm:
    """An arm with motors and an inertial unit."""

    def __init__(self, device: str) -> None:
        self.model = arm_builder().finalize(WORLDS, device, per_world=["body_mass"])
        specs = [ActuatorSpec(name=f"m{k}", terms=((k, 1.0),), ctrl_range=(-2.0, 4.0)) for k in range(2)]
        self.actuators = Actuators(self.model, specs)
        self.imu = sensors.Imu(self.model, sensors.Mount("fore"))
        self.sim = sw.Simulation(
            self.model, 0.01, elements=[self.actuators], sensors=[self.imu], threads=None if device != "cpu" else 1
        )
        self.search = InverseKinematics(self.sim, "fore", (0.0, 0.0, 0.5))
        self.search.target.assign(np.array([[0.3, 0.0, 1.2]] * WORLDS))

    def moved(self) -> sw.Simulation:
        """Its simulation, somewhere on its way."""
        self.sim.control.joint_force.zero_()  # other calls wrote it
        self.sim.reset()
        self.sim.set_joint_state(None, Q, Q)
        self.sim.step(2)
        return self.sim

    def seen(self) -> Any:
        """Coordinates and rates."""
        return np.concatenate([self.sim.state.joint_x.numpy(), self.sim.state.joint_qd.numpy()])


class Ground:
    """A wheel above soil."""

    def __init__(self, device: str) -> None:
        builder = sw.ModelBuilder()
        body = builder.add_body("wheel", mass=100.0, inertia=(5, 5, 5), pose=sw.pose((0.0, 0.0, 0.45)))
        self.model = builder.finalize(WORLDS, device)
        self.soil = soil.Soil(self.model, [soil.SoilWheel(body=body, radius=0.47, width=0.25)], "mid")
        self.sim = sw.Simulation(self.model, 1e-3, elements=[self.soil])

    def fresh(self) -> soil.Soil:
        """Untouched."""
        self.sim.reset()
        self.soil.rest_force_b.zero_()
        self.soil.imprint()
        return self.soil

    def depths(self) -> Any:
        """Of the ground below the wheel."""
        return self.soil.height(PLACES * 0.05).numpy()


class Car:
    """A vehicle with a load, and who drives it."""

    def __init__(self, device: str) -> None:
        builder = sw.ModelBuilder()
        self.parts = vehicle.add_vehicle(builder, vehicle.load_vehicle("hmmwv-reduced"), speed=5.0)
        self.load = vehicle.add_payload(builder, self.parts, mass=300.0)
        self.model = builder.finalize(WORLDS, device, per_world={*vehicle.per_world(), *vehicle.PAYLOAD})
        self.vehicle = vehicle.Vehicle(self.parts, self.model)
        self.tracker = vehicle.PathTracker(
            self.vehicle, vehicle.PathTrackingSpec(paths=(vehicle.circle(20.0),), speed=5.0)
        )
        self.sim = sw.Simulation(
            self.model, 2.0e-3, elements=[self.tracker, self.vehicle], solver=vehicle.VEHICLE_SOLVER
        )

    def at_start(self) -> sw.Simulation:
        """Its simulation at the start."""
        self.sim.reset()
        return self.sim

    def seen(self) -> Any:
        """Where all bodies are."""
        return self.sim.state.body_x.numpy().copy()


class Wheels:
    """Tires without a vehicle."""

    def __init__(self, device: str) -> None:
        self.device = device
        row = tire_vector(vehicle.load_vehicle("gator").axles[0].tire)
        self.tires = vehicle.Tires([TireMount(row, 0)], WORLDS, 1, device)
        model = self._body().finalize(WORLDS, device)
        self.state = sw.State(model)
        self.state.body_x.assign(np.array([[[0.0, 0.0, 0.2]]] * WORLDS))
        self.state.body_rot.assign(np.array([[[0.0, 0.0, 0.0, 1.0]]] * WORLDS))

    def _body(self) -> sw.ModelBuilder:
        builder = sw.ModelBuilder()
        builder.add_body("wheel", mass=10.0, inertia=(1, 1, 1))
        return builder

    def force(self, out: wp.array) -> Any:
        """Forces of a step."""
        self.tires.apply(1e-3, self.state.arrays, force=out)
        return out.numpy()


class Eyes:
    """Sensors with rays."""

    def __init__(self, device: str) -> None:
        builder = arm_builder()
        builder.add_shape_sphere(1, radius=0.3)
        visuals = sensors.Visuals(builder)
        self.model = builder.finalize(WORLDS, device)
        self.scene = visuals.finalize(self.model)
        beams = sensors.beam_grid(4, 2)
        mount, rate = sensors.Mount("upper"), sensors.Schedule(rate=100.0)
        self.sensors: dict[str, Any] = {
            "camera": sensors.Camera(self.scene, mount, sensors.CameraConfig(width=4, height=3)),
            "lidar": sensors.Lidar(self.scene, mount, sensors.LidarConfig(schedule=rate, beams=beams)),
            "radar": sensors.Radar(self.scene, mount, sensors.RadarConfig(schedule=rate, rays=beams)),
        }
        self.sim = sw.Simulation(self.model, 0.01, sensors=list(self.sensors.values()))

    def begin(self, name: str, mask: Any) -> Any:
        """A sensor's frame in some worlds."""
        sensor = self.sensors[name]
        sensor.begin(self.sim, mask)
        return np.asarray(sensor.frames.tick.mode.numpy())


class Learning:
    """A task and its adapters."""

    def __init__(self, device: str) -> None:
        self.device = device
        self.task = make("pendulum", WORLDS, device=device, seed=1, capture=False)
        self.single = make("pendulum", 1, device=device, seed=1, capture=False)

    def restarted(self) -> Any:
        """The task at a start that is always the same."""
        self.task.restart(seed=1)
        return self.task


RIGS: Final[dict[str, Callable[[str], Any]]] = {
    "arm": Arm, "ground": Ground, "car": Car, "wheels": Wheels, "eyes": Eyes, "task": Learning, "none": str,
}  # fmt: skip


@functools.cache
def rig(name: str, device: str) -> Any:
    """A rig on a device, made once."""
    return RIGS[name](device)


# ---- calls -----------------------------------------------------------------------------------------------------------


def _after(arm: Arm, call: Callable[[sw.Simulation], object]) -> Any:
    call(arm.moved())
    return arm.seen()


def _written(arm: Arm, write: Callable[[sw.Simulation], object]) -> Any:
    arm.sim.control.joint_force.zero_()
    write(arm.sim)
    return arm.sim.control.joint_force.numpy().copy()


def _solved(device: str, give: Give) -> Any:
    n, r, mu = np.array([np.eye(3)] * 2), np.array([[-1.0, 0.2, 0.1]] * 2), np.full((2, 1), 0.5)
    given = [give(each, wp.float64) for each in (n, r, mu)]
    found = sw.solve_cone_problems(*given, warm_start=give(np.zeros((2, 3)), wp.float64), device=device).impulse
    return found if isinstance(found, np.ndarray) else found.cpu().numpy() if hasattr(found, "cpu") else found.numpy()


def _solved_from_mechanics(device: str, give: Give) -> Any:
    d, m, v, b = np.array([np.eye(3)] * 2), np.ones((2, 3)), np.array([[-1.0, 0.2, 0.1]] * 2), np.zeros((2, 3))
    names = ("jacobian", "inverse_mass", "free_velocity", "bias")
    given = {name: give(each, wp.float64) for name, each in zip(names, (d, m, v, b), strict=True)}
    found = sw.solve_cone_problems(None, None, np.full((2, 1), 0.5), **given, device=device).impulse
    return found if isinstance(found, np.ndarray) else found.cpu().numpy() if hasattr(found, "cpu") else found.numpy()


def _searched(arm: Arm, start: Any) -> Any:
    arm.moved()
    arm.search.solve(start)
    return arm.search.q.numpy()


def _searched_as_recorded(arm: Arm, mask: Any, start: Any) -> Any:
    arm.moved()
    arm.search.q.zero_()
    arm.sim.shares.run([arm.search.record(mask, start)])
    return arm.search.q.numpy()


def _acted(arm: Arm, action: Any) -> Any:
    arm.actuators.set_from_action(action)
    return arm.actuators.ctrl.numpy().copy()


def _frames(arm: Arm, begin: Callable[[sw.Simulation], object]) -> Any:
    sim = arm.moved()
    begin(sim)
    return arm.imu.frames.tick.mode.numpy()


def _recorded_outputs(car: Car, mask: Any) -> Any:
    sim = car.at_start()
    sim.shares.run(car.vehicle.record_outputs(sim, mask))
    return car.vehicle.position.numpy()


def _placed(car: Car, *arguments: Any) -> Any:
    vehicle.place_vehicle(car.at_start(), car.vehicle, *arguments)
    return car.seen()


def _loaded(car: Car, **values: Any) -> Any:
    vehicle.set_payload(car.at_start(), car.load, **values)
    return np.concatenate([car.model.body_mass.numpy().ravel(), car.seen().ravel()])


def _looked_anew(car: Car, mask: Any) -> Any:
    sim = car.at_start()
    sim.step(2)
    car.tracker.restart(mask)
    return car.tracker.memory["started"].numpy()


def _pressed(ground: Ground, call: Callable[[soil.Soil], object]) -> Any:
    found = call(ground.fresh())
    return ground.depths() if found is None else found


def _recorded_on_soil(ground: Ground, record: Callable[[soil.Soil], Any]) -> Any:
    launches = record(ground.fresh())
    ground.sim.shares.run(launches)
    return ground.depths()


def _placed_scene(eyes: Eyes, due: Any) -> Any:
    tables: Any = eyes.scene.tables()
    tables.lower.zero_()
    eyes.scene.place(eyes.sim.state, tables, due)
    return tables.lower.numpy()


def _recorded_scene(eyes: Eyes, due: Any) -> Any:
    tables: Any = eyes.scene.tables()
    tables.lower.zero_()
    eyes.sim.shares.run(eyes.scene.record_place(eyes.sim, tables, due))
    return tables.lower.numpy()


def _valued_scene(eyes: Eyes, values: Any) -> Any:
    builder = sw.ModelBuilder()
    stuff = sw.flex.Rubber(young=1e6, density=1e3)
    sheet = builder.add_shell("sheet", np.eye(3), [[0, 1, 2]], thickness=0.1, material=stuff)
    visuals = sensors.Visuals(builder)
    visuals.show_values(sheet)
    scene = visuals.finalize(builder.finalize(1, device=str(eyes.sim.model.device)))
    scene.set_values(sheet, values, most=1.0)
    return values.numpy()


def _stepped(learning: Learning, action: Any) -> Any:
    return learning.restarted().step(action).rewards.cpu().numpy()


def _advanced(learning: Learning, request: Any) -> Any:
    task = learning.restarted()
    task.advance(request)
    return task.observe()["policy"].cpu().numpy()


def _over_gymnasium(learning: Learning, action: Any) -> Any:
    env = TaskVectorEnv(learning.restarted())
    env.reset(seed=1)
    return env.step(action)[1]


def _over_one_of_gymnasium(learning: Learning, action: Any) -> Any:
    env = TaskEnv("pendulum", device=learning.device, seed=1)
    env.reset(seed=1)
    return env.step(action)[1]


def _over_rsl_rl(learning: Learning, action: Any) -> Any:
    return TaskVecEnv(learning.restarted()).step(action)[1].cpu().numpy()


def _begun(learning: Learning, mask: Any) -> Any:
    task = learning.restarted()
    task.step(torch.zeros(WORLDS, task.action_size, device=task.device))
    return task.begin_episodes(mask)["policy"].cpu().numpy()


def _loaded_state(learning: Learning, give: Give) -> Any:
    task = learning.restarted()
    kept = _each(task.state_dict(), lambda tensor: give(tensor.cpu().numpy()))
    task.step(torch.ones(WORLDS, task.action_size, device=task.device))
    task.load_state_dict(kept)
    return task.observe()["policy"].cpu().numpy()


def _each(value: Any, change: Callable[[torch.Tensor], Any]) -> Any:
    if isinstance(value, dict):
        return {name: _each(part, change) for name, part in value.items()}
    return change(value) if isinstance(value, torch.Tensor) else value


def _tires_of(wheels: Wheels, mask: Any) -> Any:
    wheels.tires.state.fill_(1.0)
    wheels.tires.reset(mask)
    return wheels.tires.state.numpy().copy()


WARP: Final = ("warp",)
TENSORS: Final = ("torch",)
CALLS: Final[dict[str, Call]] = {
    # between steps: moved
    "Simulation.reset": Call("arm", lambda a, g: _after(a, lambda sim: sim.reset(g(SOME))), captured=True),
    "Simulation.copy_worlds": Call("arm", lambda a, g: _after(a, lambda sim: sim.copy_worlds(1, g(SOME)))),
    "Simulation.restore": Call("arm", lambda a, g: _after(a, lambda s: s.restore(s.snapshot(world=1), g(SOME)))),
    "Simulation.begin_sensors": Call("arm", lambda a, g: _frames(a, lambda sim: sim.begin_sensors(g(SOME)))),
    "Simulation.measure": Call("arm", lambda a, g: _after(a, lambda sim: sim.measure(g(SOME)))),
    "Simulation.set_joint_state": Call(
        "arm", lambda a, g: _after(a, lambda sim: sim.set_joint_state(g(SOME), g(Q, wp.float32), g(Q, wp.float32)))
    ),
    "Simulation.set_joint_state mask alone": Call(
        "arm", lambda a, g: _after(a, lambda sim: sim.set_joint_state(g(SOME), None, None))
    ),
    "Simulation.set_joint_state doubles": Call(
        "arm", lambda a, g: _after(a, lambda sim: sim.set_joint_state(None, g(Q.astype(np.float64), wp.float64), None))
    ),
    "WritableArray.__setitem__": Call(
        "arm", lambda a, g: _written(a, lambda sim: sim.control.joint_force.__setitem__(slice(None), g(Q, wp.float32)))
    ),
    "WritableArray.__setitem__ column": Call(
        "arm",
        lambda a, g: _written(
            a, lambda sim: sim.control.joint_force.__setitem__((slice(None), 1), g(Q[:, 0].copy(), wp.float32))
        ),
    ),
    "WritableArray.assign": Call(
        "arm", lambda a, g: _written(a, lambda sim: sim.control.joint_force.assign(g(Q, wp.float32)))
    ),
    "solve_cone_problems": Call("none", _solved),
    "solve_cone_problems mechanics": Call("none", _solved_from_mechanics),
    "place_vehicle": Call(
        "car", lambda c, g: _placed(c, g(PLACES, wp.float64), g(np.array([0.1, 0.2, 0.3]), wp.float64), g(SOME))
    ),
    "set_payload": Call(
        "car",
        lambda c, g: _loaded(
            c, mass=g(np.array([200.0, 300.0, 400.0]), wp.float64), position=g(np.ones((3, 3)), wp.float64),
            worlds=g(SOME),
        ),
    ),
    "PathTracker.restart": Call("car", lambda c, g: _looked_anew(c, g(SOME))),
    "Soil.height": Call("ground", lambda s, g: s.fresh().height(g(PLACES[None], wp.vec2d)).numpy()),
    "Soil.surface": Call("ground", lambda s, g: s.fresh().surface(g(PLACES[None], wp.vec2d))[1].numpy()),
    "Soil.imprint": Call("ground", lambda s, g: _pressed(s, lambda each: each.imprint(g(SOME)))),
    "Soil.keep_forces": Call("ground", lambda s, g: _pressed(s, lambda each: each.keep_forces(g(SOME)))),
    "Soil.resting_shifts": Call("ground", lambda s, g: _pressed(s, lambda each: each.resting_shifts(g(SOME)).numpy())),
    "Task.begin_episodes": Call("task", lambda t, g: _begun(t, g(SOME)), kinds=TENSORS),
    "Task.load_state_dict": Call("task", _loaded_state, kinds=TENSORS),
    "TaskVectorEnv.step": Call(
        "task", lambda t, g: _over_gymnasium(t, g(Q[:, :1].copy(), wp.float32))
    ),
    "TaskEnv.step": Call("task", lambda t, g: _over_one_of_gymnasium(t, g(Q[0, :1].copy(), wp.float32))),
    "Task.step": Call("task", lambda t, g: _stepped(t, g(Q[:, :1].copy())), kinds=TENSORS),
    "Task.advance": Call("task", lambda t, g: _advanced(t, g(Q[:, :1].copy())), kinds=TENSORS),
    "TaskVecEnv.step": Call("task", lambda t, g: _over_rsl_rl(t, g(Q[:, :1].copy())), kinds=TENSORS),
    # in steps, where they are read as they are: refused
    "Actuators.set_from_action": Call(
        "arm", lambda a, g: _acted(a, g(Q, wp.float32)), moves=False, kinds=("warp", "torch")
    ),
    "InverseKinematics.solve": Call("arm", lambda a, g: _searched(a, g(Q, wp.float32)), moves=False, kinds=WARP),
    "InverseKinematics.record start": Call(
        "arm", lambda a, g: _searched_as_recorded(a, a.sim._all_worlds, g(Q, wp.float32)), moves=False, kinds=WARP
    ),
    "InverseKinematics.record mask": Call(
        "arm", lambda a, g: _searched_as_recorded(a, g(SOME), a.sim.state.joint_q), moves=False, kinds=WARP
    ),
    "FrameSensor.begin": Call(
        "arm", lambda a, g: _frames(a, lambda sim: a.imu.begin(sim, g(SOME))), moves=False, kinds=WARP
    ),
    "FrameBuffer.begin": Call(
        "arm", lambda a, g: _frames(a, lambda sim: a.imu.frames.begin(sim, g(SOME))), moves=False, kinds=WARP
    ),
    **{
        f"FrameSensor.begin {name}": Call(
            "eyes", lambda e, g, name=name: e.begin(name, g(SOME)), moves=False, kinds=WARP  # type: ignore[misc]
        )
        for name in ("camera", "lidar", "radar")
    },
    "Scene.place": Call("eyes", lambda e, g: _placed_scene(e, g([1, 0, 1], wp.int32)), moves=False, kinds=WARP),
    "Scene.set_values": Call("eyes", lambda e, g: _valued_scene(e, g([[0.5]], wp.float32)), moves=False, kinds=WARP),
    "Scene.record_place": Call(
        "eyes", lambda e, g: _recorded_scene(e, g([1, 0, 1], wp.int32)), moves=False, kinds=WARP
    ),
    "Soil.record_imprint": Call(
        "ground", lambda s, g: _recorded_on_soil(s, lambda each: each.record_imprint(s.sim, g(SOME))), moves=False,
        kinds=WARP,
    ),
    "Soil.record_reset": Call(
        "ground", lambda s, g: _recorded_on_soil(s, lambda each: each.record_reset(s.sim, g(SOME))), moves=False,
        kinds=WARP,
    ),
    "Vehicle.record_outputs": Call("car", lambda c, g: _recorded_outputs(c, g(SOME)), moves=False, kinds=WARP),
    "Tires.apply": Call(
        "wheels", lambda w, g: w.force(g(np.zeros((WORLDS, 1, 3), np.float32), wp.vec3)), moves=False, kinds=WARP
    ),
    "Tires.reset": Call("wheels", lambda w, g: _tires_of(w, g(SOME)), moves=False, kinds=WARP),
    # of whichever device the array is
    "to_torch": Call("none", lambda _, g: to_torch(g(Q, wp.float32)).cpu().numpy(), kinds=WARP),
    "from_torch": Call("none", lambda _, g: from_torch(g(Q)).numpy(), kinds=TENSORS),
    "array_over": Call("none", lambda _, g: array_over(g(Q).T).numpy(), kinds=TENSORS),
    "augment": Call(
        "none", lambda _, g: np.array(augment(g(np.zeros((1, 8, 8, 3), np.uint8))).shape), kinds=TENSORS
    ),
}  # fmt: skip
"""By the function, with a word where there are several of one."""

REAL_ONLY: Final = {
    "WritableArray.__setitem__", "WritableArray.__setitem__ column", "WritableArray.assign", "to_torch", "from_torch",
    "array_over", "augment",
    "Task.begin_episodes", "Task.step", "Task.advance", "TaskVecEnv.step",
    "Task.load_state_dict", "TaskVectorEnv.step", "TaskEnv.step", "solve_cone_problems",
    "solve_cone_problems mechanics",
}  # fmt: skip
"""Calls that leave the moving to Warp's or torch's own copies, which an array that only says so would not take."""

HEIGHTS: Final = np.array([[0.0, 0.1, 0.0], [0.2, 0.0, 0.1], [0.0, 0.0, 0.3]])
TETRAHEDRON: Final = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
FACES: Final = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
SQUARE: Final = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)])


def _built(add: Callable[[sw.ModelBuilder, Any], object]) -> Callable[[Any], Any]:
    def make_of(values: Any) -> Any:
        builder = sw.ModelBuilder()
        builder.add_body("first", mass=1.0, inertia=(1, 1, 1))
        add(builder, values)
        bodies = np.array([float(np.asarray(body.inertia).sum()) for body in builder.bodies])
        return np.concatenate([bodies, *(hull.vertices.ravel() for hull in builder.hulls)])

    return make_of


def _seen(add: Callable[[sensors.Visuals, Any], object]) -> Callable[[Any], Any]:
    def make_of(values: Any) -> Any:
        visuals = sensors.Visuals(arm_builder())
        add(visuals, values)
        return visuals.meshes[0].vertices

    return make_of


def _turned(lens: Any) -> Callable[[Any], Any]:
    return lambda values: np.asarray(lens.points(values))


HOST: Final[dict[str, tuple[Callable[[Any], Any], Any]]] = {
    "ShapeList.add_body": (
        _built(lambda b, v: b.add_body("second", mass=1.0, inertia=v)), np.diag([1.0, 2.0, 2.5])
    ),
    "FlexibleParts.add_rod": (
        _built(
            lambda b, v: b.add_rod(
                "rod", v, section=sw.flex.Round(diameter=0.1), material=sw.flex.Elastic(young=1e6, density=1000.0)
            )
        ),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.5, 0.0]]),
    ),
    "FlexibleParts.add_shell": (
        _built(
            lambda b, v: b.add_shell("sheet", v, FACES, thickness=0.1, material=sw.flex.Rubber(young=1e6, density=1e3))
        ),
        TETRAHEDRON,
    ),
    "ShapeList.add_solid": (_built(lambda b, v: b.add_solid("s", "hull", mass=1.0, points=v)), TETRAHEDRON),
    "ShapeList.add_shape_hull": (_built(lambda b, v: b.add_shape_hull(0, v)), TETRAHEDRON),
    "ShapeList.add_hull_asset": (_built(lambda b, v: b.add_hull_asset(v)), TETRAHEDRON),
    "ShapeList.add_shape_mesh": (_built(lambda b, v: b.add_shape_mesh(sw.WORLD, v, FACES)), TETRAHEDRON),
    "ShapeList.add_mesh_asset": (_built(lambda b, v: b.add_mesh_asset(v, FACES)), TETRAHEDRON),
    "ShapeList.add_shape_height_field": (
        _built(lambda b, v: b.add_shape_height_field(sw.WORLD, v, size=(2.0, 2.0))), HEIGHTS
    ),
    "ShapeList.add_height_field_asset": (_built(lambda b, v: b.add_height_field_asset(v, size=(2.0, 2.0))), HEIGHTS),
    "Visuals.add_mesh": (_seen(lambda s, v: s.add_mesh(0, v, FACES)), TETRAHEDRON),
    "Visuals.add_mesh_asset": (_seen(lambda s, v: s.add_mesh_asset(v, FACES)), TETRAHEDRON),
    "Pinhole.points": (_turned(sensors.Pinhole()), TETRAHEDRON[1:]),
    "FishEye.points": (_turned(sensors.FishEye()), TETRAHEDRON[1:]),
    "Radial.points": (_turned(sensors.Radial()), TETRAHEDRON[1:]),
    "flattened": (lambda v: scenery.flattened(v, (2.0, 2.0), [(0.0, 0.0, 0.5)]), HEIGHTS),
    "height_at": (lambda v: scenery.height_at(HEIGHTS, (2.0, 2.0), v), PLACES),
    "steepness": (lambda v: np.array(scenery.steepness(v, (2.0, 2.0))), HEIGHTS),
    "scattered": (lambda v: scenery.scattered(3, keep_clear=v), np.array([(0.0, 0.0, 3.0)])),
    "barrier_chain": (lambda v: scenery.barrier_chain(v).mesh.vertices, SQUARE),
    "rounded": (lambda v: scenery.rounded(v, 3.0, width=4.0).points, SQUARE),
    "Track.at": (lambda v: scenery.rounded(SQUARE, 3.0, width=4.0).at(v), np.array([1.0, 2.0])),
    "arranged": (lambda v: scenery.arranged(scenery.cone(), v).mesh.vertices, np.array([(1.0, 2.0, 0.3)])),
}  # fmt: skip
"""Functions that describe a model, on the host: what they make of an array, and its values."""

BY_SUBCLASSES: Final = "a task overrides it, and is called with its own tensors"
APART: Final[dict[str, str]] = {
    **dict.fromkeys(("Task.apply", "Task.reset", "Task.load_extra_state"), BY_SUBCLASSES),
    "Task.set_level": "numbers, one for each world, which torch brings to the task's device",
    **dict.fromkeys(
        ("ActuatorNetwork.begin", "ActuatorNetwork.follow", "ActuatorNetwork.load_state"), "a task's own tensors"
    ),
    "TaskVecEnv.hand_out": "the adapter calls it with the task's tensors",
    "Sensor.begin": "does nothing: see FrameSensor",
    "ForceElement.record_outputs": "does nothing: the Simulation calls it",
    "ForceElement.record_reset": "does nothing: the Simulation calls it",
    "Snapshot.empty": "allocates like the arrays that it gets",
    "Vehicles.record_outputs": "Vehicle.record_outputs calls it",
    "TrackedVehicle.record_outputs": "as that of Vehicle, with readings of tracks",
    **{f"ReducedWheels.record{what}": "Vehicle calls it" for what in ("", "_poses", "_set_poses")},
    **dict.fromkeys(
        ("Imported.q_from", "Imported.qd_from", "Imported.qpos_from", "Imported.qvel_from"), "another simulator's data"
    ),
    "TensorLaunch.on": "see test_a_launch_over_tensors_refuses_those_of_another_device",
    **dict.fromkeys(("LiveView.reset", "Task.copy_worlds"), "hands the mask to the Simulation"),
    "check_step": "makes its actions on the task's device",
    **dict.fromkeys(("draw_lines", "portrait", "FollowCamera.floors", "spring_lengths", "travel_table"), "of NumPy"),
    **dict.fromkeys(("Task.look_ahead", "SampledPlan.reset", "Ilqr.reset"), "torch brings them to the task's device"),
    **dict.fromkeys(
        ("Imagination.advance", "Imagination.costs", "ActionSpline.actions", "ActionSpline.shifted"), "own tensors"
    ),
    **dict.fromkeys(("Snapshot.of_one_world", "Snapshot.take"), "the Simulation calls it with its own arrays"),
}
"""Functions that take arrays and are not called here, each with its reason."""
NOT_FOUND: Final = {"WritableArray.__setitem__", "WritableArray.assign", "TaskVecEnv.step"}
"""Methods of classes that no package exports."""
