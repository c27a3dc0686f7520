"""Warp kernels and device functions, one physics stage per file."""

from simwarp.core.kernel_hashing import hash_functions_once

hash_functions_once()  # before the first of them is declared
