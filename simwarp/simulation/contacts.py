"""Contacts: what touches what in every world, the impulses found there, and the forces that they add up to."""

from __future__ import annotations

import warp as wp

from simwarp.kernels.core.fields import ContactArrays, ContactFields
from simwarp.model.model import Model


class Contacts(ContactFields):
    """The contacts of the last sub-step, at the poses of its start. Slots from `contact_count` on hold old values.

    Its arrays are declared in `ContactFields`.
    """

    def __init__(self, model: Model) -> None:
        self.arrays = ContactArrays()
        self.allocate(model.sizes(), model.device, "contacts", self.arrays)

    def copy_from(self, other: Contacts) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))
