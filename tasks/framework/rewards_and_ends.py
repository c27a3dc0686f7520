"""Verdict on a control step: the rewards, whether an episode is over and why, and the statistics of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import torch

from simwarp.core.interop import TensorLaunch

from .agents import Agents
from .config import TaskConfig
from .control_step_kernels import Clocks, Recording, Rules, Verdict, judge, judge_agents
from .recorded_launches import filled
from .statistics import EpisodeStatistics
from .step_result import VerdictViews, block_size


class RewardsAndEnds:
    """Device memory of the verdicts, and the launch that writes them.

    Args:
        config: step limit and curriculum of the task.
        terminations: number of its reasons that are ends.
        truncations: number of those that cut off.
        winning: for every reason, also those of the base class, whether it counts as a success.
        own_success: a metric of the task decides about success.
        status: (W,) int32, of the physics; of no length without.
        clocks: counters of the episodes.
        level: (W,) float32, the curriculum's; moved where it climbs.
        statistics: that are kept.
        agents: of the worlds.
        recording: of the last steps; of no length: there is none.

    Attributes:
        ended: (W,) bool, the worlds whose episode is over; the mask of a reset.
        views: of the verdict.
    """

    def __init__(
        self, config: TaskConfig, terminations: int, truncations: int, winning: Sequence[bool], own_success: bool,
        status: torch.Tensor, clocks: Clocks, level: torch.Tensor, statistics: EpisodeStatistics, agents: Agents,
        recording: Recording,
    ) -> None:  # fmt: skip
        worlds, device, count = len(level), level.device, len(statistics.terms)
        self._lead = tuple(agents.done.shape) if agents.several else (worlds,)
        rows = worlds * agents.count
        self._block = torch.zeros(block_size(rows, count), dtype=torch.uint8, device=device)
        self.views = VerdictViews.of(self._block, (rows,), count)
        self.ended = torch.zeros(worlds, dtype=torch.bool, device=device)
        shape = (rows, terminations + truncations)
        self._flags = torch.zeros(shape, dtype=torch.bool, device=device)
        self._won = torch.zeros(rows, dtype=torch.bool, device=device)
        self._climbing = torch.zeros(1, dtype=torch.int32, device=device)
        named = {field.name: getattr(self.views, field.name) for field in dataclasses.fields(VerdictViews)}
        verdict = filled(Verdict, ended=self.ended, terms=named.pop("reward_terms"), **named)
        rules = filled(
            Rules,
            terminal_count=1 + terminations,
            step_limit=config.max_episode_steps,
            winning=torch.tensor(winning, device=device),
            judged=int(own_success),
            climbing=self._climbing,
            up=config.curriculum.up,
            down=config.curriculum.down,
        )
        arguments = [status, self._flags, self._won, rules, clocks, level, verdict, statistics.tally]
        arguments += [statistics.bad, recording]
        if agents.several:
            self._launch = TensorLaunch(judge_agents, worlds, [*arguments, agents.done, agents.acting], device)
        else:
            self._launch = TensorLaunch(judge, worlds, arguments, device)

    def climb(self, climbing: bool) -> None:
        """Let successes move the level, or not."""
        self._climbing.fill_(int(climbing))

    def judge(
        self, rewards: Iterable[torch.Tensor], flags: Sequence[torch.Tensor], success: torch.Tensor | None
    ) -> None:
        """Write the verdict on a step.

        Args:
            rewards: terms in their order, each (W,) float32; (W, N) of several agents, as all that follows.
            flags: reasons to end, then reasons to cut off, in their order, each (W,) bool.
            success: (W,) bool, the metric that tells it, if there is one.
        """
        torch.stack([each.reshape(-1) for each in rewards], dim=1, out=self.views.reward_terms)
        if flags:
            torch.stack([each.reshape(-1) for each in flags], dim=1, out=self._flags)
        if success is not None:
            self._won.copy_(success.reshape(-1))
        self._launch.launch()

    @property
    def broken(self) -> torch.Tensor:
        """(W,) bool, the worlds whose physics broke down in the last step."""
        flags = self.views.non_finite
        return flags if len(self._lead) == 1 else flags.view(self._lead).any(dim=1)

    def hand_out(self) -> VerdictViews:
        """Return a copy of the verdict, which no later step changes."""
        return VerdictViews.of(self._block.clone(), self._lead, self.views.reward_terms.shape[1])
