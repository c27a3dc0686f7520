"""The fronts of the campaign: what is attacked, how, and with which share of the examples."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from simwarp.cli import main
from tests.campaign import strategies_builder, strategies_commands, strategies_files, strategies_json, strategies_state
from tests.campaign.oracle import Attack, CallAttack, CommandAttack, Outcome, attack_call, attack_command
from tests.campaign.sandbox import Sandbox

CHRONO_SENSORS = Path(__file__).parents[1] / "unit" / "importers" / "chrono_sensor_files.json"


class Place(NamedTuple):
    """Where attacks happen.

    Attributes:
        material: good files, as `make_material` makes them.
        sandbox: bystanders.
        folder: for files of calls.
    """

    material: Path
    sandbox: Sandbox
    folder: Path


class Front(NamedTuple):
    """One front.

    Attributes:
        attacks: makes its strategy.
        quick, full: examples of `make test` and of `make test-slow`.
    """

    attacks: Callable[[Place], st.SearchStrategy[Any]]
    quick: int
    full: int


def perform(place: Place) -> Callable[[Attack], Outcome]:
    """What tries an attack of any kind."""

    def each(attack: Attack) -> Outcome:
        if isinstance(attack, CommandAttack):
            return attack_command(attack, place.sandbox, main)
        assert isinstance(attack, CallAttack)
        with place.sandbox.inside():
            outcome = attack_call(attack)
        if not place.sandbox.changes():
            return outcome
        found = ", ".join(f"{path.name} is {what}" for path, what in place.sandbox.changes().items())
        place.sandbox.restore()
        return outcome if outcome.failure else Outcome(outcome.result, "bystander", found)

    return each


def _commands(place: Place) -> st.SearchStrategy[Any]:
    return strategies_commands.command_lines()


def _json(place: Place) -> st.SearchStrategy[Any]:
    from simwarp.sensors.shipped import DATA as SENSORS
    from simwarp.vehicle.spec.vehicle_files import DATA as VEHICLES

    vehicles, sensors = (place.folder / name for name in ("vehicles", "sensors"))
    for source, target in ((VEHICLES, vehicles), (SENSORS, sensors)):
        shutil.copytree(source, target, dirs_exist_ok=True)
    documents = strategies_json.vehicle_documents(vehicles) + strategies_json.sensor_documents(sensors)
    documents += strategies_json.chrono_documents(place.folder / "chrono", CHRONO_SENSORS)
    return strategies_json.json_files(documents)


def checkpoint_parts(place: Place) -> tuple[bytes, dict[str, Any], Callable[[dict[str, Any]], bytes]]:
    """A checkpoint's bytes, its content, and what makes bytes of another content."""
    from simwarp.train.runs.checkpoint import load_checkpoint, save_checkpoint

    path, again = place.material / "good" / "fast.pt", place.folder / "again.pt"

    def save(content: dict[str, Any]) -> bytes:
        save_checkpoint(again, content)
        return again.read_bytes()

    return path.read_bytes(), load_checkpoint(path), save


def _checkpoints(place: Place) -> st.SearchStrategy[Any]:
    from simwarp.train.runs.checkpoint import load_checkpoint

    data, content, save = checkpoint_parts(place)
    flipped = strategies_files.byte_attacks(
        ".pt", data, load_checkpoint, strategies_files.equal, place.folder, sealed=True
    )
    return st.one_of(flipped, strategies_files.checkpoint_commands(content, save))


def _arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def _recordings(place: Place) -> st.SearchStrategy[Any]:
    from simwarp.train.datasets.dataset_formats import load_trajectories

    good = place.material / "good"

    def read(path: Path) -> dict[str, Any]:
        return vars(load_trajectories(path, "fast"))

    flipped = strategies_files.byte_attacks(
        ".npz", (good / "fast.npz").read_bytes(), read, strategies_files.equal, place.folder
    )
    spoiled = strategies_files.trajectory_commands(_arrays(good / "fast.npz"))
    return st.one_of(flipped, spoiled, spoiled, strategies_files.dump_commands(_arrays(good / "broken.npz")))


def _snapshots(place: Place) -> st.SearchStrategy[Any]:
    import simwarp as sw
    from simwarp import Snapshot

    made = strategies_builder.builder()
    made.add_joint_revolute("hinge", sw.WORLD, 0, axis=(0.0, 1.0, 0.0))
    simulation = sw.Simulation(made.finalize(2, "cpu"), 0.01)
    path = place.folder / "good.snapshot.npz"
    simulation.snapshot().save(path)

    def read(path: Path) -> dict[str, Any]:
        return {name: array.numpy() for name, array in Snapshot.load(path, simulation).arrays().items()}

    return strategies_files.byte_attacks(".npz", path.read_bytes(), read, strategies_files.equal, place.folder)


FRONTS = {
    "command lines": Front(_commands, 60, 2600),
    "JSON files": Front(_json, 150, 2400),
    "builder calls": Front(lambda place: strategies_builder.builder_calls(), 150, 2200),
    "running simulations": Front(lambda place: strategies_state.state_calls(), 30, 1000),
    "checkpoints": Front(_checkpoints, 40, 600),
    "recordings": Front(_recordings, 40, 500),
    "snapshots": Front(_snapshots, 20, 300),
    "run folders": Front(lambda place: strategies_files.run_commands(place.material / "good" / "run"), 15, 400),
}
assert sum(front.full for front in FRONTS.values()) == 10_000

__all__ = ["FRONTS", "Front", "Place", "checkpoint_parts", "perform"]
