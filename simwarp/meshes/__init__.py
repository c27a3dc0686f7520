"""Meshes of flexible bodies on the host: elements, materials, the structure of their matrix, tables for kernels."""
