"""Signs of runs that other programs recorded, in those of ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

REVERSED: Final = ("omega_",)
"""Begin the names of columns whose recorded sign is the other one: wheel speeds, negative in forward drive."""


def with_iso_signs(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Columns of a recorded run, or means of them, in the signs of ISO 8855, as `Recorder` has them."""
    return {name: -values if name.startswith(REVERSED) else values for name, values in recorded.items()}
