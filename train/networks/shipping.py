"""Putting a trained policy into the package: ``python -m simwarp.train.networks.shipping RUN``, from a checkout.

Writes ``shipped/TASK.pt`` (the actor alone) and ``shipped/TASK.json`` (command, revision, versions, what it reached);
``TASK.OBS`` where the task has a choice of observations, ``TASK.OBS.soil`` where it was trained on soil.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from simwarp.core.files import read_json
from simwarp.tasks import task_class

from ..config import task_config_from_plain
from ..evaluation.evaluation import evaluate_with_baselines
from ..runs.checkpoint import SUFFIX, inference_only, save_checkpoint
from ..runs.run_files import write_json
from ..runs.run_folder import PROVENANCE, open_run
from .policies import SHIPPED, network_policy

_EPISODES = 256
_SEED = 1_000_003


def ship(run: Path, target: Path = SHIPPED) -> dict[str, Any]:
    """Evaluate the newest checkpoint of a run and write it, with its provenance, to ``target``."""
    folder = open_run(run)
    content = inference_only(folder.load_latest()[1])
    name = content["task"]
    results = evaluate_with_baselines(
        name,
        lambda task: network_policy(content, task),
        config=task_config_from_plain(task_class(name), content["task_config"]),
        episodes=_EPISODES,
        seed=_SEED,
    )
    made = read_json(folder.path / PROVENANCE, PROVENANCE)
    record = {
        "task": name,
        "iterations": content["iteration"],
        **made,
        "evaluation": {"seed": _SEED} | {key: value.as_json() for key, value in results.items()},
    }
    target.mkdir(exist_ok=True)
    trained = content["task_config"]
    soil = "soil" if trained.get("soil", "none") != "none" else None
    title = ".".join(part for part in (name, trained.get("obs"), soil) if part is not None)
    save_checkpoint(target / f"{title}{SUFFIX}", content)
    write_json(target / f"{title}.json", record)
    return record


if __name__ == "__main__":
    print(json.dumps(ship(Path(sys.argv[1]))["evaluation"], indent=2))
