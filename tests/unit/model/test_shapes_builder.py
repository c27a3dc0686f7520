"""What the builder refuses about shapes: every message names the thing, the rule, the value and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.model.rules import ALL_GROUPS

Case = tuple[str, Callable[[sw.ModelBuilder], Any], list[str]]

CASES: list[Case] = [
    ("body", lambda b: b.add_shape_sphere(3, radius=0.1, name="ball"), ["shape 'ball'", "body", "3", "add_body"]),
    ("body_bool", lambda b: b.add_shape_sphere(True, radius=0.1, name="ball"), ["shape 'ball'", "True"]),
    ("body_name", lambda b: b.add_shape_sphere("torso", radius=0.1, name="ball"), ["shape 'ball'", "'torso'"]),  # type: ignore[arg-type]
    ("radius", lambda b: b.add_shape_sphere(0, radius=-0.1, name="ball"), ["shape 'ball'", "size", "-0.1", "m"]),
    ("radius_nan", lambda b: b.add_shape_sphere(0, radius=float("nan"), name="ball"), ["shape 'ball'", "nan"]),
    ("half_zero", lambda b: b.add_shape_box(0, half=(0.1, 0.0, 0.1), name="box"), ["shape 'box'", "size", "0.0"]),
    ("half_two", lambda b: b.add_shape_box(0, half=(0.1, 0.1), name="box"), ["shape 'box'", "3", "(0.1, 0.1)"]),
    ("capsule", lambda b: b.add_shape_capsule(0, radius=0.1, half_length=-1.0, name="c"), ["shape 'c'", "-1.0"]),
    ("option", lambda b: b.add_shape_sphere(0, radius=0.1, name="b", frction=1.0), ["shape 'b'", "frction", "known"]),  # type: ignore[call-arg]
    ("group", lambda b: b.add_shape_sphere(0, radius=0.1, name="b", group=-1), ["shape 'b'", "group", "31", "-1"]),
    ("mask", lambda b: b.add_shape_sphere(0, radius=0.1, name="b", mask=ALL_GROUPS + 1), ["shape 'b'", "mask", "31"]),
    ("margin", lambda b: b.add_shape_sphere(0, radius=0.1, name="b", margin=-0.01), ["shape 'b'", "margin", "-0.01"]),
    ("material", lambda b: b.add_shape_sphere(0, radius=0.1, name="b", material=0.5), ["shape 'b'", "Material", "0.5"]),  # type: ignore[arg-type]
    ("kind", lambda b: b.add_solid("s", "cube", 0.1, mass=1.0), ["solid 's'", "'cube'", "box"]),
    ("capsule_size", lambda b: b.add_solid("s", "capsule", 0.1, mass=1.0), ["radius and half length", "0.1"]),
    ("plane_solid", lambda b: b.add_solid("s", "plane", 0.1, mass=1.0), ["solid 's'", "'plane'", "add_shape"]),
    ("no_mass", lambda b: b.add_solid("s", "box", 0.1), ["solid 's'", "mass or density"]),
    ("two_masses", lambda b: b.add_solid("s", "box", 0.1, mass=1.0, density=2.0), ["solid 's'", "1.0", "2.0"]),
    ("mass", lambda b: b.add_solid("s", "box", 0.1, mass=-1.0), ["solid 's'", "mass", "-1.0"]),
    ("exclude", lambda b: b.exclude_collision(0, 7), ["exclude_collision", "7"]),
    ("friction_rule", lambda b: sw.ModelBuilder(friction_rule="maximum"), ["friction_rule", "min, max", "'maximum'"]),
    ("pair_rule", lambda b: sw.ModelBuilder(pair_rule="eiter"), ["pair_rule", "both, either", "did you mean 'either'"]),
    ("priority", lambda b: b.add_shape_sphere(0, radius=0.1, name="b", material=sw.Material(priority=0.5)),  # type: ignore[arg-type]
     ["shape 'b'", "material.priority", "whole number", "0.5"]),
]  # fmt: skip


def with_body() -> sw.ModelBuilder:
    builder = sw.ModelBuilder()
    builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0))
    return builder


def assert_line(error: pytest.ExceptionInfo[ModelError], parts: list[str]) -> None:
    text = str(error.value)
    assert "\n" not in text
    for part in parts:
        assert part in text, f"{part!r} is missing in: {text}"


@pytest.mark.parametrize("case", CASES, ids=[case[0] for case in CASES])
def test_refused(case: Case) -> None:
    builder = with_body()
    with pytest.raises(ModelError) as error:
        case[1](builder)
    assert_line(error, case[2])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("friction", -0.1), ("rolling_friction", -1.0), ("spinning_friction", float("nan")), ("restitution", 1.1),
        ("restitution", -0.1), ("cohesion", -1.0), ("compliance", -1e-9), ("damping", float("inf")),
        ("poisson_ratio", 0.6), ("young_modulus", -1.0),
    ],
)  # fmt: skip
def test_materials_out_of_range(field: str, value: float) -> None:
    wrong: Any = {field: value}
    with pytest.raises(ModelError) as error:
        with_body().add_shape_sphere(0, radius=0.1, name="ball", material=sw.Material(**wrong))
    assert_line(error, ["shape 'ball'", f"material.{field}", str(value)])


def test_a_name_is_taken_once() -> None:
    builder = with_body()
    builder.add_shape_sphere(0, radius=0.1, name="ball")
    with pytest.raises(ModelError) as error:
        builder.add_shape_box(0, half=(1.0, 1.0, 1.0), name="ball")
    assert_line(error, ["shape 'ball'", "unique", "another"])


@pytest.mark.parametrize("capacity", [0, -1, 2.5, True])
def test_contact_capacity(capacity: Any) -> None:
    with pytest.raises(ModelError) as error:
        with_body().finalize(1, "cpu", contact_capacity=capacity)
    assert_line(error, ["finalize", "contact_capacity", repr(capacity), "None"])


def test_friction_law() -> None:
    with pytest.raises(ModelError) as error:
        sw.Simulation(with_body().finalize(1, "cpu"), 1e-3, solver=sw.SolverOptions(friction_law="coulomb"))
    assert_line(error, ["friction_law", "exact", "convex", "'coulomb'"])


def test_a_solid_that_is_refused_leaves_nothing_behind() -> None:
    builder = sw.ModelBuilder()
    with pytest.raises(ModelError, match="unknown option 'frction'"):
        builder.add_solid("ball", "sphere", 0.1, mass=1.0, frction=0.3)  # type: ignore[call-arg]
    assert builder.add_solid("ball", "sphere", 0.1, mass=1.0) == 0
    assert len(builder.shapes) == len(builder.bodies) == 1
