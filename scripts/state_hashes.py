"""SHA-256 of final states, recorded runs, sensor outputs and trained policies: what a change of shape must not change.

    .venv/bin/python -m scripts.state_hashes before.json       # at the old commit
    .venv/bin/python -m scripts.state_hashes after.json --against before.json
    .venv/bin/python -m scripts.state_hashes after.json --only "drive m113"     # those alone; the file keeps its others

Compilers and processors round differently: both files come from one machine.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import numpy.typing as npt

from simwarp.cli import main as command

WORLDS = 3
STEPS = 300
ITERATIONS = 10
SPACING = ["--spacing=0.04"]
"""Of the soil's nodes: a distance that suits the narrowest wheels of all vehicles."""
ON_CHAINS = [
    "m113 --maneuver=accelerate --duration=2", "m113 --maneuver=obstacle --duration=3.8",
    "m113 --driveline=simple --maneuver=pivot --duration=2", "m113-double-pin --maneuver=accelerate --duration=1",
]  # fmt: skip
"""Runs shoe by shoe, which takes some 3 s of a core for 1 s."""
Wanted = Callable[[str], bool]
"""Whether a hash of this name, or one that begins so, is asked for."""


def digest(arrays: dict[str, npt.NDArray[Any]]) -> str:
    """Return the hash of arrays, with their types and shapes; names do not count, but their order does."""
    found = hashlib.sha256()
    for array in arrays.values():
        array = np.ascontiguousarray(array)
        found.update(f"{array.dtype.str}{array.shape}".encode())
        found.update(array.tobytes())
    return found.hexdigest()[:16]


def scenes(wanted: Wanted) -> Iterator[tuple[str, str]]:
    """Yield the state, contacts and memory of every scene after some steps of its benchmark."""
    from simwarp.bench.measure import SceneRun
    from simwarp.bench.workloads import bench_scenes

    for name, scene in bench_scenes().items():
        if not wanted(f"scene {name}"):
            continue
        run = SceneRun(scene, WORLDS, "cpu", None)
        run.set_motion()
        for _ in range(STEPS if name != "pile" else 20):
            run.sim.step()
        yield f"scene {name}", digest({key: array.numpy() for key, array in run.sim.snapshot().arrays().items()})


def recorded(wanted: Wanted) -> Iterator[tuple[str, str]]:
    """Yield every recorded run of the reference that is shipped, repeated."""
    from simwarp.verify.vehicle_cases import read_shipped
    from simwarp.verify.vehicle_runs import repeat

    for case in read_shipped():
        if wanted(f"recorded {case.title}"):
            yield f"recorded {case.title}", digest(repeat(case, "cpu").columns)


def drives(folder: Path, wanted: Wanted) -> Iterator[tuple[str, str]]:
    """Yield runs of every vehicle with every one of its tires, drivelines and engines, and of every manoeuvre."""
    for words in [*wheeled(), *tracked()]:
        title = f"drive {' '.join(words)}"
        if not wanted(title):
            continue
        if command(["drive", words[0], "--device=cpu", *words[1:], f"--csv={folder}/run.csv"]):
            sys.exit(f"{title} failed")
        text = (folder / "run.csv").read_bytes()
        yield title, hashlib.sha256(text).hexdigest()[:16]


def wheeled() -> Iterator[list[str]]:
    """Yield the words of all runs on wheels."""
    from simwarp.vehicle.driving.maneuvers import MANEUVERS
    from simwarp.vehicle.spec.variants import option_names
    from simwarp.vehicle.spec.vehicle_files import vehicle_names

    for name in vehicle_names():
        for part in ("tire", "powertrain", "driveline"):
            for choice in option_names(name, part):
                soil = SPACING if "soil" in choice else []
                yield [name, "--maneuver=step-steer", f"--{part}={choice}", "--duration=16", *soil]
        if name in ("sedan", "hmmwv-reduced"):
            yield from ([name, f"--maneuver={maneuver}"] for maneuver in MANEUVERS)


def tracked() -> Iterator[list[str]]:
    """Yield the words of all runs on tracks: some shoe by shoe, and all manoeuvres on belts."""
    from simwarp.vehicle.driving.track_maneuvers import TRACK_MANEUVERS

    yield from (words.split() for words in ON_CHAINS)
    for maneuver in TRACK_MANEUVERS:
        if maneuver not in ("obstacle", "trench"):  # which belts refuse
            yield ["m113-belt", f"--maneuver={maneuver}"]
    yield ["m113-belt", "--driveline=simple", "--maneuver=pivot"]


def sensors(folder: Path, wanted: Wanted) -> Iterator[tuple[str, str]]:
    """Yield what each sensor of the demonstration measures, and its picture."""
    if not wanted("sensor "):
        return
    data, picture = folder / "sensors.npz", folder / "sensors.png"
    if command(["sensor-demo", "--device=cpu", f"--data={data}", f"--out={picture}"]):
        sys.exit("sensor-demo failed")
    with np.load(data) as archive:
        for name in sorted(archive.files):
            yield f"sensor {name}", digest({name: archive[name]})
    yield "sensor picture", hashlib.sha256(picture.read_bytes()).hexdigest()[:16]


def policies(folder: Path, wanted: Wanted) -> Iterator[tuple[str, str]]:
    """Yield the networks of every task after some iterations, by exact state and by camera."""
    from simwarp.tasks import task_class, task_names
    from simwarp.train.runs.checkpoint import load_checkpoint

    for name in task_names():
        observations: Any = get_type_hints(task_class(name).config_type).get("obs", ())
        kinds = [None, "camera"] if "camera" in [each.value for each in observations] else [None]
        for kind in kinds:
            if not wanted(f"policy {name} {kind or 'state'}"):
                continue
            runs = folder / f"{name}-{kind}"
            words = ["train", name, "--device=cpu", "--num-envs=4", "--steps-per-iteration=8", "--seed=5"]
            words += ["--threads=1", f"--iterations={ITERATIONS if kind is None else 2}", f"--runs={runs}"]
            words += [] if kind is None else [f"--task.obs={kind}"]
            if command(words):
                sys.exit(f"training of {name} failed")
            checkpoint = load_checkpoint(max(runs.rglob("*.pt"), key=lambda path: path.stat().st_mtime))
            parts = [checkpoint["actor_state_dict"], checkpoint["critic_state_dict"]]
            arrays = {f"{i}{key}": value.numpy() for i, part in enumerate(parts) for key, value in part.items()}
            yield f"policy {name} {kind or 'state'}", digest(arrays)


def main() -> int:
    """Write the hashes; compare them where asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--only", default="", help="how the names begin that are hashed; others stay in the output")
    options = parser.parse_args()
    only: str = options.only
    found: dict[str, str] = {}
    if only and options.output.exists():
        found = json.loads(options.output.read_text(encoding="utf-8"))

    def wanted(name: str) -> bool:
        return name.startswith(only) or only.startswith(name)

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for part in (
            scenes(wanted), recorded(wanted), drives(place, wanted), sensors(place, wanted), policies(place, wanted)
        ):  # fmt: skip
            for name, value in part:
                found[name] = value
                print(f"{value}  {name}", flush=True)
                options.output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.against is None:
        return 0
    before = json.loads(options.against.read_text(encoding="utf-8"))
    before = before.get("hashes", before)
    differing = sorted(name for name in before.keys() | found.keys() if before.get(name) != found.get(name))
    print(f"{len(before)} hashes before, {len(differing)} differ" + "".join(f"\n  {name}" for name in differing))
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
