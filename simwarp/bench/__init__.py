"""`simwarp bench`: how fast a scene or a task runs, told only where its final state is sound."""

from __future__ import annotations


def main(arguments: list[str]) -> int:
    """Run the command; 1 where a final state was refused."""
    from simwarp.cli.benching import run

    return run(arguments)
