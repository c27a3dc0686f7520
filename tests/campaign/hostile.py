"""Hostile values: what a user, a script or a broken disk may hand over, each with the verdict that is certain."""

import enum
import functools
import math
from typing import Any, NamedTuple

from hypothesis import strategies as st

FLOAT32_MAX = 3.4028234663852886e38
DEPTH = 100_000


class Verdict(enum.Enum):
    """What a right program does with an input."""

    REFUSE = "must be refused"
    ACCEPT = "must be accepted"
    EITHER = "may be refused or accepted"


class Value(NamedTuple):
    """A value and its verdict."""

    value: Any
    verdict: Verdict


REFUSE, ACCEPT, EITHER = Verdict.REFUSE, Verdict.ACCEPT, Verdict.EITHER


def refused(*values: Any) -> list[Value]:
    return [Value(value, REFUSE) for value in values]


def either(*values: Any) -> list[Value]:
    return [Value(value, EITHER) for value in values]


def is_number(text: str, kind: type = float) -> bool:
    """Whether Python reads a text as a number: such a text is no certain mistake."""
    try:
        kind(text)
    except ValueError:
        return False
    return True


# ---- texts of a command line -----------------------------------------------------------------------------------------

NAMES = [
    "x",
    "",
    " ",
    "None",
    "../",
    "/",
    ".",
    "~",
    "a" * 256,
    "ü" * 200,
    "日本",
    "-",
    "--",
    "a\nb",
    "\x1b[31m",
    "%s{}",
    "nul\0",
]
"""Names of nothing."""

odd_texts = st.one_of(
    st.sampled_from(NAMES),
    st.text(min_size=1, max_size=12),
    st.integers(20, 400).map(lambda count: "9" * count),
    st.sampled_from(["\udcff", "a\udc80b", "\ud800"]),
)
"""Texts of any kind: unicode, lone surrogates (bytes that are no UTF-8), control characters."""

integer_texts = st.one_of(
    st.sampled_from(
        refused("", "nan", "inf", "-inf", "1.5", "1e308", "x", "None", "0x1f", "1,2", "½", str(10**20), str(-(10**20)))
    ),
    st.integers(20, 400).map(lambda count: Value("7" * count, REFUSE)),
    odd_texts.filter(lambda text: not is_number(text, int)).map(lambda text: Value(text, REFUSE)),
    st.sampled_from(either("0", "-1", str(-(2**31)), "1_0", " 3", "３")),
)
float_texts = st.one_of(
    st.sampled_from(
        refused("", "nan", "-nan", "inf", "-inf", "1e39", "-1e39", "1e308", "1e400", "1,5", "x", "None", "0x1p3")
    ),
    st.integers(39, 400).map(lambda count: Value("8" * count, REFUSE)),
    st.floats(1.0001 * FLOAT32_MAX, 1.7e308).map(lambda number: Value(repr(number), REFUSE)),
    odd_texts.filter(lambda text: not is_number(text)).map(lambda text: Value(text, REFUSE)),
    st.sampled_from(either("0", "-0.0", "-1", "1e-45", "1e-320", "1_0", "-3e38", "1e-9")),
)

# ---- values of Python and of JSON ------------------------------------------------------------------------------------

NO_NUMBERS = refused(
    math.nan,
    math.inf,
    -math.inf,
    1e39,
    -1e39,
    1e308,
    10**39,
    10**400,
    -(10**400),
    "x",
    "",
    "1.0",
    [],
    {},
    [1.0],
    object,
)
"""Where a number of float32 is wanted. A whole number of 400 digits does not even become a float."""

SMALL_NUMBERS = either(0.0, -0.0, -1.0, 1e-45, 1e-320, -1e-30, 1e-9, 0, -1, True, 1e30, -1e30, 3e38)
"""Numbers that some fields take."""

no_numbers = st.one_of(
    st.sampled_from(NO_NUMBERS),
    st.floats(1.0001 * FLOAT32_MAX, 1.7e308).map(lambda number: Value(number, REFUSE)),
    st.integers(40, 400).map(lambda count: Value(int("7" * count), REFUSE)),
    odd_texts.map(lambda text: Value(text, REFUSE)),
)
number_values = st.one_of(no_numbers, st.sampled_from(SMALL_NUMBERS))

no_integers = st.one_of(
    no_numbers,
    st.sampled_from(refused(1.5, None, 10**20, -(10**20), 2**64, (1,))),
    st.floats(0.01, 0.99).map(lambda number: Value(number, REFUSE)),
)


def vector_values(length: int) -> st.SearchStrategy[Value]:
    """Values where `length` numbers are wanted: wrong lengths, wrong types, one hostile component."""
    wrong: list[Any] = [
        None,
        "x",
        1.0,
        math.nan,
        [],
        [1.0] * (length - 1),
        [1.0] * (length + 1),
        {},
        ["a"] * length,
        [[1.0] * length] * 2,
    ]
    good = [1.0] + [0.0] * (length - 1)

    def spoil(item: Value, place: int) -> Value:
        return Value((*good[:place], item.value, *good[place + 1 :]), item.verdict)

    hostile = no_numbers.filter(lambda item: not isinstance(item.value, (str, list, dict)) or item.value == "x")
    return st.one_of(
        st.sampled_from(refused(*wrong)),
        st.builds(spoil, hostile, st.integers(0, length - 1)),
        st.sampled_from(either((0.0,) * length, (1e30,) * length, (1e-30,) * length, (-1.0,) * length)),
    )


@functools.cache
def deep_json(opening: str = "[", closing: str = "]") -> str:
    """A text nested deeper than any reader's stack."""
    return opening * DEPTH + closing * DEPTH


def shorten(value: Any, longest: int = 120) -> str:
    """A value as one short line, for lists of failures; never fails."""
    try:
        text = ascii(value)
    except ValueError:  # a whole number beyond Python's limit of digits
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= longest else f"{text[: longest - 30]}... of {len(text)} characters"
