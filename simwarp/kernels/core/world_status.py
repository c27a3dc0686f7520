"""Bits of `State.world_status` in device code: those of :class:`~simwarp.core.types.WorldStatus`."""

from __future__ import annotations

from typing import Final

import warp as wp

from simwarp.core.types import WorldStatus

NON_FINITE: Final = wp.constant(int(WorldStatus.NON_FINITE))
"""The world is frozen until it is reset."""
NOT_ASSEMBLED: Final = wp.constant(int(WorldStatus.NOT_ASSEMBLED))
"""The closed loops could not be assembled."""
SINGULAR: Final = wp.constant(int(WorldStatus.SINGULAR))
"""A rate was held for a step, for axes with no mass between them became parallel."""
