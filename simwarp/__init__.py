"""simwarp: thousands of non-smooth multibody worlds at once, in NVIDIA Warp kernels, on a GPU or a CPU.

    import simwarp as sw

gives the model builder, simulations and what they take (`simwarp/api.py` lists them), and when they are first used the
packages `sw.actuators`, `sw.analysis`, `sw.flex`, `sw.motions`, `sw.vehicle`, `sw.sensors`, `sw.scenery`, `sw.scenes`,
`sw.importers`, `sw.exporters`, `sw.mcap`, `sw.identify`, `sw.viewer`, `sw.tasks`, `sw.train`, `sw.planning`.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any, Final

_ELSEWHERE: Final = {"to_torch": "simwarp.core.interop"}
"""Public names of modules that take long to import: this one imports torch."""


def __getattr__(name: str) -> Any:
    """Import a package of this one, or what `simwarp.api` offers, when it is first asked for.

    Importing Warp and all kernels takes a second or two: the command line can answer, and be interrupted, before.
    """
    if not name.startswith("_") and importlib.util.find_spec(f"{__name__}.{name}") is not None:
        return importlib.import_module(f"{__name__}.{name}")
    api = importlib.import_module(f"{__name__}.api")
    if name == "__all__":
        return [*api.__all__, *_ELSEWHERE]
    if name in _ELSEWHERE:
        value = getattr(importlib.import_module(_ELSEWHERE[name]), name)
    elif name in api.__all__:
        value = getattr(api, name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__getattr__("__all__")})
