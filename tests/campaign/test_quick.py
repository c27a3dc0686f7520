"""The quick campaign: the same examples every time, some hundred over all fronts; the full one is in test_full.py."""

import pytest

from tests.campaign.fronts import FRONTS, perform
from tests.campaign.options import options_of
from tests.campaign.strategies_builder import CALLS, public_methods
from tests.campaign.strategies_commands import BASES
from tests.campaign.tally import run_front


@pytest.mark.parametrize("name", FRONTS)
def test_front(name, place):
    front = FRONTS[name]
    run_front(name, front.attacks(place), perform(place), front.quick, chosen=None).check()


def test_every_public_method_of_the_builder_is_called():
    assert sorted(public_methods()) == sorted(CALLS)


def test_every_command_and_its_options_are_attacked():
    from simwarp.cli import COMMANDS

    assert {base.command for base in BASES} == set(COMMANDS)
    found = {option.name for base in BASES for option in options_of(base.command, base.first)}
    assert {"--json", "--num-envs", "--ppo.gamma", "--task.dt", "--worlds", "--grid", "--network.hidden"} <= found
    assert len(found) > 100
