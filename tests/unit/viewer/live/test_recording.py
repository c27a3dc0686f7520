"""A recording: one file that plays what happened, at the pace at which it happened."""

import contextlib
import re
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from simwarp import cli
from simwarp.cli.view.films import TrainingFilms
from simwarp.cli.view.task_subject import task_subject
from simwarp.core.types import ModelError
from simwarp.tasks import make, replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.evaluation.play import record
from simwarp.train.networks.policies import random_policy, zero_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.training import train
from simwarp.viewer.live import LiveView, recording as recording_module
from simwarp.viewer.live.recording import RATE, Recorder, recording_name
from simwarp.viewer.live.recording_panel import RecordingPanel
from tests.reference.recordings import messages, poses

# Half a step of 2^-14 m and of float32, and what half a step of 2^-14 of a quaternion turns a metre by
NEAR = 1e-4


@contextlib.contextmanager
def pendulums(worlds: int = 2) -> Iterator[LiveView]:
    task = make("pendulum", worlds, device="cpu", seed=3)
    subject, _ = task_subject(task, random_policy(task), 3)
    view = LiveView(subject, worlds=worlds, port=0)
    try:
        yield view
    finally:
        for recorder in list(view.recorders):
            recorder.drop()
        view.stop()


def run(view: LiveView, steps: int) -> None:
    for _ in range(steps):
        view.subject.advance()
        view.step()


def instances(view: LiveView) -> dict[str, np.ndarray]:
    """Places of all moving instances as they are now, by the node that shows them."""
    page = view.page
    places, _ = page.batches.poses(page.bodies)
    places = places + page.offsets[:, None]
    moving = [batch for batch in page.batches.batches if batch.moving]
    return {page._handles[batch.key].name: places[batch.rows, batch.instances] for batch in moving}


def test_a_recording_ends_with_the_bodies_where_they_are(tmp_path):
    with pendulums() as view:
        first = instances_at_start(view)
        recorder = Recorder(view, tmp_path / "a.html")
        run(view, 40)
        recorder.finish()
        last = instances(view)
        assert view.recorders == []
        assert recorder.elapsed == pytest.approx(40 * view.subject.dt, abs=1e-5)
    times, found = poses(tmp_path / "a.html")
    duration, content = messages(tmp_path / "a.html")
    assert times[0] == 0.0
    assert len(times) == recorder.frames
    assert np.diff(times).min() > 0.0
    assert np.diff(times).mean() == pytest.approx(1.0 / RATE, rel=0.2)
    assert duration == pytest.approx(recorder.elapsed + 1.0 / RATE, abs=1e-5)
    assert found.keys() == last.keys() != set()
    for name, places in found.items():
        assert np.abs(places[0] - first[name]).max() < NEAR
        assert np.abs(places[-1] - last[name]).max() < NEAR
        assert np.abs(places[-1] - places[0]).max() > 0.01  # they do move
    texts = [m["updates"]["text"] for _, m in content if "text" in m.get("updates", {})]
    assert texts[-1].startswith(f"{40 * view.subject.dt:.1f} s")
    assert "return" in texts[-1]


def instances_at_start(view: LiveView) -> dict[str, np.ndarray]:
    view.page.frame()
    return instances(view)


def test_the_file_asks_for_nothing_from_outside(tmp_path):
    with pendulums() as view:
        view.subject.name = "<script>alert(1)</script>"
        recorder = Recorder(view, tmp_path / "a.html")
        run(view, 3)
        text = recorder.finish().read_text(encoding="utf-8")
    assert re.findall(r"(?:src|href|action|data)\s*=\s*[\"']?\s*(?:https?:)?//[^\"'\s>]*", text) == []
    assert "<title>&lt;script&gt;alert(1)&lt;/script&gt;</title>" in text
    assert "<script>alert(1)" not in text
    assert "</body>" in text


def test_a_scene_file_holds_the_same_stream(tmp_path):
    for name in ("a.viser", "b.html"):
        with pendulums(1) as view:
            recorder = Recorder(view, tmp_path / name)
            with pytest.raises(ModelError, match="one runs at a time"):
                Recorder(view, tmp_path / "c.html")
            run(view, 6)
            recorder.finish()
            assert view.page.recorded == 0
    one, other = (poses(tmp_path / name) for name in ("a.viser", "b.html"))
    assert one[0] == other[0]
    assert all(np.array_equal(a, b) for name in one[1] for a, b in zip(one[1][name], other[1][name], strict=True))


def test_playback_takes_simulated_time_whatever_the_clock_says(tmp_path):
    """A page at a sixteenth of real time sends sixteen frames where one is due; a rest adds nothing."""
    with pendulums(1) as view:
        recorder = Recorder(view, tmp_path / "a.viser")
        for _ in range(20):
            view.subject.advance()
            for _ in range(3):
                view._draw(time.perf_counter())
        recorder.finish()
        assert recorder.elapsed == pytest.approx(20 * view.subject.dt, abs=1e-5)
    times, found = poses(tmp_path / "a.viser")
    assert len(times) == recorder.frames <= 20 * view.subject.dt * RATE + 2
    assert all(len(places) <= len(times) for places in found.values())  # one that rests is not sent


def test_what_moved_before_a_frame_and_rests_from_then_on_is_seen(tmp_path):
    with pendulums(1) as view:
        recorder = Recorder(view, tmp_path / "a.viser")
        view.subject.advance()
        view._draw(time.perf_counter())  # not due
        clock = view.subject.simulation.state.world_time
        clock.assign(clock.numpy() + 2.0 / RATE)
        view._draw(time.perf_counter())  # due, and nothing is sent: all is as it was
        clock.assign(clock.numpy() + 0.1 / RATE)
        view._draw(time.perf_counter())
        recorder.finish()
        last = instances(view)
    _, found = poses(tmp_path / "a.viser")
    assert all(np.abs(places[-1] - last[name]).max() < NEAR for name, places in found.items())


def test_time_goes_on_over_the_end_of_an_episode(tmp_path):
    with pendulums(2) as view:
        recorder = Recorder(view, tmp_path / "a.viser")
        run(view, 10)
        view.reset(np.array([True, False]))
        run(view, 10)
        view.reset()
        run(view, 10)
        recorder.finish()
        assert recorder.elapsed == pytest.approx(30 * view.subject.dt, abs=1.01 / RATE)
        assert np.diff(poses(recorder.path)[0]).min() > 0.0


def test_it_stops_at_the_largest_size_and_says_so(tmp_path):
    told: list[str] = []
    largest = 30_000
    with pendulums(16) as view:
        recorder = Recorder(view, tmp_path / "a.viser", largest=largest, say=told.append)
        assert recorder.size < largest
        for _ in range(2000):
            run(view, 1)
            if recorder.written:
                break
        assert recorder.written
        assert recorder.size > largest
        run(view, 5)
    assert len(told) == 1
    assert "stopped at 0 MB after" in told[0]
    # Told while it grows by a looser compression: of the size that the file has, within a third
    assert (tmp_path / "a.viser").stat().st_size == pytest.approx(largest, rel=0.34)
    assert len(poses(tmp_path / "a.viser")[0]) == recorder.frames


def test_closing_the_view_writes_what_there_is(tmp_path):
    with pendulums(1) as view:
        Recorder(view, tmp_path / "a.html")
        run(view, 5)
        view.stop()
        assert (tmp_path / "a.html").exists()


def test_the_button_records_into_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pendulums(1) as view:
        view.subject.name = "../a b/<x>"
        panel = RecordingPanel(view)
        panel.toggle()
        run(view, 4)
        panel.toggle()
        (file,) = tmp_path.iterdir()
        assert re.fullmatch(r"a-b-x-\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d\.html", file.name)
        assert file.name.replace("_", "&#95;") in panel._line.content
        assert panel._button.label == "Record"


def test_names_of_recordings_are_new(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = recording_name("ant")
    first.touch()
    assert recording_name("ant") != first


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("a.gif", "--record: the name must end in .html, .viser or .mcap, got 'a.gif'; give it one"),
        ("no/a.html", "--record"),
    ],
)
def test_a_bad_name_is_refused_before_any_work(tmp_path, monkeypatch, capsys, name, error):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("simwarp.cli.view.task_view.make", lambda *_, **__: pytest.fail("worlds were built"))
    assert cli.main(["view", "pendulum", "--record", name, "--seconds", "1", "--checkpoint", "zero"]) == 2
    said = capsys.readouterr()
    assert error in said.err
    assert said.err.count("\n") == 1
    with pendulums(1) as view, pytest.raises((ModelError, ValueError)):
        Recorder(view, name)


def test_view_records_without_a_browser(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("webbrowser.open", lambda *_: pytest.fail("a browser was opened"))
    file = tmp_path / "a.html"
    command = ["view", "pendulum", "--worlds", "2", "--record", str(file), "--seconds", "0.5", "--port", "0"]
    assert cli.main([*command, "--checkpoint", "zero"]) == 0
    assert f"wrote {file}: 0.5 s" in capsys.readouterr().out.replace("\n", "")
    assert poses(file)[0][-1] == pytest.approx(0.5, abs=0.04)


@pytest.mark.slow
def test_play_records_what_it_would_film(tmp_path, capsys):
    file, data = tmp_path / "a.html", tmp_path / "a.json"
    command = [
        "play",
        "pendulum",
        "--num-envs",
        "2",
        "--seconds",
        "0.6",
        "--checkpoint",
        "shipped",
        "--json",
        str(data),
    ]
    assert cli.main([*command, "--html", str(file)]) == 0
    recorded = data.read_text()
    assert cli.main([*command, "--video", str(tmp_path / "a.png")]) == 0
    assert recorded.split('"return"')[1] == data.read_text().split('"return"')[1]  # to the last bit
    times, _ = poses(file)
    assert times[-1] == pytest.approx(0.6, abs=1e-3)
    assert cli.main([*command, "--html", str(tmp_path / "a.gif")]) == 2
    assert "--html: the name must end in .html or .viser" in capsys.readouterr().err
    assert cli.main([*command, "--html", "b.html", "--video", "b.png"]) == 2


def test_a_film_takes_the_steps_of_play(tmp_path):
    from simwarp.cli.view.films import HtmlFilm

    ends = []
    for filmed in (True, False):
        task = make("pendulum", 2, device="cpu", seed=5)
        film = HtmlFilm(task, tmp_path / "a.viser") if filmed else Blind()
        _, total = record(task, random_policy(task), 0.5, 5, film)
        film.close()
        ends.append((task.simulation.state.body_x.numpy().tobytes(), total))
    assert ends[0] == ends[1]


class Blind:
    """Sees nothing."""

    def render(self, index: int, count: int, time: float) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


def trained(root: Path, films: TrainingFilms | None, **changes: object) -> tuple[Path, dict]:
    settings = {"num_envs": 8, "iterations": 3, "steps_per_iteration": 8, "device": "cpu"} | changes
    config = replace_fields(default_config(task_class("pendulum")), settings)
    task_config = task_class("pendulum").config_type(max_episode_steps=20)
    from rich.console import Console

    result = train("pendulum", config, task_config, root=root, console=Console(quiet=True), films=films)
    return Path(result.run), load_checkpoint(Path(result.checkpoint))


def test_films_leave_the_training_as_it_is_bit_by_bit(tmp_path):
    run_folder, content = trained(tmp_path / "a", TrainingFilms(2))
    films = sorted(path.name for path in (run_folder / "films").iterdir())
    assert films == ["iteration_000002.html", "iteration_000003.html"]
    times, found = poses(run_folder / "films" / films[-1])
    assert times[-1] > 0.1
    assert all(len(places[0]) % 4 == 0 for places in found.values())  # of four worlds
    _, plain = trained(tmp_path / "b", None)
    for key in ("actor_state_dict", "critic_state_dict"):
        assert all(torch.equal(content[key][name], plain[key][name]) for name in plain[key])
    assert torch.equal(content["torch_rng"], plain["torch_rng"])
    worlds = content["worlds"], plain["worlds"]
    tensors = [name for name, value in worlds[0].items() if isinstance(value, torch.Tensor)]
    assert tensors
    assert all(torch.equal(worlds[0][name], worlds[1][name]) for name in tensors)
    _, longer = trained(tmp_path / "c", None, iterations=4)  # the comparison can fail
    assert not torch.equal(longer["torch_rng"], plain["torch_rng"])


def test_without_viser_films_are_refused_before_the_training(tmp_path, monkeypatch, capsys):
    for package, part in (("simwarp.viewer", "live"), ("simwarp.cli", "view")):  # attributes are put back, too
        monkeypatch.setattr(sys.modules[package], part, sys.modules[f"{package}.{part}"])
    for name in list(sys.modules):
        if name.startswith(("simwarp.viewer.live", "simwarp.cli.view")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "viser", None)
    assert cli.main(["train", "pendulum", "--film", "2", "--runs", str(tmp_path / "runs")]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert said.err.endswith("pip install 'simwarp[viewer]'\n")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("seconds", [["--seconds", "80000"], ["--no-open"]])
def test_ctrl_c_writes_the_file(tmp_path, monkeypatch, capsys, seconds):
    taken = Recorder.begin_frame

    def interrupted(recorder: Recorder) -> None:
        taken(recorder)
        if recorder.frames == 4:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Recorder, "begin_frame", interrupted)
    file = tmp_path / "a.html"
    command = ["view", "pendulum", "--worlds", "1", "--checkpoint", "zero", "--record", str(file), "--port", "0"]
    assert cli.main([*command, *seconds]) == 130
    assert f"wrote {file}" in capsys.readouterr().out.replace("\n", "")
    assert len(poses(file)[0]) >= 4


def test_private_names_of_viser_are_there():
    """What the recorder leans on beside viser's public names."""
    with pendulums(1) as view:
        view.page.frame()
        serializer = view.server.viser.get_scene_serializer()
        assert callable(serializer._filter)
        assert serializer._binary_buffers
        assert serializer._messages
        assert recording_module.TITLE in serializer.as_html()


def test_zero_policy_films_a_task_that_somebody_else_steps(tmp_path):
    from simwarp.cli.view.films import HtmlFilm

    task = make("pendulum", 1, device="cpu", seed=5)
    film = HtmlFilm(task, tmp_path / "a.viser")
    _, total = record(task, zero_policy(task), 0.3, 5, film)
    film.write()
    film.close()
    texts = [m["updates"]["text"] for _, m in messages(tmp_path / "a.viser")[1] if "text" in m.get("updates", {})]
    assert float(texts[-1].split()[-1]) == pytest.approx(total, abs=0.051)  # shown to a tenth
