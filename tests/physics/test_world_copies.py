"""A copy of a world goes on like the world itself, bit by bit; all others go on as if nothing had been copied."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.sensors.cameras.camera import Camera, CameraConfig
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.imu import Imu, ImuConfig
from simwarp.sensors.scene import Visuals
from simwarp.soil import soil_under
from simwarp.vehicle import VEHICLE_SOLVER, CommonTire, Vehicle, add_vehicle, load_vehicle, per_world, with_options
from simwarp.vehicle.driving.path_tracking import PathTracker, PathTrackingSpec, PIDGains
from simwarp.vehicle.driving.paths import circle
from tests.unit.vehicle.tracks.test_track_worlds import made as tracked

WORLDS, SOURCE = 6, 3
TARGETS = [0, 3, 5]
UNTOUCHED = [1, 2, 4]

Made = tuple[sw.Simulation, Callable[[], None]]
"""A simulation, and what makes its worlds differ."""


def spread(array: Any, least: float, most: float, worlds: int = WORLDS) -> None:
    """Scales the rows of an array by world."""
    values = array.numpy()
    factors = np.linspace(least, most, worlds).reshape(worlds, *(1,) * (values.ndim - 1))
    array.assign((values * factors).astype(values.dtype))


def pushed(sim: sw.Simulation, size: float) -> None:
    """Forces that differ by world, and stay."""
    force = np.random.default_rng(7).normal(size=sim.control.joint_force.shape) * size
    sim.control.joint_force.assign(force.astype(np.float32))


def ant(worlds: int = WORLDS) -> Made:
    model = scenes.ant(height=0.35).finalize(worlds, "cpu", per_world=("body_mass", "shape_friction", "joint_damping"))
    sim = sw.Simulation(model, 5e-3)

    def differ() -> None:
        spread(model.body_mass, 0.8, 1.2, worlds)
        spread(model.shape_friction, 0.5, 1.5, worlds)
        pushed(sim, 0.3)

    return sim, differ


def linkage(worlds: int = WORLDS) -> Made:
    sim = sw.Simulation(scenes.linkage().finalize(worlds, "cpu"), 2e-3, joint_reactions=True)
    return sim, lambda: pushed(sim, 1.0)


def driven(tire: str | None = None, *, soil: bool = False, worlds: int = WORLDS) -> Made:
    """A HMMWV with another pedal, steering, friction, load and tire in each world."""
    builder = sw.ModelBuilder()
    spec = load_vehicle("hmmwv") if tire is None else with_options(load_vehicle("hmmwv"), tire=tire)
    parts = add_vehicle(builder, spec, speed=5.0)
    if tire == "rigid":
        builder.add_shape_plane(material=sw.Material(friction=0.9), name="ground")
    own = ("body_mass", "shape_friction")
    model = builder.finalize(worlds, "cpu", per_world=per_world(own))
    vehicle = Vehicle(parts, model, randomised=True)
    elements: list[Any] = [vehicle]
    if soil:
        elements.append(soil_under(vehicle, "mid", spacing=0.1, per_world=True))
    sim = sw.Simulation(model, 2e-3, elements=elements, solver=VEHICLE_SOLVER)

    def differ() -> None:
        spread(model.body_mass, 0.9, 1.1, worlds)
        if vehicle.tires.ground_friction.shape[0] == worlds:
            spread(vehicle.tires.ground_friction, 0.4, 1.0, worlds)
        if soil:
            spread(elements[1].parameter, 0.9, 1.1, worlds)
        if hasattr(vehicle.tires, "parameter"):
            stiffness = vehicle.tires.parameter.numpy().copy()
            stiffness[:, :, CommonTire.STIFFNESS] *= np.linspace(0.9, 1.1, worlds)[:, None]
            vehicle.tires.parameter.assign(stiffness)
        vehicle.input.assign(np.random.default_rng(1).uniform(0.1, 0.6, (worlds, 4)).astype(np.float32) * (1, 1, 0, 0))

    return sim, differ


def followed(worlds: int = WORLDS) -> Made:
    """A Gator on one of two circles, each world at another speed."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("gator"), speed=3.0)
    model = builder.finalize(worlds, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    gains = PIDGains(proportional=0.5, integral=0.1)
    tracker = PathTracker(vehicle, PathTrackingSpec(paths=(circle(20.0), circle(-15.0)), speed=4.0, speed_gains=gains))
    sim = sw.Simulation(model, 2e-3, elements=[tracker, vehicle], solver=VEHICLE_SOLVER)

    def differ() -> None:
        tracker.path.assign(np.arange(worlds, dtype=np.int32) % 2)
        spread(tracker.target_speed, 0.5, 1.5, worlds)

    return sim, differ


def chains(case: str, worlds: int = WORLDS) -> Made:
    sim, vehicle = tracked(case, worlds=worlds, own=("body_mass",))

    def differ() -> None:
        spread(sim.model.body_mass, 0.9, 1.1, worlds)
        if vehicle.belts is not None:
            spread(vehicle.belts.ground_friction, 0.5, 1.0, worlds)
        pushed(sim, 5.0)

    return sim, differ


def rod(worlds: int = WORLDS) -> Made:
    sim = sw.Simulation(scenes.rod_on_floor().finalize(worlds, "cpu"), 2e-3)

    def differ() -> None:
        force = np.random.default_rng(3).normal(size=(*sim.control.body_force.shape, 3)).astype(np.float32)
        sim.control.body_force.assign(force)

    return sim, differ


def block(worlds: int = WORLDS) -> Made:
    model = scenes.tetra().finalize(worlds, "cpu", per_world=("flexible_young",))
    sim = sw.Simulation(model, 2e-3)
    return sim, lambda: spread(model.flexible_young, 0.5, 2.0, worlds)


def sensed(worlds: int = WORLDS) -> Made:
    """A tumbling box with sensors that lag, collect over a window and start at phases of their own. They are free of
    noise: later draws are each world's own.
    """
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -1.0))
    builder.add_body("car", mass=1.0, inertia=(1, 1.2, 1.4), pose=sw.pose((0.0, 0.0, 0.7)), omega=(0.3, 0.2, 2.0))
    builder.add_shape_box(0, half=(0.3, 0.2, 0.1))
    builder.add_shape_plane(name="ground")
    visuals = Visuals(builder)
    for index in range(6):
        place = (4.0 * np.cos(index), 4.0 * np.sin(index), 0.5)
        visuals.add_box(sw.WORLD, half=(0.4, 0.3, 0.5), pose=sw.pose(place), color=(0.1 * index, 0.5, 0.9))
    model = builder.finalize(worlds, "cpu", per_world=("body_mass",))
    config = CameraConfig(
        schedule=Schedule(rate=25.0, window=0.02, lag=0.06), width=7, height=5, lens=Pinhole(fov=1.2),
        imaging=Imaging(noise_sigma=0.0),
    )  # fmt: skip
    camera = Camera(visuals.finalize(model), Mount("car"), config, per_world=("mount", "exposure"))
    quiet = ImuConfig(schedule=Schedule(rate=50.0, lag=0.03, phase="random"))
    imu = Imu(model, Mount("car"), quiet, randomised=True)
    sim = sw.Simulation(model, 5e-3, sensors=[camera, imu], read_every=4, check_start=False)

    def differ() -> None:
        spread(model.body_mass, 0.5, 2.0, worlds)
        spread(camera.image_processing.exposure, 0.5, 2.0, worlds)
        camera.mount.position.assign(np.linspace((0.0, 0.0, 0.0), (0.0, 0.1, 0.5), worlds))
        torque = np.random.default_rng(3).normal(size=(worlds, 1, 3)).astype(np.float32)
        sim.control.body_torque.assign(torque)
        sim.reset([world % 2 == 0 for world in range(worlds)])

    return sim, differ


TIRE_LAWS = ("fiala", "lugre", "pacejka2002", "pacejka89", "tmeasy", "tmsimple")
CASES: dict[str, Callable[..., Made]] = {
    "ant": ant,
    "linkage": linkage,
    "hmmwv": driven,
    **{f"hmmwv {law}": lambda worlds=WORLDS, law=law: driven(law, worlds=worlds) for law in TIRE_LAWS},
    "hmmwv rigid": lambda worlds=WORLDS: driven("rigid", worlds=worlds),
    "hmmwv soil": lambda worlds=WORLDS: driven("soil-rigid", soil=True, worlds=worlds),
    "gator follows": followed,
    "chains": lambda worlds=WORLDS: chains("chains", worlds),
    "belts on soil": lambda worlds=WORLDS: chains("belts on soil", worlds),
    "rod": rod,
    "rubber": block,
    "sensors": sensed,
}
STEPS = {"chains": (25, 15), "hmmwv soil": (80, 40), "belts on soil": (60, 40), "rubber": (40, 30)}
"""Before the copy and after it; 120 and 60 else."""


def rows(sim: sw.Simulation) -> dict[str, np.ndarray]:
    """Every array of a snapshot, and the reports of the last step, by world."""
    arrays = sim.snapshot().arrays()
    arrays |= {f"report {name}": getattr(sim.diagnostics, name) for name in sim.diagnostics.NAMES}
    worlds = sim.model.world_count
    return {
        name: array.numpy().reshape(worlds, -1).copy() for name, array in arrays.items()
        if array.size and array.shape[0] % worlds == 0
    }  # fmt: skip


def assert_rows(
    found: dict[str, np.ndarray], worlds: list[int], wanted: dict[str, np.ndarray], like: list[int]
) -> None:
    for name, values in found.items():
        for world, other in zip(worlds, like, strict=True):
            assert values[world].tobytes() == wanted[name][other].tobytes(), (name, world)


@pytest.mark.parametrize("case", CASES)
def test_copies_go_on_like_their_source_and_all_others_as_before(case):
    sim, differ = CASES[case]()
    before, after = STEPS.get(case, (120, 60))
    differ()
    sim.step(before)
    kept = sim.snapshot()
    sim.step(after)
    wanted = rows(sim)
    sim.restore(kept)
    assert any(values[0].tobytes() != values[SOURCE].tobytes() for values in rows(sim).values())
    sim.copy_worlds(SOURCE, TARGETS)
    at_once = rows(sim)
    restored = {name: array.numpy().reshape(WORLDS, -1) for name, array in kept.arrays().items() if name in at_once}
    assert_rows({name: at_once[name] for name in restored}, TARGETS, restored, [SOURCE] * len(TARGETS))
    assert_rows({name: at_once[name] for name in restored}, UNTOUCHED, restored, UNTOUCHED)
    sim.step(after)
    found = rows(sim)
    assert_rows(found, TARGETS, wanted, [SOURCE] * len(TARGETS))
    assert_rows(found, UNTOUCHED, wanted, UNTOUCHED)


@pytest.mark.parametrize("case", CASES)
def test_a_world_goes_on_alike_in_a_simulation_of_more_worlds(case):
    """One real world and many imagined ones: the copy is a world of another Simulation, with its parameters."""
    real, differ = CASES[case](worlds=WORLDS)
    imagined, _ = CASES[case](worlds=4)
    before, after = STEPS.get(case, (120, 60))
    differ()
    real.step(before)
    reference = real.snapshot()
    imagined.step(7)
    others = rows(imagined)
    imagined.copy_worlds(SOURCE, [0, 2, 3], of=real)
    assert_rows(rows(imagined), [1], others, [1])
    for sim in (imagined, real):
        sim.step(after)
    wanted = rows(real)
    assert_rows(rows(imagined), [0, 2, 3], wanted, [SOURCE] * 3)
    real.restore(reference)
    real.step(after)
    again = rows(real)
    assert all(wanted[name].tobytes() == values.tobytes() for name, values in again.items())


@pytest.mark.parametrize("case", CASES)
def test_a_snapshot_of_one_world_goes_into_many(case):
    sim, differ = CASES[case]()
    before, after = STEPS.get(case, (120, 60))
    differ()
    sim.step(before)
    one, kept = sim.snapshot(world=SOURCE), sim.snapshot()
    assert one.world_count == 1
    sim.step(after)
    sim.restore(one, TARGETS)
    restored = {name: array.numpy().reshape(WORLDS, -1) for name, array in kept.arrays().items()
                if array.size and array.shape[0] % WORLDS == 0}  # fmt: skip
    found = rows(sim)
    assert_rows({name: found[name] for name in restored}, TARGETS, restored, [SOURCE] * len(TARGETS))
