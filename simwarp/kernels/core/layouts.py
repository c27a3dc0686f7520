"""The arrays of a Simulation and of a snapshot, from the lengths that they have: known before the first one is made."""

from __future__ import annotations

from collections.abc import Mapping

from simwarp.core.fields import FieldGroup, Size
from simwarp.core.types import ArrayLayout
from simwarp.kernels.core.fields import ContactFields, ControlFields, ReportFields, StateFields


def run_layouts(sizes: Mapping[Size, int]) -> dict[str, ArrayLayout]:
    """State, its initial values, control, contacts and diagnostics of any Simulation."""
    groups = {
        "state": StateFields,
        "initial state": StateFields,
        "control": ControlFields,
        "contacts": ContactFields,
        "diagnostics": ReportFields,
    }
    return _layouts(groups, sizes)


def snapshot_layouts(sizes: Mapping[Size, int]) -> dict[str, ArrayLayout]:
    """The arrays of a snapshot, without the states of force elements and sensors."""
    return _layouts({"state": StateFields, "control": ControlFields, "contacts": ContactFields}, sizes)


def _layouts(groups: Mapping[str, type[FieldGroup]], sizes: Mapping[Size, int]) -> dict[str, ArrayLayout]:
    return {
        f"{label}.{name}": layout for label, group in groups.items() for name, layout in group.layouts(sizes).items()
    }
