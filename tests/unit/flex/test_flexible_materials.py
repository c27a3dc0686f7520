"""Materials of flexible bodies refuse what no material has."""

import dataclasses

import pytest

import simwarp as sw

STEEL = {"young": 2.1e11, "poisson": 0.3, "density": 7850.0}
WRONG = [
    ("young", 0.0), ("young", -1.0), ("young", float("nan")), ("young", float("inf")), ("young", "steel"),
    ("poisson", -0.1), ("poisson", 0.5), ("poisson", float("nan")),
    ("density", 0.0), ("density", float("inf")),
    ("damping_time", -1e-3), ("damping_time", float("nan")),
]  # fmt: skip


@pytest.mark.parametrize("kind", [sw.flex.Elastic, sw.flex.Rubber])
def test_a_material_is_frozen_and_has_defaults(kind):
    made = kind(young=1e6, density=1000.0)
    assert (made.poisson, made.damping_time) == ({sw.flex.Elastic: 0.3, sw.flex.Rubber: 0.45}[kind], 0.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.young = 2.0


@pytest.mark.parametrize("kind", [sw.flex.Elastic, sw.flex.Rubber])
@pytest.mark.parametrize(("field", "value"), WRONG)
def test_a_wrong_value_is_named_in_one_line(kind, field, value):
    with pytest.raises(sw.ModelError) as raised:
        kind(**{**STEEL, field: value})
    text = str(raised.value)
    assert text.startswith(f"{kind.__name__}: {field} must be ")
    assert ", got " in text
    assert "; " in text
    assert "\n" not in text


@pytest.mark.parametrize("kind", [sw.flex.Elastic, sw.flex.Rubber])
def test_the_edges_of_a_rule_pass(kind):
    for edge in (0.0, 0.499):
        assert kind(**{**STEEL, "poisson": edge}).poisson == edge
