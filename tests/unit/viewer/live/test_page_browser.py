"""The page in a browser: it draws, moves, folds its panels where it is narrow, and a hand lifts an ant."""

import io
import math
import threading
import time

import numpy as np
import pytest

pytest.importorskip("viser")
pytest.importorskip("selenium")

from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.keys import Keys

import simwarp as sw
from simwarp.scenes import ant
from simwarp.sensors.scene import Visuals
from simwarp.viewer.default_visuals import paint
from simwarp.viewer.live.hand import with_hand
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.page_panels import add_panels
from simwarp.viewer.live.subject import Subject
from tests.unit.viewer.live.headless import NEEDED, console_errors, keep, open_browser, until

pytestmark = NEEDED


@pytest.fixture
def view():
    builder = ant()
    visuals = Visuals(builder)
    paint(visuals)
    model = builder.finalize(1, "cpu")
    simulation = sw.Simulation(model, 0.005, elements=with_hand(model))
    subject = Subject("ant", simulation, visuals.finalize(model), 0.02, lambda: simulation.advance(4), simulation.reset)
    view = LiveView(subject, worlds=1, port=0)
    add_panels(view)
    thread = threading.Thread(target=view.run)
    thread.start()
    yield view
    view.stopped = True
    thread.join()
    view.stop()


def opened(view, width, height, *, phone=False):
    browser = open_browser(width=width, height=height)
    if phone:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(view.url)
    until(lambda: "real time" in browser.page_source or phone, "the panels do not come")
    return browser


@pytest.fixture
def page(view):
    browser = opened(view, 800, 560)
    yield browser
    errors = console_errors(browser)
    browser.quit()
    # what viser's page itself does when a drag begins
    assert [line for line in errors if "preventDefault inside passive event listener" not in line] == []


def pixels(browser, name=None):
    data = browser.get_screenshot_as_png()
    if name:
        keep(data, name)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), np.int16)


def torso(view):
    return view.subject.simulation.state.body_q.numpy()[0, 0, :3].astype(float)


def left_of_panels(image):
    return image[100:, : image.shape[1] // 2]


def test_the_canvas_is_drawn_and_moves(view, page):
    until(lambda: left_of_panels(pixels(page)).std() > 5.0, "the canvas is uniform")
    view.post(lambda: view.reset())  # it falls again
    first = left_of_panels(pixels(page, "page_first"))
    until(lambda: np.abs(left_of_panels(pixels(page)) - first).max() > 20, "nothing moves")
    frames: list[float] = []
    sent = view.page.frame

    def counted() -> None:
        frames.append(time.monotonic())
        sent()

    view.page.frame = counted
    time.sleep(4.0)
    view.page.frame = sent
    assert len(frames) > 0.7 * 4.0 * 30.0  # two cores that also draw in software; 30 per second are asked for


def pixel(view, place):
    """Where a place of the first world is on the canvas [pixels]."""
    [client] = view.server.viser.get_clients().values()
    camera = client.camera
    eye, target = np.asarray(camera.position), np.asarray(camera.look_at)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    seen = np.asarray(place) + view.page.shifts[0] - eye
    scale = 0.5 * camera.image_height / math.tan(0.5 * camera.fov) / (seen @ ahead)
    middle = 0.5 * camera.image_width, 0.5 * camera.image_height
    return round(middle[0] + seen @ right * scale), round(middle[1] - (seen @ up) * scale)


def test_shift_and_the_left_button_lift_an_ant(view, page):
    until(lambda: left_of_panels(pixels(page)).std() > 5.0, "the canvas is uniform")
    until(lambda: view.subject.simulation.state.world_time.numpy()[0] > 1.0, "it does not come to rest")
    rest = torso(view)
    view.page.follow(False)
    start, end = (pixel(view, rest + height * np.array([0.0, 0.0, 1.0])) for height in (0.0, 0.9))
    ActionChains(page).key_down(Keys.SHIFT).perform()
    pointer = ActionBuilder(page)
    pointer.pointer_action.move_to_location(*start).pointer_down()
    for k in range(1, 9):
        pointer.pointer_action.move_to_location(
            *(round(a + (b - a) * k / 8) for a, b in zip(start, end, strict=True))
        ).pause(0.1)
    pointer.perform()
    until(lambda: torso(view)[2] > rest[2] + 0.2, "the ant is not lifted by 0.2 m")
    pixels(page, "lifted")
    release = ActionBuilder(page)
    release.pointer_action.pointer_up()
    release.perform()
    ActionChains(page).key_up(Keys.SHIFT).perform()
    until(lambda: torso(view)[2] < rest[2] + 0.05, "the ant is not let go")
    assert np.isfinite(torso(view)).all()


def test_on_a_phone_the_panels_are_folded_and_everything_is_in_sight(view):
    browser = opened(view, 390, 844, phone=True)
    try:
        until(
            lambda: browser.execute_script("return !!window.simwarpNarrow"), "the page does not know that it is narrow"
        )
        until(lambda: "real time" not in browser.execute_script("return document.body.innerText"), "not folded")
        until(lambda: 0 < pixel(view, torso(view))[0] < 390, "the ant is beside the page")
        until(lambda: pixels(browser, "phone")[200:700].std() > 5.0, "the canvas is uniform")
        handle = "return [...document.querySelectorAll('div')].find((e) => e.style.cursor === 'pointer').click()"
        browser.execute_script(handle)
        until(lambda: "real time" in browser.execute_script("return document.body.innerText"), "it does not unfold")
        pixels(browser, "phone_panels")
    finally:
        errors = [line for line in browser.get_log("browser") if line["level"] == "SEVERE"]
        browser.quit()
    assert errors == []
