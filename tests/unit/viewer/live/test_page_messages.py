"""What a page gets and does, seen by a client without a browser."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

viser = pytest.importorskip("viser")

from simwarp.cli.view.model_subjects import scene_subject  # noqa: E402
from simwarp.core.types import ShapeType  # noqa: E402
from simwarp.viewer.live import LiveView  # noqa: E402
from simwarp.viewer.live.page_panels import add_panels  # noqa: E402
from tests.reference.viser_client import ViserClient, connect  # noqa: E402

WORLDS = 4


@pytest.fixture
def view() -> Iterator[LiveView]:
    """Four ants that rest."""
    made = LiveView(scene_subject("ant", WORLDS, "cpu"), worlds=WORLDS, port=0)
    made.paused = True
    add_panels(made)
    thread = threading.Thread(target=made.run, daemon=True)
    thread.start()
    yield made
    made.stopped = True
    thread.join(timeout=10.0)
    made.stop()


def opened(page: ViserClient, view: LiveView) -> None:
    """Waits until the whole scene is there."""
    page.wait(lambda: sum(page.batches("/moving").values()) == things(view) * len(view.page.worlds))


def things(view: LiveView) -> int:
    """Instances of a world that move, all of them batched."""
    visuals = view.subject.scene.visuals
    return sum(instance.body >= 0 and instance.kind is not ShapeType.PLANE for instance in visuals.instances)


def step(view: LiveView, page: ViserClient) -> None:
    """One step of a paused view."""
    time = view.subject.simulation.state.world_time.numpy
    before = float(time()[0])
    page.trigger("One step")
    page.wait(lambda: time()[0] > before)


def bits(view: LiveView) -> list[bytes]:
    state = view.subject.simulation.state
    return [b"".join(getattr(state, name).numpy()[world].tobytes() for name in state.NAMES) for world in range(WORLDS)]


def torso(view: LiveView) -> tuple[str, int]:
    """Node and first instance of the batch of the torsos."""
    body = view.subject.simulation.model.body("torso")
    for batch in view.page.batches.batches:
        found = np.flatnonzero(view.page.seen.body[batch.instances] == body)
        if len(found):
            return view.page.node(batch), int(found[0])
    raise AssertionError("no torso")


def test_instances_are_worlds_times_things_at_the_bodies(view):
    with connect(view.url) as page:
        opened(page, view)
        places, turns = view.page.batches.poses(view.page.bodies)
        for batch in view.page.batches.batches:
            if not batch.moving:
                continue
            expected = (places + view.page.shifts[:, None])[batch.rows, batch.instances]
            # float32 at some metres
            assert page.positions(view.page.node(batch)) == pytest.approx(expected, abs=1e-5)
            turned = turns[batch.rows, batch.instances][:, [3, 0, 1, 2]]
            assert page.rotations(view.page.node(batch)) == pytest.approx(turned, abs=1e-6)
        node, first = torso(view)
        body = view.subject.simulation.model.body("torso")
        seen = page.positions(node)[first] - view.page.shifts[0]
        assert seen == pytest.approx(view.subject.simulation.state.body_q.numpy()[0, body, :3], abs=1e-5)


def test_who_comes_late_or_again_gets_the_same(view):
    with connect(view.url) as page:
        opened(page, view)
        page.trigger("One step")
        page.wait(lambda: view.subject.simulation.state.world_time.numpy()[0] > 0.0)
        page.set("Joint axes", True)
        page.wait(lambda: any(name.endswith("/joints") for name in page.nodes))
        first = {name: page.positions(name) for name in page.batches()}
        with connect(view.url) as late:
            opened(late, view)
            late.wait(lambda: any(name.endswith("/joints") for name in late.nodes))
            assert late.labels("Run") == page.labels("Run")
            assert late.value("Joint axes") is True
            late.wait(lambda: all(np.allclose(late.positions(name), page.positions(name), atol=1e-6) for name in first))
    with connect(view.url) as again:
        opened(again, view)
        assert set(again.batches()) == set(first)
        assert again.value("Joint axes") is True


def test_pause_step_reset_speed_and_world(view):
    time = view.subject.simulation.state.world_time.numpy
    with connect(view.url) as page:
        opened(page, view)
        assert view.paused
        page.trigger("One step")
        page.wait(lambda: time()[0] == pytest.approx(view.subject.dt))
        page.trigger("Pause or go on")
        page.wait(lambda: not view.paused and time()[0] > 0.1)
        page.wait(lambda: page.has("Pause"))
        page.click("Pause")
        page.wait(lambda: view.paused)
        page.set("World", 2)
        page.wait(lambda: view.page.chosen == 2)
        page.click("Reset", "world")
        page.wait(lambda: time()[2] == 0.0)
        assert time()[1] > 0.0
        page.click("Reset", "all")
        page.wait(lambda: not time().any())
        page.set("Speed", "1/4")
        page.wait(lambda: view.speed == 0.25)
        page.set("Layout", "one")
        page.wait(lambda: view.page.worlds.tolist() == [2])
        opened(page, view)


def test_a_drag_moves_that_body_of_that_world_alone(view):
    with connect(view.url) as page:
        opened(page, view)
        # every world alike: the ant falls, in world 1 it is held
        node, first = torso(view)
        batch = next(each for each in view.page.batches.batches if view.page.node(each) == node)
        index = next(k for k, row in enumerate(batch.rows) if row == 1 and batch.instances[k] == batch.instances[first])
        place = page.positions(node)[index]
        page.drag(node, index, "start", grab=place, pointer=place + np.array([0.0, 0.0, 0.3]))
        page.wait(lambda: "/world/pull" in page.nodes)
        page.drag(node, index, "update", grab=place, pointer=place + np.array([0.0, 0.0, 0.5]))
        page.wait(lambda: abs(page.nodes["/world/pull"]["props"]["points"][5] - place[2] - 0.5) < 1e-5)
        for _ in range(20):
            step(view, page)
        page.drag(node, index, "end", grab=place, pointer=place)
        page.wait(lambda: "/world/pull" not in page.nodes)
        found = bits(view)
        assert found[0] == found[2] == found[3]
        assert found[1] != found[0]
        height = view.subject.simulation.state.body_x.numpy()[:, view.subject.simulation.model.body("torso"), 2]
        assert height[1] > height[0] + 0.02
        # without shift the camera moves
        page.drag(node, index, "start", grab=place, pointer=place, modifier=None)
        page.set("World", 3)
        page.wait(lambda: view.page.chosen == 3)
        assert "/world/pull" not in page.nodes


def test_a_drag_ends_with_its_page(view):
    with connect(view.url) as page:
        opened(page, view)
        node, index = torso(view)
        place = page.positions(node)[index]
        page.drag(node, index, "start", grab=place, pointer=place)
        page.wait(lambda: "/world/pull" in page.nodes)
    hand = view.subject.simulation.elements[-1]
    with connect(view.url) as other:
        other.wait(lambda: hand.hold is None)
    assert hand.hold is None


def test_trajectories_are_the_same_watched_or_not(view):
    with connect(view.url) as page:
        opened(page, view)
        for label in ("Contact points", "Contact forces", "Joint axes", "Body frames", "Centres of mass", "Names"):
            page.set(label, True)
        for _ in range(10):
            step(view, page)
        page.wait(lambda: any(name.endswith("/frames") for name in page.nodes))
        assert not page.notices
    alone = scene_subject("ant", WORLDS, "cpu")
    for _ in range(10):
        alone.advance()
    for name in ("body_x", "body_rot", "body_v", "body_omega"):
        one, other = (getattr(each.simulation.state, name).numpy() for each in (view.subject, alone))
        assert one.tobytes() == other.tobytes(), name
