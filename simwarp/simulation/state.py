"""State, Control and Contacts: the arrays that change, world first, shared with whoever looks at them."""

from __future__ import annotations

import numpy as np
import warp as wp

from simwarp.kernels.core.fields import (
    ContactArrays,
    ContactFields,
    ControlArrays,
    ControlFields,
    StateArrays,
    StateFields,
)
from simwarp.model.model import Model


class State(StateFields):
    """State of all worlds. Angular and linear parts are separate arrays; everything is in the world frame.

    Its arrays are declared in `StateFields`. `worlds`: of the model, where these are not all.
    """

    def __init__(self, model: Model, *, worlds: int | None = None) -> None:
        self.arrays = StateArrays()
        self.allocate(model.sizes(worlds=worlds), model.device, "state", self.arrays)

    def copy_from(self, other: State) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))


class Control(ControlFields):
    """Inputs of a step; whoever writes them (Warp, torch) writes the memory that the kernels read.

    Its arrays are declared in `ControlFields`. Force elements of a model, such as tires and engines, write those that
    begin with `element` every step; they add to `body_force`, `body_torque` and `joint_force`.
    """

    def __init__(
        self, model: Model, *, elements: bool = False, implicit: bool = False, worlds: int | None = None
    ) -> None:
        self.arrays = ControlArrays()
        sizes = model.sizes(elements=elements, implicit=implicit, worlds=worlds)
        self.allocate(sizes, model.device, "control", self.arrays)

    def clear(self) -> None:
        """Zeroes every input."""
        for name in self.NAMES:
            getattr(self, name).zero_()


def initial_arrays(model: Model) -> State:
    """The state as built, the same in every world; coordinates still to be measured."""
    state = State(model)
    for name, values in model.initial.items():
        array = getattr(state, name)
        if values.size:
            array.assign(np.repeat(values[None], model.world_count, axis=0))
    return state


class Contacts(ContactFields):
    """The contacts of the last sub-step, at the poses of its start. Slots from `contact_count` on hold old values.

    Its arrays are declared in `ContactFields`. `worlds`: as for `State`.
    """

    def __init__(self, model: Model, *, worlds: int | None = None) -> None:
        self.arrays = ContactArrays()
        self.allocate(model.sizes(worlds=worlds), model.device, "contacts", self.arrays)

    def copy_from(self, other: Contacts) -> None:
        """Copies every array of `other` into this one."""
        for name in self.NAMES:
            wp.copy(getattr(self, name), getattr(other, name))
