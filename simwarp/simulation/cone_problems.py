"""Batches of cone complementarity problems given as matrices, outside of any simulation."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.constraints import Ge, Le, Meaning, NotNegative, Whole
from simwarp.core.memory import check_layouts
from simwarp.core.types import FLOAT32_MAX, BlockKind, ConeSolver, FrictionLaw, formatted
from simwarp.kernels.cones.batch import BatchInput, BatchSizes, batch_layouts, make_batch_scratch, solve_batch
from simwarp.kernels.cones.problem import ConeConfig
from simwarp.model.model import resolve_device
from simwarp.model.rules import RULES, Flag, word_of
from simwarp.simulation.solver_options import MOST_ITERATIONS

Array = npt.NDArray[np.float64]
Rows: TypeAlias = Annotated[Whole, Meaning("the number of such rows")]

SOLVERS = {solver.name.lower(): solver for solver in ConeSolver}
FRICTION_LAWS = {law.name.lower(): law for law in FrictionLaw}
ITERATIONS = {
    ConeSolver.APGD: 2000,
    ConeSolver.PSOR: 10000,
    ConeSolver.SPG: 10000,
    ConeSolver.PADMM: 5000,
    ConeSolver.INTERIOR_POINT: 25,
}
"""Default of `max_iterations`: of the interior point per solve, of which there are up to six with the exact law."""

AIM = 20.0
"""Solvers stop at the tolerance divided by this."""

ASYMMETRY = 1.0e-4
"""Greatest |N - N^T| relative to the greatest entry; what is less is taken for rounding and averaged."""


@dataclasses.dataclass(frozen=True)
class ConeSolution:
    """Result of `solve_cone_problems`: float32 arrays of the kind that r was given in (NumPy, torch or Warp)."""

    impulse: Any
    """(problems, rows) [N·s or N·m·s], rows in the order of the problem."""
    residual: Any
    """(problems,) of the natural map, greatest over limits and contacts [m/s or rad/s]."""
    iterations: Any
    """(problems,) int32, of all solves together."""
    velocity: Any = None
    """(problems, velocities) v+ [m/s or rad/s] when the mechanics are given."""


@RULES.arguments("solve_cone_problems")
def solve_cone_problems(
    N: Any,
    r: Any,
    mu: Any,
    *,
    bilateral_count: Rows = 0,
    limit_count: Rows = 0,
    jacobian: Any = None,
    inverse_mass: Any = None,
    free_velocity: Any = None,
    bias: Any = None,
    solver: Annotated[str, word_of(*SOLVERS)] = "apgd",
    friction_law: Annotated[str, word_of(*FRICTION_LAWS)] = "convex",
    tolerance: Annotated[NotNegative, Meaning("m/s, 0 to use all iterations")] = 1.0e-5,
    max_iterations: Annotated[int, Ge(1), Le(MOST_ITERATIONS), Meaning("one, or leave it out")] | None = None,
    warm_start: Any = None,
    fallback: Flag = True,
    device: Any = None,
) -> ConeSolution:
    """Solves u = N gamma + r, gamma in K, u in K*, gamma^T u = 0 for a batch of problems (or a single one).

    Rows come in the order bilateral (gamma free, u = 0), limits (gamma >= 0), contacts (n, t1, t2 with
    `|t| <= mu n`). Redundant rows are welcome. Bilateral rows are eliminated first: from N alone by its Schur
    complement; with the mechanics, v+ = free_velocity + inverse_mass jacobian gamma, by velocity projection, which is
    ten to a hundred times more accurate in float32. Rows that nothing moves (zero diagonal) get no impulse.

    Args:
        N: (problems, rows, rows) Delassus matrix D^T M^-1 D, plus any compliance on its diagonal, symmetric positive
            semidefinite. None when the mechanics are given: formed from them.
        r: (problems, rows) velocities at zero impulse, D^T v_free + b [m/s or rad/s]. None when the mechanics are
            given: formed from them and `bias`.
        mu: (problems, contacts) or (contacts,) friction coefficients.
        bilateral_count: number of bilateral rows.
        limit_count: number of limits.
        jacobian: (problems, velocities, rows) D.
        inverse_mass: (problems, velocities, velocities), or (problems, velocities) its diagonal.
        free_velocity: (problems, velocities) v_free [m/s or rad/s].
        bias: (problems, rows) b [m/s or rad/s], used when r is None; zeros when None.
        solver: "apgd", "psor", "spg", "padmm" or "interior_point".
        friction_law: "convex" is the cone complementarity problem as it stands; "exact" adds De Saxcé's term: Coulomb's
            law, whose sliding contacts do not separate.
        tolerance: residual to reach [m/s or rad/s]. Solvers aim for a twentieth of it, as far as float32 goes: where a
            problem is ill-conditioned, velocities are further off than the residual suggests.
        max_iterations: per solver when None (`ITERATIONS`).
        warm_start: (problems, rows) impulses to start from [N·s or N·m·s].
        fallback: let the interior point solve what "apgd" leaves above the tolerance.
        device: device of the solve, on which the results are; None: that of r (of the jacobian without r), and for
            NumPy's the default.

    Raises:
        ValueError: an argument breaks a rule that the message names, with the value received and the remedy.
    """
    given = _Given.read(N, r, mu, jacobian, inverse_mass, free_velocity, bias, warm_start)
    given.check(bilateral_count, limit_count)
    config = ConeConfig()
    chosen = SOLVERS[solver]
    config.solver, config.friction_law = int(chosen), int(FRICTION_LAWS[friction_law])
    config.tolerance = tolerance / AIM
    config.max_iterations = max_iterations or ITERATIONS[chosen]
    batch_fallback = 1 if fallback and chosen == ConeSolver.APGD else 0
    where = resolve_device(_home(jacobian if r is None else r) if device is None else device)
    outputs = _launch(given, bilateral_count, limit_count, config, batch_fallback, where)
    return _wrapped(outputs, given)


@dataclasses.dataclass
class _Given:
    """The arguments as float64 NumPy arrays with a batch axis."""

    n: Array
    r: Array
    mu: Array
    start: Array
    jacobian: Array | None
    inverse_mass: Array | None
    free_velocity: Array | None
    single: bool
    kind: str
    bilateral: int = 0

    @classmethod
    def read(
        cls, n: Any, r: Any, mu: Any, jacobian: Any, inverse_mass: Any, free_velocity: Any, bias: Any, start: Any
    ) -> _Given:
        """Converts, adds the batch axis, and forms what was left out."""
        mechanics = {"jacobian": jacobian, "inverse_mass": inverse_mass, "free_velocity": free_velocity}
        missing = [name for name, value in mechanics.items() if value is None]
        if missing and len(missing) < 3:
            raise ValueError(
                f"jacobian, inverse_mass and free_velocity must be given together, got none for {missing[0]}; "
                "pass all three or none"
            )
        for name, value in (("N", n), ("r", r)):
            if value is None and missing:
                raise ValueError(f"{name} must be an array when the mechanics are not given, got None; pass {name}")
        kind = _kind(r if r is not None else jacobian)
        lead = _numbers("r", r) if r is not None else _numbers("free_velocity", free_velocity)
        if lead.ndim not in (1, 2):
            name = "r" if r is not None else "free_velocity"
            raise ValueError(f"{name} must have 1 or 2 axes, got shape {lead.shape}; pass (problems, n) or (n,)")
        single = lead.ndim == 1
        count = 1 if single else lead.shape[0]
        d = m = v = None
        if not missing:
            d = _batched("jacobian", jacobian, 3, single)
            rows = d.shape[2]
            v = _shaped("free_velocity", free_velocity, (count, d.shape[1]), single)
            _expect("jacobian", d, (count, d.shape[1], rows), single)
            m = _mass(inverse_mass, count, d.shape[1], single)
        else:
            rows = lead.shape[-1]
        if n is None:
            assert d is not None
            assert m is not None
            matrix = np.swapaxes(d, 1, 2) @ m @ d
        else:
            matrix = _shaped("N", n, (count, rows, rows), single)
        if r is None:
            assert d is not None
            assert v is not None
            offset = np.einsum("pvn,pv->pn", d, v)
            offset = offset if bias is None else offset + _shaped("bias", bias, (count, rows), single)
        else:
            offset = _shaped("r", r, (count, rows), single)
        friction = _numbers("mu", mu if mu is not None else [])
        if friction.ndim == 1:
            friction = np.broadcast_to(friction, (count, friction.shape[0]))
        if friction.ndim != 2 or friction.shape[0] != count:
            raise ValueError(f"mu must have shape ({count}, contacts), got {friction.shape}; pass one row per problem")
        begin = np.zeros((count, rows)) if start is None else _shaped("warm_start", start, (count, rows), single)
        return cls(matrix, offset, friction, begin, d, m, v, single, kind)

    def check(self, bilateral: int, limits: int) -> None:
        """Refuses problems that the solvers cannot solve."""
        rows = self.r.shape[1]
        contacts = self.mu.shape[1]
        if bilateral + limits + 3 * contacts != rows:
            raise ValueError(
                f"mu must have one entry per contact: bilateral_count {bilateral} + limit_count {limits} + 3 x "
                f"{contacts} contacts = {bilateral + limits + 3 * contacts}, got {rows} rows; change the counts or mu"
            )
        if (self.mu < 0.0).any():
            raise ValueError(f"mu must be >= 0, got {self.mu.min():g}; pass 0 for contacts without friction")
        if self.n.size == 0:
            return
        for name, array in (("N", self.n), ("r", self.r)):  # formed from the mechanics, maybe
            _check_float32(name, array)
        diagonal = np.einsum("pii->pi", self.n)
        if (diagonal < 0.0).any():
            raise ValueError(
                f"N must be positive semidefinite, got {diagonal.min():g} on its diagonal; pass D^T M^-1 D + compliance"
            )
        size = np.abs(self.n).max(axis=(1, 2))
        skew = np.abs(self.n - np.swapaxes(self.n, 1, 2)).max(axis=(1, 2))
        worst = int(np.argmax(skew - ASYMMETRY * size))
        if skew[worst] > ASYMMETRY * size[worst]:
            raise ValueError(
                f"N must be symmetric, got |N - N^T| up to {skew[worst]:g} in problem {worst}; pass 0.5 (N + N^T)"
            )
        self.n = 0.5 * (self.n + np.swapaxes(self.n, 1, 2))


def _home(value: Any) -> str | None:
    """Name of the device that a Warp array or tensor lies on."""
    return str(value.device) if _kind(value) != "numpy" else None


def _kind(value: Any) -> str:
    """Name of the library that an array is of: "warp", "torch" or "numpy"."""
    if isinstance(value, wp.array):
        return "warp"
    return "torch" if hasattr(value, "data_ptr") else "numpy"


def _numbers(name: str, value: Any) -> Array:
    """Any array as float64 NumPy, finite."""
    try:
        if isinstance(value, wp.array):
            value = value.numpy()
        elif hasattr(value, "data_ptr"):
            value = value.detach().cpu().numpy()
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise ValueError(f"{name} must be an array of numbers, got {formatted(value)}; pass NumPy's") from error
    if array.dtype.kind not in "iuf" and array.size:
        raise ValueError(f"{name} must be an array of numbers, got {formatted(value)}; pass NumPy's")
    array = array.astype(np.float64)
    _check_float32(name, array)
    return array


def _check_float32(name: str, array: Array) -> None:
    """A ValueError where kernels would see NaN or infinity."""
    bad = array[~(np.abs(array) <= FLOAT32_MAX)]
    if bad.size:
        beyond = " and at most 3.4e38" if np.isfinite(bad[0]) else ""
        raise ValueError(
            f"{name} must be finite{beyond}, got {bad[0]} among {array.size} values; remove or mask such problems"
        )


def _batched(name: str, value: Any, axes: int, single: bool) -> Array:
    """`_numbers` with the batch axis, the number of axes checked."""
    array = _numbers(name, value)
    array = array[None] if single else array
    if array.ndim != axes:
        raise ValueError(
            f"{name} must have {axes - single} axes, got shape {array.shape[single:]}; give all arguments "
            f"{'without' if single else 'with'} a batch axis"
        )
    return array


def _expect(name: str, array: Array, shape: tuple[int, ...], single: bool) -> None:
    """Raises where an array has another shape."""
    if array.shape != shape:
        raise ValueError(
            f"{name} must have shape {shape[single:]}, got {array.shape[single:]}; match it with the other arguments"
        )


def _shaped(name: str, value: Any, shape: tuple[int, ...], single: bool) -> Array:
    """`_batched` of exactly this shape."""
    array = _batched(name, value, len(shape), single)
    _expect(name, array, shape, single)
    return array


def _mass(value: Any, count: int, velocities: int, single: bool) -> Array:
    """The inverse mass as full matrices."""
    array = _numbers("inverse_mass", value)
    array = array[None] if single else array
    if array.shape == (count, velocities):
        array = array[:, :, None] * np.eye(velocities)
    _expect("inverse_mass", array, (count, velocities, velocities), single)
    return array


def _floats(array: Array, device: wp.Device) -> wp.array:
    """A float32 Warp array with at least one element per axis, so that kernels can take views."""
    shape = tuple(max(size, 1) for size in array.shape)
    data = np.zeros(shape, dtype=np.float32)
    data[tuple(slice(0, size) for size in array.shape)] = array
    return wp.array(data, dtype=float, device=device)


def _launch(
    given: _Given, bilateral: int, limits: int, config: ConeConfig, fallback: int, device: wp.Device
) -> tuple[wp.array, wp.array, wp.array, wp.array]:
    """Uploads, solves; impulse, velocity, residual, iterations."""
    problems, rows = given.r.shape
    contacts = given.mu.shape[1]
    velocities = 0 if given.jacobian is None else given.jacobian.shape[1]
    # A CPU takes the problems in turn: one slot stays in its cache.
    scratch_slots = 1 if device.is_cpu else max(problems, 1)
    sizes = BatchSizes(rows=rows, bilateral=bilateral, velocities=velocities)
    layouts = batch_layouts(scratch_slots, sizes)
    more = 4 * problems * (rows * (rows + velocities + 4) + velocities * (velocities + 2))
    check_layouts("solve_cone_problems: its arrays", layouts, device, "solve fewer or smaller problems at a time", more)
    batch: Any = BatchInput()
    batch.rows, batch.bilateral, batch.blocks = rows, bilateral, limits + contacts
    batch.velocities, batch.fallback = velocities, fallback
    batch.n, batch.r, batch.start = (_floats(a, device) for a in (given.n, given.r, given.start))
    batch.friction = _floats(np.concatenate([np.zeros((problems, limits)), given.mu], axis=1), device)
    if given.jacobian is not None:
        assert given.inverse_mass is not None
        assert given.free_velocity is not None
        batch.jacobian = _floats(given.jacobian, device)
        batch.inverse_mass = _floats(given.inverse_mass, device)
        batch.free_velocity = _floats(given.free_velocity, device)
    first = [*range(limits), *range(limits, limits + 3 * contacts + 1, 3)]
    kinds = [int(BlockKind.BOX)] * limits + [int(BlockKind.CONTACT)] * contacts
    batch.block_row = wp.array(first, dtype=int, device=device)
    batch.block_kind = wp.array(kinds or [0], dtype=int, device=device)
    cones = max(rows - bilateral, 1)
    batch.lower = wp.zeros(cones, dtype=float, device=device)
    batch.upper = wp.full(cones, float("inf"), dtype=float, device=device)
    batch.zeros = wp.zeros(max(limits + contacts, 1), dtype=float, device=device)
    scratch = make_batch_scratch(device, scratch_slots, sizes)
    impulse = wp.zeros((problems, rows), dtype=float, device=device)
    velocity = wp.zeros((problems, velocities), dtype=float, device=device)
    residual = wp.zeros(problems, dtype=float, device=device)
    iterations = wp.zeros(problems, dtype=int, device=device)
    if problems > 0 and rows > 0:
        inputs = [config, batch, scratch, impulse, velocity, residual, iterations]
        wp.launch(solve_batch, dim=problems, inputs=inputs, device=device)
    elif problems > 0 and velocities > 0:
        assert given.free_velocity is not None
        velocity.assign(given.free_velocity.astype(np.float32))
    return impulse, velocity, residual, iterations


def _wrapped(outputs: tuple[wp.array, wp.array, wp.array, wp.array], given: _Given) -> ConeSolution:
    """The results in the caller's kind of array, without a batch axis if there was none."""

    def out(array: wp.array) -> Any:
        if given.kind == "numpy":
            value = array.numpy()
        elif given.kind == "torch":
            from simwarp.core.interop import to_torch  # torch only where the caller already has it

            value = to_torch(array)
        else:
            return array[0] if given.single and array.ndim > 1 else array
        return value[0] if given.single else value

    impulse, velocity, residual, iterations = outputs
    return ConeSolution(out(impulse), out(residual), out(iterations), None if given.jacobian is None else out(velocity))
