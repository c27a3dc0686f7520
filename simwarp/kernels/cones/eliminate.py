"""Bilateral rows are eliminated before the cones are solved: rows a..b of a dense problem, redundant ones included.

With S = N_cc - N_cb N_bb^-1 N_bc the rest is a cone problem of its own. From N alone that difference is all there is.
With the mechanics it is formed as Y^T Y with Y = (1 - A_b N_bb^-1 A_b^T)^2 A_c, A = L^T D, M^-1 = L L^T: the second
pass removes what rounding left along the joints, and one more projection at the end makes the joints hold to rounding.
"""

import warp as wp

from simwarp.kernels.cones.dense import add_to_row, cholesky, cholesky_solve, dot_rows, dot_rows_wide

wp.set_module_options({"enable_backward": False})

NOISE = wp.constant(3.0e-6)
"""Relative rounding error: a diagonal entry reduced below this share of itself is zero, the joints hold its row."""


@wp.struct
class DenseSystem:
    """One problem as it is given, and room to eliminate. Bilateral rows come first."""

    rows: int
    bilateral: int
    velocities: int  # 0: only n and r are given

    n: wp.array2d[float]  # (rows, rows)
    r: wp.array[float]
    gamma: wp.array2d[float]  # (2, rows): all impulses, and what they have beyond float32
    jacobian: wp.array2d[float]  # (velocities, rows): D
    inverse_mass: wp.array2d[float]  # (velocities, velocities)
    free_velocity: wp.array[float]

    # scratch and results
    root: wp.array2d[float]  # (velocities, velocities): L^T, row by row
    a: wp.array2d[float]  # (rows, velocities): A^T
    y: wp.array2d[float]  # (cone rows, velocities): Y^T
    change: wp.array2d[float]  # (2, velocities): velocity change over L, and its copy
    compliance: wp.array[float]  # (rows,): diagonal of N beyond D^T M^-1 D
    n_bb: wp.array2d[float]  # (bilateral, bilateral): its factor
    c: wp.array2d[float]  # (cone rows, bilateral): (N_bb^-1 N_bc)^T
    work: wp.array2d[float]  # (3, rows)


@wp.func
def factor_bilateral(system: DenseSystem):
    """Sets n_bb <- Cholesky factor of the bilateral rows of n."""
    for i in range(system.bilateral):
        for j in range(i + 1):
            system.n_bb[i, j] = system.n[i, j]
    cholesky(system.bilateral, system.n_bb, 0.0)


@wp.func
def solve_column(system: DenseSystem, row: int):
    """c[row] <- N_bb^-1 N_b,row, refined once."""
    nb = system.bilateral
    source = nb + row
    for i in range(nb):
        system.c[row, i] = system.n[source, i]
    cholesky_solve(nb, system.n_bb, system.c, row)
    for i in range(nb):
        system.work[0, i] = -dot_rows_wide(-system.n[source, i], nb, system.n, i, system.c, row)
    cholesky_solve(nb, system.n_bb, system.work, 0)
    for i in range(nb):
        system.c[row, i] += system.work[0, i]


@wp.func
def reduce_delassus(system: DenseSystem, s: wp.array2d[float], r: wp.array[float], diagonal: wp.array[float]):
    """s, r, diagonal <- the Schur complement of the bilateral rows, from N alone."""
    nb = system.bilateral
    cones = system.rows - nb
    for i in range(nb):
        system.work[1, i] = system.r[i]
    for row in range(cones):
        solve_column(system, row)
        r[row] = system.r[nb + row] - dot_rows(nb, system.c, row, system.work, 1)
        for col in range(row + 1):
            value = system.n[nb + row, nb + col]
            # Both halves, so that the result is symmetric whatever the rounding of c.
            taken = dot_rows(nb, system.n, nb + row, system.c, col) + dot_rows(nb, system.n, nb + col, system.c, row)
            value -= 0.5 * taken
            s[row, col] = value
            s[col, row] = value
        diagonal[row] = pivot_or_zero(s[row, row], system.n[nb + row, nb + row])


@wp.func
def pivot_or_zero(value: float, before: float) -> float:
    """The diagonal left after elimination, zero where it is rounding."""
    if value > NOISE * before:
        return value
    return 0.0


@wp.func
def bilateral_impulses(system: DenseSystem):
    """Sets gamma of the bilateral rows <- what makes their u zero, refined twice; gamma of the cones is known."""
    nb = system.bilateral
    for i in range(nb):
        system.gamma[0, i] = 0.0
    refine_bilateral(system, 3)


@wp.func
def refine_bilateral(system: DenseSystem, rounds: int):
    """Sets gamma of the bilateral rows <- corrected by what u of the given n is left there."""
    nb = system.bilateral
    for _ in range(rounds):
        for i in range(nb):
            system.work[0, i] = -dot_rows_wide(system.r[i], system.rows, system.n, i, system.gamma, 0)
        cholesky_solve(nb, system.n_bb, system.work, 0)
        for i in range(nb):
            system.gamma[0, i] += system.work[0, i]


@wp.func
def form_rows(system: DenseSystem):
    """Sets root <- L^T and a <- (L^T D)^T; n of a compliance-free problem is a a^T."""
    nv = system.velocities
    for i in range(nv):
        for j in range(nv):
            system.root[i, j] = system.inverse_mass[i, j]
    cholesky(nv, system.root, 0.0)
    for i in range(nv):
        if system.root[i, i] > 0.0:
            system.root[i, i] = 1.0 / system.root[i, i]
        for j in range(i):
            # L sits in the lower triangle; L^T is wanted row by row.
            system.root[j, i] = system.root[i, j]
            system.root[i, j] = 0.0
    for row in range(system.rows):
        for k in range(nv):
            total = float(0.0)
            for j in range(k, nv):
                total += system.root[k, j] * system.jacobian[j, row]
            system.a[row, k] = total


@wp.func
def find_compliance(system: DenseSystem):
    """Sets compliance <- what the diagonal of n has beyond a a^T, where that is more than rounding."""
    for row in range(system.rows):
        rigid = dot_rows(system.velocities, system.a, row, system.a, row)
        extra = system.n[row, row] - rigid
        if extra < 1.0e-5 * system.n[row, row]:
            extra = float(0.0)
        system.compliance[row] = extra


@wp.func
def reduce_mechanics(system: DenseSystem, s: wp.array2d[float], r: wp.array[float], diagonal: wp.array[float]):
    """s, r, diagonal <- the cone problem by two-pass projection; c keeps the bilateral impulses per cone impulse."""
    nb = system.bilateral
    nv = system.velocities
    cones = system.rows - nb
    for row in range(cones):
        for k in range(nv):
            system.y[row, k] = system.a[nb + row, k]
        for i in range(nb):
            system.c[row, i] = 0.0
        for _ in range(2):
            for i in range(nb):
                left = dot_rows(nv, system.a, i, system.y, row)
                system.work[0, i] = left - system.compliance[i] * system.c[row, i]
            cholesky_solve(nb, system.n_bb, system.work, 0)
            for i in range(nb):
                system.c[row, i] += system.work[0, i]
                add_to_row(nv, -system.work[0, i], system.a, i, system.y, row)
    clear_change(system)
    for i in range(nb):
        system.gamma[0, i] = 0.0
    project_change(system)
    project_change(system)
    for row in range(cones):
        r[row] = system.r[nb + row] + dot_rows(nv, system.a, nb + row, system.change, 0)
        for col in range(row + 1):
            value = dot_rows(nv, system.y, row, system.y, col)
            for i in range(nb):
                value += system.compliance[i] * system.c[row, i] * system.c[col, i]
            if col == row:
                value += system.compliance[nb + row]
            s[row, col] = value
            s[col, row] = value
        diagonal[row] = pivot_or_zero(s[row, row], system.n[nb + row, nb + row])


@wp.func
def clear_change(system: DenseSystem):
    """Sets change <- 0: the free velocity."""
    for k in range(system.velocities):
        system.change[0, k] = 0.0


@wp.func
def project_change(system: DenseSystem):
    """Sets change and the bilateral impulses <- with the joints' velocities brought to zero."""
    nb = system.bilateral
    nv = system.velocities
    for i in range(nb):
        u = dot_rows_wide(system.r[i], nv, system.a, i, system.change, 0)
        system.work[0, i] = -u - system.compliance[i] * system.gamma[0, i]
    cholesky_solve(nb, system.n_bb, system.work, 0)
    for i in range(nb):
        system.gamma[0, i] += system.work[0, i]
        add_to_row(nv, system.work[0, i], system.a, i, system.change, 0)


@wp.func
def bilateral_from_cones(system: DenseSystem):
    """Sets gamma of the bilateral rows <- what makes their u zero, given the cones' impulses; `change` likewise."""
    if system.velocities > 0:
        change_from_cones(system)
        refine_bilateral(system, 2)
    else:
        bilateral_impulses(system)


@wp.func
def cone_velocity(system: DenseSystem, row: int) -> float:
    """Velocity u of a cone row of the whole problem, at the present impulses."""
    i = system.bilateral + row
    return dot_rows_wide(system.r[i], system.rows, system.n, i, system.gamma, 0)


@wp.func
def change_from_cones(system: DenseSystem):
    """Sets change and the bilateral impulses <- from the cones' impulses, with a last projection."""
    nb = system.bilateral
    nv = system.velocities
    clear_change(system)
    for i in range(nb):
        system.gamma[0, i] = 0.0
    project_change(system)
    project_change(system)
    for row in range(system.rows - nb):
        gamma = system.gamma[0, nb + row]
        low = system.gamma[1, nb + row]
        if nb > 0:
            add_to_row(nv, gamma, system.y, row, system.change, 0)
            add_to_row(nv, low, system.y, row, system.change, 0)
        else:
            add_to_row(nv, gamma, system.a, row, system.change, 0)
            add_to_row(nv, low, system.a, row, system.change, 0)
        for i in range(nb):
            system.gamma[0, i] -= gamma * system.c[row, i]
    project_change(system)


@wp.func
def write_velocity(system: DenseSystem, velocity: wp.array[float]):
    """Sets velocity <- v+ from the change."""
    nv = system.velocities
    for k in range(nv):
        total = float(0.0)
        for j in range(k + 1):
            total += system.root[j, k] * system.change[0, j]
        velocity[k] = system.free_velocity[k] + total
