"""What became of the trials of extras: kept in JSON, and the table that docs/installation.md shows.

`python -m scripts.extra_results` writes the table between `<!-- extras that were tried -->` and
`<!-- end of extras -->` anew, from benchmarks/results/extras.json.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results" / "extras.json"
PAGE = ROOT / "docs" / "installation.md"
BLOCK = re.compile(r"(<!-- extras that were tried -->\n).*?(<!-- end of extras -->)", re.DOTALL)
CORE = "core"
ENDS = ("floor", "ceiling")


class ExtraError(Exception):
    """An extra does not hold what pyproject.toml says of it; the text is one line."""


@dataclass(frozen=True)
class Outcome:
    """What became of a trial."""

    extra: str
    at: str
    requirements: list[str]
    """What pyproject.toml said of the extra; of `core`, of simwarp."""
    versions: dict[str, str]
    """Versions of these packages, in the order of the requirements."""
    torch: str
    python: str
    date: str
    passed: int
    skipped: int
    failed: int
    error: str
    """Why there was no trial, or why it does not count; otherwise empty."""
    wall_s: float

    @property
    def holds(self) -> bool:
        """Whether the extra holds at this end."""
        return not self.error and not self.failed

    @property
    def text(self) -> str:
        """The outcome in words."""
        counts = {"passed": self.passed, "skipped": self.skipped, "failed": self.failed}
        said = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
        return "; ".join(part for part in (said, self.error) if part)


def requirements(extra: str) -> list[str]:
    """What pyproject.toml says of an extra, or of simwarp itself."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: list[str] = project["dependencies"] if extra == CORE else project["optional-dependencies"][extra]
    return found


def named(extra: str) -> list[Requirement]:
    """The requirements of an extra that apply on this machine, but for torch."""
    wanted = [Requirement(text) for text in requirements(extra)]
    return [each for each in wanted if each.name != "torch" and (each.marker is None or each.marker.evaluate())]


def read(file: Path) -> list[Outcome]:
    """Outcomes of a file; none where there is no file.

    Raises:
        ExtraError: it holds anything else.
    """
    if not file.exists():
        return []
    try:
        return [Outcome(**each) for each in json.loads(file.read_text(encoding="utf-8"))]
    except (OSError, ValueError, TypeError) as error:
        raise ExtraError(f"{file}: no outcomes of extras ({error}); move it or name another file") from None


def merged(outcomes: Sequence[Outcome], new: Outcome) -> list[Outcome]:
    """Outcomes with a new one in the place of the earlier one of the same trial."""
    kept = [each for each in outcomes if (each.extra, each.at) != (new.extra, new.at)]
    return [*kept, new]


def write(file: Path, outcomes: Sequence[Outcome]) -> None:
    """Write outcomes; the file is whole at any time."""
    draft = file.with_name(f"{file.name}.part")
    draft.write_text(json.dumps([asdict(each) for each in outcomes], indent=1) + "\n", encoding="utf-8")
    draft.replace(file)


def done(outcomes: Sequence[Outcome], extra: str, at: str) -> bool:
    """Whether an extra holds at an end by what pyproject.toml says now."""
    tried = [each for each in outcomes if (each.extra, each.at) == (extra, at)]
    return any(each.holds and each.requirements == requirements(extra) for each in tried)


def versions_text(outcome: Outcome) -> str:
    """Packages of an extra with their versions."""
    return ", ".join(f"{name} {version}" for name, version in outcome.versions.items())


def summary(outcomes: Sequence[Outcome]) -> str:
    """A line for each outcome, in columns."""
    rows = [(each.extra, each.at, each.text, versions_text(each)) for each in outcomes]
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    lines = ["  ".join([*map(str.ljust, row[:3], widths), row[3]]).rstrip() for row in rows]
    return "\n".join(lines)


def table(outcomes: Sequence[Outcome], extras: Sequence[str]) -> str:
    """The table of the page, in Markdown: a row for each extra, which says so where none passed yet."""
    by_trial = {(each.extra, each.at): each for each in outcomes}
    lines = ["| extra | floor | tests | ceiling | tests | on |", "|---|---|---|---|---|---|"]
    for extra in extras:
        ends = [by_trial.get((extra, at)) for at in ENDS]
        cells = [cell for each in ends for cell in (("", "not passed yet") if each is None else cells_of(each))]
        dates = ", ".join(sorted({each.date for each in ends if each is not None}))
        lines.append(f"| {' | '.join([f'`{extra}`', *cells, dates])} |")
    return "\n".join(lines) + "\n"


def cells_of(outcome: Outcome) -> tuple[str, str]:
    """Versions and tests, as cells of the table."""
    return versions_text(outcome), outcome.text.replace("|", "/")


def with_table(page: str, outcomes: Sequence[Outcome], extras: Sequence[str]) -> str:
    """The page with its table made anew."""
    made = table(outcomes, extras)
    return BLOCK.sub(lambda match: f"{match[1]}{made}{match[2]}", page)


def known_extras() -> list[str]:
    """`core` and the extras of pyproject.toml that users ask for, in its order."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [CORE, *(name for name in project["optional-dependencies"] if name != "dev")]


def main() -> int:
    """Write the page."""
    try:
        page = with_table(PAGE.read_text(encoding="utf-8"), read(RESULTS), known_extras())
    except ExtraError as error:
        print(f"extra_results: {error}", file=sys.stderr)
        return 1
    PAGE.write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
