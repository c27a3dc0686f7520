"""Writing parameters, controls and states: what does not fit is told with its name, and nothing is written silently."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import WORLD, Material, PositionDrive, WorldStatus, pose
from simwarp.kernels.core.world_range import WorldRange
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import PARAMETERS

NAN, INF = float("nan"), float("inf")
WORLDS = 3


def build() -> ModelBuilder:
    """One of everything that has parameters: also two hulls and a height field."""
    builder = ModelBuilder()
    for index in range(2):
        builder.add_body(f"b{index}", mass=1.0, inertia=(1, 1, 1), pose=pose((index, 0, 1)))
    drive = PositionDrive(stiffness=1.0, effort_limit=5.0)
    builder.add_joint_revolute("hinge", 0, 1, axis=(0, 1, 0), limit=(-1, 1), friction=0.1, drive=drive)
    shaft = builder.add_shaft("shaft", inertia=1.0)
    builder.add_gear("gear", 0, shaft, ratio=2.0)
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    builder.add_shape_hull(0, corners, name="hull", material=Material(rolling_friction=0.1))
    builder.add_hull_asset(corners * 2.0)
    builder.add_shape_box(1, half=(0.1, 0.1, 0.1), name="box")
    builder.add_shape_height_field(WORLD, np.zeros((3, 3)), size=(4.0, 4.0), name="ground")
    return builder


@pytest.fixture(scope="module")
def own() -> sw.Model:
    return build().finalize(WORLDS, "cpu", per_world=tuple(PARAMETERS))


@pytest.fixture(scope="module")
def sheet() -> sw.Model:
    builder = sw.ModelBuilder()
    stuff = sw.flex.Rubber(young=1e6, density=1e3)
    builder.add_shell("sheet", np.eye(3), [[0, 1, 2]], thickness=0.1, material=stuff)
    return builder.finalize(WORLDS, "cpu", per_world=tuple(PARAMETERS))


@pytest.fixture(scope="module")
def shared() -> sw.Model:
    return build().finalize(WORLDS, "cpu")


@pytest.fixture(scope="module")
def sim(shared: sw.Model) -> sw.Simulation:
    return sw.Simulation(shared, 1e-3)


def refusal(call: Callable[[], object], kind: type[Exception] = sw.ModelError) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(kind) as caught:
            call()
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 400
    return message


def put(array: Any, key: Any, value: Any) -> Callable[[], object]:
    return lambda: array.__setitem__(key, value)


# ---- values ----------------------------------------------------------------------------------------------------------

BELOW: dict[str, float] = {
    name: -1.0 for name, parameter in PARAMETERS.items()
    if parameter.domain is not None and np.max(np.asarray(parameter.domain.least)) >= 0.0
} | {"body_mass": 0.0, "body_inertia_b": 0.0, "shape_asset": -2.0}  # fmt: skip


@pytest.mark.parametrize("name", PARAMETERS)
def test_values_outside_a_parameters_domain_are_refused(own, sheet, name):
    array = getattr(sheet if name.startswith("flexible_") else own, name)
    before = array.numpy().copy()
    wrong = [NAN, INF, -INF, 1e39, "x", None, [None], 1j, 10**400, *([BELOW[name]] if name in BELOW else [])]
    for value in wrong:
        for call in (
            put(array, slice(None), value),
            put(array, 0, value),
            lambda value=value: array.fill_(value),
            lambda value=value: array.assign(np.full(before.shape, value)),
        ):
            assert refusal(call).startswith(f"model.{name}: "), value
    for value in (NAN, *([BELOW[name]] if name in BELOW else [])):
        tensor = torch.full(before.shape, value, dtype=torch.float64)
        if before.dtype.kind == "f":
            refusal(put(array, slice(None), tensor))
            refusal(put(array, slice(None), wp.array(before * 0.0 + value, dtype=array.dtype, device="cpu")))
    np.testing.assert_array_equal(array.numpy(), before)
    array[:] = before  # what is there is inside
    array.assign(before)


def test_a_mass_of_zero_by_any_way(own):
    for value in (0.0, 0, 1e-60, 1e-45, np.float32(0.0), [0.0, 1.0], torch.tensor([1.0, 0.0]), -2.0):
        assert "finite and > 0 in float32, got" in refusal(put(own.body_mass, 1, value))
    refusal(own.body_mass.zero_)
    own.joint_friction.zero_()  # none of it is a friction
    assert (own.body_mass.numpy() > 0.0).all()


def test_one_value_of_many_is_named(own):
    text = refusal(put(own.body_mass, slice(None), [[1.0, 2.0], [1.0, NAN], [1.0, 1.0]]))
    assert text == (
        "model.body_mass: values must be finite and > 0 in float32, got nan; replace or leave out such values"
    )


def test_inertias_may_have_products_but_no_empty_diagonal(own):
    own.body_inertia_b[0, 0] = [[2.0, -0.5, 0.0], [-0.5, 2.0, 0.0], [0.0, 0.0, 2.0]]
    refusal(put(own.body_inertia_b, (0, 0), np.diag([1.0, 0.0, 1.0])))
    refusal(put(own.body_inertia_b, (0, 0), np.full((3, 3), NAN)))
    own.body_inertia_b[0, 0] = np.eye(3)


def test_assets_that_there_are(own):
    """A kernel would read beyond the geometries."""
    own.shape_asset[1, 0] = 1
    own.shape_asset[:, 0] = 0
    for key, value in (((0, 0), 2), ((0, 0), -1), ((slice(None), 2), 1), (slice(None), [[0, -1, 5]] * WORLDS)):
        text = refusal(put(own.shape_asset, key, value))
        assert "model.shape_asset: values must be in 0.." in text or "in -1.." in text
    row = own.shape_asset[0]
    row[0] = 1
    assert own.shape_asset.numpy()[0].tolist() == [1, -1, 0]
    refusal(put(row, 2, 1))
    row[0] = 0


def test_integers_stay_whole(own):
    for value in (0.5, 2**31, 1e10, [1.0, 0.5, 1.0]):
        assert "must be numbers of int32" in refusal(put(own.shape_enabled, 0, value))
    own.shape_enabled[0] = [1.0, 1.0, 1.0]
    own.shape_enabled[0] = True


def test_controls_take_any_finite_number_of_float32(sim):
    sim.control.joint_force[:, 0] = -1e30
    sim.control.body_force[:] = (0.0, 0.0, -1.0)
    for value in (1e39, 10**400, "x", None, [1e39, 0.0, 0.0]):
        assert refusal(put(sim.control.joint_force, slice(None), value)).startswith("control.joint_force: values must")
    sim.control.clear()


# ---- shapes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [
        np.ones((WORLDS, 2)), torch.ones(WORLDS, 2), [[1.0, 1.0]] * WORLDS, np.ones(7),
        wp.zeros((WORLDS, 2), dtype=wp.float32, device="cpu"),
    ],
    ids=["numpy", "torch", "list", "another", "warp"],
)  # fmt: skip
def test_a_shared_parameter_says_how_every_world_gets_its_own(shared, value):
    for call in (put(shared.body_mass, slice(None), value), lambda: shared.body_mass.assign(value)):
        text = refusal(call)
        assert text.startswith("model.body_mass: cannot assign ")
        assert "(1, 2) float32; all worlds share it: finalize(per_world=('body_mass',)) gives each its own" in text


def test_a_world_of_a_shared_parameter(shared):
    text = refusal(put(shared.gravity, 1, (0.0, 0.0, -1.0)), IndexError)
    assert text.startswith("model.gravity of shape (1,): index 1 is outside axis 0 of length 1")
    assert "finalize(per_world=('gravity',))" in text


@pytest.mark.parametrize(
    ("array", "key", "value", "told"),
    [
        ("joint_force", slice(None), np.ones((2, 2)), "values of shape (2, 2) to (3, 2) float32"),
        ("joint_force", (slice(None), 0), torch.ones(2), "a tensor of shape (2,) to (3,) float32"),
        (
            "joint_force",
            slice(None),
            wp.zeros((3, 2), dtype=wp.float64, device="cpu"),
            "a Warp array of (3, 2) float64",
        ),
        ("body_force", slice(None), np.ones((3, 2)), "values of shape (3, 2) to (3, 2) vec3"),
        ("body_torque", 0, [1.0, 2.0], "values of shape (2,) to (2,) vec3"),
    ],
)
def test_controls_name_themselves_and_both_shapes(sim, array, key, value, told):
    text = refusal(put(getattr(sim.control, array), key, value))
    assert text.startswith(f"control.{array}: cannot assign {told}")


def test_assign_wants_a_value_for_each(sim):
    for value in (np.ones(2), torch.ones(3, 1), wp.zeros((1, 2), dtype=wp.float32, device="cpu"), 1.0):
        for array in (sim.control.joint_force, sim.state.joint_q):
            assert "assign needs one for each" in refusal(partial(array.assign, value))
    sim.control.joint_force.assign(torch.zeros(3, 2))
    sim.control.joint_force.assign(wp.zeros((3, 2), dtype=wp.float32, device="cpu"))
    sim.state.body_v.assign(np.zeros((3, 2, 3)))


def test_a_model_without_coordinates_has_nothing_to_write():
    sim = sw.Simulation(scenes.stack(count=1).finalize(1, "cpu"), 1e-3)
    sim.control.joint_force[:] = 1.0
    sim.control.joint_force.assign(np.zeros((1, 0)))
    assert sim.control.joint_force.shape == (1, 0)


# ---- attributes ------------------------------------------------------------------------------------------------------


def test_arrays_are_written_into_not_replaced(sim, shared):
    new = wp.zeros((WORLDS, 2), dtype=wp.float32, device="cpu")
    for owner, names in (
        (shared, PARAMETERS), (sim.state, sim.state.NAMES), (sim.control, sim.control.NAMES),
        (sim.contacts, sim.contacts.NAMES), (sim.diagnostics, sim.diagnostics.NAMES),
    ):  # fmt: skip
        for name in names:
            array = getattr(owner, name)
            for value in (new, np.ones(3), 1.0, None):
                text = refusal(partial(setattr, owner, name, value))
                assert text.startswith(f"{type(owner).__name__}.{name}: cannot be replaced, kernels read")
                assert f"write .{name}" in text
            assert getattr(owner, name) is array


def test_what_is_fixed_at_construction_stays(sim, shared):
    for owner, name in (
        (sim, "dt"), (sim, "substeps"), (sim, "state"), (sim, "control"), (sim, "model"), (sim, "solver"),
        (sim, "sensors"), (shared, "world_count"), (shared, "contact_capacity"), (shared, "topology"),
        (sim.control, "arrays"),
    ):  # fmt: skip
        before = getattr(owner, name)
        text = refusal(partial(setattr, owner, name, 1))
        assert text.startswith(f"{type(owner).__name__}.{name}: cannot be replaced, it is fixed when ")
        assert getattr(owner, name) is before


def test_a_slip_of_the_pen_is_found(sim, shared):
    text = refusal(lambda: setattr(sim.control, "joint_forces", 1.0))
    assert text == "Control.joint_forces: there is no such attribute; did you mean 'joint_force'?"
    assert "did you mean 'body_mass'?" in refusal(lambda: setattr(shared, "body_masses", 1.0))
    assert "keep what is yours elsewhere" in refusal(lambda: setattr(sim.state, "zzz", 1.0))


# ---- coordinates -----------------------------------------------------------------------------------------------------

FORMS: dict[str, Callable[[np.ndarray], Any]] = {
    "list": np.ndarray.tolist, "numpy": lambda v: v, "torch": torch.from_numpy,
    "warp": lambda v: wp.array(v.astype(np.float32), dtype=wp.float32, device="cpu"),
    "warp of doubles": lambda v: wp.array(v, dtype=wp.float64, device="cpu"),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e39])
def test_coordinates_that_are_not_finite(sim, form, value):
    before = sim.state.joint_q.numpy().copy()
    values = np.zeros((WORLDS, 2))
    values[1, 1] = value
    with np.errstate(over="ignore"):
        given = form(values)
    for name, call in (
        ("q", lambda: sim.set_joint_state(None, given, None)),
        ("qd", lambda: sim.set_joint_state([True, True, False], None, given)),
    ):
        text = refusal(call)
        assert text.startswith(f"set_joint_state: {name} must be finite (float32), got ")
        assert "for world 1; leave such worlds out of the mask" in text
    np.testing.assert_array_equal(sim.state.joint_q.numpy(), before)
    sim.set_joint_state([True, False, True], given, given)  # nobody looks at world 1
    assert np.isfinite(sim.state.joint_q.numpy()).all()


@pytest.mark.parametrize(
    "value", ["abc", object(), [[None, 0.0]] * WORLDS, 1j, 10**400, {}, b"12", [["1", "2"]] * WORLDS]
)
def test_coordinates_that_are_no_numbers(sim, value):
    assert refusal(lambda: sim.set_joint_state(None, value, None)).startswith("set_joint_state: q must be ")


@pytest.mark.parametrize("mask", ["abc", 1, [[True], [True, False]], object(), {}, [None] * WORLDS])
def test_masks_that_are_none(sim, mask):
    for name, call in (
        ("reset", lambda: sim.reset(mask)), ("measure", lambda: sim.measure(mask)),
        ("set_joint_state", lambda: sim.set_joint_state(mask, None, None)),
    ):  # fmt: skip
        assert refusal(call).startswith(f"{name}: world_mask must ")


def test_on_a_gpu_such_worlds_are_frozen_instead():
    """The kernel that looks there, launched here on the CPU."""
    from simwarp.kernels.dynamics.world import flag_worlds

    values = np.zeros((4, 2), np.float32)
    values[1, 0], values[2, 1], values[3, 1] = NAN, INF, NAN
    status = wp.zeros(4, dtype=wp.int32, device="cpu")
    mask: wp.array = wp.array([True, True, True, False], dtype=wp.bool, device="cpu")
    given: wp.array = wp.array(values, dtype=wp.float32, device="cpu")
    wp.launch(flag_worlds, dim=4, inputs=[WorldRange(), mask, given, wp.zeros_like(given)], outputs=[status],
              device="cpu")  # fmt: skip
    assert status.numpy().tolist() == [0, WorldStatus.NON_FINITE, WorldStatus.NON_FINITE, 0]


# ---- the simulation's own arguments ----------------------------------------------------------------------------------

DT_WRONG = [0.0, -1.0, NAN, INF, "0.01", True, None, [0.01], 10**400, 1e39, 1e-60, 1e-12, 1e9, 1j, object(), b"1"]
COUNT_WRONG = [0, -1, 1.5, 1.0, NAN, "1", True, None, [1], 10**20, 2**33, 10**400, object()]


@pytest.mark.parametrize("dt", DT_WRONG)
def test_steps_that_are_none(shared, dt):
    assert refusal(lambda: sw.Simulation(shared, dt)).startswith("Simulation: dt ")


@pytest.mark.parametrize("dt", [0.01, 1, np.float32(0.01), np.float64(0.01), np.int64(1), np.array(0.01)])
def test_steps_of_any_kind_of_number(shared, dt):
    sim = sw.Simulation(shared, dt)
    assert sim.dt == float(dt)
    assert type(sim.dt) is float


@pytest.mark.parametrize("count", COUNT_WRONG)
@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("substeps", "(a whole number|at least 1|at most 1000000), got .*; give 1, the default"),
        ("read_every", "an integer >= 1.*, got .*; 1 is the default"),
    ],
)
def test_counts_that_are_none(shared, name, rule, count):
    text = refusal(lambda: sw.Simulation(shared, 0.01, **{name: count}))
    assert re.fullmatch(f"Simulation: {name} must be {rule}", text), text


def test_reads_so_rare_that_clocks_could_not_count_them(shared):
    sw.Simulation(shared, 0.01, read_every=2**31 - 1)
    text = refusal(lambda: sw.Simulation(shared, 0.01, substeps=1000, read_every=2**31 - 1))
    assert text.startswith("Simulation: read_every must be an integer >= 1 and <= 2147483, got 2147483647")


def test_sub_steps_that_float32_cannot_resolve(shared):
    assert "dt / substeps must be in" in refusal(lambda: sw.Simulation(shared, 1e-5, substeps=1_000_000))


@pytest.mark.parametrize("wrong", [None, 3, "model", build(), [], sw.Model])
def test_models_that_are_none(wrong):
    assert refusal(lambda: sw.Simulation(wrong, 0.01)).startswith("Simulation: model must be a Model, got ")


@pytest.mark.parametrize("wrong", [3, "x", {}, None, [None], [3], ["tire"], b"x", [sw.Model]])
def test_elements_that_are_none(shared, wrong):
    assert refusal(lambda: sw.Simulation(shared, 0.01, elements=wrong)).startswith("Simulation: elements must be ")


@pytest.mark.parametrize("wrong", [None, 1, "yes", []])
def test_flags_that_are_none(shared, wrong):
    text = refusal(lambda: sw.Simulation(shared, 0.01, joint_reactions=wrong))
    assert text.startswith("Simulation: joint_reactions must be True or False, got ")
    text = refusal(lambda: sw.Simulation(shared, 0.01, joint_accelerations=wrong))
    assert text.startswith("Simulation: joint_accelerations must be True or False, got ")
