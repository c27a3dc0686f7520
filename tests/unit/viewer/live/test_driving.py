"""Driving by hand: the hands and feet of `HumanDriver`, and a HMMWV driven over the socket of its page."""

import json
import math
import time
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from simwarp.cli.view.vehicle_subject import vehicle_subject
from simwarp.viewer.live.batches import turned
from simwarp.viewer.live.driving.browser_driving import read_row, wheel_of
from simwarp.viewer.live.driving.chase import Chase, Eye
from simwarp.viewer.live.driving.drive_panel import DrivePanel
from simwarp.viewer.live.driving.human_driver import HumanDriver, Inputs, Keys, Wish, shifted
from simwarp.viewer.live.driving.vehicle_panel import Dashboard
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.page_panels import add_panels
from tests.unit.viewer.live.driving_page import DrivingPage, address, run_for

DT = 0.01


def drive(driver, wish, seconds, speed=0.0, dt=DT):
    """Inputs after holding a wish."""
    for _ in range(round(seconds / dt)):
        driver.step(wish, dt, speed)
    return driver.inputs


@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_steering_takes_half_a_second_out_and_less_back(dt):
    driver = HumanDriver()
    # linear in time: the tolerance is that of float sums
    assert drive(driver, Wish(steer=1.0), 0.24, dt=dt).steering == pytest.approx(0.48, abs=1e-9)
    assert drive(driver, Wish(steer=1.0), 0.26, dt=dt).steering == pytest.approx(1.0, abs=1e-9)
    assert drive(driver, Wish(), 0.2, dt=dt).steering == pytest.approx(1.0 - 0.2 / 0.3, abs=1e-9)
    assert drive(driver, Wish(), 0.12, dt=dt).steering == 0.0


def test_steering_crosses_the_middle_at_both_rates_and_mirrors():
    left, right = HumanDriver(), HumanDriver()
    for driver, side in ((left, 1.0), (right, -1.0)):
        drive(driver, Wish(steer=side), 1.0)
        drive(driver, Wish(steer=-side), 0.3 + 0.25)
    assert left.inputs.steering == pytest.approx(-0.5, abs=1e-9)
    assert left.inputs.steering == pytest.approx(-right.inputs.steering, abs=1e-12)


@pytest.mark.parametrize("speed", [0.0, 7.5, 15.0, 30.0, -15.0])
def test_steering_is_limited_at_speed(speed):
    for side in (1.0, -1.0):
        found = drive(HumanDriver(), Wish(steer=side), 3.0, speed).steering
        assert found == pytest.approx(side / (1.0 + abs(speed) / 15.0), abs=1e-9)


def test_pedals_take_a_quarter_second():
    driver = HumanDriver()
    assert drive(driver, Wish(throttle=1.0), 0.2).throttle == pytest.approx(0.8)
    assert drive(driver, Wish(throttle=1.0), 0.05).throttle == pytest.approx(1.0)
    assert drive(driver, Wish(brake=0.5), 0.12).row == pytest.approx((0.0, 0.52, 0.48, 0.0))
    assert drive(driver, Wish(brake=0.5), 0.5).row == pytest.approx((0.0, 0.0, 0.5, 0.0))


def test_nobody_at_the_wheel_brakes():
    driver = HumanDriver()
    drive(driver, Wish(steer=1.0, throttle=1.0), 1.0)
    assert driver.step(None, DT, 0.0).row[1:] == (0.0, 0.3, 0.0)
    assert drive(driver, None, 0.5) == Inputs(braking=0.3)


def test_chrono_keys_step_targets_which_inputs_follow():
    driver = HumanDriver(Keys.CHRONO)
    driver.step(Wish(steer=1.0), DT, 0.0)
    # one step of 1/50 at first order with 4/s, for 0.01 s and then for 2 s without a key
    assert driver.inputs.steering == pytest.approx(0.02 * -math.expm1(-0.04))
    assert drive(driver, Wish(), 2.0).steering == pytest.approx(0.02 * -math.expm1(-8.04))
    # 30 repeats a second after the first step
    assert drive(driver, Wish(throttle=1.0), 1.01).throttle < 31 * 0.02
    assert drive(driver, Wish(), 4.0).throttle == pytest.approx(31 * 0.02, abs=1e-5)
    # the throttle goes back three times as fast before the brake comes: 11 steps, then 20 of the brake
    drive(driver, Wish(brake=1.0), 1.01)
    assert drive(driver, Wish(), 4.0).braking == pytest.approx(21 * 0.02, abs=0.02 + 1e-5)
    assert driver.inputs.throttle == pytest.approx(0.0, abs=1e-5)


def test_gears():
    automatic: dict[str, Any] = {"gears": 4, "manual": False}
    assert shifted(3, False, speed=0.0, **automatic) == 0
    assert shifted(0, False, speed=0.0, **automatic) == -1
    assert shifted(0, False, speed=9.0, **automatic) == 0  # no reverse at speed
    assert shifted(-1, True, speed=0.0, **automatic) == 0
    assert shifted(0, True, speed=9.0, **automatic) == 1
    assert shifted(3, True, speed=9.0, **automatic) == 3
    manual: dict[str, Any] = {"gears": 5, "manual": True, "speed": 9.0}
    assert [shifted(gear, True, **manual) for gear in (-1, 0, 1, 5)] == [0, 1, 2, 5]
    assert [shifted(gear, False, **manual) for gear in (5, 1, 0, -1)] == [4, 0, -1, -1]


@pytest.mark.parametrize(
    "text", ["", "[]", "{", b"{}", '{"steer": "1"}', '{"steer": NaN}', '{"presses": [1]}', "[" * 3000, '{"a": ' * 300]
)
def test_what_is_no_message_is_no_wish(text):
    assert Wish.read(text) is None


def test_messages_are_clipped():
    assert Wish.read('{"steer": 7, "throttle": -1, "brake": 3}') == Wish(1.0, 0.0, 1.0)
    assert Wish.read(json.dumps({"presses": ["reset"]})) == Wish(presses=("reset",))


@pytest.fixture(scope="module")
def running():
    view = LiveView(vehicle_subject("hmmwv", 2, "cpu"), worlds=2, port=0)
    add_panels(view)
    view.speed = 0.0
    yield view
    view.stop()


@pytest.fixture
def view(running):
    running.wheel.open = False
    run_for(running, 0.02)
    running.paused = False
    running.reset()
    running.wheel.open = True
    return running


def ended(closed):
    """Code and reason of a connection's end."""
    return closed.value.rcvd.code, closed.value.rcvd.reason


def vehicle(view):
    return view.subject.elements["vehicle"]


def test_held_throttle_drives_one_world(view):
    with DrivingPage(view, throttle=1.0) as page:
        run_for(view, 5.0)
        speed = vehicle(view).velocity_b.numpy()[:, 0].copy()
        assert speed[0] > 5.0
        assert abs(speed[1]) < 0.05  # the other world stands
        place = vehicle(view).angles.numpy()[0, 2]
        page.say(steer=1.0)
        run_for(view, 1.0)
        assert vehicle(view).omega_b.numpy()[0, 2] > 0.1
        assert vehicle(view).angles.numpy()[0, 2] > place + 0.05
        fast = float(vehicle(view).velocity_b.numpy()[0, 0])
        page.silent()
        time.sleep(0.6)
        run_for(view, 1.0)
        assert vehicle(view).input.numpy()[0, 1:3] == pytest.approx([0.0, 0.3])
        print("held throttle", speed[0], "braked", fast, vehicle(view).velocity_b.numpy()[0, 0])
        assert vehicle(view).velocity_b.numpy()[0, 0] < fast - 0.5
    run_for(view, 0.04)
    assert not view.wheel.occupied


def test_reset_gear_and_camera_keys(view):
    with DrivingPage(view, throttle=1.0) as page:
        run_for(view, 1.5)
        assert vehicle(view).velocity_b.numpy()[0, 0] > 1.0
        page.presses = ["reset", "camera"]
        time.sleep(0.1)
        run_for(view, 0.04)
        assert abs(vehicle(view).velocity_b.numpy()[0, 0]) < 0.2
        page.say()
        page.presses = ["gear_down", "gear_down"]
        time.sleep(0.1)
        run_for(view, 0.04)
        assert read_row(vehicle(view).gear, 0) == -1
        page.say(throttle=1.0)
        time.sleep(0.1)
        run_for(view, 2.0)
        assert vehicle(view).velocity_b.numpy()[0, 0] < -0.5
    assert read_row(vehicle(view).gear, 1) == 1


@pytest.mark.slow
def test_a_truck_is_driven_by_hand_and_its_trailer_follows():
    view = LiveView(vehicle_subject("truck-semitrailer", 1, "cpu"), worlds=1, port=0)
    add_panels(view)
    view.speed = 0.0
    view.wheel.open = True
    try:
        with DrivingPage(view, steer=0.5, throttle=1.0) as page:
            run_for(view, 6.0)
            assert vehicle(view).velocity_b.numpy()[0, 0] > 3.0
            # to the left, and the trailer behind it turned to the right
            assert vehicle(view).angles.numpy()[0, 2] > 0.1
            assert vehicle(view).articulation.numpy()[0, 0] < -0.05
            page.say(brake=1.0)
            run_for(view, 4.0)
            assert abs(vehicle(view).velocity_b.numpy()[0, 0]) < 0.1
    finally:
        view.stop()


def test_arrows_turn_a_robot_on_the_spot_and_a_gear_key_reverses_it():
    view = LiveView(vehicle_subject("skid-steer", 2, "cpu"), worlds=2, port=0)
    add_panels(view)
    view.speed = 0.0
    view.wheel.open = True
    try:
        with DrivingPage(view, steer=1.0) as page:
            run_for(view, 2.0)
            assert vehicle(view).omega_b.numpy()[0, 2] > 1.0
            assert np.linalg.norm(vehicle(view).position.numpy()[0, :2]) < 0.02
            page.say()
            run_for(view, 1.0)
            assert abs(vehicle(view).omega_b.numpy()[0, 2]) < 1e-2
            heading = vehicle(view).angles.numpy()[0, 2]
            page.presses = ["gear_down", "gear_down"]
            time.sleep(0.1)
            run_for(view, 0.04)
            assert read_row(vehicle(view).gear, 0) == -1
            page.say(throttle=1.0)
            time.sleep(0.1)
            run_for(view, 2.0)
            assert vehicle(view).velocity_b.numpy()[0, 0] < -0.5
            assert vehicle(view).angles.numpy()[0, 2] == pytest.approx(heading, abs=0.02)
        assert np.abs(vehicle(view).position.numpy()[1, :2]).max() < 1e-3
    finally:
        view.stop()


def test_one_driver_at_a_time_and_the_next_one_after_him(view):
    with DrivingPage(view), connect(address(view), origin=view.url) as second:
        with pytest.raises(ConnectionClosed) as closed:
            second.recv(timeout=5.0)
        assert ended(closed) == (1013, "another page is driving")
    with DrivingPage(view, throttle=1.0):
        time.sleep(0.2)
        assert view.wheel.occupied
        assert view.wheel.wish() == Wish(throttle=1.0)


def test_who_may_not_drive(view):
    with connect(address(view, token="wrong"), origin=view.url) as socket:
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=5.0)
        assert ended(closed)[0] == 1008
    with pytest.raises(InvalidStatus) as refused:
        connect(address(view), origin=Origin("http://elsewhere.example"))
    assert refused.value.response.status_code == 403
    view.wheel.open = False
    with connect(address(view), origin=view.url) as socket:
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=5.0)
        assert ended(closed) == (1008, "Drive is off")


def test_nonsense_ends_the_connection(view):
    with connect(address(view), origin=view.url) as socket:
        socket.send("full speed")
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=5.0)
        assert ended(closed)[0] == 1007
    assert view.wheel.wish() is None


def test_the_dashboard_tells_and_escapes(view):
    with DrivingPage(view, throttle=1.0, steer=-1.0):
        run_for(view, 2.0)
    board = Dashboard.read(vehicle(view), 0, lambda world: {"<lap>": 0.25})
    weight = vehicle(view).model.body_mass.numpy()[0].sum() * 9.81
    assert sum(load for load, *_ in board.wheels) == pytest.approx(weight, rel=0.1)  # it bounces
    assert board.steering < -0.5
    assert board.pedals[0] == pytest.approx(1.0)
    assert f">{3.6 * board.speed:.0f}</b> km/h" in board.html()
    assert "&lt;lap&gt;" in board.html()
    assert "<lap>" not in board.html()


def test_scripted_vehicles_are_not_offered_for_driving():
    from simwarp.cli.view.maneuver_view import maneuver_subject
    from simwarp.vehicle.driving.maneuvers import maneuver
    from simwarp.vehicle.results.runs import set_up
    from simwarp.vehicle.spec.vehicle_files import load_vehicle

    spec = load_vehicle("hmmwv")
    setup = set_up(spec, maneuver("step-steer", spec), device="cpu")
    assert wheel_of(maneuver_subject(setup, "hmmwv step-steer")) is None


@pytest.mark.parametrize("eye", list(Eye))
def test_the_scene_turns_and_moves_under_the_camera(view, eye):
    chase = next(panel for panel in view.panels if isinstance(panel, DrivePanel)).chase
    chase.use(eye)
    view.page.frame()
    start = moving(view)[0]
    with DrivingPage(view, throttle=1.0, steer=1.0):
        run_for(view, 3.0)
    for _ in range(3):  # the camera comes round in 0.25 s
        time.sleep(0.5)
        view.page.frame()
    state = view.subject.simulation.state
    chassis = vehicle(view).parts.chassis
    turn = state.body_rot.numpy()[0, chassis]
    assert abs(turn[2]) > 0.2
    place, wxyz = moving(view)
    # the chassis: it pitches and leans, but stays before the camera, and faces it but from outside
    assert place == pytest.approx(start, abs=0.3)
    yaw = 2.0 * math.atan2(wxyz[3], wxyz[0])
    assert math.remainder(yaw - (2.0 * math.atan2(turn[2], turn[3]) if eye is Eye.OUTSIDE else 0.0), math.tau) == (
        pytest.approx(0.0, abs=0.05)
    )
    # what is fixed is moved by its root, as what moves is by hand: both show the same world
    back = np.array(view.page._root.wxyz)[[1, 2, 3, 0]] * [-1.0, -1.0, -1.0, 1.0]
    world = turned(back, place - np.array(view.page._root.position))
    batch = next(batch for batch in view.page.batches.batches if batch.moving)
    true = view.page.batches.poses(view.page.bodies)[0][0, batch.instances[0]] + view.page.offsets[0]
    assert world == pytest.approx(true, abs=1e-4)
    chase.leave()
    view.page.follow(False)


def moving(view):
    """Pose of the vehicle's body as it was sent."""
    batch = next(batch for batch in view.page.batches.batches if batch.moving)
    handle = view.page._handles[batch.key]
    return handle.batched_positions[0].astype(float), handle.batched_wxyzs[0].astype(float)


def test_the_ground_goes_along(view):
    Chase(view.page, vehicle(view)).use(Eye.BEHIND)
    view.page.frame()
    ground, handle = view.page.batches.grounds[0], view.page._grounds[0]
    section = 10.0 * ground.tile
    state = view.subject.simulation.state
    places = state.body_x.numpy().copy()
    state.body_x.assign(places + np.array([5000.0, -300.0, 0.0]))
    view.page.frame()
    assert np.abs(np.array(handle.position)[:2] - [5000.0, -300.0]).max() < section
    assert np.allclose(np.remainder(np.array(handle.position)[:2] / section + 0.5, 1.0), 0.5)  # lines stay
    view.page.follow(False)


def test_silent_connections_end_when_driving_is_switched_off(view):
    with DrivingPage(view, throttle=1.0):
        run_for(view, 0.1)
        view.wheel.open = False
        run_for(view, 0.04)
        assert vehicle(view).input.numpy()[0] == pytest.approx([0.0, 0.0, 0.3, 0.0])
