"""Flexible elements, slowly and in float64: energies as they are written in papers, forces by differences of them."""

import functools
import itertools

import numpy as np

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))[[0, 4, 6, 2, 1, 5, 7, 3]]
"""Natural coordinates of a hexahedron's nodes: around the lower face, then around the upper one."""


def lame(young, poisson):
    """Lamé's constants λ and µ."""
    return young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)), young / (2.0 * (1.0 + poisson))


def elastic_density(f, young, poisson):
    """Energy density of Saint Venant and Kirchhoff."""
    first, shear = lame(young, poisson)
    strain = (f.T @ f - np.eye(3)) / 2.0
    return shear * np.sum(strain**2) + first / 2.0 * np.trace(strain) ** 2


def rubber_density(f, young, poisson):
    """Energy density of a stable neo-Hookean material, without the logarithm (Smith, de Goes and Kim 2018, eq. 13)."""
    first, shear = lame(young, poisson)
    first += shear
    j = np.linalg.det(f)
    return shear / 2.0 * (np.sum(f**2) - 3.0) - shear * (j - 1.0) + first / 2.0 * (j - 1.0) ** 2


def hexahedron_slopes(xi, x):
    """Gradients (8, 3) of shape functions at natural coordinates, and the determinant of the map."""
    natural = np.array([
        [c[i] / 8.0 * np.prod([1.0 + c[j] * xi[j] for j in range(3) if j != i]) for i in range(3)] for c in CORNERS
    ])  # fmt: skip
    jacobian = x.T @ natural
    return natural @ np.linalg.inv(jacobian), np.linalg.det(jacobian)


def deformation(x, rest):
    """Deformation gradient of a tetrahedron, or the mean one of a hexahedron, and its rest volume."""
    if len(x) == 4:
        edges = (rest[1:] - rest[0]).T
        return (x[1:] - x[0]).T @ np.linalg.inv(edges), np.linalg.det(edges) / 6.0
    slopes, volume = mean_slopes(rest)
    return x.T @ slopes, volume


def mean_slopes(rest):
    """Mean gradients (8, 3) of a hexahedron's shape functions, and its volume, by a rule of 27 points."""
    return _mean_slopes(rest.tobytes())


@functools.cache
def _mean_slopes(rest):
    rest = np.frombuffer(rest).reshape(8, 3)
    slopes, volume = np.zeros((8, 3)), 0.0
    rule = tuple(zip(*np.polynomial.legendre.leggauss(3), strict=True))
    for (a, wa), (b, wb), (c, wc) in itertools.product(rule, repeat=3):
        at_point, weight = hexahedron_slopes(np.array([a, b, c]), rest)
        slopes += wa * wb * wc * weight * at_point
        volume += wa * wb * wc * weight
    return slopes / volume, volume


def hourglass_amplitudes(x, rest):
    """(4, 3) what a hexahedron's corners do beyond its deformation gradient, in the axes of its rotation."""
    slopes, _ = mean_slopes(rest)
    c = CORNERS.T
    modes = np.array([c[0] * c[1], c[1] * c[2], c[2] * c[0], c[0] * c[1] * c[2]])
    u, _, vt = np.linalg.svd(x.T @ slopes)
    turned = x @ (u @ vt)
    return np.array([(mode @ turned - (mode @ rest) @ slopes.T @ turned) / 8.0 for mode in modes])


def incompatible_hexahedron(rest, young, poisson):
    """(24, 24) linear stiffness of a hexahedron with incompatible modes (Taylor, Beresford and Wilson 1976)."""
    first, shear = lame(young, poisson)
    unit = np.eye(3)
    law = first * np.einsum("ij,kl->ijkl", unit, unit)
    law += shear * (np.einsum("ik,jl->ijkl", unit, unit) + np.einsum("il,jk->ijkl", unit, unit))
    middle = np.linalg.inv((rest.T @ CORNERS) / 8.0)
    total = np.zeros((11, 3, 11, 3))
    for signs in itertools.product((-1.0, 1.0), repeat=3):
        xi = np.array(signs) / np.sqrt(3.0)
        slopes, weight = hexahedron_slopes(xi, rest)
        bubbles = -2.0 * xi[:, None] * middle / (np.linalg.det(middle) * weight)
        both = np.vstack([slopes, bubbles])
        total += weight * np.einsum("aj,ijkl,bl->aibk", both, law, both)
    k = total.reshape(33, 33)
    return k[:24, :24] - k[:24, 24:] @ np.linalg.solve(k[24:, 24:], k[24:, :24])


def triangle_strains(x, rest, there):
    """(6,) stretches and bendings xx, yy, 2 xy of a triangle with its neighbours' nodes (Flores and Oñate 2005)."""
    now, before = _patch(x, rest, there), _patch(rest, rest, there)
    return np.concatenate([now[0] - before[0], now[1] - before[1]])


def _patch(x, rest, there):
    """Metric and curvature of a patch of four triangles, by shape functions of the whole patch."""
    edge = rest[1] - rest[0]
    corner = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    flat = _frame(rest[:3], corner, edge)
    plain = np.linalg.solve((rest[:3].T @ corner).T @ flat, corner.T)  # (2, 3) slopes
    tangents = x[:3].T @ plain.T
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    normal /= np.linalg.norm(normal)
    metric, bend = np.zeros((2, 2)), np.zeros((2, 2))
    for side, (xi, eta) in enumerate(((0.5, 0.5), (0.0, 0.5), (0.5, 0.0))):
        if there[side]:
            h = 1e-6  # the functions are of second order: central differences are exact
            natural = np.stack([
                (_quadratic(xi + h, eta) - _quadratic(xi - h, eta)) / (2 * h),
                (_quadratic(xi, eta + h) - _quadratic(xi, eta - h)) / (2 * h),
            ], axis=1)  # fmt: skip
            slopes = np.linalg.solve((rest.T @ natural).T @ _frame(rest, natural, edge), natural.T)
            along = x.T @ slopes.T
        else:
            along = tangents
        metric += along.T @ along / 3.0
        for a, b in itertools.product(range(2), repeat=2):
            bend[a, b] -= normal @ (plain[a, side] * along[:, b] + plain[b, side] * along[:, a])
    return (
        np.array([metric[0, 0] / 2.0, metric[1, 1] / 2.0, metric[0, 1]]),
        np.array([bend[0, 0], bend[1, 1], 2.0 * bend[0, 1]]),
    )


def _quadratic(xi, eta):
    """The six shape functions of a patch."""
    zeta = 1.0 - xi - eta
    return np.array([
        zeta + xi * eta, xi + eta * zeta, eta + zeta * xi,
        zeta * (zeta - 1.0) / 2.0, xi * (xi - 1.0) / 2.0, eta * (eta - 1.0) / 2.0,
    ])  # fmt: skip


def _frame(rest, natural, edge):
    """(3, 2) axes of the tangent plane, the first one as near to an edge as can be."""
    tangents = rest.T @ natural
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    normal /= np.linalg.norm(normal)
    first = edge - normal * (normal @ edge)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)], axis=1)


def triangle_energy(x, rest, there, young, poisson, thickness):
    """Energy of a triangle in plane stress."""
    area = np.linalg.norm(np.cross(rest[1] - rest[0], rest[2] - rest[0])) / 2.0
    law = young / (1.0 - poisson**2) * np.array([
        [1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, (1.0 - poisson) / 2.0]
    ])  # fmt: skip
    strains = triangle_strains(x, rest, there)
    stretch, bend = strains[:3], strains[3:]
    return area * (thickness * stretch @ law @ stretch + thickness**3 / 12.0 * bend @ law @ bend) / 2.0


def gradient(energy, x, h):
    """(n, 3) slope of an energy over positions, by differences of fourth order."""
    found = np.zeros_like(x)
    for place in np.ndindex(x.shape):
        values = []
        for shift in (-2.0, -1.0, 1.0, 2.0):
            moved = x.copy()
            moved[place] += shift * h
            values.append(energy(moved))
        found[place] = (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * h)
    return found
