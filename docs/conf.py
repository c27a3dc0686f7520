"""Configuration of the site: pages in Markdown, the API reference from docstrings, nothing from the network."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, get_origin, get_type_hints, is_typeddict

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.errors import PycodeError
from sphinx.pycode import ModuleAnalyzer
from sphinx.util import logging, typing as hints

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

PACKAGES = (
    "actuators", "exporters", "flex", "importers", "scenery", "scenes", "sensors", "soil", "tasks", "tasks.driving",
    "train", "vehicle", "viewer",
)  # fmt: skip

project = "simwarp"
author = "simwarp contributors"
project_copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
root_doc = "index"

html_theme = "furo"
html_title = "simwarp"
html_show_sphinx = False
html_theme_options = {"source_repository": "", "navigation_with_keys": True}

myst_enable_extensions = ["deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4

# Docstrings quote code with one backtick, as Markdown does.
default_role = "code"
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
nitpicky = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100


def public_names() -> dict[int, str]:
    """Identity of every public class and function -> the name that users import it by."""
    found: dict[int, str] = {}
    for package in ("simwarp", *(f"simwarp.{name}" for name in PACKAGES)):
        module = importlib.import_module(package)
        for name in module.__all__:
            value = getattr(module, name)
            # Packages that import on demand have the name as an attribute from here on: autodoc looks there.
            setattr(module, name, value)
            if inspect.isclass(value) or inspect.isfunction(value):
                found.setdefault(id(value), f"{package}.{name}")
    return found


def simwarp_modules() -> list[ModuleType]:
    """Modules of simwarp that were imported."""
    return [module for name, module in sys.modules.items() if name.startswith("simwarp.")]


LOGGER = logging.getLogger(__name__)
PUBLIC = public_names()
CONSTRAINTS = {
    value: f"simwarp.tasks.{name}"
    for name, value in vars(sys.modules["simwarp.tasks"]).items()
    if get_origin(value) is Annotated
}
"""Public types with bounds -> their names."""
OPTIONS = {
    name: value for module in simwarp_modules() for name, value in vars(module).items() if is_typeddict(value)
}  # fmt: skip
"""Keyword arguments that several functions share, by the name of their type."""
stringify_everything = hints.stringify_annotation


def stringify_annotation(annotation: Any, /, mode: Any = "fully-qualified-except-typing", **options: Any) -> str:
    """Text of a type hint: bounds by the name of their public type, and left out where they have none."""
    if get_origin(annotation) is not Annotated:
        return stringify_everything(annotation, mode, **options)
    try:
        name = CONSTRAINTS.get(annotation)
    except TypeError:  # metadata without a hash
        name = None
    if name is None:
        return stringify_annotation(annotation.__origin__, mode, **options)
    return f"~{name}" if mode == "smart" else name


def evaluate_inherited_hints() -> None:
    """Evaluate the hints of dataclasses' arguments, each in the module of its class; Sphinx takes the subclass's."""
    for name in PUBLIC.values():
        value = resolve(name)
        if dataclasses.is_dataclass(value):
            arguments = value.__init__.__annotations__
            try:
                known = get_type_hints(value, include_extras=True)
            except NameError:  # of what is imported for type checkers alone: such hints stay as they are written
                continue
            arguments.update({key: known[key] for key in arguments if key in known})


def print_names_of_bounds() -> None:
    """Let all of Sphinx use the function above, which its own calls itself for parts of a hint."""
    for module in [value for name, value in sys.modules.items() if name.startswith("sphinx.")]:
        if getattr(module, "stringify_annotation", None) is stringify_everything:
            vars(module)["stringify_annotation"] = stringify_annotation


def documented_data(name: str, value: Any) -> list[str]:
    """Lines of the text below a constant, from the module that defines it; a package only imports it."""
    for module in simwarp_modules():
        if vars(module).get(name) is value:
            try:
                documented = ModuleAnalyzer.for_module(module.__name__).find_attr_docs()
            except PycodeError:
                continue
            if ("", name) in documented:
                return documented["", name]
    return []


def fill_constant(_app: Sphinx, what: str, name: str, value: Any, _options: Any, lines: list[str]) -> None:
    """Give a constant of a package the text that stands where it is defined."""
    if what == "data":
        lines[:] = documented_data(name.rpartition(".")[2], value)
        if not lines:
            LOGGER.warning("%s has no text below its definition", name)


def keep_sentence(_app: Sphinx, what: str, _name: str, _value: Any, _options: Any, lines: list[str]) -> None:
    """Begin the text of a property with an empty comment: napoleon takes what stands before a colon for its type."""
    if what in {"attribute", "data", "property"} and lines and ":" in lines[0]:
        lines[:0] = ["..", ""]


def split_names(_app: Sphinx, _what: str, _name: str, _value: Any, _options: Any, lines: list[str]) -> None:
    """Give each of `low, high: bounds` its own entry; Sphinx would take all but the last name for a type."""
    found: list[str] = []
    for entry in entries(lines):
        several = re.match(r"(\s*):(ivar|param) (\w+(?:, \w+)+):", entry[0])
        if several is None:
            found += entry
            continue
        indent, kind, names = several.groups()
        for name in names.split(", "):
            found += [f"{indent}:{kind} {name}:{entry[0][several.end() :]}", *entry[1:]]
    lines[:] = found


def list_options(_app: Sphinx, what: str, _name: str, value: Any, _options: Any, lines: list[str]) -> None:
    """Say which keys `**options: Unpack[...]` has, below the text of a function."""
    for argument, hint in getattr(value, "__annotations__", {}).items() if what in {"function", "method"} else ():
        shared = re.fullmatch(r"Unpack\[(\w+)\]", str(hint))
        kind = OPTIONS[shared[1]] if shared is not None else None
        while kind is not None:
            bases = [base for base in getattr(kind, "__orig_bases__", ()) if is_typeddict(base)]
            keys = [key for key in kind.__annotations__ if not any(key in base.__annotations__ for base in bases)]
            meaning = re.sub(r"`(\w+)`", link_by_name, " ".join((kind.__doc__ or "").split()))
            lines += ["", f"``{argument}``: {', '.join(f'``{key}``' for key in keys)}. {meaning}"]
            kind = bases[0] if bases else None


def link_by_name(found: re.Match[str]) -> str:
    """A link in place of a public name in backticks; the same text where it is not public."""
    public = {name.rpartition(".")[2]: name for name in PUBLIC.values()}
    return f":obj:`~{public[found[1]]}`" if found[1] in public else found[0]


def write_factories(
    _app: Sphinx, _what: str, _name: str, _value: Any, _options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Write a default that a dataclass makes anew as `...`: Sphinx cannot read `<factory>` among the arguments."""
    return (signature.replace("<factory>", "...") if signature else signature), returned


def entries(lines: list[str]) -> list[list[str]]:
    """Lines in groups: one that begins a field, with those that go on with it."""
    groups: list[list[str]] = []
    for line in lines:
        if not groups or re.match(r"\s*:\w+", line) or not line.startswith(" "):
            groups.append([])
        groups[-1].append(line)
    return groups


def resolve(target: str) -> Any:
    """What a dotted name stands for; None where there is no such thing."""
    module, _, rest = target.rpartition(".")
    tail = [rest]
    while module:
        if module in sys.modules:
            value: Any = sys.modules[module]
            for part in tail:
                value = getattr(value, part, None)
            return value
        module, _, rest = module.rpartition(".")
        tail.insert(0, rest)
    return None


def link_to_public(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.Node | None:
    """Link a type to its public name; what has none, or is another library's, stays text.

    A name of simwarp that does not exist is left to the caller, who warns.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    value = resolve(target)
    public = PUBLIC.get(id(value)) if value is not None else None
    if public is None:
        written_in_text = node.get("refexplicit") or node.get("reftype") in {"func", "meth", "attr", "mod"}
        return None if written_in_text else content
    domain = env.domains.python_domain
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", public, node, content)


def setup(app: Sphinx) -> None:
    """Connect the functions above."""
    evaluate_inherited_hints()
    print_names_of_bounds()
    app.connect("autodoc-process-docstring", fill_constant, priority=300)
    app.connect("autodoc-process-docstring", keep_sentence, priority=400)  # napoleon comes at 500
    app.connect("autodoc-process-docstring", split_names, priority=600)
    app.connect("autodoc-process-docstring", list_options, priority=700)
    app.connect("autodoc-process-signature", write_factories)
    app.connect("missing-reference", link_to_public)
