"""A row of the report: expected value, value of the engine, and tolerance."""

from __future__ import annotations

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True)
class CheckResult:
    """One quantity of one scene.

    Attributes:
        scene: name of the scene.
        quantity: measured quantity, with its unit.
        expected: the known answer; 0 for an error.
        got: the engine's.
        tolerance: largest |got - expected| that passes.
    """

    scene: str
    quantity: str
    expected: float
    got: float
    tolerance: float

    @property
    def passed(self) -> bool:
        """True if the answer is within the tolerance; False for NaN."""
        return bool(abs(self.got - self.expected) <= self.tolerance)

    def as_dict(self) -> dict[str, Any]:
        """The row with the keys that scripts rely on."""
        return {**dataclasses.asdict(self), "pass": self.passed}


def near(scene: str, quantity: str, expected: float, got: float, tolerance: float) -> CheckResult:
    """A row for a value with a known answer."""
    return CheckResult(scene, quantity, float(expected), float(got), float(tolerance))


def below(scene: str, quantity: str, got: float, bound: float) -> CheckResult:
    """A row for the size of an error."""
    return near(scene, quantity, 0.0, got, bound)
