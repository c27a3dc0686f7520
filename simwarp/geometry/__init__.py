"""Shapes as data: hulls, height fields and meshes, triangle trees for rays, what meshes look like."""
