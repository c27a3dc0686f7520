"""Signals as process groups, batch systems and `timeout` send them, to commands in processes of their own."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simwarp import cli
from simwarp.train.datasets.dataset_formats import load_trajectories
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import RunFolder

pytestmark = pytest.mark.slow

PATIENCE = 400.0
"""For a process to begin, or to end, on a busy machine [s]."""
SMALL = ("--device=cpu", "--num-envs=8", "--steps-per-iteration=4", "--threads=1", "--save-interval=1000000")
ENDLESS = "--iterations=1000000"
TASK = f"{Path(__file__).parents[1] / 'train' / 'algorithm' / 'two_sights.py'}:TwoSights"
TORCHRUN = (sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m", "simwarp")


class Group:
    """A command in a process group of its own, which hears Ctrl-C also where the tests run in the background."""

    def __init__(self, folder, *words, program=(sys.executable, "-m", "simwarp"), place="runs", **variables):
        self.folder, self.place = folder, place
        environment = os.environ | {"PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1"} | variables
        self._out, self._err = (folder / name for name in ("told", "complained"))
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = subprocess.Popen(
                [*program, *words], cwd=folder, stdout=out, stderr=err, env=environment, start_new_session=True,
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
            )  # fmt: skip

    @property
    def out(self):
        return self._out.read_text()

    @property
    def err(self):
        return self._err.read_text()

    def wait_until(self, condition):
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert self.process.poll() is None, self.err
            assert time.monotonic() < deadline, self.out + self.err
            time.sleep(0.02)

    def wait_for_iterations(self, count=3):
        self.wait_until(lambda: any(len(rows(run)) >= count for run in self.runs()))

    def runs(self):
        return [path.parent for path in self.folder.glob(f"{self.place}/*/*/progress.csv")]

    def run_folder(self):
        (run,) = self.runs()
        return RunFolder(run)

    def signal(self, number, times=2, pids=None):
        """Send copies, 50 ms apart, to the whole group or to some processes."""
        for copy in range(times):
            time.sleep(0.05 * (copy > 0))
            for pid in pids or [None]:
                try:
                    os.killpg(self.process.pid, number) if pid is None else os.kill(pid, number)
                except ProcessLookupError:
                    assert copy > 0  # it was faster

    def end(self):
        try:
            return self.process.wait(timeout=PATIENCE)
        finally:
            if self.process.poll() is None:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()


def rows(run):
    return read_progress(run / "progress.csv")


def assert_saved(group):
    """A checkpoint of the last iteration that is told, a curve, and the hint that goes on with it."""
    folder = group.run_folder()
    assert load_checkpoint(folder.latest_checkpoint())["iteration"] == len(rows(folder.path)) >= 3
    assert folder.curve.is_file()
    assert not (folder.path / "writer.json").exists()
    relative = folder.path.relative_to(group.folder)
    assert "interrupted and saved after" in group.out
    assert f"--resume {relative}" in group.out
    assert not list(folder.path.rglob(".*"))


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A folder with runs of two tasks, a checkpoint and trajectories."""
    folder = tmp_path_factory.mktemp("good")
    commands = (
        ("train", TASK, "--obs=place", *SMALL, "--iterations=2"),
        ("train", "fast", *SMALL, "--iterations=2"),
        ("record", "fast", "--episodes=8", "--output=fast.npz"),
    )
    for words in commands:
        group = Group(folder, *words)
        assert group.end() == 0, group.err
    return folder


@pytest.fixture
def folder(good, tmp_path):
    shutil.copytree(good, tmp_path / "work")
    return tmp_path / "work"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_two_signals_to_the_group_of_a_training(tmp_path, number):
    group = Group(tmp_path, "train", "fast", *SMALL, ENDLESS)
    group.wait_for_iterations()
    group.signal(number)
    assert (group.end(), group.err) == (130, "")
    assert_saved(group)
    resumed = Group(tmp_path, "train", "fast", "--resume", str(group.run_folder().path), "--iterations=1000001")
    resumed.wait_until(lambda: "iteration" in resumed.out)
    resumed.signal(number)
    assert (resumed.end(), resumed.err) == (130, "")


@pytest.mark.skipif(shutil.which("timeout") is None, reason="there is no timeout(1)")
def test_timeout_signals_the_command_and_its_group(tmp_path):
    """It sends the signal twice at once; the time begins when there is something to lose."""
    # `timeout` also hears SIGALRM as the end of its time
    group = Group(
        tmp_path, "train", "fast", *SMALL, ENDLESS,
        program=("timeout", "--signal=INT", "1h", sys.executable, "-m", "simwarp"),
    )  # fmt: skip
    group.wait_for_iterations()
    os.kill(group.process.pid, signal.SIGALRM)
    assert (group.end(), group.err) == (124, "")  # its own code: it was in time
    assert_saved(group)


def children(pid):
    """Processes that a process has started."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
    pairs = [[int(word) for word in line.split()] for line in listed.splitlines()]
    return [child for child, parent in pairs if parent == pid]


@pytest.mark.parametrize("whom", ["all", "torchrun", "workers", "one"])
def test_signals_to_torchrun_and_its_workers(tmp_path, whom):
    """A batch system signals all processes of a job, and torchrun hands on what it has heard: workers hear it twice.

    No process may end before the first one has saved: torchrun then stops the others.
    """
    group = Group(tmp_path, "train", "fast", *SMALL, ENDLESS, program=TORCHRUN)
    group.wait_for_iterations()
    pid, workers = group.process.pid, children(group.process.pid)
    assert len(workers) == 2
    pids = {"all": [pid, *workers], "torchrun": [pid], "workers": workers, "one": workers[1:]}[whom]
    group.signal(signal.SIGTERM, times=1, pids=pids)
    assert group.end() != 0  # torchrun tells of its own end in its own words
    assert_saved(group)
    assert len(load_checkpoint(group.run_folder().latest_checkpoint())["other_processes"]) == 1


def test_several_processes_leave_a_rollout_that_takes_too_long(tmp_path):
    """What would last beyond the time in which torchrun kills is left; what was learnt before it is saved."""
    first = Group(tmp_path, "train", "fast", *SMALL, "--iterations=3", program=TORCHRUN)
    assert first.end() == 0, first.err
    path = first.run_folder().path
    more = ("--resume", str(path), "--steps-per-iteration=1000000", ENDLESS)  # a rollout takes some ten minutes
    group = Group(tmp_path, "train", "fast", *more, program=TORCHRUN, TORCH_ELASTIC_SHUTDOWN_TIMEOUT="40")
    group.wait_until(lambda: "run folder" in group.out)
    group.signal(signal.SIGTERM, times=1)
    assert group.end() != 0
    assert "forcefully exiting" not in group.err
    assert load_checkpoint(path / "checkpoints" / "iteration_000003.pt")["iteration"] == 3


def test_two_signals_to_a_distillation(folder):
    (teacher,) = folder.glob("runs/two-sights/*")
    words = ("distill", TASK, f"--teacher={teacher}", *SMALL, ENDLESS, "--runs=students")
    group = Group(folder, *words, place="students")
    group.wait_for_iterations()
    group.signal(signal.SIGTERM)
    assert (group.end(), group.err) == (130, "")
    assert_saved(group)


def test_two_signals_to_an_evaluation_keep_the_finished_points(folder):
    grid = "--grid=max-episode-steps=" + ",".join(map(str, range(8, 808)))
    endless = Group(folder, "eval", "fast", grid, "--episodes=8", "--no-baselines", "--json=a.json")
    results = folder / "fast-eval" / "results.json"
    endless.wait_until(lambda: results.exists() and len(json.loads(results.read_text())["grid"]) > 1)
    endless.signal(signal.SIGINT)
    assert (endless.end(), endless.err) == (130, "")
    content = json.loads((folder / "a.json").read_text())
    assert content["interrupted"]
    assert 2 <= len(content["grid"]) < 800
    assert json.loads(results.read_text()) == content


@pytest.mark.parametrize(("kind", "output"), [("minari", "out-v0"), ("lerobot", "out")])
def test_two_signals_to_a_recording_of_a_dataset_keep_what_there_is(folder, kind, output):
    pytest.importorskip("minari" if kind == "minari" else "pyarrow", reason=f"needs the extra {kind}")
    words = ("--episodes=100000000", "--num-envs=8", f"--format={kind}", f"--output={output}")
    group = Group(folder, "record", "fast", *words)
    group.wait_until(lambda: re.search(r"recording  [1-9]\d*/", group.out))
    group.signal(signal.SIGINT)
    assert (group.end(), group.err) == (130, "")
    told = re.search(r"interrupted and saved after (\d+) of 100000000 episodes; wrote", group.out)
    assert told is not None
    assert load_trajectories(folder / output, "fast").episodes == int(told[1])


def test_two_signals_to_a_recording_and_a_cloning_keep_what_there_is(folder):
    group = Group(folder, "record", "fast", "--episodes=100000000", "--num-envs=8", "--output=out.npz")
    group.wait_until(lambda: re.search(r"recording  [1-9]\d*/", group.out))
    group.signal(signal.SIGTERM)
    assert (group.end(), group.err) == (130, "")
    assert "interrupted and saved after" in group.out
    cloned = Group(folder, "clone", "fast", "--data=out.npz", "--epochs=100000000", "--output=out.pt")
    cloned.wait_until(lambda: "epoch 1/" in cloned.out)
    cloned.signal(signal.SIGTERM)
    assert (cloned.end(), cloned.err) == (130, "")
    assert "interrupted and saved after" in cloned.out
    assert load_checkpoint(folder / "out.pt")["task"] == "fast"


def test_two_signals_to_a_sweep_and_to_its_runs(tmp_path):
    """A group of the system holds the sweep and its runs: each run hears it, and is asked by the sweep as well."""
    words = ("sweep", "fast", *SMALL, ENDLESS, "--seeds=0-2", "--jobs=2", "--out=s")
    group = Group(tmp_path, *words)
    runs = [tmp_path / "s" / f"seed={seed}" for seed in (0, 1)]
    group.wait_until(lambda: all((run / "progress.csv").exists() and len(rows(run)) > 2 for run in runs))
    pids = [json.loads((run / "writer.json").read_text())["pid"] for run in runs]
    group.signal(signal.SIGTERM, pids=[group.process.pid, *pids])
    assert (group.end(), group.err) == (130, "")
    for run in runs:
        assert load_checkpoint(RunFolder(run).latest_checkpoint())["iteration"] == len(rows(run)) > 2
        assert (run / "learning_curve.png").is_file()
        assert "--resume" in (run / "train.log").read_text()
    assert "3 of 3 runs are not finished" in group.out
    assert not runs[0].with_name("seed=2").exists()


@pytest.mark.parametrize("times", [1, 4])
def test_signals_while_kernels_are_compiled_are_one_line(tmp_path, times):
    """The compiler is C code: the signal is heard when it returns. Nothing was learnt, and nothing is lost."""
    words = ("train", "pendulum", "--device=cpu", "--num-envs=2", ENDLESS)
    group = Group(tmp_path, *words, WARP_CACHE_PATH=str(tmp_path / "cache"))
    group.wait_until(lambda: list((tmp_path / "cache").rglob("*.cpp")))
    group.signal(signal.SIGTERM, times=times)
    code = group.end()
    assert code == 130, group.err
    told = [line for line in group.err.splitlines() if not line.startswith("simwarp: compiling kernels")]
    assert told == ["simwarp: interrupted"] or (told == [] and "interrupted and saved" in group.out)


@pytest.mark.parametrize("name", ["_ctypes", "multiarray", "libtorch_cpu", "torch_python", "warp.so"])
def test_signals_while_modules_are_loaded_are_one_line(tmp_path, name):
    """While a library has just been mapped; before the first line of simwarp Python ends by the signal itself."""
    group = Group(tmp_path, "train", "fast", *SMALL, ENDLESS)
    maps = Path(f"/proc/{group.process.pid}/maps")
    group.wait_until(lambda: name in maps.read_text())
    group.signal(signal.SIGTERM)
    code = group.end()
    unborn = code == -signal.SIGTERM and not (group.err or group.out)
    assert unborn or (code, group.err) in ((130, "simwarp: interrupted\n"), (130, "")), (code, group.err)


def state_of(pid):
    """Letter of the state of a process: T is stopped."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc")
def test_a_training_that_is_suspended_goes_on_and_hears_what_came_meanwhile(tmp_path):
    """By SIGSTOP: Ctrl-Z does the same, but not to a group without a shell."""
    group = Group(tmp_path, "train", "fast", *SMALL, ENDLESS)
    group.wait_for_iterations()
    group.signal(signal.SIGSTOP, times=1)
    group.wait_until(lambda: state_of(group.process.pid) == "T")
    reached = len(rows(group.run_folder().path))
    group.signal(signal.SIGCONT, times=1)
    group.wait_for_iterations(reached + 3)
    group.signal(signal.SIGSTOP, times=1)
    group.wait_until(lambda: state_of(group.process.pid) == "T")
    group.signal(signal.SIGTERM)
    time.sleep(1.5)  # both were sent within a second, and are heard when it goes on
    assert group.process.poll() is None
    group.signal(signal.SIGCONT, times=1)
    assert (group.end(), group.err) == (130, "")
    assert_saved(group)
    # Times are of one clock that only rises, however long it stood still
    walls = [float(row["wall_s"]) for row in rows(group.run_folder().path)]
    assert walls == sorted(walls)


def test_an_error_that_a_library_made_of_an_interrupt_is_an_interrupt(monkeypatch, capsys):
    """Extension modules drop what a signal raised inside them, and fail with an error of their own."""

    def run(arguments, *, alone):
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(5.0)
        raise ValueError("too many values to unpack (expected 2)")

    monkeypatch.setattr(cli, "_run", run)
    assert cli.main(["list"]) == 130
    assert capsys.readouterr().err == "simwarp: interrupted\n"


def test_an_error_without_an_interrupt_stays_one(monkeypatch):
    def run(arguments, *, alone):
        raise ValueError("a bug")

    monkeypatch.setattr(cli, "_run", run)
    with pytest.raises(ValueError, match="a bug"):
        cli.main(["list"])
