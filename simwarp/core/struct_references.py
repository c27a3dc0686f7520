"""Device functions of a CPU get their tables by reference.

Warp hands a struct over by value. A step calls hundreds of functions with the tables of a model, 2 to 4 kB each, so
that a compiler either copies them at every call or inlines everything and then takes the copies apart, one variable
for each attribute and call: seven eighths of its time (docs/decisions.md). With references there is nothing to copy.
Functions must then leave the attributes of their structs alone, as those of this package do; a test reads them all.
"""

from __future__ import annotations

import contextlib
import re
from typing import Any, Final

from warp._src import context

BY_REFERENCE: Final = "-DSTRUCTS_BY_REFERENCE"
"""Flag of a module's compiler: its structs go by reference. A part of the module's options, it tells such kernels
apart in Warp's cache."""

_STRUCT: Final = re.compile(r"^    ([A-Z]\w*_[0-9a-f]{8}) (var_[A-Za-z]\w*[,)])", re.MULTILINE)
"""A parameter in the head of a function as Warp writes it; local variables end in a semicolon."""


def pass_structs_by_reference() -> None:
    """Has Warp write the functions of modules with the flag so, for CPUs.

    Where Warp has no such method, nothing changes, but compiling takes longer.
    """
    builder: Any = context.ModuleBuilder
    with contextlib.suppress(AttributeError):
        if not getattr(builder.codegen, "knows_references", False):
            builder.codegen = _with_references(builder.codegen)


def _with_references(write: Any) -> Any:
    """`ModuleBuilder.codegen`, and references in the text of modules with the flag."""

    def codegen(module: Any, device: str) -> str:
        text: str = write(module, device)
        if device == "cpu" and BY_REFERENCE in (module.options.get("cpu_compiler_flags") or ""):
            text = _STRUCT.sub(r"    \1& \2", text)
        return text

    codegen.knows_references = True  # type: ignore[attr-defined]
    return codegen
