"""pytest plugin: models that tests make for the CPU are made for the emulated device.

`python -m tests.emulated_cuda -m pytest -p tests.emulated_cuda.force_cuda tests/unit/simulation`
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.emulated_cuda.device import device


def pytest_sessionstart(session: pytest.Session) -> None:
    """Let the builder choose another device."""
    from simwarp.model.builder import ModelBuilder

    finalize = ModelBuilder.finalize

    def finalize_there(self: ModelBuilder, *args: Any, **kwargs: Any) -> Any:
        arguments = list(args)
        if len(arguments) > 1 and arguments[1] in ("cpu", None):
            arguments[1] = "cuda:0"
        elif kwargs.get("device") in ("cpu", None):
            kwargs["device"] = "cuda:0"
        return finalize(self, *arguments, **kwargs)

    ModelBuilder.finalize = finalize_there  # type: ignore[method-assign]


@pytest.fixture(autouse=True)
def _no_fault_stays() -> Iterator[None]:
    """Print a test's faults, and let the next one begin without them."""
    faults = device().faults
    faults.clear()
    before = len(faults.violations)
    yield
    for text, _ in faults.violations[before:]:
        print("emulated CUDA:", text)
