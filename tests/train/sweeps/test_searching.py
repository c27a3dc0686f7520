"""A search in place of a grid: what Optuna is told, and what a later start finds. Needs the extra ``sweep``."""

import dataclasses
import json
import math

import pytest

pytest.importorskip("optuna")

from simwarp.search.search_journal import STORAGE
from simwarp.tasks import InputError, replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.sweeps.plan import SweepRun, run_name
from simwarp.train.sweeps.run_state import RunRecord
from simwarp.train.sweeps.searching import Dimension, Search

FAST = task_class("fast")
SPACE = {"ppo.gamma": Dimension(low=0.9, high=1.0)}


def runs_of(folder, number, values, seeds=3):
    label = f"trial-{number:03d}"
    config = replace_fields(default_config(FAST), dict(values))
    return [
        SweepRun(label, values, dataclasses.replace(config, seed=seed), FAST.config_type(),
                 RunFolder(folder / run_name(label, seed)))
        for seed in range(seeds)
    ]  # fmt: skip


def search(folder, scores, trials=2, space=SPACE):
    def score(record):
        return scores[record.run.seed]

    return Search(folder, space, trials, lambda number, values: runs_of(folder, number, values), score)


def finish(source):
    """Take all runs as they come, and return the values of their points."""
    taken = []
    while (run := source.next_run()) is not None:
        taken.append(run.values["ppo.gamma"])
        source.settled(RunRecord(run))
    return taken


def told(source):
    return [(trial.state.name, trial.value) for trial in source._study.get_trials()]


@pytest.mark.parametrize("scores", [(math.nan, 1.0, 2.0), (1.0, math.nan, 2.0), (2.0, 1.0, math.nan)])
def test_a_trial_is_the_median_of_the_scores_that_are_known(tmp_path, scores):
    source = search(tmp_path, scores)
    assert len(finish(source)) == 6
    assert told(source) == [("COMPLETE", 1.5)] * 2


def test_a_trial_without_a_score_or_with_failed_runs_has_failed(tmp_path):
    source = search(tmp_path, (math.nan,) * 3)
    finish(source)
    assert told(source) == [("FAIL", None)] * 2
    (tmp_path / "other").mkdir()
    source = search(tmp_path / "other", (-math.inf, -math.inf, 1.0))
    finish(source)
    assert told(source) == [("FAIL", None)] * 2


def test_a_later_start_goes_on_with_the_same_points(tmp_path):
    first = finish(search(tmp_path, (1.0, 2.0, 3.0)))
    again = finish(search(tmp_path, (1.0, 2.0, 3.0), trials=3))
    assert again[:6] == first
    assert len(again) == 9


def test_a_trial_that_was_cut_off_while_it_was_written_is_left_out(tmp_path):
    source = search(tmp_path, (1.0, 2.0, 3.0))
    first = finish(source)
    source._study.ask()  # without its values: the process was killed between two lines of the journal
    later = search(tmp_path, (1.0, 2.0, 3.0), trials=3)
    assert finish(later)[:6] == first
    assert [state for state, _ in told(later)] == ["COMPLETE", "COMPLETE", "FAIL", "COMPLETE"]
    assert len(finish(search(tmp_path, (1.0, 2.0, 3.0), trials=3))) == 9


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_journal_that_was_cut_off_in_a_line_goes_on(tmp_path, share):
    """As `kill -9` and a full disk leave it. What stands behind its last whole line was never told."""
    finish(search(tmp_path, [1.0, 2.0, 3.0]))
    path = tmp_path / STORAGE
    data = path.read_bytes()
    cut = int(share * len(data))
    assert data[cut - 1 : cut] != b"\n"
    path.write_bytes(data[:cut])
    again = finish(search(tmp_path, [1.0, 2.0, 3.0]))
    assert len(again) == 2 * 3  # both trials, with their seeds
    # and its file is whole again
    assert [json.loads(line) for line in path.read_bytes().splitlines()]
    assert len(finish(search(tmp_path, [1.0, 2.0, 3.0]))) == 2 * 3


def test_a_search_over_other_fields_is_refused(tmp_path):
    finish(search(tmp_path, (1.0, 2.0, 3.0)))
    with pytest.raises(InputError, match=r"holds a search over ppo.gamma, not ppo.lam: give another --out"):
        search(tmp_path, (1.0,), space={"ppo.lam": Dimension(low=0.9, high=1.0)})
