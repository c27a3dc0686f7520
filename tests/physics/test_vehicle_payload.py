"""A load fixed to the chassis drives like a chassis that holds it; every world has its own."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.payload import PAYLOAD, add_payload, box_inertia, set_payload
from simwarp.vehicle.spec.vehicle_spec import RigidPart, SpecError
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.physics.sample_vehicles import shipped

MASSES = (80.0, 400.0, 800.0)
PLACES = ((0.0, 0.0, 0.5), (-1.0, 0.4, 0.6), (0.8, -0.3, 0.9))
SCRIPT = ScriptSpec(steering=((0.0, 0.0), (1.0, 0.0), (1.2, 0.25)), speed=((0.0, 10.0),))


class Loaded:
    """Worlds with one load each, or with none where it is part of the description."""

    def __init__(self, spec: Any, worlds: int, *, load: bool = True, names: tuple[str, ...] = PAYLOAD) -> None:
        builder = ModelBuilder()
        self.parts = add_vehicle(builder, spec, speed=10.0)
        self.load: Any = add_payload(builder, self.parts, mass=100.0) if load else None
        self.model = builder.finalize(worlds, "cpu", per_world=per_world(names))
        self.vehicle = Vehicle(self.parts, self.model)
        driver = ScriptedDriver(self.vehicle, SCRIPT)
        self.sim = sw.Simulation(self.model, 1.0e-3, elements=[driver, self.vehicle], solver=VEHICLE_SOLVER)

    def reference(self, world: int) -> np.ndarray:
        """Of the vehicle's frame [m]."""
        q = self.sim.state.body_rot.numpy()[world, self.parts.chassis]
        arm = np.array(self.parts.reference)
        vector, w = q[:3], q[3]
        arm = arm + 2.0 * np.cross(vector, np.cross(vector, arm) + w * arm)
        return self.sim.state.body_x.numpy()[world, self.parts.chassis] + arm


def with_component(spec: Any, mass: float, place: tuple[float, float, float]) -> Any:
    """The same load as a part of the chassis."""
    inertia = np.diag(box_inertia(mass, (1.0, 1.0, 0.5)))
    part = RigidPart(mass=mass, com=place, inertia=tuple(inertia.tolist()))
    chassis = dataclasses.replace(spec.chassis, components=(*spec.chassis.components, part))
    return dataclasses.replace(spec, chassis=chassis)


def test_a_load_drives_like_a_part_of_the_chassis():
    spec = shipped("hmmwv")
    loaded = Loaded(spec, 3)
    set_payload(loaded.sim, loaded.load, mass=MASSES, position=PLACES)
    parts = [Loaded(with_component(spec, m, p), 1, load=False) for m, p in zip(MASSES, PLACES, strict=True)]
    for _ in range(3000):
        loaded.sim.step()
        for part in parts:
            part.sim.step()
    ends = np.array([loaded.reference(world) for world in range(3)])
    expected = np.array([part.reference(0) for part in parts])
    # 30 m in float32; the drag of neither is in play
    assert np.abs(ends - expected).max() < 2.0e-4
    for world, part in enumerate(parts):
        load = part.vehicle.tires.load.numpy()[0]
        assert loaded.vehicle.tires.load.numpy()[world] == pytest.approx(load, rel=2.0e-4)
    # other loads, other runs; the load stays where it was put
    assert np.abs(ends[0] - ends[1]).max() > 0.02
    assert loaded.sim.diagnostics.position_error.numpy().max() < 1.0e-4
    assert loaded.sim.problems() == []


def test_a_chosen_world_alone_is_loaded_and_a_reset_keeps_its_load():
    loaded, other = Loaded(shipped("hmmwv-reduced"), 2), Loaded(shipped("hmmwv-reduced"), 2)
    chosen = np.array([False, True])
    set_payload(loaded.sim, loaded.load, mass=500.0, position=(-1.0, 0.0, 0.8), worlds=chosen)
    start = loaded.sim.state.body_x.numpy().copy()
    for _ in range(500):
        loaded.sim.step()
        other.sim.step()
    run = loaded.sim.state.body_x.numpy().copy()
    assert (run[0] == other.sim.state.body_x.numpy()[0]).all()
    assert np.abs(run[1] - run[0]).max() > 1.0e-2
    loaded.sim.reset(chosen)
    set_payload(loaded.sim, loaded.load, worlds=chosen)
    assert (loaded.sim.state.body_x.numpy()[1] == start[1]).all()
    for _ in range(500):
        loaded.sim.step()
    assert (loaded.sim.state.body_x.numpy()[1] == run[1]).all()


def test_wrong_loads_are_named():
    builder = ModelBuilder()
    parts = add_vehicle(builder, shipped("gator"))
    with pytest.raises(SpecError, match="size: must be three lengths"):
        add_payload(builder, parts, mass=10.0, size=(1.0, 0.0, 0.0))
    with pytest.raises(ModelError, match="mass must be"):
        add_payload(builder, parts, mass=0.0)
    shared = Loaded(shipped("gator"), 2, names=("body_mass",))
    with pytest.raises(ModelError, match="body_inertia_b, joint_anchor0"):
        set_payload(shared.sim, shared.load, mass=10.0)
    good = Loaded(shipped("gator"), 2)
    for wrong, message in (
        ({"mass": -1.0}, "positive.*; leave it out"), ({"position": (0.0, np.nan, 0.0)}, "finite.*; leave it out"),
        ({"mass": [1, 2, 3]}, r"set_payload: mass must be one, or one for each of 2 worlds, got \[1, 2, 3\]; match"),
        ({"position": (1.0, 2.0)}, "position must be three numbers, or three numbers for each of 2 worlds"),
        ({"position": [(1.0, 2.0, 3.0)] * 3}, "position must be"), ({"mass": "heavy"}, "mass must be one"),
        ({"mass": 2.0, "worlds": [True, False, True]}, r"set_payload: worlds must have shape \(2,\).*got \(3,\); give"),
        ({"mass": 2.0, "worlds": [0, 1]}, "set_payload: worlds must be of bool, got int64.*not indices of worlds"),
    ):  # fmt: skip
        with pytest.raises(ModelError, match=message):
            set_payload(good.sim, good.load, **wrong)
