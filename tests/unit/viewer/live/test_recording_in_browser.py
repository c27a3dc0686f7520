"""A recording opens from a file in a browser that reaches nobody, and plays."""

import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simwarp import cli

webdriver: Any = pytest.importorskip("selenium.webdriver")
PATIENCE = 100.0
"""Longest wait for two different pictures: WebGL is drawn by the processor here [s]."""
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
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        pytest.skip("needs chromium and chromedriver")
    options = webdriver.ChromeOptions()
    for argument in (
        "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--ignore-gpu-blocklist", "--window-size=600,500", "--host-resolver-rules=MAP * ~NOTFOUND",
    ):  # fmt: skip
        options.add_argument(argument)
    options.binary_location = shutil.which("chromium")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    driver.set_script_timeout(PATIENCE)
    # Pictures are read from the page itself: software drawing is too slow for the driver's screenshots
    driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": KEEP_PICTURES})
    try:
        yield driver
    finally:
        driver.quit()


@pytest.mark.slow
@pytest.mark.browser
def test_a_recording_plays_from_a_file_and_asks_nobody(tmp_path: Path, browser: Any) -> None:
    file = tmp_path / "a.html"
    command = ["view", "pendulum", "--worlds", "1", "--record", str(file), "--seconds", "3", "--port", "0"]
    assert cli.main([*command, "--checkpoint", "random"]) == 0
    browser.get(file.as_uri())
    pictures: list[str] = []
    end = time.monotonic() + PATIENCE
    while len(set(pictures)) < 3:
        assert time.monotonic() < end, f"{len(pictures)} pictures, {len(set(pictures))} different"
        time.sleep(1.0)
        picture = browser.execute_script(PICTURE)
        if len(picture) > 2000:  # not of one colour
            pictures.append(picture)
    assert browser.title == "pendulum"
    if "SIMWARP_PICTURES" in os.environ:
        import base64

        Path(os.environ["SIMWARP_PICTURES"]).write_bytes(base64.b64decode(pictures[-1].split(",")[1]))
    assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
    events = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    asked = [
        event["params"].get("url") or event["params"]["request"]["url"]
        for event in events
        if event["method"] in ("Network.requestWillBeSent", "Network.webSocketCreated")
    ]
    assert file.as_uri() in asked
    assert [address for address in asked if not address.startswith(("data:", "blob:", "file:"))] == []
