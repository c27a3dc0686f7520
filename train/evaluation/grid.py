"""Evaluation over a grid of configurations: which points there are, how far they have come, what came out."""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from simwarp.core.stopping import StopRequest
from simwarp.tasks import Driver, Task, TaskConfig

from ..networks.policies import Policy
from ..runs.progress_display import LiveLine, duration
from .driven_paths import DrivenPaths, PathRecorder
from .evaluation import CHECK_INTERVAL, EpisodeRecords, Evaluation, EvaluationCallback, evaluate_policies

POLICY_NAMES = {"policy": "policy", "zero": "zero action", "random": "random"}
"""Labels of the policies of :func:`evaluate_policies`."""

LEVEL = "level"
"""Key of a grid, and of results, that stands for the curriculum's level, unless a task has a field of that name."""

_LEAST = 0.02
"""Share of an evaluation from which its time is judged: before, kernels are compiled."""


@dataclasses.dataclass(frozen=True)
class GridPoint:
    """One combination of values.

    Attributes:
        values: field of the task's configuration -> its value; empty where there is no grid.
        config: the whole configuration.
        level: of the curriculum in [0, 1].
    """

    values: Mapping[str, Any]
    config: TaskConfig
    level: float = 1.0

    @property
    def label(self) -> str:
        """``obstacles = 30, hills = 0.5``."""
        return ", ".join(f"{key} = {value_text(value)}" for key, value in self.values.items())


def has_curriculum(config: TaskConfig) -> bool:
    """Return True if a training moves the level of a task, or a range opens with it."""
    grows = any(each.grows for each in config.uncertainty.randomise.values())
    return grows or config.curriculum.driver is not Driver.NONE


@dataclasses.dataclass
class PointResult:
    """Result at a point.

    Attributes:
        point: the point.
        evaluations: by policy, those that were finished; ``policy`` is always there.
        paths_driven: paths of the policy's first episodes; None where the task is nowhere.
        seconds: it took, building the worlds included.
    """

    point: GridPoint
    evaluations: dict[str, Evaluation]
    paths_driven: DrivenPaths | None
    seconds: float

    @property
    def evaluation(self) -> Evaluation:
        """Of the policy."""
        return self.evaluations["policy"]

    def as_json(self) -> dict[str, Any]:
        """Return plain values: those of the point, the usual keys, and the baselines by name."""
        plain = self.evaluation.as_json()
        usual = {field.name for field in dataclasses.fields(Evaluation)}
        # A metric of the same name as a key gives way
        plain = {key: value for key, value in plain.items() if key in usual or key not in self.point.values}
        baselines = {name: value.as_json() for name, value in self.evaluations.items() if name != "policy"}
        # A task without a curriculum may have a metric of that name, which has it still where no level was asked for
        own = LEVEL in plain and self.point.level == 1.0 and not has_curriculum(self.point.config)
        level = {} if own or LEVEL in self.point.values else {LEVEL: self.point.level}
        return {**self.point.values, **plain, **level, **({"baselines": baselines} if baselines else {})}


class EvaluationStoppedError(Exception):
    """An evaluation was asked to stop in the middle.

    Attributes:
        where: the point and the policy, in words.
        ended: number of its episodes that were over.
        end_reasons: reasons of their ends. Short episodes end first, so that shares of these mislead.
    """

    def __init__(self, where: str, ended: int, end_reasons: dict[str, int]) -> None:
        super().__init__(where)
        self.where = where
        self.ended = ended
        self.end_reasons = end_reasons


def value_text(value: Any) -> str:
    """Return a value as people read it."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def words(key: str) -> str:
    """Return the name of a field as people read it."""
    return key.replace("_", " ").replace(".", ": ")


def axes_of(points: list[GridPoint]) -> dict[str, list[Any]]:
    """Return the values of each key, in the order in which they come."""
    keys = list(points[0].values) if points else []
    return {key: list(dict.fromkeys(point.values[key] for point in points)) for key in keys}


class GridDisplay(LiveLine):
    """Shows which point of how many is evaluated, and how long the rest takes.

    Args:
        console: for the output.
        points: number of points.
        policies: number of policies at each of them.
        episodes: of each policy.
    """

    def __init__(self, console: Console, points: int, policies: int, episodes: int) -> None:
        super().__init__(console, points * policies)
        self._runs = points * policies
        self._points, self._policies, self._episodes = points, policies, episodes
        self._done = 0
        self._spent = 0.0
        self._last = time.monotonic()
        if points == 1:
            # A short evaluation needs no line: the first one comes when it turns out to be long
            self._last_line = self._last

    def building(self, label: str) -> None:
        """Show that the worlds of a point are built."""
        where = f"{label}  " if label else ""
        self.show(self._head(self._done // self._policies + 1), f"{where}building worlds", self._done)

    def running(self, label: str, policy: str, ended: int, share: float) -> None:
        """Show that a policy is evaluated.

        Args:
            label: of the point.
            policy: name of the policy.
            ended: episodes that are over.
            share: of the longest time that they could take.
        """
        part = max(ended / self._episodes, share)
        left = self._left(time.monotonic() - self._last, part)
        where = f"{label}  " if label else ""
        who = f"{POLICY_NAMES[policy]}  " if self._policies > 1 else ""
        text = f"{where}{who}{part:.0%}  {ended}/{self._episodes} episodes{left}"
        self.show(self._head(self._done // self._policies + 1), text, self._done + min(part, 1.0))

    def _left(self, busy: float, part: float) -> str:
        """Words on the time that the rest takes; none where too little is done to tell."""
        if part >= _LEAST:
            whole = busy / part
            runs = self._runs - self._done - 1
            seconds = whole - busy + runs * (self._spent / self._done if self._done else whole)
        elif self._done:
            seconds = max(self._spent / self._done * (self._runs - self._done) - busy, 0.0)
        else:
            return ""
        return f"  ETA {'' if self._done else 'below '}{duration(seconds)}"

    def run_done(self) -> None:
        """Count a policy at a point."""
        now = time.monotonic()
        self._spent += now - self._last
        self._last = now
        self._done += 1

    def point_done(self, result: PointResult) -> None:
        """Print what came out at a point, where there are several."""
        self._last = time.monotonic()
        if self._points == 1:
            return
        value = result.evaluation
        low, high = value.success_ci95
        ends = ", ".join(f"{reason} {count}" for reason, count in value.end_reasons.items())
        self.say(
            f"{self._head(self._done // self._policies)}  {result.point.label}  success {value.success_rate:.1%}"
            f" ({low:.1%} - {high:.1%})  return {value.mean_return:.1f}  {ends}  {duration(result.seconds)}"
        )

    def _head(self, number: int) -> str:
        return f"point {number}/{self._points}" if self._points > 1 else "evaluating"


class _Watch(EvaluationCallback):
    """Observer that updates the display, checks for a stop, and passes steps to a path recorder."""

    def __init__(
        self, point: GridPoint, policy: str, episodes: int, display: GridDisplay, stop: StopRequest,
        recorder: PathRecorder | None,
    ) -> None:  # fmt: skip
        self._point, self._policy, self._episodes = point, policy, episodes
        self._display, self._stop, self._recorder = display, stop, recorder
        self._reasons: list[str] = []
        self._longest = 1

    def begin(self, task: Task[Any]) -> None:
        self._reasons = task.end_reasons
        self._longest = task.config.max_episode_steps * -(-self._episodes // (task.num_worlds * task.agents))
        if self._recorder is not None:
            self._recorder.begin(task)

    def step(self, step: int, tally: EpisodeRecords) -> None:
        if self._stop.requested:
            parts = (self._point.label, POLICY_NAMES[self._policy] if self._policy != "policy" else "")
            where = ", ".join(part for part in parts if part)
            raise EvaluationStoppedError(where, tally.ended(), tally.reasons_so_far(self._reasons))
        if step % CHECK_INTERVAL == 0:
            self._display.running(self._point.label, self._policy, tally.ended(), step / self._longest)

    def warn(self, text: str) -> None:
        where = f"{self._point.label}: " if self._point.label else ""
        self._display.say(f"{where}{POLICY_NAMES[self._policy]}: {text}")

    def end(self, tally: EpisodeRecords) -> None:
        if self._recorder is not None:
            self._recorder.end(tally)
        self._display.run_done()


@dataclasses.dataclass(frozen=True, kw_only=True)
class GridSettings:
    """Settings of the evaluation, the same at every point.

    Attributes:
        episodes: of each policy.
        seed: of the worlds: the same at all points, so that they differ in nothing else.
        device: canonical device name.
        num_envs: worlds stepped together; None: as many as the episodes fill, at most 4096.
        baselines: True if doing nothing and chance are evaluated too.
        capture: control steps are captured into a CUDA graph, where there is a CUDA device.
        paths_driven: True if the paths of the policy's first episodes are noted.
        kept: file for the steps that led to a value of the task that is not finite; None keeps none.
    """

    episodes: int
    seed: int
    device: str = "cpu"
    num_envs: int | None = None
    baselines: bool = False
    capture: bool = True
    paths_driven: bool = True
    kept: Path | None = None


def _watch(
    point: GridPoint, settings: GridSettings, display: GridDisplay, stop: StopRequest, recorder: PathRecorder | None,
    policy: str,
) -> EvaluationCallback:  # fmt: skip
    """Return who looks on at a policy; only the paths of the trained one are noted."""
    return _Watch(point, policy, settings.episodes, display, stop, recorder if policy == "policy" else None)


def evaluate_grid(
    task_name: str,
    make_policy: Callable[[Task[Any]], Policy],
    points: list[GridPoint],
    settings: GridSettings,
    *,
    results: list[PointResult],
    display: GridDisplay,
    stop: StopRequest,
    after: Callable[[], None] = lambda: None,
) -> None:
    """Evaluate a policy at one point after the other; the task is built anew for each.

    Args:
        task_name: a registered task.
        make_policy: builds the policy for a task.
        points: points to evaluate.
        settings: settings of the evaluation.
        results: takes what comes out, as soon as it is known.
        display: shows how far the work has come.
        stop: asks to leave.
        after: called after each point.

    Raises:
        EvaluationStoppedError: ``stop`` asked for it; ``results`` holds what had been finished.
    """
    for point in points:
        if stop.requested:
            raise EvaluationStoppedError(point.label, 0, {})
        display.building(point.label)
        recorder = PathRecorder() if settings.paths_driven else None
        begun = time.monotonic()
        found: PointResult | None = None

        for policy, evaluation in evaluate_policies(
            task_name, make_policy, config=point.config, episodes=settings.episodes, seed=settings.seed,
            device=settings.device, num_envs=settings.num_envs, baselines=settings.baselines, capture=settings.capture,
            watch=functools.partial(_watch, point, settings, display, stop, recorder), kept=settings.kept,
            level=point.level,
        ):  # fmt: skip
            if found is None:
                found = PointResult(point, {}, recorder.paths_driven if recorder is not None else None, 0.0)
                results.append(found)
            found.evaluations[policy] = evaluation
            found.seconds = time.monotonic() - begun
        if found is not None:
            display.point_done(found)
        after()
