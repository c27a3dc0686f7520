"""What a key of a study may be: a number from a range, about a mean, or one of a few; and its text."""

from __future__ import annotations

import dataclasses
import enum
import math
import re
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri

from simwarp.core.types import formatted
from simwarp.study.study_error import StudyError

Array = npt.NDArray[np.float64]

CUT: Final = 3.0
"""Standard deviations from the mean beyond which nothing is drawn from a normal distribution."""
NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?%?"
FORMS: Final = "LOW..HIGH, LOW..HIGH:log, MEAN+-DEVIATION or A,B,C, all numbers or all in %"
MOST_CHOICES: Final = 1000


class Kind(enum.Enum):
    """Of a distribution."""

    UNIFORM = "uniform"
    LOG_UNIFORM = "log-uniform"
    NORMAL = "normal"
    CHOICES = "choices"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Distribution:
    """How a key is drawn.

    Attributes:
        kind: of the distribution.
        low, high: ends of all draws; of a normal one three standard deviations from the mean.
        mean, deviation: of a normal one.
        choices: all alike in probability.
        relative: whether numbers are changes of the value as built, 0.1 for 10 % more.
    """

    kind: Kind
    low: float
    high: float
    mean: float = math.nan
    deviation: float = math.nan
    choices: tuple[float, ...] = ()
    relative: bool = False

    def at(self, share: npt.ArrayLike) -> Array:
        """The values below which these shares (0 to 1) of all draws are."""
        part = np.asarray(share, float)
        match self.kind:
            case Kind.UNIFORM:
                found = self.low + part * (self.high - self.low)
            case Kind.LOG_UNIFORM:
                found = self.low * np.exp(part * math.log(self.high / self.low))
            case Kind.NORMAL:
                tail = ndtr(-CUT)
                found = self.mean + self.deviation * ndtri(tail + part * (1.0 - 2.0 * tail))
            case Kind.CHOICES:
                index = np.minimum((part * len(self.choices)).astype(int), len(self.choices) - 1)
                return np.asarray(self.choices)[index]
        return np.asarray(np.clip(found, self.low, self.high))

    @property
    def ends(self) -> tuple[float, ...]:
        """Values to be checked before anything is drawn: both ends, or all choices."""
        return self.choices or (self.low, self.high)

    @property
    def text(self) -> str:
        """As it is written."""

        def word(value: float) -> str:
            return f"{100.0 * value:g}%" if self.relative else f"{value:g}"

        match self.kind:
            case Kind.NORMAL:
                return f"{word(self.mean)}+-{word(self.deviation)}"
            case Kind.CHOICES:
                return ",".join(map(word, self.choices))
        return f"{word(self.low)}..{word(self.high)}{':log' if self.kind is Kind.LOG_UNIFORM else ''}"


def parse_distribution(text: str, place: str) -> Distribution:
    """A distribution from its text: `LOW..HIGH`, `LOW..HIGH:log`, `MEAN+-DEVIATION`, `A,B,C`; a colon stands for the
    two points, as in `simwarp sweep --search`; numbers in % are changes of the value as built.

    Args:
        text: of it.
        place: for the message, such as `--vary KEY`.

    Raises:
        StudyError: it is none of these, its ends are not in order, or a logarithm has none.
    """
    words = text.replace(" ", "")
    if found := re.fullmatch(rf"({NUMBER})(?:\.\.|:)({NUMBER})(:log)?", words):
        (low, high), relative = _numbers(found.groups()[:2], place, text)
        if not low < high:
            raise StudyError(f"{place}: the first number must be below the second one, got {formatted(text)}")
        if found[3] is None:
            return Distribution(kind=Kind.UNIFORM, low=low, high=high, relative=relative)
        if relative or low <= 0.0:
            raise StudyError(f"{place}: a logarithm needs numbers above 0 and no %, got {formatted(text)}")
        return Distribution(kind=Kind.LOG_UNIFORM, low=low, high=high)
    if found := re.fullmatch(rf"({NUMBER})\+-({NUMBER})", words):
        (mean, deviation), relative = _numbers(found.groups(), place, text)
        if not deviation > 0.0:
            raise StudyError(f"{place}: the standard deviation must be above 0, got {formatted(text)}")
        return Distribution(
            kind=Kind.NORMAL, low=mean - CUT * deviation, high=mean + CUT * deviation, mean=mean,
            deviation=deviation, relative=relative,
        )  # fmt: skip
    if re.fullmatch(rf"{NUMBER}(?:,{NUMBER})+", words):
        choices, relative = _numbers(tuple(words.split(",")), place, text)
        if len(set(choices)) < len(choices) or len(choices) > MOST_CHOICES:
            raise StudyError(f"{place}: choices must differ and be at most {MOST_CHOICES}, got {formatted(text)}")
        return Distribution(
            kind=Kind.CHOICES, low=min(choices), high=max(choices), choices=choices, relative=relative
        )  # fmt: skip
    raise StudyError(f"{place}: must be {FORMS}, got {formatted(text)}")


def _numbers(words: tuple[str, ...], place: str, text: str) -> tuple[tuple[float, ...], bool]:
    """Numbers, and whether they are in %. A zero may leave its sign out."""
    marked = {word.endswith("%") for word in words if float(word.rstrip("%")) != 0.0 or word.endswith("%")}
    if len(marked) > 1:
        raise StudyError(f"{place}: numbers must be all in % or none, got {formatted(text)}")
    relative = marked == {True}
    values = tuple(float(word.rstrip("%")) * (0.01 if relative else 1.0) for word in words)
    if not all(map(math.isfinite, values)):
        raise StudyError(f"{place}: numbers must be finite, got {formatted(text)}")
    return values, relative
