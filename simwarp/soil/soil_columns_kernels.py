"""Columns of a soil's parameters and sizes of its pages: what laws and descriptions share with all kernels of soils."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

SIDE = wp.constant(8)
"""Nodes along a side of a page."""

K_PHI = wp.constant(0)
K_C = wp.constant(1)
EXPONENT = wp.constant(2)
COHESION = wp.constant(3)
TAN_PHI = wp.constant(4)
SHEAR_LENGTH = wp.constant(5)
ELASTIC = wp.constant(6)
DAMPING = wp.constant(7)
DENSITY = wp.constant(8)
PARAMETERS = wp.constant(9)
