"""simwarp: thousands of non-smooth multibody worlds at once, in NVIDIA Warp kernels, on a GPU or a CPU."""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simwarp.api import *  # noqa: F403 - the names of __all__
    from simwarp.api import __all__ as __all__


def __getattr__(name: str) -> Any:
    """Import a module of this package, or what `simwarp.api` offers, when it is first asked for.

    Importing Warp and all kernels takes a second or two: the command line can answer, and be interrupted, before.
    """
    if not name.startswith("_") and importlib.util.find_spec(f"{__name__}.{name}") is not None:
        return importlib.import_module(f"{__name__}.{name}")
    api = importlib.import_module(f"{__name__}.api")
    if name == "__all__":
        return api.__all__
    if name not in api.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(api, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__getattr__("__all__")})
