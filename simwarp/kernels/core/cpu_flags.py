"""Flags of the CPU's compiler for the large kernels of collision and of the step."""

from typing import Final

INLINE: Final = "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
"""Warp's own flags, which those of a module replace: a call that is not inlined copies its tables, 4 kB each time."""
