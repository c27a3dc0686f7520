"""The journal of a search: one that is damaged is named, and left as it is. Needs the extra ``sweep``."""

import os

import pytest

pytest.importorskip("optuna")

from simwarp.core.files import FileError
from simwarp.search.search_journal import STORAGE, open_study

DAMAGED = {
    "no text": b"\xff\xfe\n" * 9,
    "zeros": b"\0" * 99 + b"\n",
    "a list": b"[1, 2]\n",
    "another object": b'{"a": null}\n',
    "nested": b"[" * 100_000 + b"\n",
    "empty objects": b"{}\n{}\n",
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_journal_is_named(tmp_path, content):
    path = tmp_path / STORAGE
    path.write_bytes(content)
    words = r"search\.log is damaged \((line 1|\w+)\); put a whole copy in its place, or give another --out"
    with pytest.raises(FileError, match=words):
        open_study(path, "designs")
    assert path.read_bytes().startswith(content)


def test_a_journal_that_is_no_file_is_not_waited_for(tmp_path):
    path = tmp_path / STORAGE
    os.mkfifo(path)
    with pytest.raises(FileError, match=r"journal of the search '.*search\.log' is no regular file"):
        open_study(path, "designs")


def test_what_is_told_to_a_study_is_there_when_its_journal_is_opened_again(tmp_path):
    path = tmp_path / STORAGE
    study = open_study(path, "designs", maximise=False)
    study.optimize(lambda trial: (trial.suggest_float("x", -1.0, 1.0) - 0.25) ** 2, n_trials=3)
    again = open_study(path, "designs", maximise=False)
    assert [trial.values for trial in again.trials] == [trial.values for trial in study.trials]
    assert again.best_params == study.best_params
