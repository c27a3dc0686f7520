"""Random and chosen pairs of shapes, and a test kernel that runs `collide` on a batch of them."""

import dataclasses

import numpy as np
import warp as wp

from simwarp.core.types import ShapeType
from simwarp.geometry.assets import convex_hull, hull_assets
from simwarp.kernels.collision.narrow import axis_between, axis_contacts, formula_contacts, has_formula, swapped
from simwarp.kernels.collision.shape import MANIFOLD_CONTACTS, POLYGON_CAPACITY, Assets, Manifold, Shape
from tests.reference.collision import TRIANGLE, Solid

PLANE, SPHERE, CAPSULE, CYLINDER = ShapeType.PLANE, ShapeType.SPHERE, ShapeType.CAPSULE, ShapeType.CYLINDER
BOX, ELLIPSOID, CONE, HULL = ShapeType.BOX, ShapeType.ELLIPSOID, ShapeType.CONE, ShapeType.HULL
PLANE_KIND = wp.constant(int(PLANE))
KINDS = [SPHERE, CAPSULE, CYLINDER, BOX, ELLIPSOID, CONE, HULL, TRIANGLE]

# mypy: disable-error-code="index"
wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def collide(a: Shape, b: Shape, reach: float, assets: Assets, out: Manifold) -> int:
    """Contacts of two shapes whose gap is below `reach` [m], as the stages of collision find them; returns how many.

    `a` and `b`: any of ShapeType up to HULL, or TRIANGLE; two planes never touch. Results go to normal (from a to b),
    point (on a), gap and feature of `out`. The contacts of (b, a) are the same, seen from the other side.
    """
    flip = swapped(a, b)
    p = a
    q = b
    if flip == 1:
        p = b
        q = a
    if q.kind == PLANE_KIND:
        return 0
    if has_formula(p.kind, q.kind):
        return formula_contacts(p, q, reach, flip, assets, out)
    return axis_contacts(p, q, axis_between(p, q, reach, assets), reach, flip, assets, out)


@wp.kernel(enable_backward=False)
def collide_pairs(
    a: wp.array[Shape], b: wp.array[Shape], reach: wp.array[float], assets: Assets, normal: wp.array2d[wp.vec3],
    point: wp.array2d[wp.vec3], gap: wp.array2d[float], feature: wp.array2d[int], polygon: wp.array3d[wp.vec3],
    count: wp.array[int],
):  # fmt: skip
    """One pair per thread."""
    i = wp.tid()
    m = Manifold()
    m.normal = normal[i]
    m.point = point[i]
    m.gap = gap[i]
    m.feature = feature[i]
    m.polygon = polygon[i]
    count[i] = collide(a[i], b[i], reach[i], assets, m)


def voussoir(inner: float = 1.0, outer: float = 1.3, angle: float = 0.2, depth: float = 0.3) -> np.ndarray:
    """Vertices of an arch's stone."""
    return np.array(
        [
            [r * np.sin(t), y, r * np.cos(t) - 1.15]
            for r in (inner, outer)
            for t in (-angle / 2, angle / 2)
            for y in (-depth / 2, depth / 2)
        ]
    )


HULLS = [
    convex_hull(voussoir()),
    convex_hull(np.random.default_rng(5).normal(size=(14, 3)) * 0.5),
    convex_hull(np.random.default_rng(6).normal(size=(60, 3)) * 0.5),
    convex_hull(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) - 0.25),
]


@dataclasses.dataclass
class Contacts:
    """What the kernel found for one pair, in float64."""

    normal: np.ndarray
    point: np.ndarray
    gap: np.ndarray
    feature: np.ndarray

    def __len__(self) -> int:
        return len(self.gap)


def as_record(s: Solid) -> tuple:
    """A solid as a row of the kernel's structured array."""
    rot, x = s.rot, s.x
    if s.kind == TRIANGLE:
        x = s.vertices.mean(axis=0)
        rot = (s.vertices - x).T
    return int(s.kind), x, rot, s.size, s.margin, s.asset


class Batch:
    """Pairs on the device; `launch` collides them all."""

    def __init__(self, pairs: list[tuple[Solid, Solid]], reach: float | np.ndarray) -> None:
        n = len(pairs)
        self.assets = hull_assets(HULLS, "cpu")
        dtype = Shape.numpy_dtype()  # type: ignore[attr-defined]
        sides: list[wp.array] = []
        for side in range(2):
            rows = np.zeros(n, dtype=dtype)
            for i, pair in enumerate(pairs):
                for name, value in zip(
                    ("kind", "x", "rot", "size", "margin", "asset"), as_record(pair[side]), strict=True
                ):
                    rows[name][i] = value
            sides.append(wp.array(rows, dtype=Shape, device="cpu"))
        self.reach: wp.array = wp.array(np.broadcast_to(reach, n).astype(np.float32), dtype=float, device="cpu")
        k = int(MANIFOLD_CONTACTS)
        self.out = [
            wp.zeros((n, k), dtype=wp.vec3, device="cpu"), wp.zeros((n, k), dtype=wp.vec3, device="cpu"),
            wp.zeros((n, k), dtype=float, device="cpu"), wp.zeros((n, k), dtype=int, device="cpu"),
            wp.zeros((n, 4, int(POLYGON_CAPACITY)), dtype=wp.vec3, device="cpu"), wp.zeros(n, dtype=int, device="cpu"),
        ]  # fmt: skip
        self.inputs = [*sides, self.reach, self.assets, *self.out]
        self.count = n

    def launch(self) -> None:
        wp.launch(collide_pairs, dim=self.count, inputs=self.inputs, device="cpu")

    def results(self) -> list[Contacts]:
        normal, point, gap, feature, _, count = (array.numpy() for array in self.out)
        return [
            Contacts(
                normal[i, :c].astype(float), point[i, :c].astype(float), gap[i, :c].astype(float), feature[i, :c].copy()
            )
            for i, c in enumerate(count)
        ]


def collide_all(pairs: list[tuple[Solid, Solid]], reach: float | np.ndarray = 1e6) -> list[Contacts]:
    """Contacts of every pair."""
    batch = Batch(pairs, reach)
    batch.launch()
    return batch.results()


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def rounded(v: np.ndarray) -> np.ndarray:
    """The float32 numbers that the kernel sees."""
    return np.asarray(v, dtype=np.float32).astype(np.float64)


def random_solid(kind: int, rng: np.random.Generator, scale: float = 1.0) -> Solid:
    """A shape of size about `scale`, aspect ratios up to 4, at the origin."""
    size = rounded(scale * rng.uniform(0.25, 1.0, size=3))
    rot = rounded(random_rotation(rng))
    if kind == TRIANGLE:
        vertices = rng.normal(size=(3, 3)) * scale
        return Solid(kind, np.zeros(3), np.eye(3), np.zeros(3), vertices=rounded(vertices - vertices.mean(axis=0)))
    solid = Solid(int(kind), np.zeros(3), rot, size)
    if kind == HULL:
        solid.asset = int(rng.integers(len(HULLS)))
        hull = HULLS[solid.asset]
        solid.vertices, solid.normals, solid.edges = rounded(hull.vertices), hull.normals, hull.edges
    return solid


def moved(s: Solid, shift: np.ndarray) -> Solid:
    vertices = s.vertices
    if s.kind == TRIANGLE:
        vertices = rounded(vertices + shift)
    return dataclasses.replace(s, x=rounded(s.x + shift), vertices=vertices)
