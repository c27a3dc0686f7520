"""Kernels of vehicle driving: inputs, powertrain, path followers."""
