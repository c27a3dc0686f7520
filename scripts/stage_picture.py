"""The picture of the stages in docs/theory.md, made of their tables: `python -m scripts.stage_picture` writes it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from simwarp.kernels.collision.collision_stages import STAGES
from simwarp.kernels.core.stages import Stage
from simwarp.kernels.dynamics.solve_stages import cone_solve
from simwarp.kernels.dynamics.step_stages import step_stages

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "images" / "stages.svg"
WIDTH, HEIGHT, BOX, LEFT = 1040, 34, 190, 20
COLOURS = {True: "#dbe9f6", False: "#ffffff"}
"""Of a box, by whether every model has the stage."""


def tables() -> dict[str, Sequence[Stage]]:
    """Return the stages of each table under its title."""
    return {"collision": STAGES, "step": step_stages([cone_solve(all_solvers=False)])}


def _text(x: int, y: int, words: str, *, style: str = "") -> str:
    return f'<text x="{x}" y="{y}"{style}>{escape(words)}</text>'


def _stage(stage: Stage, y: int) -> Iterator[str]:
    """One box with its name, and what it reads and leaves beside it."""
    always = stage.when is None
    dash = "" if always else ' stroke-dasharray="5 3"'
    yield (
        f'<rect x="{LEFT}" y="{y}" width="{BOX}" height="{HEIGHT - 10}" rx="4" fill="{COLOURS[always]}" '
        f'stroke="#4477aa"{dash}/>'
    )
    yield _text(LEFT + 8, y + 16, stage.name)
    yield _text(LEFT + BOX + 14, y + 10, f"reads {stage.reads}", style=' fill="#555"')
    yield _text(LEFT + BOX + 14, y + 23, f"leaves {stage.writes}")
    if not always:
        condition = (stage.when.__doc__ or "").strip().rstrip(".").replace("\n", " ")
        yield _text(LEFT + BOX + 430, y + 16, f"if: {condition[0].lower()}{condition[1:]}", style=' fill="#4477aa"')


def picture() -> str:
    """Return the SVG."""
    lines: list[str] = []
    y = 10
    for title, stages in tables().items():
        lines.append(_text(LEFT, y + 16, title, style=' font-weight="bold"'))
        y += 26
        for stage in stages:
            lines += _stage(stage, y)
            y += HEIGHT
        y += 10
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y}" width="{WIDTH}" height="{y}" '
        'font-family="sans-serif" font-size="11">'
    )
    return "\n".join([head, f'<rect width="{WIDTH}" height="{y}" fill="#fafafa"/>', *lines, "</svg>", ""])


def main() -> int:
    """Write the picture; exit code 0."""
    PICTURE.write_text(picture(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
