"""`simwarp doctor --gpu`: every scene on the GPU and on the CPU, then a short training there."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from simwarp.cli import UsageError, one_line
from simwarp.cli.values import LARGEST_COUNT

if TYPE_CHECKING:
    from simwarp.bench.agreement import Agreement

TASK: Final = "pendulum"
ITERATIONS: Final = 5


class GpuTrial:
    """Tries a GPU with what `bench` has, and goes on where something fails.

    Args:
        device: of CUDA, such as `cuda:0`.
        worlds: of each scene.
        console: for the progress and the table.

    Raises:
        UsageError: the device is no GPU that Warp finds, or `worlds` is no number of worlds.
    """

    def __init__(self, device: str, worlds: int, console: Console) -> None:
        import warp as wp

        names = [str(each) for each in wp.get_cuda_devices()]
        if device not in names:
            there = f"there are: {', '.join(names)}" if names else "Warp finds none; `simwarp doctor` looks for reasons"
            raise UsageError(f"--gpu tries a CUDA device, and '{device}' is none that Warp finds; {there}")
        if not 1 <= worlds <= LARGEST_COUNT:
            raise UsageError(f"worlds must be from 1 to {LARGEST_COUNT}, got {worlds}")
        self.device, self.worlds, self.console = device, worlds, console

    def run(self) -> tuple[dict[str, Any], list[str]]:
        """Try everything; facts for the report, and a line for each thing that is wrong."""
        import warp as wp

        from simwarp.bench.agreement import agreement_scenes, compare, disagreements
        from simwarp.bench.machine import describe

        rows: list[Agreement] = []
        wrong: list[str] = []
        scenes = agreement_scenes()
        for index, name in enumerate(scenes):
            with self._step(f"{index + 1}/{len(scenes) + 1} {name}", name, wrong):
                rows.append(compare(name, self.device, self.worlds))
        self.console.print(_table(rows))
        wrong += disagreements(rows)
        training: dict[str, Any] = {}
        with self._step(f"{len(scenes) + 1}/{len(scenes) + 1} training {TASK}", f"training {TASK}", wrong):
            training = self._train()
        facts = {
            "machine": describe(wp.get_device(self.device)),
            "scenes": [dataclasses.asdict(row) for row in rows],
            "training": training,
        }
        return facts, wrong

    @contextlib.contextmanager
    def _step(self, title: str, name: str, wrong: list[str]) -> Iterator[None]:
        """One thing that is tried: an error of any kind is a line of the report, and the next one follows."""
        begin = time.perf_counter()
        self.console.print(f"{title} ...", highlight=False)
        try:
            yield
        except Exception as error:  # noqa: BLE001 - a report of whatever goes wrong
            wrong.append(f"{name}: {type(error).__name__}: {one_line(str(error))}")
            self.console.print(f"  failed: {wrong[-1]}", highlight=False, soft_wrap=True)
        else:
            self.console.print(f"  {time.perf_counter() - begin:.1f} s", highlight=False)

    def _train(self) -> dict[str, Any]:
        """Train for some iterations into a folder that goes away."""
        from simwarp.tasks import task_class
        from simwarp.train import TrainConfig, train

        config = TrainConfig(num_envs=self.worlds, iterations=ITERATIONS, device=self.device)
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            quiet = Console(file=io.StringIO())
            result = train(TASK, config, task_class(TASK).config_type(), root=Path(folder), console=quiet)
        return {"iterations": result.iterations, "env_steps_per_s": result.env_steps_per_s, "cores": os.cpu_count()}


def _table(rows: Sequence[Agreement]) -> Table:
    table = Table(box=SIMPLE_HEAD)
    table.add_column("scene", no_wrap=True)
    for head in ("first step", "position", "frames", "same bits", "agrees"):
        table.add_column(head, justify="right")
    for row in rows:
        frames = "" if row.frames is None else f"{row.frames:.1%}"
        yes = ["no", "yes"]
        table.add_row(
            row.scene, f"{row.seconds:.1f} s", f"{row.position:.1e} m", frames, yes[row.repeats], yes[row.agrees]
        )
    return table
