"""Draws a vehicle's FMU, driven by FMPy in a process of its own, beside the simulation: docs/images/fmu.png.

    python benchmarks/fmu_beside.py [--output docs/images/fmu.png] [--vehicle hmmwv-reduced] [--json FILE]

The same inputs twice: once they jump between communication steps of 10 ms, once steering is a sine, which the
simulation has at each of its steps of 1 ms and the FMU as it was at the begin of the communication step.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from simwarp.exporters import save_fmu
from simwarp.vehicle import Drive, load_vehicle, maneuver, set_up
from simwarp.vehicle.results.plot_style import BLUE, GREY, INK, ORANGE, dress, title_of

Array = npt.NDArray[np.float64]

ROOT: Final = Path(__file__).resolve().parents[1]
STEP: Final = 0.01
"""Of communication [s]."""
DURATION: Final = 12.0
FRICTION: Final = 0.9
SHOWN: Final = (
    ("speed_mps", "speed [m/s]"), ("yawrate_radps", "yaw rate [rad/s]"), ("Fz_FL_N", "load, front left [N]")
)  # fmt: skip
IMPORTER: Final = """
import sys
import fmpy, numpy as np
file, inputs, result, names = sys.argv[1:]
given = np.load(inputs)
found = fmpy.simulate_fmu(
    file, stop_time=float(given["time"][-1]), step_size=0.01, output_interval=0.01, input=given,
    start_values={"friction": 0.9}, output=names.split(","),
)
np.save(result, found)
"""


def inputs(sine: bool) -> dict[str, Array]:
    """Rows of inputs, two at one time where they jump: a second on the brakes, full throttle, then steering."""
    rows = [(0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.8, 0.0), (6.0, 0.0, 0.8, 0.0)]
    if sine:
        times = np.arange(6.0, DURATION + 0.5 * STEP, STEP)
        rows += [(t, 0.25 * np.sin(2.0 * np.pi * 0.5 * (t - 6.0)), 0.4, 0.0) for t in times]
    else:
        rows += [(6.0, 0.2, 0.4, 0.0), (9.0, 0.2, 0.4, 0.0), (9.0, -0.2, 0.4, 0.0), (DURATION, -0.2, 0.4, 0.0)]
    columns = np.array(rows, np.float64).T
    return dict(zip(("time", "steering", "throttle", "braking"), columns, strict=True))


def simulated(vehicle: str, given: dict[str, Array], folder: Path) -> Any:
    """The run of `simwarp drive`."""
    table = np.column_stack(list(given.values()))
    script = folder / "inputs.csv"
    np.savetxt(script, table, delimiter=",", header="t_s,steering,throttle,braking", comments="", fmt="%.17g")
    spec = load_vehicle(vehicle)
    what = maneuver(str(script), spec)
    return Drive(set_up(spec, what, device="cpu", friction=FRICTION)).run()


def imported(file: Path, given: dict[str, Array], folder: Path) -> Any:
    """Outputs of the FMU by FMPy, in a process of its own."""
    held = np.zeros(len(given["time"]), dtype=[(name, np.float64) for name in given])
    for name, values in given.items():
        held[name] = values
    np.save(folder / "inputs.npy", held)
    names = ",".join(name for name, _ in SHOWN)
    command = [
        sys.executable, "-c", IMPORTER, str(file), str(folder / "inputs.npy"), str(folder / "outputs.npy"), names
    ]  # fmt: skip
    subprocess.run(command, check=True)
    return np.load(folder / "outputs.npy")


def compare(vehicle: str, file: Path, sine: bool) -> tuple[Any, Any, dict[str, float]]:
    """Run, outputs and the largest difference of each that is shown."""
    with tempfile.TemporaryDirectory() as name:
        given, folder = inputs(sine), Path(name)
        run, outputs = simulated(vehicle, given, folder), imported(file, given, folder)
    if len(outputs) != len(run["t_s"]):
        raise RuntimeError(f"rows: {len(outputs)} of the FMU, {len(run['t_s'])} of the simulation")
    return run, outputs, {key: float(np.abs(outputs[key] - run[key]).max()) for key, _ in SHOWN}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images" / "fmu.png")
    parser.add_argument("--vehicle", default="hmmwv-reduced")
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    found = {}
    figure, panels = plt.subplots(3, 2, figsize=(12.0, 7.5), constrained_layout=True, sharex=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{arguments.vehicle}.fmu"
        save_fmu(load_vehicle(arguments.vehicle), file)
        for column, (sine, text) in enumerate(((False, "inputs that jump"), (True, "steering as a sine"))):
            run, outputs, most = compare(arguments.vehicle, file, sine)
            found[text] = most
            for axes, (key, label) in zip(panels[:, column], SHOWN, strict=True):
                dress(axes)
                axes.plot(run["t_s"], run[key], color=GREY, linewidth=3.0, label="simwarp drive")
                axes.plot(outputs["time"], outputs[key], color=BLUE, linewidth=0.9, label="FMU, by FMPy")
                title_of(axes, f"{label}; largest difference {most[key]:.2g}")
                beside = axes.twinx()
                beside.plot(outputs["time"], outputs[key] - run[key], color=ORANGE, linewidth=0.7)
                beside.tick_params(colors=ORANGE, labelsize=8)
                beside.spines[["top"]].set_visible(False)
            panels[0, column].legend(frameon=False, fontsize=8, loc="lower right", title=text, title_fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]", fontsize=9, color=INK)
    figure.suptitle(f"{arguments.vehicle}: an FMU beside the simulation; red, right axis: the difference", x=0.35)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.output, dpi=100)
    print(json.dumps(found, indent=1))
    print(arguments.output)
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps({"vehicle": arguments.vehicle, "largest": found}, indent=1) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
