"""Learning rates that follow the progress of a run: down to 0 at its end, by a line or a cosine."""

import math

import pytest

from simwarp.tasks import InputError, make
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import Objective, PPOConfig, Schedule, TrainConfig

ITERATIONS, FIRST = 4, 2e-3
EXPECTED = {
    Schedule.LINEAR: [FIRST * (1.0 - k / ITERATIONS) for k in range(ITERATIONS)],
    Schedule.COSINE: [FIRST * 0.5 * (1.0 + math.cos(math.pi * k / ITERATIONS)) for k in range(ITERATIONS)],
    Schedule.FIXED: [FIRST] * ITERATIONS,
}


@pytest.mark.parametrize("schedule", list(EXPECTED))
@pytest.mark.parametrize("threads", [1, 2])
def test_each_iteration_learns_at_its_rate(schedule, threads):
    config = TrainConfig(
        num_envs=8, iterations=ITERATIONS, steps_per_iteration=4, device="cpu", threads=threads,
        ppo=PPOConfig(learning_rate=FIRST, schedule=schedule),
    )  # fmt: skip
    trainer = Trainer(make("fast", 8), config)
    rates = []
    for _ in range(ITERATIONS):
        reported = trainer.iterate().values["learning_rate"]
        (used,) = {group["lr"] for group in trainer.algorithm.optimizer.param_groups}
        assert used == reported
        rates.append(used)
    trainer.close()
    assert rates == pytest.approx(EXPECTED[schedule])


def test_the_kl_penalty_has_a_rule_of_its_own():
    with pytest.raises(InputError, match="schedule must be left out under the KL penalty"):
        TrainConfig(ppo=PPOConfig(objective=Objective.KL_PENALTY, schedule=Schedule.LINEAR))
