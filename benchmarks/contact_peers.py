"""Ant, stack and pile beside other engines, and what the time of the ant goes to.

    python benchmarks/contact_peers.py [--scenes ant,stack,pile] [--seconds 1.0] [--no-peers] [--out benchmarks/results]

Writes one JSON file per scene, named after it, with the machine and its load, and prints the tables. Engines that are
not installed are named. Exit code 1 when a state was refused.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.bench.measure import Row, SceneRun, measure_scene  # noqa: E402
from simwarp.bench.peers import peer_measures, peer_notes  # noqa: E402
from simwarp.bench.workloads import BenchScene, bench_scenes  # noqa: E402

WORLDS = {"ant": (1, 256, 1024, 4096), "stack": (1, 256, 1024), "pile": (1, 16, 256)}
_PARTS_WORLDS = 256
_PARTS_STEPS = 4
_PARTS_REPEATS = 25


def cpu_us(run: SceneRun, action: Callable[[], object], steps: int) -> float:
    """CPU time of an action per world, the median over repeats from the same start [µs]."""
    times = []
    for _ in range(_PARTS_REPEATS):
        run.restart()
        start = time.process_time()
        for _ in range(steps):
            action()
        times.append((time.process_time() - start) / (steps * run.worlds))
    return 1e6 * statistics.median(times[1:])


def prepared(scene: BenchScene, device: str) -> SceneRun:
    """A run at its start, kernels loaded."""
    run = SceneRun(scene, _PARTS_WORLDS, device, None)
    run.set_motion()
    run.step()
    return run


def breakdown(scene: BenchScene, device: str) -> dict[str, Any]:
    """Breakdown of a step of the ant by its parts, from variants of it that leave parts out [µs per world-step].

    Collision and the motion's torques are launched alone. Free motion is a step in the air, where the solver only
    sees joints. What one iteration adds to that are the rows of the contacts with all that goes with them, what the
    others add is the solve.
    """
    from simwarp import scenes

    run = prepared(scene, device)
    whole = cpu_us(run, run.step, _PARTS_STEPS)
    parts = {"motion": cpu_us(run, run.motion_command.launch, 1)}
    *before, _ = run.sim.physics_commands
    parts["collision"] = sum(cpu_us(run, command.launch, 1) for command in before)
    iterations = float(run.sim.diagnostics.iterations.numpy().mean())
    air = prepared(dataclasses.replace(scene, build=lambda: scenes.ant(ground=False), settle=0.0), device)
    parts["free_motion"] = cpu_us(air, air.sim.step, _PARTS_STEPS)
    solver = dataclasses.replace(scene.solver, max_iterations=1)
    # the same starts: settled with all iterations
    once = SceneRun(dataclasses.replace(scene, solver=solver), _PARTS_WORLDS, device, None)
    once.set_motion_of(run)
    single = cpu_us(once, once.step, _PARTS_STEPS)
    parts["contact_rows"] = single - parts["motion"] - parts["collision"] - parts["free_motion"]
    parts["solve"] = whole - single
    return {
        "worlds": _PARTS_WORLDS,
        "iterations": iterations,
        "whole": whole,
        **parts,
    }


def measure(name: str, device: str, seconds: float, peers: bool) -> dict[str, Any]:
    """All rows of a scene, as `simwarp bench --json` writes them."""
    import warp as wp

    from simwarp.bench.machine import describe

    scene = bench_scenes()[name]
    machine = describe(wp.get_device(device))
    rows = [measure_scene(scene, count, device, None, seconds) for count in WORLDS[name]]
    measures = peer_measures(name) if peers else []
    others = [one(scene, count, device, None, seconds) for one in measures for count in WORLDS[name]]
    result: dict[str, Any] = {
        "scene": name,
        "kind": "scene",
        "machine": machine,
        "rows": [dataclasses.asdict(row) for row in rows],
        "peers": [dataclasses.asdict(row) for row in others],
        "notes": peer_notes(name) if peers else [],
    }
    if name == "ant":
        result["breakdown_us"] = breakdown(scene, device)
    report(result, rows + others)
    return result


def report(result: dict[str, Any], rows: list[Row]) -> None:
    """Prints the table of a scene."""
    machine = result["machine"]
    print(f"\n{result['scene']}, dt {rows[0].dt:g} s, {machine['gpu'] or machine['cpu']}, load {machine['load_1min']}")
    print(
        f"{'engine':<20}{'worlds':>7}{'steps/s':>11}{'steps/CPU-s':>13}{'contacts':>10}{'iterations':>12}{'B/world':>9}"
    )
    for row in rows:
        numbers = (row.steps_per_s, row.steps_per_cpu_s)
        rates = [f"{value:,.0f}" if value is not None else "refused" for value in numbers]
        means = [f"{value:.1f}" if value is not None else "" for value in (row.contacts, row.iterations)]
        memory = "" if row.bytes_per_world is None else f"{row.bytes_per_world:,}"
        print(f"{row.engine:<20}{row.worlds:>7,}{rates[0]:>11}{rates[1]:>13}{means[0]:>10}{means[1]:>12}{memory:>9}")
        if not row.valid:
            print(f"  refused: {'; '.join(row.problems)}")
    if "breakdown_us" in result:
        parts = result["breakdown_us"]
        words = ", ".join(f"{key} {value:.2f}" for key, value in parts.items() if key not in ("worlds", "iterations"))
        print(f"µs per world-step at {parts['worlds']} worlds, {parts['iterations']:.1f} iterations: {words}")
    for note in result["notes"]:
        print(note)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=",".join(WORLDS))
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results")
    options = parser.parse_args()
    unknown = set(options.scenes.split(",")) - set(WORLDS)
    if unknown:
        parser.error(f"no such scene: {', '.join(sorted(unknown))}; there are {', '.join(WORLDS)}")
    from simwarp.core.warp_start import start_warp

    start_warp()
    options.out.mkdir(parents=True, exist_ok=True)
    sound = True
    for name in options.scenes.split(","):
        result = measure(name, options.device, options.seconds, not options.no_peers)
        (options.out / f"{name}.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
        sound &= all(row["valid"] for row in result["rows"] + result["peers"])
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
