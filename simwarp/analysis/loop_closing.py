"""Assembly of mechanisms from a rough start: coordinates at which all loops close, or the joints that stay apart."""

from __future__ import annotations

import dataclasses
from typing import Any, Final, NamedTuple

import numpy as np

from simwarp.analysis.variations import Array, checked_simulation
from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, WorldStatus
from simwarp.model.checks import whole_number
from simwarp.simulation.joint_errors import joint_errors
from simwarp.simulation.simulation import Simulation

CLOSED: Final = 1e-5
"""Error of a joint that counts as closed [m or rad]."""
SPREAD: Final = 0.1
"""Standard deviation of the first other start [m or rad]; it grows with every further one."""


class JointGap(NamedTuple):
    """A joint that is not closed: its name, and how far apart it is [m] and turned [rad]."""

    joint: str
    travel: float
    angle: float

    def __str__(self) -> str:
        parts = [f"{self.travel * 1e3:.3g} mm apart"] if self.travel > CLOSED else []
        parts += [f"{self.angle:.3g} rad off"] if self.angle > CLOSED else []
        return f"joint '{self.joint}' is {' and '.join(parts)}"


@dataclasses.dataclass(frozen=True, repr=False)
class Assembly(Readable):
    """How a mechanism was assembled.

    Attributes:
        starts: (W,) which start closed the loops: 0 is the given one.
        q: (W, dofs) coordinates [m or rad].
    """

    starts: tuple[int, ...]
    q: Array

    def _readable_title(self) -> str:
        return f": {len(self.starts)} worlds, the given start closed {sum(start == 0 for start in self.starts)} of them"


def assemble(simulation: Simulation, q: Any = None, *, starts: int = 16, seed: int = 0) -> Assembly:
    """Close the loops of every world near coordinates that need not fit together; rates become zero.

    `set_joint_state` runs Newton's method from the given coordinates. Where it does not end, it runs from others around
    them, farther and farther away.

    Args:
        simulation: whose state is replaced.
        q: (W, dofs), or (dofs,) for all worlds [m or rad]; the present ones when None.
        starts: how many are tried.
        seed: of the other starts.

    Raises:
        ModelError: loops of a world do not close from any start: lists its joints that stay apart, the widest first.
            The state is then the one that was there.
    """
    thing = "assemble"
    sim = checked_simulation(thing, simulation)
    count = whole_number(thing, "starts", starts, 1, 10**6, "16 is the default")
    model = sim.model
    kept = sim.snapshot()
    given = sim.state.joint_q.numpy() if q is None else np.broadcast_to(q, (model.world_count, model.dof_count))
    near = np.array(given, np.float64)
    draws = np.random.default_rng(seed)
    reached, found = near.copy(), np.full(model.world_count, -1)
    gaps: dict[int, list[JointGap]] = {}
    for start in range(count):
        tried = near + start * SPREAD * draws.standard_normal(near.shape) * (found < 0)[:, None]
        tried[found >= 0] = reached[found >= 0]
        sim.restore(kept)
        sim.set_joint_state(None, tried.astype(np.float32), None)
        closed = sim.state.world_status.numpy() & int(WorldStatus.NOT_ASSEMBLED) == 0
        new = closed & (found < 0)
        found[new], reached[new] = start, sim.state.joint_q.numpy()[new]
        if start == 0:
            gaps = {int(world): joint_gaps(sim, int(world)) for world in np.flatnonzero(~closed)}
        if (found >= 0).all():
            return Assembly(tuple(map(int, found)), sim.state.joint_x.numpy().copy())
    sim.restore(kept)
    world = int(np.flatnonzero(found < 0)[0])
    raise ModelError(
        f"{thing}: loops of world {world} do not close from {count} starts: "
        f"{', '.join(map(str, gaps[world][:8])) or 'no joint is far apart'}; check lengths and frames, or start nearer"
    )


def joint_gaps(simulation: Simulation, world: int) -> list[JointGap]:
    """Joints of a world that are not closed, the widest first."""
    model = simulation.model
    errors = joint_errors(model, simulation.state, np.array([world]))
    rows = [
        JointGap(name, float(errors.travel[0, joint]), float(errors.angle[0, joint]))
        for joint, name in enumerate(model.joint_names)
    ]
    return sorted((row for row in rows if max(row.travel, row.angle) > CLOSED), key=lambda row: -max(row[1:]))
