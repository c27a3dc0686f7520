"""Every check of `simwarp verify`, on the float32 engine; bounds and their reasons are in the checks' docstrings.

Deviations that are known and explained may not grow.
"""

import inspect

import pytest

from simwarp.verify import SCENES, mechanism_checks as mechanisms
from simwarp.verify.check_result import CheckResult, below, near
from simwarp.verify.known import Verdict, verdict


def require(rows: list[CheckResult]) -> bool:
    assert rows
    missed = [row for row in rows if verdict(row) is Verdict.FAILED]
    assert not missed, "\n" + "\n".join(
        f"{row.scene}: {row.quantity}: got {row.got:.9g}, expected {row.expected:.9g} within {row.tolerance:.3g}"
        for row in missed
    )
    return True


# A minute of many bricks, balls or wheels each: laws of the same contacts and soils are held by quicker tests
LONG = {"vehicles", "wall", "arch", "stack", "pile", "card-house", "soil", "tracks"}
CHECKS = [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in SCENES]


@pytest.mark.long("andrews", "bricard", "four-bar", "chain", "double-pendulum", "free-spin", "bouncing", "cube-stack")
@pytest.mark.parametrize("name", CHECKS)
def test_known_answers(name):
    assert require(SCENES[name]("cpu"))


def test_one_more_projection_pass_converges():
    _, _, once = mechanisms.chain_rows(1.0, 1)
    _, _, twice = mechanisms.chain_rows(1.0, 2)
    # Newton along the step's rows: each pass gains the share of h w that the poses turned, 1/30 and better here
    assert twice < 0.1 * once


def test_every_check_says_what_and_why():
    for check in SCENES.values():
        assert len(inspect.getdoc(check) or "") > 80


def test_a_row_passes_within_its_tolerance_only():
    assert near("scene", "quantity", 1.0, 1.1, 0.11).passed
    assert not near("scene", "quantity", 1.0, 0.8, 0.11).passed
    assert not below("scene", "quantity", float("nan"), 1.0).passed
    assert not below("scene", "quantity", -2.0, 1.0).passed
    assert near("scene", "q [m]", 1.0, 2.0, 0.5).as_dict() == {
        "scene": "scene", "quantity": "q [m]", "expected": 1.0, "got": 2.0, "tolerance": 0.5, "pass": False,
    }  # fmt: skip
