"""Motion of geometrically exact rods, float64, in absolute coordinates: one assembled system per step.

    (M + h d + h^2 (beta + zeta) K) dv = h (f(x) - (d + zeta h K) v)
    v+ = v + dv,    x+ = x + h v+,    R+ = exp(h w+) R

K and d are the sums of L B^T C B and of tau L B^T C B: rates of strains, so that they do not act in rigid rotation.
With beta = (1 - zeta)^2 / 4, zeta = 1 is the linearly implicit Euler rule and zeta = 0 is of second order. Twist has
(1 + zeta) / 2 for beta + zeta: stress ties it to the motion out of the plane of bending by less than its stiffness as
long as the rod does not buckle, and (4 beta + 2 zeta - 1) K is what may be missing of the matrix.

Masses are lumped. Option `tension` adds the transverse stiffness N / L of stretched elements, and N L a^2 / 8 to the
twist of those that are bent by the angle a besides; both act on dv alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.linalg import solveh_banded

from tests.reference import rods
from tests.reference.rods import Array, Loads, Pose, Rods


@dataclasses.dataclass(frozen=True)
class Rule:
    """How steps are made.

    Attributes:
        h: step [s].
        numerical_damping: zeta, 0 to 1.
        damping_time: tau of the material [s].
        tension: whether stretched elements resist transverse motion, and bent ones of them twist, implicitly.
    """

    h: float
    numerical_damping: float = 0.1
    damping_time: float = 0.0
    tension: bool = True

    @property
    def implicit(self) -> float:
        """beta + zeta."""
        return (1.0 - self.numerical_damping) ** 2 / 4.0 + self.numerical_damping

    @property
    def crossing(self) -> float:
        """What stands for beta + zeta in the transverse stiffness of tension: a tension may double within a step."""
        return 0.5 + self.numerical_damping

    @property
    def lag(self) -> float:
        """Time by which rates of strains act as strains [s]."""
        return self.damping_time + self.numerical_damping * self.h

    @property
    def gain(self) -> Array:
        """(6,) the same of changes of those rates in the step [s]."""
        shares = np.full(6, self.implicit)
        shares[3] = 0.5 + 0.5 * self.numerical_damping
        return self.damping_time + self.h * shares


@dataclasses.dataclass(frozen=True)
class Rows:
    """Equations between nodes, as of a joint.

    Attributes:
        value: (K,) of a pose [m or rad], zero where they hold.
        jacobian: (K, N * 6) its derivative by velocities.
        one_sided: the value may be positive, and what holds it only pushes; one row.
    """

    value: Callable[[Pose], Array]
    jacobian: Callable[[Pose], Array]
    one_sided: bool = False


def coincident(first: int, second: int) -> Rows:
    """Two nodes are at one point, and turn as they like."""

    def jacobian(pose: Pose) -> Array:
        out = np.zeros((3, len(pose.position), 6))
        out[:, second, :3], out[:, first, :3] = np.eye(3), -np.eye(3)
        return out.reshape(3, -1)

    return Rows(lambda pose: pose.position[second] - pose.position[first], jacobian)


def at_distance(node: int, point: Sequence[float], distance: float) -> Rows:
    """A node hangs on a massless rigid link, as on a shackle."""
    centre = np.array(point, float)

    def value(pose: Pose) -> Array:
        return np.array([float(np.linalg.norm(pose.position[node] - centre)) - distance])

    def jacobian(pose: Pose) -> Array:
        out = np.zeros((1, len(pose.position), 6))
        along = pose.position[node] - centre
        out[0, node, :3] = along / np.linalg.norm(along)
        return out.reshape(1, -1)

    return Rows(value, jacobian)


def below(node: int, axis: int, limit: float) -> Rows:
    """A node does not pass a wall."""

    def jacobian(pose: Pose) -> Array:
        out = np.zeros((1, len(pose.position), 6))
        out[0, node, axis] = -1.0
        return out.reshape(1, -1)

    return Rows(lambda pose: np.array([limit - pose.position[node, axis]]), jacobian, one_sided=True)


class Motion:
    """Rods that move.

    Attributes:
        pose: of the nodes.
        velocity: (N, 6) of the positions and the spins, in the world.
        time: [s].
        impulses: of each group of `rows` in the last step, as in the equation J^T impulse.
        acting: (E, 6) N and M that acted in the last step. They are C (eps + (tau + zeta h) eps' + (tau + h (beta +
            zeta)) d eps'): those of the pose alone, C eps, have E A (beta + zeta / 2) (h w)^2 of a rotation w beside
            them, from which the implicit term is subtracted again.
    """

    def __init__(
        self,
        model: Rods,
        pose: Pose,
        rule: Rule,
        *,
        supports: Mapping[int, Sequence[int]] | None = None,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        loads: Loads | None = None,
        driven: Callable[[float], Array] | None = None,
        rows: Sequence[Rows] = (),
    ) -> None:
        """Begins at rest.

        Args:
            model: elements and masses.
            pose: at the start.
            rule: of the steps.
            supports: unknowns held, by node.
            gravity: [m/s^2].
            loads: on the nodes; may be replaced between steps.
            driven: (N, 6) velocities of the held unknowns in the step that ends at a time; they rest without it.
            rows: joints and walls.
        """
        self.model, self.pose, self.rule = model, pose, rule
        self.fixed = rods.held(model, supports or {})
        self.weight = rods.weight(model, gravity)
        self.gravity = np.array(gravity, float)
        self.loads = loads or rods.no_loads(model.nodes)
        self.driven = driven
        self.rows = list(rows)
        self.velocity = np.zeros((model.nodes, 6))
        self.time = 0.0
        self.impulses: list[Array] = []
        self.acting = rods.stresses(model, pose)
        count = model.nodes - 1
        steps = np.stack([np.arange(count), np.arange(1, model.nodes)], axis=1)
        self.chain = len(model.elements) == count and bool(np.all(model.elements == steps))
        self._lower = np.tril_indices(12)
        row, column = self._lower
        self._band = ((row - column) * 6 * model.nodes)[None, :] + model.dofs[:, column]

    def spin_inertia(self) -> Array:
        """(N, 3, 3) of the nodes, in the world."""
        rotation = self.pose.rotation
        return np.einsum("nij,nj,nkj->nik", rotation, self.model.inertia, rotation)

    def _gains(self, strain: Array) -> Array:
        """(E, 6) times by which changes of the rates of strains act as strains, by the strains [s]."""
        gains = np.tile(self.rule.gain, (len(strain), 1))
        if self.rule.tension:
            pull = np.maximum(self.model.stiffness[:, 0] * strain[:, 0], 0.0)
            bend = np.sum(strain[:, 4:] ** 2, axis=1) * self.model.length**2
            gains[:, 3] += self.rule.h * 0.125 * pull * bend * self.model.length**2 / self.model.stiffness[:, 3]
        return gains

    def _element_blocks(self, matrix: Array, strain: Array, gains: Array) -> Array:
        """(E, 12, 12) what elements add to the matrix, by their strains, the derivatives of these, and their gains."""
        model, h = self.model, self.rule.h
        weights = h * gains * model.length[:, None] * model.stiffness
        blocks = matrix.transpose(0, 2, 1) @ (weights[:, :, None] * matrix)
        if self.rule.tension:
            a, b = model.elements.T
            r = self.pose.position[b] - self.pose.position[a]
            size = np.linalg.norm(r, axis=1)
            across = np.eye(3) - r[:, :, None] * r[:, None, :] / (size**2)[:, None, None]
            pull = np.maximum(model.stiffness[:, 0] * strain[:, 0], 0.0)
            term = (h * h * self.rule.crossing * pull / size)[:, None, None] * across
            for first in (0, 6):
                for last in (0, 6):
                    blocks[:, first : first + 3, last : last + 3] += term if first == last else -term
        return blocks

    def _node_blocks(self) -> Array:
        """(N, 6, 6) masses."""
        out = np.zeros((self.model.nodes, 6, 6))
        out[:, (0, 1, 2), (0, 1, 2)] = self.model.mass[:, None]
        out[:, 3:, 3:] = self.spin_inertia()
        return out

    def step(self, count: int = 1) -> None:
        """Makes steps."""
        for _ in range(count):
            self._one()

    def _one(self) -> None:
        h, n = self.rule.h, 6 * self.model.nodes
        model, dofs = self.model, self.model.dofs
        matrix = rods.strain_matrix(model, self.pose)
        # what acts before the change of velocity
        rate = np.einsum("eij,ej->ei", matrix, self.velocity.ravel()[dofs])
        pose_strain = rods.strains(model, self.pose)
        strain = pose_strain + self.rule.lag * rate
        elastic = -np.einsum("eij,ei->ej", matrix, model.length[:, None] * model.stiffness * strain)
        gains = self._gains(pose_strain)
        blocks = self._element_blocks(matrix, pose_strain, gains)
        nodes = self._node_blocks()
        spin = self.velocity[:, 3:]
        right = rods.gathered(model, elastic) + self.weight.ravel() + self.loads.at(self.pose)
        right.reshape(-1, 6)[:, 3:] -= np.cross(spin, np.einsum("nij,nj->ni", nodes[:, 3:, 3:], spin))
        right *= h
        wanted = np.zeros(n) if self.driven is None else self.driven(self.time + h).ravel()
        change = np.where(self.fixed, wanted - self.velocity.ravel(), 0.0)
        if self.rows or not self.chain:
            self._dense(blocks, nodes, right, change)
        else:
            self._banded(blocks, nodes, right, change)
        strain += gains * np.einsum("eij,ej->ei", matrix, change[dofs])
        self.acting = model.stiffness * strain
        self.velocity = self.velocity + change.reshape(-1, 6)
        self.pose = self.pose.moved((h * self.velocity).ravel())
        self.time += h

    def _banded(self, blocks: Array, nodes: Array, right: Array, change: Array) -> None:
        """The free unknowns' part of `change`, in bands of a chain."""
        n, model = len(right), self.model
        if self.fixed.any():
            pushed = np.einsum("eij,ej->ei", blocks, change[model.dofs])
            right = right - rods.gathered(model, pushed)
            hold = self.fixed[model.dofs]
            blocks = np.where(hold[:, :, None] | hold[:, None, :], 0.0, blocks)
            still = self.fixed.reshape(-1, 6)
            nodes = np.where(still[:, :, None] | still[:, None, :], np.eye(6), nodes)
            right = np.where(self.fixed, change, right)
        row, column = self._lower
        summed = np.bincount(self._band.ravel(), blocks[:, row, column].ravel(), minlength=12 * n)
        band: Array = np.array(summed[: 12 * n].reshape(12, n), np.float64)
        for i in range(6):
            for j in range(i + 1):
                band[i - j, j::6] += nodes[:, i, j]
        change[:] = solveh_banded(band, right, lower=True)

    def _dense(self, blocks: Array, nodes: Array, right: Array, change: Array) -> None:
        """The same with a full matrix, and rows by their multipliers."""
        n = len(right)
        matrix = rods.assembled(self.model, blocks)
        for node, block in enumerate(nodes):
            matrix[6 * node : 6 * node + 6, 6 * node : 6 * node + 6] += block
        free = np.flatnonzero(~self.fixed)
        moved = right - matrix @ change
        inner = matrix[np.ix_(free, free)]
        active = [not group.one_sided for group in self.rows]
        for _ in range(4):
            chosen = [group for group, on in zip(self.rows, active, strict=True) if on]
            jacobian = np.concatenate([np.zeros((0, n)), *(group.jacobian(self.pose) for group in chosen)])
            value = np.concatenate([np.zeros(0), *(group.value(self.pose) for group in chosen)])
            target = -value / self.rule.h - jacobian @ (self.velocity.ravel() + change)
            solution = _saddle(inner, jacobian[:, free], moved[free], target)
            change[free] += solution[: len(free)]
            impulses = np.split(
                solution[len(free) :], np.cumsum([len(group.value(self.pose)) for group in chosen])[:-1]
            )
            parts = dict(zip((k for k, on in enumerate(active) if on), impulses, strict=False))
            self.impulses = [parts.get(k, np.zeros(1)) for k in range(len(self.rows))]
            if not self._change_sides(active, change):
                return
            change[free] = 0.0

    def _change_sides(self, active: list[bool], change: Array) -> bool:
        """Switches one-sided rows that pull, or are passed; whether any was."""
        switched = False
        velocity = self.velocity.ravel() + change
        for k, group in enumerate(self.rows):
            if not group.one_sided:
                continue
            if active[k]:
                wrong = self.impulses[k][0] < 0.0
            else:
                wrong = (group.value(self.pose) + self.rule.h * group.jacobian(self.pose) @ velocity)[0] < 0.0
            if wrong:
                active[k], switched = not active[k], True
        return switched

    def energy(self) -> float:
        """Kinetic, elastic and in the field [J]."""
        v, w = self.velocity[:, :3], self.velocity[:, 3:]
        kinetic = 0.5 * float(np.sum(self.model.mass[:, None] * v**2))
        kinetic += 0.5 * float(np.einsum("ni,nij,nj->", w, self.spin_inertia(), w))
        height = -float(np.sum(self.model.mass * (self.pose.position @ self.gravity)))
        return kinetic + rods.elastic_energy(self.model, self.pose) + height

    def momentum(self) -> tuple[Array, Array]:
        """Linear [N s], and angular about the origin [N m s]."""
        linear = self.model.mass[:, None] * self.velocity[:, :3]
        spin = np.einsum("nij,nj->ni", self.spin_inertia(), self.velocity[:, 3:])
        return linear.sum(axis=0), (np.cross(self.pose.position, linear) + spin).sum(axis=0)

    def set_spin(self, rate: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Velocities of a rigid rotation [rad/s]."""
        self.velocity[:, :3] = np.cross(np.array(rate), self.pose.position - np.array(centre))
        self.velocity[:, 3:] = rate


def _saddle(matrix: Array, rows: Array, right: Array, target: Array) -> Array:
    """Unknowns and multipliers of matrix x - rows^T y = right, rows x = target."""
    count = len(rows)
    full = np.block([[matrix, -rows.T], [rows, np.zeros((count, count))]])
    scale = 1.0 / np.sqrt(np.concatenate([np.diag(matrix), np.full(count, 1.0)]))
    if count:  # rows by what they can move
        scale[-count:] = 1.0 / np.sqrt(np.einsum("ij,j,ij->i", rows, 1.0 / np.diag(matrix), rows))
    both = np.concatenate([right, target])
    return scale * np.linalg.solve(full * scale[:, None] * scale[None, :], scale * both)
