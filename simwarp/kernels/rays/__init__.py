"""Rays: trees of triangles, primitives, instances of worlds, nearest and any hits."""
