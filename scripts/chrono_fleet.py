"""The list of Project Chrono's vehicle files in docs/vehicles.md: `python -m scripts.chrono_fleet FOLDER` writes it.

FOLDER is Chrono's data/vehicle. Each file is read with the first tire of its own folder, or of the HMMWV's. The list
stands between `<!-- files of vehicles -->` and `<!-- end of files -->`.
"""

from __future__ import annotations

import argparse
import re
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from simwarp.importers.chrono_json import Node, vehicle_template
from simwarp.importers.chrono_vehicle import load_chrono_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec

PAGE: Final = Path(__file__).resolve().parent.parent / "docs" / "vehicles.md"
BLOCK: Final = re.compile(r"(<!-- files of vehicles -->\n).*?(<!-- end of files -->)", re.DOTALL)
ELSEWHERE: Final = ("M113", "M113_RS", "Marder", "fmi", "cosim")
"""Folders of tracked vehicles and of parts for other programs."""
TIRES: Final = ("TMeasyTire", "Pac02Tire", "FialaTire")
ENGINES: Final = ("EngineSimpleMap", "EngineSimple", "EngineShafts")
TRANSMISSIONS: Final = ("AutomaticTransmissionSimpleMap", "AutomaticTransmissionShafts")
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


def row(root: Path, vehicle: Path) -> str:
    """Line of a file: axles from the front, or why it is refused."""
    name = vehicle.relative_to(root).as_posix()
    try:
        axles = loaded(root, vehicle).axles
    except SpecError as error:
        text = CHOICES.sub(r"\1: there is none for \2", str(error)).partition(";")[0]
        return f"| `{name}` | no | {text} |"
    return f"| `{name}` | yes | {', '.join(axle.suspension.template for axle in axles)} |"


def table(root: Path) -> str:
    """The whole list."""
    head = ["| file | loads | axles, or why not |", "|---|---|---|"]
    return "\n".join([*head, *(row(root, vehicle) for vehicle in vehicle_files(root))]) + "\n"


def main() -> int:
    """Write the page; exit code 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="Chrono's data/vehicle")
    made = table(parser.parse_args().folder)
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda match: f"{match[1]}{made}{match[2]}", page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
