"""`simwarp doctor --warm`: small models first, a line for each, and a failure does not stop the others."""

import io

from rich.console import Console

from simwarp.bench.workloads import bench_scenes, vehicle_row_names
from simwarp.cli import warming
from simwarp.tasks import task_names


def test_all_tasks_are_among_the_subjects_and_small_ones_come_first():
    names = warming.subjects()
    assert names[0] == "pendulum"
    assert len(set(names)) == len(names)
    assert set(task_names()) <= set(names)
    assert set(names) <= {*bench_scenes(), *vehicle_row_names(), *task_names(), warming.FILM}


def test_what_is_compiled_already_is_not_compiled_again_and_failures_are_told(monkeypatch):
    def step(name: str, device: str) -> None:
        if name == "broken":
            raise ValueError("no such thing")

    monkeypatch.setattr("simwarp.bench.compiling.first_step", step)
    out = io.StringIO()
    first, second, third = warming.warm(["one", "broken", "two"], "cpu", Console(file=out, width=200))
    assert (first.modules, first.problem, third.problem) == (0, "", "")
    assert second.problem == "ValueError: no such thing"
    lines = out.getvalue().splitlines()
    assert len(lines) == 6
    assert lines[3] == "2/3 broken: ValueError: no such thing"
