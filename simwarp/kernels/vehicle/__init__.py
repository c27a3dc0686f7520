"""Kernels of vehicle driving: inputs, powertrain, path trackers."""
