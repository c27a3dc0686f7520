"""Contacts of parts of a robot by their names: forces, touches, and times in air and in contact.

``feet = task.contacts("FL_foot", "FR_foot")`` in ``setup``; the task brings it up to date in every control step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from simwarp import to_torch
from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.core.types import formatted

from .errors import InputError, near_names
from .rotations import in_world_axes


@dataclasses.dataclass(frozen=True)
class SoilForces:
    """What a soil does to parts of a robot.

    Attributes:
        force: (W, S, 3) on its shapes, axes of the world, as of the last physics step [N].
        rows: name of a shape or body -> which of the S are its own.
    """

    force: torch.Tensor
    rows: Mapping[str, Sequence[int]]


class NamedContacts(Readable):
    """Contacts of N shapes or bodies in W worlds, as of the last physics step of a control step.

    Args:
        names: of shapes, or of bodies: then the sum over their shapes. Each is looked for among shapes first.
        simulation: of the worlds.
        views: of its state.
        period: time of a control step [s].
        threshold: of the force from which on a part touches [N].
        owner: name of the task: the errors name it.
        soil: whose forces on the parts are contacts too; None: there is none.

    Attributes:
        names: in the order of the columns.
        force: (W, N, 3) float32, the sum of contact forces on each part, axes of the world [N].
        touching: (W, N) bool.
        time_in_air: (W, N) float32, since the part touched last or the episode began; 0 while it touches [s].
        time_in_contact: (W, N) float32, since it began to touch; 0 while it does not [s].
        landed: (W, N) float32, where the part began to touch in this control step, the time it was in air before; else
            0 [s].

    Raises:
        InputError: there are no names, one of them is unknown, or the threshold is negative.
    """

    def __init__(
        self, names: tuple[str, ...], simulation: Any, views: Any, period: float, threshold: float, owner: str,
        soil: SoilForces | None = None,
    ) -> None:  # fmt: skip
        if not names or not all(isinstance(name, str) for name in names):
            raise InputError(f"task '{owner}': contacts need names of shapes or bodies, got {formatted(names)}")
        if not threshold >= 0.0:
            raise InputError(f"task '{owner}': threshold of contacts must be 0 N or more, got {formatted(threshold)}")
        self.names = names
        self._period, self._threshold = period, threshold
        model, device, worlds = simulation.model, views.body_v.device, len(views.body_v)
        known = [*model.shape_names, *model.body_names]
        for name in names:
            if name not in known:
                raise InputError(
                    f"task '{owner}': there is no shape or body {formatted(name)} whose contacts could be felt"
                    f"{near_names(name, known)}"
                )
        shapes = [name in model.shape_names for name in names]
        if any(shapes) != all(shapes):
            odd = names[shapes.index(False)]
            raise InputError(
                f"task '{owner}': contacts of shapes and of bodies must be asked for apart, got the body "
                f"{formatted(odd)} among shapes; call contacts twice"
            )
        contacts = simulation.contacts
        self._moving_offsets: torch.Tensor | None = None
        if all(shapes):
            self._source = to_torch(contacts.shape_contact_force)
            columns = [model.shape_names.index(name) for name in names]
            bodies = [int(model.topology.shape_body.numpy()[column]) for column in columns]
            offsets = model.shape_x.numpy()[0, columns]
            if model.shape_x.shape[0] > 1:  # a shift of the centre of mass moves them
                self._moving_offsets = to_torch(model.shape_x)
            if min(bodies) < 0:
                fixed = names[bodies.index(min(bodies))]
                raise InputError(
                    f"task '{owner}': contacts must be of shapes that move, got {formatted(fixed)}, which is "
                    "fixed to the world; ask for those of what touches it"
                )
        else:
            self._source = to_torch(contacts.body_contact_force)
            columns = bodies = [model.body(name) for name in names]
            offsets = [(0.0, 0.0, 0.0)] * len(names)
        self._columns = torch.tensor(columns, device=device)
        self._bodies = torch.tensor(bodies, device=device)
        self._offsets = torch.tensor(offsets, dtype=torch.float32, device=device).expand(worlds, -1, -1)
        self._soil = soil
        rows = [[] if soil is None else soil.rows.get(name, ()) for name in names]
        self._soil_rows = torch.tensor([row for each in rows for row in each], dtype=torch.int64, device=device)
        parts = [part for part, each in enumerate(rows) for _ in each]
        self._soil_parts = torch.tensor(parts, dtype=torch.int64, device=device)
        self._views = views
        size = (worlds, len(names))
        self.force = torch.zeros(*size, 3, device=device)
        self.touching = torch.zeros(size, dtype=torch.bool, device=device)
        self.time_in_air, self.time_in_contact, self.landed = (torch.zeros(size, device=device) for _ in range(3))

    def _readable_title(self) -> str:
        return f": {plural(len(self.names), 'part')}, {plural(len(self.force), 'world')}"

    def _readable_rows(self) -> dict[str, Row]:
        return {"names": Names(len(self.names), self.names)}

    @property
    def phases(self) -> tuple[torch.Tensor, torch.Tensor]:
        """``time_in_air`` and ``time_in_contact``."""
        return self.time_in_air, self.time_in_contact

    def _turned_offsets(self) -> torch.Tensor:
        """Return (W, N, 3) from centres of mass to the parts, axes of the world [m]."""
        moving = self._moving_offsets
        offsets = self._offsets if moving is None else moving[:, self._columns].float()
        return in_world_axes(self._views.body_q[:, self._bodies, 3:], offsets)

    def position(self) -> torch.Tensor:
        """Return (W, N, 3) where the middles of shapes, or the centres of mass of bodies, are in the world [m]."""
        return self._views.body_q[:, self._bodies, :3] + self._turned_offsets()

    def velocity(self) -> torch.Tensor:
        """Return (W, N, 3) the velocities of these points, axes of the world: v + omega x r [m/s]."""
        turning = torch.linalg.cross(self._views.body_omega[:, self._bodies], self._turned_offsets())
        return self._views.body_v[:, self._bodies] + turning

    def follow(self) -> None:
        """Take in the physics of a control step."""
        torch.index_select(self._source, 1, self._columns, out=self.force)
        if self._soil is not None:
            self.force.index_add_(1, self._soil_parts, self._soil.force.index_select(1, self._soil_rows))
        torch.ge(self.force.norm(dim=2), max(self._threshold, 1e-30), out=self.touching)
        self.landed.copy_(self.time_in_air * self.touching)
        self.time_in_air.add_(self._period).masked_fill_(self.touching, 0.0)
        self.time_in_contact.add_(self._period).mul_(self.touching)

    def begin(self, world_mask: torch.Tensor) -> None:
        """Begin an episode in the worlds of a mask (W,) bool: no forces, no touches, no times."""
        for tensor in self.state().values():
            tensor.masked_fill_(world_mask.view(-1, *(1,) * (tensor.dim() - 1)), 0)

    def state(self) -> dict[str, torch.Tensor]:
        """Return the state that a checkpoint keeps: the tensors themselves."""
        kept = ("force", "touching", "time_in_air", "time_in_contact", "landed")
        return {name: getattr(self, name) for name in kept}


class ContactTracker:
    """Contacts by name that a task keeps up to date."""

    def __init__(self) -> None:
        self._all: list[NamedContacts] = []

    def add(self, task: Any, names: tuple[str, ...], threshold: float, soil: SoilForces | None) -> NamedContacts:
        """Track the contacts of further parts; see :meth:`~simwarp.tasks.Task.contacts`."""
        if task.simulation is None:
            raise InputError(f"task '{task.name}': contacts need physics")
        period = task.config.control_dt
        self._all.append(NamedContacts(names, task.simulation, task.views, period, threshold, task.name, soil))
        return self._all[-1]

    def update(self) -> None:
        """Read the forces after the physics of a control step."""
        for contacts in self._all:
            contacts.follow()

    def begin(self, world_mask: torch.Tensor) -> None:
        """Begin an episode in the worlds of a mask (W,) bool."""
        for contacts in self._all:
            contacts.begin(world_mask)

    def state(self) -> dict[str, torch.Tensor]:
        """Return the tensors that a checkpoint keeps, by the names in it."""
        return {
            f"contacts {index} {name}": tensor
            for index, contacts in enumerate(self._all)
            for name, tensor in contacts.state().items()
        }
