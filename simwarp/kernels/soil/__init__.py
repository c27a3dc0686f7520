"""Kernels of deformable ground: pages of nodes, the laws of pressure and shear, wheels pressed into them."""
