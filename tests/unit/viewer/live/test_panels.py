"""The panels, driven by messages as a page sends them, and what they show against the simulation's own arrays."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

viser = pytest.importorskip("viser")

from PIL import Image  # noqa: E402

import simwarp as sw  # noqa: E402
from simwarp import scenes, tasks  # noqa: E402
from simwarp.actuators import Actuators, ActuatorSpec  # noqa: E402
from simwarp.cli.view.task_subject import task_subject  # noqa: E402
from simwarp.core.types import WorldStatus  # noqa: E402
from simwarp.tasks import Command  # noqa: E402
from simwarp.train.networks.policies import zero_policy  # noqa: E402
from simwarp.viewer.live import LiveView, Subject, subject_of  # noqa: E402
from simwarp.viewer.live.controls.joint_coordinates import coordinates_of  # noqa: E402
from simwarp.viewer.live.controls.overlays import ContactOverlay, joint_axes  # noqa: E402
from simwarp.viewer.live.controls.sliders import step_of  # noqa: E402
from simwarp.viewer.live.page_panels import add_panels  # noqa: E402
from tests.reference.sensed_scene import DISTANCE, sensed_scene  # noqa: E402
from tests.reference.viser_client import ViserClient, connect  # noqa: E402


@contextlib.contextmanager
def opened(
    subject: Subject | sw.Simulation, scene: Any = None, *, worlds: int = 2
) -> Iterator[tuple[Any, ViserClient]]:
    """A paused view and a page on it."""
    view = LiveView(subject, scene=scene, worlds=worlds, port=0)
    view.paused = True
    add_panels(view)
    thread = threading.Thread(target=view.run, daemon=True)
    thread.start()
    try:
        with connect(view.url) as page:
            page.wait(lambda: page.has("Go on") and "/moving" in page.nodes)
            yield view, page
            assert not page.notices
    finally:
        view.stopped = True
        thread.join(timeout=10.0)
        view.stop()


def step(view: LiveView, page: ViserClient) -> None:
    """One step of a paused view."""
    time = view.subject.simulation.state.world_time.numpy
    before = float(time()[0])
    page.trigger("One step")
    page.wait(lambda: time()[0] > before)


def simulation_of(builder: sw.ModelBuilder, worlds: int = 2, **options: Any) -> sw.Simulation:
    return sw.Simulation(builder.finalize(world_count=worlds, device="cpu"), 2e-3, **options)


def resting_box() -> sw.Simulation:
    """A box of 4 kg, side 1 m, that has come to rest on a plane."""
    builder = sw.ModelBuilder()
    box = builder.add_body("box", mass=4.0, inertia=np.eye(3) * 4.0 / 6.0, pose=sw.pose((0.0, 0.0, 0.5)))
    builder.add_shape_box(box, half=(0.5, 0.5, 0.5), name="box")
    builder.add_shape_plane(name="ground")
    simulation = simulation_of(builder)
    for _ in range(50):
        simulation.step()
    return simulation


def pair(driven: bool = False) -> sw.ModelBuilder:
    """A hinge with limits and a slide without, fixed to the world."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    first = builder.add_body("first", mass=1.0, inertia=np.eye(3) * 0.1, pose=sw.pose((0.5, 0.0, 0.0)))
    second = builder.add_body("second", mass=1.0, inertia=np.eye(3) * 0.1, pose=sw.pose((1.0, 0.0, 0.0)))
    drive = sw.PositionDrive(stiffness=100.0, damping=10.0) if driven else None
    builder.add_joint_revolute("hinge", sw.WORLD, first, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0),
                               limit=(-0.5, 1.5), drive=drive)  # fmt: skip
    builder.add_joint_prismatic("slide", first, second, axis=(1.0, 0.0, 0.0), anchor=(0.5, 0.0, 0.0))
    return builder


# ---- show


def test_contact_forces_carry_the_box_as_arrows():
    with opened(resting_box()) as (view, page):
        page.set("Newtons per metre", 10.0)
        page.set("Contact forces", True)
        node = "/moving/over/forces/forces"
        page.wait(lambda: node in page.nodes)
        arrows = page.nodes[node]["props"]["points"].reshape(-1, 2, 3)
        assert len(arrows) == 2 * 4
        # both worlds' boxes weigh 4 kg; at rest to 1e-3 of that
        assert np.abs(arrows[:, 1] - arrows[:, 0]).sum(axis=0)[2] * 10.0 == pytest.approx(2 * 4.0 * 9.81, rel=1e-3)
        corners = np.abs(arrows[:, 0] - np.repeat(view.page.shifts, 4, axis=0))
        assert corners[:, :2] == pytest.approx(0.5 * np.ones((8, 2)), abs=1e-3)
        page.set("Newtons per metre", 20.0)
        page.wait(lambda: abs(page.nodes[node]["props"]["points"].reshape(-1, 2, 3)[0, 1, 2]) < 0.6)
        page.set("Contact forces", False)
        page.wait(lambda: node not in page.nodes)
        assert not view.page.overlays


def test_joint_axes_are_where_the_joints_are():
    model = pair().finalize(world_count=1, device="cpu")
    bodies, points, axes = joint_axes(model)
    assert bodies.tolist() == [sw.WORLD, 0]
    assert points == pytest.approx(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), abs=1e-9)
    assert axes == pytest.approx(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), abs=1e-9)


def test_every_overlay_goes_on_and_off():
    with opened(resting_box()) as (view, page):
        plain = set(page.batches("/moving"))
        for label in ("Contact points", "Body frames", "Centres of mass", "Names"):
            page.set(label, True)
        page.wait(lambda: len(view.page.overlays) == 4)
        page.wait(lambda: any("/over/NameOverlay" in name or "/over/names" in name for name in page.nodes))
        page.set("Collision shapes", True)
        page.wait(lambda: view.page.seen is not view.subject.scene)
        step(view, page)
        page.set("Collision shapes", False)
        for label in ("Contact points", "Body frames", "Centres of mass", "Names"):
            page.set(label, False)
        page.wait(lambda: not view.page.overlays and view.page.seen is view.subject.scene)
        page.wait(lambda: set(page.batches("/moving")) == plain)
        assert not [name for name, node in page.nodes.items() if "/over/" in name and "points" in node["props"]]


def test_no_contacts_are_no_points():
    simulation = simulation_of(pair())
    with opened(simulation) as (view, _):
        points, forces = ContactOverlay(view.page, 1.0, forces=True).touching()
        assert points.shape == forces.shape == (0, 3)


# ---- commands


def test_actions_are_taken_over_and_given_back():
    task = tasks.make("ant", 2, seed=1)
    subject, loop = task_subject(task, zero_policy(task), 1)
    with opened(subject) as (view, page):
        page.set("action 3", 0.5, "Commands")
        page.wait(lambda: page.value("Policy") is False)
        step(view, page)
        expected = np.zeros((2, task.action_size))
        expected[0, 3] = 0.5
        assert loop.actions.numpy() == pytest.approx(expected)
        page.set("Policy", True)
        page.wait(lambda: loop._taken.sum() == 0)
        step(view, page)
        assert not loop.actions.any()
        page.set("World", 1)
        page.wait(lambda: view.page.chosen == 1)
        page.set("Policy", False)
        page.wait(lambda: loop._taken.tolist() == [[False] * 8, [True] * 8])


def test_controls_of_actuators_and_commands_of_a_task():
    builder = pair()
    model = builder.finalize(world_count=2, device="cpu")
    motors = Actuators(model, [ActuatorSpec(name="motor", terms=((0, 1.0),), ctrl_range=(-2.0, 2.0))])
    simulation = sw.Simulation(model, 2e-3, elements=[motors])
    subject = subject_of(simulation)
    import torch

    speed = torch.zeros(2)
    subject.details["commands"] = lambda: {"speed": Command(speed, -1.0, 3.0)}
    with opened(subject) as (_, page):
        page.set("speed", 2.5, "Commands")
        page.wait(lambda: speed.tolist() == [2.5, 0.0])
        element = page.element("speed", "Commands")["props"]
        assert (element["min"], element["max"]) == (-1.0, 3.0)
        page.set("motor", 1.5, "Commands")
        page.wait(lambda: motors.ctrl.numpy().tolist() == [[1.5], [0.0]])


# ---- joints


def test_paused_sliders_place_the_chosen_world():
    simulation = simulation_of(pair())
    with opened(simulation) as (view, page):
        page.set("Sliders", True)
        page.wait(lambda: page.has("hinge", "Joints"))
        ends = page.element("hinge", "Joints")["props"]
        assert (ends["min"], ends["max"]) == (-0.5, 1.5)
        page.set("World", 1)
        page.wait(lambda: view.page.chosen == 1)
        page.set("hinge", 0.7, "Joints")
        page.wait(lambda: simulation.state.joint_q.numpy()[1, 0] == pytest.approx(0.7))
        assert not simulation.state.joint_q.numpy()[0].any()
        assert simulation.state.body_x.numpy()[1, 0, 2] == pytest.approx(-0.5 * np.sin(0.7), abs=1e-6)
        page.set("Sliders", False)
        page.wait(lambda: not page.has("hinge", "Joints"))


def test_running_sliders_are_targets_of_drives():
    simulation = simulation_of(pair(driven=True))
    with opened(simulation) as (view, page):
        page.set("Sliders", True)
        page.wait(lambda: page.has("slide", "Joints"))
        page.click("Go on")
        page.wait(lambda: not view.paused)
        page.set("hinge", 0.4, "Joints")
        page.wait(lambda: simulation.control.joint_target_q.numpy()[0, 0] == pytest.approx(0.4))
        assert simulation.control.joint_target_q.numpy()[1, 0] == 0.0
        page.set("slide", 0.4, "Joints")  # it has no drive
        page.wait(lambda: simulation.state.joint_q.numpy()[0, 0] > 0.2)
        assert simulation.control.joint_target_q.numpy()[0, 1] == 0.0


def test_loops_that_do_not_close_are_told():
    simulation = sw.Simulation(scenes.four_bar().finalize(world_count=1, device="cpu"), 2e-3)
    with opened(simulation, worlds=1) as (_, page):
        page.set("Sliders", True)
        page.wait(lambda: any("sliders place" in text for text in page.texts()))
        simulation.state.world_status.fill_(int(WorldStatus.NOT_ASSEMBLED))
        page.wait(lambda: any("NOT_ASSEMBLED" in text for text in page.texts()))


def test_more_than_forty_joints_are_chosen_from_a_list():
    builder = sw.ModelBuilder()
    last = sw.WORLD
    for index in range(41):
        place = sw.pose((0.1 * index, 0.0, 0.0))
        body = builder.add_body(f"link {index}", mass=1.0, inertia=np.eye(3) * 0.01, pose=place)
        anchor = (0.1 * index - 0.05, 0.0, 0.0)
        builder.add_joint_revolute(f"joint {index}", last, body, axis=(0.0, 1.0, 0.0), anchor=anchor)
        last = body
    model = builder.finalize(world_count=1, device="cpu")
    assert len(coordinates_of(model)) == 41
    with opened(sw.Simulation(model, 2e-3), worlds=1) as (_, page):
        page.set("Sliders", True)
        page.wait(lambda: page.has("joint 0", "Joints"))
        page.set("Joint", "joint 40", "Joints")
        page.wait(lambda: page.has("joint 40", "Joints") and not page.has("joint 0", "Joints"))


def test_steps_of_sliders_are_round():
    assert [step_of(span) for span in (2.0, 100.0, 0.02)] == pytest.approx([0.01, 1.0, 1e-4])


# ---- sensors


def picture(page: ViserClient, label: str) -> np.ndarray:
    """The pixels of an image on the page."""
    found = [each["props"] for each in page.gui.values() if each["props"].get("label") == label]
    assert found[0]["_format"] == "jpeg"
    data = found[0]["_data"]
    return np.asarray(Image.open(io.BytesIO(bytes(data))))


def charts(page: ViserClient) -> list[dict[str, Any]]:
    """Properties of the charts that have reached a page."""
    return [each["props"] for each in [*page.gui.values()] if "series" in each["props"]]


def test_pictures_points_and_lines_of_sensors():
    simulation, scene = sensed_scene(2)
    with opened(simulation, scene) as (view, page):
        for _ in range(11):
            step(view, page)
        page.set("Sensor", "eye")
        page.wait(lambda: page.has("instance", "Sensors"))
        page.wait(lambda: page.counts.get("GuiUpdateMessage", 0) > 0 and picture(page, "rgb").any())
        seen = picture(page, "rgb")
        eye: Any = simulation.sensors[0]
        expected = np.repeat(np.repeat(eye.outputs["rgb"].numpy()[0], 2, axis=0), 2, axis=1)
        assert seen.shape == expected.shape == (96, 128, 3)
        # JPEG: a few of 255 levels on the average
        assert np.abs(seen.astype(float) - expected).mean() < 4.0
        page.set("Sensor", "lidar")
        page.wait(lambda: "/world/returns" in page.nodes and not page.has("rgb", "Sensors"))
        points = page.nodes["/world/returns"]["props"]["points"].reshape(-1, 3) - view.page.shifts[0]
        ahead = points[(np.abs(points[:, 1]) < 0.2) & (points[:, 2] > 0.1)]
        assert len(ahead) > 10
        assert ahead[:, 0] == pytest.approx(np.full(len(ahead), 0.5 + DISTANCE), abs=2e-3)
        page.set("Sensor", "imu")
        page.wait(lambda: "/world/returns" not in page.nodes)
        page.wait(lambda: any(len(chart["data"][0]) for chart in charts(page)))
        assert [line["label"] for line in charts(page)[0]["series"]][1] == "ax m/s²"
        page.set("Sensor", "gps")
        page.wait(lambda: any("° N" in text for text in page.texts()))
        page.set("Sensor", "none")
        page.wait(lambda: not charts(page))


# ---- plots


def test_lines_are_read_only_when_they_are_chosen():
    simulation = simulation_of(pair())
    subject = subject_of(simulation)
    asked = dict.fromkeys(subject.series, 0)

    def counted(name: str, read: Any) -> Any:
        def ask(world: int) -> float:
            asked[name] += 1
            return float(read(world))

        return ask

    subject.series = {name: counted(name, read) for name, read in subject.series.items()}
    with opened(subject) as (view, page):
        chart = page.wait(lambda: charts(page))[0]  # elements of a page come one after the other
        page.wait(lambda: page.has("Series") and page.has("Line"))
        page.set("Series", "q slide")
        assert not chart["visible"]
        page.click("Line", "add")
        page.wait(lambda: chart["visible"])
        simulation.set_joint_state(None, np.array([[0.0, 0.3], [0.0, 0.0]]), None)
        for _ in range(3):
            asked["q slide"] = 0
            step(view, page)
            page.wait(lambda: asked["q slide"] > 0)
        # Points are drawn some times a second: the last one follows the last step in its own time
        page.wait(lambda: len(chart["data"][0]) >= 2 and chart["data"][1][-1] == pytest.approx(0.3, abs=1e-6))
        assert asked["q hinge"] == 0
        page.set("Series", "q hinge")
        page.click("Line", "add")  # the same chart: one that is removed would still be sent points
        page.wait(lambda: len(chart["series"]) == 3)
        assert any(each["props"] is chart for each in page.gui.values())
        page.click("Line", "clear")
        page.wait(lambda: not chart["visible"])


def test_a_task_names_rewards_observations_and_joints():
    task = tasks.make("ant", 2, seed=1)
    subject, loop = task_subject(task, zero_policy(task), 1)
    subject.advance()
    total = sum(subject.series[f"reward {name}"](1) for name in task.reward_terms)
    assert subject.series["reward"](1) == pytest.approx(total)
    assert subject.series["reward"](1) == pytest.approx(float(loop.returns[1]), rel=1e-5)
    assert subject.series["policy orientation 3"](0) == pytest.approx(float(loop.observations()["policy"][0, 3]))
    hip = subject.simulation.model.joint_names.index("hip_1")
    column = subject.simulation.model.joint_dof_start[hip]
    assert subject.series["q hip_1"](1) == pytest.approx(float(subject.simulation.state.joint_q.numpy()[1, column]))
