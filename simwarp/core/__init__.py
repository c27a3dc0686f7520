"""Shared by all packages: value types, arrays, rotations, files, memory, the bridge to torch."""
