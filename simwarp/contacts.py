"""Contacts: what touches what in every world, the impulses found there, and the forces that they add up to."""

from __future__ import annotations

from typing import Any

import warp as wp

from simwarp.kernels.tables import ContactArrays
from simwarp.model import Model


class Contacts:
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

    def __init__(self, model: Model) -> None:
        worlds, device = model.world_count, model.device
        capacity = model.contact_capacity

        def zeros(count: int, dtype: Any) -> wp.array:
            return wp.zeros((worlds, count), dtype=dtype, device=device)

        self.contact_count = wp.zeros(worlds, dtype=wp.int32, device=device)
        self.contact_overflow = wp.zeros(worlds, dtype=wp.int32, device=device)
        self.contact_shape0 = zeros(capacity, wp.int32)
        self.contact_shape1 = zeros(capacity, wp.int32)
        self.contact_feature = zeros(capacity, wp.int32)
        self.contact_normal_w = zeros(capacity, wp.vec3)
        self.contact_gap = zeros(capacity, wp.float32)
        self.contact_arm0 = zeros(capacity, wp.vec3)
        self.contact_arm1 = zeros(capacity, wp.vec3)
        self.contact_impulse = zeros(capacity, wp.vec3)
        self.contact_moment = zeros(capacity, wp.vec3)
        self.contact_force_w = zeros(capacity, wp.vec3)
        self.shape_contact_force = zeros(model.shape_count, wp.vec3)
        self.body_contact_force = zeros(model.body_count if model.shape_count else 0, wp.vec3)
        self.penetration = wp.zeros(worlds, dtype=wp.float32, device=device)
        self.arrays = ContactArrays()
        for name in self.NAMES:
            setattr(self.arrays, name, getattr(self, name))

    def copy_from(self, other: Contacts) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))
