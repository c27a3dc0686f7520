"""Packs recorded runs of vehicles into the package: ``python -m scripts.pack_vehicle_runs FOLDER``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import numpy as np

from simwarp.verify.vehicle_cases import COLUMNS, LOADS, SHIPPED, read_folder

HEADER: Final = "recorded runs of Project Chrono 10, commit 7689fbc; columns are integers times their scale"
STEPS: Final = {"t_s": 1e-3, "speed_mps": 1e-4, "yawrate_radps": 1e-5, "engine_radps": 0.02, "gear": 1.0}
"""Resolution of the columns; that of loads is the largest load / 30 000, at most 1 N."""


def pack_runs(folder: Path, target: Path = SHIPPED) -> None:
    """Packs the runs of a folder."""
    packed: dict[str, np.ndarray] = {"header.scale": np.array(HEADER)}
    for case, run in read_folder(folder).items():
        load_step = min(1.0, max(np.abs(run[name]).max() for name in LOADS) / 3e4)
        scale = np.array([STEPS.get(name, load_step) for name in COLUMNS])
        counts = np.rint(np.array([run[name] for name in COLUMNS]) / scale[:, None]).astype(np.int32)
        packed[case.name] = np.diff(counts, axis=1, prepend=0)
        packed[f"{case.name}.scale"] = scale
    np.savez_compressed(target, **packed)  # type: ignore[arg-type]  # the stubs take allow_pickle for one of them


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of full CSV files")
    pack_runs(parser.parse_args().folder)
