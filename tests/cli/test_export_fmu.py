"""``simwarp export-fmu``: what the FMU says of itself, its motion beside that of a drive, and what is refused."""

import json
import os
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from simwarp import cli
from simwarp.vehicle import Drive, load_vehicle, maneuver, set_up
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names, load_any_vehicle

fmpy = pytest.importorskip("fmpy")
pytest.importorskip("pythonfmu")

VEHICLE = "hmmwv-reduced"
IMPORTER = """
import json
import sys

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

file, folder, result, plan = sys.argv[1:]
plan = json.loads(plan)
description = fmpy.read_model_description(file)
numbers = {each.name: each.valueReference for each in description.modelVariables}
fmu = FMU2Slave(
    guid=description.guid, unzipDirectory=fmpy.extract(file, folder),
    modelIdentifier=description.coSimulation.modelIdentifier, instanceName="one",
)
fmu.instantiate()
fmu.setupExperiment(startTime=0.0)
fmu.enterInitializationMode()
for name, value in plan["parameters"].items():
    fmu.setReal([numbers[name]], [value])
fmu.exitInitializationMode()
outputs = plan["outputs"]
rows = [fmu.getReal([numbers[name] for name in outputs])]
for step in range(plan["steps"]):
    for first, name, value in plan["inputs"]:
        if step == first:
            fmu.setReal([numbers[name]], [value])
    fmu.doStep(currentCommunicationPoint=step * plan["step"], communicationStepSize=plan["step"])
    rows.append(fmu.getReal([numbers[name] for name in outputs]))
fmu.terminate()
fmu.freeInstance()
np.save(result, np.array(rows))
"""
SCRIPT = "t_s,steering,throttle,braking\n0,0,0,1\n0.1,0,0,1\n0.1,0,0.8,0\n0.5,0,0.8,0\n0.5,0.3,0.8,0\n1.0,0.3,0.8,0\n"
INPUTS = [[0, "braking", 1.0], [10, "braking", 0.0], [10, "throttle", 0.8], [50, "steering", 0.3]]


@pytest.fixture
def export(capfd, tmp_path, monkeypatch):
    """Run the command in a folder of its own: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["export-fmu", *arguments])
        out, err = capfd.readouterr()
        return code, out, err

    return run


def description_of(path):
    return fmpy.read_model_description(str(path))


@pytest.mark.parametrize("name", all_vehicle_names())
def test_every_vehicle_is_a_valid_fmu(name, tmp_path):
    from fmpy.validation import validate_fmu

    from simwarp.exporters import save_fmu

    path = tmp_path / "a vehicle.fmu"
    save_fmu(load_any_vehicle(name), path)
    assert validate_fmu(str(path)) == []
    found = {each.name: each for each in description_of(path).modelVariables}
    assert {"steering", "throttle", "braking"} <= {k for k, v in found.items() if v.causality == "input"}
    assert found["speed_mps"].unit == "m/s"
    assert found["chassis_mass"].unit == "kg"
    assert sum(each.causality == "output" for each in found.values()) > 15


def test_the_file_holds_the_vehicle(export, tmp_path):
    code, out, err = export(VEHICLE, "--output", "out.fmu", "--json", "a.json")
    assert (code, err) == (0, "")
    assert "wrote out.fmu" in out
    content = json.loads((tmp_path / "a.json").read_text())
    assert (content["file"], content["vehicle"]) == ("out.fmu", VEHICLE)
    with zipfile.ZipFile("out.fmu") as file:
        assert {"modelDescription.xml", "resources/vehicle.json"} <= set(file.namelist())
        file.extract("resources/vehicle.json")
    assert load_vehicle("resources/vehicle.json") == load_vehicle(VEHICLE)


@pytest.mark.slow
@pytest.mark.parametrize(("vehicle", "cold"), [(VEHICLE, True), ("gator", False), ("m113-belt", False)])
def test_an_fmu_moves_as_a_drive_does(export, tmp_path, vehicle, cold):
    """In a second process, in a folder with a space, once with no kernels: the same motion to the last bit."""
    assert export(vehicle, "--output", "my truck.fmu")[0] == 0
    (tmp_path / "inputs.csv").write_text(SCRIPT)
    spec = load_any_vehicle(vehicle)
    what = maneuver("inputs.csv", spec)
    forces = () if isinstance(spec, TrackedVehicleSpec) else ("Fx_*", "Fy_*")
    run = Drive(set_up(spec, what, device="cpu", friction=0.7), channels=forces).run()
    names = [each.name for each in description_of("my truck.fmu").modelVariables if each.causality == "output"]
    plan = {"parameters": {"friction": 0.7}, "outputs": names, "steps": 100, "step": 0.01, "inputs": INPUTS}
    (tmp_path / "importer.py").write_text(IMPORTER)
    folder = tmp_path / "with a space"
    environment = {**os.environ, **({"WARP_CACHE_PATH": str(tmp_path / "empty cache")} if cold else {})}
    done = subprocess.run(
        [sys.executable, "importer.py", "my truck.fmu", str(folder), "rows.npy", json.dumps(plan)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = np.load("rows.npy")
    assert rows.shape == (101, len(names))
    for number, name in enumerate(names):
        np.testing.assert_array_equal(rows[:, number], run[name], err_msg=name)
    assert rows[-1, names.index("speed_mps")] > 0.3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "which vehicle? usage: simwarp export-fmu VEHICLE"),
        (("hmvw",), "hmvw"),
        (("sedan", "--output", "sedan.zip"), "--output must end in .fmu, got 'sedan.zip'"),
        (("sedan", "--dt", "0"), "--dt must be above 0"),
        (("sedan", "--tire", "soil-rigid"), "soil-rigid"),
        (("m113", "--tire", "tmeasy"), "--tire: 'M113' has tracks"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(export, arguments, message):
    code, _, err = export(*arguments)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1


def test_without_pythonfmu_it_says_what_to_install(export, monkeypatch):
    monkeypatch.setitem(sys.modules, "pythonfmu.builder", None)
    code, _, err = export("sedan")
    assert (code, err.count("\n")) == (2, 1)
    assert "pip install 'simwarp[fmu]'" in err
