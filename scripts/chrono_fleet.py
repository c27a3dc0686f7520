"""Project Chrono's vehicle files, each read and driven: `python -m scripts.chrono_fleet FOLDER` writes what came of it.

FOLDER is Chrono's data/vehicle. Each file is read with the first tire, engine and transmission of its own folder, or of
the HMMWV's. The list in docs/vehicles.md stands between `<!-- files of vehicles -->` and `<!-- end of files -->`, the
figures in docs/accuracy.md between `<!-- figures of vehicles -->` and `<!-- end of figures -->`. All of it takes six
minutes of a core, and the first time as long again for the compilation.
"""

from __future__ import annotations

import argparse
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from scripts.chrono_fleet_driving import Driven, drive
from simwarp.importers.chrono_json import Node, vehicle_template
from simwarp.importers.chrono_vehicle import load_chrono_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec

DOCS: Final = Path(__file__).resolve().parent.parent / "docs"
PAGE: Final = DOCS / "vehicles.md"
FIGURES_PAGE: Final = DOCS / "accuracy.md"
FIGURES: Final = re.compile(r"(<!-- figures of vehicles -->\n).*?(<!-- end of figures -->)", re.DOTALL)
BLOCK: Final = re.compile(r"(<!-- files of vehicles -->\n).*?(<!-- end of files -->)", re.DOTALL)
ELSEWHERE: Final = ("M113", "M113_RS", "Marder", "fmi", "cosim")
"""Folders of tracked vehicles and of parts for other programs."""
TIRES: Final = ("TMeasyTire", "Pac02Tire", "FialaTire")
ENGINES: Final = ("EngineSimpleMap", "EngineSimple", "EngineShafts")
TRANSMISSIONS: Final = ("AutomaticTransmissionSimpleMap", "AutomaticTransmissionShafts")
STRAIGHTEST: Final = 1.0e-3
"""Curvature below which a vehicle goes straight on, for the table [1/m]."""
CHOICES: Final = re.compile(r"^(.*): must be one of .*, got ('[^']*').*$")
"""An error that lists all that is known."""


def vehicle_files(root: Path) -> list[Path]:
    """Files of wheeled vehicles."""
    found = (file for file in sorted(root.rglob("*.json")) if file.relative_to(root).parts[0] not in ELSEWHERE)
    return [file for file in found if vehicle_template(file) == "WheeledVehicle"]


def nearest_part(root: Path, vehicle: Path, kind: str, templates: tuple[str, ...]) -> Path:
    """The part of a kind that Chrono's programs would choose for a vehicle: of its own folder, or of the HMMWV's."""
    for folder in (root / vehicle.relative_to(root).parts[0], root / "hmmwv"):
        found = [(templates.index(template), file) for file, template in _parts(folder, kind) if template in templates]
        if found:
            return min(found)[1]
    raise SpecError(f"{root}: it must be Chrono's data/vehicle, got a folder without a {kind} in hmmwv")


def _parts(folder: Path, kind: str) -> Iterator[tuple[Path, str]]:
    for file in sorted(folder.rglob("*.json")):
        try:
            value = Node.of_file(file).value
        except SpecError:
            continue
        if value.get("Type") == kind:
            yield file, str(value.get("Template"))


def loaded(root: Path, vehicle: Path, *, driven: bool = False) -> VehicleSpec:
    """A vehicle with the nearest tires, and with the nearest engine and transmission where it is `driven`.

    Raises:
        SpecError: it is refused.
    """
    parts = {"tire": nearest_part(root, vehicle, "Tire", TIRES)}
    if driven:
        parts["engine"] = nearest_part(root, vehicle, "Engine", ENGINES)
        parts["transmission"] = nearest_part(root, vehicle, "Transmission", TRANSMISSIONS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return load_chrono_vehicle(vehicle, root=root, **parts)


def row(root: Path, vehicle: Path) -> tuple[str, str, str]:
    """File, whether it loads, and its axles from the front or why it is refused."""
    name = f"`{vehicle.relative_to(root).as_posix()}`"
    try:
        axles = loaded(root, vehicle).axles
    except SpecError as error:
        text = CHOICES.sub(r"\1: there is none for \2", str(error)).partition(";")[0]
        return name, "no", text
    return name, "yes", ", ".join(axle.suspension.template for axle in axles)


def table(rows: Iterable[Sequence[str]], head: Sequence[str]) -> str:
    """A table of a page."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"{'|'.join(['', *(f' {cell} ' for cell in line), '']).replace(' --- ', '---')}\n" for line in lines)


def verdict(driven: Driven | None) -> str:
    """Whether a vehicle drives plausibly, or the first fault: where it does not stand, others follow."""
    if driven is None:
        return "no"
    faults = driven.faults()
    if faults:
        return f"no: {faults[0]}"
    return f"yes, but {driven.little_steering}" if driven.little_steering else "yes"


def figures(name: str, driven: Driven) -> tuple[str, ...]:
    """How a vehicle drove, for docs/accuracy.md."""
    left, right = driven.crawl.tightest
    share = [turn.curvature / turn.bicycle for turn in (driven.crawl, driven.turn)]
    return (
        name, f"{driven.loads.sum() / driven.weight - 1.0:+.0e}", f"{np.degrees(driven.tilt):.1f}",
        f"{driven.reached:.1f}", f"{radius(left)}, {radius(right)}",
        f"{share[0]:.2f}, {share[1]:.2f}".replace("nan", "–"),
        f"{driven.understeer:+.3f}, {driven.expected_understeer:+.3f}".replace("+nan", "–"),
        f"{driven.braked_from:.1f}, {driven.stopping:.1f}",
    )  # fmt: skip


def radius(curvature: float) -> str:
    """Of a turn [m]; a dash where it is straight, or goes the other way."""
    return f"{1.0 / curvature:.0f}" if curvature > STRAIGHTEST else "–"


def drive_all(root: Path) -> dict[str, Driven]:
    """Every vehicle that loads, by the name that its row has."""
    found = {}
    for vehicle in vehicle_files(root):
        name, loads, _ = row(root, vehicle)
        if loads == "yes":
            found[name] = drive(loaded(root, vehicle, driven=True))
            print(f"{name}: {verdict(found[name])}", flush=True)
    return found


HEAD: Final = ("file", "loads", "axles, or why not", "drives plausibly")
FIGURES_HEAD: Final = (
    "file", "loads' sum against the weight", "out of level [°]", "after 15 s of full throttle [m/s]",
    "full steering, left and right [m]", "curvature over the bicycle's, 3 m/s and at speed",
    "understeer, and the bicycle's", "from [m/s], stops in [m]",
)  # fmt: skip


def main() -> int:
    """Write the pages; exit code 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="Chrono's data/vehicle")
    root = parser.parse_args().folder
    driven = drive_all(root)
    rows = [row(root, vehicle) for vehicle in vehicle_files(root)]
    made = table([(*each, verdict(driven.get(each[0]))) for each in rows], HEAD)
    measured = table([figures(*item) for item in driven.items()], FIGURES_HEAD)
    for page, block, text in ((PAGE, BLOCK, made), (FIGURES_PAGE, FIGURES, measured)):
        content = page.read_text(encoding="utf-8")
        page.write_text(block.sub(lambda match, text=text: f"{match[1]}{text}{match[2]}", content), encoding="utf-8")  # type: ignore[misc]
    return 0


if __name__ == "__main__":
    sys.exit(main())
