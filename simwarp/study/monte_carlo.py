"""A manoeuvre in many worlds whose vehicles differ by chance: what comes out, and what it depends on."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from simwarp.core.files import replacing
from simwarp.core.wording import suggestions
from simwarp.statistics.proportions import wilson_interval
from simwarp.study.draws import drawn_worlds
from simwarp.study.study_error import StudyError
from simwarp.study.study_figures import MARGIN, Figure, figures_of
from simwarp.study.study_summary import FigureSummary, summary_of
from simwarp.study.varied_vehicle import VariedVehicle
from simwarp.study.world_runs import WorldRuns
from simwarp.vehicle.assessment.maneuver_variants import Outcome

USUAL_BATCH: Final = 64
"""Worlds of one simulation on a CPU, of which rows are kept when a study is interrupted."""
DEVICE_BATCH: Final = 1024
"""On a GPU."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class StudyRow:
    """One world of a study.

    Attributes:
        world: its index.
        values: of the keys.
        figures: by key; NaN where the run did not come to it.
        passed: whether all rules were kept; None without rules.
        trouble: why its figures do not count: it diverged, or cannot be built; empty of a sound one.
    """

    world: int
    values: tuple[float, ...]
    figures: Mapping[str, float]
    passed: bool | None
    trouble: str

    @property
    def sound(self) -> bool:
        """Whether its figures count."""
        return not self.trouble


@dataclasses.dataclass(frozen=True, kw_only=True)
class Worst:
    """By which figure worlds are the worst.

    Attributes:
        key: of the figure.
        least: whether small values are bad.
    """

    key: str
    least: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class StudyResult:
    """What a study found so far.

    Attributes:
        keys: names of what was varied.
        figures: that runs have.
        nominal: figures of the vehicle as built.
        rows: of the worlds that are done, in their order.
        factors: names of keys whose values are factors of what is built; values of others are as in the file.
    """

    keys: tuple[str, ...]
    figures: tuple[Figure, ...]
    nominal: Mapping[str, float]
    rows: tuple[StudyRow, ...]
    factors: frozenset[str] = frozenset()

    @property
    def sound(self) -> tuple[StudyRow, ...]:
        """Rows whose figures count."""
        return tuple(row for row in self.rows if row.sound)

    def column(self, key: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(N,) of a figure in the sound rows."""
        return np.array([row.figures.get(key, math.nan) for row in self.sound], float)

    def summaries(self) -> list[FigureSummary]:
        """Of each figure."""
        values = np.array([row.values for row in self.sound], float).reshape(-1, len(self.keys))
        return [
            summary_of(each, self.nominal.get(each.key, math.nan), self.column(each.key), values)
            for each in self.figures
        ]

    def passes(self) -> tuple[int, int, tuple[float, float]] | None:
        """Worlds that passed, worlds that were judged, and Wilson's interval of their share at 95 %; a world that
        diverged or cannot be built has not passed. None without rules.
        """
        if all(row.passed is None for row in self.rows):
            return None
        good = sum(row.passed is True for row in self.rows)
        return good, len(self.rows), wilson_interval(good, len(self.rows))

    def worst(self, by: Worst, count: int) -> list[StudyRow]:
        """The worst worlds: those that diverged, then those that did not come to the figure, then by its value."""

        def order(row: StudyRow) -> tuple[bool, bool, float, int]:
            value = row.figures.get(by.key, math.nan)
            known = not math.isnan(value)
            return row.sound, known, (value if by.least else -value) if known else 0.0, row.world

        return sorted(self.rows, key=order)[:count]

    def write_rows(self, path: Path) -> None:
        """A CSV file with a row for each world.

        Raises:
            OutputError: the disk did not take it.
        """
        names = [figure.key for figure in self.figures]
        with replacing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["world", *self.keys, *names, "passed", "trouble"])
            for row in self.rows:
                values = [
                    f"{value:.9g}" for value in (*row.values, *(row.figures.get(name, math.nan) for name in names))
                ]
                verdict = "" if row.passed is None else int(row.passed)
                writer.writerow([row.world, *values, verdict, row.trouble])


class MonteCarlo:
    """A study of one vehicle and manoeuvre.

    Args:
        vehicle: with the keys that are varied.
        worlds: how many.
        seed: of the draws.
        dt: time step [s].
        device: of the simulations.
        batch: most worlds of one simulation; None: as the device has it. No result depends on it.

    Attributes:
        runs: that drive documents.
        nominal: what became of the vehicle as built.
    """

    def __init__(
        self, vehicle: VariedVehicle, *, worlds: int, seed: int, dt: float, device: str, batch: int | None = None
    ) -> None:
        self.vehicle, self.worlds, self.seed = vehicle, worlds, seed
        self.runs = WorldRuns(vehicle=vehicle, dt=dt, device=device)
        self.batch = batch or (USUAL_BATCH if device.startswith("cpu") else DEVICE_BATCH)
        self.nominal: Outcome | None = None
        self._figures: dict[str, Figure] = {}
        self._rows: list[StudyRow] = []

    def drive_nominal(self) -> None:
        """Drive the vehicle as built, from which the figures are known.

        Raises:
            StudyError: it breaks down.
        """
        (found,) = self.runs.run([self.vehicle.document])
        if isinstance(found, str):
            raise StudyError(found)
        if found.broken:
            raise StudyError(f"{self.vehicle.maneuver}: the vehicle as built breaks down; take a smaller --dt")
        self.nominal = found
        self._learn(found)

    def _learn(self, outcome: Outcome) -> None:
        for key, item in figures_of(outcome).items():
            if not math.isnan(item.value):
                self._figures.setdefault(key, Figure(key, item.label, item.unit))

    @property
    def judged(self) -> bool:
        """Whether the manoeuvre has rules."""
        return self.nominal is not None and bool(self.nominal.verdicts)

    def worst_by(self, text: str | None) -> Worst:
        """A figure by which worlds are the worst, `KEY` where large is bad, `KEY:least` where small is.

        Args:
            text: of an option; None: the margin to the rules.

        Raises:
            StudyError: there is no such figure, or there are no rules.
        """
        if text is None:
            if not self.judged:
                raise StudyError(
                    f"--worst: {self.vehicle.maneuver} has no rules to tell what is worst; give --worst-by with one of "
                    f"{', '.join(self._figures)}"
                )
            return Worst(key=MARGIN, least=True)
        key, _, word = text.partition(":")
        if word not in ("", "least", "greatest"):
            raise StudyError(f"--worst-by: must be FIGURE or FIGURE:least, got '{text}'")
        self.require_figure(key, "--worst-by")
        return Worst(key=key, least=word == "least" or (word == "" and key == MARGIN))

    def require_figure(self, key: str, option: str) -> None:
        """Refuse a figure that the manoeuvre does not have.

        Raises:
            StudyError: so it is.
        """
        if key not in self._figures:
            known = ", ".join(self._figures)
            hint = suggestions(key, self._figures, f"it has {known}")
            raise StudyError(f"{option}: '{key}' is no figure of {self.vehicle.maneuver}; {hint}")

    def steps(self, progress: Callable[[float], None] | None = None) -> Iterator[StudyResult]:
        """Drive all worlds, batch after batch, and tell after each what is known.

        Args:
            progress: called with the worlds that are done, whole or in part.
        """
        for first in range(0, self.worlds, self.batch):
            count = min(self.batch, self.worlds - first)
            values = drawn_worlds(self.vehicle, self.seed, first, count)
            shown = None if progress is None else _counted(progress, first, count)
            found = self.runs.run([self.vehicle.changed(row) for row in values], shown)
            for offset, (row, outcome) in enumerate(zip(values, found, strict=True)):
                self._rows.append(self._row(first + offset, row, outcome))
            yield self.result()

    def _row(self, world: int, values: tuple[float, ...], outcome: Outcome | str) -> StudyRow:
        judged = self.judged
        if isinstance(outcome, str):
            return StudyRow(world=world, values=values, figures={}, passed=False if judged else None, trouble=outcome)
        self._learn(outcome)
        figures = {key: item.value for key, item in figures_of(outcome).items()}
        trouble = f"diverged at {float(outcome.run['t_s'][-1]):.2f} s" if outcome.broken else ""
        return StudyRow(
            world=world, values=values, figures={} if outcome.broken else figures,
            passed=outcome.passed if judged else None, trouble=trouble,
        )  # fmt: skip

    def result(self) -> StudyResult:
        """What is known."""
        nominal = {} if self.nominal is None else {k: item.value for k, item in figures_of(self.nominal).items()}
        return StudyResult(
            keys=tuple(key.name for key in self.vehicle.keys), figures=tuple(self._figures.values()), nominal=nominal,
            rows=tuple(self._rows), factors=frozenset(key.name for key in self.vehicle.keys if key.factor),
        )  # fmt: skip


def _counted(progress: Callable[[float], None], first: int, count: int) -> Callable[[float], None]:
    return lambda share: progress(first + share * count)


def rows_of(result: StudyResult) -> list[dict[str, Any]]:
    """For JSON."""
    return [_plain_row(row, result.keys) for row in result.rows]


def _plain_row(row: StudyRow, keys: Sequence[str]) -> dict[str, Any]:
    return {
        "world": row.world, "values": dict(zip(keys, row.values, strict=True)), "figures": dict(row.figures),
        "passed": row.passed, "trouble": row.trouble,
    }  # fmt: skip
