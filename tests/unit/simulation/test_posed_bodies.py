"""Bodies that a force element poses: a step does not know them, and whoever looks sees them where they are."""

# The kernel is Warp's language, as those in simwarp/kernels.
# mypy: disable-error-code="index, operator, assignment"

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors import Mount, Schedule, load_config, make_sensor


@wp.kernel(enable_backward=False)
def follow(worlds: WorldRange, mask: wp.array[wp.bool], leader: int, marker: int, state: StateArrays):
    """Puts the marker a metre above the leader, and lets it move alike."""
    world = worlds.first + wp.tid()
    if mask[world]:
        above = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        state.body_x[world, marker] = state.body_x[world, leader] + above
        state.body_rot[world, marker] = state.body_rot[world, leader]
        state.body_v[world, marker] = state.body_v[world, leader]
        state.body_omega[world, marker] = state.body_omega[world, leader]
        state.body_v_low[world, marker] = state.body_v_low[world, leader]
        state.body_omega_low[world, marker] = state.body_omega_low[world, leader]


class Follower(sw.ForceElement):
    """Poses body 1 above body 0, when it is seen or in every sub-step."""

    def __init__(self, in_steps: bool = False) -> None:
        self.in_steps = in_steps

    def record_outputs(self, simulation: sw.StepContext, mask: wp.array) -> Sequence[Any]:
        return [simulation.shares.record(follow, inputs=[mask, 0, 1], outputs=[simulation.state.arrays])]

    def _following(self, simulation: sw.StepContext) -> Sequence[Any]:
        model = simulation.model
        return self.record_outputs(simulation, wp.full(model.world_count, True, dtype=wp.bool, device=model.device))

    def record_after(self, simulation: sw.StepContext, dt: float) -> Sequence[Any]:
        return self._following(simulation) if self.in_steps else ()

    def record_shown(self, simulation: sw.StepContext) -> Sequence[Any]:
        return () if self.in_steps else self._following(simulation)


def followed(worlds: int = 1) -> sw.Model:
    """A ball that is thrown, and a marker."""
    builder = sw.ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(0.1, 0.2, 0.25), velocity=(1.0, 0.5, 2.0), omega=(0.3, 2.0, 0.1))
    builder.add_massless_body("marker", posed=True)
    return builder.finalize(worlds, "cpu")


def bits(sim: sw.Simulation, bodies: slice | list[int] = slice(None)) -> list[bytes]:
    names = ("body_x", "body_rot", "body_v", "body_omega")
    return [np.ascontiguousarray(getattr(sim.state, name).numpy()[:, bodies]).tobytes() for name in names]


def test_a_step_does_not_know_a_posed_body():
    plain, marked = scenes.ant(), scenes.ant()
    marker = marked.add_massless_body("marker", pose=sw.pose((0.0, 0.0, 9.0)), posed=True)
    sims = [sw.Simulation(builder.finalize(2, "cpu"), 5e-3) for builder in (plain, marked)]
    force = np.zeros((*sims[1].control.body_force.shape, 3), np.float32)
    force[:, marker] = 1e3
    sims[1].control.body_force.assign(force)
    for sim in sims:
        sim.step(40)
    others = list(range(marker))
    assert bits(sims[0], others) == bits(sims[1], others)
    assert sims[0].measure_energy().numpy().tobytes() == sims[1].measure_energy().numpy().tobytes()
    assert sims[1].state.body_x.numpy()[:, marker].tolist() == [[0.0, 0.0, 9.0]] * 2
    assert not sims[1].state.body_v.numpy()[:, marker].any()
    assert sims[0].model.tables.links == sims[1].model.tables.links


def test_what_is_shown_is_that_of_the_last_step_however_many_were_run():
    sims = [sw.Simulation(followed(2), 1e-2, substeps=2, elements=[Follower(k == 2)]) for k in range(3)]
    sims[0].step(6)
    for _ in range(6):
        sims[1].step()
    sims[2].step(6)
    assert bits(sims[0]) == bits(sims[1]) == bits(sims[2])
    x = sims[0].state.body_x.numpy()
    assert x[:, 1] - x[:, 0] == pytest.approx(np.array([[0.0, 0.0, 1.0]] * 2), abs=1e-15)  # of float64 near 1


def test_it_is_shown_once_for_all_steps_of_a_call():
    shown = sw.Simulation(followed(), 1e-2, substeps=2, elements=[Follower()])
    physics = len(shown.physics_commands)
    for steps in (5, 1, 0):
        before = shown.shares.launches
        shown.step(steps)
        assert shown.shares.launches - before == 2 * steps * physics + min(steps, 1)


@pytest.mark.parametrize(("rate", "read_every"), [(500.0, 1), (250.0, 1), (250.0, 8), (125.0, 4)])
def test_sensors_see_it_where_it_is(rate, read_every):
    """A speedometer on the marker measures what one on the ball does, in every frame."""
    schedule = Schedule(rate=rate, window=2e-3, lag=1e-3)
    config = dataclasses.replace(load_config("speedometer"), schedule=schedule)
    found = []
    for body in ("ball", "marker"):
        model = followed(2)
        sensor = make_sensor(config, model, Mount(body))
        sim = sw.Simulation(model, 1e-3, elements=[Follower()], sensors=[sensor], read_every=read_every)
        frames = []
        for _ in range(6):
            sim.step(read_every)
            frames.append(sensor.data.numpy().copy())
        found.append(np.array(frames))
    assert np.ptp(found[0], axis=0).max() > 0.0
    assert found[0].tobytes() == found[1].tobytes()


def with_joint(builder: sw.ModelBuilder, marker: int) -> None:
    builder.add_joint_fixed("weld", 0, marker)


def with_shape(builder: sw.ModelBuilder, marker: int) -> None:
    builder.add_shape_sphere(marker, radius=0.1, name="skin")


@pytest.mark.parametrize(
    ("touch", "told"),
    [
        (with_joint, "joint 'weld': its bodies must be moved by the step, but 'marker' is posed; add it without"),
        (with_shape, "shape 'skin': its bodies must be moved by the step, but 'marker' is posed; add it without"),
    ],
)
def test_nothing_touches_a_posed_body(touch: Callable[[sw.ModelBuilder, int], None], told: str):
    builder = sw.ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(1, 1, 1))
    touch(builder, builder.add_massless_body("marker", posed=True))
    with pytest.raises(sw.ModelError) as caught:
        builder.finalize(1, "cpu")
    assert str(caught.value).startswith(told)


def test_posed_is_yes_or_no():
    with pytest.raises(sw.ModelError, match="body 'marker': posed must be"):
        sw.ModelBuilder().add_massless_body("marker", posed=1)  # type: ignore[arg-type]


def test_a_posed_body_alone_is_no_model_that_moves():
    builder = sw.ModelBuilder()
    builder.add_massless_body("marker", posed=True, pose=sw.pose((1.0, 0.0, 0.0)))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.step(3)
    assert sim.state.body_x.numpy().tolist() == [[[1.0, 0.0, 0.0]]]
    assert sim.problems() == []
