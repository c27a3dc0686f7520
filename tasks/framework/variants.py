"""Variants of a task: sets of fields of its configuration, each under a name."""

from __future__ import annotations

import enum
from typing import Any


class Variant(enum.Enum):
    """A task as this project has it, or as the thesis has it from which the tasks come."""

    SIMWARP = "simwarp"
    THESIS = "thesis"


def variant_of(config: Any) -> str | None:
    """Return the variant of a task's configuration (its field ``variant``); None if the task has no variants."""
    variant = getattr(config, "variant", None)
    return str(variant.value) if isinstance(variant, enum.Enum) else None
