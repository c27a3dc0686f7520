"""Stand-ins for Warp's functions of graphs."""

from __future__ import annotations

import functools
from typing import Any

from tests.emulated_cuda.device import Device
from tests.emulated_cuda.streams import LEGACY, Capture, CaptureMode
from tests.emulated_cuda.warp_calls.warp_arguments import number


class WarpGraphs:
    """Functions of graphs, named as in Warp's library without `wp_`."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.streams, self.faults = device.streams, device.faults
        self._graphs: dict[int, Capture] = {}
        self._external: set[int] = set()

    def cuda_graph_begin_capture(self, context: Any, stream: Any, external: Any, mode: int) -> bool:
        """Begin a capture, or join one that another library began."""
        handle = number(stream)
        if handle == LEGACY:
            self.faults.fail(900, "cudaStreamBeginCapture", "the legacy stream cannot be captured")
            return False
        if external:
            if self.streams.capture_of(handle) is None:
                self.faults.last_error = b"Warp error: stream is not capturing"
                return False
            self._external.add(handle)
            return True
        self.streams.begin_capture(handle, CaptureMode(mode))
        self.faults.counts["captures"] += 1
        return True

    def cuda_graph_end_capture(self, context: Any, stream: Any, graph: Any) -> bool:
        """End a capture; its graph goes to `graph`."""
        handle, where = number(stream), "wp_cuda_graph_end_capture"
        capture = self.streams.capture_of(handle)
        if capture is None:
            self.faults.last_error = b"Warp error: stream has no capture started"
            return False
        if handle in self._external:
            self._external.discard(handle)
            if not capture.valid:
                self.faults.fail(901, where)
                return False
        elif not self.streams.end_capture(capture, where):
            return False
        self._graphs[capture.handle] = capture
        graph._obj.value = capture.handle
        return True

    def cuda_graph_create_exec(self, context: Any, stream: Any, graph: Any, result: Any) -> bool:
        """A graph that can be launched, which is the same one."""
        if self.streams.is_forbidden("wp_cuda_graph_create_exec"):
            return False
        result._obj.value = number(graph)
        return True

    def cuda_graph_launch(self, graph: Any, stream: Any) -> bool:
        """Replay a graph."""
        self.faults.counts["graph launches"] += 1
        return self.streams.launch(self._graphs[number(graph)], number(stream), "wp_cuda_graph_launch")

    def cuda_graph_exec_destroy(self, context: Any, graph: Any) -> bool:
        """Nothing is to be given back."""
        return True

    def cuda_graph_destroy(self, context: Any, graph: Any) -> bool:
        """Give a graph back, with its memory."""
        capture = self._graphs.pop(number(graph), None)
        for address in capture.blocks if capture else ():
            self.streams.release_later(functools.partial(self.device.release, address))
        return True
