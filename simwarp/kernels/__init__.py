"""Warp kernels and device functions, one physics stage per file."""
