"""Puts a trained policy into the package: ``python -m scripts.ship_policy RUN [--nominal [--keep FIELD ...]]``.

Writes ``shipped/TASK.pt`` (the actor alone) and ``shipped/TASK.json`` (command, revision, versions, what it reached);
``TASK.OBS`` where the task has a choice of observations, ``TASK.OBS.soil`` where it was trained on soil,
``TASK.OBS.vehicles`` where it drives several vehicles.

A policy brings the configuration of its worlds with it, where its evaluation begins. With ``--nominal`` that is the
task's own instead of the one that it was trained in, such as worlds that vary, but for the fields of ``--keep``.
``--vehicle`` names the vehicles to evaluate it in where it was trained in reduced ones.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

from simwarp.core.files import read_json
from simwarp.tasks import InputError, config_to_plain, task_class
from simwarp.train.algorithm.distiller import TAUGHT_BY
from simwarp.train.config import task_config_from_plain
from simwarp.train.evaluation.evaluation import evaluate_policies
from simwarp.train.networks.policies import SHIPPED, network_policy
from simwarp.train.runs.checkpoint import SUFFIX, inference_only, save_checkpoint
from simwarp.train.runs.run_files import write_json
from simwarp.train.runs.run_folder import PROVENANCE, open_run

_EPISODES = 256
_SEED = 1_000_003


def ship(
    run: Path, target: Path = SHIPPED, *, nominal: bool = False, keep: Collection[str] = (),
    vehicle: str | None = None, episodes: int = _EPISODES, num_envs: int | None = None, baselines: bool = True,
) -> dict[str, Any]:  # fmt: skip
    """Evaluate the newest checkpoint of a run and write it, with its provenance, to ``target``.

    Args:
        run: folder of the run.
        target: folder of the policies.
        nominal: ship it with the configuration that its task has by default, on the ground that it was trained on.
        keep: fields that are as in the training all the same, such as the tracks that it knows.
        vehicle: what the field ``vehicle`` is in place of the training's.
        episodes: of each evaluation.
        num_envs: worlds stepped together; by default as many as the episodes fill.
        baselines: evaluate the policies that do nothing and that act at random as well.

    Raises:
        InputError: the task has no such field.
    """
    folder = open_run(run)
    whole = folder.load_latest()[1]
    content = inference_only(whole)
    name, trained = content["task"], content["task_config"]
    usual = config_to_plain(task_class(name).config_type())
    varied = {key: value for key, value in trained.items() if usual.get(key) != value}
    for key in keep:
        if key not in usual:
            raise InputError(f"--keep {key}: no field of the configuration of task '{name}'")
    if nominal:
        kept = {key: trained[key] for key in ("obs", "soil", *keep) if key in trained}
        content["task_config"] = usual | kept
    if vehicle is not None:
        content["task_config"] |= {"vehicle": vehicle}
    found = evaluate_policies(
        name,
        lambda task: network_policy(content, task),
        config=task_config_from_plain(task_class(name), content["task_config"]),
        episodes=episodes,
        seed=_SEED,
        num_envs=num_envs,
        baselines=baselines,
    )
    results = dict(found)
    made = read_json(folder.path / PROVENANCE, PROVENANCE)
    record = {
        "task": name,
        "iterations": content["iteration"],
        **made,
        "trained_on": varied,
        **({"teacher": _teacher(whole)} if TAUGHT_BY in whole else {}),
        "evaluation": {"seed": _SEED} | {key: value.as_json() for key, value in results.items()},
    }
    target.mkdir(exist_ok=True)
    soil = "soil" if _on_soil(trained) else None
    several = "vehicles" if "," in (content["task_config"].get("vehicle") or "") else None
    title = ".".join(part for part in (name, trained.get("obs"), soil, several) if part is not None)
    save_checkpoint(target / f"{title}{SUFFIX}", content)
    write_json(target / f"{title}.json", record)
    return record


def _on_soil(config: dict[str, Any]) -> bool:
    """Whether a task's worlds are on soil: of driving tasks the field `soil` says it, of those on legs `ground`."""
    soil = config.get("soil", "none")
    return config.get("ground") == "soil" if isinstance(soil, dict) else soil != "none"


def _teacher(content: dict[str, Any]) -> dict[str, Any]:
    """Return what is told of the teacher of a distillation."""
    teacher = content[TAUGHT_BY]
    return {"obs": teacher["task_config"].get("obs"), "iterations": teacher["iteration"]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("--nominal", action="store_true", help="with the task's configuration by default")
    parser.add_argument("--keep", nargs="*", default=(), metavar="FIELD", help="but for these fields")
    parser.add_argument("--vehicle", help="vehicles in place of the training's")
    parser.add_argument("--episodes", type=int, default=_EPISODES, help="of each evaluation")
    parser.add_argument("--num-envs", type=int, help="worlds stepped together")
    parser.add_argument("--no-baselines", dest="baselines", action="store_false", help="evaluate the policy alone")
    print(json.dumps(ship(**vars(parser.parse_args()))["evaluation"], indent=2))
