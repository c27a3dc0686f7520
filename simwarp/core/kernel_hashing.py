"""Less work when kernels are declared: what Warp finds out about a device function of this package, it finds out once.

Warp names a compiled kernel by a hash over its text and that of all functions below it, and makes this hash twice for
each kernel, from the ground up: the functions of a step are read hundreds of times. And it looks up every call in
every function to know which modules to compile anew when a Python module is reloaded, which ours never are. Both
together were a third of the processor time of a command's start.

Hashes stay the same, bit by bit. Whatever may change between two kernels is hashed as ever: functions of others,
closures, functions whose module is still being imported, values that are found while code is made.
"""

from __future__ import annotations

import contextlib
import sys
import weakref
from typing import Any, Final

from warp._src import context

PACKAGE: Final = "simwarp."
_hashes: weakref.WeakKeyDictionary[Any, bytes] = weakref.WeakKeyDictionary()


def hash_functions_once() -> None:
    """Has Warp keep the hashes of this package's functions, and not look for what reloading would need.

    Where Warp has no such methods, nothing changes.
    """
    hasher: Any = context.ModuleHasher
    module: Any = context.Module
    with contextlib.suppress(AttributeError):
        if not getattr(hasher.hash_function, "keeps_hashes", False):
            hasher.hash_function = _keeping(hasher.hash_function)
            module._find_references = _of_others(module._find_references)


def _keeping(hash_anew: Any) -> Any:
    """`ModuleHasher.hash_function`, and the hashes that hold for the whole process."""

    def hash_function(hasher: Any, function: Any) -> bytes:
        found = _hashes.get(function)
        if found is not None:
            return found
        # Whatever calls a function that may change may change as well
        callers_stay = getattr(hasher, "stays", True)
        hasher.stays = function not in hasher.function_hashes
        digest: bytes = hash_anew(hasher, function)
        if hasher.stays and _stays(function):
            _hashes[function] = digest
        else:
            callers_stay = False
        hasher.stays = callers_stay
        return digest

    hash_function.keeps_hashes = True  # type: ignore[attr-defined]
    return hash_function


def _stays(function: Any) -> bool:
    """Whether nothing about a function can change any more, beside the functions that it calls."""
    every = [*function.user_overloads.values(), *function.user_templates.values()]
    return all(
        _is_ours(each.func) and not each.func.__closure__ and not each.adj.has_unresolved_static_expressions
        and not each.adj.deferred_static_expressions and _is_imported(each.func.__module__)
        for each in every
    )  # fmt: skip


def _of_others(find: Any) -> Any:
    """`Module._find_references` of functions of other packages."""

    def find_references(module: Any, adjoint: Any) -> None:
        if not _is_ours(adjoint.func):
            find(module, adjoint)

    return find_references


def _is_ours(function: Any) -> bool:
    return str(function.__module__).startswith(PACKAGE)


def _is_imported(module: str) -> bool:
    """Whether all of a module has run: until then, a name that its functions ask for may be missing."""
    spec = getattr(sys.modules.get(module), "__spec__", None)
    return spec is not None and not getattr(spec, "_initializing", True)
