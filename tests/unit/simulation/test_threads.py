"""Worlds shared among threads: the same bits for any number of them, and no thread that outlives its simulation."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.bench.measure import SceneRun
from simwarp.bench.workloads import bench_scenes
from simwarp.core.threads import Workers, thread_count
from simwarp.core.types import ModelError
from simwarp.simulation.world_launches import CHUNKS_PER_THREAD

COUNTS = (2, 3, 7)


def bits(sim: sw.Simulation) -> dict[str, bytes]:
    """Everything that a step changes and reports."""
    arrays = sim.snapshot().arrays() | {name: getattr(sim.diagnostics, name) for name in sim.diagnostics.NAMES}
    return {name: array.numpy().tobytes() for name, array in arrays.items()}


def names_of_workers() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("simwarp")]


def no_worker_is_left() -> bool:
    gc.collect()
    for _ in range(100):  # they end on their own, soon
        if not names_of_workers():
            return True
        time.sleep(0.02)
    return False


@pytest.mark.parametrize("name", [name for name in bench_scenes() if name != "pile"])
@pytest.mark.sweep
def test_scenes_have_the_same_bits(name, monkeypatch):
    """Nine worlds in motion: chunks of one, two and more worlds."""
    found: dict[int, Any] = {}
    for threads in (1, *COUNTS):
        monkeypatch.setenv("SIMWARP_THREADS", str(threads))
        run = SceneRun(bench_scenes()[name], 9, "cpu", None)
        assert len(run.sim.shares.ranges) == (1 if threads == 1 else min(9, CHUNKS_PER_THREAD * threads))
        run.set_motion()
        for _ in range(5):
            run.step()
        run.sim.advance(5)
        run.sim.reset(np.arange(9) % 4 == 1)
        run.sim.advance(2)
        found[threads] = bits(run.sim)
    for threads in COUNTS:
        assert [key for key, value in found[threads].items() if value != found[1][key]] == []


@pytest.mark.parametrize("worlds", [1, 2, 13])
def test_any_number_of_worlds(worlds):
    found = []
    for threads in (1, *COUNTS):
        model = scenes.ant().finalize(worlds, "cpu")
        sim = sw.Simulation(model, 5e-3, threads=threads)
        rng = np.random.default_rng(1)
        q = rng.uniform(-0.2, 0.2, (worlds, model.dof_count))
        sim.set_joint_state(None, q, rng.uniform(-1.0, 1.0, q.shape))
        for _ in range(3):
            sim.advance(4)
            sim.set_joint_state(np.arange(worlds) % 2 == 0, q, None)
            sim.measure()
        found.append((bits(sim), sim.measure_energy().numpy().tobytes()))
    assert all(each == found[0] for each in found[1:])


def test_advancing_is_stepping():
    sims = [sw.Simulation(scenes.ant().finalize(5, "cpu"), 5e-3, substeps=2, threads=2) for _ in range(2)]
    for _ in range(6):
        sims[0].step()
    sims[1].advance(6)
    assert bits(sims[0]) == bits(sims[1])


@wp.kernel(enable_backward=False)
def push(force: wp.array2d[wp.vec3], counter: wp.array[int]):
    """A force that grows with every step."""
    world = wp.tid()
    counter[world] = counter[world] + 1  # type: ignore[index]
    force[world, 0] = wp.vec3(0.0, 0.0, float(counter[world]))  # type: ignore[index]


class Push(sw.ForceElement):
    """A force element whose launch was recorded by Warp itself."""

    def __init__(self, worlds: int) -> None:
        self.count = wp.zeros(worlds, dtype=int, device="cpu")

    @property
    def memory(self):
        return {"count": self.count}

    def record(self, simulation, dt):
        force = simulation.control.element_force
        return [wp.launch(push, dim=force.shape[0], record_cmd=True, device="cpu",
                          inputs=[force, self.count])]  # fmt: skip


def test_a_launch_of_warp_runs_between_the_others_and_is_named():
    found = []
    for threads in (1, 3):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            sim = sw.Simulation(scenes.ant().finalize(9, "cpu"), 5e-3, elements=[Push(9)], threads=threads)
        assert [str(each.message).split(" will run")[0] for each in told] == ["Simulation: push"] * (threads > 1)
        sim.advance(20)
        found.append(bits(sim))
    assert found[0] == found[1]


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5", "4096"])
def test_numbers_of_threads_that_are_none(text, monkeypatch):
    monkeypatch.setenv("SIMWARP_THREADS", text)
    with pytest.raises(ModelError, match="SIMWARP_THREADS must be a whole number from 1 to 1024, got"):
        thread_count()


@pytest.mark.parametrize("value", [0, -3, 2.0, "2", True, 1025])
def test_wrong_threads(value):
    with pytest.raises(ModelError, match="threads must be a whole number from 1 to 1024, got"):
        sw.Simulation(scenes.pendulum().finalize(1, "cpu"), 1e-3, threads=value)


def test_the_default(monkeypatch):
    monkeypatch.delenv("SIMWARP_THREADS", raising=False)
    assert thread_count() == len(os.sched_getaffinity(0))
    monkeypatch.setenv("SIMWARP_THREADS", "5")
    assert thread_count() == 5
    assert thread_count(2) == 2


def test_what_a_worker_raises_is_raised_here():
    def work() -> None:
        raise KeyError("sand")

    with pytest.raises(KeyError, match="sand"):
        Workers(2).run(work)
    assert no_worker_is_left()


def test_a_simulation_may_end_while_work_is_handed_out(monkeypatch):
    """Garbage is collected anywhere: also where the pool, or what is below it, holds a lock that is not to be taken
    twice. A run hung there.
    """
    assert no_worker_is_left()
    others, done = [Workers(3), Workers(3)], []
    submit = ThreadPoolExecutor.submit

    def while_others_end(executor: Any, *arguments: Any) -> Any:
        with executor._shutdown_lock:
            others.clear()
        return submit(executor, *arguments)

    monkeypatch.setattr(ThreadPoolExecutor, "submit", while_others_end)

    def run() -> None:
        Workers(2).run(lambda: done.append(1))

    thread = threading.Thread(target=run, daemon=True)  # a lock that is never released must not hang the tests
    thread.start()
    thread.join(timeout=20.0)
    assert not thread.is_alive()
    assert done == [1, 1]
    assert no_worker_is_left()


def test_threads_end_with_the_last_simulation():
    assert no_worker_is_left()
    sims = [sw.Simulation(scenes.pendulum().finalize(8, "cpu"), 1e-3, threads=threads) for threads in (2, 3)]
    for sim in sims:
        sim.step()
    assert 0 < len(names_of_workers()) <= 5
    del sim
    sims.pop()
    sims[0].step()
    assert names_of_workers()
    sims.pop()
    assert no_worker_is_left()


@pytest.mark.slow
def test_a_thousand_simulations_leave_nothing_behind():
    model = scenes.pendulum().finalize(8, "cpu")
    resident = []
    for round_ in range(1000):
        sim = sw.Simulation(model, 1e-3, threads=3)
        sim.step()
        del sim
        if round_ in (199, 999):
            assert no_worker_is_left()
            resident.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
    assert resident[1] - resident[0] < 8e6  # 10 kB each would be 8 MB


FORKED = """
import os, sys
import simwarp as sw
from simwarp import scenes
sim = sw.Simulation(scenes.pendulum().finalize(8, "cpu"), 1e-3, threads=2)
sim.step()
child = os.fork()
if child == 0:
    sim.step()
    other = sw.Simulation(scenes.pendulum().finalize(8, "cpu"), 1e-3, threads=3)
    other.step()
    os._exit(7 if abs(sim.time.numpy()[7] - 2e-3) < 1e-9 else 8)
_, status = os.waitpid(child, 0)
sim.step()
print(os.waitstatus_to_exitcode(status), round(float(sim.time.numpy()[0]), 6))
"""


@pytest.mark.slow
def test_a_child_process_steps_on():
    """Fork copies no thread: the child makes its own, the parent keeps its."""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKED], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-2:] == ["7", "0.002"], done.stdout


INTERRUPTED = """
import os, signal, sys, threading, time
import numpy as np
import simwarp as sw
from simwarp import scenes
sim = sw.Simulation(scenes.ant().finalize(64, "cpu"), 5e-3, threads=3)
sim.advance(10)
threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    while True:
        sim.advance(50)
except KeyboardInterrupt:
    times = np.unique(sim.time.numpy())
    del sim
    print("interrupted", len(times))
"""


def test_ctrl_c_leaves_all_worlds_at_one_time():
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "interrupted 1", done.stdout
