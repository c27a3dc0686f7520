"""Files of JSON: vehicles, parts of vehicles, sensors and Chrono's own; good ones, spoiled at random places."""

import copy
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from hypothesis import strategies as st

from tests.campaign.hostile import (
    ACCEPT,
    EITHER,
    REFUSE,
    Value,
    Verdict,
    deep_json,
    either,
    odd_texts,
    refused,
    shorten,
)
from tests.campaign.oracle import CallAttack

DEEP = "@nested@"
"""Stands for a value that no encoder of JSON can write."""

Path_ = tuple[str | int, ...]


class Document(NamedTuple):
    """A good file.

    Attributes:
        kind: what it is.
        path: where a spoiled copy may stand: beside the files that it names.
        content: its value.
        read: reads a file of its kind.
        is_ours: whether every value in it is read; others' files have some that nobody looks at.
    """

    kind: str
    path: Path
    content: Any
    read: Callable[[Path], Any]
    is_ours: bool = True


# ---- spoiling --------------------------------------------------------------------------------------------------------

NUMBERS = st.one_of(
    st.sampled_from(
        refused(float("nan"), float("inf"), float("-inf"), 1e39, 1e308, 10**40, "x", "1", [], {}, [1.0], DEEP)
    ),
    st.integers(40, 400).map(lambda digits: Value(int("3" * digits), REFUSE)),
    st.floats(3.41e38, 1.7e308).map(lambda number: Value(number, REFUSE)),
    odd_texts.map(lambda text: Value(text, REFUSE)),
    st.sampled_from(either(0, -1, 1e-320, 1e30, None, True, 0.5, 2**63 - 1)),
)
TEXTS = st.one_of(
    st.sampled_from(refused(3, 1.5, float("nan"), [], {}, True, DEEP)),
    st.sampled_from(either(None, "", "x", "../", "/", "a" * 5000)),
    odd_texts.map(lambda text: Value(text, EITHER)),
)
FLAGS = st.sampled_from([*refused("x", "true", [], {}, 2, 1.5, DEEP), *either(None)])
LISTS = st.sampled_from([*refused("x", 3, True, {"zz": 1}, DEEP), *either([], None)])
OBJECTS = st.sampled_from([*refused("x", 3, True, [1], DEEP), *either({}, None)])


def places(value: Any, path: Path_ = ()) -> Iterator[Path_]:
    """Where everything in a JSON value stands; the top alone is none."""
    if path:
        yield path
    members = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in members:
        yield from places(item, (*path, key))


def at(value: Any, path: Path_) -> Any:
    for key in path:
        value = value[key]
    return value


def hostile_like(old: Any) -> st.SearchStrategy[Value]:
    """What may stand in the place of a value: of another type, or out of its range."""
    if isinstance(old, bool):
        return FLAGS
    if isinstance(old, (int, float)):
        return NUMBERS
    if isinstance(old, str):
        return TEXTS
    return LISTS if isinstance(old, list) else OBJECTS


class Spoiled(NamedTuple):
    """A text, what was done to it, whether it must be refused, and also where nobody looks at the value."""

    data: bytes
    how: str
    verdict: Verdict
    anywhere: bool = True


def encode(value: Any) -> bytes:
    text = json.dumps(value, ensure_ascii=True).replace(f'"{DEEP}"', deep_json())
    return text.encode()


@st.composite
def spoiled_values(draw: st.DrawFn, content: Any) -> Spoiled:
    """One value replaced, left out, or added."""
    value = copy.deepcopy(content)
    path = draw(st.sampled_from(list(places(content))))
    owner, key = at(value, path[:-1]), path[-1]
    how = draw(st.sampled_from(("replace", "replace", "replace", "drop", "add", "twice")))
    words = ".".join(map(str, path))
    if how == "drop":
        del owner[key]
        return Spoiled(encode(value), f"{words} left out", EITHER)
    if how == "add" and isinstance(owner, dict):
        owner["zz_no_such_key"] = 1
        known = "tir" not in path  # a property file may hold anything
        return Spoiled(encode(value), f"a key beside {words}", REFUSE if known else EITHER, anywhere=False)
    if how == "twice" and isinstance(owner, dict):
        owner["@twice@"] = owner[key]
        data = encode(value).replace(b'"@twice@"', json.dumps(key).encode())
        return Spoiled(data, f"{words} twice", REFUSE)
    new, verdict = draw(hostile_like(owner[key]))
    owner[key] = new
    beyond = new == DEEP or (isinstance(new, (int, float)) and abs(new) > 3.41e38)
    if "tir" in path and not beyond:
        verdict = EITHER
    return Spoiled(encode(value), f"{words} = {shorten(new)}", verdict, beyond)


@st.composite
def spoiled_texts(draw: st.DrawFn, content: Any) -> Spoiled:
    """The text itself cut, garbled, or nested without end."""
    data = encode(content)
    how = draw(st.sampled_from(("cut", "byte", "nul", "more", "other", "mark")))
    place = draw(st.integers(1, len(data) - 1))
    if how == "cut":
        return Spoiled(data[:place], f"cut after byte {place}", REFUSE)
    if how == "byte":
        return Spoiled(data[:place] + b"\xff" + data[place:], f"no UTF-8 at byte {place}", REFUSE)
    if how == "nul":
        return Spoiled(data[:place] + b"\0" + data[place:], f"NUL at byte {place}", REFUSE)
    if how == "more":
        return Spoiled(data + b"x", "something after the end", REFUSE)
    if how == "mark":
        return Spoiled(b"\xef\xbb\xbf" + data, "with a byte order mark", EITHER)
    other = draw(
        st.sampled_from(
            [
                b"",
                b" ",
                b"null",
                b"3",
                b"[]",
                b'"x"',
                b"NaN",
                b"{",
                b"\xff\xfe",
                b"PK\x03\x04",
                deep_json().encode(),
                deep_json('{"a":', "}").encode(),
            ]
        )
    )
    return Spoiled(other, f"only {shorten(other, 60)}", REFUSE)


def spoiled(content: Any) -> st.SearchStrategy[Spoiled]:
    """A file gone wrong, in its values four times as often as in its text."""
    values = spoiled_values(content)
    return st.one_of(values, values, values, values, spoiled_texts(content))


# ---- the documents ---------------------------------------------------------------------------------------------------


def vehicle_documents(data: Path) -> list[Document]:
    """Shipped vehicles and their parts, in a copy of the data folder."""
    from simwarp.vehicle.spec.variants import with_options
    from simwarp.vehicle.spec.vehicle_files import load_vehicle

    def reader(kind: str, vehicle: str) -> Callable[[Path], Any]:
        return lambda path: assembled(with_options(load_vehicle(vehicle), **{kind: str(path)}))

    found = [
        _document("vehicle", path, lambda path: assembled(load_vehicle(path))) for path in sorted(data.glob("*.json"))
    ]
    for kind in ("tire", "powertrain", "driveline"):
        for path in sorted(data.rglob(f"{kind}s/**/*.json")):
            vehicle = path.relative_to(data).parts[0]
            found.append(_document(kind, path, reader(kind, vehicle)))
    return found


def assembled(spec: Any) -> Any:
    """The vehicle in a builder: what a file that was read is for."""
    from simwarp import ModelBuilder
    from simwarp.vehicle.construction import add_vehicle

    return add_vehicle(ModelBuilder(), spec)


def sensor_documents(data: Path) -> list[Document]:
    """Shipped sensors."""
    from simwarp.sensors.presets import load_config

    return [_document("sensor", path, load_config) for path in sorted(data.glob("*.json"))]


def chrono_documents(folder: Path, values: Path) -> list[Document]:
    """Chrono's sensors and vehicles, as tests/unit/importers keeps them."""
    from simwarp.importers.chrono_sensors import load_chrono_sensor

    found = []
    for name, content in json.loads(values.read_text(encoding="utf-8")).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(encode(content))
        found.append(Document("chrono sensor", path, content, load_chrono_sensor, is_ours=False))
    return found


def _document(kind: str, path: Path, read: Callable[[Path], Any]) -> Document:
    return Document(kind, path, json.loads(path.read_text(encoding="utf-8")), read)


def json_files(documents: list[Document]) -> st.SearchStrategy[CallAttack]:
    """Good files gone wrong, and now and then a good one."""
    kinds = sorted({document.kind for document in documents})
    by_kind = {kind: [document for document in documents if document.kind == kind] for kind in kinds}
    chosen = st.sampled_from(kinds).flatmap(lambda kind: st.sampled_from(by_kind[kind]))
    return chosen.flatmap(_attacks)


def _attacks(document: Document) -> st.SearchStrategy[CallAttack]:
    good = st.just(Spoiled(encode(document.content), "as it is", ACCEPT))
    return (
        st.integers(0, 19)
        .flatmap(lambda number: good if number == 0 else spoiled(document.content))
        .map(lambda made: _attack(document, made))
    )


def _attack(document: Document, made: Spoiled) -> CallAttack:
    path = document.path.with_name(f"attacked-{document.path.name}")

    def call() -> None:
        path.write_bytes(made.data)
        try:
            document.read(path)
        finally:
            path.unlink()

    what = f"{document.kind} {document.path.name}: {made.how}"
    verdict = made.verdict if document.is_ours or made.anywhere or made.verdict is ACCEPT else EITHER
    # what is wrong with a part may be told of the part
    keys = [key for key in made.how.partition(" ")[0].split(".") if not key.isdigit()]
    return CallAttack(what, verdict, (path.name, document.path.stem, *keys[-2:]), call)
