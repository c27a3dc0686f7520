"""The cone solve of a step (step_stages.py): one stage with all solvers on a CPU; on a GPU some for each solver, of
which a model compiles what it uses.

Accelerated gradient descent stands in where a solver cannot work: its stage runs, too, and each leaves the worlds of
the other alone. The interior point has two stages, as a solver and as the one that follows another.
"""

import functools

import warp as wp

from simwarp.core.types import ConeSolver
from simwarp.kernels.cones.apgd import descend_first, descend_rest, keep_best, needs_newton, solve_apgd, step_newton
from simwarp.kernels.cones.interior_point import can_factorise, finish_interior_point, start_interior_point
from simwarp.kernels.cones.islands import island_problem, island_start, whole_problem
from simwarp.kernels.cones.padmm import solve_padmm
from simwarp.kernels.cones.problem import LOW, ConeConfig, ConeProblem, SolveReport
from simwarp.kernels.cones.psor import solve_psor
from simwarp.kernels.cones.solve import FALLBACK_STEPS, INTERIOR_POINT, gradient_config, solve_with_fallback
from simwarp.kernels.cones.spg import solve_spg
from simwarp.kernels.core.lanes import lane_of, lanes_for
from simwarp.kernels.core.stages import Stage
from simwarp.kernels.core.tables import StepConfig, StepProgress, Topology
from simwarp.kernels.dynamics.cone_rows import assemble_dense
from simwarp.kernels.dynamics.step import cone_config, has_cones

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

READS = "blocks, responses"
WRITES = "impulses, iterations and residuals of islands"


@wp.func
def keep_report(island: int, solution: SolveReport, cone: ConeProblem):
    """For the stages that follow."""
    if lane_of(cone.lanes) == 0:
        cone.island_iterations[island] = solution.iterations
        cone.island_residual[island] = solution.residual


@wp.func
def solve_quickly(problem: ConeProblem, config: ConeConfig, kept: wp.array[float]) -> SolveReport:
    """Accelerated gradient descent alone."""
    return solve_apgd(problem, config)


@wp.func
def solve_or_fall_back(problem: ConeProblem, config: ConeConfig, kept: wp.array[float]) -> SolveReport:
    """The solver of the configuration, and the interior point for what it leaves above the tolerance."""
    return solve_with_fallback(problem, config, 1, kept)


@functools.cache
def cone_solve(all_solvers: bool) -> Stage:
    """The stage of a CPU: the whole solve, by accelerated gradient descent alone or by all solvers."""
    solve = solve_or_fall_back if all_solvers else solve_quickly

    @wp.func(inline=True)
    def solve_cones(
        world: int, config: StepConfig, topology: Topology, progress: StepProgress, cone: ConeProblem,
        kept: wp.array[float],
    ):  # fmt: skip
        """Solves the cone problems of a world, island by island."""
        blocks = progress.blocks[world]
        if blocks > 0:
            islands = progress.islands[world]
            for island in range(wp.max(islands, 1)):
                problem = island_problem(island, islands, blocks, topology, config, cone)
                if problem.dense == 1:
                    assemble_dense(problem)
                keep_report(island, solve(problem, cone_config(config), kept), cone)

    return Stage(name="solve_cones", function=solve_cones, reads=READS, writes=WRITES, when=has_cones)


@wp.func
def always(problem: ConeProblem) -> bool:
    """A solver for every problem."""
    return True


@wp.func
def if_dense(problem: ConeProblem) -> bool:
    """A solver that needs S."""
    return problem.dense == 1


@wp.func
def if_not_dense(problem: ConeProblem) -> bool:
    """What `if_dense` leaves."""
    return problem.dense == 0


@wp.func
def if_not_factorised(problem: ConeProblem) -> bool:
    """What the interior point leaves."""
    return not can_factorise(problem)


@wp.func
def descend(problem: ConeProblem, config: ConeConfig) -> SolveReport:
    """Accelerated gradient descent until Newton steps are worth a try (`resume_stage`)."""
    report = descend_first(problem, config)
    keep_best(problem)
    return report


SOLVERS = {
    ConeSolver.APGD: (always, descend),
    ConeSolver.PSOR: (always, solve_psor),
    ConeSolver.SPG: (always, solve_spg),
    ConeSolver.PADMM: (if_dense, solve_padmm),
}  # fmt: skip
STAND_INS = {ConeSolver.PADMM: if_not_dense, ConeSolver.INTERIOR_POINT: if_not_factorised}
"""Which problems of a solver accelerated gradient descent solves for it."""


@wp.func
def restore_dense(problem: ConeProblem, islands: int):
    """Forms S once more, where another island has taken its room since."""
    if problem.dense == 1 and islands > 1:
        assemble_dense(problem)


@wp.func
def no_islands(world: int, progress: StepProgress) -> int:
    """Worlds of one unit are solved whole."""
    return 0


@wp.func
def island_count(world: int, progress: StepProgress) -> int:
    """Of worlds of several units; 0: there is one that moves everything."""
    return progress.islands[world]


VIEWS = {False: (no_islands, whole_problem), True: (island_count, island_problem)}
"""How many problems a world has, and each of them, by whether it has several units. Problems of islands are views into
those of worlds: they take half as many registers again (docs/decisions.md).
"""


def _stage(name: str, function: object, several: bool, lanes: int = 1) -> Stage:
    name = f"{name}_of_islands" if several else name
    return Stage(name=name, function=function, reads=READS, writes=WRITES, when=has_cones, lanes=lanes)


@functools.cache
def solve_stage(solver: ConeSolver, stand_in: bool, several: bool, lanes: int = 1) -> Stage:
    """The stage of one solver, which is not the interior point, or of gradient descent where a solver cannot work.

    Args:
        solver: that is chosen.
        stand_in: for what it cannot solve.
        several: worlds have several units, which may be islands.
        lanes: of a warp, that share a world: gradient descent knows them.
    """
    applies, solve = (STAND_INS[solver], descend) if stand_in else SOLVERS[solver]
    islands_of, problem_of = VIEWS[several]

    @wp.func(inline=True)
    def solve_problems(world: int, config: StepConfig, topology: Topology, progress: StepProgress, cone: ConeProblem):
        """Solves the cone problems of a world that are for this solver."""
        if progress.blocks[world] > 0:
            numbers = gradient_config(cone_config(config))
            islands = islands_of(world, progress)
            shared = cone
            shared.lanes = wp.static(lanes)
            for island in range(wp.max(islands, 1)):
                problem = problem_of(island, islands, progress.blocks[world], topology, config, shared)
                if applies(problem):
                    if problem.dense == 1:
                        assemble_dense(problem)
                    keep_report(island, solve(problem, numbers), shared)

    name = solver.name.lower()
    return _stage(f"descend_for_{name}" if stand_in else f"solve_by_{name}", solve_problems, several, lanes)


@functools.cache
def resume_stage(stand_in: ConeSolver | None, rest: bool, several: bool, lanes: int) -> Stage:
    """The stage that goes on after gradient descent by proximal Newton steps, or with the `rest` of the descent, by
    `lanes` of a warp for a world.
    """
    applies = always if stand_in is None else STAND_INS[stand_in]
    go_on = descend_rest if rest else step_newton
    islands_of, problem_of = VIEWS[several]

    @wp.func(inline=True)
    def resume_problems(world: int, config: StepConfig, topology: Topology, progress: StepProgress, cone: ConeProblem):
        """Goes on with the problems that gradient descent has left to Newton steps."""
        if progress.blocks[world] > 0:
            numbers = gradient_config(cone_config(config))
            islands = islands_of(world, progress)
            shared = cone
            shared.lanes = wp.static(lanes)
            for island in range(wp.max(islands, 1)):
                if not cone.island_residual[island] <= numbers.tolerance:
                    problem = problem_of(island, islands, progress.blocks[world], topology, config, shared)
                    if applies(problem) and needs_newton(problem, numbers, cone.island_residual[island]):
                        restore_dense(problem, islands)
                        before = SolveReport()
                        before.iterations = cone.island_iterations[island]
                        solution = go_on(problem, numbers, before)
                        keep_best(problem)
                        keep_report(island, solution, shared)

    return _stage("descend_on" if rest else "step_newton", resume_problems, several, lanes)


@wp.func
def following_config(config: StepConfig) -> ConeConfig:
    """Numbers of the interior point, where it follows another solver."""
    numbers = cone_config(config)
    numbers.solver = INTERIOR_POINT
    numbers.max_iterations = FALLBACK_STEPS
    return numbers


@functools.cache
def start_newton_stage(several: bool) -> Stage:
    """The stage of Newton steps of the interior point, where it is the solver."""
    islands_of, problem_of = VIEWS[several]

    @wp.func(inline=True)
    def start_newton(world: int, config: StepConfig, topology: Topology, progress: StepProgress, cone: ConeProblem):
        """Newton steps of the interior point."""
        if progress.blocks[world] > 0:
            islands = islands_of(world, progress)
            for island in range(wp.max(islands, 1)):
                cone.newton_steps[island] = -1
                problem = problem_of(island, islands, progress.blocks[world], topology, config, cone)
                if can_factorise(problem):
                    problem.dense = 1  # which it is: no code for others
                    assemble_dense(problem)
                    found = start_interior_point(problem, cone_config(config))
                    cone.newton_steps[island] = found.iterations
                    cone.newton_residual[island] = found.residual

    return _stage("start_newton", start_newton, several)


@functools.cache
def follow_newton_stage(several: bool) -> Stage:
    """The stage of Newton steps of the interior point, where another solver has missed the tolerance."""
    islands_of, problem_of = VIEWS[several]

    @wp.func(inline=True)
    def follow_newton(
        world: int, config: StepConfig, topology: Topology, progress: StepProgress, cone: ConeProblem,
        kept: wp.array[float],
    ):  # fmt: skip
        """Newton steps of the interior point for what is left; the solution of before is kept."""
        if progress.blocks[world] > 0:
            islands = islands_of(world, progress)
            for island in range(wp.max(islands, 1)):
                cone.newton_steps[island] = -1
                problem = problem_of(island, islands, progress.blocks[world], topology, config, cone)
                if can_factorise(problem) and not cone.island_residual[island] <= config.tolerance:
                    problem.dense = 1
                    restore_dense(problem, islands)
                    start = island_start(island, islands, cone)
                    for row in range(problem.row_count):
                        kept[start + row] = problem.gamma[row]
                    found = start_interior_point(problem, following_config(config))
                    cone.newton_steps[island] = found.iterations
                    cone.newton_residual[island] = found.residual

    return _stage("follow_newton", follow_newton, several)


@functools.cache
def refine_newton_stage(follows: bool, several: bool) -> Stage:
    """The stage of the gradient steps after them; with `follows`, the better of the two solutions."""
    islands_of, problem_of = VIEWS[several]
    numbers_of = following_config if follows else cone_config

    @wp.func(inline=True)
    def refine_newton(
        world: int, config: StepConfig, topology: Topology, progress: StepProgress, cone: ConeProblem,
        kept: wp.array[float],
    ):  # fmt: skip
        """Gradient steps after Newton steps of the interior point."""
        if progress.blocks[world] > 0:
            islands = islands_of(world, progress)
            for island in range(wp.max(islands, 1)):
                if cone.newton_steps[island] >= 0:
                    problem = problem_of(island, islands, progress.blocks[world], topology, config, cone)
                    problem.dense = 1
                    restore_dense(problem, islands)
                    newton = SolveReport()
                    newton.iterations = cone.newton_steps[island]
                    newton.residual = cone.newton_residual[island]
                    solution = finish_interior_point(problem, numbers_of(config), newton)
                    if wp.static(follows):
                        solution.iterations += cone.island_iterations[island]
                        if not solution.residual < cone.island_residual[island]:
                            solution.residual = cone.island_residual[island]
                            start = island_start(island, islands, cone)
                            for row in range(problem.row_count):
                                problem.gamma[row] = kept[start + row]
                                problem.vectors[LOW, row] = 0.0
                    keep_report(island, solution, cone)

    return _stage("refine_following" if follows else "refine_newton", refine_newton, several)


def solver_stages(solver: ConeSolver, *, rows: int, several: bool, newton: bool, follows: bool) -> list[Stage]:
    """The stages of the cone solve on a GPU.

    Args:
        solver: that is chosen.
        rows: of a world, at most.
        several: worlds have several units, which may be islands.
        newton: proximal Newton steps may follow gradient descent: there is room for what they factorise.
        follows: the interior point solves what is left above the tolerance.
    """
    lanes = lanes_for(rows)

    def descent(stand_in: ConeSolver | None) -> list[Stage]:
        first = solve_stage(solver, stand_in is not None, several, lanes)
        return [first, *(resume_stage(stand_in, rest, several, lanes) for rest in (False, True) if newton)]

    stages = descent(solver) if solver in STAND_INS else []
    if solver == ConeSolver.INTERIOR_POINT:
        stages += [start_newton_stage(several), refine_newton_stage(False, several)]
    elif solver == ConeSolver.APGD:
        stages += descent(None)
    else:
        stages.append(solve_stage(solver, False, several))
    if follows:
        stages += [follow_newton_stage(several), refine_newton_stage(True, several)]
    return stages


def stages_for_cuda_check() -> list[Stage]:
    """All solvers; those of islands stand for each other, but for the interior point."""
    alone = [solve_stage(solver, False, False, 8 if solver == ConeSolver.APGD else 1) for solver in SOLVERS]
    stand_ins = [solve_stage(solver, True, False, 8) for solver in STAND_INS]
    on = [resume_stage(None, rest, False, 8) for rest in (False, True)]
    several = [solve_stage(ConeSolver.APGD, False, True, 32), resume_stage(None, False, True, 32)]
    newton = [
        stage for each in (False, True)
        for stage in (start_newton_stage(each), follow_newton_stage(each),
                      refine_newton_stage(False, each), refine_newton_stage(True, each))
    ]  # fmt: skip
    return [*alone, *stand_ins, *on, *several, *newton]
