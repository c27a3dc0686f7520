"""Type-check the whole repository with the packages laid out as the wheel installs them.

An editable install maps `simwarp.tasks` to the folder `tasks` through an import hook, which type checkers
cannot follow: they would see Any. So the wheel's own tree is built into a folder, the tests and scripts are
put beside it, and mypy reads that. Paths in its messages are turned back into those of the checkout.
"""

import fcntl
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# A fixed place: mypy's cache knows files by path, and a second run takes seconds.
TREE = ROOT / ".mypy_cache" / "tree"
BESIDE = ("tests", "scripts", "benchmarks", "examples")


def lay_out() -> list[str]:
    """Fill TREE and return the names in it to check."""
    shutil.rmtree(TREE, ignore_errors=True)
    build = [sys.executable, "setup.py", "-q", "build_py", "--build-lib", str(TREE)]
    built = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    if built.returncode:
        sys.exit(f"typecheck: could not lay out the packages:\n{built.stderr}")
    targets = ["simwarp"]
    for name in BESIDE:
        if any((ROOT / name).rglob("*.py")):
            shutil.copytree(ROOT / name, TREE / name, ignore=shutil.ignore_patterns("__pycache__"))
            targets.append(name)
    return targets


def main() -> int:
    """Run mypy and show its messages under the checkout's paths."""
    TREE.parent.mkdir(exist_ok=True)
    with (TREE.parent / "lock").open("w") as lock:
        # Two runs in one checkout would pull the tree from under each other.
        fcntl.flock(lock, fcntl.LOCK_EX)
        return check()


def check() -> int:
    """Lay the packages out, check them, and give mypy's exit status."""
    targets = lay_out()
    command = [
        sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"),
        "--cache-dir", str(ROOT / ".mypy_cache"), *targets,
    ]  # fmt: skip
    done = subprocess.run(command, cwd=TREE, capture_output=True, text=True, check=False)
    print(re.sub(r"^simwarp/(tasks|train)/", r"\1/", done.stdout, flags=re.MULTILINE), end="")
    print(done.stderr, end="", file=sys.stderr)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
