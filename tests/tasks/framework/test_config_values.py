"""Plain values become configurations only where every one of them is of its field's type."""

import dataclasses
import enum
import json
import typing
from collections.abc import Mapping
from typing import Annotated, Literal

import pytest
import torch

from simwarp.tasks import Range, config_from_plain, config_to_plain, task_class, task_names
from simwarp.tasks.framework.config_values import typed
from simwarp.tasks.framework.errors import InputError
from simwarp.tasks.framework.registry import _BUILT_IN
from simwarp.tasks.framework.saved_state import check_like
from simwarp.train.config import TrainConfig, default_config

KINDS = [TrainConfig, *(task_class(name).config_type for name in task_names())]
WRONG: dict = {
    float: [None, True, "1", [], {}, float("nan"), float("inf"), 1e39, -(10**400)],
    int: [None, True, "1", 1.0, [], {}, 10**20, -(2**63) - 1],
    bool: [None, 0, 1, "true", []],
    str: [None, 1, [], "x" * 1001],
    list: [None, 1, "ab", {"a": 1}, [None], [[1]], ["x"]],
    dict: [None, 1, "x", [], {"nonsense": None}, {1: 2}],
    enum.Enum: [None, 1, [], {}, "nonsense", True],
}


def kind_of(value):
    if isinstance(value, enum.Enum):
        return enum.Enum
    if isinstance(value, tuple):
        return list
    return dict if isinstance(value, Mapping) or dataclasses.is_dataclass(value) else type(value)


def fields(config, path=()):
    """Every field of a configuration, those of the configurations in it too, with its value."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        yield (*path, field.name), value
        if dataclasses.is_dataclass(value):
            yield from fields(value, (*path, field.name))


def nested(path, value):
    for name in reversed(path):
        value = {name: value}
    return value


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_field_of_every_configuration_refuses_what_it_is_not(kind):
    hints = typing.get_type_hints(kind)
    count = 0
    for path, value in fields(kind()):
        if value is None:
            continue
        name = ".".join(path).replace("_", "-")
        optional = type(None) in typing.get_args(hints.get(path[0])) and len(path) == 1
        many = any(typing.get_origin(hint) is tuple for hint in typing.get_args(hints.get(path[0])))
        for wrong in WRONG[kind_of(value)]:
            if (optional and wrong is None) or (many and wrong == []):
                continue
            if many and type(wrong) is int and isinstance(value, tuple):
                continue  # one number for all
            with pytest.raises(InputError) as caught:
                config_from_plain(kind, nested(path, wrong), "file.json")
            assert str(caught.value).startswith("file.json: "), path
            assert name.rpartition(".")[2] in str(caught.value) or "nonsense" in str(caught.value), (path, caught.value)
            assert len(str(caught.value)) < 600
            count += 1
    assert count > 50


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_configuration_comes_back_from_json(kind):
    assert config_from_plain(kind, json.loads(json.dumps(config_to_plain(kind())))) == kind()
    assert config_from_plain(kind, {}) == kind()


@pytest.mark.parametrize("name", sorted(_BUILT_IN))
def test_every_tasks_training_comes_back_from_json(name):
    config = default_config(task_class(name))
    assert config_from_plain(TrainConfig, json.loads(json.dumps(config_to_plain(config)))) == config


@dataclasses.dataclass(frozen=True)
class Inner:
    first: int
    second: float = 2.0


@dataclasses.dataclass(frozen=True)
class Outer:
    inner: Inner = Inner(1, 5.0)
    many: tuple[Inner, ...] = ()
    named: Mapping[str, Range] = dataclasses.field(default_factory=dict)
    word: Literal["a", "b"] = "a"
    maybe: Annotated[float | None, "unit"] = None


def test_what_is_left_away_has_the_value_of_the_owners_default():
    assert config_from_plain(Outer, {"inner": {"first": 3}}).inner == Inner(3, 5.0)
    assert config_from_plain(Outer, {"many": [{"first": 3}]}).many == (Inner(3, 2.0),)
    assert config_from_plain(Outer, {"maybe": 1}).maybe == 1.0
    assert config_from_plain(Outer, {"named": {"x": {"low": 1, "high": 2}}}).named == {"x": Range(1.0, 2.0)}


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        ({"many": [{}]}, "many[0].first: missing; give a whole number"),
        ({"named": {"x": {"low": 1}}}, "named 'x'.high: missing; give a number"),
        ({"named": {"x": {"low": 2, "high": 1}}}, "named 'x': bounds of a Range must be"),
        ({"inner": {"frist": 1}}, "inner.frist: unknown key (did you mean 'first'?); known: first, second"),
        ({"word": "c"}, "word must be one of 'a', 'b', got 'c'"),
        ({"outer": 1}, "outer: unknown key; known: inner, many"),
        (None, "Outer must be an object with the keys of Outer, got None"),
    ],
)
def test_what_is_wrong_is_named(plain, message):
    with pytest.raises(InputError) as caught:
        config_from_plain(Outer, plain)
    assert str(caught.value).startswith(message)


def test_instances_of_other_classes_are_looked_at_only_for_their_class():
    tensor = torch.zeros(3)
    assert typed(torch.Tensor, tensor, "x") is tensor
    assert typed(torch.Tensor | None, None, "x") is None
    with pytest.raises(InputError, match="x must be a Tensor, got 1"):
        typed(torch.Tensor, 1, "x")


@pytest.mark.parametrize(
    ("like", "saved", "message"),
    [
        (torch.zeros(2, 3), torch.zeros(3, 2), r"x must be \(2, 3\) float32, got \(3, 2\) float32"),
        (torch.zeros(2), torch.zeros(2, dtype=torch.float64), r"x must be \(2,\) float32, got \(2,\) float64"),
        (torch.zeros(2), torch.zeros(2).to_sparse(), r"got \(2,\) float32 in sparse_coo layout"),
        (torch.zeros(2), torch.zeros(2, device="meta"), r"got \(2,\) float32 without values"),
        (torch.zeros(2), [0.0, 0.0], r"x must be \(2,\) float32"),
        ({"a": 1}, {}, "x has no 'a'"),
        ({"a": 1}, {"a": 1, "b": 2}, "x has 'b', which is nothing here"),
        ({"a": {"b": 1}}, {"a": {"b": True}}, "x.a.b must be a whole number"),
        ([1, 2], [1], "x must be a list of 2"),
        (None, 1, "x must be nothing"),
    ],
)
def test_saved_state_is_held_to_the_present_one(like, saved, message):
    with pytest.raises(InputError, match=message):
        check_like(like, saved, "x")
    check_like(like, like, "x")
