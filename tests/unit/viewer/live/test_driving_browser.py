"""`keys.js` in a browser: held keys, lost focus, form fields, a gamepad."""

import threading
import time

import pytest

pytest.importorskip("viser")
pytest.importorskip("selenium")

from selenium.webdriver.common.action_chains import ActionChains

from simwarp.cli.view.vehicle_subject import vehicle_subject
from simwarp.viewer.live.driving.drive_panel import DrivePanel
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.page_panels import add_panels
from tests.unit.viewer.live.headless import NEEDED, console_errors, keep, open_browser, until

pytestmark = NEEDED


@pytest.fixture(scope="module")
def view():
    view = LiveView(vehicle_subject("hmmwv", 1, "cpu"), port=0)
    add_panels(view)
    next(panel for panel in view.panels if isinstance(panel, DrivePanel)).switch(True)
    thread = threading.Thread(target=view.run)
    thread.start()
    yield view
    view.stopped = True
    thread.join()
    view.stop()


@pytest.fixture(scope="module")
def page(view):
    browser = open_browser()
    browser.get(view.url)
    until(lambda: view.wheel.wish() is not None, "no page drives")
    yield browser
    errors = console_errors(browser)
    browser.quit()
    assert errors == []


def picture(page, name):
    keep(page.get_screenshot_as_png(), name)


def vehicle(view):
    return view.subject.elements["vehicle"]


def wish(view):
    return view.wheel.wish()


def test_held_keys_drive_five_metres(view, page):
    picture(page, "drive_rest")
    place = vehicle(view).position.numpy()[0].copy()
    ActionChains(page).key_down("w").perform()
    until(lambda: vehicle(view).position.numpy()[0][0] - place[0] > 5.0, "held W drives")
    picture(page, "drive_held")
    assert wish(view).throttle == 1.0
    ActionChains(page).key_down("a").perform()
    until(lambda: wish(view).steer == 1.0, "A steers to the left")
    until(lambda: vehicle(view).omega_b.numpy()[0][2] > 0.1, "the vehicle turns to the left")
    picture(page, "drive_left")
    ActionChains(page).key_up("a").key_down("d").perform()
    until(lambda: wish(view).steer == -1.0, "D steers to the right")
    ActionChains(page).key_up("d").key_up("w").perform()
    until(lambda: wish(view).throttle == 0.0, "released keys are told")
    assert not view.paused


def test_space_brakes_and_does_not_pause(view, page):
    ActionChains(page).key_down(" ").perform()
    until(lambda: wish(view).brake == 1.0, "space brakes")
    ActionChains(page).key_up(" ").perform()
    until(lambda: wish(view).brake == 0.0, "released")
    assert not view.paused


def test_lost_focus_releases_all(view, page):
    ActionChains(page).key_down("w").perform()
    until(lambda: wish(view).throttle == 1.0, "W is held")
    page.execute_script("window.dispatchEvent(new Event('blur'))")
    until(lambda: wish(view).throttle == 0.0, "lost focus releases")
    ActionChains(page).key_up("w").perform()
    page.execute_script("window.simwarpDrive.stop()")
    until(lambda: wish(view) is None, "a page that has left is silent")
    until(lambda: vehicle(view).input.numpy()[0][2] > 0.0, "nobody brakes")
    assert list(vehicle(view).input.numpy()[0][1:3]) == pytest.approx([0.0, 0.3])


def test_a_page_that_is_loaded_anew_drives_again_and_a_gamepad_steers(view, page):
    page.refresh()
    until(lambda: wish(view) is not None, "the page is back")
    page.execute_script(
        "navigator.getGamepads = () => [{axes: [-0.54, 0], buttons: Array.from({length: 17}, (_, i) => ({value: "
        "i === 7 ? 1 : 0}))}]"
    )
    # the dead zone of 0.08 is taken off, and the rest spread: 0.46 / 0.92
    until(lambda: wish(view) is not None and wish(view).steer == 0.5, "the stick steers to the left")
    assert wish(view).throttle == 1.0
    until(lambda: vehicle(view).omega_b.numpy()[0][2] > 0.1, "the vehicle turns to the left")
    page.execute_script("navigator.getGamepads = () => [{axes: [0.07, 0], buttons: []}]")
    until(lambda: wish(view).steer == 0.0 and wish(view).throttle == 0.0, "the dead zone")
    page.execute_script("navigator.getGamepads = () => [null]")


def test_form_fields_are_left_alone(view, page):
    page.execute_script("const field = document.createElement('input'); field.id = 'own'; document.body.append(field)")
    page.execute_script("document.getElementById('own').focus()")
    ActionChains(page).send_keys("wad").perform()
    time.sleep(0.3)
    assert page.execute_script("return document.getElementById('own').value") == "wad"
    assert wish(view).throttle == 0.0
    page.execute_script("document.getElementById('own').remove()")


def test_a_second_page_is_told_why_it_does_not_drive(view, page):
    first = page.current_window_handle
    page.switch_to.new_window("tab")
    page.get(view.url)
    told = "return window.simwarpDrive ? window.simwarpDrive.label.textContent : ''"
    until(lambda: page.execute_script(told) == "another page is driving", "the reason is shown")
    picture(page, "drive_second")
    ActionChains(page).key_down("w").perform()
    time.sleep(0.5)
    assert wish(view) is None or wish(view).throttle == 0.0  # what it sends is not followed
    ActionChains(page).key_up("w").perform()
    page.close()
    page.switch_to.window(first)
