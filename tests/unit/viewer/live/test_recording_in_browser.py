"""A recording opens from a file in a browser that reaches nobody, and plays."""

import base64
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simwarp import cli
from tests.unit.viewer.live.headless import NEEDED, PATIENCE, console_errors, keep, open_browser, until

pytestmark = NEEDED
KEEP_PICTURES = """
const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  return get.call(this, kind, kind.startsWith("webgl") ? {...options, preserveDrawingBuffer: true} : options);
};
window.requestAnimationFrame = (act) => setTimeout(() => act(performance.now()), 100);
"""
PICTURE = """
const wide = [...document.querySelectorAll("canvas")].filter((canvas) => canvas.width * canvas.height > 0);
return wide.length ? wide[wide.length - 1].toDataURL() : "";
"""


@pytest.fixture
def browser() -> Iterator[Any]:
    """Chromium without a display and without names."""
    driver = open_browser("--host-resolver-rules=MAP * ~NOTFOUND", width=600, height=500)
    driver.set_script_timeout(PATIENCE)
    # Pictures are read from the page itself: software drawing is too slow for the driver's screenshots
    driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": KEEP_PICTURES})
    try:
        yield driver
    finally:
        driver.quit()


def test_a_recording_plays_from_a_file_and_asks_nobody(tmp_path: Path, browser: Any) -> None:
    file = tmp_path / "a.html"
    command = ["view", "pendulum", "--worlds", "1", "--record", str(file), "--seconds", "3", "--port", "0"]
    assert cli.main([*command, "--checkpoint", "random"]) == 0
    browser.get(file.as_uri())
    pictures: list[str] = []

    def another() -> bool:
        time.sleep(1.0)
        picture = browser.execute_script(PICTURE)
        if len(picture) > 2000:  # not of one colour
            pictures.append(picture)
        return len(set(pictures)) == 3

    until(another, "its pictures are all the same")
    assert browser.title == "pendulum"
    keep(base64.b64decode(pictures[-1].split(",")[1]), "recording")
    assert console_errors(browser) == []
    events = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    asked = [
        event["params"].get("url") or event["params"]["request"]["url"]
        for event in events
        if event["method"] in ("Network.requestWillBeSent", "Network.webSocketCreated")
    ]
    assert file.as_uri() in asked
    assert [address for address in asked if not address.startswith(("data:", "blob:", "file:"))] == []
