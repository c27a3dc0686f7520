"""Calling pip: the environment it gets, what it could install, and what went wrong in one line.

Only the standard library is used, since this runs before anything is installed.
"""

import os
import re
import subprocess
from collections.abc import Sequence


class PipError(Exception):
    """pip itself does not work; the text is one line."""


def pip_environment() -> dict[str, str]:
    """The user's environment without what would send packages elsewhere, or let pip see those of elsewhere.

    Clusters set PYTHONPATH to packages of their own, containers PIP_CONSTRAINT, or `constraint` in pip's configuration,
    to their own versions. An empty value would leave that of the configuration; an empty file replaces it.
    """
    elsewhere = {"PYTHONPATH", "PYTHONHOME", "PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "PIP_QUIET"}
    kept = {name: value for name, value in os.environ.items() if name not in elsewhere}
    ours = {"PIP_CONSTRAINT": os.devnull, "PIP_USER": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_NO_INPUT": "1"}
    return kept | ours


def pip_reason(output: str) -> str:
    """Reason of a failure, out of pip's whole output."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line.removeprefix("ERROR: ") for line in lines if line.startswith("ERROR: ")]
    telling = [line for line in errors if not line.startswith("ResolutionImpossible")]
    reason = (telling or lines or ["no message"])[-1][:300]
    return f"{reason} (a package index did not answer: no network?)" if "Retrying (Retry(" in output else reason


def offered(pip: Sequence[str], name: str, *arguments: str) -> list[str]:
    """The versions of a package that this pip command would choose from, found without downloading any.

    Asking for a version that cannot be makes pip name those that are, for the same indexes, folders and kinds of
    wheels as when it installs (`pip index` reads another section of its configuration). Unreachable indexes are
    given up soon: pip by itself tries for minutes.

    Raises:
        PipError: If pip says anything else.
    """
    command = [*pip, "--no-deps", "--only-binary=:all:", "--retries", "0", "--timeout", "8", *arguments, f"{name}===0"]
    asked = subprocess.run(
        command, capture_output=True, encoding="utf-8", errors="replace", env=pip_environment(), check=False
    )
    listed = re.search(r"\(from versions: ([^)]*)\)", asked.stderr)
    if listed is None:
        raise PipError(f"pip cannot tell what there is of {name}: {pip_reason(asked.stderr)}")
    return [version.strip() for version in listed.group(1).split(",") if version.strip() != "none"]
