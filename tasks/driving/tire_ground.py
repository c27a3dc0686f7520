"""Ground for tires that are shapes in contact, rigid or flexible: a shape that these meet and nothing else does."""

from __future__ import annotations

from typing import Final

import simwarp as sw

IN_CONTACT: Final = frozenset({"rigid", "flexible"})
"""Templates of tires that are shapes in contact."""
TIRE_GROUP: Final = 1
"""Bit of the collision group of tires in contact, that of shapes by default; chassis have another."""
GRIPPING: Final = sw.Material(friction=10.0)
"""Surface of the ground: tires have the smaller friction, theirs or that of the task (`ContactTires`)."""
CONTACT_ARRAYS: Final = ("shape_friction",)
"""Model parameters that tires in contact write, world by world."""


def stands_on_shapes(spec: sw.vehicle.VehicleSpec) -> bool:
    """Return True if a vehicle's tires are shapes in contact, which need a shape below them."""
    return all(axle.tire.template in IN_CONTACT for axle in spec.all_axles)


def add_flat_ground(builder: sw.ModelBuilder, *, mask: int = TIRE_GROUP) -> int:
    """Add the plane z = 0 for groups of a mask, as built for tires alone: nothing else meets it; returns its shape."""
    return builder.add_shape_plane(name="tire_ground", material=GRIPPING, group=TIRE_GROUP, mask=mask)
