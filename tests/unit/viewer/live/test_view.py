"""`LiveView`, its loop and `simwarp view`: frames only for those who look, one line for what cannot be shown."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import tasks
from simwarp.scenes import ant, double_pendulum

pytest.importorskip("viser")

from simwarp.cli.view.task_subject import task_subject
from simwarp.cli.view.view_target import find_target
from simwarp.train.networks.policies import zero_policy
from simwarp.viewer.live import Layout, LiveView, Subject
from simwarp.viewer.live.live_view import FRAMES
from simwarp.viewer.live.pacing import LATE, Pace


@pytest.fixture
def view() -> Any:
    simulation = sw.Simulation(ant().finalize(4, "cpu"), 0.005)
    opened = LiveView(simulation, worlds=4, port=0)
    yield opened
    opened.stop()


def test_nothing_is_sent_while_nobody_looks(view: LiveView, monkeypatch: pytest.MonkeyPatch) -> None:
    frames: list[int] = []
    monkeypatch.setattr(view.page, "frame", lambda **_: frames.append(1))
    for _ in range(20):
        view.subject.simulation.step()
        view.step()
    assert frames == []
    view.recorders.append(Onlooker())
    view.step()
    assert frames == [1]


def test_steps_between_frames_are_not_waited_for(view: LiveView) -> None:
    """Reading what ended would wait for a GPU: it is done with a frame, for all steps since the last one."""
    asked: list[int] = []

    def ended() -> Any:
        asked.append(1)
        return np.array([False, True, False, False])

    view.subject.ended = ended
    clients: Any = {0: view}
    view._clients = clients
    view._next_frame = np.inf
    for _ in range(5):
        view.advance()
    assert (asked, view.last_failed) == ([], None)
    view._next_frame = 0.0
    view.advance()
    assert (asked, view.last_failed) == ([1], 1)


@pytest.mark.parametrize("cost", [0.001, 0.02, 0.03, 0.05, 0.3])
def test_a_page_gets_thirty_frames_a_second_or_every_step(
    view: LiveView, monkeypatch: pytest.MonkeyPatch, cost: float
) -> None:
    """Whatever a step costs [s]: frames do not wait for each other, and no step is skipped to keep up with a clock."""
    clock, frames = [100.0], []
    monkeypatch.setattr("simwarp.viewer.live.live_view.time.perf_counter", lambda: clock[0])
    monkeypatch.setattr(view.page, "frame", lambda **_: frames.append(clock[0]))
    clients: Any = {0: view}
    view._clients = clients
    steps = round(3.0 / cost)
    for _ in range(steps):
        clock[0] += cost
        view.step()
    assert len(frames) == pytest.approx(min(3.0 * FRAMES, steps), abs=2)
    assert np.diff(frames).max() < max(cost, 1.0 / FRAMES) + cost + 1e-9


class Onlooker:
    """Takes every frame."""

    def due(self) -> bool:
        return True

    def begin_frame(self) -> None:
        pass

    def finish(self) -> None:
        pass

    def drop(self) -> None:
        pass


def test_being_looked_at_changes_no_bit() -> None:
    states = []
    for watched in (False, True):
        simulation = sw.Simulation(ant().finalize(4, "cpu"), 0.005)
        view = LiveView(simulation, worlds=4, port=0)
        if watched:
            view.recorders.append(Onlooker())
        for _ in range(30):
            view.advance()
            view._next_frame = 0.0
        states.append(simulation.state.body_x.numpy().tobytes())
        view.stop()
    assert states[0] == states[1]


def test_a_frame_has_all_instances_where_the_bodies_are(view: LiveView) -> None:
    view.subject.simulation.advance(40)
    view.page.frame()
    places, _ = view.page.batches.poses(view.page.bodies)
    sent = 0
    for batch in view.page.batches.batches:
        handle = view.page._handles[batch.key]
        expected = places[batch.rows, batch.instances] + view.page.offsets[batch.rows]
        np.testing.assert_allclose(handle.batched_positions, expected, atol=1e-5)
        sent += len(handle.batched_positions)
    assert sent == 4 * sum(instance.kind != sw.ShapeType.PLANE for instance in view.subject.scene.visuals.instances)


def test_an_error_rests_the_loop_and_leaves_the_page(view: LiveView, capsys: pytest.CaptureFixture[str]) -> None:
    def broken() -> None:
        raise ValueError("the road is gone")

    view.subject.advance = broken
    view.advance()
    assert view.paused
    assert "the road is gone" in capsys.readouterr().err
    view.post(lambda: setattr(view, "paused", False))
    view.obey()
    assert not view.paused


def test_commands_run_in_the_stepping_thread_alone(view: LiveView) -> None:
    done: list[int] = []
    view.post(lambda: done.append(1))
    assert done == []
    view.step()
    assert done == [1]


def test_a_reset_of_one_world_leaves_the_others(view: LiveView) -> None:
    simulation = view.subject.simulation
    start = simulation.state.body_x.numpy().copy()
    simulation.advance(50)
    moved = simulation.state.body_x.numpy().copy()
    view.reset(np.array([False, True, False, False]))
    now = simulation.state.body_x.numpy()
    assert now[1].tobytes() == start[1].tobytes()
    assert now[[0, 2, 3]].tobytes() == moved[[0, 2, 3]].tobytes()


def test_bodies_without_shapes_are_seen() -> None:
    simulation = sw.Simulation(double_pendulum().finalize(1, "cpu"), 1e-3)
    view = LiveView(simulation, port=0)
    assert sum(len(batch.rows) for batch in view.page.batches.batches) >= 2
    view.stop()


def test_one_world_alone_and_all_again(view: LiveView) -> None:
    from simwarp.viewer.live.page_panels import add_panels

    add_panels(view)
    panel: Any = view.panels[0]
    assert len(view.page.worlds) == 4
    panel.choose(2)
    panel.arrange(Layout.ONE)
    assert view.page.worlds.tolist() == [2]
    panel.arrange(Layout.GRID)
    assert view.page.worlds.tolist() == [0, 1, 2, 3]
    panel.refresh(0.0)


def test_following_moves_the_scene_by_what_the_body_moves(view: LiveView) -> None:
    view.page.follow(True)
    before = view.page.followed()
    view.subject.simulation.advance(60)
    view.page.frame()
    moved = view.page.followed() - before
    assert np.abs(moved).max() > 0.01
    np.testing.assert_allclose(view.page._root.position, -moved, atol=1e-6)


def test_a_step_that_is_late_stretches_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("simwarp.viewer.live.pacing.time.perf_counter", lambda: clock[0])
    monkeypatch.setattr("simwarp.viewer.live.pacing.time.sleep", lambda t: clock.__setitem__(0, clock[0] + t))
    pace = Pace(0.1)
    for _ in range(5):
        clock[0] += 0.02  # of computing
        pace.wait(1.0, lambda: None)
    assert clock[0] == pytest.approx(0.5)
    assert pace.factor == pytest.approx(1.0, abs=0.25)
    clock[0] += 10.0
    pace.wait(1.0, lambda: None)
    late = clock[0]
    for _ in range(10):
        pace.wait(1.0, lambda: None)
    assert clock[0] - late >= 10 * 0.1 - LATE - 0.1  # not ten seconds at once


@pytest.mark.parametrize(
    ("name", "kind"),
    [("ant", "task"), ("hmmwv", "vehicle"), ("card-house", "scene"), ("a/b.URDF", "model"), ("x.npz", "dump")],
)
def test_what_a_target_means(name: str, kind: str) -> None:
    assert find_target(name).kind == kind


@pytest.mark.parametrize(
    ("worlds", "word"), [(0, "at least 1"), ([7], "below 4"), ([], "1 to 64"), (list(range(65)), "1 to 64")]
)
def test_worlds_that_are_not_there(worlds: Any, word: str) -> None:
    simulation = sw.Simulation(ant().finalize(4, "cpu"), 0.005)
    with pytest.raises(sw.ModelError, match=word):
        LiveView(simulation, worlds=worlds, port=0)


def command(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    run = [sys.executable, "-m", "simwarp", "view", *arguments]
    return subprocess.run(run, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


def test_the_command_prints_its_address_and_ends(tmp_path: Path) -> None:
    done = command("four-bar", "--no-open", "--port", "0", "--seconds", "0.5", "--json", "out.json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    [line] = re.findall(r"^view  (http://127\.0\.0\.1:\d+)$", done.stdout, re.MULTILINE)
    assert line in (tmp_path / "out.json").read_text()
    with socket.socket() as probe:  # the port is free again
        assert probe.connect_ex(("127.0.0.1", int(line.rpartition(":")[2]))) != 0


@pytest.mark.parametrize(
    ("target", "early"), [(["four-bar"], True), (["pendulum"], True), (["pendulum", "--task.dt", "0.01"], False)]
)
def test_the_browser_opens_while_the_worlds_are_built(target, early, monkeypatch, capsys):
    from simwarp.cli import main

    opened: list[tuple[str, bool]] = []

    def browse(url: str) -> None:
        with socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2]))):  # somebody answers
            opened.append((url, "building" in capsys.readouterr().out))

    monkeypatch.setattr("webbrowser.open", browse)
    assert main(["view", *target, "--port", "0", "--seconds", "0.2"]) == 0
    [(url, built)] = opened
    assert built is not early
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", int(url.rpartition(":")[2]))) != 0


def test_a_task_without_bodies_has_a_page_and_a_clock(tmp_path):
    """Its lines are seen on bare ground; a recording of its time comes to an end."""
    from simwarp.cli import main

    file = tmp_path / "fast.html"
    assert main(["view", "fast", "--worlds", "2", "--record", str(file), "--seconds", "1", "--port", "0"]) == 0
    assert file.stat().st_size > 500_000
    task = tasks.make("fast", 2, seed=1)
    subject, loop = task_subject(task, zero_policy(task), 1)
    times = subject.simulation.state.world_time.numpy
    steps = task.config.max_episode_steps
    for _ in range(steps):
        subject.advance()
    assert times() == pytest.approx(steps * subject.dt, rel=1e-5)  # float32 sums
    assert loop.ended.all()
    subject.advance()
    assert times() == pytest.approx(subject.dt)
    assert subject.ended is not None
    assert subject.ended().all()  # a step ago, and not asked for until now
    assert not subject.ended().any()
    subject.advance()
    subject.reset(np.array([True, False]))
    assert times() == pytest.approx([0.0, 2.0 * subject.dt])


def test_no_browser_opens_on_what_is_wrong(monkeypatch, capsys, tmp_path):
    from simwarp.cli import main

    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail(f"opened {url}"))
    wrong_ones = (
        f"pendulum --checkpoint {tmp_path}/none.pt", "pendulum --seed x", "pendulum --sped 1", "none.urdf",
        "four-bar --worlds 0", f"pendulum --record {tmp_path}/a.txt",
    )  # fmt: skip
    for wrong in wrong_ones:
        assert main(["view", *wrong.split()]) == 2, wrong
        assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["four-bra"], "nothing is called 'four-bra'; did you mean four-bar"),
        (["missing.urdf", "--base", "fixed"], "missing.urdf"),
        (["four-bar", "--worlds", "0"], "worlds must be"),
        (["four-bar", "--speed", "-1"], "speed must be"),
        (["four-bar", "--layout", "round"], "layout must be grid or overlay or one"),
        ([], "usage: simwarp view TARGET"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    from simwarp.cli import main

    assert main(["view", *arguments, *(["--no-open", "--seconds", "1"] if arguments else [])]) == 2
    [line] = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
    assert words in line


def test_a_subject_of_ones_own(view: LiveView) -> None:
    simulation = view.subject.simulation
    subject = Subject("mine", simulation, view.subject.scene, 0.01, simulation.step, lambda mask: None)
    other = LiveView(subject, worlds=1, port=0)
    other.run(iter([False, False, True]).__next__)
    assert float(simulation.state.world_time.numpy()[0]) == pytest.approx(0.01)
    other.stop()
