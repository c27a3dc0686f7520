"""Deformable soil after Bekker, Wong and Janosi-Hanamoto, once more: slow, float64, from the statement of the law.

The law is Project Chrono's SCM (commit 7689fbc, `SCMTerrain.cpp`) with two changes: pressure is never negative, and
shear stress has a direction that relaxes over a millimetre of sliding. All soil is a dictionary of nodes; what a node
does is in `advance` (stress at the present pose) and `linearised` (stress and derivatives at the end of a step). These
work on one node and on arrays of nodes alike. Shapes are in `soil_shapes.py`; integrals over the contact of a rolling
wheel, without any node, in `soil_quadrature.py`.

Signs: N is the upward normal of the undeformed ground, s the sinkage along it, v_n > 0 a body that leaves, tau acts on
the body. A wheel's axis is the second column of its rotation and points to the left; spin > 0 about it rolls forward.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from tests.reference.soil_shapes import Array, Body, Columns

Key = tuple[int, int]
Ground = Callable[[float, float], tuple[float, Array]]
"""(x, y) -> height, upward unit normal."""


# ---- the law of a node -----------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class SoilParameters:
    """Bekker's pressure and sinkage, Mohr-Coulomb, Janosi-Hanamoto's shear modulus, elasticity and damping."""

    k_phi: float
    """[N/m^(n+2)]"""
    k_c: float
    """[N/m^(n+1)]"""
    n: float
    cohesion: float
    """[Pa]"""
    friction_angle: float
    """[rad]"""
    shear_modulus: float
    """K_J [m]"""
    elastic: float
    """K_el [Pa/m]"""
    damping: float
    """R [Pa s/m]"""

    def curve(self, s: Any, inverse_b: Any) -> Any:
        """Pressure of virgin soil at a sinkage."""
        return (self.k_c * inverse_b + self.k_phi) * np.maximum(s, 0.0) ** self.n

    @property
    def friction(self) -> float:
        return float(np.tan(self.friction_angle))


PRESETS = {
    "soft": SoilParameters(0.2e6, 0.0, 1.1, 0.0, np.radians(30.0), 0.01, 4e7, 3e4),
    "mid": SoilParameters(2e6, 0.0, 1.1, 0.0, np.radians(30.0), 0.01, 2e8, 3e4),
    "hard": SoilParameters(5.301e6, 1.02e5, 0.793, 1300.0, np.radians(31.1), 0.012, 4e8, 3e4),
}


@dataclasses.dataclass(frozen=True)
class ShearMemory:
    """What a node remembers of shear besides J: nothing ("scalar", Chrono) or a direction."""

    kind: Literal["direction", "scalar"] = "direction"
    length: float = 1e-3
    """l: sliding over which the direction relaxes [m]."""
    speed: float = 0.02
    """v_r: the direction's damping fades with speed [m/s]."""

    @property
    def time(self) -> float:
        """T_d, 10 l per m/s [s]."""
        return 10.0 * self.length


DIRECTION = ShearMemory("direction")
SCALAR = ShearMemory("scalar")


@dataclasses.dataclass
class Node:
    """Memory of a node, or of k nodes: (k,) and for the direction (k, 2)."""

    plastic: Any
    """z_p: sinkage left when unloaded [m]."""
    strength: Any
    """sigma_y: pressure at which it yields again [Pa]."""
    shear: Any
    """J: sliding under load, never less [m]."""
    direction: Any
    """d, at most 1 long, in the plane of the undeformed ground."""

    @staticmethod
    def fresh(shape: tuple[int, ...] = ()) -> Node:
        return Node(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros((*shape, 2)))


class Stress(NamedTuple):
    """On the body: along N, and in the plane of the ground (..., 2) [Pa]."""

    normal: Any
    tangential: Any


class Linearised(NamedTuple):
    """Stress at the end of a step with the present velocity, and the coefficients of D, per area.

    A change dv of the point's velocity changes the impulse per area by -(h^2 stiffness + h damping) along N and by
    -shear in the plane of the ground.
    """

    normal: Any
    tangential: Any
    stiffness: Any
    """k_s [Pa/m]."""
    damping: Any
    """R, or 0 where the pressure was clamped [Pa s/m]."""
    shear: Any
    """[Pa s^2/m]: h^2 m (1 - e^-q)/(q l) + h m g/l, or h m/|v_t|."""


def pressure(node: Node, s: Any, parameters: SoilParameters, inverse_b: Any = 0.0) -> Any:
    """Static pressure at a sinkage, nothing stored: elastic below the yield pressure, else the virgin curve."""
    trial = parameters.elastic * (s - node.plastic)
    sigma = np.where(trial > node.strength, np.minimum(parameters.curve(s, inverse_b), trial), trial)
    return np.where(trial > 0.0, sigma, 0.0)


def advance_memory(
    node: Node, s: Any, v_t: Any, dt: float, parameters: SoilParameters, inverse_b: Any, memory: ShearMemory
) -> None:
    """Yield at the present sinkage, sliding by |v_t| dt. A node that bears nothing keeps all of its memory."""
    trial = parameters.elastic * (s - node.plastic)
    touched = trial > 0.0
    sigma = parameters.curve(s, inverse_b)
    yields = touched & (trial > node.strength) & (sigma < trial)
    node.strength = np.where(yields, sigma, node.strength)
    node.plastic = np.where(yields, s - sigma / parameters.elastic, node.plastic)
    speed = np.linalg.norm(v_t, axis=-1)
    node.shear = node.shear + np.where(touched, speed * dt, 0.0)
    ahead = v_t / np.where(speed > 0.0, speed, 1.0)[..., None]
    relaxed = ahead + (node.direction - ahead) * np.exp(-speed * dt / memory.length)[..., None]
    slides = touched & (speed > 0.0)
    node.direction = np.where(slides[..., None], relaxed, node.direction)


def shear_direction(node: Node, v_t: Any, dt: float, memory: ShearMemory) -> Any:
    """d': shear stress acts against it. Needs the memory of this step."""
    speed = np.linalg.norm(v_t, axis=-1)
    if memory.kind == "scalar":
        return v_t / np.maximum(speed, 1e-9 / dt)[..., None]
    g = memory.time * np.exp(-speed / memory.speed)
    damped = node.direction + (g / memory.length)[..., None] * v_t
    return damped / np.maximum(np.linalg.norm(damped, axis=-1), 1.0)[..., None]


def shear_strength(node: Node, sigma: Any, parameters: SoilParameters) -> Any:
    """m: Mohr-Coulomb, mobilised after Janosi and Hanamoto."""
    limit = parameters.cohesion + sigma * parameters.friction
    return limit * -np.expm1(-node.shear / parameters.shear_modulus)


def advance(
    node: Node,
    s: Any,
    v_n: Any,
    v_t: Any,
    dt: float,
    parameters: SoilParameters,
    inverse_b: Any = 0.0,
    memory: ShearMemory = DIRECTION,
    clamp: bool = True,
) -> Stress:
    """Advances the memory; the stress at the present pose. Without `clamp` soil pulls, as Chrono's does."""
    v_t = np.asarray(v_t, dtype=float)
    advance_memory(node, s, v_t, dt, parameters, inverse_b, memory)
    static = pressure(node, s, parameters, inverse_b)
    sigma = static - parameters.damping * v_n
    sigma = np.where(static > 0.0, np.maximum(sigma, 0.0) if clamp else sigma, 0.0)
    m = np.where(static > 0.0, shear_strength(node, sigma, parameters), 0.0)
    return Stress(sigma, -m[..., None] * shear_direction(node, v_t, dt, memory))


def secant(sigma0: Any, sigma1: Any, s0: Any, s1: Any, elastic: float) -> Any:
    """k_s between the present and the predicted sinkage, within [0, K_el]."""
    step = s1 - s0
    near = np.abs(step) < 1e-7
    slope = (sigma1 - sigma0) / np.where(near, 1.0, step)
    return np.where(near, elastic, np.clip(slope, 0.0, elastic))


def linearised(
    node: Node,
    s: Any,
    predicted: Any,
    v_n: Any,
    v_t: Any,
    dt: float,
    parameters: SoilParameters,
    inverse_b: Any = 0.0,
    memory: ShearMemory = DIRECTION,
    clamp: bool = True,
    damp_ahead: bool = True,
) -> Linearised:
    """Advances the memory at the present sinkage; stress at the predicted one, and its derivatives.

    With `damp_ahead` R acts wherever the predicted pose bears, as the design's list has it, else only where the
    present one does: v_n is that of the present pose, and too great on nodes that are reached within the step.
    """
    v_t = np.asarray(v_t, dtype=float)
    advance_memory(node, s, v_t, dt, parameters, inverse_b, memory)
    sigma0 = pressure(node, s, parameters, inverse_b)
    sigma1 = pressure(node, predicted, parameters, inverse_b)
    bears = sigma1 > 0.0
    damper = np.where(damp_ahead | (sigma0 > 0.0), parameters.damping, 0.0)
    raw = sigma1 - damper * v_n
    free = (raw > 0.0) | (not clamp)
    sigma = np.where(bears & free, raw, 0.0)
    damping = np.where(bears & free, damper, 0.0)
    stiffness = np.where(bears, secant(sigma0, sigma1, s, predicted, parameters.elastic), 0.0)
    m = np.where(bears, shear_strength(node, sigma, parameters), 0.0)
    speed = np.linalg.norm(v_t, axis=-1)
    if memory.kind == "scalar":
        factor = dt / np.maximum(speed, 1e-9 / dt)
    else:
        q = speed * dt / memory.length
        share = np.where(q > 1e-12, -np.expm1(-q) / np.where(q > 1e-12, q, 1.0), 1.0)
        g = memory.time * np.exp(-speed / memory.speed)
        factor = dt * dt * share / memory.length + dt * g / memory.length
    tangential = -m[..., None] * shear_direction(node, v_t, dt, memory)
    return Linearised(sigma, tangential, stiffness, damping, np.maximum(m, 0.0) * factor)


def rectangle_inverse_b(length: float, width: float) -> float:
    """1/b = perimeter / (2 area) of a rectangle; 0 below 1e-6 m^2."""
    return (length + width) / (length * width) if length * width >= 1e-6 else 0.0


# ---- the grid --------------------------------------------------------------------------------------------------------


def slope(normal: Any = (0.0, 0.0, 1.0), height: float = 0.0) -> Ground:
    """A plane `height` above the origin."""
    n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    return lambda x, y: (height - (n[0] * x + n[1] * y) / n[2], n)


class Reaction(NamedTuple):
    """Of the soil on a body, about its position; D in the order (velocity, spin)."""

    force: Array
    moment: Array
    matrix: Array
    depth: float
    """Greatest sinkage."""

    @property
    def wrench(self) -> Array:
        return np.concatenate([self.force, self.moment])


class Touch(NamedTuple):
    """Nodes under a body: keys, sinkage now and predicted, area, arm from its position."""

    keys: list[Key]
    sinkage: Array
    predicted: Array
    area: Array
    arm: Array


class GridSoil:
    """Nodes at (i dx, j dy); a record only for nodes that were touched.

    Args:
        spacing: dx and dy, or one for both. A single row as wide as a wheel is a planar problem.
        share: weigh a node by the share of its cell inside the width of a body.
        hull: for b, the rectangle of touched nodes in the axes of the body ("nodes") or of their cells, no wider
            than the body ("cells").
        damp_ahead: see `linearised`.
        along_surface: pressure acts along the normal of the body's surface, into the body, in the place of the
            ground's, on the area of the surface above a cell; shear acts across it.
    """

    def __init__(
        self,
        parameters: SoilParameters,
        spacing: float | tuple[float, float] = 0.05,
        ground: Ground | None = None,
        memory: ShearMemory = DIRECTION,
        clamp: bool = True,
        share: bool = True,
        hull: Literal["cells", "nodes"] = "cells",
        damp_ahead: bool = True,
        along_surface: bool = False,
    ) -> None:
        self.parameters = parameters
        self.spacing = np.broadcast_to(np.asarray(spacing, dtype=float), (2,)).copy()
        self.ground = slope() if ground is None else ground
        self.memory, self.clamp, self.share, self.hull = memory, clamp, share, hull
        self.damp_ahead, self.along_surface = damp_ahead, along_surface
        self.nodes: dict[Key, Array] = {}
        """z_p, sigma_y, J, d_x, d_y."""
        self.base: dict[Key, Array] = {}

    def frame(self, key: Key) -> Array:
        """(10,) undeformed height, and the axes of the ground there: N, T_1 (X laid into the plane), T_2 = N x T_1."""
        if key not in self.base:
            height, n = self.ground(key[0] * self.spacing[0], key[1] * self.spacing[1])
            t = np.array([1.0, 0.0, 0.0]) - n[0] * n
            t /= np.linalg.norm(t)
            self.base[key] = np.concatenate([[height], n, t, np.cross(n, t)])
        return self.base[key]

    def gather(self, keys: list[Key]) -> Node:
        """Memory of nodes."""
        rows = np.array([self.nodes.get(key, np.zeros(5)) for key in keys]).reshape(-1, 5)
        return Node(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3:])

    def store(self, keys: list[Key], node: Node) -> None:
        """Memory of nodes that were ever loaded."""
        rows = np.column_stack([node.plastic, node.strength, node.shear, node.direction])
        for key, row in zip(keys, rows, strict=True):
            if row[1] > 0.0:
                self.nodes[key] = row

    def depth(self, x: float, y: float) -> float:
        """Sinkage left at the nearest node."""
        key = (round(x / self.spacing[0]), round(y / self.spacing[1]))
        return float(self.nodes[key][0]) if key in self.nodes else 0.0

    def candidates(self, body: Body) -> list[Key]:
        """Nodes below the box around a body, half a cell wider."""
        half = body.shape.extent(body.rotation)[:2] + 0.5 * self.spacing
        low = np.ceil((body.position[:2] - half) / self.spacing - 1e-9).astype(int)
        high = np.floor((body.position[:2] + half) / self.spacing + 1e-9).astype(int)
        ranges = (range(low[k], high[k] + 1) for k in (0, 1))
        return [(int(i), int(j)) for i, j in itertools.product(*ranges)]

    def heights(self, body: Body, keys: list[Key]) -> Columns:
        """Lowest points of a body over nodes, in the world."""
        xy = np.array(keys, dtype=float).reshape(-1, 2) * self.spacing - body.position[:2]
        found = body.shape.columns(xy, body.rotation, self.spacing if self.share else None)
        return Columns(found.height + body.position[2], found.share)

    def surface_axes(self, body: Body, touch: Touch, ground: Array) -> Array:
        """(k, 3, 3) rows: normal of the surface at its lowest points, by differences, and the axes across it. It leans
        by at most acos 1/4 from the ground's.
        """
        xy, step = touch.arm[:, :2], 1e-6

        def slope_along(shift: tuple[float, float]) -> Array:
            ends = (body.shape.smooth(xy + sign * np.array(shift), body.rotation) for sign in (1.0, -1.0))
            ahead, behind = ends
            return np.asarray((ahead - behind) / (2.0 * step))

        n = np.column_stack([-slope_along((step, 0.0)), -slope_along((0.0, step)), np.ones(len(xy))])
        n /= np.linalg.norm(n, axis=1)[:, None]
        upright = np.einsum("ki,ki->k", n, ground)
        along = n - upright[:, None] * ground
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
        n = np.where((upright < 0.25)[:, None], 0.25 * ground + np.sqrt(1.0 - 0.25**2) * along, n)
        side = np.cross(n, [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side, axis=1)[:, None]
        return np.stack([n, np.cross(side, n), side], axis=1)

    def touch(self, body: Body, dt: float) -> Touch:
        """Nodes that the present pose covers and that the present or the predicted pose sinks into.

        A node below a leaning flat side, which the tread only comes to sideways, waits for the next step: its present
        height is that of the side, as far as a wheel is high.
        """
        keys = self.candidates(body)
        base = np.array([self.frame(key) for key in keys]).reshape(-1, 10)
        now = self.heights(body, keys)
        later = self.heights(body.moved(dt), keys)
        s, predicted = (base[:, 3] * (base[:, 0] - height) for height in (now.height, later.height))
        fast = float(np.linalg.norm(body.velocity)) + body.shape.sweep * float(np.linalg.norm(body.spin))
        near = s > -3.0 * dt * fast - 1e-9
        use = np.isfinite(now.height) & (now.share > 0.0) & ((s > 0.0) | ((predicted > 0.0) & near))
        xy = np.array(keys, dtype=float).reshape(-1, 2) * self.spacing
        arm = np.column_stack([xy, now.height])[use] - body.position
        area = float(np.prod(self.spacing)) * now.share[use]
        return Touch([key for key, u in zip(keys, use, strict=True) if u], s[use], predicted[use], area, arm)

    def owned(self, touches: list[Touch], bodies: Sequence[Body]) -> list[Touch]:
        """A node under several bodies belongs to the lowest surface, then to the first body."""
        best: dict[Key, tuple[float, int]] = {}
        for index, (touch, body) in enumerate(zip(touches, bodies, strict=True)):
            for key, arm in zip(touch.keys, touch.arm, strict=True):
                best[key] = min(best.get(key, (np.inf, index)), (float(arm[2] + body.position[2]), index))
        kept = []
        for index, touch in enumerate(touches):
            use = np.array([best[key][1] == index for key in touch.keys], dtype=bool)
            keys = [key for key, u in zip(touch.keys, use, strict=True) if u]
            kept.append(Touch(keys, touch.sinkage[use], touch.predicted[use], touch.area[use], touch.arm[use]))
        return kept

    def inverse_b(self, body: Body, touch: Touch) -> float:
        """Of the rectangle of the sunken nodes in the body's axes."""
        sunk = touch.arm[touch.sinkage > 0.0]
        if self.parameters.k_c == 0.0 or len(sunk) == 0:
            return 0.0
        sides = []
        left = body.rotation[:2, 1] / np.linalg.norm(body.rotation[:2, 1])
        for axis, most in zip((np.array([left[1], -left[0]]), left), body.shape.sizes(), strict=True):
            along = sunk[:, :2] @ axis
            cell = float(np.abs(axis) @ self.spacing) if self.hull == "cells" else 0.0
            side = float(np.ptp(along)) + cell
            sides.append(min(side, most) if self.hull == "cells" else side)
        return rectangle_inverse_b(*sides)

    def stored(self, body: Body) -> float:
        """Elastic energy of the nodes under a body [J]."""
        touch = self.touch(body, 0.0)
        node, inverse_b = self.gather(touch.keys), self.inverse_b(body, touch)
        sigma = pressure(node, touch.sinkage, self.parameters, inverse_b)
        return float((touch.area * sigma**2).sum() / (2.0 * self.parameters.elastic))

    def react(self, bodies: Sequence[Body], dt: float, implicit: bool = False) -> list[Reaction]:
        """Advances all memory; forces at the present pose with D = 0, or the linearly implicit F_0 and D."""
        touches = self.owned([self.touch(body, dt) for body in bodies], bodies)
        return [self.react_to(body, touch, dt, implicit) for body, touch in zip(bodies, touches, strict=True)]

    def react_to(self, body: Body, touch: Touch, dt: float, implicit: bool) -> Reaction:
        """The reaction on one body."""
        if not touch.keys:
            return Reaction(np.zeros(3), np.zeros(3), np.zeros((6, 6)), 0.0)
        axes = np.array([self.frame(key)[1:] for key in touch.keys]).reshape(-1, 3, 3)
        node, upright = self.gather(touch.keys), np.ones(len(touch.keys))
        if self.along_surface:
            ground = axes[:, 0]
            axes = self.surface_axes(body, touch, ground)
            upright = np.einsum("ki,ki->k", ground, axes[:, 0])
            # a node keeps x and y of its direction; it is laid across the normal of the step
            node.direction = laid_across(node.direction, axes)
        velocity = np.einsum("kai,ki->ka", axes, body.velocity + np.cross(body.spin, touch.arm))
        inverse_b = self.inverse_b(body, touch)
        motion = velocity[:, 0], velocity[:, 1:], dt, self.parameters, inverse_b, self.memory, self.clamp
        matrix = np.zeros((6, 6))
        stress: Stress | Linearised
        if implicit:
            stress = linearised(node, touch.sinkage, touch.predicted, *motion, damp_ahead=self.damp_ahead)
            matrix = self.assemble(body, touch, axes, stress, dt, upright)
        else:
            stress = advance(node, touch.sinkage, *motion)
        if self.along_surface:
            node.direction = np.einsum("ka,kai->ki", node.direction, axes[:, 1:, :2])
        self.store(touch.keys, node)
        local = np.column_stack([stress.normal, stress.tangential]) * (touch.area / upright)[:, None]
        forces = np.einsum("kai,ka->ki", axes, local)
        # an implicit force acts all through the step, while the body moves on over the nodes: from its middle
        arm = touch.arm - 0.5 * dt * body.velocity if implicit else touch.arm
        moment = np.cross(arm, forces).sum(axis=0)
        return Reaction(forces.sum(axis=0), moment, matrix, float(touch.sinkage.max()))

    def assemble(self, body: Body, touch: Touch, axes: Array, law: Linearised, dt: float, upright: Array) -> Array:
        """D: sum over nodes of area times coefficient times outer products of rows of the points' Jacobians."""
        rows = np.concatenate([axes, np.cross(touch.arm[:, None, :], axes)], axis=2)
        sinking = rows[:, 0].copy()
        sinking[:, 3:] = sinking[:, 3:] @ body.shape.turns(body.rotation)
        terms = (
            (dt * dt * law.stiffness / upright, sinking),
            (dt * law.damping, rows[:, 0]),
            (law.shear, rows[:, 1]),
            (law.shear, rows[:, 2]),
        )
        return np.asarray(sum(np.einsum("k,ki,kj->ij", touch.area / upright * c, row, row) for c, row in terms))


def laid_across(flat: Array, axes: Array) -> Array:
    """(k, 2) along the last two axes: vectors across the first axis, of which x and y are given."""
    n = axes[:, 0]
    up = -(n[:, 0] * flat[:, 0] + n[:, 1] * flat[:, 1]) / n[:, 2]
    return np.einsum("kai,ki->ka", axes[:, 1:], np.column_stack([flat, up]))


# ---- a wheel or plate in its plane -----------------------------------------------------------------------------------

PLANAR = np.array([0, 2, 4])
"""Forward and vertical velocity, spin about Y."""


@dataclasses.dataclass
class Rig:
    """A body that moves along X and Z and turns about Y; forces on it are constant.

    What is not free keeps its velocity.
    """

    body: Body
    mass: float
    inertia: float
    force: tuple[float, float] = (0.0, 0.0)
    """Along X and Z, weight included."""
    torque: float = 0.0
    free: tuple[bool, bool, bool] = (True, True, True)

    @property
    def velocity(self) -> Array:
        return np.concatenate([self.body.velocity, self.body.spin])[PLANAR]

    def step(self, soil: GridSoil, dt: float, implicit: bool = True) -> Array:
        """(M + D) dv = h (F + F_0), then the pose moves with the new velocity. The soil's force F_0 - D dv/h."""
        reaction = soil.react([self.body], dt, implicit)[0]
        wrench = reaction.wrench[PLANAR]
        coupling = reaction.matrix[np.ix_(PLANAR, PLANAR)]
        inertia = np.diag([self.mass, self.mass, self.inertia])
        free = np.flatnonzero(self.free)
        outer = np.array([*self.force, self.torque])
        change = np.zeros(3)
        change[free] = np.linalg.solve((inertia + coupling)[np.ix_(free, free)], dt * (wrench + outer)[free])
        twist = np.concatenate([self.body.velocity, self.body.spin])
        twist[PLANAR] += change
        self.body = dataclasses.replace(self.body, velocity=twist[:3], spin=twist[3:]).moved(dt)
        return wrench - coupling @ change / dt
