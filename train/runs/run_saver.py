"""The checkpoints of a run: when they are written, and what a request to stop changes about that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import torch

from simwarp.core.stopping import COPIES_WITHIN, StopRequest

from ..algorithm.distributed import shutdown_time
from ..algorithm.learner import Learner
from .run_folder import RunFolder
from .run_lock import RunLock

_SHARE_OF_ROLLOUT: Final = 0.5
"""Share of the time before ``torchrun`` kills that a rollout may still take; the rest is for the checkpoint."""


class RunSaver:
    """Writes checkpoints, so that a request to stop loses nothing that was learnt.

    The iteration under way is finished and saved. Where that takes long, the state before it is saved first: whoever
    asks may not wait so long. Asked once more, the iteration is left. The networks of such a checkpoint are those of
    the iteration before; its worlds, and what was learnt from whole mini-batches, are a part of an iteration on.

    Args:
        trainer: what learns.
        folder: of the run.
        lock: of its first process.
        stop: request to stop.

    Attributes:
        newest: path of the newest checkpoint that was written; None before the first one.
        say: prints a line.
    """

    def __init__(self, trainer: Learner, folder: RunFolder, lock: RunLock | None, stop: StopRequest) -> None:
        self.newest: Path | None = None
        self.say: Callable[[str], None] = lambda text: None
        self._said = False
        self.trainer, self.folder, self.lock, self._stop = trainer, folder, lock, stop
        self._saved = trainer.iteration
        self._longest = _SHARE_OF_ROLLOUT * shutdown_time()
        trainer.interlude = self._interlude

    def save(self) -> None:
        """Write a checkpoint, all processes together, unless there is one of this iteration."""
        if self.trainer.iteration != self._saved:
            self.newest = self._write()
            self._saved = self.trainer.iteration

    def _write(self) -> Path:
        trainer, group = self.trainer, self.trainer.group
        content = trainer.checkpoint()
        if group.first:
            if self.lock is not None:
                self.lock.check()
            self.folder.save(content, trainer.config.keep_checkpoints)
        group.gather(None)  # none goes on before the file is there
        return self.folder.checkpoint_path(content["iteration"])

    def stops(self) -> bool:
        """Return True if any process was asked to stop: all must leave in the same iteration."""
        group = self.trainer.group
        return group.sums({"stop": float(self._stop.requested)}, self.trainer.device)["stop"] > 0.0

    def _interlude(self) -> bool:
        """Do what a request asks for in the middle of an iteration; True if that is to be left."""
        if not self._stop.requested:
            return False
        if self._stop.age >= COPIES_WITHIN and not self._said:
            self._said = True
            self.say(f"stopping after iteration {self.trainer.iteration + 1}, which is saved; again: at once")
        if self.trainer.group.several:  # they save together, once all have left
            return self._stop.at_once or self._stop.age > self._longest
        if self._stop.at_once or self._stop.age >= COPIES_WITHIN:
            with torch.inference_mode(False):
                self.save()
        return self._stop.at_once
