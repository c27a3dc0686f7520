"""The cone solve of a step in parts (step_parts.py): a kernel for each solver, of which a model compiles what it uses.

Accelerated gradient descent stands in where a solver cannot work: its kernel is launched, too, and each leaves the
worlds of the other alone. The interior point has two kernels, as a solver and as the one that follows another.
"""

import functools
from collections.abc import Callable
from typing import Any

import warp as wp

from simwarp.core.types import ConeSolver
from simwarp.kernels.cones.apgd import descend_first, descend_rest, keep_best, step_newton, wants_newton
from simwarp.kernels.cones.interior_point import can_factorise, finish_interior_point, start_interior_point
from simwarp.kernels.cones.islands import island_problem, island_start, whole_problem
from simwarp.kernels.cones.padmm import solve_padmm
from simwarp.kernels.cones.problem import LOW, ConeConfig, ConeProblem, SolveReport
from simwarp.kernels.cones.psor import solve_psor
from simwarp.kernels.cones.solve import FALLBACK_STEPS, INTERIOR_POINT
from simwarp.kernels.cones.spg import solve_spg
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.dynamics.cone_rows import assemble_dense
from simwarp.kernels.dynamics.step import NON_FINITE, cone_config
from simwarp.kernels.dynamics.step_parts import PART, StepState
from simwarp.kernels.dynamics.world import MODULE_OPTIONS, Scratch, pack_cone

wp.set_module_options(MODULE_OPTIONS)


@wp.func
def always(problem: ConeProblem, config: ConeConfig) -> bool:
    """A solver for every problem."""
    return True


@wp.func
def if_dense(problem: ConeProblem, config: ConeConfig) -> bool:
    """A solver that needs S."""
    return problem.dense == 1


@wp.func
def if_not_dense(problem: ConeProblem, config: ConeConfig) -> bool:
    """What `if_dense` leaves."""
    return problem.dense == 0


@wp.func
def if_not_factorised(problem: ConeProblem, config: ConeConfig) -> bool:
    """What the interior point leaves."""
    return not can_factorise(problem)


@wp.func
def descend(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Accelerated gradient descent until Newton steps are worth a try (`proximal_worlds_kernel`)."""
    report = descend_first(problem, config)
    keep_best(problem)
    return report


@wp.func
def step_on(problem: ConeProblem, config: ConeConfig, before: SolveReport) -> SolveReport:
    """Newton steps."""
    return step_newton(problem, config, before)


@wp.func
def descend_on(problem: ConeProblem, config: ConeConfig, before: SolveReport) -> SolveReport:
    """The rest of the descent."""
    return descend_rest(problem, config, before)


SOLVES: dict[ConeSolver, tuple[Any, Any]] = {
    ConeSolver.APGD: (always, descend), ConeSolver.PSOR: (always, solve_psor), ConeSolver.SPG: (always, solve_spg),
    ConeSolver.PADMM: (if_dense, solve_padmm),
}  # fmt: skip
STAND_INS = {ConeSolver.PADMM: if_not_dense, ConeSolver.INTERIOR_POINT: if_not_factorised}


@wp.func
def keep_report(island: int, solution: SolveReport, cone: ConeProblem):
    """For the kernels that follow."""
    cone.island_iterations[island] = solution.iterations
    cone.island_residual[island] = solution.residual


@wp.func
def restore_dense(problem: ConeProblem, islands: int):
    """Forms S once more, where another island has taken its room since."""
    if problem.dense == 1 and islands > 1:
        assemble_dense(problem)


@wp.func
def no_islands(world: int, step: StepState) -> int:
    """Worlds of one unit are solved whole."""
    return 0


@wp.func
def island_count(world: int, step: StepState) -> int:
    """Of worlds of several units; 0: there is one that moves everything."""
    return step.islands[world]


VIEWS = {False: (no_islands, whole_problem), True: (island_count, island_problem)}
"""How many problems a world has, and each of them, by whether it has several units."""


def _kernel(function: Callable[..., None], several: bool) -> wp.Kernel:
    """A part of the step; for worlds of several units, whose islands are solved in turn, under another name.

    Problems of islands are views into those of worlds: they take half as many registers again (docs/decisions.md).
    """
    name = function.__name__
    function.__qualname__ = name.replace("worlds", "islands") if several else name
    kernel: wp.Kernel = wp.kernel(**PART)(function)
    return kernel


@functools.cache
def solve_worlds_kernel(solver: ConeSolver, stand_in: bool = False, *, several: bool = False) -> wp.Kernel:
    """The kernel of one solver, which is not the interior point, or of gradient descent where a solver cannot work.

    Args:
        solver: that is chosen.
        stand_in: for what it cannot solve.
        several: worlds have several units, which may be islands.
    """
    applies, solve = (STAND_INS[solver], descend) if stand_in else SOLVES[solver]
    islands_of, problem_of = VIEWS[several]

    def solve_worlds(
        # inputs
        worlds: WorldRange,
        config: StepConfig,
        topology: Topology,
        scratch: Scratch,
        # in and out
        state: StateArrays,
        step: StepState,
    ):
        """Solves the cone problems of all worlds that have one for this solver."""
        world = worlds.first + wp.tid()
        if (state.world_status[world] & NON_FINITE) != 0 or step.blocks[world] == 0:
            return
        cone = pack_cone(scratch, scratch_slot_of(world, worlds))
        islands = islands_of(world, step)
        for island in range(wp.max(islands, 1)):
            problem = problem_of(island, islands, step.blocks[world], topology, config, cone)
            if applies(problem, cone_config(config)):
                if problem.dense == 1:
                    assemble_dense(problem)
                keep_report(island, solve(problem, cone_config(config)), cone)

    return _kernel(solve_worlds, several)


@functools.cache
def proximal_worlds_kernel(solver: ConeSolver, stand_in: bool, rest: bool, *, several: bool = False) -> wp.Kernel:
    """The kernel that goes on after gradient descent by proximal Newton steps, or with the `rest` of the descent."""
    applies = STAND_INS[solver] if stand_in else always
    go_on = descend_on if rest else step_on
    islands_of, problem_of = VIEWS[several]

    def proximal_worlds(
        # inputs
        worlds: WorldRange,
        config: StepConfig,
        topology: Topology,
        scratch: Scratch,
        # in and out
        state: StateArrays,
        step: StepState,
    ):
        """Goes on with all worlds that gradient descent has left to Newton steps."""
        world = worlds.first + wp.tid()
        if (state.world_status[world] & NON_FINITE) != 0 or step.blocks[world] == 0:
            return
        cone = pack_cone(scratch, scratch_slot_of(world, worlds))
        numbers = cone_config(config)
        islands = islands_of(world, step)
        for island in range(wp.max(islands, 1)):
            problem = problem_of(island, islands, step.blocks[world], topology, config, cone)
            if applies(problem, numbers) and wants_newton(problem, numbers, cone.island_residual[island]):
                restore_dense(problem, islands)
                before = SolveReport()
                before.iterations = cone.island_iterations[island]
                solution = go_on(problem, numbers, before)
                keep_best(problem)
                keep_report(island, solution, cone)

    return _kernel(proximal_worlds, several)


@wp.func
def newton_config(config: StepConfig, follows: int) -> ConeConfig:
    """Numbers of the interior point."""
    numbers = cone_config(config)
    if follows == 1:
        numbers.solver = INTERIOR_POINT
        numbers.max_iterations = FALLBACK_STEPS
    return numbers


@functools.cache
def newton_worlds_kernel(*, several: bool = False) -> wp.Kernel:
    """The kernel of Newton steps of the interior point."""
    islands_of, problem_of = VIEWS[several]

    def newton_worlds(
        # inputs
        worlds: WorldRange,
        config: StepConfig,
        topology: Topology,
        follows: int,
        scratch: Scratch,
        # in and out
        state: StateArrays,
        step: StepState,
    ):
        """Newton steps of the interior point; with `follows`, where another solver has missed the tolerance."""
        world = worlds.first + wp.tid()
        if (state.world_status[world] & NON_FINITE) != 0 or step.blocks[world] == 0:
            return
        scratch_slot = scratch_slot_of(world, worlds)
        cone = pack_cone(scratch, scratch_slot)
        islands = islands_of(world, step)
        for island in range(wp.max(islands, 1)):
            cone.newton_steps[island] = -1
            problem = problem_of(island, islands, step.blocks[world], topology, config, cone)
            wanted = can_factorise(problem)
            if follows == 1:
                wanted = wanted and not cone.island_residual[island] <= config.tolerance
            if wanted:
                problem.dense = 1  # which it is: no code for others
                if follows == 0:
                    assemble_dense(problem)
                else:
                    restore_dense(problem, islands)
                    start = island_start(island, islands, cone)
                    for row in range(problem.row_count):
                        scratch.kept[scratch_slot, start + row] = problem.gamma[row]
                found = start_interior_point(problem, newton_config(config, follows))
                cone.newton_steps[island] = found.iterations
                cone.newton_residual[island] = found.residual

    return _kernel(newton_worlds, several)


@functools.cache
def refine_worlds_kernel(*, several: bool = False) -> wp.Kernel:
    """The kernel of the gradient steps after them."""
    islands_of, problem_of = VIEWS[several]

    def refine_worlds(
        # inputs
        worlds: WorldRange,
        config: StepConfig,
        topology: Topology,
        follows: int,
        scratch: Scratch,
        # in and out
        state: StateArrays,
        step: StepState,
    ):
        """Gradient steps after them; with `follows`, the better of the two solutions."""
        world = worlds.first + wp.tid()
        if (state.world_status[world] & NON_FINITE) != 0 or step.blocks[world] == 0:
            return
        scratch_slot = scratch_slot_of(world, worlds)
        cone = pack_cone(scratch, scratch_slot)
        islands = islands_of(world, step)
        for island in range(wp.max(islands, 1)):
            if cone.newton_steps[island] >= 0:
                problem = problem_of(island, islands, step.blocks[world], topology, config, cone)
                problem.dense = 1
                restore_dense(problem, islands)
                newton = SolveReport()
                newton.iterations = cone.newton_steps[island]
                newton.residual = cone.newton_residual[island]
                solution = finish_interior_point(problem, newton_config(config, follows), newton)
                if follows == 1:
                    solution.iterations += cone.island_iterations[island]
                    if not solution.residual < cone.island_residual[island]:
                        solution.residual = cone.island_residual[island]
                        start = island_start(island, islands, cone)
                        for row in range(problem.row_count):
                            problem.gamma[row] = scratch.kept[scratch_slot, start + row]
                            problem.vectors[LOW, row] = 0.0
                keep_report(island, solution, cone)

    return _kernel(refine_worlds, several)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All solvers; those of islands stand for each other, but for the interior point."""
    alone = [solve_worlds_kernel(solver) for solver in SOLVES]
    stand_ins = [solve_worlds_kernel(solver, True) for solver in STAND_INS]
    on = [proximal_worlds_kernel(ConeSolver.APGD, False, rest) for rest in (False, True)]
    several = [
        solve_worlds_kernel(ConeSolver.APGD, several=True),
        proximal_worlds_kernel(ConeSolver.APGD, False, False, several=True),
    ]
    last = [make(several=each) for each in (False, True) for make in (newton_worlds_kernel, refine_worlds_kernel)]
    return [*alone, *stand_ins, *on, *several, *last]
