"""What two surfaces make of their contact: rules, priorities, and surfaces of given pairs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import FrictionRule, Material
from tests.reference.contact_scenes import heap
from tests.reference.contact_step import ContactReference, mixed

DT = 1e-3
FASTEST = 1000.0
"""Depenetration velocity [m/s], of which a fiftieth takes 20 mm away in a step by the rows themselves."""
RULES = list(FrictionRule)
TIGHT = sw.SolverOptions(tolerance=1e-6)
EXPECTED = {FrictionRule.MIN: 0.2, FrictionRule.MAX: 0.5, FrictionRule.MEAN: 0.35, FrictionRule.PRODUCT: 0.1}
"""Of 0.5 and 0.2."""


def sliding(
    ground: Material, ball: Material, *, turned: bool = False, given: Material | None = None, **options: Any
) -> sw.ModelBuilder:
    """A ball that slides over the ground and spins about the vertical; `turned`: its shape is the first one."""
    builder = sw.ModelBuilder(**options)
    if not turned:
        builder.add_shape_plane(material=ground)
    builder.add_solid(
        "ball", "sphere", 0.2, mass=2.0, pose=sw.pose((0.0, 0.0, 0.2)), velocity=(3.0, 0.0, 0.0),
        omega=(0.0, 0.0, 40.0), material=ball,
    )  # fmt: skip
    if turned:
        builder.add_shape_plane(material=ground)
    if given is not None:
        builder.add_shape_pair(0, 1, material=given)
    return builder


def ratios(builder: sw.ModelBuilder, **solver: Any) -> np.ndarray:
    """Friction, and levers of rolling and spinning, that the contact has after a step [m]."""
    options = sw.SolverOptions(tolerance=1e-6, **solver)
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, solver=options)
    sim.step()
    normal, *across = sim.contacts.contact_impulse.numpy()[0, 0].astype(float)
    moment = sim.contacts.contact_moment.numpy()[0, 0].astype(float)
    assert sim.contacts.contact_count.numpy()[0] == 1
    assert normal > 0.0
    return np.array([np.hypot(*across), np.hypot(*moment[:2]), abs(moment[2])]) / normal


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("rule", RULES)
def test_rules_of_sliding_friction(rule: FrictionRule, turned: bool) -> None:
    builder = sliding(Material(friction=0.5), Material(friction=0.2), turned=turned, friction_rule=rule)
    # the solver stops at 1e-6 m/s of an impulse per mass of 0.01 m/s
    assert ratios(builder)[0] == pytest.approx(EXPECTED[rule], rel=1e-3)


@pytest.mark.parametrize("rule", RULES)
def test_rules_of_the_levers(rule: FrictionRule) -> None:
    """Spinning is slowed by the lever times the normal force; a product of lengths would be none."""
    one, other = (Material(friction=0.4, spinning_friction=lever) for lever in (0.004, 0.001))
    lever = {FrictionRule.MIN: 0.001, FrictionRule.MAX: 0.004, FrictionRule.MEAN: 0.0025, FrictionRule.PRODUCT: 0.001}
    found = ratios(sliding(one, other, friction_rule=rule))
    assert found[2] == pytest.approx(lever[rule], rel=2e-3)
    one, other = (Material(friction=0.4, rolling_friction=lever) for lever in (0.004, 0.001))
    rolling = ratios(sliding(one, other, friction_rule=rule))
    # the ball slides: friction turns it, and rolling resistance holds against that with all it has
    assert rolling[1] == pytest.approx(lever[rule], rel=2e-3)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("rule", RULES)
def test_the_higher_priority_decides_alone(rule: FrictionRule, turned: bool) -> None:
    ground = Material(friction=0.3, spinning_friction=0.003, priority=-1)
    ball = Material(friction=0.6, spinning_friction=0.001, priority=2)
    ahead = ratios(sliding(ground, ball, turned=turned, friction_rule=rule))
    assert ahead[[0, 2]] == pytest.approx([0.6, 0.001], rel=2e-3)
    ground, ball = (Material(**{**vars(m), "priority": -m.priority}) for m in (ground, ball))
    behind = ratios(sliding(ground, ball, turned=turned, friction_rule=rule))
    assert behind[[0, 2]] == pytest.approx([0.3, 0.003], rel=2e-3)


@pytest.mark.parametrize("rule", RULES)
def test_a_frictionless_surface(rule: FrictionRule) -> None:
    """Two of them slide freely whatever the rule; one meets the larger or mean friction of the other."""
    free = Material(friction=0.0)
    assert ratios(sliding(free, free, friction_rule=rule))[0] == 0.0
    expected = {FrictionRule.MAX: 0.4, FrictionRule.MEAN: 0.2}.get(rule, 0.0)
    assert ratios(sliding(free, Material(friction=0.4), friction_rule=rule))[0] == pytest.approx(expected, rel=1e-3)
    first = Material(friction=0.0, priority=1)
    assert ratios(sliding(first, Material(friction=0.4), friction_rule=rule))[0] == 0.0


@pytest.mark.parametrize("law", ["rigid", "smooth"])
def test_a_given_pair_has_a_surface_of_its_own(law: str) -> None:
    own = Material(friction=0.45, spinning_friction=0.002)
    ahead = Material(friction=0.9, priority=3)
    builder = sliding(ahead, Material(), given=own, friction_rule="product")
    if law == "smooth":
        builder = press(builder)
    found = ratios(builder, contact_model=law)
    assert found[0] == pytest.approx(0.45, rel=1e-3)
    if law == "rigid":
        assert found[2] == pytest.approx(0.002, rel=2e-3)
        assert ratios(sliding(Material(restitution=1.0), Material(), given=own))[0] == pytest.approx(0.45, rel=1e-3)


@pytest.mark.parametrize("rule", RULES)
def test_rules_in_the_smooth_model(rule: FrictionRule) -> None:
    builder = press(sliding(Material(friction=0.5), Material(friction=0.2), friction_rule=rule))
    assert ratios(builder, contact_model="smooth")[0] == pytest.approx(EXPECTED[rule], rel=1e-5)


def press(builder: sw.ModelBuilder) -> sw.ModelBuilder:
    """The ball a little into the ground: penalty forces need it, and slow tangential springs many steps."""
    body = builder.bodies[0]
    pose = sw.pose((0.0, 0.0, 0.199))
    builder.bodies[0] = type(body)(**{**vars(body), "pose": pose, "velocity": np.array([50.0, 0.0, 0.0])})
    return builder


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.sweep
def test_against_the_reference(rule: FrictionRule, seed: int) -> None:
    """Random surfaces and priorities, a pair that is excluded and one that is given, in float64."""
    rng = np.random.default_rng(seed)
    builder = heap(rng, "o", boxes=False)
    for index, shape in enumerate(builder.shapes):
        material = Material(**{**vars(shape.material), "priority": int(rng.integers(0, 2))})
        builder.shapes[index] = type(shape)(**{**vars(shape), "material": material})
    builder.friction_rule = rule
    builder.add_shape_pair(0, 1, material=Material(friction=0.7))
    builder.exclude_shapes(0, 3)
    envelope = 0.1
    options = sw.SolverOptions(
        tolerance=1e-7, max_iterations=2000, contact_margin=envelope, max_depenetration_velocity=FASTEST
    )
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, solver=options)
    reference = ContactReference(builder, DT, envelope=envelope, max_depenetration_velocity=FASTEST)
    sim.step()
    reference.step()
    assert len(reference.touches) >= 4
    residual = float(sim.diagnostics.cone_residual.numpy()[0])
    # gaps are off by a rounding of 0.5 m over h, 3e-5 m/s; the solve by some residuals; angular speeds at 0.05 m
    allowed = 4e-5 + 20.0 * residual
    assert np.abs(sim.state.body_v.numpy()[0] - reference.v).max() <= allowed
    assert np.abs(sim.state.body_omega.numpy()[0] - reference.omega).max() <= allowed / 0.05


def test_the_reference_itself() -> None:
    a, b = Material(friction=0.5, rolling_friction=0.2), Material(friction=0.2, rolling_friction=0.1)
    for rule, expected in EXPECTED.items():
        assert mixed(a, b, rule).friction == pytest.approx(expected)
    assert mixed(a, b, FrictionRule.PRODUCT).rolling_friction == 0.1
    assert mixed(Material(friction=0.1, priority=1), b, FrictionRule.MAX).friction == 0.1


def test_worlds_have_frictions_of_their_own() -> None:
    """A rule is the model's, the numbers are the worlds'."""
    builder = sliding(Material(friction=0.5), Material(friction=0.2), friction_rule=FrictionRule.MAX)
    sim = sw.Simulation(builder.finalize(3, "cpu", per_world=["shape_friction"]), DT, solver=TIGHT)
    sim.model.shape_friction[1, 0] = 0.1
    sim.model.shape_friction[2, 1] = 0.7
    sim.step()
    impulse = sim.contacts.contact_impulse.numpy()[:, 0].astype(float)
    found = np.hypot(impulse[:, 1], impulse[:, 2]) / impulse[:, 0]
    assert found == pytest.approx([0.5, 0.2, 0.7], rel=1e-3)


NOTHING: dict[str, Any] = {}


@pytest.mark.parametrize(
    ("options", "section"),
    [({"friction_rule": "max"}, "rules of contact"), ({"pair_rule": "either"}, "rules of contact")],
)
def test_a_rule_is_part_of_the_identity(options: dict[str, Any], section: str) -> None:
    plain, other = (sliding(Material(), Material(), **each).finalize(1, "cpu").identity for each in (NOTHING, options))
    assert section not in plain.parts  # files of before stay readable
    assert plain.difference(other).startswith(section)
    first = sliding(Material(priority=1), Material()).finalize(1, "cpu").identity
    assert plain.difference(first).startswith("shapes")
