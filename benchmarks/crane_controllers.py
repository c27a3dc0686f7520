"""The crane under its shipped policy, and under controllers written by hand, in the same worlds.

    python benchmarks/crane_controllers.py [--episodes 512]

`profile` drives boom and trolley over the pad by speeds from which they can brake, lowers the load once it is there,
and knows nothing of swing. `damped` moves the trolley after the load as well, with half of the critical damping, and
waits over the pad until the load is calm. Both see the observations of the policy.

Half as many episodes are in stronger wind, and on other models of the cable: one element in place of six, and sixteen
with half of the step. Writes benchmarks/results/crane.json and prints a table; what is in the file
already is kept.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import torch
import warp as wp

from simwarp.bench.machine import describe
from simwarp.core.files import read_json
from simwarp.tasks import make, replace_fields
from simwarp.tasks.crane import CraneConfig
from simwarp.train import find_policy
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import Policy
from simwarp.train.runs.run_files import write_json

RESULTS: Final = Path(__file__).resolve().parent / "results" / "crane.json"
SEED: Final = 1_000_003
CLEAR: Final = 1.0
"""Height at which the load waits over the pad [m]."""
CREEP: Final = 0.15
"""Speed at which it touches down [m/s]."""
NEAR: Final = 0.15
"""Distance of the trolley from its place at which the load is lowered [m]."""
CALM: Final = 0.12
"""Distance [m] and speed [m/s] of the load with which `damped` lowers it."""
GAIN: Final = 0.5
"""Speed per distance where no braking is in the way [1/s]."""
WITH_SWING: Final = 1.0
"""Speed of the trolley per distance of the load from under it [1/s]: half of the critical damping at 10 m."""


def braking(error: torch.Tensor, speed: float, rise: float) -> torch.Tensor:
    """Return the speed towards an end, from which a drive can stop there, as a share of its largest."""
    size = torch.minimum(GAIN * error.abs(), (2.0 * 0.8 * speed / rise * error.abs()).sqrt())
    return error.sign() * (size / speed).clamp(max=1.0)


def controller(config: CraneConfig, *, damped: bool) -> Policy:
    """Return a controller written by hand.

    Args:
        config: of the task.
        damped: it acts against the swing.
    """
    rises = config.action_rise_time
    rise = rises if isinstance(rises, tuple) else (rises,) * 3

    def act(observations: Mapping[str, torch.Tensor]) -> torch.Tensor:
        seen = observations["policy"]
        place, length, ahead, left = (seen[:, k] for k in (1, 3, 5, 6))
        far = torch.hypot(place + ahead, left)
        turn = torch.atan2(left, place + ahead)
        slew = braking(turn, config.slew_speed, rise[0])
        trolley = braking(far - place, config.trolley_speed, rise[1])
        arrived = (far * turn.abs() < NEAR) & ((far - place).abs() < NEAR)
        height = seen[:, 9]
        if damped:
            off = torch.stack([seen[:, 7], seen[:, 8]], dim=1).norm(dim=1)
            moving = torch.stack([seen[:, 10], seen[:, 11]], dim=1).norm(dim=1)
            # Half of the lean counts: in steady wind the load, not the trolley, should come over the pad
            trolley = braking(-seen[:, 7], config.trolley_speed, rise[1]) + WITH_SWING * length * seen[:, 13]
            slew = braking(-seen[:, 8] / place, config.slew_speed, rise[0])
            slew = slew + WITH_SWING * length * seen[:, 14] / place / config.slew_speed
            arrived = (off < CALM) & (moving < CALM)
        lowest = torch.where(arrived, torch.zeros_like(height), torch.full_like(height, CLEAR))
        hoist = braking(height - lowest, config.hoist_speed, rise[2])
        hoist = torch.where(arrived, hoist.clamp(min=CREEP / config.hoist_speed), hoist)
        return torch.stack([slew, trolley, hoist], dim=1).clamp(-1.0, 1.0)

    return act


def run(policy_of: Callable[[Any], Policy], episodes: int, **changes: Any) -> dict[str, Any]:
    """Evaluate in fresh worlds."""
    config = replace_fields(CraneConfig(), changes)
    task = make("crane", episodes, seed=SEED, config=config)
    found = evaluate(task, policy_of(task), episodes, SEED)
    return {**found.as_json(), "changes": changes}


def main() -> None:
    """Evaluate all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=512)
    episodes = parser.parse_args().episodes

    def shipped(task: Any) -> Policy:
        return find_policy("crane", Path("shipped")).policy(task)

    cases: dict[str, tuple[Callable[[Any], Policy], dict[str, Any]]] = {
        "policy": (shipped, {}),
        "profile": (lambda task: controller(task.config, damped=False), {}),
        "damped": (lambda task: controller(task.config, damped=True), {}),
        "policy, wind to 12 m/s": (shipped, {"wind": 12.0}),
        "damped, wind to 12 m/s": (lambda task: controller(task.config, damped=True), {"wind": 12.0}),
        "policy, 1 element": (shipped, {"cable_elements": 1}),
        "policy, 16 elements, 5 ms": (shipped, {"cable_elements": 16, "dt": 0.005, "decimation": 40}),
    }
    results: dict[str, Any] = read_json(RESULTS, "results")["results"] if RESULTS.is_file() else {}
    for name, (policy_of, changes) in cases.items():
        count = episodes if not changes else episodes // 2
        if results.get(name, {}).get("episodes") != count:
            results[name] = run(policy_of, count, **changes)
            machine = describe(wp.get_device("cpu"))
            write_json(RESULTS, {"task": "crane", "seed": SEED, "machine": machine, "results": results})
        low, high = results[name]["success_ci95"]
        print(
            f"{name:28} {results[name]['success_rate']:6.1%} ({low:.1%} to {high:.1%}) "
            f"{results[name]['mean_episode_length']:6.1f} steps {results[name]['error']:6.3f} m "
            f"{results[name]['touch_speed']:6.3f} m/s {results[name]['end_reasons']}", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    main()
