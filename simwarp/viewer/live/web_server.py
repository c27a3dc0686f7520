"""The web server of the viewer: for this machine alone by default, and never through a tunnel.

Pages of other origins may open sockets to this machine: the browser only tells where they come from. All connections
are therefore held to their `Origin` and `Host` here, by wrapping the one call with which viser opens its port.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import hmac
import http
import io
import logging
import os
import secrets
import sys
import threading
from collections.abc import Awaitable, Callable, Iterator, Mapping
from typing import Any, Final
from urllib.parse import SplitResult, parse_qs, urlsplit

from simwarp.core.types import ModelError
from simwarp.viewer.live.viser_extra import not_installed

try:
    import viser
    import websockets.asyncio.server
    from viser import _messages
    from websockets import Headers
    from websockets.datastructures import MultipleValuesError
    from websockets.exceptions import ConnectionClosed as ConnectionClosed
    from websockets.http11 import Response

    from simwarp.viewer.live.page_frames import CheckedConnection, Complaints, OneLine
except ImportError as error:
    raise not_installed(error) from None

HERE: Final = ("127.0.0.1", "localhost", "[::1]")
PORT_VARIABLE: Final = "_VISER_PORT_OVERRIDE"
TOKEN: Final = "token"
_OPENING = threading.Lock()

SocketHandler = Callable[[Any], Awaitable[None]]
"""Of one connection to a path of ours, until it ends."""


@dataclasses.dataclass(frozen=True, eq=False)
class WebServer:
    """A server that runs.

    Attributes:
        viser: the library's server.
        host, port: that it is bound to.
        url: for a browser, with the token where there is one.
        token: that a connection from elsewhere, and to a path of ours, has to bring.
        sockets: further web sockets by path, such as /drive; they need the token as well. May be added to.
    """

    viser: viser.ViserServer
    host: str
    port: int
    url: str
    token: str
    sockets: dict[str, SocketHandler]

    @property
    def watched(self) -> bool:
        """True if anybody looks."""
        return bool(self.viser._connected_clients)

    def stop(self) -> None:
        """Closes the port and all connections."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


def open_server(host: str, port: int, title: str) -> WebServer:
    """Opens the first free port from `port` on.

    Args:
        host: 127.0.0.1 lets nobody in but this machine; others need the token that is in the address then.
        port: 0: any.
        title: of the page.

    Raises:
        ModelError: the address cannot be used.
    """
    if not 0 <= port <= 65535:
        raise ModelError(f"viewer: port must be in 0..65535, got {port}; 8080 is the default")
    _check_address(host)
    if os.environ.pop(PORT_VARIABLE, None) is not None:
        print(f"warning: viewer: {PORT_VARIABLE} is ignored; use --port", file=sys.stderr)
    guard = _Guard(host, secrets.token_urlsafe(16))
    with _OPENING, guard.wrapped(), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
    bound = server.get_port()
    guard.port = bound
    _close_tunnels(server)
    guard.watch_callbacks(server)
    guard.elements = server.gui._gui_input_handle_from_uuid
    local = host in ("127.0.0.1", "localhost", "::1")
    name = f"[{host}]" if ":" in host else ("127.0.0.1" if host == "0.0.0.0" else host)
    url = f"http://{name}:{bound}" + ("" if local else f"/?{TOKEN}={guard.token}")
    return WebServer(server, host, bound, url, guard.token, guard.sockets)


def run_script(client: Any, source: str) -> None:
    """Has one page run a script, as the body of a function; it is no part of the scene, nor of recordings."""
    client._websock_connection.queue_message(_messages.RunJavascriptMessage(source=source))


def _check_address(host: str) -> None:
    import socket

    try:
        socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)
    except OSError as error:
        rule = f"viewer: host must be an address of this machine, got '{host}' ({error}); 127.0.0.1 is one"
        raise ModelError(rule) from None


def _close_tunnels(server: viser.ViserServer) -> None:
    """No message of a page opens a tunnel to the public."""
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server._incoming_handlers[message] = []


class _Guard:
    """Holds requests to origin, host and token, and leads those to paths of ours to their handlers."""

    def __init__(self, host: str, token: str) -> None:
        self.token, self.port = token, 0
        self.sockets: dict[str, SocketHandler] = {}
        self.complaints = Complaints()
        self.elements: Mapping[str, Any] = {}
        self._local = host in ("127.0.0.1", "localhost", "::1")
        self._logger = logging.Logger("simwarp.viewer.web_server")  # of its own: viser and others use the library's
        self._logger.addFilter(OneLine(self.complaints))

    @contextlib.contextmanager
    def wrapped(self) -> Iterator[None]:
        """While viser opens its port."""
        plain: Any = websockets.asyncio.server.serve

        def serve(handler: SocketHandler, *arguments: Any, process_request: Any = None, **options: Any) -> Any:
            def checked(connection: Any, request: Any) -> Any:
                refused = self.refusal(request)
                if refused is not None or process_request is None:
                    return refused
                try:
                    response = process_request(connection, request)
                except MultipleValuesError as error:
                    return _response(400, f"a request must have one {error.args[0]}")
                except (OSError, ValueError):  # a path that no file system takes
                    return _response(404, "there is no such page")
                if response is not None and not self._local and response.status_code == 200:
                    # the page's own socket comes without the address's parameters, but with its cookies
                    cookie = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                    response.headers["Set-Cookie"] = cookie
                return response

            options["logger"] = self._logger
            return plain(self._routed(handler), *arguments, process_request=checked, **options)

        websockets.asyncio.server.serve = serve  # type: ignore[misc,assignment]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = plain  # type: ignore[misc]

    def refusal(self, request: Any) -> Any:
        """A response to what may not come in, else None."""
        hosts = request.headers.get_all("Host")
        place = _split("//" + hosts[0]) if len(hosts) == 1 else None
        if place is None:
            return _response(400, f"a request must have one Host, got {len(hosts)}, or one that is no address")
        host = place.hostname or ""
        if self._local and host not in ("127.0.0.1", "localhost", "::1"):
            return _response(403, "this viewer serves 127.0.0.1 alone; start it with --host for others")
        if not self._local and not self.admits(request):
            return _response(403, "the address lacks the token that was printed")
        origins = request.headers.get_all("Origin")
        if origins and any(each.lower() == "websocket" for each in request.headers.get_all("Upgrade")):
            own = _split(origins[0]) if len(origins) == 1 else None
            if own is None or own.scheme not in ("http", "https") or own.netloc != hosts[0]:
                return _response(403, f"origin {origins[0][:100]!r} may not connect")
        return None

    def admits(self, request: Any, *, cookies: bool = True) -> bool:
        """Whether a request has the token: in its path, or in the cookie that the page was sent with."""
        address = _split(request.path)
        given = [""] if address is None else parse_qs(address.query).get(TOKEN, [""])
        for header in request.headers.get_all("Cookie") if cookies else ():
            pairs = (pair.strip().partition("=") for pair in header.split(";"))
            given += [value for name, _, value in pairs if name == self._cookie]
        return any(hmac.compare_digest(each.encode(), self.token.encode()) for each in given)

    @property
    def _cookie(self) -> str:
        return f"simwarp_{self.port}"

    def _routed(self, handler: SocketHandler) -> SocketHandler:
        async def route(connection: Any) -> None:
            asyncio.get_running_loop().set_exception_handler(self._complain)
            address = _split(connection.request.path)
            own = None if address is None else self.sockets.get(address.path)
            if own is None:
                await handler(CheckedConnection(connection, self.complaints, self.elements))
            elif self.admits(connection.request, cookies=False):
                await own(connection)
            else:
                await connection.close(1008, "token")

        return route

    def watch_callbacks(self, server: viser.ViserServer) -> None:
        """What a page asks for runs in a pool of threads; where that fails, viser would print a traceback."""
        pool: Any = server._thread_executor
        submit: Any = pool.submit

        def watched(call: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
            def run() -> Any:
                try:
                    return call(*arguments, **options)
                except Exception as error:  # noqa: BLE001  whatever a page asks for
                    self._complain(None, {"exception": error})

            return submit(run)

        pool.submit = watched

    def _complain(self, _: Any, context: dict[str, Any]) -> None:
        """A handler of viser failed over what a page sent: it has no page's name any more."""
        error = context.get("exception")
        told = str(context.get("message", "")) if error is None else f"{type(error).__name__}: {error}"
        self.complaints.report("a page", f"what it asked for failed ({told})")


def _split(text: str) -> SplitResult | None:
    """An address in its parts; None where it is none."""
    try:
        place = urlsplit(text)
        _ = place.port  # read for its check alone
    except ValueError:
        return None
    return place


def _response(status: int, reason: str) -> Any:
    body = (reason + "\n").encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    return Response(status, http.HTTPStatus(status).phrase, headers, body)
