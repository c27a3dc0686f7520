"""Flexible bodies: rods, solids, cloth; their materials."""

from simwarp.flex.materials import Elastic, Rubber

__all__ = ["Elastic", "Rubber"]
