"""The example that swings poles up without a policy does so from every start and for every seed."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "plan_cart_pole.py"
SECONDS, PERIOD = 8.0, 0.05


def example() -> Any:
    spec = importlib.util.spec_from_file_location("plan_cart_pole", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_poles_are_swung_up_and_balanced(seed):
    swing = example().SwingUp(worlds=4, samples=64, seed=seed)
    assert not swing.upright().any()
    for step in range(round(SECONDS / PERIOD)):
        swing.step()
        if step * PERIOD >= SECONDS - 1.0:
            assert swing.upright().all(), step * PERIOD
