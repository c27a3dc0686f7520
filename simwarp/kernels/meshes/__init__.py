"""Meshes: loads of their elements, their matrix and its factor, links of nodes in the tree."""
