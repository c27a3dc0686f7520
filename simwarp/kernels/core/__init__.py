"""Structs and small functions that all kernels share."""
