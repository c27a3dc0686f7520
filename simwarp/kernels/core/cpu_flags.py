"""Flags of the CPU's compiler for the large kernels of collision and of the step."""

import hashlib
from pathlib import Path
from typing import Final

from simwarp.core.struct_references import BY_REFERENCE

HEADER: Final = Path(__file__).with_name("array_access.h")
"""Elements of arrays without negative indices, of arrays whose innermost axis is contiguous."""

INLINE: Final = (
    "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
    f" -mllvm=-slp-recursion-max-depth=4 {BY_REFERENCE}"
)
"""Warp's own flags, which those of a module replace. The compiler keeps what follows `-mllvm` in one place for all
threads: only modules with the same compile side by side."""


def array_flags() -> str:
    """Flags that include the header; its digest tells kernels of another version apart in Warp's cache.

    Empty where its path has a blank: Warp splits flags there.
    """
    path = str(HEADER.resolve())
    if any(letter.isspace() for letter in path):
        return ""
    digest = hashlib.sha256(HEADER.read_bytes()).hexdigest()[:8]
    return f"-include {path} -DARRAY_ACCESS={digest}"
