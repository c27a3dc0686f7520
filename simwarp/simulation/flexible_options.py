"""FlexibleOptions: the numbers of flexible parts."""

from __future__ import annotations

import dataclasses
from typing import Annotated

from simwarp.core.constraints import Ge, Le, Meaning
from simwarp.model.rules import Configuration


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlexibleOptions(Configuration):
    """Numbers of rods and other flexible parts (docs/flexible.md); `sw.flex.Options`.

    Attributes:
        numerical_damping: of what is elastic in them, 0 to 1, beside `SolverOptions.numerical_damping` of springs and
            drives: 1 is backward Euler, 0 the trapezoidal rule, 0.1 damps what is too fast for the step, and little
            else.

    Raises:
        ModelError: a value lies outside its domain.
    """

    numerical_damping: Annotated[float, Ge(0.0), Le(1.0), Meaning("a share, 0.1 by default")] = 0.1
