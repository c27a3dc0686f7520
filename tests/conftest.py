"""What every test needs: quiet Warp, one thread, the CPU by default, and no CUDA test without a CUDA device."""

import os

# Before NumPy and torch are imported: two test workers with a thread pool each would fight over the cores.
for _name in ("SIMWARP_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

import gc
import signal
import tempfile
from pathlib import Path
from typing import Any

# Tests interrupt themselves: in the background of a shell, which ignores Ctrl-C (nohup: hang-ups), they would wait on
_handlers: list[tuple[int, Any]] = [(signal.SIGINT, signal.default_int_handler)]
if hasattr(signal, "SIGHUP"):  # Windows has none
    _handlers.append((signal.SIGHUP, signal.SIG_DFL))
for _number, _handler in _handlers:
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _handler)

# What tests pass off as a decomposition is none that a user should find again
os.environ["SIMWARP_CACHE"] = tempfile.mkdtemp(prefix="simwarp-tests-")

import pytest
from hypothesis import HealthCheck, settings

# How long an example takes says how busy the machine is
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

# What is imported and collected stays: looking for garbage in it costs a fifth of the collection, and again in tests
gc.disable()


def pytest_collection_finish() -> None:
    """Leave what was collected out of all later searches for garbage."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    """Import what takes seconds where tests run, which is not where they are handed out to workers."""
    if config.getoption("numprocesses", None) and "PYTEST_XDIST_WORKER" not in os.environ:
        return
    import torch
    import warp as wp

    from simwarp.core.warp_start import start_warp

    wp.config.log_level = wp.LOG_WARNING
    torch.set_num_threads(1)
    start_warp()
    wp.set_device("cpu")  # also where there is a GPU: a test that is for one says so, and is marked `cuda`


@pytest.fixture(scope="session", autouse=True)
def _kernels() -> None:
    """Test workers share the compilation of the large kernels instead of doing it twice."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        from tests.compiled import compile_together

        compile_together()


MEASURED = Path(__file__).with_name("slow_tests.txt")
"""Names of tests that take more than a second, one in a line."""
SWEEP = 5
"""Of the cases of a test marked `sweep`, one in so many, and at least two, are part of `make test`."""
STALE = pytest.StashKey[list[str]]()
"""What marks and the list of slow tests name, and what is not there: a test reads it, for workers end in silence."""


def _mark_sweeps(items: list[pytest.Item]) -> None:
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("sweep"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for same in cases.values():
        step = min(SWEEP, max(1, len(same) // 2))
        for index, item in enumerate(same):
            if index % step:
                item.add_marker(pytest.mark.slow)


@pytest.fixture
def stale_names(request: pytest.FixtureRequest) -> list[str]:
    """Tests and cases that are named as slow or quick, and are not there; none when only a part was collected."""
    return request.config.stash[STALE]


def _mark_measured(items: list[pytest.Item], *, all_there: bool) -> list[str]:
    names = {line for line in MEASURED.read_text(encoding="utf-8").splitlines() if not line.startswith("#")}
    for item in items:
        if item.nodeid in names:
            item.add_marker(pytest.mark.slow)
    # Cases may depend on what is installed, as whole files do
    tests = {item.nodeid.partition("[")[0] for item in items}
    files = {test.partition("::")[0] for test in tests}
    named = {name.partition("[")[0] for name in names}
    return sorted(test for test in named - tests if all_there and test.partition("::")[0] in files)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark slow cases of tests (`quick`, `long`, `sweep`); skip tests marked `cuda` where Warp finds no CUDA device."""
    sampled: dict[str, tuple[set[str], set[str]]] = {}
    for item in items:
        quick, long = item.get_closest_marker("quick"), item.get_closest_marker("long")
        mark = quick or long
        if mark is None or not isinstance(item, pytest.Function):
            continue
        case = item.callspec.id
        sampled.setdefault(item.nodeid.partition("[")[0], (set(mark.args), set()))[1].add(case)
        if (case in mark.args) == (long is not None):
            item.add_marker(pytest.mark.slow)
    all_there = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    stale = _mark_measured(items, all_there=all_there)
    if all_there:  # and so all their cases
        stale += [f"{test}[{case}]" for test, (named, cases) in sampled.items() for case in sorted(named - cases)]
    config.stash[STALE] = stale
    _mark_sweeps(items)
    marked = [item for item in items if item.get_closest_marker("cuda")]
    import warp as wp

    if marked and not wp.is_cuda_available():
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="needs a CUDA device"))
