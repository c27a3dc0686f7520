"""The full campaign: 10 000 examples in one process, a hundred command lines of them through the installed command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.campaign.fronts import FRONTS, perform
from tests.campaign.oracle import HANG, START, CommandAttack, Run, judge_command
from tests.campaign.strategies_commands import command_lines
from tests.campaign.tally import campaign_seed, run_front

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", FRONTS)
def test_front(name, place):
    front = FRONTS[name]
    run_front(name, front.attacks(place), perform(place), front.full, campaign_seed()).check()


def _installed(attack, sandbox):
    """Run a command line as a user does."""
    command = [str(Path(sys.executable).with_name("simwarp")), *attack.words]
    with sandbox.inside():
        try:
            done = subprocess.run(
                [os.fsencode(word) for word in command],
                capture_output=True,
                timeout=HANG + START,
                stdin=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired:
            run = Run(None, "", "", "installed command", hung=True)
        else:
            out, err = (stream.decode("utf-8", "replace") for stream in (done.stdout, done.stderr))
            run = Run(done.returncode, out, err, err[-300:] if "Traceback" in err else "")
    try:
        return judge_command(attack, run, sandbox)
    finally:
        sandbox.restore()


def _is_typed(attack: CommandAttack) -> bool:
    """Whether a shell could hand it over: no NUL, no half surrogate."""
    try:
        return all("\0" not in os.fsencode(word).decode("latin-1") for word in attack.words)
    except UnicodeEncodeError:
        return False


def test_installed_command(place):
    attacks = command_lines().filter(_is_typed)
    run_front(
        "installed command", attacks, lambda attack: _installed(attack, place.sandbox), 100, campaign_seed()
    ).check()
