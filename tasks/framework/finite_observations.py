"""Observations that are not finite: counted after a reset, and made finite for worlds whose physics broke down."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from simwarp.core.interop import TensorLaunch

from .control_step_kernels import Clocks, Recording, count_bad
from .statistics import EpisodeStatistics


class FiniteObservations:
    """Watch over the observation groups of a task.

    Args:
        groups: name -> (W, ...), as the task returns them.
        statistics: of the episodes: steps in which an observation was not finite are counted there, by world.
        clocks: counters of the episodes.
        recording: of the last steps; of no length: there is none.
    """

    def __init__(
        self, groups: Mapping[str, torch.Tensor], statistics: EpisodeStatistics, clocks: Clocks, recording: Recording
    ) -> None:  # fmt: skip
        counts, first = statistics.bad_groups, len(statistics.terms)
        self._watches = {
            name: TensorLaunch(
                count_bad, len(group),
                [_as_rows(group), index, counts, first + index, clocks, statistics.bad, recording], group.device,
            )
            for index, (name, group) in enumerate(groups.items())
            if group.is_floating_point()
        }  # fmt: skip

    def count(self, groups: Mapping[str, torch.Tensor]) -> None:
        """Count the worlds with NaN or infinity in a group (W, ...)."""
        for name, watch in self._watches.items():
            watch.on(_as_rows(groups[name]))

    def kept(self, groups: Mapping[str, torch.Tensor], broken: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return copies of groups (W, ...), finite in the worlds of a mask (W,) bool."""
        kept = {}
        for name, group in groups.items():
            if group.is_floating_point():
                mask = broken.view(-1, *(1,) * (group.dim() - 1))
                kept[name] = torch.where(mask, torch.nan_to_num(group, 0.0, 0.0, 0.0), group)
            else:
                kept[name] = group.clone()
        return kept


def _as_rows(group: torch.Tensor) -> torch.Tensor:
    """Return an observation (W, ...) as (W, N) float32."""
    return group.flatten(1).float()
