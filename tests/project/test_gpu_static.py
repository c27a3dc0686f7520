"""What kernels cost on a GPU, held to budgets without one; and the script of the first day on one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from scripts import gpu_static

ROOT = Path(__file__).resolve().parents[2]
REGISTERS = 168
"""A thread's share of a multiprocessor on which twelve warps work."""
MORE_REGISTERS = {
    "load_state": 183, "publish_bodies": 172, "bias_rotations": 190, "compute_reactions": 188,
    "list_triangles": 182, "clip_triangles": 174,
    "join_triangles": 192, "solve_by_psor": 218, "solve_by_spg": 242, "solve_by_padmm": 184, "solve_by_apgd": 246,
    "descend_for_padmm": 234, "descend_for_interior_point": 246, "step_newton": 225,
}  # fmt: skip
"""What they have; not more. Steps of arrays whose innermost axis is the world, and of lanes, are registers too: eight
warps of the solvers work (docs/gpu.md, Lanes that share a world)."""
OVER_BUDGET = {
    "start_newton", "follow_newton", "start_newton_of_islands", "follow_newton_of_islands",
    "solve_by_apgd_of_islands", "step_newton_of_islands", "refine_newton_of_islands", "refine_following_of_islands",
}  # fmt: skip
"""Newton steps of the interior point, in double precision: compiled only where it may run (docs/decisions.md); and what
only worlds of several units run, whose problems are views (docs/accuracy.md, CUDA without a GPU).
"""
COMPILE_CPU_S = 20.0
CODE = 300_000
"""Bytes of machine code of a module: the second-level instruction cache holds about as much."""
STEP = [kernel.key.rpartition("__")[2] for kernel in gpu_static.step_kernels()]


@pytest.fixture(scope="module")
def ptxas():
    found = gpu_static.assembler()
    if found is None:
        pytest.skip("ptxas is not installed: pip install nvidia-cuda-nvcc")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(STEP)), ids=STEP)
def test_a_part_of_the_step_keeps_its_budgets(index, ptxas):
    """No spills, few registers, little code, and seconds to compile."""
    (cost,) = gpu_static.costs_of(gpu_static.step_kernels()[index].module, ptxas)
    assert cost.compile_cpu_s <= COMPILE_CPU_S
    if STEP[index] not in OVER_BUDGET:
        assert cost.spilled == 0
        assert cost.registers <= MORE_REGISTERS.get(STEP[index], REGISTERS)
        assert cost.code <= CODE


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is a GPU")
def test_the_first_day_skips_every_stage_by_name_without_a_gpu(tmp_path):
    done = subprocess.run(
        ["bash", "scripts/gpu_day.sh", str(tmp_path)], cwd=ROOT, capture_output=True, text=True, timeout=120,
        env={"PATH": "/usr/bin:/bin", "PY": sys.executable, "HOME": str(tmp_path)},
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    assert len(lines) > 15
    assert all(line.startswith("skipped  ") and line.endswith(": no CUDA device") for line in lines), done.stdout


def test_what_does_not_begin_in_time_is_skipped(tmp_path):
    done = subprocess.run(
        ["bash", "scripts/gpu_day.sh", "--rehearse", str(tmp_path), "ant", "stack"], cwd=ROOT, capture_output=True,
        text=True, timeout=120, env={"PATH": "/usr/bin:/bin", "PY": "/bin/false", "BUDGET": "14"},
    )  # fmt: skip
    assert done.stdout.splitlines() == [f"skipped  {name}: no time left of 14 s (BUDGET)" for name in ("ant", "stack")]


def test_stages_can_be_chosen(tmp_path):
    done = subprocess.run(
        ["bash", "scripts/gpu_day.sh", str(tmp_path), "ant", "verify"], cwd=ROOT, capture_output=True, text=True,
        timeout=120, env={"PATH": "/usr/bin:/bin", "PY": "/bin/false", "HOME": str(tmp_path)},
    )  # fmt: skip
    assert [line.split(":")[0] for line in done.stdout.splitlines()] == ["skipped  ant", "skipped  verify"]
