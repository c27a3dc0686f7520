"""A table of stages makes one kernel for a CPU and one per stage for a GPU, which do the same."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Set
from typing import Any

import numpy as np
import pytest
import warp as wp

from simwarp.core.types import ArrayLayout, ConeSolver, WorldStatus
from simwarp.kernels.collision.collision_stages import STAGES
from simwarp.kernels.cones.problem import ConeScratch
from simwarp.kernels.core.scratch import make_memory, slot_function
from simwarp.kernels.core.stages import (
    Stage,
    StageLocal,
    StageRoom,
    attributes_of,
    fused_kernel,
    parameters_of,
    separate_kernel,
)
from simwarp.kernels.core.tables import WorkScratch
from simwarp.kernels.dynamics.solve_stages import cone_solve, solver_stages, stages_for_cuda_check
from simwarp.kernels.dynamics.step_stages import stage_kernel, step_stages
from simwarp.simulation.world_launches import WorldShares
from tests.unit.kernels.core.toy_stages import NUMBERS, TOY_MEMORY, Options, State, Toy, ToyScratch

WORLDS = 5


def pack_toy(name: str, only: Set[str] | None = None, *, inline: bool | None = None) -> wp.Function:
    function: wp.Function = slot_function(name, "toy", ToyScratch, NUMBERS, TOY_MEMORY, only=only, inline=inline)
    return function


def toy_room() -> StageRoom:
    return StageRoom(
        module="toy", options={"enable_backward": False},
        arguments={"options": Options, "scratch": TOY_MEMORY, "state": State},
        locals={"numbers": StageLocal(pack_toy("pack_toy"), "scratch", pack_toy)},
    )  # fmt: skip


def toy_stages() -> list[Stage]:
    return [
        Stage(name="double", function=Toy.double, reads="value", writes="numbers"),
        Stage(name="square", function=Toy.square, reads="numbers", writes="numbers", when=Toy.has_squares),
        Stage(name="publish", function=Toy.publish, reads="numbers", writes="value"),
    ]


def run(*, squares: int, separate: bool) -> np.ndarray:
    """The values after all stages of five worlds, of which the third is frozen."""
    options: Any = Options()
    options.squares = squares
    state: Any = State()
    state.world_status = wp.array([0, 0, int(WorldStatus.NON_FINITE), 0, 0], dtype=int, device="cpu")
    state.value = wp.array([1.0, 2.0, 3.0, 4.0, 5.0], dtype=float, device="cpu")
    shares = WorldShares(WORLDS, 1, wp.get_device("cpu"))
    slots = WORLDS if separate else 1
    scratch = make_memory(TOY_MEMORY, {"number": ArrayLayout((slots, 1), wp.float32)}, "cpu")
    given = {"options": options, "scratch": scratch, "state": state}
    stages = [stage for stage in toy_stages() if not separate or stage.is_due(given)]
    room = toy_room()
    made = [separate_kernel(stage, room) for stage in stages] if separate else [fused_kernel("toy", stages, room)]
    for each in made:
        for worlds in shares.ranges:
            worlds.own_slots = int(separate)
            inputs = [worlds, *(given[name] for name in each.arguments)]
            wp.launch(each.kernel, dim=WORLDS if separate else 1, inputs=inputs, device="cpu")
    assert len(made) == (1 if not separate else 2 + squares)
    values: np.ndarray = state.value.numpy()
    return values


@pytest.mark.parametrize("squares", [0, 1])
def test_both_ways_run_the_stages_that_are_due_and_leave_frozen_worlds_alone(squares):
    doubled = 2.0 * np.array([1.0, 2.0, 1.5, 4.0, 5.0])
    expected = doubled**2 if squares else doubled
    expected[2] = 3.0
    for separate in (False, True):
        np.testing.assert_array_equal(run(squares=squares, separate=separate), expected)


def test_a_kernel_has_the_arguments_of_its_functions_alone():
    room = toy_room()
    double, square, publish = toy_stages()
    assert separate_kernel(double, room).arguments == ("scratch", "state")
    assert separate_kernel(square, room).arguments == ("scratch", "state")
    assert fused_kernel("toy", [double, publish], room).arguments == ("scratch", "state")
    assert fused_kernel("toy", [double, square, publish], room).arguments == ("options", "scratch", "state")


def test_a_kernel_of_one_stage_finds_what_the_stage_and_what_it_calls_ask_for():
    assert attributes_of(Toy.publish) == {"number", "value"}
    assert attributes_of(Toy.publish_sum) == {"number", "value", "other", "colour"}, "the last in native code"
    asked: list[tuple[str, Set[str] | None, bool | None]] = []

    def part(name: str, only: Set[str] | None = None, *, inline: bool | None = None) -> wp.Function:
        asked.append((name, only, inline))
        return pack_toy(name, only, inline=inline)

    room = dataclasses.replace(toy_room(), locals={"numbers": StageLocal(pack_toy("pack_toy"), "scratch", part)})
    separate_kernel(toy_stages()[1], room)
    fused_kernel("toy", toy_stages(), room)
    assert asked == [
        ("numbers_for_square", {"number"}, None),
        ("numbers_for_toy", {"number", "squares", "value"}, False),
    ]


GPU_STAGES = {stage.name: stage for stage in step_stages(stages_for_cuda_check())}
FOUND = re.compile(r"static CUDA_CALLABLE \w+ \w+_for_\w+\(.*?^\}", re.MULTILINE | re.DOTALL)


@pytest.mark.quick("collect_bounds", "publish_bodies")
@pytest.mark.parametrize("name", GPU_STAGES)
def test_a_kernel_of_a_gpu_finds_all_arrays_that_its_code_asks_for(monkeypatch, tmp_path, name):
    """In the code that Warp writes: an array that was not found would be a null pointer."""
    monkeypatch.setattr("warp._src.build.build_cuda", lambda *given, **options: None)
    kernel = stage_kernel(GPU_STAGES[name]).kernel
    wp.compile_aot_module(kernel.module, device=None, arch=90, module_dir=tmp_path, use_ptx=True)
    code = next(tmp_path.rglob("*.cu")).read_text(encoding="utf-8")
    own = "".join(FOUND.findall(code))
    found = set(re.findall(r"// found\.(\w+) = ", own))
    asked = set(re.findall(r"\(\(?var_\w+\)\.(\w+)\)", FOUND.sub("", code)))
    for group, local in ((WorkScratch, "work"), (ConeScratch, "cone")):
        if f"{local}_for_{name}" in own:
            arrays = {key for key, each in group.ARRAYS.items() if each.lengths}
            assert asked & arrays <= found
            assert len(found & arrays) < len(arrays)


def test_what_no_kernel_has_is_named():
    stage = Stage(name="lost", function=Toy.lost, reads="nothing", writes="nothing")
    with pytest.raises(ValueError, match="toy: stages ask for colour, which their kernels do not have"):
        separate_kernel(stage, toy_room())


def all_stages() -> dict[str, list[Stage]]:
    return {
        "step of a CPU": list(step_stages([cone_solve(True)])),
        "step of a GPU": list(step_stages(stages_for_cuda_check())),
        "collision": list(STAGES),
    }


@pytest.mark.parametrize("table", all_stages())
def test_tables_name_each_stage_once_and_say_what_it_is_for(table):
    stages = all_stages()[table]
    names = [stage.name for stage in stages]
    assert len(set(names)) == len(names)
    for stage in stages:
        assert stage.reads, stage.name
        assert stage.writes, stage.name
        assert parameters_of(stage.function)[0] == "world", stage.name
        assert (stage.function.__doc__ or stage.function.func.__doc__ or "").strip(), stage.name


def test_solvers_of_a_model_come_once_each():
    """Whatever the solver: no kernel twice, and islands have kernels of their own."""
    for solver in ConeSolver:
        for several in (False, True):
            names = [stage.name for stage in solver_stages(solver, rows=30, several=several, newton=True, follows=True)]
            assert len(set(names)) == len(names), solver
            assert all(name.endswith("_of_islands") == several for name in names)
