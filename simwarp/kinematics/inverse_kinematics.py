"""Inverse kinematics of a point on a body, in every world of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Final

import numpy as np
import warp as wp

from simwarp.core.array_devices import refuse_elsewhere
from simwarp.core.constraints import Ge, Le, Meaning, Positive
from simwarp.core.object_repr import Readable
from simwarp.core.types import JointType, ModelError, Vec3, finite_vector, formatted
from simwarp.kernels.core.tables import StepConfig
from simwarp.kinematics.inverse_kinematics_kernels import Found, Search, SearchArrays, search_coordinates
from simwarp.kinematics.jacobian import body_index, checked_tree, tree_scratch
from simwarp.model.rules import RULES
from simwarp.simulation.simulation import Simulation
from simwarp.simulation.world_launches import WorldLaunch

ADDITIVE: Final = (
    JointType.REVOLUTE, JointType.PRISMATIC, JointType.CYLINDRICAL, JointType.UNIVERSAL, JointType.PLANAR,
)  # fmt: skip
"""Joints whose coordinates are the integrals of their rates."""


class InverseKinematics(Readable):
    """Joint coordinates that bring a point on a body to a target, by damped least squares within the joints' limits.

    Each iteration takes the step J'(J J' + (e²/2 + damping²) 1)⁻¹ e with the position error e (Levenberg and
    Marquardt with Sugihara's damping, IEEE Trans. Robotics 27, 2011, eq. 27): full steps where the target can be
    reached, short ones at singular poses and beyond the reach. A coordinate at its stop that a step would push further
    is taken out of that step, which is then solved anew. The simulation's state stays as it is.

    Args:
        simulation: whose model and worlds these are; floating bodies stay where its state has them.
        body: by name or index.
        point: from the body's centre of mass, in its axes [m].
        joints: names of the joints that move; all that carry the body when None.
        iterations: most of a search, 1 to 10 000.
        tolerance: distance from the target at which it stops [m].
        damping: of the least squares where the error is small [m/rad].
        longest_step: of a coordinate in one iteration [rad or m].

    Attributes:
        target: (W,) vec3d, where the point should be, in the world [m].
        q: (W, dofs) float32, coordinates that were found; those that do not move are the start's.
        error: (W,) float32, distance that is left [m].
        iterations: (W,) int32, how many there were.

    Raises:
        ModelError: there is no such body or joint, a number is out of its range, the model has loops or couplings, or
            a joint that moves has coordinates that are no integrals of its rates (spherical and free joints).
    """

    @RULES.arguments("InverseKinematics")
    def __init__(
        self, simulation: Simulation, body: str | int, point: Vec3 = (0.0, 0.0, 0.0), *,
        joints: Sequence[str] | None = None,
        iterations: Annotated[int, Ge(1), Le(10_000), Meaning("100, the default")] = 100,
        tolerance: Annotated[Positive, Meaning("metres, 1e-6 by default")] = 1.0e-6,
        damping: Annotated[Positive, Meaning("m/rad, 1e-3 by default")] = 1.0e-3,
        longest_step: Annotated[Positive, Meaning("rad or m, 0.3 by default")] = 0.3,
    ) -> None:  # fmt: skip
        thing = type(self).__name__
        checked_tree(thing, simulation)
        self.simulation = simulation
        self.body = body_index(thing, simulation, body)
        self.point = finite_vector(thing, "point", point, 3)
        search: Any = Search()
        search.body, search.point = self.body, wp.vec3d(*self.point)
        search.iterations, search.tolerance = iterations, tolerance
        search.damping, search.longest = damping, longest_step
        model, device = simulation.model, simulation.model.device
        worlds, dofs = model.world_count, model.dof_count
        search.movable = wp.array(self._movable(thing, joints), dtype=int, device=device)
        arrays: Any = SearchArrays()
        found: Any = Found()
        arrays.column = wp.zeros((worlds, dofs), dtype=wp.vec3d, device=device)
        arrays.turn = wp.zeros((worlds, dofs), dtype=wp.float64, device=device)
        arrays.free = wp.zeros((worlds, dofs), dtype=int, device=device)
        self.target = wp.zeros(worlds, dtype=wp.vec3d, device=device)
        self.q = found.q = wp.zeros((worlds, dofs), dtype=wp.float32, device=device)
        self.error = found.error = wp.zeros(worlds, dtype=wp.float32, device=device)
        self.iterations = found.iterations = wp.zeros(worlds, dtype=wp.int32, device=device)
        self._search, self._arrays, self._found = search, arrays, found
        self._scratch = tree_scratch(simulation)
        self._every = wp.full(worlds, True, dtype=wp.bool, device=device)
        self._command = self.record(self._every, simulation.state.joint_q)

    def _readable_title(self) -> str:
        return f" of body '{self.simulation.model.body_names[self.body]}'"

    def record(self, mask: wp.array, start: wp.array) -> WorldLaunch:
        """Record a search, to be launched with others (`Simulation.program`).

        Args:
            mask: (W,) bool, worlds that it is for.
            start: (W, dofs) float32, coordinates that it begins with.
        """
        simulation, model = self.simulation, self.simulation.model
        return simulation.shares.record(
            search_coordinates,
            inputs=[
                mask, start, self.target, self._search, StepConfig(), model.topology, model.parameters, self._scratch,
                simulation.state.arrays, self._arrays,
            ],
            outputs=[self._found],
        )  # fmt: skip

    def solve(self, start: wp.array | None = None) -> None:
        """Search in all worlds: `q`, `error` and `iterations` of `target`. Nothing is allocated or read back.

        Args:
            start: (W, dofs) float32 on the simulation's device, coordinates to begin with; those of its state when
                None.

        Raises:
            ModelError: the start has another shape or dtype, or lies on another device.
        """
        if start is None:
            start = self.simulation.state.joint_q
        if not isinstance(start, wp.array) or start.shape != self.q.shape or start.dtype != wp.float32:
            given = f"{start.dtype.__name__} {start.shape}" if isinstance(start, wp.array) else formatted(start)
            raise ModelError(
                f"InverseKinematics: start must be a Warp array of float32 of shape {self.q.shape} (worlds, dofs), got "
                f"{given}; leave it out to begin at the present coordinates"
            )
        refuse_elsewhere("InverseKinematics: start must", start, self.simulation.model.device)
        self._command.use(1, start)
        self.simulation.shares.run([self._command])

    def _movable(self, thing: str, joints: Sequence[str] | None) -> Any:
        """(dofs,) 1 where the search may turn a coordinate."""
        model, topology = self.simulation.model, self.simulation.model.topology
        wanted = None if joints is None else {model.joint(name) for name in joints}
        kinds, first = topology.joint_type.numpy(), topology.joint_dof.numpy()
        links = {name: getattr(topology, f"link_{name}").numpy() for name in ("joint", "parent", "type")}
        movable = np.zeros(model.dof_count, np.int32)
        carrying = set()
        link = int(topology.body_link.numpy()[self.body])
        while link >= 0:
            joint = int(links["joint"][link])
            if joint >= 0 and kinds[joint] != JointType.FREE:
                carrying.add(joint)
            link = int(links["parent"][link])
        chosen = carrying if wanted is None else wanted
        for joint in sorted(chosen):
            name = model.joint_names[joint]
            if joint not in carrying:
                raise ModelError(
                    f"{thing}: joints must carry body '{model.body_names[self.body]}', got '{name}'; leave it out"
                )
            if first[joint] < first[joint + 1] and kinds[joint] not in ADDITIVE:
                kind = JointType(int(kinds[joint])).name
                raise ModelError(
                    f"{thing}: joints that move must have coordinates that are integrals of their rates, got '{name}' "
                    f"({kind}); name others in joints"
                )
            movable[first[joint] : first[joint + 1]] = 1
        if not movable.any():
            raise ModelError(
                f"{thing}: a joint must carry body '{model.body_names[self.body]}', got none that moves; "
                "choose another body"
            )
        return movable
