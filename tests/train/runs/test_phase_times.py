"""Time by phase in ``progress.csv``: one control step of each rollout is timed in parts, and nothing else changes."""

import csv

import numpy as np
import pytest
import torch

import simwarp as sw
from simwarp.sensors import Imu, Mount
from simwarp.simulation.step_program import Phase, timed_phases
from simwarp.tasks import make
from simwarp.train.algorithm import learner
from simwarp.train.algorithm.phase_sample import UNTIMED, TimedStep
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import TrainConfig
from simwarp.train.runs.training import train

PHASES = {"time/simulate", "time/sense", "time/task", "time/policy", "time/learn"}
CONFIG = TrainConfig(num_envs=8, iterations=3, steps_per_iteration=4, device="cpu")


def test_phases_are_columns_of_the_progress_and_add_up_to_the_iteration(tmp_path):
    result = train("pendulum", CONFIG, make("pendulum", 1).config, root=tmp_path)
    with open(f"{result.run}/progress.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert set(rows[0]) >= PHASES
    for row in rows:
        seconds = {name: float(row[name]) for name in PHASES}
        assert seconds["time/sense"] == 0.0  # the pendulum has no sensor
        assert all(value > 0.0 for name, value in seconds.items() if name != "time/sense")
        steps = CONFIG.num_envs * CONFIG.steps_per_iteration
        # the rate of an iteration is rounded to a tenth
        assert sum(seconds.values()) == pytest.approx(steps / float(row["env_steps_per_s"]), rel=1e-2)


def test_a_timed_step_is_the_step_bit_by_bit(monkeypatch):
    def learnt():
        trainer = Trainer(make("quadruped-velocity", 8, seed=3), CONFIG)
        for _ in range(3):
            report = trainer.iterate()
        trainer.close()
        return report, torch.cat([p.detach().flatten() for p in trainer.algorithm.actor.parameters()])

    timed, weights = learnt()
    assert timed.values["time/simulate"] > 0.0
    monkeypatch.setattr(TimedStep, "policy", lambda self: UNTIMED.policy())
    monkeypatch.setattr(TimedStep, "worlds", lambda self: UNTIMED.worlds())
    monkeypatch.setattr(learner.Learner, "_phase_seconds", lambda *_: {})
    assert torch.equal(learnt()[1], weights)


def test_sensors_are_timed_apart_from_physics():
    model = sw.scenes.quadruped().finalize(4)
    sim, same = (sw.Simulation(model, dt=0.005, sensors=[Imu(model, Mount("trunk"))]) for _ in range(2))
    waits: list[None] = []
    with timed_phases(lambda: waits.append(None)) as times:
        sim.step(5)
    same.step(5)
    assert waits
    assert times.seconds[Phase.PHYSICS] > 0.0
    assert times.seconds[Phase.SENSORS] > 0.0
    np.testing.assert_array_equal(sim.state.body_q.numpy(), same.state.body_q.numpy())
    before = dict(times.seconds)
    sim.step(1)  # outside the context nothing is timed
    assert times.seconds == before
