"""The fault campaign: kills at random instants, full disks, flipped bits, removed folders, two writers, signals."""

import random
import shutil
import signal
import time

import pytest

from simwarp.tasks import InputError
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import latest_run
from tests.campaign.faults import drafts, end, judge, note, run, small_disk, small_files, start, timed
from tests.campaign.tally import Tally, campaign_seed
from tests.train.runs.test_kill_resume import same, wait_until

pytestmark = pytest.mark.slow

KILLS, FLIPS, SIGNALS = 8, 400, 2
SMALL = ("--device=cpu", "--num-envs=8", "--steps-per-iteration=4", "--save-interval=1")
ENDLESS = "--iterations=1000000"
ITERATIONS = 150


def newest(folder, task):
    return latest_run(folder / "runs", task)


def trained(folder, task):
    """Whether there is a checkpoint; a run folder may be half made when it is looked at."""
    found = newest(folder, task)
    return found is not None and len(found.checkpoint_files()) > 0


def newest_content(folder, task):
    return load_checkpoint(newest(folder, task).latest_checkpoint())


def test_killed_at_random_instants_and_resumed_bit_by_bit(place, tmp_path):
    chance = random.Random(campaign_seed())
    words = ("train", "pendulum", *SMALL, f"--iterations={ITERATIONS}")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    whole.mkdir(), killed.mkdir()
    ended = run(whole, *words)
    assert ended.code == 0, ended.err
    with timed(Tally("kills", campaign_seed())) as tally:
        for _ in range(KILLS):
            if trained(killed, "pendulum") and newest_content(killed, "pendulum")["iteration"] == ITERATIONS:
                break  # on a fast machine the last but one came to the end
            resume = [f"--resume={newest(killed, 'pendulum').path}"] if trained(killed, "pendulum") else []
            process = start(killed, *words, *resume)
            instant = chance.uniform(0.0, 8.0)
            time.sleep(instant)
            done = process.poll() is not None
            process.kill()
            process.communicate()
            wrong = ""
            if trained(killed, "pendulum"):
                folder = newest(killed, "pendulum")
                folder.load_config()
                torn = [path.name for path in folder.checkpoint_files() if load_checkpoint(path)["iteration"] < 1]
                wrong = f"torn: {torn}" if torn else ""
            note(tally, f"kill after {instant:.2f} s", wrong, "finished" if done else "killed")
        if not trained(killed, "pendulum") or newest_content(killed, "pendulum")["iteration"] < ITERATIONS:
            resume = [f"--resume={newest(killed, 'pendulum').path}"] if trained(killed, "pendulum") else []
            ended = run(killed, *words, *resume)
            note(tally, "the last resume", judge(ended, (0,), most=2), "resumed")
        left, right = newest_content(whole, "pendulum"), newest_content(killed, "pendulum")
        differing = [key for key in left if not same(left[key], right[key])]
        note(tally, "the policy", f"differs: {differing}" if differing else "", "compared")
        left_over = drafts(newest(killed, "pendulum").path)
        note(tally, "drafts", f"left: {left_over}" if left_over else "", "compared")


def test_flipped_bits_are_refused(place, tmp_path):
    chance = random.Random(campaign_seed())
    data = (place.material / "good" / "fast.pt").read_bytes()
    path = tmp_path / "flipped.pt"
    with timed(Tally("flipped bits", campaign_seed())) as tally:
        for _ in range(FLIPS):
            changed = bytearray(data)
            spot, bit = chance.randrange(len(data)), chance.randrange(8)
            changed[spot] ^= 1 << bit
            path.write_bytes(changed)
            try:
                load_checkpoint(path)
            except InputError as error:
                note(
                    tally,
                    f"bit {bit} of byte {spot}",
                    "" if path.name in str(error) else f"names nothing: {error}",
                    "refused",
                )
            else:
                note(tally, f"bit {bit} of byte {spot}", "silent acceptance:", "accepted")


def writers(good):
    """Commands that write files: words, and what they write."""
    policy, short = f"--checkpoint={good / 'fast.pt'}", "--task.max-episode-steps=60"
    return (
        ("train", "fast", *SMALL, "--keep-checkpoints=0", "--iterations=400"),
        ("record", "fast", policy, "--episodes=200", short, "--output=out.npz"),
        ("clone", "fast", f"--data={good / 'fast.npz'}", "--epochs=1", "--output=out.pt"),
        ("play", "fast", policy, "--seconds=1", "--num-envs=1", "--video=out.gif"),
        ("export", str(good / "fast.pt"), "--output=out.onnx"),
        ("drive", "sedan", f"--maneuver={good / 'short.csv'}", "--csv=out.csv", "--plot=out.png"),
        ("eval", "fast", policy, "--episodes=4", short, "--plot=pictures"),
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["full disk", "file-size limit"])
def test_a_disk_that_takes_no_more(kind, place, tmp_path):
    good = place.material / "good"
    with timed(Tally(kind, None)) as tally:
        for index, words in enumerate(writers(good)):
            folder = tmp_path / str(index)
            with small_disk(folder, "1m" if words[0] == "train" else "8k") as mounted:
                if kind == "full disk" and not mounted:
                    pytest.skip("only root mounts a small file system")
                before = small_files(100_000 if words[0] == "train" else 4_000) if kind == "file-size limit" else None
                ended = run(folder, *words, before=before)
                wrong = judge(ended, (1,), (str(folder),) if words[0] == "train" else (), most=1)
                left = drafts(folder)
                note(
                    tally,
                    f"{kind}: simwarp {' '.join(words)}",
                    wrong or (f"draft left: {left}" if left else ""),
                    "fell short",
                )
                if words[0] == "train" and kind == "full disk":
                    kept = newest_content(folder, "fast")["iteration"] if trained(folder, "fast") else 0
                    note(tally, "the last good state", "" if kept > 0 else "lost:", "kept")


def test_a_run_folder_that_is_removed(tmp_path):
    with timed(Tally("removed folders", None)) as tally:
        for what in ("run", "checkpoints"):
            folder = tmp_path / what
            folder.mkdir()
            process = start(folder, "train", "fast", *SMALL, ENDLESS)
            wait_until(lambda folder=folder: trained(folder, "fast"), process)
            path = newest(folder, "fast").path
            shutil.rmtree(path if what == "run" else path / "checkpoints", ignore_errors=True)
            note(tally, f"removed: {what}", judge(end(process), (1,), (path.name,)), "fell short")


def test_two_resume_at_once(tmp_path):
    words = ("train", "fast", *SMALL)
    assert run(tmp_path, *words, "--iterations=3").code == 0
    folder = newest(tmp_path, "fast")
    resume = (*words, "--iterations=100", f"--resume={folder.path}")
    with timed(Tally("two writers", None)) as tally:
        both = [end(process) for process in [start(tmp_path, *resume), start(tmp_path, *resume)]]
        codes = sorted(ended.code for ended in both)
        note(
            tally,
            "exit codes",
            "" if codes == [0, 2] else f"codes {codes}: {[ended.err for ended in both]}",
            "one waits",
        )
        refusal = next((ended for ended in both if ended.code == 2), both[0])
        note(tally, "the second", judge(refusal, (2,), (folder.path.name,)), "refused")
        rows = [int(row["iteration"]) for row in read_progress(folder.progress)]
        note(tally, "progress.csv", "" if rows == list(range(1, 101)) else f"mixed: {rows[:20]}...", "whole")


def long_commands(good):
    """Commands that take long enough to be interrupted."""
    policy = f"--checkpoint={good / 'fast.pt'}"
    return (
        ("train", "fast", *SMALL, ENDLESS),
        ("train", "pendulum", *SMALL, ENDLESS),
        ("eval", "fast", policy, "--episodes=1000000", "--num-envs=8"),
        ("play", "fast", policy, "--seconds=60", "--video=out.gif"),
        ("record", "fast", policy, "--episodes=1000000", "--num-envs=8"),
        ("clone", "fast", f"--data={good / 'fast.npz'}", "--epochs=1000000"),
        ("export", str(good / "fast.pt"), "--output=out.onnx"),
        ("bench", "pendulum", "--worlds=1", "--seconds=100"),
        ("drive", "sedan", "--csv=out.csv"),
        ("sensor-demo",),
        ("verify",),
    )


def test_signals_at_random_instants(place, tmp_path):
    chance = random.Random(campaign_seed())
    with timed(Tally("signals", campaign_seed())) as tally:
        for index in range(SIGNALS):
            for words in long_commands(place.material / "good"):
                folder = tmp_path / f"{index}-{'-'.join(words[:2]).replace('/', '-')}"
                folder.mkdir()
                process = start(folder, *words)
                number, instant = (signal.SIGTERM, signal.SIGINT)[index % 2], chance.uniform(1.0, 10.0)
                time.sleep(instant)
                done = process.poll() is not None
                for copy in range(2):  # as `timeout` and batch systems send them
                    time.sleep(0.05 * copy)
                    process.send_signal(number)
                ended = end(process)
                left = drafts(folder)
                # a process that still loads its modules ends by the signal itself, before anything was begun
                unborn = ended.code == -number and not (ended.out or ended.err or any(folder.iterdir()))
                wrong = "" if unborn else judge(ended, (130, 0) if done or ended.code == 0 else (130,))
                what = f"{number.name} after {instant:.2f} s: simwarp {' '.join(words)}"
                result = "not begun" if unborn else "finished" if ended.code == 0 else "interrupted"
                note(tally, what, wrong or (f"draft left: {left}" if left else ""), result)
