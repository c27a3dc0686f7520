"""Geometrically exact rods of two-node elements, float64: strains, their exact derivatives, forces, static equilibrium.

A node has a position and a rotation (columns are its axes in the world, the first along the rod). An element from a to
b of length L, with r = x_b - x_a, theta = log(R_a^T R_b) and the frame R_m = R_a exp(theta / 2) in the middle, has

    Gamma = R_m^T r / L - e_1 - Gamma_0    (stretch, shear along y and z)
    kappa = theta / L - kappa_0            (twist, bending about y and z) [1/m]

and the energy L/2 (Gamma, kappa) C (Gamma, kappa). Velocities are those of the world: of the position, and the spin w
of R' = [w] R. One point in the middle integrates everything, so that slender elements do not lock in shear.

Sources: J.C. Simo, L. Vu-Quoc, CMAME 58 (1986) 79; V. Sonneville, A. Cardona, O. Bruls, CMAME 268 (2014) 451.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

SMALL = 1e-4
"""Angle [rad] below which series are used in place of quotients."""


def cross_matrix(v: Array) -> Array:
    """(..., 3, 3) matrices of the cross products with (..., 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return out


def _polynomial(theta: Array, first: Array, second: Array) -> Array:
    """1 + first [theta] + second [theta]^2."""
    hat = cross_matrix(theta)
    return np.eye(3) + first[..., None, None] * hat + second[..., None, None] * (hat @ hat)


def _angle(theta: Array) -> tuple[Array, Array, Array]:
    """The angle, the same without zeros, and where it is small."""
    t = np.sqrt(np.sum(theta * theta, axis=-1))
    small = t < SMALL
    return t, np.where(small, 1.0, t), small


def exponential(theta: Array) -> Array:
    """(..., 3, 3) rotations by the vectors (..., 3) [rad]."""
    t, safe, small = _angle(theta)
    first = np.where(small, 1.0 - t * t / 6.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - t * t / 24.0, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    return _polynomial(theta, first, second)


def logarithm(rotation: Array) -> Array:
    """(..., 3) rotation vectors, shorter than pi [rad]."""
    vector = 0.5 * np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.sqrt(np.sum(vector * vector, axis=-1))
    t = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0))
    scale = np.where(t < SMALL, 1.0 + t * t / 6.0, t / np.where(t < SMALL, 1.0, sine))
    return scale[..., None] * vector


def left_jacobian(theta: Array) -> Array:
    """(..., 3, 3) J of exp(theta + d) = exp(J d) exp(theta)."""
    t, safe, small = _angle(theta)
    first = np.where(small, 0.5 - t * t / 24.0, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    second = np.where(small, 1.0 / 6.0 - t * t / 120.0, (safe - np.sin(safe)) / safe**3)
    return _polynomial(theta, first, second)


def left_jacobian_inverse(theta: Array) -> Array:
    """(..., 3, 3) inverse of `left_jacobian`."""
    t, safe, small = _angle(theta)
    half = 0.5 * safe
    second = np.where(small, 1.0 / 12.0 + t * t / 720.0, (1.0 - half / np.tan(half)) / safe**2)
    return _polynomial(theta, np.full_like(t, -0.5), second)


@dataclasses.dataclass(frozen=True)
class Rods:
    """Elements between nodes, in any arrangement.

    Attributes:
        elements: (E, 2) nodes a and b.
        length: (E,) rest length [m].
        rest: (E, 6) Gamma_0 and kappa_0.
        stiffness: (E, 6) EA, kGA_y, kGA_z, GJ, EI_y, EI_z.
        mass: (N,) of the nodes [kg].
        inertia: (N, 3) of the nodes, about their own axes [kg m^2].
    """

    elements: Indices
    length: Array
    rest: Array
    stiffness: Array
    mass: Array
    inertia: Array

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.mass)

    @property
    def dofs(self) -> Indices:
        """(E, 12) unknowns of each element: three of position, three of rotation, of a and then of b."""
        return (self.elements[:, :, None] * 6 + np.arange(6)).reshape(len(self.elements), 12)


@dataclasses.dataclass(frozen=True)
class Pose:
    """Where the nodes are.

    Attributes:
        position: (N, 3) [m].
        rotation: (N, 3, 3).
    """

    position: Array
    rotation: Array

    def moved(self, increment: Array) -> Pose:
        """The pose after (N * 6,) displacements and rotation vectors of the world."""
        change = increment.reshape(-1, 6)
        return Pose(self.position + change[:, :3], exponential(change[:, 3:]) @ self.rotation)


def strains(rods: Rods, pose: Pose) -> Array:
    """(E, 6) Gamma, kappa."""
    return _strains(rods, *_ends(rods, pose))


def _ends(rods: Rods, pose: Pose) -> tuple[Array, Array, Array]:
    """Distances r and the rotations at both ends."""
    a, b = rods.elements.T
    return pose.position[b] - pose.position[a], pose.rotation[a], pose.rotation[b]


def _strains(rods: Rods, r: Array, first: Array, last: Array) -> Array:
    theta = logarithm(first.swapaxes(-1, -2) @ last)
    middle = first @ exponential(0.5 * theta)
    along = np.einsum("eji,ej->ei", middle, r) / rods.length[:, None]
    along[:, 0] -= 1.0
    return np.concatenate([along, theta / rods.length[:, None]], axis=1) - rods.rest


def strain_matrix(rods: Rods, pose: Pose) -> Array:
    """(E, 6, 12) exact derivative of the strains by the velocities (v_a, w_a, v_b, w_b) of the world."""
    r, first, last = _ends(rods, pose)
    theta = logarithm(first.swapaxes(-1, -2) @ last)
    bend = left_jacobian_inverse(theta) @ first.swapaxes(-1, -2)  # of theta, by w_b - w_a
    middle = first @ exponential(0.5 * theta)
    share = 0.5 * first @ left_jacobian(0.5 * theta) @ bend  # of w_m, by w_b - w_a
    to_middle = middle.swapaxes(-1, -2)
    arm = to_middle @ cross_matrix(r)
    out = np.zeros((len(r), 6, 12))
    out[:, :3, 0:3], out[:, :3, 6:9] = -to_middle, to_middle
    out[:, :3, 3:6], out[:, :3, 9:12] = arm - arm @ share, arm @ share
    out[:, 3:, 3:6], out[:, 3:, 9:12] = -bend, bend
    return out / rods.length[:, None, None]


def stresses(rods: Rods, pose: Pose) -> Array:
    """(E, 6) N [N] and M [N m] in the middle frame."""
    return rods.stiffness * strains(rods, pose)


def elastic_energy(rods: Rods, pose: Pose) -> float:
    """[J]."""
    return 0.5 * float(np.sum(rods.length[:, None] * rods.stiffness * strains(rods, pose) ** 2))


def element_forces(rods: Rods, pose: Pose) -> Array:
    """(E, 12) forces and moments of the world that elements put on their nodes."""
    weighted = rods.length[:, None] * stresses(rods, pose)
    return -np.einsum("eij,ei->ej", strain_matrix(rods, pose), weighted)


def gathered(rods: Rods, per_element: Array) -> Array:
    """(N * 6,) sums of (E, 12) over the elements of each node."""
    out = np.zeros(rods.nodes * 6)
    np.add.at(out, rods.dofs, per_element)
    return out


def forces(rods: Rods, pose: Pose) -> Array:
    """(N * 6,) elastic forces and moments on the nodes."""
    return gathered(rods, element_forces(rods, pose))


def assembled(rods: Rods, blocks: Array) -> Array:
    """(N * 6, N * 6) sum of the element matrices (E, 12, 12)."""
    out = np.zeros((rods.nodes * 6, rods.nodes * 6))
    dofs = rods.dofs
    np.add.at(out, (dofs[:, :, None], dofs[:, None, :]), blocks)
    return out


def material_blocks(rods: Rods, pose: Pose, stiffness: Array | None = None) -> Array:
    """(E, 12, 12) L B^T C B: positive semidefinite, and blind to rotation."""
    matrix = strain_matrix(rods, pose)
    weights = rods.length[:, None] * (rods.stiffness if stiffness is None else stiffness)
    return np.einsum("eki,ek,ekj->eij", matrix, weights, matrix)


def tangent_blocks(rods: Rods, pose: Pose, step: float = 1e-6) -> Array:
    """(E, 12, 12) derivative of -`element_forces` by displacements and spins, with central differences.

    Every element is given its own two nodes, so that all elements move at once.
    """
    count = len(rods.elements)
    a, b = rods.elements.T
    single = dataclasses.replace(
        rods,
        elements=np.arange(2 * count).reshape(count, 2),
        mass=np.zeros(2 * count),
        inertia=np.zeros((2 * count, 3)),
    )
    pair = np.stack([a, b], axis=1).ravel()
    apart = Pose(pose.position[pair], pose.rotation[pair])
    out = np.zeros((count, 12, 12))
    for column in range(12):
        scale = step * (rods.length if column % 6 < 3 else np.ones(count))
        change = np.zeros((count, 12))
        change[:, column] = scale
        ahead = element_forces(single, apart.moved(change.ravel()))
        behind = element_forces(single, apart.moved(-change.ravel()))
        out[:, :, column] = -(ahead - behind) / (2.0 * scale[:, None])
    return out


# Building


def rest_strains(length: Array, elements: Indices, pose: Pose) -> Array:
    """(E, 6) strains Gamma_0, kappa_0 that leave the pose without forces."""
    count = len(elements)
    zeros = np.zeros((count, 6))
    bare = Rods(elements, length, zeros, zeros, np.zeros(len(pose.position)), np.zeros((len(pose.position), 3)))
    return strains(bare, pose)


def frames_along(points: Array, up: Array) -> Array:
    """(N, 3, 3) frames whose first axis is the mean direction of the neighbouring segments.

    The third axis is `up`, made perpendicular, at the first node; the next ones turn it by the smallest rotation.
    """
    segments = np.diff(points, axis=0)
    segments = segments / np.linalg.norm(segments, axis=1, keepdims=True)
    tangents = np.concatenate([segments[:1], segments[:-1] + segments[1:], segments[-1:]])
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    third = up - tangents[0] * (up @ tangents[0])
    third = third / np.linalg.norm(third)
    frames = [np.stack([tangents[0], np.cross(third, tangents[0]), third], axis=1)]
    for before, after in itertools.pairwise(tangents):
        axis = np.cross(before, after)
        turn = axis * (np.arctan2(np.linalg.norm(axis), before @ after) / max(float(np.linalg.norm(axis)), 1e-300))
        frames.append(exponential(turn) @ frames[-1])
    return np.array(frames)


def build(
    points: Array,
    stiffness: Array,
    *,
    density_area: float = 1.0,
    polar: Array | None = None,
    up: Sequence[float] = (0.0, 0.0, 1.0),
    frames: Array | None = None,
    straight: bool = False,
) -> tuple[Rods, Pose]:
    """One rod through points, and its rest pose.

    Args:
        points: (N, 3) nodes [m].
        stiffness: (6,), see `Rods`.
        density_area: mass per length, rho A [kg/m].
        polar: (3,) rho (I_y + I_z), rho I_y, rho I_z [kg m].
        up: third axis of the section at the first node.
        frames: (N, 3, 3) in place of `frames_along`.
        straight: the rod is straight without forces, whatever the points are.
    """
    elements = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], axis=1)
    pose = Pose(np.array(points, float), frames_along(points, np.array(up, float)) if frames is None else frames)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    share = 0.5 * (np.append(length, 0.0) + np.append(0.0, length))
    rest = np.zeros((len(elements), 6)) if straight else rest_strains(length, elements, pose)
    polar = np.zeros(3) if polar is None else polar
    rods = Rods(
        elements, length, rest, np.tile(stiffness, (len(elements), 1)), density_area * share, np.outer(share, polar)
    )
    return rods, pose


# Equilibrium


@dataclasses.dataclass(frozen=True)
class Loads:
    """What acts on the nodes.

    Attributes:
        dead: (N, 6) forces [N] and moments [N m] that keep their directions in the world.
        following: (N, 6) those that turn with their node, along its axes.
    """

    dead: Array
    following: Array

    def at(self, pose: Pose) -> Array:
        """(N * 6,) in the world."""
        turned = np.einsum("nij,nkj->nki", pose.rotation, self.following.reshape(-1, 2, 3))
        return (self.dead + turned.reshape(-1, 6)).ravel()

    def tangent(self, pose: Pose) -> Array:
        """(N * 6, N * 6) derivative of `at` by displacements and spins."""
        count = len(self.dead)
        turned = np.einsum("nij,nkj->nki", pose.rotation, self.following.reshape(-1, 2, 3))
        out = np.zeros((count, 6, count, 6))
        node = np.arange(count)
        out[node, :3, node, 3:] = -cross_matrix(turned[:, 0])
        out[node, 3:, node, 3:] = -cross_matrix(turned[:, 1])
        return out.reshape(count * 6, count * 6)

    def scaled(self, factor: float) -> Loads:
        """A part of the loads."""
        return Loads(factor * self.dead, factor * self.following)


def no_loads(nodes: int) -> Loads:
    """Zeros to write into."""
    return Loads(np.zeros((nodes, 6)), np.zeros((nodes, 6)))


def weight(rods: Rods, gravity: Sequence[float]) -> Array:
    """(N, 6) dead loads of the nodes' masses in a field [m/s^2]."""
    out = np.zeros((rods.nodes, 6))
    out[:, :3] = rods.mass[:, None] * np.array(gravity)
    return out


CLAMP = (0, 1, 2, 3, 4, 5)
HINGE = (0, 1, 2)
"""Unknowns of a node that a support holds."""


def held(rods: Rods, supports: Mapping[int, Sequence[int]]) -> npt.NDArray[np.bool_]:
    """(N * 6,) which unknowns do not move; negative nodes count from the end."""
    out = np.zeros((rods.nodes, 6), bool)
    for node, which in supports.items():
        out[node, list(which)] = True
    return out.ravel()


class NoEquilibrium(RuntimeError):
    """Newton's iterations did not reach the tolerance."""


def _newton(
    rods: Rods, pose: Pose, loads: Loads, free: Indices, tolerance: float, rounding: float, iterations: int
) -> Pose | None:
    """The equilibrium beside `pose`, or None where the iterations do not reach it."""
    for _ in range(iterations):
        per_element = element_forces(rods, pose)
        outside = loads.at(pose)
        residual = (gathered(rods, per_element) + outside)[free]
        size = max(float(np.abs(per_element).max()), float(np.abs(outside).max()))
        if np.abs(residual).max() <= max(tolerance * size, rounding):
            return pose
        matrix = (assembled(rods, tangent_blocks(rods, pose)) - loads.tangent(pose))[np.ix_(free, free)]
        change = np.zeros(rods.nodes * 6)
        change[free] = np.linalg.solve(matrix, residual)
        if not np.abs(change.reshape(-1, 6)[:, 3:]).max() < 2.0:
            return None
        pose = pose.moved(change)
    return None


def equilibrium(
    rods: Rods,
    pose: Pose,
    loads: Loads,
    supports: Mapping[int, Sequence[int]],
    *,
    steps: int = 1,
    moving: Array | None = None,
    tolerance: float = 1e-9,
    iterations: int = 12,
) -> Pose:
    """The pose where elastic forces and loads balance, by Newton's method from `pose`, in steps of the load.

    Args:
        rods: elements.
        pose: where to start.
        loads: full loads, of which a growing part acts.
        supports: unknowns held, by node.
        steps: of the load, at first; one that fails is halved.
        moving: (N * 6,) displacements and rotation vectors of the held unknowns in all steps together.
        tolerance: of the free residual, beside the largest force of any element or load; never below the rounding of
            positions.
        iterations: in a step, at the most.

    Raises:
        NoEquilibrium: where the steps become too small.
    """
    fixed = held(rods, supports)
    free = np.flatnonzero(~fixed)
    far = float(np.abs(pose.position).max()) + float(rods.length.sum())
    rounding = 16.0 * np.finfo(float).eps * far * float((rods.stiffness[:, :3].max(axis=1) / rods.length).max())
    part, step = 0.0, 1.0 / steps
    while part < 1.0:
        goal = min(1.0, part + step)
        if goal > 1.0 - 1e-9:
            goal = 1.0
        start = pose if moving is None else pose.moved(np.where(fixed, (goal - part) * moving, 0.0))
        found = _newton(rods, start, loads.scaled(goal), free, tolerance, rounding, iterations)
        if found is not None:
            pose, part = found, goal
        elif step < 1e-4 / steps:
            raise NoEquilibrium(f"no equilibrium beyond {part:.6g} of the load; start closer or give it another path")
        else:
            step *= 0.5
    return pose


def reactions(rods: Rods, pose: Pose, loads: Loads) -> Array:
    """(N, 6) forces and moments of the supports on the nodes, in equilibrium."""
    return -(forces(rods, pose) + loads.at(pose)).reshape(-1, 6)


def free_tangent(rods: Rods, pose: Pose, supports: Mapping[int, Sequence[int]], loads: Loads | None = None) -> Array:
    """Symmetric part of the tangent of the free unknowns: its smallest eigenvalue says whether a pose is stable."""
    free = np.flatnonzero(~held(rods, supports))
    matrix = assembled(rods, tangent_blocks(rods, pose))
    if loads is not None:
        matrix = matrix - loads.tangent(pose)
    matrix = matrix[np.ix_(free, free)]
    return 0.5 * (matrix + matrix.T)
