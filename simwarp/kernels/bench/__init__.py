"""Kernels that only benchmarks launch."""
