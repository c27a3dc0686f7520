"""Centres of mass that differ by world and episode: a load that sits further ahead, a battery at one side.

Poses of bodies are those of their centres of mass, and what is fixed to a body is placed from there. A centre of mass
that moves by d therefore takes d off the places of the body's shapes and joints; its inertia stays, about the new
centre. Joint coordinates then place the bodies where they were. A body that no joint places, alone or the root of a
tree without a free joint, has its centre itself in the state: that one moves by d, as a point of the rigid body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import torch

import simwarp as sw

from ..framework.errors import InputError
from ..framework.rotations import in_world_axes
from .randomisation_config import Mode, Range, When

CENTRES: Final = ("body_com_x", "body_com_y", "body_com_z")
"""What `randomise` may name: shifts of centres of mass from where they were built, in body axes [m]."""
ARRAYS_OF_CENTRES: Final = ("shape_x", "joint_anchor0", "joint_anchor1")
"""The model parameters that follow."""


def of_centres(ranges: Mapping[str, Range]) -> dict[str, Range]:
    """Return the ranges that are about centres of mass."""
    return {name: spec for name, spec in ranges.items() if name in CENTRES}


class MassCentres:
    """Where the centres of mass of a simulation are.

    Args:
        ranges: of what is drawn, named as in `CENTRES`.
        simulation: whose model has a row for each world of `ARRAYS_OF_CENTRES`.
        owner: whose simulation it is: the errors name it.

    Attributes:
        views: name -> (W, B) float32 tensor of shifts along that axis of the bodies [m].

    Raises:
        InputError: a range is a factor or changes in every step, or something else than shapes and joints is placed
            from the centres of mass.
    """

    def __init__(self, ranges: Mapping[str, Range], simulation: Any, owner: str) -> None:
        model = self._model = simulation.model
        for name, spec in ranges.items():
            if spec.mode is Mode.SCALE:
                raise InputError(f"randomise '{name}': a shift starts from 0; use mode='add' or 'set'")
            if spec.when is When.STEP:
                raise InputError(f"randomise '{name}': a centre of mass jumps with its body; use when='episode'")
        self._simulation = simulation
        others = [type(each).__name__ for each in simulation.elements if not isinstance(each, sw.actuators.Actuators)]
        if others:
            name = next(iter(ranges))
            raise InputError(
                f"randomise '{name}': {others[0]} of {owner} has places on bodies that do not follow; leave it out"
            )
        topology = model.topology
        device = sw.to_torch(model.body_mass).device
        size = (model.world_count, model.body_count)
        self.views = {name: torch.zeros(size, device=device) for name in ranges}
        owners = (topology.shape_body, topology.joint_body0, topology.joint_body1)
        self._parts: list[tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]] = []
        for name, bodies in zip(ARRAYS_OF_CENTRES, owners, strict=True):
            on = bodies.numpy()
            columns = torch.from_numpy(np.flatnonzero(on >= 0)).to(device)
            if len(columns):
                view = sw.to_torch(getattr(model, name))
                body = torch.from_numpy(on[on >= 0].astype(np.int64)).to(device)
                self._parts.append((view, columns, body, view[:, columns].clone()))
        link_body, link_joint = topology.link_body.numpy(), topology.link_joint.numpy()
        roots = link_body[(link_body >= 0) & (link_joint < 0)].astype(np.int64)
        self._unplaced = torch.from_numpy(roots).to(device)
        """Bodies whose place in the world is no joint's: `set_joint_state` leaves them where they are."""
        state = simulation.state
        self._motion = [sw.to_torch(array) for array in (state.body_x, state.body_rot, state.body_v, state.body_omega)]

    def chosen(self, spec: Range, named: torch.Tensor) -> torch.Tensor:
        """Return which bodies a range moves the centres of, (B,) bool: those that are named and have mass.

        Raises:
            InputError: there is none.
        """
        massive = torch.from_numpy(self._model.body_mass.numpy()[0] > 0.0)
        if not (named & massive).any():
            where = f"'{spec.only[0]}'" if spec.only else "any body"
            raise InputError(f"randomise: {where} has no mass whose centre could move; leave it out")
        return named & massive

    def compose(self, mask: torch.Tensor) -> None:
        """Move the centres of the worlds of the mask ((W,) bool), which were just reset, to the present shifts.

        Bodies stay where they were, and move as they did; their centres are elsewhere. Joint coordinates stay, too.
        """
        none = torch.zeros_like(next(iter(self.views.values())))
        shift = torch.stack([self.views.get(name, none) for name in CENTRES], dim=-1).double()
        for view, columns, body, built in self._parts:
            moved = built - shift[:, body]
            view[:, columns] = torch.where(mask.view(-1, 1, 1), moved, view[:, columns])
        if len(self._unplaced):
            self._move_unplaced(shift, mask.view(-1, 1, 1))
        state = self._simulation.state
        self._simulation.set_joint_state(mask, state.joint_q, state.joint_qd)

    def _move_unplaced(self, shift: torch.Tensor, where: torch.Tensor) -> None:
        """Move centres that the state holds: x + R d, and v + omega x R d, the velocity of that point of the body."""
        bodies = self._unplaced
        x, rotation, velocity, spin = (array[:, bodies] for array in self._motion)
        arm = in_world_axes(rotation, shift[:, bodies])
        turning = torch.linalg.cross(spin.double(), arm).to(velocity.dtype)
        self._motion[0][:, bodies] = torch.where(where, x + arm, x)
        self._motion[2][:, bodies] = torch.where(where, velocity + turning, velocity)
