"""`simwarp fit`: a fit from files to files, its list of parameters, and one clear line for each mistake."""

import json
import os
import signal

import pytest

from simwarp.identify import Fit
from tests.unit.identify.cart_pole_logs import write_logs

CONFIG = """
target = "cartpole.json"
dt = 0.005
sample = 0.02

[[runs]]
file = ["run.npz", "run_force.npz"]
start = { "joint_velocity:slide" = 0, "joint_velocity:hinge" = 0 }

[readings]
"joint_position:slide" = "slide"
"joint_position:hinge" = { column = "hinge" }

[inputs]
"joint_force:slide" = "force"

[parameters]
"bodies[pole].mass" = { start = 1.1, low = 0.1, high = 3 }
"bodies[cart].inertia[0]" = {}
"""


@pytest.fixture
def fitting(command, tmp_path, monkeypatch):
    """Run the command in a folder with logs: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    write_logs(tmp_path)
    (tmp_path / "fit.toml").write_text(CONFIG)
    return lambda *arguments: command("fit", *arguments)


@pytest.mark.slow
def test_a_fit_writes_what_it_found(fitting, tmp_path):
    code, out, err = fitting("fit.toml", "--device", "cpu", "--threads", "1", "--json", "out.json")
    assert (code, err) == (0, "")
    content = json.loads((tmp_path / "out.json").read_text())
    mass, inertia = content["parameters"]
    assert mass["value"] == pytest.approx(0.8, rel=1e-3)
    assert mass["low"] <= mass["value"] <= mass["high"]
    assert (mass["identifiable"], inertia["identifiable"], inertia["low"]) == (True, False, None)
    assert (content["iterations"], content["interrupted"]) == (content["iterations"], False)
    assert "not told: bodies[cart].inertia[0]: no reading changes with it" in out
    for name in ("result.json", "patch.json", "cartpole-fitted.json", "ranges.json", "fit.png", "state.npz"):
        assert (tmp_path / "fits" / "fit" / name).is_file(), name


@pytest.mark.slow
def test_an_interrupted_fit_keeps_the_best_and_goes_on(fitting, tmp_path, monkeypatch):
    code, _, _ = fitting("fit.toml", "--device", "cpu", "--threads", "1", "--json", "whole.json", "--out", "whole")
    assert code == 0
    usual = Fit.iterate

    def iterate(fit):
        found = usual(fit)
        if fit.iteration == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return found

    with monkeypatch.context() as patch:
        patch.setattr(Fit, "iterate", iterate)
        code, out, _ = fitting("fit.toml", "--device", "cpu", "--threads", "1", "--json", "part.json")
    assert code == 130
    assert "--resume goes on from" in out
    part = json.loads((tmp_path / "part.json").read_text())
    assert (part["iterations"], part["interrupted"]) == (2, True)
    code, _, _ = fitting("fit.toml", "--device", "cpu", "--threads", "1", "--json", "rest.json", "--resume")
    assert code == 0
    whole, rest = (json.loads((tmp_path / name).read_text()) for name in ("whole.json", "rest.json"))
    assert rest["parameters"] == whole["parameters"]
    assert rest["cost"] == whole["cost"]


def test_parameters_are_listed_with_their_values(fitting, tmp_path):
    code, out, err = fitting("--list", "cartpole.json", "--match", "damping", "--json", "list.json")
    assert (code, err) == (0, "")
    assert "joints[slide].dofs[0].damping  0.5" in out
    rows = json.loads((tmp_path / "list.json").read_text())["parameters"]
    assert [row["value"] for row in rows] == [0.5, 0.05]
    assert {"name", "value", "low", "high", "identifiable"} <= set(rows[0])


@pytest.mark.slow
def test_parameters_of_a_vehicle_are_listed_with_its_soil(fitting):
    code, out, _ = fitting("--list", "hmmwv", "--soil", "mid")
    assert code == 0
    assert "soil.k_phi  2e+06" in out
    assert "chassis.components[0].mass  2086.52" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "which configuration? usage: simwarp fit CONFIG"),
        (("none.toml",), "none.toml"),
        (("fit.toml", "--iterations", "0"), "--iterations must be at least 1, got 0"),
        (("fit.toml", "--match", "x"), "--match and --soil are for --list"),
        (("fit.toml", "--json", "fit.toml"), "--json would overwrite"),
        (("--list", "no-such-car"), "no-such-car"),
        (("--list", "m113"), "must be a vehicle on wheels, got 'M113' on tracks"),
    ],
)
def test_a_mistake_is_one_line(fitting, arguments, words):
    code, out, err = fitting(*arguments)
    assert code == 2
    assert words in err
    assert err.count("\n") == 1
    assert out == ""


def test_a_resume_without_a_state_is_one_line(fitting):
    code, _, err = fitting("fit.toml", "--device", "cpu", "--resume")
    assert code == 2
    assert "state.npz" in err
    assert err.count("\n") == 1
