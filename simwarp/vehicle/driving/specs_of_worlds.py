"""Configurations of a force element: one for all worlds, or one for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import plural
from simwarp.vehicle.spec.parts import refuse

Kind = TypeVar("Kind")


def specs_of_worlds(given: Kind | Sequence[Kind], kind: type[Kind], worlds: int) -> tuple[Kind, ...]:
    """The one configuration of all worlds, or those of each in their order.

    Args:
        given: a configuration, or a sequence of them.
        kind: their class.
        worlds: number of worlds.

    Raises:
        SpecError: there are neither one nor as many as worlds.
    """
    specs = (given,) if isinstance(given, kind) else tuple(given) if isinstance(given, Sequence) else ()
    if len(specs) not in (1, worlds):
        rule = f"one for all worlds, or one for each of {plural(worlds, 'world')}"
        raise refuse(kind.__name__, rule, len(specs))
    return specs


def per_world(values: Sequence[float], worlds: int) -> npt.NDArray[np.float64]:
    """(W,) values of the configurations of `specs_of_worlds`."""
    return np.array(np.broadcast_to(np.asarray(values, np.float64), worlds))
