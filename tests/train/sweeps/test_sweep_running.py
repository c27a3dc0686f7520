"""The loop of a sweep: what is begun, kept, resumed, told as failed. Processes are doubles, run folders are real."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from simwarp.core.files import OutputError
from simwarp.core.stopping import StopRequest
from simwarp.tasks import InputError, Range, Sensing, replace_fields, task_class
from simwarp.train.config import TrainConfig, default_config
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.run_lock import LOCK, Writer, started
from simwarp.train.sweeps import running
from simwarp.train.sweeps.leaving import LeaveRule
from simwarp.train.sweeps.plan import SweepRun, point_label, run_name, sweep_name
from simwarp.train.sweeps.run_state import LOG, RunRecord, RunState, failure
from simwarp.train.sweeps.running import RunList, SweepRunner, check_runs
from simwarp.train.sweeps.time_to_bound import parse_bound

FAST = task_class("fast")
ITERATIONS = 3


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr(running, "POLL", 0.001)


def make_run(folder, seed=0, **changes):
    config = replace_fields(default_config(FAST), {"iterations": ITERATIONS, "seed": seed, "threads": 1} | changes)
    return SweepRun("", {}, config, FAST.config_type(), RunFolder(folder / run_name("", seed)))


def saved(run, iteration=ITERATIONS):
    configs: dict[str, Any] = {"train_config": {}, "task_config": {}, "actor_state_dict": {}}
    run.folder.save({"task": "fast", "iteration": iteration, **configs}, keep=0)


class Scripted:
    """A job that ends after a few looks, and does what a training would have done."""

    def __init__(self, looks=1, code=0, work=lambda: None):
        self.looks, self.code, self.work = looks, code, work
        self.stops = []

    def poll(self):
        self.looks -= 1
        if self.looks > 0:
            return None
        if self.looks == 0:
            self.work()
        return self.code

    def stop(self, *, at_once=False):
        self.stops.append(at_once)
        self.looks, self.code = 1, 130


class Scripts:
    """A launcher whose jobs are scripted by seed; by default a run is finished."""

    def __init__(self, **jobs):
        self.jobs = {int(key[4:]): job for key, job in jobs.items()}
        self.begun, self.most, self.alive = [], 0, []

    def start(self, run):
        job = self.jobs.get(run.seed) or Scripted(3, 0, lambda: saved(run))
        self.begun.append(run.seed)
        self.alive = [other for other in self.alive if other.looks > 0] + [job]
        self.most = max(self.most, len(self.alive))
        return job


class Silent:
    """Takes down what is shown."""

    def __init__(self):
        self.lines = []

    def update(self, records):
        pass

    def changed(self, record):
        self.lines.append((record.run.seed, record.state.value, record.reason))

    def say(self, text):
        self.lines.append(text)


def sweep(runs, launcher, stop=None, **options):
    watcher = Silent()
    runner = SweepRunner("fast", RunList(runs), launcher, watcher=watcher, **({"jobs": 1} | options))
    runner.run(stop or StopRequest())
    return runner, watcher


def states(runner):
    return {record.run.seed: record.state for record in runner.records}


def test_all_runs_are_done_and_no_more_at_a_time_than_asked_for(tmp_path):
    launcher = Scripts()
    runner, _ = sweep([make_run(tmp_path, seed) for seed in range(7)], launcher, jobs=3)
    assert set(states(runner).values()) == {RunState.DONE}
    assert launcher.begun == list(range(7))
    assert launcher.most == 3


def test_a_prepared_run_is_a_run_folder(tmp_path):
    run = make_run(tmp_path, 4)
    run.prepare("fast")
    assert run.folder.load_config()["train_config"]["seed"] == 4
    assert run.folder.checkpoint_files() == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["seed=4"]


def test_finished_runs_are_kept_and_broken_ones_go_on(tmp_path):
    runs = [make_run(tmp_path, seed) for seed in range(3)]
    for run in runs[:2]:
        run.prepare("fast")
    saved(runs[0])
    saved(runs[1], 2)
    launcher = Scripts()
    runner, watcher = sweep(runs, launcher)
    assert launcher.begun == [1, 2]
    assert [record.kept for record in runner.records] == [True, False, False]
    assert (1, "running", "resumed after iteration 2") in watcher.lines
    assert (2, "running", "") in watcher.lines


@pytest.mark.parametrize(
    "spoil", [lambda path: path.write_bytes(path.read_bytes()[:-9]), lambda path: path.write_bytes(b"")]
)
def test_a_finished_run_whose_checkpoint_is_damaged_is_not_taken_for_done(tmp_path, spoil):
    runs = [make_run(tmp_path, seed) for seed in range(2)]
    for run in runs:
        run.prepare("fast")
        saved(run, 2)
        saved(run)
    spoil(runs[0].folder.checkpoint_path(ITERATIONS))
    launcher = Scripts()
    runner, _ = sweep(runs, launcher)
    assert launcher.begun == []
    assert states(runner) == {0: RunState.FAILED, 1: RunState.DONE}
    newest, older = (runs[0].folder.checkpoint_path(iteration) for iteration in (ITERATIONS, 2))
    assert f"checkpoint {newest} is" in runner.records[0].reason
    assert f"the newest good one is {older}: move the damaged one away" in runner.records[0].reason
    newest.unlink()
    launcher = Scripts()
    runner, _ = sweep(runs, launcher)
    assert launcher.begun == [0]
    assert states(runner) == {0: RunState.DONE, 1: RunState.DONE}


def test_more_iterations_go_on_with_a_finished_run(tmp_path):
    first = make_run(tmp_path)
    first.prepare("fast")
    saved(first)
    longer = make_run(tmp_path, iterations=9)
    launcher = Scripts(seed0=Scripted(2, 0, lambda: saved(longer, 9)))
    runner, _ = sweep([longer], launcher)
    assert (launcher.begun, states(runner)) == ([0], {0: RunState.DONE})


def test_a_failed_run_is_named_and_the_others_go_on(tmp_path):
    runs = [make_run(tmp_path, seed) for seed in range(3)]

    def fail():
        (runs[1].folder.path / LOG).write_text("iteration 1\nsimwarp: learning diverged: loss is NaN\n")

    ended: list[RunRecord] = []
    runner, _ = sweep(runs, Scripts(seed1=Scripted(2, 1, fail)), after=ended.append)
    assert states(runner) == {0: RunState.DONE, 1: RunState.FAILED, 2: RunState.DONE}
    assert [record.reason for record in runner.records] == ["", "learning diverged: loss is NaN", ""]
    assert [record.run.seed for record in ended] == [0, 1, 2]
    # Told again, and not tried again unless that is asked for
    launcher = Scripts()
    runner, _ = sweep(runs, launcher)
    assert (launcher.begun, states(runner)[1]) == ([], RunState.FAILED)
    assert runner.records[1].reason == failure(runs[1].folder) == "learning diverged: loss is NaN"
    launcher = Scripts()
    runner, _ = sweep(runs, launcher, retry=True)
    assert (launcher.begun, states(runner)[1]) == ([1], RunState.DONE)
    assert failure(runs[1].folder) == ""


def test_a_run_that_somebody_killed_goes_on_the_next_time(tmp_path):
    run = make_run(tmp_path)
    runner, _ = sweep([run], Scripts(seed0=Scripted(2, -signal.SIGKILL, lambda: saved(run, 1))))
    assert runner.records[0].state is RunState.FAILED
    assert runner.records[0].reason == "ended by SIGKILL after iteration 1"
    launcher = Scripts()
    assert states(sweep([run], launcher)[0]) == {0: RunState.DONE}
    assert launcher.begun == [0]


def test_the_reason_is_of_this_time_alone(tmp_path):
    run = make_run(tmp_path)
    run.prepare("fast")
    (run.folder.path / LOG).write_text("simwarp: an old reason\n")
    runner, _ = sweep([run], Scripts(seed0=Scripted(2, 5)))
    assert runner.records[0].reason == "exit code 5"


class Asking(Silent):
    """Asks to stop once two runs are under way, and so many times more, one look after the other."""

    def __init__(self, stop, times=1):
        super().__init__()
        self.stop, self.left = stop, times

    def update(self, records):
        if self.left and len(records) == 2:
            self.left -= 1
            self.stop.ask()


def asked(tmp_path, jobs, times, runs=4):
    stop = StopRequest()
    launcher = Scripts(seed0=jobs[0], seed1=jobs[1])
    watcher = Asking(stop, times)
    runner = SweepRunner(
        "fast", RunList([make_run(tmp_path, seed) for seed in range(runs)]), launcher, jobs=2, watcher=watcher
    )
    runner.run(stop)
    return runner, launcher, watcher


def test_a_request_to_stop_is_handed_on_once_and_begins_nothing_more(tmp_path):
    jobs = [Scripted(1000), Scripted(1000)]
    runner, launcher, _ = asked(tmp_path, jobs, 1)
    assert [job.stops for job in jobs] == [[False], [False]]
    assert states(runner) == {0: RunState.STOPPED, 1: RunState.STOPPED}
    assert launcher.begun == [0, 1]


class Slow(Scripted):
    """Ends at the request of a number, and by it: the second one as the first, the third one as a kill."""

    def __init__(self, ends_at):
        super().__init__(1000)
        self.ends_at = ends_at

    def stop(self, *, at_once=False):
        looks, code = self.looks, self.code
        super().stop(at_once=at_once)
        if len(self.stops) < self.ends_at:
            self.looks, self.code = looks, code
        elif at_once:
            self.code = -signal.SIGKILL


def test_each_request_is_handed_on_and_only_the_third_one_kills(tmp_path):
    jobs = [Slow(2), Slow(3)]
    runner, _, watcher = asked(tmp_path, jobs, 3)
    assert [job.stops for job in jobs] == [[False, False], [False, False, True]]
    assert states(runner) == {0: RunState.STOPPED, 1: RunState.FAILED}
    assert runner.records[1].reason == "ended by SIGKILL after iteration 0"
    told = [line for line in watcher.lines if isinstance(line, str)]
    assert told == [
        "stopping 2 runs: each saves its iteration; again: at once",
        "stopping 2 runs: each saves what it has; again: kills",
        "stopping 1 run: killed",
    ]


def test_a_run_that_had_not_yet_begun_is_stopped_by_the_signal_itself(tmp_path):
    class Unborn(Scripted):
        def stop(self, *, at_once=False):
            super().stop(at_once=at_once)
            self.code = -signal.SIGTERM

    runner, _, _ = asked(tmp_path, [Unborn(1000), Scripted(1000)], 1)
    assert states(runner) == {0: RunState.STOPPED, 1: RunState.STOPPED}


def test_after_an_error_of_the_sweep_runs_are_killed_only_after_two_requests(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "_PATIENCE", 0.0)
    jobs = {"seed0": Slow(3), "seed1": Scripted(2, 1)}

    def full(record):
        raise OutputError("no room")

    with pytest.raises(OutputError, match="no room"):
        sweep([make_run(tmp_path, seed) for seed in range(2)], Scripts(**jobs), jobs=2, after=full)
    assert jobs["seed0"].stops == [False, False, True]


def test_an_error_of_the_sweep_stops_its_runs(tmp_path):
    jobs = {"seed0": Scripted(1000), "seed1": Scripted(2, 1)}

    def full(record):
        raise OutputError("no room")

    with pytest.raises(OutputError, match="no room"):
        sweep([make_run(tmp_path, seed) for seed in range(2)], Scripts(**jobs), jobs=2, after=full)
    assert jobs["seed0"].stops == [False]


def test_a_run_that_still_goes_since_an_earlier_sweep_is_waited_for_and_then_goes_on(tmp_path):
    run = make_run(tmp_path)
    run.prepare("fast")
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        writer = dataclasses.replace(Writer.this(), pid=process.pid)
        writer = dataclasses.replace(writer, started=started(process.pid) or "")
        (run.folder.path / LOCK).write_text(json.dumps(dataclasses.asdict(writer)))
        launcher = Scripts()
        looks = []

        class Ending(Silent):
            def update(self, records):
                looks.append(list(launcher.begun))
                if len(looks) == 5:
                    process.kill()
                    process.wait()

        watcher = Ending()
        runner = SweepRunner("fast", RunList([run]), launcher, jobs=1, watcher=watcher)
        runner.run(StopRequest())
    finally:
        process.kill()
        process.wait()
    assert watcher.lines[0] == (0, "running", f"goes on as {writer}")
    assert looks[:5] == [[]] * 5  # nobody else writes a run while its process lives
    assert launcher.begun == [0]
    assert states(runner) == {0: RunState.DONE}


def test_a_run_of_another_configuration_is_refused_before_any_work(tmp_path):
    make_run(tmp_path, 1).prepare("fast")
    other = make_run(tmp_path, 1, num_envs=16)
    with pytest.raises(InputError, match=r"seed=1 was made with num-envs = 128, not 16: give another --out"):
        check_runs("fast", [make_run(tmp_path, 0), other])
    assert not (tmp_path / "seed=0").exists()
    # Threads and iterations may change
    check_runs("fast", [make_run(tmp_path, 1, threads=2, iterations=50)])


DRAWN = {"randomise": {"body_mass": Range(0.9, 1.1)}}


@pytest.mark.parametrize(
    ("was", "now", "words"),
    [
        ({}, DRAWN, r'made with task.randomise = {}, not {"body_mass"'),
        (DRAWN, {}, r'made with task.randomise = {"body_mass".*not {}: give another --out'),
        ({}, {"sensing": {"policy": Sensing(noise=0.1)}}, r"made with task.sensing = {}, not"),
        ({}, {"warm_start": "a.pt"}, r"made with no --warm-start, not --warm-start a.pt: give another --out"),
        ({"warm_start": "a.pt"}, {}, r"made with --warm-start a.pt, not no --warm-start: give another --out"),
    ],
)
def test_what_is_drawn_and_where_it_starts_are_part_of_a_configuration(tmp_path, was, now, words):
    def run_with(changes):
        start = changes.get("warm_start")
        task = dataclasses.replace(
            FAST.config_type(), **{key: each for key, each in changes.items() if key != "warm_start"}
        )
        return dataclasses.replace(make_run(tmp_path), task_config=task, warm_start=start and Path(start))

    run_with(was).prepare("fast")
    run_with(was).prepare("fast")
    with pytest.raises(InputError, match=words):
        run_with(now).prepare("fast")


def test_a_field_that_is_younger_than_the_run_is_no_difference(tmp_path):
    make_run(tmp_path).prepare("fast")
    path = tmp_path / "seed=0" / "config.json"
    content = json.loads(path.read_text())
    del content["train_config"]["critic_warmup"], content["train_config"]["ppo"]["clip"]
    path.write_text(json.dumps(content))
    make_run(tmp_path, critic_warmup=3).prepare("fast")
    assert json.loads(path.read_text()) == content


def test_names_hold_what_is_varied_and_folders_what_is_held(tmp_path):
    assert point_label({"ppo.gamma": 0.97, "network.hidden": [64, 64], "task.x": "a/b"}) == (
        "ppo.gamma=0.97,network.hidden=64x64,task.x=a|b"
    )
    assert point_label({"a": 0.1 + 0.2}) == "a=0.30000000000000004"
    long = {f"key{index}": index for index in range(100)}
    assert len(point_label(long)) <= 200
    assert point_label(long) != point_label(long | {"key99": 0})
    config: TrainConfig = default_config(FAST)
    task: Any = FAST.config_type()
    name = sweep_name("fast", config, task, ["ppo.gamma"], {})
    same = replace_fields(config, {"seed": 3, "iterations": 7, "threads": 2, "ppo.gamma": 0.5})
    assert sweep_name("fast", same, task, ["ppo.gamma"], {}) == name
    assert sweep_name("fast", same, task, [], {}) != name
    assert sweep_name("fast", replace_fields(config, {"ppo.lam": 0.5}), task, ["ppo.gamma"], {}) != name
    assert sweep_name("fast", config, dataclasses.replace(task, gain=0.2), ["ppo.gamma"], {}) != name
    assert sweep_name("fast", config, dataclasses.replace(task, gain=0.2), ["task.gain"], {}) == sweep_name(
        "fast", config, task, ["task.gain"], {}
    )


def test_a_draft_of_a_killed_sweep_is_no_obstacle(tmp_path):
    run = make_run(tmp_path)
    draft = tmp_path / ".simwarp-seed=0"
    draft.mkdir()
    (draft / "config.json").write_text("half")
    run.prepare("fast")
    assert run.folder.load_config()["task"] == "fast"
    assert os.listdir(tmp_path) == ["seed=0"]


# ---- runs that are left ----------------------------------------------------------------------------------------------


def progress(run, rewards):
    run.folder.path.mkdir(parents=True, exist_ok=True)
    lines = ["iteration,env_steps,mean_reward,env_steps_per_s"]
    lines += [f"{k + 1},{10 * (k + 1)},{reward},10.0" for k, reward in enumerate(rewards)]
    run.folder.progress.write_text("\n".join([*lines, ""]))


def rule(text="mean_reward>=5", patience=2.0, seeds=1):
    return LeaveRule((parse_bound(text),), (), patience, seeds)


def test_a_run_that_is_there_is_ended_and_kept_the_next_time(tmp_path):
    run = make_run(tmp_path, 0, iterations=100)
    run.prepare("fast")
    progress(run, [5.0] * 6)
    job = Scripted(looks=50, work=lambda: saved(run, 6))
    runner, watcher = sweep([run], Scripts(seed0=job), rule=rule("mean_reward>=4"))
    # it was there before anything was begun
    assert job.stops == []
    assert (states(runner), watcher.lines[-1]) == ({0: RunState.DONE}, (0, "done", "reached after 5 s"))
    # of a higher bound it goes on, and is ended once
    progress(run, [5.0] * 6)
    job = Scripted(looks=50)
    job.work = lambda: saved(run, 30)
    looks = iter(range(1000))
    poll = job.poll

    def polled():
        if next(looks) == 3:
            progress(run, [5.0] * 6 + [7.0] * 10)
        return poll()

    job.poll = polled  # type: ignore[method-assign]
    runner, watcher = sweep([run], Scripts(seed0=job), rule=rule("mean_reward>=7"))
    assert job.stops == [False]
    assert (states(runner), watcher.lines[-1]) == ({0: RunState.DONE}, (0, "done", "reached after 11 s"))


def test_a_slower_run_is_left_and_stays_so_by_the_same_rule(tmp_path):
    runs = [make_run(tmp_path, seed, iterations=100) for seed in range(2)]
    runs = [dataclasses.replace(run, label=f"point{seed}") for seed, run in enumerate(runs)]
    for run, rewards in zip(runs, ([5.0] * 5, [0.0] * 11), strict=True):
        run.prepare("fast")
        progress(run, rewards)

    def tried(patience):
        job, following = Scripted(looks=9, work=lambda: saved(runs[1], 11)), rule(patience=patience)
        launcher, scores = Scripts(seed1=job), iter((-5.0, -1e9))
        runner, watcher = sweep(
            runs, launcher, rule=following, after=lambda record: following.settled(record, next(scores))
        )
        return launcher.begun, job.stops, states(runner), watcher.lines

    begun, _, found, lines = tried(2.0)
    assert begun == []
    assert found == {0: RunState.DONE, 1: RunState.DONE}
    assert lines[-1] == (1, "done", "left after 11 s, the best point took 5 s")
    # with more patience it goes on, and is stopped by nothing
    progress(runs[1], [0.0] * 11)
    begun, stops, found, _ = tried(3.0)
    assert (begun, stops, found) == ([1], [], {0: RunState.DONE, 1: RunState.STOPPED})
    progress(runs[1], [0.0] * 16)
    assert tried(3.0)[0] == []


def test_a_run_whose_minutes_are_used_up_is_done(tmp_path):
    run = make_run(tmp_path, 0, minutes=0.5)
    launcher = Scripts(seed0=Scripted(1, 0, lambda: saved(run, 1)))
    runner, watcher = sweep([run], launcher)
    assert (states(runner), watcher.lines[-1]) == ({0: RunState.DONE}, (0, "done", "its 0.5 min are used up"))
    runner, watcher = sweep([run], launcher)
    assert launcher.begun == [0]
    assert watcher.lines == [(0, "done", "its 0.5 min are used up")]
