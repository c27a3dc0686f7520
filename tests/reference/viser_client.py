"""A client of the web viewer without a browser: it speaks viser's protocol, keeps the page's state, and presses things.

with connect(view.url) as page:
    page.wait(lambda: page.has("Pause"))
    page.click("Pause")
    page.set("World", 3)
    page.trigger("One step")
    page.drag("/world/moving/0", 5, "start", grab=(0, 0, 1), pointer=(0, 0, 2))
    page.positions("/world/moving/0")  # (N, 3)
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec.msgpack
import numpy as np
import viser
import websockets.sync.client
import zstandard
from websockets.typing import Subprotocol

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, -5.0, 2.0), "fov": 1.0, "near": 0.01,
    "far": 1000.0, "image_height": 600, "image_width": 800, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip
PATIENCE = 200.0
"""Longest wait for anything to arrive [s]: kernels may have to be compiled, and the machine may have other work."""


def with_arrays(message: Any, content: dict[str, Any], data: bytes, place: int) -> Any:
    """A message with its arrays, which lie in `data` from `place` on, each at a multiple of eight bytes."""
    buffers = []
    for size in content["binaryBufferLengths"]:
        place += -place % 8
        buffers.append(data[place : place + size])
        place += size

    def filled(value: Any) -> Any:
        if isinstance(value, dict):
            if "__binary_index" in value:
                return np.frombuffer(buffers[value["__binary_index"]], value["dtype"])
            return {key: filled(each) for key, each in value.items()}
        return [filled(each) for each in value] if isinstance(value, list) else value

    return filled(message)


def decoded(data: bytes) -> list[dict[str, Any]]:
    """The messages of one frame of the socket, with arrays as NumPy has them (flat)."""
    whole, packed = (int.from_bytes(data[place : place + 8], "little") for place in (0, 8))
    inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], whole))
    return [with_arrays(message, inner, data, 16 + packed) for message in inner["messages"]]


class ViserClient:
    """One page that is open.

    Attributes:
        gui: elements by id, as their messages had them, with updates applied: `props`, and `value` where they have one.
        nodes: of the scene by name: `props`, and `position`, `wxyz`, `visible` where they were told.
        commands: labels by id.
        counts: messages of each type.
        scripts: JavaScript that was sent.
        notices: bodies of the notifications.
        octets: received.
    """

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._news = threading.Condition()
        self.gui: dict[str, dict[str, Any]] = {}
        self.nodes: dict[str, dict[str, Any]] = {}
        self.commands: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.scripts: list[str] = []
        self.notices: list[str] = []
        self.octets = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.send(CAMERA)

    def send(self, message: dict[str, Any]) -> None:
        """A message as a page would send it."""
        self._socket.send(msgspec.msgpack.encode(message))

    def close(self) -> None:
        """Leaves."""
        self._socket.close()
        self._reader.join(timeout=5.0)

    def wait(self, until: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Returns what `until` returns as soon as that is true; asked after every news.

        Raises:
            TimeoutError: it never was.
        """
        end = time.monotonic() + patience
        with self._news:
            while not (found := until()):
                if time.monotonic() > end:
                    raise TimeoutError(f"nothing came that {until} waits for; messages: {self.counts}")
                self._news.wait(0.05)
        return found

    # elements

    def has(self, label: str, folder: str | None = None) -> bool:
        """Whether the page has an element."""
        return bool(self.labelled(label, folder))

    def labelled(self, label: str, folder: str | None = None) -> list[str]:
        """Ids of the elements with a label, of those in a folder, if one is named."""
        return [
            key for key, element in self.gui.items()
            if element["props"].get("label") == label
            and (folder is None or self._folder(element).get("label") == folder)
        ]  # fmt: skip

    def element(self, label: str, folder: str | None = None) -> dict[str, Any]:
        """The one element with a label."""
        found = self.labelled(label, folder)
        if len(found) != 1:
            known = sorted({str(each["props"].get("label")) for each in self.gui.values()})
            raise KeyError(f"{len(found)} elements are called {label!r}; the page has {known}")
        return self.gui[found[0]]

    def value(self, label: str, folder: str | None = None) -> Any:
        """The present value of an element."""
        return self.element(label, folder)["value"]

    def labels(self, folder: str) -> list[str]:
        """Labels of the elements of a folder in their order."""
        inside = [each for each in self.gui.values() if self._folder(each).get("label") == folder]
        return [each["props"].get("label") for each in sorted(inside, key=lambda each: each["props"]["order"])]

    def texts(self) -> list[str]:
        """Contents of all texts."""
        return [
            str(each["props"][name]) for each in self.gui.values() for name in ("_markdown", "content")
            if name in each["props"]
        ]  # fmt: skip

    def set(self, label: str, value: Any, folder: str | None = None) -> None:
        """Moves a slider, ticks a box, chooses from a list, types a number."""
        element = self.element(label, folder)
        element["value"] = value
        self.send({"type": "GuiUpdateMessage", "uuid": element["uuid"], "updates": {"value": value}})

    def click(self, label: str, option: str | None = None, folder: str | None = None) -> None:
        """Presses a button, or one of a group."""
        self.set(label, True if option is None else option, folder)

    def trigger(self, label: str) -> None:
        """Runs a command of the palette, as its key does."""
        keys = [key for key, name in self.commands.items() if name == label]
        if len(keys) != 1:
            raise KeyError(f"{len(keys)} commands are called {label!r}; there are {sorted(self.commands.values())}")
        self.send({"type": "CommandTriggerMessage", "uuid": keys[0]})

    # scene

    def drag(
        self, node: str, instance: int | None, phase: str, *, grab: Sequence[float], pointer: Sequence[float],
        button: str = "left", modifier: str | None = "shift",
    ) -> None:  # fmt: skip
        """One message of a drag: phase "start", "update" or "end"; places in the coordinates of the page [m]."""
        self.send({
            "type": "SceneNodeDragMessage", "phase": phase, "name": node, "instance_index": instance,
            "start_position": [float(value) for value in grab], "start_screen_pos": (0.5, 0.5),
            "end_position": [float(value) for value in pointer], "end_screen_pos": (0.5, 0.5), "button": button,
            "modifier": modifier, "owner": "",
        })  # fmt: skip

    def batches(self, below: str = "/world/") -> dict[str, int]:
        """Names of the batched meshes and how many instances each has."""
        return {
            name: len(node["props"]["batched_positions"]) // 3 for name, node in list(self.nodes.items())
            if name.startswith(below) and "batched_positions" in node["props"]
        }  # fmt: skip

    def positions(self, node: str) -> np.ndarray:
        """(N, 3) of a node's instances [m]."""
        return self.nodes[node]["props"]["batched_positions"].reshape(-1, 3)

    def rotations(self, node: str) -> np.ndarray:
        """(N, 4) of a node's instances, wxyz."""
        return self.nodes[node]["props"]["batched_wxyzs"].reshape(-1, 4)

    def _folder(self, element: dict[str, Any]) -> dict[str, Any]:
        return self.gui.get(element.get("container_uuid", ""), {}).get("props", {})

    def _read(self) -> None:
        try:
            for data in self._socket:
                messages = decoded(data)
                with self._news:
                    self.octets += len(data)
                    for message in messages:
                        self._take(message)
                    self._news.notify_all()
        except (OSError, websockets.exceptions.WebSocketException):
            return

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if kind == "GuiUpdateMessage":
            element = self.gui.get(message["uuid"])
            if element is not None:
                for name, value in message["updates"].items():
                    (element if name == "value" and name in element else element["props"])[name] = value
        elif kind == "SceneNodeUpdateMessage":
            self.nodes.setdefault(message["name"], {"props": {}})["props"].update(message["updates"])
        elif kind == "GuiRemoveMessage":
            self.gui.pop(message["uuid"], None)
        elif kind == "RemoveSceneNodeMessage":
            whole = message["name"]
            self.nodes = {
                name: node for name, node in self.nodes.items() if name != whole and not name.startswith(whole + "/")
            }
        elif kind == "RegisterCommandMessage":
            self.commands[message["uuid"]] = message["props"]["label"]
        elif kind == "RunJavascriptMessage":
            self.scripts.append(message["source"])
        elif kind == "NotificationShowMessage":
            self.notices.append(str(message["props"].get("body")))
        elif kind in ("SetPositionMessage", "SetOrientationMessage", "SetSceneNodeVisibilityMessage"):
            self.nodes.setdefault(message["name"], {"props": {}}).update(
                {name: message[name] for name in ("position", "wxyz", "visible") if name in message}
            )
        elif "uuid" in message and "props" in message:
            self.gui[message["uuid"]] = message
        elif "name" in message and "props" in message:
            self.nodes[message["name"]] = message


@contextlib.contextmanager
def connect(url: str, *, origin: str | None = None) -> Iterator[ViserClient]:
    """Opens the page at an address of the viewer, as a browser does, and leaves it at the end."""
    address = url.replace("http://", "ws://", 1)
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    named: Any = origin
    with websockets.sync.client.connect(
        address, subprotocols=[protocol], max_size=None, compression=None, origin=named, proxy=None
    ) as socket:
        client = ViserClient(socket)
        try:
            yield client
        finally:
            client.close()
