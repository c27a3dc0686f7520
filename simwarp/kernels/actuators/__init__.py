"""Kernels of actuators: from controls to efforts and targets."""
