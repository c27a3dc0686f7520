"""Counts of a campaign: what was tried, what became of it, what failed; and the driver of Hypothesis."""

import collections
import dataclasses
import fcntl
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, Phase, assume, given, seed, settings, strategies as st

from tests.campaign.oracle import Attack, Outcome

REPORT_VARIABLE, SEED_VARIABLE = "SIMWARP_CAMPAIGN_REPORT", "SIMWARP_CAMPAIGN_SEED"
DEFAULT_SEED = 20260713
TOLD = 25
"""Failures of a front that its test tells in full."""


def campaign_seed() -> int:
    """The seed of the full campaign."""
    return int(os.environ.get(SEED_VARIABLE, DEFAULT_SEED))


@dataclasses.dataclass
class Tally:
    """Figures of one front."""

    front: str
    seed: int | None
    examples: int = 0
    duration_s: float = 0.0
    results: collections.Counter = dataclasses.field(default_factory=collections.Counter)
    verdicts: collections.Counter = dataclasses.field(default_factory=collections.Counter)
    failures: collections.Counter = dataclasses.field(default_factory=collections.Counter)
    failed: list[str] = dataclasses.field(default_factory=list)

    def add(self, attack: Attack, outcome: Outcome) -> None:
        """Count one example."""
        self.examples += 1
        self.results[outcome.result] += 1
        self.verdicts[attack.verdict.value] += 1
        if outcome.failure:
            self.failures[outcome.failure] += 1
            self.failed.append(f"{outcome.failure}: {attack.what} -> {outcome.detail}")

    def content(self) -> dict:
        """What the report keeps."""
        return {name: dict(value) if isinstance(value, dict) else value for name, value in vars(self).items()}

    def write(self) -> None:
        """Add the figures to the report that the environment asks for."""
        name = os.environ.get(REPORT_VARIABLE)
        if not name:
            return
        with Path(name).open("a+") as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # test workers write to it too
            file.seek(0)
            fronts = json.loads(file.read() or '{"fronts": []}')["fronts"]
            others = [front for front in fronts if (front["front"], front["seed"]) != (self.front, self.seed)]
            file.truncate(0)
            file.write(json.dumps({"fronts": [*others, self.content()]}, indent=2) + "\n")

    def check(self) -> None:
        """Write the figures; fail if anything failed."""
        self.write()
        told = "\n".join(self.failed[:TOLD])
        assert not self.failed, f"{self.front}: {len(self.failed)} of {self.examples} failed\n{told}"


def run_front(
    front: str, attacks: st.SearchStrategy, perform: Callable[[Attack], Outcome], examples: int, chosen: int | None
) -> Tally:
    """Try so many examples, all of them also where some fail; derandomised where there is no seed."""
    tally = Tally(front, chosen)
    begin = time.perf_counter()
    tried: set[str] = set()

    @settings(
        max_examples=examples,
        database=None,
        deadline=None,
        derandomize=chosen is None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(attacks)
    def each(attack: Attack) -> None:
        assume(attack.what not in tried)  # Hypothesis repeats itself
        tried.add(attack.what)
        tally.add(attack, perform(attack))

    (each if chosen is None else seed(chosen)(each))()
    tally.duration_s = round(time.perf_counter() - begin, 1)
    return tally
