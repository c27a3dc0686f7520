"""Flexible meshes on the page: their vertices go with the nodes of every world that is shown."""

import itertools
import threading
from collections.abc import Iterator

import numpy as np
import pytest

import simwarp as sw

pytest.importorskip("viser")

from simwarp.viewer.live import LiveView
from simwarp.viewer.live.controls.show_panel import shapes_scene
from simwarp.viewer.live.recording import Recorder
from tests.reference.recordings import messages
from tests.reference.viser_client import connect
from tests.unit.flex.test_meshes_seen import sheet


class Shown:
    """A sheet that falls, fixed at one side, in three worlds, of which the last two are shown."""

    def __init__(self) -> None:
        builder = sw.ModelBuilder()
        builder.add_shape_plane(pose=sw.pose((0.0, 0.0, -1.0)))
        self.mesh = sheet(builder, cells=2, fixed=[0, 1, 2], radius=0.01)
        self.sim = sw.Simulation(builder.finalize(world_count=3, device="cpu"), dt=1e-3)
        self.view = LiveView(self.sim, worlds=[1, 2], port=0)
        self.view.page.follow(False)

    def vertices(self, world):
        """Of the mesh now [m]."""
        x = self.sim.state.body_x.numpy()[world, list(self.mesh.bodies)]
        places = np.where(np.array(self.mesh.bodies)[:, None] >= 0, x, self.mesh.points)
        return self.mesh.surface.vertices(places)


@pytest.fixture
def shown() -> Iterator[Shown]:
    made = Shown()
    yield made
    made.view.stop()


def test_vertices_go_with_the_nodes_of_each_world(shown) -> None:
    view = shown.view
    view.paused = True
    thread = threading.Thread(target=view.run, daemon=True)
    thread.start()
    try:
        with connect(view.url) as page:

            def surfaces():
                return sorted(name for name, node in page.nodes.items() if len(node["props"].get("vertices", ())) == 27)

            names = page.wait(lambda: surfaces() if len(surfaces()) == 2 else [])
            assert [name.rsplit("_", 1)[-1] for name in names] == ["0", "1"]
            assert all(page.nodes[name]["props"]["side"] == "double" for name in names)
            assert not page.batches("/moving")  # spheres of nodes are not shown
            velocity = shown.sim.state.body_v.numpy().copy()
            velocity[2] += (0.0, 0.0, 2.0)
            shown.sim.state.body_v.assign(velocity)
            for _ in range(2):
                done = threading.Event()
                view.post(lambda done=done: (shown.sim.step(20), done.set()))
                assert done.wait(300.0)
                for row, name in enumerate(names):
                    expected = shown.vertices(row + 1) + view.page.offsets[row]

                    def arrived(name=name, expected=expected):
                        got = page.nodes[name]["props"]["vertices"].reshape(-1, 3)
                        return np.abs(got - expected).max() < 1e-5

                    assert page.wait(arrived)
            moved = [page.nodes[name]["props"]["vertices"].reshape(-1, 3) - view.page.offsets[row]
                     for row, name in enumerate(names)]  # fmt: skip
            assert np.abs(moved[0] - moved[1]).max() > 0.01
    finally:
        view.stopped = True
        thread.join(timeout=10.0)


def test_a_recording_has_the_vertices_of_its_frames(shown, tmp_path) -> None:
    recorder = Recorder(shown.view, tmp_path / "sheet.viser")
    for _ in range(10):
        shown.sim.step(20)
        shown.view.step()
    recorder.finish()
    found: dict[str, list[np.ndarray]] = {}
    for _, message in messages(tmp_path / "sheet.viser")[1]:
        props = message.get("props") or message.get("updates") or {}
        if "/moving/" in message.get("name", "") and "vertices" in props:
            found.setdefault(message["name"], []).append(np.reshape(props["vertices"], (-1, 3)))
    assert len(found) == 2
    for row, (_, frames) in enumerate(sorted(found.items())):
        assert len(frames) > 5
        drop = [frame[:, 2].min() for frame in frames]
        assert all(later < earlier for earlier, later in itertools.pairwise(drop))
        # places are rounded to 2^-14 m
        assert np.abs(frames[-1] - shown.vertices(row + 1) - shown.view.page.offsets[row]).max() < 1e-4


def test_collision_shapes_are_the_spheres_of_nodes(shown) -> None:
    instances = shapes_scene(shown.sim.model).visuals.instances
    assert sum(each.shape in shown.mesh.shapes for each in instances) == len(shown.mesh.shapes) == 6
    assert not [each for each in instances if each.flexible >= 0]
