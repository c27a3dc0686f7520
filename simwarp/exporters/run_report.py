"""A recorded run as one page of HTML that opens without a network: all pictures and styles are in the file."""

from __future__ import annotations

import base64
import dataclasses
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import Final

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from PIL import Image

from simwarp.core.files import FileError, write_file
from simwarp.exporters.standing_sheet import StandingFact
from simwarp.exporters.vehicle_sheet import Fact, Section
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.results.run_result import Result

SUFFIXES: Final = (".html", ".htm")
DPI: Final = 110
"""Of plots."""

PAGE: Final = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>$title</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; color: #1f2933; max-width: 1100px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; margin: 0 0 .2em; }
h2 { font-size: 1.15em; margin: 2em 0 .6em; border-bottom: 1px solid #cbd2d9; padding-bottom: .2em; }
h3 { font-size: 1em; margin: 0 0 .3em; }
table { border-collapse: collapse; }
td, th { padding: .15em .9em .15em 0; text-align: left; vertical-align: top; overflow-wrap: anywhere; }
th { font-weight: 600; border-bottom: 1px solid #cbd2d9; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; height: auto; display: block; }
.verdict { display: inline-block; font-weight: 700; padding: .15em .7em; border-radius: .3em; color: #fff; }
.pass { background: #1a7f37; } .fail { background: #b42318; } .none { background: #52606d; }
.sheet { display: grid; grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); gap: 1.6em; }
.note { color: #52606d; }
@media print { body { margin: 0; max-width: none; } img, .sheet > div { break-inside: avoid; }
}
</style>
</head>
<body>
<h1>$title</h1>
<p>$verdict</p>
$notes
$body
<p class="note">simwarp $version</p>
</body>
</html>
""")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    """What a page tells.

    Attributes:
        title: heading, vehicle and manoeuvre.
        passed: whether all rules are kept; None where there is none.
        verdicts: rules and whether the run kept to them.
        results: numbers of the run.
        parameters: of the manoeuvre and the run, text by name.
        vehicle: sections of its data sheet.
        portrait: (height, width, 3) picture of the vehicle, None without one.
        figures: plots by their captions.
        notes: warnings such as of an interrupted run.
        caption: what the portrait shows.
        standing: lines of the vehicle as built and at rest; none where it is not known.
    """

    title: str
    passed: bool | None
    verdicts: Sequence[Verdict]
    results: Sequence[Result]
    parameters: Mapping[str, str]
    vehicle: Sequence[Section]
    portrait: npt.NDArray[np.uint8] | None
    figures: Mapping[str, Figure]
    notes: Sequence[str] = ()
    caption: str = "The vehicle as built."
    standing: Sequence[StandingFact] = ()


def check_report(path: Path, option: str) -> None:
    """Refuses names that no page can have.

    Args:
        path: of the page.
        option: that asked for it, such as ``--report``: the errors begin with it.

    Raises:
        FileError: it does not end in .html.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise FileError(f"{option}: the name must end in {SUFFIXES[0]}, got '{path.name}'")


def write_report(report: Report, path: Path) -> None:
    """Writes the page.

    Raises:
        FileError: the path cannot be written to.
        OutputError: the disk did not take it.
    """
    write_file(path, report_page(report))


def report_page(report: Report) -> str:
    """The page as text. All words are escaped, and nothing in it is looked up elsewhere."""
    parts = [
        _section("Verdicts", _verdicts(report.verdicts)),
        _section("Manoeuvre", _facts(Fact(name, text) for name, text in report.parameters.items())),
        _section("Figures", _facts(Fact(item.label, item.value_text, item.unit_text) for item in report.results)),
        *(_section(caption, _image(_figure_bytes(figure), caption)) for caption, figure in report.figures.items()),
        _section("As built and at rest", _standing(report.standing)),
        _section("Vehicle", _vehicle(report)),
    ]
    return PAGE.substitute(
        title=escape(report.title), verdict=_badge(report.passed), version=escape(version("simwarp")),
        notes="\n".join(f'<p class="note">{escape(note)}</p>' for note in report.notes),
        body="\n".join(part for part in parts if part),
    )  # fmt: skip


def _section(title: str, content: str) -> str:
    return f"<h2>{escape(title)}</h2>\n{content}" if content else ""


def _badge(passed: bool | None) -> str:
    kind, word = {True: ("pass", "passed"), False: ("fail", "failed"), None: ("none", "no verdict asked for")}[passed]
    return f'<span class="verdict {kind}">{word}</span>'


def _verdicts(found: Iterable[Verdict]) -> str:
    rows = [
        [item.rule, f"{item.limit:.3g}", item.value_text, item.unit, item.where, "pass" if item.passed else "FAIL"]
        for item in found
    ]
    return _table(("rule", "limit", "value", "unit", "where", "verdict"), rows, numbers=(1, 2)) if rows else ""


def _facts(facts: Iterable[Fact]) -> str:
    rows = [[fact.label, fact.value, fact.unit] for fact in facts]
    return _table((), rows, numbers=(1,)) if rows else ""


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int]) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        marks = [' class="number"' if index in numbers else "" for index in range(len(row))]
        return "".join(f"<{tag}{mark}>{escape(text)}</{tag}>" for mark, text in zip(marks, row, strict=True))

    lines = [f"<tr>{cells('th', head)}</tr>"] if head else []
    lines += [f"<tr>{cells('td', row)}</tr>" for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _vehicle(report: Report) -> str:
    picture = ""
    if report.portrait is not None:
        image = _image(_picture_bytes(report.portrait), "the vehicle as built")
        picture = f'{image}\n<p class="note">{escape(report.caption)}</p>'
    sheets = [f"<div><h3>{escape(part.title)}</h3>\n{_facts(part.facts)}</div>" for part in report.vehicle]
    return f'{picture}\n<div class="sheet">\n' + "\n".join(sheets) + "\n</div>" if sheets or picture else ""


def _standing(facts: Iterable[StandingFact]) -> str:
    rows = [[fact.label, fact.built, fact.standing, fact.unit] for fact in facts]
    head = ("on level ground, wheels on plates that slide", "as built", "at rest", "unit")
    return _table(head, rows, numbers=(1, 2)) if rows else ""


def _image(png: bytes, text: str) -> str:
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def _figure_bytes(figure: Figure) -> bytes:
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=DPI)
    return content.getvalue()


def _picture_bytes(picture: npt.NDArray[np.uint8]) -> bytes:
    content = io.BytesIO()
    Image.fromarray(picture).save(content, format="png", optimize=True)
    return content.getvalue()


def number_text(value: float, unit: str = "") -> str:
    """A parameter for people; "–" of what is not a number."""
    return "–" if math.isnan(value) else f"{value:g} {unit}".rstrip()
