"""Kernels of the sensors: clocks, random numbers, motion, and what each kind measures."""
