"""Print the requirements of simwarp and of extras, a line each: `python -m scripts.dependencies viewer,mcap`.

An image installs these before simwarp itself, so that they stay in its cache while the code changes. Only the standard
library is used.
"""

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"


def dependencies(extras: Sequence[str]) -> list[str]:
    """Requirements of simwarp with extras.

    Raises:
        ValueError: an extra is not there; the text is one line.
    """
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    known = project["optional-dependencies"]
    if unknown := [extra for extra in extras if extra not in known]:
        raise ValueError(f"no extra '{unknown[0]}'; there are {', '.join(known)}")
    return [*project["dependencies"], *(text for extra in extras for text in known[extra])]


def main() -> int:
    """Print the requirements with the extras of the first argument, which commas separate."""
    words = sys.argv[1] if len(sys.argv) > 1 else ""
    try:
        print(*dependencies([word for word in words.split(",") if word]), sep="\n")
    except ValueError as error:
        print(f"dependencies: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
