"""Which shapes may meet: rules of groups and masks, excluded and given pairs, in the list and in the grid."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import simwarp as sw
import simwarp.model.model
from simwarp.core.types import WORLD, Material, ModelError, PairRule
from simwarp.model.model import never_meet
from simwarp.model.shape_pairs import shape_pairs
from tests.reference.contact_step import ContactReference

Change = Callable[[sw.ModelBuilder], Any]


def crowd(rule: PairRule | str, seed: int = 0, bodies: int = 12) -> sw.ModelBuilder:
    """Balls that all overlap, two on some bodies, of random groups and masks; some tied, some excluded, some given."""
    rng = np.random.default_rng(seed)
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0), pair_rule=rule)
    for index in range(bodies):
        at = 0.02 * rng.normal(size=3)
        body = builder.add_body(f"b{index}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose(at))
        for _ in range(1 + index % 3 // 2):
            group, mask = (int(bits) for bits in rng.integers(0, 8, 2))
            builder.add_shape_sphere(body, radius=0.2, group=group, mask=mask)
    builder.add_shape_sphere(WORLD, radius=0.2, group=4, mask=3)
    builder.add_shape_box(WORLD, half=(0.2, 0.2, 0.2), group=1, mask=0)
    builder.add_joint_spherical("tie", 0, 1, anchor=(0.0, 0.0, 0.0))
    builder.add_joint_spherical("base", WORLD, 2, anchor=(0.0, 0.0, 0.0))
    builder.exclude_collision(3, 4)
    bodies_of = [shape.body for shape in builder.shapes]
    pairs = [
        (a, b) for a, b in itertools.combinations(range(len(bodies_of)), 2)
        if bodies_of[a] != bodies_of[b] and (a, b) != (0, 1)
    ]  # fmt: skip
    chosen = [pairs[k] for k in rng.permutation(len(pairs))[:16]]
    for a, b in chosen[:8]:
        builder.exclude_shapes(b, a)
    for a, b in chosen[8:]:
        builder.add_shape_pair(b, a)
    builder.add_shape_pair(0, 1)  # tied
    return builder


def met(builder: sw.ModelBuilder, **options: Any) -> set[tuple[int, int]]:
    """Pairs of shapes with contacts after a step."""
    sim = sw.Simulation(builder.finalize(1, "cpu", contact_capacity=400), 1e-4, **options)
    sim.step()
    count = int(sim.contacts.contact_count.numpy()[0])
    assert sim.contacts.contact_overflow.numpy()[0] == 0
    names = (sim.contacts.contact_shape0, sim.contacts.contact_shape1)
    return set(zip(*(array.numpy()[0, :count].tolist() for array in names), strict=True))


def expected(builder: sw.ModelBuilder) -> set[tuple[int, int]]:
    """Pair by pair, as the reference has it."""
    reference = ContactReference(builder, 1e-3)
    return {(i, j) for i, j in itertools.combinations(range(len(builder.shapes)), 2) if reference.may_meet(i, j)}


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("rule", PairRule)
def test_list_and_grid_against_one_pair_after_the_other(
    rule: PairRule, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder = crowd(rule, seed)
    wanted = expected(builder)
    listed = [tuple(pair) for pair in shape_pairs(builder, never_meet(builder)).tolist()]
    assert listed == sorted(wanted)
    assert met(builder) == wanted
    monkeypatch.setattr(simwarp.model.model, "LISTED_PAIRS", 0)
    assert builder.finalize(1, "cpu").topology.grid_buckets > 0
    assert met(builder) == wanted


def test_either_is_what_mujoco_does() -> None:
    """contype and conaffinity, excluded bodies, given pairs: the same contacts of balls on one heap."""
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(7)
    bits = rng.integers(0, 8, (14, 2))
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0), pair_rule=PairRule.EITHER)
    text = ""
    for index, (kind, affinity) in enumerate(bits.tolist()):
        at = 0.02 * rng.normal(size=3)
        body = builder.add_body(f"b{index}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose(at))
        builder.add_shape_sphere(body, radius=0.2, group=kind, mask=affinity)
        text += f'<body name="b{index}" pos="{at[0]} {at[1]} {at[2]}"><freejoint/>'
        text += f'<geom name="g{index}" size="0.2" contype="{kind}" conaffinity="{affinity}"/></body>'
    rules = ""
    for a, b in ((0, 1), (2, 5), (3, 4)):
        builder.exclude_collision(a, b)
        rules += f'<exclude body1="b{a}" body2="b{b}"/>'
    for a, b in ((3, 4), (0, 6), (7, 9), (1, 12)):  # one of them excluded, too
        builder.add_shape_pair(a, b)
        rules += f'<pair geom1="g{a}" geom2="g{b}"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{text}</worldbody><contact>{rules}</contact></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    theirs = {tuple(sorted(contact.geom.tolist())) for contact in data.contact}
    assert 20 < len(theirs) < 91
    assert met(builder) == theirs


def test_given_pairs_alone() -> None:
    """Masks of zero leave only what is given."""
    builder = sw.ModelBuilder()
    for index in range(4):
        builder.add_solid(f"b{index}", "sphere", 0.2, mass=1.0, pose=sw.pose((0.01 * index, 0.0, 0.0)), mask=0)
    assert met(builder) == set()
    assert builder.finalize(1, "cpu").shapes_that_meet.tolist() == [False] * 4
    builder.add_shape_pair(3, 1)
    builder.add_shape_pair(0, 2, material=Material(rolling_friction=0.01))
    model = builder.finalize(1, "cpu")
    assert met(builder) == {(0, 2), (1, 3)}
    assert model.shapes_that_meet.all()
    assert model.has_rolling_friction


def two() -> sw.ModelBuilder:
    builder = sw.ModelBuilder()
    for name in ("a", "b"):
        builder.add_solid(name, "sphere", 0.1, mass=1.0)
    builder.add_shape_sphere(1, radius=0.1, name="c")
    for name in ("field", "other"):
        body = 0 if name == "other" else WORLD
        builder.add_shape_height_field(body, np.zeros((2, 2)), size=(1.0, 1.0), name=name)
    return builder


def exclude_and_add(builder: sw.ModelBuilder) -> None:
    builder.exclude_shapes(0, 1)
    builder.add_shape_pair(1, 0)


def add_and_exclude(builder: sw.ModelBuilder) -> None:
    builder.add_shape_pair(0, 1)
    builder.exclude_shapes(1, 0)


WRONG: Any = 0.5
ERRORS: list[tuple[Change, list[str]]] = [
    (lambda b: b.exclude_shapes(0, 9), ["exclude_shapes", "shape1", "<= 4", "9"]),
    (lambda b: b.exclude_shapes(-1, 1), ["exclude_shapes", "shape0", "-1", "add_shape"]),
    (lambda b: b.exclude_shapes(1, 1), ["exclude_shapes", "must differ", "1"]),
    (lambda b: b.add_shape_pair(True, 1), ["add_shape_pair", "shape0", "True"]),
    (lambda b: b.add_shape_pair(1, 2), ["add_shape_pair", "two bodies", "'b' and 'c'"]),
    (lambda b: b.add_shape_pair(3, 4), ["add_shape_pair", "convex", "'field' and 'other'", "hulls"]),
    (lambda b: b.add_shape_pair(0, 1, material=WRONG), ["add_shape_pair", "Material", "0.5"]),
    (lambda b: b.add_shape_pair(0, 1, material=Material(friction=-1.0)), ["add_shape_pair", "friction", "-1.0"]),
    (exclude_and_add, ["add_shape_pair", "exclude_shapes", "drop one"]),
    (add_and_exclude, ["exclude_shapes", "add_shape_pair", "drop one"]),
]


@pytest.mark.parametrize("case", range(len(ERRORS)))
def test_refused(case: int) -> None:
    change, parts = ERRORS[case]
    with pytest.raises(ModelError) as error:
        change(two())
    text = str(error.value)
    assert "\n" not in text
    assert all(part in text for part in parts), text


@pytest.mark.parametrize(("field", "known"), [("friction_rule", "min, max"), ("pair_rule", "both, either")])
def test_a_rule_that_there_is_not(field: str, known: str) -> None:
    builder = two()
    setattr(builder, field, 3)
    with pytest.raises(ModelError, match=f"finalize: {field} must be one of {known}"):
        builder.finalize(1, "cpu")
    setattr(builder, field, known.split(", ")[1])
    assert builder.finalize(1, "cpu").topology.shape_count == 5


def test_pairs_are_part_of_the_identity() -> None:
    plain = two().finalize(1, "cpu").identity
    for change, section in (
        (lambda b: b.exclude_shapes(0, 1), "excluded pairs of shapes"),
        (lambda b: b.add_shape_pair(0, 1), "given pairs of shapes"),
        (lambda b: b.add_shape_pair(0, 1, material=Material(friction=0.1)), "given pairs of shapes"),
    ):
        builder = two()
        change(builder)
        assert plain.difference(builder.finalize(1, "cpu").identity).startswith(section)
