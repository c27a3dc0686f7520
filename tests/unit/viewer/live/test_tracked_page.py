"""A tracked vehicle in the page: what a person drives, the dashboard, the camera, a recording."""

import numpy as np
import pytest

pytest.importorskip("viser")

from simwarp.cli import main
from simwarp.cli.view.maneuver_view import maneuver_subject
from simwarp.cli.view.vehicle_subject import vehicle_subject
from simwarp.vehicle import TrackedVehicle, load_tracked_vehicle, maneuver, set_up
from simwarp.viewer.live.driving.browser_driving import wheel_of
from simwarp.viewer.live.driving.chase import Chase, Eye
from simwarp.viewer.live.driving.human_driver import Inputs
from simwarp.viewer.live.driving.vehicle_panel import Dashboard
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.page_panels import add_panels


@pytest.fixture(scope="module")
def view():
    made = LiveView(vehicle_subject("m113", 2, "cpu"), worlds=2, port=0)
    add_panels(made)
    yield made
    made.stop()


def test_a_person_drives_one_world(view):
    wheel = wheel_of(view.subject)
    assert wheel is not None
    assert isinstance(wheel.vehicle, TrackedVehicle)
    wheel.give(1, Inputs(steering=0.5, throttle=0.25, braking=0.125))
    np.testing.assert_allclose(wheel.vehicle.input.numpy()[:, :3], [[0.0, 0.0, 0.0], [0.5, 0.25, 0.125]])
    view.subject.simulation.step()
    board = Dashboard.read(wheel.vehicle, 1, None)
    assert (board.name, board.wheels, board.pedals) == ("M113", (), (0.25, 0.125))
    assert board.tracks == tuple(
        (float(speed), float(tension))
        for speed, tension in zip(
            wheel.vehicle.sprocket_speed.numpy()[1], wheel.vehicle.tension.numpy()[1], strict=True
        )
    )
    text = board.html()
    assert text.count("kN</b>") == 2
    assert "left track" in text
    for panel in view.panels:
        panel.refresh(0.0)


def test_the_camera_stands_behind_the_tracks(view):
    wheel = wheel_of(view.subject)
    assert wheel is not None
    chase = Chase(view.page, wheel.vehicle)
    # 1.5 times the way from the front road wheel on the left to the rear one on the right
    assert chase._length == pytest.approx(1.5 * np.hypot(3.407 - 0.655, 2.0 * 1.0795), abs=0.1)
    for eye in Eye:
        chase.use(eye)


def test_a_manoeuvre_in_the_page_shows_what_lies_across_the_way():
    spec = load_tracked_vehicle("m113")
    setup = set_up(spec, maneuver("trench", spec), device="cpu")
    subject = maneuver_subject(setup, "m113 trench")
    assert wheel_of(subject) is None  # a script drives
    fixed = {name for name, body in zip(subject.scene.names, subject.scene.body, strict=True) if body < 0}
    assert fixed == {"ground_near", "ground_far", "bottom"}


def test_a_recording_of_tracks(tmp_path):
    file = tmp_path / "tracks.html"
    assert main(["view", "m113", "--record", str(file), "--seconds", "0.04", "--port", "0"]) == 0
    assert file.stat().st_size > 100_000
