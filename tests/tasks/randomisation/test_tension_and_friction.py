"""Tension of tracks and friction of the ground, drawn for each world: they act, and worlds stay apart."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

from simwarp.tasks import Range, TaskConfig, make
from simwarp.vehicle import TRACK_SOLVER, add_tracked_vehicle, load_tracked_vehicle
from simwarp.vehicle.tracks.belt_tables_kernels import BeltParameter
from tests.tasks.randomisation.idle_task import IdleTask
from tests.unit.vehicle.tracks.undriven_vehicles import undriven

TENSIONERS = ("left.tensioner", "right.tensioner")
RANGES = {
    "joint_preload": Range(0.7, 1.3, only=TENSIONERS, shared=True),
    "shape_friction": Range(0.1, 0.9, mode="set", only="ground"),
}
FLAT: dict[str, Any] = {"hills": 0.0, "obstacles": 0, "low_rocks": 0, "obs": "state"}


class Tracks(IdleTask):
    """The M113 shoe by shoe, without an engine, that is dropped onto the ground while its chains tighten."""

    name = "tracks-with-drawn-tension"

    def build(self, builder):
        self.parts = add_tracked_vehicle(builder, undriven(load_tracked_vehicle("m113")))
        builder.add_shape_plane(name="ground")

    def solver_options(self):
        return dataclasses.replace(TRACK_SOLVER, max_iterations=10)


def tracks(worlds, **options):
    return Tracks(TaskConfig(dt=0.001, decimation=30, randomise=RANGES), worlds, seed=5, **options)


def forces(task):
    """(W, 2) that tensioners give, as kernels have it."""
    model, state = task.simulation.model, task.simulation.state
    dofs = [model.joint_dof_start[side.tensioner] for side in task.parts.chains]
    preload, stiffness, damping = (
        getattr(model, f"joint_{name}").numpy()[:, dofs] for name in ("preload", "stiffness", "damping")
    )
    return preload - stiffness * state.joint_q.numpy()[:, dofs] - damping * state.joint_qd.numpy()[:, dofs]


def test_chains_differ_by_world_and_are_as_if_alone():
    task = tracks(4)
    built = undriven(load_tracked_vehicle("m113")).left.idler.tensioner.force
    names = task.simulation.model.joint_names
    start = [task.simulation.model.joint_dof_start[names.index(name)] for name in TENSIONERS]
    drawn = np.abs(task.simulation.model.joint_preload.numpy()[:, start]) / built
    np.testing.assert_allclose(drawn[:, 0], drawn[:, 1], rtol=1e-6)  # shared
    assert ((drawn > 0.7) & (drawn < 1.3)).all()
    assert np.ptp(drawn[:, 0]) > 0.1
    friction = task.simulation.model.shape_friction.numpy()[:, task.simulation.model.shape_names.index("ground")]
    assert len(set(friction.tolist())) == 4
    task.step(torch.zeros(4, 1))
    order = np.argsort(drawn[:, 0])
    assert (np.diff(np.abs(forces(task))[order], axis=0) > 0.0).all(), "the more force, the more tension"
    found = task.simulation.state.body_x.numpy()
    for world in range(4):
        alone = tracks(1, first_world=world)
        alone.step(torch.zeros(1, 1))
        np.testing.assert_array_equal(alone.simulation.state.body_x.numpy()[0], found[world])


def test_belts_and_their_ground_differ_by_world_and_are_as_if_alone():
    options: dict[str, Any] = {"friction": (0.3, 0.9), "tension": (0.7, 1.3), **FLAT}
    task: Any = make("tracked-off-road", 3, seed=5, **options)
    task.restart()
    friction = task.vehicle.belts.ground_friction.numpy().copy()
    assert len(set(friction.tolist())) == 3
    assert ((friction > 0.3) & (friction < 0.9)).all()
    built = load_tracked_vehicle("m113").left.idler.tensioner.force
    drawn = np.abs(task.vehicle.belts.parameter.numpy()[:, :, BeltParameter.TENSIONER_FORCE]) / built
    assert ((drawn > 0.7) & (drawn < 1.3)).all()
    np.testing.assert_allclose(drawn[:, 0], drawn[:, 1], rtol=1e-6)  # one number for both tracks
    action = torch.tensor([[1.0, 1.0]])
    for _ in range(5):
        task.step(action.expand(3, 2))
    found, tension = task.simulation.state.body_x.numpy(), task.vehicle.tension.numpy()
    assert len({x.tobytes() for x in found}) == 3
    assert (np.diff(tension[np.argsort(drawn[:, 0])], axis=0) > 0.0).all(), "the more force, the more tension"
    for world in range(3):
        alone: Any = make("tracked-off-road", 1, seed=5, first_world=world, **options)
        alone.restart()
        assert alone.vehicle.belts.ground_friction.numpy()[0] == friction[world]
        for _ in range(5):
            alone.step(action)
        np.testing.assert_array_equal(alone.simulation.state.body_x.numpy()[0], found[world])
        np.testing.assert_array_equal(alone.vehicle.tension.numpy()[0], tension[world])


@pytest.mark.slow
def test_tensioners_of_chains_are_drawn_for_the_task_too():
    shoes: dict[str, Any] = {"full": True, "dt": 0.001, "decimation": 200}
    task: Any = make("tracked-off-road", 2, seed=5, tension=(0.7, 1.3), friction=(0.3, 0.9), **shoes, **FLAT)
    task.restart(seed=5)
    model, built = task.simulation.model, load_tracked_vehicle("m113").left.idler.tensioner.force
    dofs = [model.joint_dof_start[side.tensioner] for side in task.vehicle.parts.chains]
    drawn = np.abs(model.joint_preload.numpy()[:, dofs]) / built
    assert ((drawn > 0.7) & (drawn < 1.3)).all()
    assert abs(drawn[1, 0] - drawn[0, 0]) > 0.02
    friction = task.ground_friction().numpy()
    assert 0.3 < friction.min() < friction.max() < 0.9
    task.step(torch.zeros(2, 2))
    tension = task.vehicle.tension.numpy()[np.argsort(drawn[:, 0])]
    assert (np.diff(tension, axis=0) > 0.0).all()
    task.restart(seed=5)
    np.testing.assert_array_equal(np.abs(model.joint_preload.numpy()[:, dofs]) / built, drawn)
