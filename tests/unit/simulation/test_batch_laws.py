"""Laws of a batch, bit by bit: worlds do not see each other, a run repeats itself, sub-steps are steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import WORLD, Dof, Material, PositionDrive, PrescribedPosition, VelocityMotor, WorldStatus, pose
from simwarp.kernels.dynamics.world import Scratch
from simwarp.meshes.lattices import rectangle_of_triangles
from simwarp.meshes.materials import Elastic
from simwarp.model.builder import ModelBuilder
from simwarp.model.keyword_argument_types import DofOptions
from simwarp.model.model import PARAMETERS
from simwarp.simulation.state import State
from tests.reference.mechanisms import random_mechanism

WORLDS = 5
SCRATCH: Any = Scratch  # a struct of Warp: the decorator gives it `vars`
STEPS = 12


def busy() -> ModelBuilder:
    """Loops, couplings, a shaft, limits, friction, motors and springs in one mechanism."""
    return random_mechanism(0, bounds=True, couplings=True)


def arm_with_everything() -> ModelBuilder:
    """No loop: limits that are reached, friction, a motor, a bounded drive, a table, a motion."""
    builder = ModelBuilder()
    bodies = [builder.add_body(f"b{k}", mass=1.0 + k, inertia=(0.1, 0.1, 0.05), pose=pose((0.4 * k, 0, 0.1)))
              for k in range(5)]  # fmt: skip
    options: list[dict[str, Any]] = [
        {"limit": (-0.02, 0.02), "friction": 0.5},
        {"drive": VelocityMotor(effort_limit=(-3.0, 5.0))},
        {"drive": PositionDrive(stiffness=200.0, damping=3.0, effort_limit=8.0), "limit": (-0.01, 0.3)},
        {"spring_table": ((-1.0, 0.0, 1.0), (-20.0, 0.0, 60.0)), "damping": 0.2},
        {"drive": PrescribedPosition()},
    ]
    for k, option in enumerate(options):
        builder.add_joint_revolute(
            f"j{k}", WORLD if k == 0 else bodies[k - 1], bodies[k], axis=(0, 1, 0.2 * k), **option
        )
    return builder


def tendons() -> ModelBuilder:
    """The arm with sums of its angles: one with a law, one with bounds alone, one that only takes a force."""
    builder = arm_with_everything()
    builder.add_combination("spring", [(0, 1.0), (1, -0.5), (3, 2.0)], stiffness=30.0, damping=0.4, friction=0.2)
    builder.add_combination("stop", [(1, 1.0), (2, 1.0), (4, 0.3)], limit=(-0.01, 0.005))
    builder.add_combination("force", [(2, -1.0), (3, 0.7)])
    return builder


MODELS: dict[str, Callable[[], ModelBuilder]] = {
    "busy": busy, "arm": arm_with_everything, "tendons": tendons, "four_bar": scenes.four_bar,
    "linkage": scenes.linkage,
}  # fmt: skip


def simulation(builder: ModelBuilder, worlds: int = WORLDS, **options: Any) -> sw.Simulation:
    return sw.Simulation(
        builder.finalize(worlds, "cpu"), 2e-3, joint_reactions=True, joint_accelerations=True, **options
    )


def drive(sim: sw.Simulation, step: int, worlds: int | None = None) -> None:
    """Inputs that differ by world and step, but not by the number of worlds."""
    count = sim.model.world_count
    rng = np.random.default_rng(step)
    for name, size in (("joint_force", 1.0), ("joint_target_q", 0.01), ("joint_target_qd", 0.5)):
        values = rng.normal(size=(32, sim.model.dof_count)).astype(np.float32)[:count] * np.float32(size)
        getattr(sim.control, name).assign(values)
    sim.control.body_force.assign(rng.normal(size=(32, sim.model.body_count, 3)).astype(np.float32)[:count])


def everything(sim: sw.Simulation) -> dict[str, np.ndarray]:
    """All arrays of the state and the diagnostics, as bytes."""
    arrays = {name: getattr(sim.state, name) for name in State.NAMES}
    arrays |= {f"report {name}": getattr(sim.diagnostics, name) for name in sim.diagnostics.NAMES}
    return {name: array.numpy().copy() for name, array in arrays.items()}


def assert_same_bits(a: dict[str, np.ndarray], b: dict[str, np.ndarray], worlds: list[int] | None = None) -> None:
    for name, values in a.items():
        left, right = (values, b[name]) if worlds is None else (values[worlds], b[name][worlds])
        # as bytes: NaN equals itself, and -0 is not +0
        assert left.tobytes() == right.tobytes(), f"{name} differs"


def run(sim: sw.Simulation, steps: int = STEPS, start: int = 0) -> None:
    for step in range(start, start + steps):
        drive(sim, step)
        sim.step()


# ---- worlds do not see each other -----------------------------------------------------------------------------------


def perturb_state(sim: sw.Simulation) -> None:
    omega = sim.state.body_omega.numpy()
    omega[3] += 1.0
    sim.state.body_omega.assign(omega)


def perturb_force(sim: sw.Simulation) -> None:
    force = sim.control.joint_force.numpy()
    force[3] += 100.0
    sim.control.joint_force.assign(force)


def reset_three(sim: sw.Simulation) -> None:
    sim.reset([False, False, False, True, False])


def set_three(sim: sw.Simulation) -> None:
    q = np.full((WORLDS, sim.model.dof_count), 1e-3, np.float32)
    sim.set_joint_state([False, False, False, True, False], q, q)


def break_three(sim: sw.Simulation) -> None:
    v = sim.state.body_v.numpy()
    v[3, 0] = np.nan
    sim.state.body_v.assign(v)


def explode_three(sim: sw.Simulation) -> None:
    force = sim.control.joint_force.numpy()
    force[3] = np.inf
    sim.control.joint_force.assign(force)


EVENTS = (perturb_state, perturb_force, reset_three, set_three, break_three, explode_three)


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.sweep
def test_one_world_leaves_the_others_alone(model, event):
    plain, touched = simulation(MODELS[model]()), simulation(MODELS[model]())
    run(plain, 4)
    run(touched, 4)
    drive(plain, 4)
    drive(touched, 4)
    event(touched)
    plain.step()
    touched.step()
    run(plain, STEPS, start=5)
    run(touched, STEPS, start=5)
    a, b = everything(plain), everything(touched)
    assert_same_bits(a, b, [0, 1, 2, 4])
    assert a["body_v"][3].tobytes() != b["body_v"][3].tobytes()  # the event did happen


# ---- frozen worlds --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("array", ["body_v", "body_omega", "body_x", "body_rot"])
@pytest.mark.sweep
def test_a_non_finite_world_is_flagged_frozen_and_reset(model, array):
    sim = simulation(MODELS[model]())
    run(sim, 3)
    values = getattr(sim.state, array).numpy()
    values[1, -1] = np.nan
    getattr(sim.state, array).assign(values)
    kept = everything(sim)
    run(sim, 1)
    status = sim.state.world_status.numpy()
    assert status.tolist() == [0, WorldStatus.NON_FINITE, 0, 0, 0]
    frozen = everything(sim)
    run(sim, 2)
    now = everything(sim)
    for name in State.NAMES:
        assert now[name][1].tobytes() == frozen[name][1].tobytes(), f"{name} of a frozen world moved"
        if name not in ("world_status", "box_impulse"):
            assert now[name][1].tobytes() == kept[name][1].tobytes(), f"{name} was written with garbage"
    sim.reset([False, True, False, False, False])
    assert sim.state.world_status.numpy()[1] == 0
    assert np.isfinite(sim.state.body_x.numpy()).all()
    fresh = simulation(MODELS[model]())
    for each in (sim, fresh):
        run(each, 3, start=20)
    a, b = everything(sim), everything(fresh)
    for name in State.NAMES:
        assert a[name][1].tobytes() == b[name][1].tobytes(), f"{name}: a reset world is not like a new one"


@pytest.mark.parametrize("array", ["body_v", "body_omega", "body_x", "body_rot"])
def test_a_free_body_that_is_nan_is_flagged_too(array):
    sim = sw.Simulation(scenes.dzhanibekov().finalize(2, "cpu"), 1e-3)
    values = getattr(sim.state, array).numpy()
    values[0] = np.nan
    getattr(sim.state, array).assign(values)
    sim.step()
    assert sim.state.world_status.numpy().tolist() == [WorldStatus.NON_FINITE, 0]


def test_a_frozen_world_stops_its_clock():
    sim = sw.Simulation(scenes.pendulum().finalize(2, "cpu"), 0.25)
    sim.control.joint_force.assign([[np.nan], [0.0]])
    for _ in range(3):
        sim.step()
    np.testing.assert_array_equal(sim.time.numpy(), [0.0, 0.75])


# ---- repetition -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_a_world_writes_all_that_it_reads_in_the_scratch(model):
    """Worlds share a scratch in turn: whatever another world left there, NaN included, must not come through."""
    plain, poisoned = simulation(MODELS[model]()), simulation(MODELS[model]())
    scratch = poisoned._scratch
    q = np.full((WORLDS, plain.model.dof_count), 1e-3, np.float32)
    calls = [
        lambda sim: sim.step(), lambda sim: sim.set_joint_state(None, q, q), lambda sim: sim.measure(),
        lambda sim: sim.step(),
    ]  # fmt: skip
    for step, call in enumerate(calls):
        for sim in (plain, poisoned):
            drive(sim, step)
        for name in SCRATCH.vars:
            poison(getattr(scratch, name))
        call(plain)
        call(poisoned)
        assert_same_bits(everything(plain), everything(poisoned))


def poison(array: wp.array) -> None:
    """NaN in every float, a huge number in every integer."""
    values = array.numpy()
    values[...] = 2**30 if values.dtype.kind == "i" else np.nan
    array.assign(values)


@pytest.mark.parametrize("model", MODELS)
def test_the_same_run_twice(model):
    results = []
    for _ in range(2):
        sim = simulation(MODELS[model]())
        run(sim)
        results.append(everything(sim))
    assert_same_bits(results[0], results[1])


@pytest.mark.parametrize("model", MODELS)
def test_one_two_and_seventeen_worlds_agree(model):
    sims = [simulation(MODELS[model](), worlds) for worlds in (1, 2, 17)]
    for sim in sims:
        run(sim)
    one, two, many = (everything(sim) for sim in sims)
    assert_same_bits(one, many, [0])
    assert_same_bits(two, many, [0, 1])
    assert many["body_v"][0].tobytes() != many["body_v"][16].tobytes()  # they were driven differently


@pytest.mark.parametrize("model", MODELS)
def test_snapshot_restore_step_equals_step(model):
    sim = simulation(MODELS[model]())
    run(sim, 5)
    drive(sim, 5)
    saved = sim.snapshot()
    for _ in range(6):
        sim.step()
    first = everything(sim)
    run(sim, 3, start=50)
    sim.reset()
    arrays = {name: getattr(sim.state, name) for name in State.NAMES}
    sim.restore(saved)
    assert all(getattr(sim.state, name) is array for name, array in arrays.items())  # in place
    for _ in range(6):
        sim.step()
    assert_same_bits(first, everything(sim))


def test_a_snapshot_is_a_copy():
    sim = simulation(arm_with_everything())
    saved = sim.snapshot()
    before = saved.state.body_x.numpy().copy()
    run(sim, 3)
    np.testing.assert_array_equal(saved.state.body_x.numpy(), before)
    sim.restore(saved)
    run(sim, 3)
    np.testing.assert_array_equal(saved.state.body_x.numpy(), before)


@pytest.mark.parametrize("model", MODELS)
def test_four_sub_steps_are_four_steps(model):
    whole = simulation(MODELS[model](), substeps=4)
    parts = sw.Simulation(
        MODELS[model]().finalize(WORLDS, "cpu"), 2e-3 / 4, joint_reactions=True, joint_accelerations=True
    )
    for step in range(5):
        for sim in (whole, parts):
            drive(sim, step)
        whole.step()
        for _ in range(4):
            parts.step()
    assert_same_bits(everything(whole), everything(parts))


@pytest.mark.parametrize("model", MODELS)
def test_reset_is_the_beginning(model):
    sim, fresh = simulation(MODELS[model]()), simulation(MODELS[model]())
    run(sim, 6)
    sim.reset()
    state = {name: getattr(sim.state, name).numpy().tobytes() for name in State.NAMES}
    assert state == {name: getattr(fresh.state, name).numpy().tobytes() for name in State.NAMES}
    run(sim, 4)
    run(fresh, 4)
    assert_same_bits(everything(sim), everything(fresh))


# ---- parameters per world --------------------------------------------------------------------------------------------


def randomise(model: sw.Model, seed: int = 0) -> dict[str, np.ndarray]:
    """Every per-world parameter drawn anew around its value; returns what was written."""
    rng = np.random.default_rng(seed)
    written = {}
    for name in PARAMETERS:
        values = getattr(model, name).numpy()
        if name == "body_inertia_b":
            factor = rng.uniform(0.7, 1.4, (*values.shape[:2], 1, 1))
            values = values * factor
        elif name in ("joint_frame0", "joint_frame1"):
            pass  # frames stay rotations
        elif name in ("joint_limit_lower", "joint_limit_upper", "drive_effort_limit", "drive_effort_lower"):
            values = np.where(np.abs(values) < 1e29, values * rng.uniform(0.5, 1.5, values.shape), values)
        elif name.startswith(("joint_anchor", "joint_offset", "coupling_offset")):
            values = values + 1e-4 * rng.normal(size=values.shape)
        else:
            values = values * rng.uniform(0.7, 1.4, values.shape)
        getattr(model, name).assign(values)
        written[name] = getattr(model, name).numpy()
    return written


@pytest.mark.parametrize("model", MODELS)
def test_a_world_with_its_own_parameters_equals_a_model_of_its_own(model):
    builder = MODELS[model]()
    many = builder.finalize(3, "cpu", per_world=PARAMETERS)
    written = randomise(many)
    sim = sw.Simulation(many, 2e-3, joint_reactions=True, joint_accelerations=True)
    singles = []
    for world in range(3):
        alone = builder.finalize(1, "cpu")
        for name, values in written.items():
            getattr(alone, name).assign(values[world : world + 1])
        singles.append(sw.Simulation(alone, 2e-3, joint_reactions=True, joint_accelerations=True))
    for step in range(6):
        rng = np.random.default_rng(step)
        force = rng.normal(size=many.dof_count).astype(np.float32)
        sim.control.joint_force.assign(np.tile(force, (3, 1)))
        sim.step()
        for single in singles:
            single.control.joint_force.assign(force[None])
            single.step()
    whole = everything(sim)
    for world, single in enumerate(singles):
        lonely = everything(single)
        for name, values in whole.items():
            assert values[world].tobytes() == lonely[name][0].tobytes(), f"world {world}: {name} differs"
    assert whole["body_v"][0].tobytes() != whole["body_v"][1].tobytes()


@pytest.mark.parametrize("name", [name for name in PARAMETERS if name.startswith("shape_")])
def test_every_shape_parameter_acts_in_its_world_only(name):
    """As below, for what only contacts see."""
    builder = contact_probe()
    model = builder.finalize(3, "cpu", per_world=[name])
    assert getattr(model, name).shape[0] == 3
    contact_model = "smooth" if name in ("shape_young_modulus", "shape_poisson_ratio") else "rigid"
    solver = sw.SolverOptions(contact_model=contact_model)
    sims = [sw.Simulation(made, 2e-3, solver=solver) for made in (builder.finalize(3, "cpu"), model)]
    array = getattr(model, name)
    values = array.numpy()
    if name == "shape_rot":
        values[1] = (0.0, np.sin(0.01), 0.0, np.cos(0.01))
    elif name == "shape_enabled":
        values[1, 1] = 0
    elif name == "shape_asset":
        values[1] = np.where(values[1] == 0, 1, values[1])
    else:
        values[1] = values[1] * 1.3 + 0.001
    array.assign(values)
    for sim in sims:
        for _ in range(4):
            sim.step()
    a, b = (np.concatenate([sim.state.body_v.numpy(), sim.state.body_omega.numpy()], axis=1) for sim in sims)
    np.testing.assert_array_equal(a[[0, 2]], b[[0, 2]])
    assert np.any(a[1] != b[1]), f"{name} has no effect"


@pytest.mark.parametrize("name", [name for name in PARAMETERS if not name.startswith("shape_")])
@pytest.mark.sweep
def test_every_parameter_acts_in_its_world_only(name):
    """Changing one parameter of world 1 changes world 1, and nothing else: the array is really read per world."""
    builder = sheet_probe() if name.startswith("flexible_") else parameter_probe()
    model = builder.finalize(3, "cpu", per_world=[name])
    assert getattr(model, name).shape[0] == 3
    sims = [sw.Simulation(builder.finalize(3, "cpu"), 2e-3), sw.Simulation(model, 2e-3)]
    array = getattr(model, name)
    values = array.numpy()
    if name in ("joint_frame0", "joint_frame1"):
        c, s = np.cos(0.02), np.sin(0.02)
        values[1] = values[1] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    else:
        values[1] = values[1] * 1.3 + 0.01 * (np.abs(values[1]) < 1e29)
    array.assign(values)
    for sim in sims:
        for _ in range(4):
            sim.step()
    a, b = (sim.state.joint_qd.numpy() for sim in sims)
    np.testing.assert_array_equal(a[[0, 2]], b[[0, 2]])
    assert np.any(a[1] != b[1]), f"{name} has no effect"


def sheet_probe() -> ModelBuilder:
    """A hinged body with a sheet glued to it, bent by pressure and its own weight."""
    builder = ModelBuilder(gravity=(1.0, 0.5, -9.0))
    arm = builder.add_body("arm", mass=0.1, inertia=(1e-3, 2e-3, 1e-3), pose=pose((0.3, 0, 0)))
    builder.add_joint_revolute("hinge", WORLD, arm, axis=(0, 1, 0), anchor=(0, 0, 0))
    points, triangles = rectangle_of_triangles((2, 2), (0.2, 0.2))
    builder.add_shell(
        "sheet", points, triangles, thickness=0.01, material=Elastic(young=1e6, density=500.0, damping_time=1e-2),
        glue={arm: np.flatnonzero(points[:, 0] < 0.15)}, pressure=200.0, pose=pose((0.3, -0.1, 0.0)),
        omega=(0.0, 3.0, 0.0),
    )  # fmt: skip
    return builder


def parameter_probe() -> ModelBuilder:
    """A model on which every parameter of `PARAMETERS` has an effect within a few steps."""
    builder = ModelBuilder(gravity=(1.0, 0.5, -9.0))
    a = builder.add_body("a", mass=1.0, inertia=(0.1, 0.2, 0.15), pose=pose((0.3, 0, 0)))
    b = builder.add_body("b", mass=2.0, inertia=(0.1, 0.2, 0.15), pose=pose((0.3, 0.4, 0)))
    law: DofOptions = {
        "armature": 0.05,
        "stiffness": 30.0,
        "rest": 0.1,
        "damping": 0.8,
        "preload": 0.6,
        "friction": 0.2,
        "limit": (0.002, 0.02),
    }
    first = builder.add_joint_revolute("first", WORLD, a, axis=(0, 1, 0), anchor=(0, 0, 0), **law)
    builder.add_joint_revolute(
        "second", a, b, axis=(1, 0.2, 0), anchor=(0.3, 0.2, 0), limit=(-0.02, -0.01),
        drive=PositionDrive(stiffness=500.0, damping=9.0, effort_limit=1.0),
    )  # fmt: skip
    shaft = builder.add_shaft("shaft", inertia=0.03, drive=PositionDrive(stiffness=50.0, damping=2.0))
    builder.add_gear("gear", first, shaft, ratio=1.5)
    builder.add_shaft("braked", inertia=0.03, speed=1.0, drive=VelocityMotor(effort_limit=(-0.5, 0.8)))
    builder.add_shaft("driven", inertia=0.03, speed=-1.0, drive=VelocityMotor(effort_limit=(-0.5, 0.8)))
    builder.add_joint_distance("rod", WORLD, b, anchor0=(0.3, 0.4, 1.0), anchor1=(0.35, 0.45, 0.1))
    return builder


def contact_probe() -> ModelBuilder:
    """A model on which every parameter of shapes has an effect within a few steps."""
    surface = Material(
        friction=0.4, rolling_friction=0.01, spinning_friction=0.01, restitution=0.5, cohesion=2.0, compliance=1e-5,
        damping=1e-3,
    )  # fmt: skip
    builder = ModelBuilder()
    builder.add_shape_plane(WORLD, material=surface)
    builder.add_solid(
        "rolling", "sphere", 0.1, mass=1.0, pose=pose((0, 0, 0.09999)), velocity=(1.0, 0.0, 0.0),
        omega=(0.0, 4.0, 9.0), material=surface,
    )  # fmt: skip
    builder.add_solid(
        "falling", "sphere", 0.1, mass=1.0, pose=pose((1, 0, 0.101)), velocity=(0.0, 0.0, -2.0), material=surface
    )
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for index, half in enumerate((0.1, 0.11)):
        builder.add_solid(
            f"block{index}", "hull", points=half * corners, mass=1.0, pose=pose((2 + index, 0, half - 1e-4)),
            velocity=(0.5, 0.0, 0.0), material=surface,
        )  # fmt: skip
    return builder


def test_dof_is_frozen():
    """A Dof shared by several joints cannot be changed behind the builder's back."""
    dof: Any = Dof()
    with pytest.raises(AttributeError):
        dof.stiffness = 3.0
