"""Drive by hand in the browser, clone what you drove, and train the clone further.

    python examples/drive_and_clone.py                         # five minutes in the corridor between cones
    python examples/drive_and_clone.py --task barrier-track --minutes 10

A page opens with the vehicle under your keys: W A S D or arrows, Space brakes, R begins anew, a gamepad works too.
What you drove is written to driven.npz when the time is over, or when you press Ctrl-C. Needs: pip install
'simwarp[viewer]'
"""

import argparse
import subprocess
import sys
from pathlib import Path


def simwarp(*arguments: str) -> int:
    """Run one of simwarp's commands; its exit code."""
    print("\n$ simwarp", *arguments, flush=True)
    return subprocess.run([sys.executable, "-m", "simwarp", *arguments]).returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="hallway", help="a driving task")
    parser.add_argument("--minutes", type=float, default=5.0, help="of driving, by the clock")
    parser.add_argument("--speed", default="1", help="times real time")
    parser.add_argument("--epochs", default="200", help="of cloning")
    parser.add_argument("--iterations", default="100", help="of training")
    parser.add_argument("--num-envs", default="64", help="worlds of the training")
    parser.add_argument("--no-open", action="store_true", help="do not open a browser")
    options = parser.parse_args()
    task, driven, cloned = options.task, Path("driven.npz"), Path("cloned.pt")
    driven.unlink(missing_ok=True)

    # 1. One world, driven by hand; observations are exact numbers, which a small network learns from in seconds
    page = ["--drive", "--worlds", "1", "--obs", "state", "--checkpoint", "zero", "--speed", options.speed]
    page += ["--seconds", f"{60.0 * options.minutes:g}", "--record-trajectories", str(driven)]
    code = simwarp("view", task, *page, *["--no-open"] * options.no_open)
    if code not in (0, 130):
        return code
    if not driven.exists():
        print("nobody drove: there is nothing to clone")
        return 0

    # 2. A network that does what you did; 3. one that has learnt from rewards what you did not show
    steps = (
        ("clone", task, "--data", str(driven), "--output", str(cloned), "--epochs", options.epochs),
        ("eval", task, "--checkpoint", str(cloned), "--episodes", "16"),
        ("train", task, "--obs", "state", "--warm-start", str(cloned), "--critic-warmup", "10", "--iterations",
         options.iterations, "--num-envs", options.num_envs),
        ("eval", task, "--obs", "state", "--episodes", "16"),
    )  # fmt: skip
    return next((code for step in steps if (code := simwarp(*step))), 0)


if __name__ == "__main__":
    raise SystemExit(main())
