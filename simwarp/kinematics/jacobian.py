"""The Jacobian of a point on a body, in every world of a simulation."""

from __future__ import annotations

from typing import Any, Final

import warp as wp

from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, Vec3, finite_vector, formatted
from simwarp.kernels.core.tables import StepConfig
from simwarp.kernels.dynamics.world import make_scratch
from simwarp.kinematics.jacobian_kernels import measure_point_jacobian
from simwarp.model.checks import checked_index
from simwarp.model.flexible_meshes import refuse_meshes
from simwarp.simulation.simulation import Simulation
from simwarp.simulation.step_sizes import scratch_slots_of, step_sizes

ROWS: Final = 6
"""Three of the velocity, three of the angular velocity."""


class PointJacobian(Readable):
    """Position of a point on a body, and how joint rates move it: v = J[:3] qd, omega = J[3:] qd.

    The columns are those that the step itself works with. Coordinates that do not carry the body have zeros.

    Args:
        simulation: whose state is looked at.
        body: by name or index.
        point: from the body's centre of mass, in its axes [m].

    Attributes:
        position: (W,) vec3d, the point in the world [m].
        jacobian: (W, 6, dofs) float32, world axes: rows of the velocity [m/s], then of the angular velocity [rad/s],
            per unit of `State.joint_qd`.

    Raises:
        ModelError: there is no such body, the point is not finite, or the model has loops or couplings, which tie
            coordinates together.
    """

    def __init__(self, simulation: Simulation, body: str | int, point: Vec3 = (0.0, 0.0, 0.0)) -> None:
        thing = type(self).__name__
        checked_tree(thing, simulation)
        self.simulation = simulation
        self.body = body_index(thing, simulation, body)
        self.point = finite_vector(thing, "point", point, 3)
        model, device = simulation.model, simulation.model.device
        self.position = wp.zeros(model.world_count, dtype=wp.vec3d, device=device)
        self.jacobian = wp.zeros((model.world_count, ROWS, model.dof_count), dtype=wp.float32, device=device)
        every = wp.full(model.world_count, True, dtype=wp.bool, device=device)
        self._command = simulation.shares.record(
            measure_point_jacobian,
            inputs=[
                every, self.body, wp.vec3d(*self.point), StepConfig(), model.topology, model.parameters,
                tree_scratch(simulation), simulation.state.arrays,
            ],
            outputs=[self.position, self.jacobian],
        )  # fmt: skip

    def _readable_title(self) -> str:
        return f" of body '{self.simulation.model.body_names[self.body]}'"

    def update(self) -> None:
        """Measure at the present poses of all worlds; nothing is allocated or read back."""
        self.simulation.shares.run([self._command])


def checked_tree(thing: str, simulation: Any) -> None:
    """A simulation whose coordinates are independent of each other."""
    if not isinstance(simulation, Simulation):
        raise ModelError(f"{thing}: simulation must be a Simulation, got {formatted(simulation)}; pass Simulation(...)")
    refuse_meshes(thing, simulation.model.builder)
    rows = simulation.model.topology.row_count - simulation.model.tables.tree_row_count
    if rows > 0:
        raise ModelError(
            f"{thing}: the model must be a tree without loops and couplings, got {rows} rows that tie its coordinates "
            "together; open the loops"
        )


def body_index(thing: str, simulation: Simulation, body: str | int) -> int:
    """Index of a body, from itself or its name."""
    model = simulation.model
    remedy, count = "pass what add_body returned", model.body_count
    return checked_index(thing, f"body must be a name or in 0..{count - 1}", body, count, model.body, remedy)


def tree_scratch(simulation: Simulation) -> Any:
    """Scratch of the tree's geometry, in as many slots as launches of the simulation take."""
    model = simulation.model
    return make_scratch(model.device, scratch_slots_of(simulation.shares), step_sizes(model, 0, False))
