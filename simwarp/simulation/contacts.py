"""Contacts: what touches what in every world, the impulses found there, and the forces that they add up to."""

from __future__ import annotations

from typing import Any

import warp as wp

from simwarp.core.arrays import FixedAttributes
from simwarp.core.types import ArrayLayout
from simwarp.kernels.core.tables import ContactArrays
from simwarp.model.model import Model


class Contacts(FixedAttributes):
    """The contacts of the last sub-step, at the poses of its start. Slots from `contact_count` on hold old values.

    Attributes:
        contact_count: (W,) int32, slots in use.
        contact_overflow: (W,) int32, contacts left out in the last sub-step for want of slots: the shallowest ones.
            `finalize(contact_capacity=...)` raises the capacity.
        contact_shape0, contact_shape1: (W, C) int32, the shapes, the smaller index first.
        contact_feature: (W, C) int32, tells the contacts of a pair apart from step to step.
        contact_normal_w: (W, C) vec3, from shape 0 to shape 1.
        contact_gap: (W, C) [m], negative is penetration.
        contact_arm0, contact_arm1: (W, C) vec3, from the bodies' centres of mass (the world's origin) to the contact
            points on the two surfaces, world axes [m].
        contact_impulse: (W, C) vec3, along the normal and the two tangents [N·s].
        contact_moment: (W, C) vec3, rolling and spinning impulses about the two tangents and the normal [N·m·s]; in the
            smooth model the displacement (s1, s2, 0) of the tangential spring [m].
        contact_force_w: (W, C) vec3, on shape 1, world axes [N].
        shape_contact_force: (W, S) vec3, sum over a shape's contacts, world axes [N].
        body_contact_force: (W, B) vec3, the same over a body's shapes [N].
        penetration: (W,) deepest penetration [m].
    """

    NAMES = (
        "contact_count", "contact_overflow", "contact_shape0", "contact_shape1", "contact_feature",
        "contact_normal_w", "contact_gap", "contact_arm0", "contact_arm1", "contact_impulse", "contact_moment",
        "contact_force_w", "shape_contact_force", "body_contact_force", "penetration",
    )  # fmt: skip

    contact_count: wp.array
    contact_overflow: wp.array
    contact_shape0: wp.array
    contact_shape1: wp.array
    contact_feature: wp.array
    contact_normal_w: wp.array
    contact_gap: wp.array
    contact_arm0: wp.array
    contact_arm1: wp.array
    contact_impulse: wp.array
    contact_moment: wp.array
    contact_force_w: wp.array
    shape_contact_force: wp.array
    body_contact_force: wp.array
    penetration: wp.array

    def __init__(self, model: Model) -> None:
        self.arrays = ContactArrays()
        for name, layout in self.layouts(model).items():
            array = wp.zeros(layout.shape, dtype=layout.dtype, device=model.device)
            setattr(self, name, array)
            setattr(self.arrays, name, array)
        self._fix()

    @classmethod
    def layouts(cls, model: Model) -> dict[str, ArrayLayout]:
        """The arrays of a model's contacts."""
        worlds = model.world_count
        slots = (worlds, model.contact_capacity)
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "contact_count": ((worlds,), wp.int32),
            "contact_overflow": ((worlds,), wp.int32),
            "contact_shape0": (slots, wp.int32),
            "contact_shape1": (slots, wp.int32),
            "contact_feature": (slots, wp.int32),
            "contact_gap": (slots, wp.float32),
            "shape_contact_force": ((worlds, model.shape_count), wp.vec3),
            "body_contact_force": ((worlds, model.body_count if model.shape_count else 0), wp.vec3),
            "penetration": ((worlds,), wp.float32),
        }
        return {name: ArrayLayout(*shapes.get(name, (slots, wp.vec3))) for name in cls.NAMES}

    def copy_from(self, other: Contacts) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))
