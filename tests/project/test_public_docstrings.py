"""Whoever reads help() of a public name finds what it is, its shapes, units and errors."""

from __future__ import annotations

import enum
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

import gymnasium
import pytest
import warp as wp
from rsl_rl.env import VecEnv

import simwarp as sw

PACKAGES = (
    "simwarp", "simwarp.vehicle", "simwarp.vehicle.rigs", "simwarp.sensors", "simwarp.scenery", "simwarp.importers",
    "simwarp.exporters", "simwarp.mcap",
    "simwarp.actuators", "simwarp.analysis", "simwarp.flex", "simwarp.motions", "simwarp.planning", "simwarp.viewer",
    "simwarp.tasks", "simwarp.tasks.driving", "simwarp.train",
)  # fmt: skip

INTERFACES = {
    sw.ForceElement: {
        "memory",
        "record",
        "record_after",
        "record_outputs",
        "record_reset",
        "record_shown",
        "world_parameters",
    },
    sw.Sensor: {"memory", "record", "begin", "check", "world_parameters"},
    gymnasium.Env: {"step", "reset"},
    gymnasium.vector.VectorEnv: {"step", "reset"},
    VecEnv: {"step", "get_observations"},
}
"""Methods whose shapes, units and errors are documented once, where the interface is."""

ARRAYS = re.compile(r"\b(NDArray|ArrayLike|Array|Tensor|TensorDict|Heights|Image|Picture|WritableArray)\b|wp\.array")
NUMBERS = re.compile(r"\b(float|Positive|NotNegative)\b")
_LENGTH = r"(?:\.\.\.|[\w·+ -]+?)"
SHAPE = re.compile(rf"\({_LENGTH}(?:,|(?:, {_LENGTH})+)\)|\(\.\.\.\)")
UNIT = re.compile(r"\[(?!-?\d)[^\[\])]*[A-Za-z][^\[\])]*\]")
WITHOUT_UNIT = re.compile(
    r"\b(shares?|factors?|probability|ratio|0 to 1|0\.\.1|between 0 and 1|-1 to 1|seconds|dimensionless|unit of)\b"
)
RAISE = re.compile(r"^\s+raise (?!NotImplementedError)\w[\w.]*\(", re.MULTILINE)
FRAGMENT = re.compile(r"(Of|That of|Those of|The same|See|As|One of zeros)\b|\[")


class Public(NamedTuple):
    """A public name, and the class that it belongs to, if any."""

    label: str
    value: Any
    owner: type | None

    @property
    def text(self) -> str:
        return inspect.getdoc(self.value) or ""

    @property
    def annotations(self) -> str:
        if inspect.isclass(self.value):
            return ""
        signature = inspect.signature(self.value)
        parts = [part.annotation for part in signature.parameters.values()]
        return " ".join(map(str, [*parts, signature.return_annotation]))


def members(cls: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties that a class defines itself, or has from a class of simwarp."""
    ours = [base for base in cls.__mro__ if base.__module__.split(".")[0] == "simwarp"]
    for name, value in {name: value for base in reversed(ours) for name, value in vars(base).items()}.items():
        function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
        if not name.startswith("_") and inspect.isfunction(function) and function.__module__.startswith("simwarp"):
            yield name, function


@cache
def public() -> list[Public]:
    """All public names of the packages, each once."""
    found: dict[int, Public] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            value = getattr(module, name)
            ours = getattr(value, "__module__", "").split(".")[0] == "simwarp"
            if id(value) in found or not ours or not (inspect.isclass(value) or inspect.isfunction(value)):
                continue
            found[id(value)] = Public(f"{package}.{name}", value, None)
            if inspect.isclass(value):
                for member, function in members(value):
                    found.setdefault(id(function), Public(f"{package}.{name}.{member}", function, value))
    return list(found.values())


def provides(cls: type, interface: type) -> bool:
    """True if a class is one of an interface: a subclass, or one with all methods of the Protocol."""
    if not getattr(interface, "_is_protocol", False):
        return issubclass(cls, interface)
    return all(hasattr(cls, name) for name, value in vars(interface).items() if inspect.isfunction(value))


def documented_elsewhere(item: Public) -> bool:
    """True if an interface documents the method: of that name, with the same arguments where it declares them."""
    if item.owner is None or item.owner in INTERFACES:
        return False
    name = item.value.__name__
    for interface, methods in INTERFACES.items():
        if name in methods and provides(item.owner, interface):
            declared = getattr(interface, name, None)
            if not inspect.isfunction(declared) or declared.__module__.split(".")[0] != "simwarp":
                return True
            return list(inspect.signature(declared).parameters) == list(inspect.signature(item.value).parameters)
    return False


def source(item: Public) -> str:
    """What runs when it is called: of a class, what it does when it is made."""
    if not inspect.isclass(item.value):
        return inspect.getsource(item.value)
    own = vars(item.value)
    makers = [inspect.unwrap(own[name]) for name in ("__init__", "__post_init__") if name in own]
    ours = [maker for maker in makers if maker.__module__.startswith("simwarp")]
    written = [maker for maker in ours if maker.__code__.co_filename != "<string>"]  # a dataclass makes its own
    return "\n".join(inspect.getsource(maker) for maker in written)


def undocumented(item: Public) -> bool:
    generated = inspect.isclass(item.value) and item.text.startswith(f"{item.value.__name__}(")
    return not item.text or generated or (inspect.isclass(item.value) and not vars(item.value).get("__doc__"))


def hides_errors(item: Public) -> bool:
    if inspect.isclass(item.value) and issubclass(item.value, enum.Enum):
        return False
    return bool(RAISE.search(source(item))) and "Raises:" not in item.text and not documented_elsewhere(item)


def lacks_shape(item: Public) -> bool:
    return bool(ARRAYS.search(item.annotations)) and not SHAPE.search(item.text) and not documented_elsewhere(item)


def lacks_unit(item: Public) -> bool:
    told = UNIT.search(item.text) or WITHOUT_UNIT.search(item.text)
    return bool(NUMBERS.search(item.annotations)) and not told and not documented_elsewhere(item)


def is_fragment(item: Public) -> bool:
    """True if the first line cannot be understood by itself: a pointer elsewhere, or a shape and a unit alone."""
    first = item.text.split("\n")[0]
    words = re.findall(r"[A-Za-z]{2,}", UNIT.sub("", SHAPE.sub("", first)))
    dtypes = {"bool", "int", "uint", "float", "vec"}
    return bool(FRAGMENT.match(first)) or not [word for word in words if word not in dtypes]


RULES: dict[str, Callable[[Public], bool]] = {
    "has a docstring": lambda item: not undocumented(item),
    "says which errors it raises": lambda item: not hides_errors(item),
    "says the shapes of arrays": lambda item: not lacks_shape(item),
    "says the units of numbers": lambda item: not lacks_unit(item),
    "begins with words of its own": lambda item: not is_fragment(item),
}


@pytest.mark.parametrize("rule", RULES)
def test_every_public_name(rule: str) -> None:
    assert [item.label for item in public() if not RULES[rule](item)] == []


def shaped(values: wp.array, dt: float) -> None:
    """Takes the values of a step."""
    raise ValueError(values)


def test_the_rules_find_a_poor_docstring() -> None:
    poor = Public("shaped", shaped, None)
    assert [rule for rule, holds in RULES.items() if not holds(poor)] == [
        "says which errors it raises",
        "says the shapes of arrays",
        "says the units of numbers",
    ]


def test_only_methods_of_an_interface_are_documented_there() -> None:
    items = {item.label: item for item in public()}
    assert documented_elsewhere(items["simwarp.sensors.Camera.record"])
    assert documented_elsewhere(items["simwarp.vehicle.Vehicle.record_after"])
    assert not documented_elsewhere(items["simwarp.sensors.FrameBuffer.record"]), "it has an argument more"
    assert not documented_elsewhere(items["simwarp.sensors.Lidar.points"])
    assert not documented_elsewhere(items["simwarp.Sensor.record"]), "there it has to be"


@pytest.mark.parametrize("text", ["(W,) [m].", "[m].", "Of a lap [m].", "(W,) uint8.", "See `Lens`."])
def test_fragments_are_found(text: str) -> None:
    def fragment() -> None: ...

    fragment.__doc__ = text
    assert is_fragment(Public("fragment", fragment, None))


def test_the_packages_are_looked_through() -> None:
    labels = {item.label for item in public()}
    assert {"simwarp.Simulation.step", "simwarp.vehicle.load", "simwarp.tasks.Task.rewards"} <= labels
