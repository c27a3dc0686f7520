"""Snapshot: a copy of what a step reads and changes, which is written to files and read back bit by bit."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.files import FileError, check_input, parse_json, replacing
from simwarp.core.memory import check_layouts
from simwarp.core.object_repr import Readable, bytes_text, plural
from simwarp.core.types import ModelError, formatted
from simwarp.kernels.core.layouts import snapshot_layouts
from simwarp.model.identity import WORLDS, Identity, run_parts
from simwarp.model.model import Model
from simwarp.simulation.state import Contacts, Control, State

FORMAT: Final = "simwarp snapshot 1"
HEADER: Final = "header"
MOST_HEADER: Final = 64 * 2**20
"""Bytes of the largest header: lines about every body, joint and shape."""
OVERHEAD: Final = 4096
"""Bytes of a file beside the numbers of one array."""


@runtime_checkable
class SnapshotTarget(Protocol):
    """Interface to take and restore snapshots: a Simulation."""

    def empty_snapshot(self) -> Snapshot:
        """A snapshot of zeros that fits."""
        ...


@dataclasses.dataclass(frozen=True, repr=False)
class Snapshot(Readable):
    """A copy of everything that a step reads and changes. Opaque; pass it to `Simulation.restore`.

    Parameters of the model (masses, frictions, sizes) and options of the solver are not in it.
    """

    state: State
    control: Control
    contacts: Contacts
    memory: tuple[wp.array, ...]
    identity: Identity

    @classmethod
    def empty(
        cls, model: Model, *, elements: bool, implicit: bool = False, memory: tuple[wp.array, ...], identity: Identity,
        worlds: int | None = None,
    ) -> Snapshot:  # fmt: skip
        """A snapshot whose state, control and contacts are zeros, with a copy of `memory`.

        Args:
            model: of the Simulation.
            elements: True if the Simulation has force elements.
            implicit: True if one of them is implicit.
            memory: arrays (W, ...) or (W·slots, ...) of force elements and sensors.
            identity: properties that a Simulation must have in common to be restored from it.
            worlds: of the model; None: all.

        Raises:
            ModelError: it does not fit into the device's memory.
        """
        more = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in memory)
        layouts = snapshot_layouts(model.sizes(elements=elements, implicit=implicit, worlds=worlds))
        check_layouts("snapshot: its arrays", layouts, model.device, "free memory or take fewer worlds", more)
        kept = tuple(wp.clone(array) for array in memory)
        control = Control(model, elements=elements, implicit=implicit, worlds=worlds)
        return cls(State(model, worlds=worlds), control, Contacts(model, worlds=worlds), kept, identity)

    @classmethod
    def of_one_world(
        cls, model: Model, elements: bool, implicit: bool, memory: tuple[wp.array, ...],
        parts: Mapping[str, Sequence[str]],
    ) -> Snapshot:  # fmt: skip
        """A snapshot of zeros, as that of a Simulation of a single world.

        Args:
            model: of the Simulation.
            elements: True if it has force elements.
            implicit: True if one of them is implicit.
            memory: arrays (W, ...) or (W·slots, ...) of force elements and sensors.
            parts: of the identity, beside the model's.

        Raises:
            ModelError: it does not fit into the device's memory.
        """
        count = model.world_count
        one = [
            wp.zeros((array.shape[0] // count, *array.shape[1:]), dtype=array.dtype, device=array.device)
            for array in memory
        ]
        identity = model.identity.extended({WORLDS: ["1"], **parts})
        return cls.empty(
            model, elements=elements, implicit=implicit, memory=tuple(one), identity=identity, worlds=1
        )  # fmt: skip

    def take(self, arrays: Sequence[wp.array], world: int) -> None:
        """Copies a world of the arrays (W, ...) of a Simulation, in the order of this snapshot's, which is of one."""
        for kept, present in zip(self.arrays().values(), arrays, strict=True):
            own = kept.size < present.size  # all worlds share the others
            wp.copy(kept, present, src_offset=world * kept.size if own else 0, count=kept.size)

    @property
    def world_count(self) -> int:
        """Worlds that it holds."""
        return int(self.state.world_time.shape[0])

    def arrays(self) -> dict[str, wp.array]:
        """All arrays (W, ...) or (W·slots, ...) by the names that files have for them, such as `state.body_x`."""
        groups: dict[str, State | Control | Contacts] = {
            "state": self.state, "control": self.control, "contacts": self.contacts,
        }  # fmt: skip
        named = {f"{group}.{name}": array for group, part in groups.items() for name, array in part.in_files().items()}
        return named | {f"memory.{index}": array for index, array in enumerate(self.memory)}

    def _readable_title(self) -> str:
        arrays = self.arrays().values()
        size = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
        time = self.state.world_time
        return f": {plural(time.shape[0], 'world')} on {time.device}, {len(arrays)} arrays, {bytes_text(size)}"

    def save(self, path: str | Path) -> None:
        """Writes a file (npz: numbers only, no code) that `load` reads; the file appears whole or not at all.

        Raises:
            FileError: the path cannot be written to.
            OutputError: the disk did not take it.
        """
        target = _checked_path("save", path)
        values = {name: array.numpy() for name, array in self.arrays().items()}
        header = {
            "format": FORMAT,
            "identity": {name: list(lines) for name, lines in self.identity.parts.items()},
            "checksum": _checksum(values),
        }
        text = np.frombuffer(json.dumps(header).encode("utf-8"), np.uint8)
        with replacing(target) as draft, draft.open("wb") as file:
            np.savez(file, **{HEADER: text, **values})

    @classmethod
    def load(cls, path: str | Path, target: SnapshotTarget | Model) -> Snapshot:
        """Reads what `save` wrote.

        Args:
            path: of the file.
            target: the Simulation that will restore it; or its Model, where that has no force elements and no sensors.

        Raises:
            FileError: there is no such file, or it is no whole snapshot.
            ModelError: it is of another simulation; says what differs.
        """
        if isinstance(target, SnapshotTarget):
            snapshot = target.empty_snapshot()
        elif isinstance(target, Model):
            bare = target.identity.extended(run_parts((), (), 0.0))
            snapshot = cls.empty(target, elements=False, memory=(), identity=bare)
        else:
            raise ModelError(
                f"Snapshot.load: target must be a Simulation or a Model, got {formatted(target)}; pass one"
            )
        arrays = snapshot.arrays()
        needed = sum(array.size * wp.types.type_size_in_bytes(array.dtype) + OVERHEAD for array in arrays.values())
        file = check_input(_checked_path("load", path), "snapshot", largest=needed + MOST_HEADER)
        values = _read(file, arrays, snapshot.identity)
        for name, array in arrays.items():
            array.assign(values[name])
        return snapshot

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Snapshot cannot be pickled or copied: it refers to memory of a device; write it with "
            "snapshot.save(path) and read it with Snapshot.load(path, simulation)"
        )


def _checked_path(call: str, path: Any) -> Path:
    if not isinstance(path, (str, Path)):
        raise ModelError(f"Snapshot.{call}: path must be a string or a Path, got {formatted(path)}; name a file")
    return Path(path) if path else Path("\0")  # an empty name is refused, not taken for this folder


def _read(path: Path, arrays: Mapping[str, wp.array], identity: Identity) -> dict[str, npt.NDArray[Any]]:
    """The numbers in a file, all of them checked before the first one is used."""
    broken = f"snapshot '{path}' is broken"
    try:
        with zipfile.ZipFile(path) as archive:
            header = _header(_member(archive, HEADER, MOST_HEADER), path)
            there = Identity.of({str(name): [*map(str, lines)] for name, lines in header["identity"].items()})
            difference = identity.difference(there)
            if difference:
                raise ModelError(
                    f"snapshot '{path}' is of another simulation ({difference}); load it where it was made"
                )
            values = {}
            for name, array in arrays.items():
                like = array.numpy()
                values[name] = _member(archive, name, like.nbytes + OVERHEAD)
                if values[name].shape != like.shape or values[name].dtype != like.dtype:
                    raise FileError(f"{broken}: '{name}' is {values[name].dtype}{values[name].shape}")
            if header["checksum"] != _checksum(values):
                raise FileError(f"{broken}: its checksum does not fit; take another copy")
    except (ModelError, FileError):
        raise
    except Exception as error:  # zipfile, zlib and NumPy raise a dozen kinds for garbled bytes
        raise FileError(f"{broken}: {formatted(str(error))}; take another copy") from error
    return values


def _member(archive: zipfile.ZipFile, name: str, largest: int) -> npt.NDArray[Any]:
    """One array of the archive, of at most so many bytes."""
    info = archive.getinfo(f"{name}.npy")
    if info.file_size > largest:
        broken = f"snapshot '{archive.filename}' is broken"
        raise FileError(f"{broken}: '{name}' has {info.file_size} bytes, more than the {largest} that belong there")
    content = archive.read(info)
    array: npt.NDArray[Any] = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    return array


def _header(data: npt.NDArray[Any], path: Path) -> dict[str, Any]:
    """The header of a snapshot's file."""
    header = parse_json(data.astype(np.uint8).tobytes().decode("utf-8"), f"snapshot '{path}'")
    known = isinstance(header, dict) and header.get("format") == FORMAT
    if not known or not isinstance(header.get("identity"), dict) or "checksum" not in header:
        raise FileError(f"snapshot '{path}' is no snapshot of this version of simwarp; make it again")
    return header


def _checksum(values: Mapping[str, npt.NDArray[Any]]) -> str:
    """Of names, dtypes, shapes and bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for name, array in values.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
