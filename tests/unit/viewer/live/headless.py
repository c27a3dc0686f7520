"""A browser without a display: how the tests of pages open one, wait, and read what its console says."""

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PATIENCE = 100.0
"""Longest wait [s]: WebGL is drawn by the processor here, beside the simulation."""
PICTURES = os.environ.get("SIMWARP_TEST_PICTURES")
"""Folder for screenshots, to be looked at."""
NEEDED = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("chromium") and shutil.which("chromedriver")), reason="chromium or chromedriver is missing"
    ),
]
"""Marks of a test that opens one."""


def open_browser(*flags: str, width: int = 1000, height: int = 700) -> Any:
    """Chromium that keeps its console and, where flags ask for it, its requests; the caller quits it."""
    webdriver: Any = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    for flag in (
        "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--ignore-gpu-blocklist", f"--window-size={width},{height}", *flags,
    ):  # fmt: skip
        options.add_argument(flag)
    options.binary_location = str(shutil.which("chromium"))
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))


def until(true: Callable[[], object], what: str) -> None:
    """Waits: nothing here is about how fast a page is drawn."""
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def console_errors(browser: Any) -> list[str]:
    """Severe lines of the console."""
    return [line["message"] for line in browser.get_log("browser") if line["level"] == "SEVERE"]


def keep(picture: bytes, name: str) -> None:
    """Writes a screenshot (PNG) where pictures are asked for."""
    if PICTURES:
        (Path(PICTURES) / f"{name}.png").write_bytes(picture)
