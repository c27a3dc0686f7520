"""What tests of training share."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from simwarp.train.runs import training
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_files import write_run_file


@pytest.fixture(scope="session", autouse=True)
def _one_learning_curve_per_kind() -> Iterator[None]:
    """A short training ends sooner than its curve is drawn: runs of the same columns get the first one's picture."""
    draw = training.draw_learning_curve
    drawn: dict[tuple[str, ...], bytes] = {}

    def draw_once(progress: Path, picture: Path, title: str) -> None:
        rows = read_progress(progress)
        kind = tuple(rows[0]) if rows else ()
        if kind in drawn:
            write_run_file(picture, drawn[kind])
        else:
            draw(progress, picture, title)
            drawn[kind] = picture.read_bytes()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "draw_learning_curve", draw_once)
        yield
