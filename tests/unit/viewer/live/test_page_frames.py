"""Frames and requests that no page sends: dropped, answered by the right status, and told of in one line."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser")

import msgspec.msgpack

from simwarp.cli.view.model_subjects import scene_subject
from simwarp.viewer.live import LiveView, page_frames
from simwarp.viewer.live.page_frames import Complaints, fault_of
from simwarp.viewer.live.page_panels import add_panels
from simwarp.viewer.live.web_server import WebServer, open_server
from tests.reference.viser_client import CAMERA, connect

DRAG = {
    "type": "SceneNodeDragMessage", "phase": "start", "name": "/moving/0", "instance_index": 0,
    "start_position": (0.0, 0.0, 1.0), "start_screen_pos": (0.5, 0.5), "end_position": (0.0, 0.0, 2.0),
    "end_screen_pos": (0.5, 0.5), "button": "left", "modifier": "shift",
}  # fmt: skip
CLICK = {
    "type": "SceneNodeClickMessage", "name": "/moving/0", "instance_index": 0, "ray_origin": (0.0, 0.0, 1.0),
    "ray_direction": (0.0, 0.0, 1.0), "screen_pos": (0.5, 0.5), "modifier": None,
}  # fmt: skip
GOOD: dict[str, dict[str, Any]] = {
    "camera": CAMERA, "drag": DRAG, "click": CLICK, "update": {"type": "GuiUpdateMessage", "uuid": "a", "updates": {}},
}  # fmt: skip


def without(message: dict[str, Any], key: str) -> bytes:
    return msgspec.msgpack.encode({name: value for name, value in message.items() if name != key})


BAD: dict[str, Any] = {
    "text": "hello",
    "empty": b"",
    "noise": bytes(range(256)),
    "a number": msgspec.msgpack.encode(3),
    "a list": msgspec.msgpack.encode([1, 2]),
    "no type": msgspec.msgpack.encode({"x": 1}),
    "unknown type": msgspec.msgpack.encode({"type": "Nothing"}),
    "more": msgspec.msgpack.encode(CAMERA | {"more": 1}),
    "camera without a place": without(CAMERA, "position"),
    "camera of NaN": msgspec.msgpack.encode(CAMERA | {"position": (float("nan"), 0.0, 0.0)}),
    "camera far away": msgspec.msgpack.encode(CAMERA | {"position": (1e300, 0.0, 0.0)}),
    "camera of two numbers": msgspec.msgpack.encode(CAMERA | {"position": (0.0, 0.0)}),
    "camera of words": msgspec.msgpack.encode(CAMERA | {"fov": "wide"}),
    "click without an origin": without(CLICK, "ray_origin"),
    "drag without a place": without(DRAG, "start_position"),
    "drag of NaN": msgspec.msgpack.encode(DRAG | {"end_position": (0.0, float("inf"), 0.0)}),
    "drag of no phase": msgspec.msgpack.encode(DRAG | {"phase": "begin"}),
    "update of a list": msgspec.msgpack.encode(GOOD["update"] | {"updates": [1]}),
    "update of NaN": msgspec.msgpack.encode(GOOD["update"] | {"updates": {"value": [1.0, float("nan")]}}),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_message_is_named(name: str) -> None:
    fault = fault_of(BAD[name])
    assert fault
    assert fault_of(msgspec.msgpack.encode(GOOD["camera"])) is None


@pytest.mark.parametrize("name", GOOD)
def test_what_a_page_sends_passes(name: str) -> None:
    assert fault_of(msgspec.msgpack.encode(GOOD[name])) is None


def test_a_page_is_told_of_once_and_lines_keep_their_distance(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock of the test's own: 600 faults of one page are a line, those of 600 pages in 3 s are three."""
    clock = [100.0]
    monkeypatch.setattr(page_frames.time, "monotonic", lambda: clock[0])
    one = Complaints()
    for number in range(600):
        clock[0] += 5.0
        one.report("127.0.0.1:1", f"fault {number}\nof two lines")
    assert capfd.readouterr().err.splitlines() == ["viewer: 127.0.0.1:1: fault 0 of two lines"]
    many = Complaints()
    for number in range(600):
        clock[0] += 0.005
        many.report(f"127.0.0.1:{number}", "fault")
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[1].endswith("fault (199 more since the last line)")


@pytest.fixture
def view() -> Iterator[LiveView]:
    """An ant that rests, with all panels."""
    made = LiveView(scene_subject("ant", 1, "cpu"), worlds=1, port=0)
    made.paused = True
    add_panels(made)
    thread = threading.Thread(target=made.run, daemon=True)
    thread.start()
    yield made
    made.stopped = True
    thread.join(timeout=10.0)
    made.stop()


def test_the_page_lives_through_malformed_frames(
    view: LiveView, capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """600 frames of every kind: one line in all, no traceback, and the same page still steps the simulation."""
    monkeypatch.chdir(tmp_path)  # one of the buttons records
    with connect(view.url) as page:
        page.wait(lambda: page.has("Pause"))
        for _ in range(600 // len(BAD)):
            for frame in BAD.values():
                page._socket.send(frame)
        for element in list(page.gui):  # values of another kind, and out of range
            for value in ("word", [1, 2], {"a": 1}, None, True, -1e11, 7):
                page.send({"type": "GuiUpdateMessage", "uuid": element, "updates": {"value": value}})
            page.send({"type": "GuiUpdateMessage", "uuid": element, "updates": {"nothing": 1, "label": 3}})
        page.send({"type": "GuiUpdateMessage", "uuid": "gone", "updates": {"value": 1.0}})
        time = view.subject.simulation.state.world_time.numpy
        view.post(lambda: setattr(view, "paused", True))
        page.wait(lambda: view.paused)
        now = float(time()[0])
        page.trigger("One step")
        page.wait(lambda: time()[0] > now)
    told = capfd.readouterr().err
    assert "Traceback" not in told
    assert np.isfinite(view.subject.simulation.state.body_x.numpy()).all()
    lines = [line for line in told.splitlines() if line]
    assert "a frame is dropped" in lines[0]
    assert len(lines) == 1, lines  # neither do values of another kind reach a panel


# ---- requests --------------------------------------------------------------------------------------------------------

SOCKET = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n"


@pytest.fixture(scope="module")
def server() -> Iterator[WebServer]:
    opened = open_server("127.0.0.1", 0, "test")
    yield opened
    opened.stop()


REQUESTS = {
    "host of an open bracket": ("/", ["Host: [::1"], 400),
    "port that is a word": ("/", ["Host: 127.0.0.1:port"], 400),
    "two hosts": ("/", ["Host: 127.0.0.1", "Host: 127.0.0.1"], 400),
    "no host": ("/", [], 400),
    "two encodings": ("/", ["Host: 127.0.0.1", "Accept-Encoding: br", "Accept-Encoding: gzip"], 400),
    "two upgrades": ("/", ["Host: 127.0.0.1", "Upgrade: websocket", "Upgrade: websocket"], 400),
    "long name": (f"/{'a' * 3000}", ["Host: 127.0.0.1"], 404),
    "zero byte": ("/%00", ["Host: 127.0.0.1"], 404),
    "path that is no address": ("//[", ["Host: 127.0.0.1"], 404),
    "origin of an open bracket": ("/", ["Host: 127.0.0.1", "SOCKET", "Origin: http://[::1"], 403),
    "two origins": ("/", ["Host: 127.0.0.1", "SOCKET", *["Origin: http://127.0.0.1"] * 2], 403),
    "page": ("/", ["Host: 127.0.0.1"], 200),
}


@pytest.mark.parametrize("name", REQUESTS)
def test_a_malformed_request_has_the_status_that_says_so(
    name: str, server: WebServer, capfd: pytest.CaptureFixture[str]
) -> None:
    path, headers, status = REQUESTS[name]
    key = SOCKET.format(key="A" * 22 + "==")
    lines = "".join(key if line == "SOCKET" else f"{line}\r\n" for line in headers)
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        connection.sendall(f"GET {path} HTTP/1.1\r\n{lines}\r\n".encode())
        answer = connection.recv(4096)
    assert int(answer.split()[1]) == status
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("sent", [b"\x16\x03\x01\r\n\r\n", b"GET / HTTP/1.1\r\nHost", b"POST / HTTP/1.1\r\n\r\n"])
def test_what_is_no_request_leaves_no_traceback(
    sent: bytes, server: WebServer, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        connection.sendall(sent)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4096):
            pass
    assert capfd.readouterr().err.count("\n") <= 1
