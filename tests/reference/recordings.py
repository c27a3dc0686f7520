"""Reads recordings of the web viewer back: what a browser plays, without one."""

import base64
import re
from pathlib import Path
from typing import Any

import msgspec.msgpack
import numpy as np
import zstandard

from tests.reference.viser_client import with_arrays


def stream(path: Path) -> bytes:
    """The serialised scene in an .html or .viser file."""
    if path.suffix == ".viser":
        return path.read_bytes()
    found = re.search(r'__VISER_EMBED_DATA__="([A-Za-z0-9+/=]*)"', path.read_text(encoding="utf-8"))
    assert found is not None
    return base64.b64decode(found[1])


def messages(path: Path) -> tuple[float, list[tuple[float, dict[str, Any]]]]:
    """Duration [s], and (time, message) with arrays in place."""
    data = stream(path)
    inner = zstandard.ZstdDecompressor().decompress(data[8:], int.from_bytes(data[:8], "little"))
    length = int.from_bytes(inner[:8], "little")
    content = msgspec.msgpack.decode(inner[8 : 8 + length])
    times = [(time, with_arrays(message, content, inner, 8 + length)) for time, message in content["messages"]]
    return content["durationSeconds"], times


def poses(path: Path) -> tuple[list[float], dict[str, list[Any]]]:
    """Times of frames [s], and the positions (N, 3) of every moving batch at each."""
    found: dict[str, list[Any]] = {}
    times: list[float] = []
    for time, message in messages(path)[1]:
        props = message.get("props") or message.get("updates") or {}
        name = message.get("name", "")
        if "/moving/" in name and "batched_positions" in props:
            if not times or time > times[-1]:
                times.append(time)
            found.setdefault(name, []).append(np.reshape(props["batched_positions"], (-1, 3)))
    return times, found
