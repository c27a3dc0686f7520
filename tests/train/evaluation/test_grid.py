"""Evaluation over grids: points like single evaluations, paths that end where episodes do, pictures that tell them."""

import dataclasses
import io
import re
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from rich.console import Console

from simwarp.core.stopping import StopRequest
from simwarp.tasks import Drawing, Line, TaskConfig, make, task_class
from simwarp.train.evaluation import grid_plot, path_maps
from simwarp.train.evaluation.driven_paths import PathRecorder
from simwarp.train.evaluation.evaluation import EpisodeRecords, Evaluation, evaluate, evaluate_policies
from simwarp.train.evaluation.grid import (
    EvaluationStoppedError,
    GridDisplay,
    GridPoint,
    GridSettings,
    PointResult,
    _Watch,
    axes_of,
    evaluate_grid,
)
from simwarp.train.networks.policies import zero_policy
from simwarp.train.runs import progress_display
from tests.tasks.framework.samples import counter
from tests.tasks.framework.test_agents import Staggered


def right(task):
    """The policy that goes right."""
    action = torch.tensor([1.0, 0.0]).expand(task.num_worlds, 2)
    return lambda observations: action


def points_of(name, **axes):
    """Every combination of values of one or two fields."""
    config = task_class(name).config_type()
    found: list[dict[str, Any]] = [{}]
    for key, values in axes.items():
        found = [{**values_before, key: value} for values_before in found for value in values]
    return [GridPoint(values, dataclasses.replace(config, **values)) for values in found]


def run(points, policy=right, stop=None, after=lambda: None, name="fast", **settings):
    """Evaluate quietly; the results."""
    results: list[PointResult] = []
    chosen = GridSettings(**{"episodes": 6, "seed": 3, **settings})
    with GridDisplay(Console(quiet=True), len(points), 3 if chosen.baselines else 1, chosen.episodes) as display:
        evaluate_grid(
            name, policy, points, chosen, results=results, display=display, stop=stop or StopRequest(), after=after
        )
    return results


def test_a_point_is_what_a_single_evaluation_says():
    points = points_of("fast", bound=[1.5, 3.0], gain=[0.05, 0.1])
    results = run(points, episodes=8)
    assert [tuple(result.point.values.values()) for result in results] == [
        (1.5, 0.05), (1.5, 0.1), (3.0, 0.05), (3.0, 0.1),
    ]  # fmt: skip
    for result in results:
        alone = evaluate_policies("fast", right, config=result.point.config, episodes=8, seed=3, baselines=False)
        assert dict(alone) == result.evaluations
    assert axes_of(points) == {"bound": [1.5, 3.0], "gain": [0.05, 0.1]}
    assert points[0].label == "bound = 1.5, gain = 0.05"


def test_baselines_only_where_asked_for():
    (with_them,) = run(points_of("fast", bound=[2.0]), baselines=True)
    assert list(with_them.evaluations) == ["policy", "zero", "random"]
    assert set(with_them.as_json()["baselines"]) == {"zero", "random"}
    (without,) = run(points_of("fast", bound=[2.0]))
    assert list(without.evaluations) == ["policy"]
    assert "baselines" not in without.as_json()


def test_usual_keys_come_before_a_points_values_and_these_before_metrics():
    evaluation = Evaluation(4, 1.0, 0.0, 2.0, 2, 0.5, (0.15, 0.85), {"goal": 4}, {"speed": 7.0, "far": 1.0})
    point = GridPoint({"speed": 3.0, "episodes": 9}, task_class("fast").config_type())
    plain = PointResult(point, {"policy": evaluation}, None, 0.0).as_json()
    assert (plain["speed"], plain["episodes"], plain["far"]) == (3.0, 4, 1.0)


@pytest.mark.parametrize(("worlds", "episodes"), [(5, 5), (3, 7)])
def test_a_path_goes_from_the_start_to_where_the_first_episode_ends(worlds, episodes):
    task = make("fast", worlds, bound=1.25, max_episode_steps=40)
    starts = task.restart(seed=8)["policy"].clone()
    recorder: Any = PathRecorder()
    evaluate(task, right(task), episodes, seed=8, watcher=recorder)
    paths_driven = recorder.paths_driven
    assert len(paths_driven.paths) == worlds
    assert paths_driven.control_dt == task.config.control_dt
    for path, start, reason in zip(paths_driven.paths, starts.numpy(), paths_driven.reasons, strict=True):
        steps = int(np.floor((1.25 - start[0]) / 0.1)) + 1
        expected = start + 0.1 * np.arange(steps + 1)[:, None] * [1.0, 0.0]
        # The last position is beyond the bound: that of the end, not of the world that has been reset
        np.testing.assert_allclose(path, expected, atol=1e-5)
        assert path[-1, 0] > 1.25
        assert reason == "out_of_bounds"
    assert not any(paths_driven.successes)
    assert task.before_reset is None


def test_a_path_of_a_body_begins_where_the_body_is():
    task = make("pendulum", 3)
    task.restart(seed=1)
    start: Any = task.views.body_q[:, 0, :2].clone().numpy()
    recorder: Any = PathRecorder()
    result = evaluate(task, zero_policy(task), 3, seed=1, watcher=recorder)
    np.testing.assert_array_equal([path[0] for path in recorder.paths_driven.paths], start)
    assert sum(len(path) - 1 for path in recorder.paths_driven.paths) == pytest.approx(3 * result.mean_episode_length)
    # A cart on a rail draws no map
    assert recorder.paths_driven.flat


def test_a_task_that_is_nowhere_has_no_paths():
    recorder: Any = PathRecorder()
    task = counter()
    evaluate(task, zero_policy(task), 3, seed=0, watcher=recorder)
    assert recorder.paths_driven is None


def test_a_stop_keeps_what_is_finished_and_tells_the_rest():
    stop, saved = StopRequest(), []

    def stopping(task):
        policy = right(task)

        def act(observations):
            if task.config.bound == 3.0 and int(task.episode_steps[0]) >= 12:
                stop.ask()
            return policy(observations)

        return act

    points = points_of("fast", bound=[1.2, 3.0, 4.0])
    results: list[PointResult] = []
    with pytest.raises(EvaluationStoppedError) as caught:
        evaluate_grid(
            "fast", stopping, points, GridSettings(episodes=6, seed=3), results=results,
            display=GridDisplay(Console(quiet=True), 3, 1, 6), stop=stop, after=lambda: saved.append(len(results)),
        )  # fmt: skip
    assert saved == [1]
    assert [result.point.values["bound"] for result in results] == [1.2]
    assert caught.value.where == "bound = 3"
    assert caught.value.ended == sum(caught.value.end_reasons.values())
    with pytest.raises(EvaluationStoppedError):
        run(points, stop=stop)


def test_the_display_says_which_point_of_how_many_and_what_came_out(capsys, monkeypatch):
    monkeypatch.setattr(progress_display, "_PLAIN_INTERVAL", 0.0)
    points = points_of("fast", bound=[1.5, 3.0])
    with GridDisplay(Console(width=200), 2, 1, 6) as display:
        evaluate_grid(
            "fast", right, points, GridSettings(episodes=6, seed=3), results=[], display=display, stop=StopRequest()
        )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "point 1/2  bound = 1.5  building worlds"
    assert re.fullmatch(r"point 1/2  bound = 1.5  100%  6/6 episodes  ETA below 0:0\d", lines[1])
    assert any(re.fullmatch(r"point 2/2  bound = 3  \d+%  \d/6 episodes  ETA 0:0\d", line) for line in lines)
    done = [line for line in lines if "success" in line]
    assert [line.split("  ")[0] for line in done] == ["point 1/2", "point 2/2"]
    assert "success 0.0% (0.0% - 39.0%)" in done[0]
    assert "out_of_bounds 6" in done[0]


def test_progress_counts_the_episodes_of_all_agents_of_a_world():
    """Two worlds of two agents have four episodes at once: the longest is over after its 100 steps, not after 200."""
    shares = []

    class Display(GridDisplay):
        def running(self, label, policy, ended, share):
            shares.append(share)

    display = Display(Console(quiet=True), 1, 1, 4)
    watch = _Watch(points_of("fast", bound=[2.0])[0], "policy", 4, display, StopRequest(), None)
    task = Staggered(TaskConfig(max_episode_steps=100), 2)
    watch.begin(task)
    watch.step(25, EpisodeRecords(task, 4))
    assert shares == [0.25]


def test_an_estimate_needs_something_to_start_from_and_no_line_comes_twice(capsys, monkeypatch):
    monkeypatch.setattr(progress_display, "_PLAIN_INTERVAL", 0.0)
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    with GridDisplay(Console(width=200), 1, 2, 8) as display:
        for share in (0.0, 0.001, 0.25, 0.25):
            display.running("", "policy", 0, share)
            now[0] += 5.0 if share < 0.2 else 0.0
        display.run_done()  # after 10 s
        now[0] += 30.0  # three times what the first run took
        display.running("", "zero", 0, 0.75)
    assert capsys.readouterr().out.splitlines() == [
        "evaluating  policy  0%  0/8 episodes",
        "evaluating  policy  25%  0/8 episodes  ETA below 1:10",
        "evaluating  zero action  75%  0/8 episodes  ETA 0:10",
    ]


def test_a_terminal_gets_a_bar_below_the_lines_that_stay():
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=120)
    points = points_of("fast", bound=[1.5, 3.0])
    with GridDisplay(console, 2, 1, 6) as display:
        evaluate_grid(
            "fast", right, points, GridSettings(episodes=6, seed=3), results=[], display=display, stop=StopRequest()
        )
    shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", screen.getvalue())
    assert "point 2/2  bound = 3  success" in shown
    assert "━" in shown


# ---- pictures ------------------------------------------------------------------------------------------------------


@pytest.fixture
def figures(monkeypatch):
    """Figures that are written, by the name of the file."""
    kept = {}

    def keep(figure, path, dpi=120):
        kept[path.name] = figure
        figure.savefig(path, dpi=dpi)

    for module in (grid_plot, path_maps):
        monkeypatch.setattr(module, "save_figure", keep)
    return kept


def texts(axes):
    """Words inside axes."""
    return [text.get_text() for text in axes.texts]


@pytest.mark.parametrize(
    ("axes", "panels"),
    [
        ({"bound": [1.5, 3.0]}, 1),
        ({"bound": [1.5, 3.0], "gain": [0.05, 0.1]}, 1),
        ({"bound": [1.5, 3.0], "gain": [0.1], "goal_radius": [0.2, 9.0]}, 2),
    ],
)
def test_success_is_drawn_for_any_number_of_keys(axes, panels, figures, tmp_path):
    points = points_of("fast", **axes)
    results = run(points, episodes=4)
    grid_plot.draw_success(tmp_path / "a.png", "title", "note", points, results[:-1])
    with Image.open(tmp_path / "a.png") as image:
        assert len(image.getcolors(maxcolors=1 << 20) or []) > 10
    shown = [axes for axes in figures["a.png"].axes if axes.get_xlabel()]
    assert len(shown) == panels
    assert shown[0].get_xlabel() in ("bound", "gain")
    if len(axes) > 1:
        cells = [text for axes in shown for text in texts(axes) if "%" in text]
        assert cells == [f"{100.0 * result.evaluation.success_rate:.1f} %" for result in sort(results[:-1], axes)]
    else:
        assert (shown[0].get_ylabel(), shown[0].get_ylim()) == ("success rate [%]", (0.0, 100.0))


def sort(results, axes):
    """Results panel by panel, then in rows."""
    keys = list(axes)
    order = [*keys[2:], *keys[:2]]
    return sorted(results, key=lambda result: [axes[key].index(result.point.values[key]) for key in order])


def test_values_that_are_no_numbers_stand_side_by_side(figures, tmp_path):
    config = task_class("fast").config_type()
    base = run([GridPoint({"full": False}, config), GridPoint({"full": True}, config)], baselines=True)
    grid_plot.draw_success(tmp_path / "a.png", "title", "", [result.point for result in base], base)
    (axes,) = figures["a.png"].axes
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["False", "True"]
    places = sorted(float(line.lines[0].get_xdata()[0]) for line in axes.containers)
    assert places[0] < places[1] < places[2]
    assert figures["a.png"].legends


def test_maps_show_paths_in_the_colour_of_their_end_and_what_is_the_same_everywhere(figures, tmp_path, monkeypatch):
    road = torch.tensor([[-2.0, 1.0, 0.0], [2.0, 1.0, 0.0]])

    def drawing(self):
        own = torch.nn.functional.pad(self.position, (0, 1)).unsqueeze(1).expand(-1, 2, -1)
        lines = (Line(road.expand(self.num_worlds, 2, 3), "0.5"), Line(own, "tab:orange"))
        return Drawing(lines, ((-2.0, 2.0), (-2.0, 2.0)))

    monkeypatch.setattr(task_class("fast"), "drawing", drawing)
    results = run(points_of("fast", bound=[1.5, 20.0]), episodes=30)
    path_maps.draw_paths(tmp_path / "paths.png", "title", "note", results)
    first, second = figures["paths.png"].axes
    assert first.get_title(loc="left") == "bound = 1.5\nsuccess 0.0 %"
    # The road once, the starts of 30 worlds not at all, then the paths
    assert [len(item.get_segments()) for item in first.collections if hasattr(item, "get_segments")] == [1, 30]
    assert (first.get_xlim(), first.get_xlabel(), first.get_ylabel()) == ((-2.0, 2.0), "x [m]", "y [m]")
    labels = [text.get_text() for text in figures["paths.png"].legends[0].get_texts()]
    assert labels == ["out of bounds", "time limit", "start"]
    path_maps.draw_worlds(tmp_path / "worlds.png", "title", "note", results[0])
    panels = figures["worlds.png"].axes
    assert len(panels) == 12
    assert panels[0].get_title(loc="left").startswith("world 0: out of bounds, 0.")
    assert len(panels[0].lines) == 2
    assert second is not first
