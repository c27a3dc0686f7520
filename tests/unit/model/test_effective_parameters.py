"""Where a parameter acts: entries that are said to do nothing change no bit of a run, and a write that only reaches
them is refused or told; the others change the run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import (
    WORLD,
    Dof,
    Material,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    VelocityMotor,
    pose,
)
from simwarp.model.builder import ModelBuilder
from simwarp.model.effective_parameters import effective_entries
from simwarp.model.model import PARAMETERS

TABLE = ((-1.0, 0.0, 1.0), (-2.0, 0.0, 3.0))
MAP = ((0.0, 1.0), (-1.0, 1.0), ((-1.0, -2.0), (1.0, 2.0)))


def build() -> ModelBuilder:
    """A chain with every law, a closed loop, couplings, and shapes that touch, that may touch, and that never do."""
    builder = ModelBuilder()
    laws: list[dict[str, Any]] = [
        {},
        {"stiffness": 2.0, "rest": 0.1, "damping": 0.1, "preload": 0.2, "armature": 0.1},
        {"friction": 0.05, "limit": (-1e-4, 1e-4)},
        {"spring_table": TABLE, "damper_table": TABLE},
        {"damper_map": MAP, "stiffness": 1.0},
        {"drive": PositionDrive(stiffness=3.0, damping=0.1)},
        {"drive": PositionDrive(stiffness=3.0, damping=0.1, effort_limit=0.5)},
        {"drive": VelocityMotor(effort_limit=0.5)},
        {"drive": PrescribedPosition(table=((0.0, 1.0), (0.0, 0.3))), "stiffness": 1.0, "limit": (-0.5, 0.5)},
        {"drive": PrescribedSpeed(table=((0.0, 1.0), (0.0, 0.3)))},
    ]
    parent = WORLD
    for index, law in enumerate(laws):
        place = (0.3 * index, 0.0, 2.0)
        child = builder.add_body(
            f"b{index}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=pose(place), omega=(0, 0.1 * index, 0)
        )
        axis = (0, 1, 0) if index % 2 else (0, 0.8, 0.6)
        builder.add_joint_revolute(f"j{index}", parent, child, axis=axis, anchor=(0.3 * index - 0.15, 0, 2), **law)
        parent = child
    builder.add_joint_spherical(
        "loop", 5, WORLD, anchor=(1.5, 0, 2.0), dofs=[Dof(damping=0.3), Dof(), Dof(armature=0.1)]
    )
    builder.add_spring("line", 1, WORLD, anchor0=(0.3, 0, 2), anchor1=(0.3, 0.1, 3), stiffness=4.0)
    builder.add_joint_distance("rod", 8, WORLD, anchor0=(2.4, 0, 2), anchor1=(2.4, 1, 2))
    free = builder.add_body(
        "free", mass=0.5, inertia=(0.1, 0.1, 0.1), pose=pose((0, 3, 0.1)), velocity=(1, 0, -1), omega=(0, 0, 5)
    )
    builder.add_joint_free("root", free)
    shafts = [builder.add_shaft(f"s{k}", inertia=0.1, speed=1.0 + k) for k in range(3)]
    builder.add_shaft("braked", inertia=0.1, speed=3.0, drive=VelocityMotor(effort_limit=(-0.4, 0.3)))
    builder.add_coupling("rigid", [(shafts[0], 1.0), (shafts[1], -2.0)])
    builder.add_coupling("viscous", [(shafts[1], 1.0), (shafts[2], -1.0)], damping=0.2)
    builder.add_combination("spring", [(shafts[0], 0.5), (1, 1.0)], stiffness=3.0, rest=0.2, damping=0.1, armature=0.1)
    builder.add_combination("stop", [(shafts[1], 1.0), (3, 1.0)], limit=(-1.0e-4, 1.0e-4), friction=0.05)
    builder.add_combination("free", [(shafts[2], 1.0), (1, 1.0)])
    rolls = Material(rolling_friction=0.01, spinning_friction=0.01, compliance=1e-5, damping=0.01, cohesion=0.1)
    builder.add_shape_plane(WORLD, name="ground", material=rolls)
    builder.add_shape_sphere(free, radius=0.1, name="ball", material=rolls)
    builder.add_shape_box(free, half=(0.05, 0.05, 0.05), name="ghost", group=2, mask=2, pose=pose((0, 0, 0.5)))
    return builder


@pytest.fixture(scope="module")
def model() -> sw.Model:
    return build().finalize(1, "cpu")


@pytest.fixture(scope="module")
def runs(model: sw.Model) -> dict[str, tuple[sw.Simulation, bytes]]:
    """A simulation for each contact model, and how its run ends."""
    made = {}
    for contact_model in ("rigid", "smooth"):
        sim = sw.Simulation(model, 2e-3, solver=sw.SolverOptions(contact_model=contact_model))
        sim.control.joint_target_q[:] = 0.5
        sim.control.joint_target_qd[:] = 0.2
        made[contact_model] = (sim, end(sim))
    return made


def end(sim: sw.Simulation) -> bytes:
    """The state after some steps from the initial one."""
    sim.reset()
    for _ in range(12):
        sim.step()
    assert not sim.state.world_status.numpy().any()
    return b"".join(getattr(sim.state, name).numpy().tobytes() for name in ("body_x", "body_v", "joint_qd"))


def changed(built: np.ndarray, name: str) -> np.ndarray:
    """Other values inside the domain."""
    if name.startswith("joint_limit"):
        nearer = 0.7 if name.endswith("lower") else -0.5
        return np.where(np.abs(built) > 1e29, np.sign(built) * 0.05, built * nearer)
    if name == "shape_x":
        return built + 0.01
    if name.startswith("drive_effort"):  # a finite one where there was none would take the drive away
        return np.where(built > 1e29, built, built * 0.3)
    if name == "shape_rot":
        return np.broadcast_to([0.1, 0.0, 0.0, 0.995], built.shape)
    if name in ("shape_restitution", "shape_poisson_ratio"):
        return built * 0.5 + 0.2
    return built * 1.3 + 0.01 * (np.abs(built) < 1e-12) * (built.ndim < 3 or built.shape[-1] > 9)


def idle(model: sw.Model, name: str, contact_model: str) -> np.ndarray:
    """Entries that do nothing, whatever else is written."""
    return ~effective_entries(model, name, contact_model=contact_model, also=PARAMETERS).entries


SKIPPED = ("shape_asset", "shape_enabled")
"""Whole numbers, which no range draws."""


@pytest.mark.parametrize("contact_model", ["rigid", "smooth"])
@pytest.mark.parametrize("name", [name for name in PARAMETERS if name not in SKIPPED])
def test_entries_act_where_they_are_said_to(model, runs, name, contact_model):
    sim, reference = runs[contact_model]
    array = getattr(model, name)
    built = array.numpy().copy()
    effect = effective_entries(model, name, contact_model=contact_model)
    count = 1 if name == "gravity" else built.shape[1]
    assert effect.entries.shape == (count,)
    other = changed(built, name)
    try:
        for entries, acts in ((~effect.entries, False), (effect.entries, True)):
            if entries.any():
                mask = entries.reshape(1, -1, *(1,) * (built.ndim - 2)) if name != "gravity" else True
                values = np.where(mask, other, built)
                changes = bool((values != built).any())
                array.assign(values)
                assert (end(sim) != reference) is acts, effect
                told = [line for line in sim.problems() if f"{name}: a value for" in line]
                assert bool(told) is (changes and bool(idle(model, name, contact_model)[entries].all())), told
    finally:
        array.assign(built)
    assert end(sim) == reference
    assert effect.rule or effect.entries.all()


@pytest.mark.parametrize("name", [name for name in PARAMETERS if name not in SKIPPED])
def test_a_write_to_what_does_nothing_is_refused(model, name):
    """Entry by entry: those that never act, with no contact model, and only those."""
    array = getattr(model, name)
    built = array.numpy().copy()
    other = changed(built, name)
    never = idle(model, name, "rigid") & idle(model, name, "smooth")
    if name == "gravity":
        assert not never.any()
        return
    for entry, nothing in enumerate(never):
        if (other[:, entry] == built[:, entry]).all():
            continue
        try:
            if nothing:
                with pytest.raises(sw.ModelError, match=f"^model.{name}: a value for .* does nothing: .*; build it so"):
                    array[:, entry] = other[:, entry]
                assert np.array_equal(array.numpy(), built)
            else:
                array[:, entry] = other[:, entry]
        finally:
            array.assign(built)


def test_a_write_that_reaches_others_as_well_is_no_mistake(model):
    """A value for all, and values as built, pass; a slice of what does nothing, and zeros there, do not."""
    array = model.joint_friction
    built = array.numpy().copy()
    acts = effective_entries(model, "joint_friction").entries
    idle, active = int(np.argmin(acts)), int(np.argmax(acts))
    try:
        array[:] = 0.3
        array.fill_(0.2)
        array[0, active] = 0.1
        array[:, idle] = float(built[0, idle])
        for write in (
            lambda: array.__setitem__((slice(None), idle), 0.3),
            lambda: array[0].__setitem__(idle, 0.3),
            lambda: array[:, idle : idle + 1].fill_(0.3),
        ):
            with pytest.raises(sw.ModelError, match=r"model.joint_friction: a value for joint 'j0' does nothing: dry"):
                write()
        with pytest.raises(sw.ModelError, match="finite and >= 0"):
            array[0, active] = -1.0
    finally:
        array.assign(built)


def test_a_world_whose_parameters_do_nothing_is_named():
    """Its own world alone, and not where another entry acts."""
    model = build().finalize(3, "cpu", per_world=("shape_young_modulus", "joint_friction"))
    sim = sw.Simulation(model, 2e-3)
    model.shape_young_modulus[1] = 1e6  # acts with smooth contacts, which these are not
    view = sw.to_torch(model.joint_friction)
    view[2, 0] = 0.5
    view[0] += 0.1  # everywhere, also where it acts
    found = sim.problems()
    assert [line.split(":")[0] for line in found] == ["world 1", "world 2"]
    assert "shape_young_modulus: a value for shape 'ground' does nothing: it acts only with SolverOptions(" in found[0]
    assert "joint_friction: a value for joint 'j0' does nothing: dry friction acts only on coordinates" in found[1]


def test_what_is_changed_beside_it_counts(model):
    """A rest length acts once there is a spring, relaxation once there is compliance."""
    alone = effective_entries(model, "joint_rest").entries
    both = effective_entries(model, "joint_rest", also=("joint_stiffness",)).entries
    assert both.sum() > alone.sum() > 0
    builder = ModelBuilder()
    ball = builder.add_body("ball", mass=1.0, inertia=(1, 1, 1))
    builder.add_shape_sphere(ball, radius=1.0)
    builder.add_shape_plane()
    hard = builder.finalize(1, "cpu")
    assert not effective_entries(hard, "shape_damping").entries.any()
    assert effective_entries(hard, "shape_damping", also=("shape_compliance",)).entries.all()
    assert not effective_entries(hard, "shape_rolling_friction").entries.any()


def test_models_without_parts():
    lone = ModelBuilder()
    lone.add_body("lone", mass=1.0, inertia=(1, 1, 1))
    model = lone.finalize(1, "cpu")
    for name in PARAMETERS:
        effect = effective_entries(model, name)
        assert effect.entries.any() == name.startswith(("gravity", "body_"))
        assert effect.rule or effect.entries.any()
