"""Who may come in: this machine alone, pages of our own, holders of the token; and no way out through a tunnel."""

from __future__ import annotations

import asyncio
import http.client
from collections.abc import Iterator
from typing import Any

import pytest

from simwarp.core.types import ModelError

pytest.importorskip("viser")

import websockets
from viser import _messages
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from simwarp.viewer.live.web_server import PORT_VARIABLE, WebServer, open_server


async def echo(connection: Any) -> None:
    async for message in connection:
        await connection.send(message)


@pytest.fixture(scope="module")
def server() -> Iterator[WebServer]:
    opened = open_server("127.0.0.1", 0, "test")
    opened.sockets["/drive"] = echo
    yield opened
    opened.stop()


@pytest.fixture(scope="module")
def remote() -> Iterator[WebServer]:
    """Open to others, as on a cluster."""
    opened = open_server("0.0.0.0", 0, "test")
    opened.sockets["/drive"] = echo
    yield opened
    opened.stop()


def fetch(server: WebServer, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def status_of_socket(server: WebServer, path: str = "/", **options: Any) -> int:
    """101 where a socket opens, the HTTP status of a refusal, or the code it is closed with."""

    async def run() -> int:
        try:
            async with connect(f"ws://127.0.0.1:{server.port}{path}", open_timeout=10, **options) as socket:
                if path.startswith("/drive"):
                    await socket.send("hello")
                    await socket.recv()
                return 101
        except InvalidStatus as error:
            return error.response.status_code
        except ConnectionClosed as error:
            return -1 if error.rcvd is None else error.rcvd.code

    return asyncio.run(run())


def page_socket(server: WebServer, **options: Any) -> int:
    import viser

    return status_of_socket(server, subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")], **options)


def test_the_page_is_served_here(server: WebServer) -> None:
    response = fetch(server)
    assert response.status == 200
    assert b"<html" in response.read()[:2000].lower() or response.headers["Content-Encoding"] == "gzip"
    assert server.url == f"http://127.0.0.1:{server.port}"
    assert page_socket(server, origin=f"http://127.0.0.1:{server.port}") == 101


def test_foreign_pages_are_refused(server: WebServer) -> None:
    assert page_socket(server, origin="http://evil.example") == 403
    assert page_socket(server, origin=f"http://127.0.0.1:{server.port + 1}") == 403
    assert page_socket(server, origin="null") == 403
    assert status_of_socket(server, f"/drive?token={server.token}", origin="http://evil.example") == 403


def test_a_name_that_was_made_to_point_here_is_refused(server: WebServer) -> None:
    assert fetch(server, Host=f"evil.example:{server.port}").status == 403
    assert fetch(server, Host="localhost").status == 200


def test_paths_of_ours_need_the_token(server: WebServer) -> None:
    assert status_of_socket(server, f"/drive?token={server.token}") == 101
    assert status_of_socket(server, "/drive") == 1008
    assert status_of_socket(server, "/drive?token=guess") == 1008


def test_others_need_the_token(remote: WebServer) -> None:
    assert remote.token in remote.url
    assert fetch(remote).status == 403
    assert page_socket(remote) == 403
    page = fetch(remote, f"/?token={remote.token}")
    assert page.status == 200
    cookie = page.headers["Set-Cookie"].partition(";")[0]
    assert "HttpOnly" in page.headers["Set-Cookie"]
    assert page_socket(remote, additional_headers={"Cookie": cookie}) == 101
    assert page_socket(remote, additional_headers={"Cookie": cookie + "x"}) == 403
    # the cookie of a page is not enough to drive
    assert status_of_socket(remote, "/drive", additional_headers={"Cookie": cookie}) == 1008


def test_no_message_opens_a_tunnel(server: WebServer) -> None:
    handlers = server.viser._websock_server._incoming_handlers
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        assert handlers[message] == []


def test_the_private_names_that_this_leans_on_are_there(server: WebServer) -> None:
    assert isinstance(server.viser._connected_clients, dict)
    assert hasattr(server.viser._websock_server, "_incoming_handlers")
    assert isinstance(server.viser.gui._gui_input_handle_from_uuid, dict)
    assert server.viser.gui._thread_executor is server.viser._thread_executor is server.viser.scene._thread_executor
    assert hasattr(_messages, "RunJavascriptMessage")
    import viser.infra._infra as infra

    assert infra.websockets.asyncio.server.serve is websockets.asyncio.server.serve


def test_an_environment_variable_does_not_move_the_port(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(PORT_VARIABLE, "1")
    opened = open_server("127.0.0.1", 0, "test")
    opened.stop()
    assert opened.port != 1
    assert PORT_VARIABLE in capsys.readouterr().err


@pytest.mark.parametrize(("host", "port", "word"), [("no.such.host.invalid", 0, "host"), ("127.0.0.1", 70000, "port")])
def test_what_cannot_be_served_is_one_line(host: str, port: int, word: str) -> None:
    with pytest.raises(ModelError, match=word) as caught:
        open_server(host, port, "test")
    assert "\n" not in str(caught.value)


def test_a_taken_port_is_passed_over(server: WebServer) -> None:
    opened = open_server("127.0.0.1", server.port, "test")
    opened.stop()
    assert opened.port > server.port
