"""Kernels of the viewer."""
