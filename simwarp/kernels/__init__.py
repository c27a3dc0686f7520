"""Warp kernels and device functions, one physics stage per file."""

from simwarp.core.kernel_hashing import hash_functions_once
from simwarp.core.struct_references import pass_structs_by_reference

hash_functions_once()  # before the first of them is declared
pass_structs_by_reference()
