"""The cone problem of one world, and the solvers that work on it."""
