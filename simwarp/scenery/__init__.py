"""Scenery made by computing: rocks, plants, cones, barriers, corridors, tracks, hills, textures, vehicle bodies.

Makers are pure functions of their arguments, one of which is a seed where something is random: the same arguments give
the same arrays. Lengths are metres, Z is up, X forward, Y left; colours are linear albedos. Whatever stands on the
ground has its origin in the middle of its foot, at ground level.
"""
