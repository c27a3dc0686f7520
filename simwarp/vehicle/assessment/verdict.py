"""A rule, its limit, and whether a run kept to it."""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run kept to a rule.

    Attributes:
        rule: in words, with its standard.
        limit: of the value [`unit`].
        value: of the run; NaN where it did not come to it.
        passed: True if the run kept to the rule.
        unit: of both.
        where: place or moment of the value, such as the cone; empty where there is none to tell.
    """

    rule: str
    limit: float
    value: float
    passed: bool
    unit: str = ""
    where: str = ""

    @property
    def value_text(self) -> str:
        """The value for people."""
        return "not reached" if math.isnan(self.value) else f"{self.value:.3g}"


def at_most(rule: str, value: float, limit: float, unit: str = "", where: str = "") -> Verdict:
    """A verdict that a value is not above its limit; without a value it is not passed."""
    return Verdict(rule=rule, limit=limit, value=value, passed=bool(value <= limit), unit=unit, where=where)


def at_least(rule: str, value: float, limit: float, unit: str = "", where: str = "") -> Verdict:
    """A verdict that a value is not below its limit; without a value it is not passed."""
    return Verdict(rule=rule, limit=limit, value=value, passed=bool(value >= limit), unit=unit, where=where)
