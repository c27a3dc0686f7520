"""How objects print: within 120 columns and 12 lines, without work, without errors."""

import dataclasses
import enum
import itertools

import numpy as np
import pytest

from simwarp.core.object_repr import MOST_LINES, WIDEST, Names, Readable, ReadableFields, bytes_text, plural
from simwarp.core.types import formatted


class Box(Readable):
    def __init__(self, title="", rows=None):
        self.title, self.rows = title, rows or {}

    def _readable_title(self):
        return self.title

    def _readable_rows(self):
        return self.rows


class Side(enum.IntEnum):
    LEFT = 1


@dataclasses.dataclass(frozen=True)
class Options(ReadableFields):
    first: object = 1
    second: object = "two"
    third: object = None


@dataclasses.dataclass(frozen=True)
class More(Options):
    fourth: object = 4.0
    hidden: object = dataclasses.field(default=5, repr=False)


def fits(text):
    lines = text.splitlines()
    return len(lines) <= MOST_LINES and max(map(len, lines)) <= WIDEST


def test_a_title_and_its_rows():
    box = Box(": 2 things", {"one": "a, b", "nothing": "", "longer": Names(2, ["c", "d"]), "none": Names(0, [])})
    assert repr(box) == "Box: 2 things\n  one     a, b\n  longer  2: c, d"
    assert str(box) == repr(box)


def test_only_names_that_fit_are_asked_for():
    asked = itertools.count()
    box = Box("", {"bodies": Names(10**9, (f"body{next(asked)}" for _ in range(10**9)))})
    text = repr(box)
    assert fits(text)
    assert text.startswith("Box\n  bodies  1000000000: body0, body1,")
    assert text.endswith(" ...")
    # the first line takes 109 letters less the count, a name at least 7 of them
    assert next(asked) < 40


@pytest.mark.parametrize("count", [1, 2, 12, 13, 14, 15, 100])
@pytest.mark.parametrize("length", [1, 6, 7, 8, 50, 109, 110, 111, 500])
def test_long_and_many_names_fit(count, length):
    names = [f"{index}".ljust(length, "x") for index in range(count)]
    rows = {
        "bodies": Names(count, names),
        "arrays": ", ".join(names),
        **{f"row {k}": "x y" * length for k in range(20)},
    }
    text = repr(Box("t" * length, rows))
    assert fits(text)
    if len(f"  bodies  {count}: {', '.join(names)}") <= WIDEST:
        assert f"{count}: {', '.join(names)}\n" in text


def test_line_breaks_in_names_are_blanks():
    assert repr(Box(" 'a\nb'", {"names": Names(1, ["c\nd"])})) == "Box 'a b'\n  names  1: c d"


def test_an_object_that_is_not_whole_prints_its_class():
    assert repr(Box.__new__(Box)) == "Box (incomplete)"
    assert repr(Box("", {"a row that is no text": 3})) == "Box (incomplete)"


def test_errors_still_call_it_by_its_class():
    assert formatted(Box(": 1 thing")) == "a Box"
    assert formatted([Box()]) == "[a Box]"


def test_few_fields_print_as_those_of_any_dataclass():
    assert repr(More()) == "More(first=1, second='two', third=None, fourth=4.0)"
    assert eval(repr(Options(third=(1, "x")))) == Options(third=(1, "x"))


def test_many_fields_are_wrapped_and_still_python():
    options = More(first="f" * 40, second=tuple(range(20)), third=Options(), fourth="g" * 40)
    text = repr(options)
    assert fits(text)
    assert len(text.splitlines()) > 2
    assert eval(text) == options


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Side.LEFT, "Side.LEFT"),
        (np.zeros((300, 4), np.float32), "<(300, 4) float32>"),
        (np.array([1.0, 2.5]), "array([1. , 2.5])"),
        (np.float64(0.5), "np.float64(0.5)"),
        (tuple(range(101)), "<tuple of 101>"),
        (dict.fromkeys(range(20), "x" * 50), "<dict of 20>"),
        (Options("x" * 60, "y" * 60), "Options(...)"),
        ("x" * 300, "'" + "x" * 103 + "'..."),
    ],
)
def test_long_values_by_what_they_are(value, text):
    printed = repr(Options(value))
    assert f"first={text}," in printed
    assert fits(printed)


def test_a_value_that_cannot_be_printed_is_named_by_its_class():
    class Broken:
        def __repr__(self):
            raise RuntimeError("no")

    assert repr(Options(Broken())) == "Options(first=<Broken>, second='two', third=None)"
    assert repr(Options.__new__(Options)) == "Options(first=1, second='two', third=None)"

    @dataclasses.dataclass
    class Needed(ReadableFields):
        value: int

    assert repr(Needed.__new__(Needed)) == "Needed(value='?')"


def test_endless_configurations_end():
    kind = dataclasses.make_dataclass("Long", [(f"a_rather_long_name_{k}", float, 1.0) for k in range(200)],
                                      bases=(ReadableFields,), frozen=True)  # fmt: skip
    text = repr(kind())
    assert fits(text)
    assert text.endswith("\n    ...\n)")


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 bytes"), (1023, "1023 bytes"), (1536, "1.5 KiB"), (2**20 - 1, "1024 KiB"), (2**20, "1 MiB"),
     (1023 * 2**20, "1023 MiB"), (3 * 2**30, "3 GiB"), (5000 * 2**30, "5000 GiB"), (2**70, "more than 2^40 GiB")],
)  # fmt: skip
def test_bytes_as_people_write_them(count, text):
    assert bytes_text(count) == text


def test_plurals():
    assert [plural(n, w) for n, w in ((1, "body"), (2, "body"), (0, "world"), (2, "mesh"))] == [
        "1 body", "2 bodies", "0 worlds", "2 meshes"
    ]  # fmt: skip
