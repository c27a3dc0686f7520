"""Options of the modules whose kernels cast rays."""

from typing import Any, Final

from simwarp.core.struct_references import BY_REFERENCE

RAY_MODULE_OPTIONS: Final[dict[str, Any]] = {
    "enable_backward": False,
    "max_unroll": 0,
    # A call that is not inlined copies the structs of scene and geometry, 3 kB, for every ray. With Warp's own
    # threshold of 9000 the search for a hit is too long to be inlined.
    "cpu_compiler_flags": (
        "-march=native -mllvm=-inline-threshold=200000 -mllvm=-inline-cold-callsite-threshold=200000"
        f" -mllvm=-slp-recursion-max-depth=4 {BY_REFERENCE}"
    ),
}
"""Of `wp.set_module_options`."""
