"""Floors and ceilings of extras: every extra has tests, the lowest versions are chosen, and torch is left alone."""

import os
import re
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from scripts import extras

from .fake_wheels import write_wheel
from .test_setup_env import bare_environment

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = [name for name in PROJECT["optional-dependencies"] if name != "dev"]


def test_every_extra_is_tried_by_tests_that_are_there():
    assert list(extras.TRIALS) == [extras.CORE, *EXTRAS]
    for name, trial in extras.TRIALS.items():
        assert trial.tests, name
        assert all((ROOT / test).exists() for test in trial.tests), name


def test_the_workflow_tries_every_extra_at_both_ends():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    matrix = workflow["jobs"]["extras"]["strategy"]["matrix"]
    assert matrix["extra"] == list(extras.TRIALS)
    assert matrix["at"] == ["floor", "ceiling"]


def test_every_requirement_has_a_floor():
    for text in (
        *PROJECT["dependencies"],
        *(each for name in EXTRAS for each in PROJECT["optional-dependencies"][name]),
    ):
        assert any(bound.operator == ">=" for bound in Requirement(text).specifier), text


@pytest.mark.parametrize(
    ("requirement", "versions", "expected"),
    [
        ("demo>=1.2", ["1.0", "1.10", "1.2.1", "2.0"], "1.2.1"),
        ("demo>=1.2,<2", ["2.0", "1.9"], "1.9"),
        ("demo>=1.2", ["1.2rc1", "1.3"], "1.3"),
    ],
)
def test_the_floor_is_the_lowest_version_that_is_admitted(requirement, versions, expected):
    assert extras.lowest(Requirement(requirement), versions) == expected


def test_no_version_is_one_line():
    with pytest.raises(extras.ExtraError, match=r"^no wheel of demo>=3 for Python 3\.\d+$"):
        extras.lowest(Requirement("demo>=3"), ["1.0", "2.0"])


@pytest.fixture
def small(monkeypatch, tmp_path):
    """A project of two packages with an extra each, in a folder of wheels; an environment that has torch 1.0."""
    text = '[project]\ndependencies = ["core>=1.0", "torch>=1.0"]\n'
    text += '[project.optional-dependencies]\nfine = ["fine>=1.1"]\nbad = ["bad>=1.0"]\n'
    (tmp_path / "pyproject.toml").write_text(text, encoding="utf-8")
    wheels = tmp_path / "wheels"
    for name, version, requires in (
        ("core", "1.0", ()), ("core", "1.5", ()), ("fine", "1.0", ()), ("fine", "1.1", ()), ("fine", "2.0", ()),
        ("bad", "1.0", ("torch>=2.0",)), ("torch", "1.0", ()), ("torch", "2.0", ()),
    ):  # fmt: skip
        write_wheel(wheels, name, version, requires)
    needs = ("core>=1.0", "torch>=1.0", 'fine>=1.1; extra == "fine"', 'bad>=1.0; extra == "bad"')
    own = write_wheel(tmp_path, "simwarp", "1.0", needs, extras=("fine", "bad"))
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheels))
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    monkeypatch.setattr(extras, "RUNNERS", ())
    monkeypatch.setattr(extras, "TRIALS", {name: extras.Trial(("x",)) for name in ("core", "fine", "bad")})
    python = bare_environment(tmp_path / "env")
    extras.pip(python, "torch==1.0")
    return python, own


@pytest.mark.slow
def test_the_lowest_and_the_newest_are_installed(small):
    python, wheel = small
    found = extras.install(python, wheel, "fine", "floor")
    assert {name: found[name] for name in ("core", "fine", "torch")} == {"core": "1.0", "fine": "1.1", "torch": "1.0"}
    extras.pip(python, "--upgrade", "core", "fine")
    found = extras.install(python, wheel, "fine", "ceiling")
    assert {name: found[name] for name in ("core", "fine", "torch")} == {"core": "1.5", "fine": "2.0", "torch": "1.0"}


@pytest.mark.slow
@pytest.mark.parametrize("at", ["floor", "ceiling"])
def test_an_extra_that_brings_another_torch_is_refused_before_it_is_installed(small, at):
    python, wheel = small
    with pytest.raises(extras.ExtraError, match=f"extra 'bad' at its {at} brings another torch: torch 2.0"):
        extras.install(python, wheel, "bad", at)
    assert "bad" not in extras.versions_in(python)
    assert extras.versions_in(python)["torch"] == "1.0"


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("def test_a():\n    pytest.importorskip('no_such_package')\n", "were skipped: .*could not import"),
        ("def test_a():\n    assert False\n", "none passed, 1 failed"),
        ("x = 1\n", "none passed, 0 failed"),
    ],
)
def test_tests_that_did_not_run_have_not_passed(body, expected, tmp_path, monkeypatch):
    (tmp_path / "test_it.py").write_text(f"import pytest\n\n\n{body}", encoding="utf-8")
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    monkeypatch.setattr(extras, "TRIALS", {"demo": extras.Trial(("test_it.py",))})
    with pytest.raises(extras.ExtraError, match=f"extra 'demo' {expected}|of extra 'demo' {expected}"):
        extras.run_tests(Path(sys.executable), "demo", [])


def test_passed_and_failed_are_counted(tmp_path, monkeypatch):
    text = "import pytest\n\n\n@pytest.mark.parametrize('n', range(3))\ndef test_n(n):\n    assert n < 2\n"
    (tmp_path / "test_it.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    monkeypatch.setattr(extras, "TRIALS", {"demo": extras.Trial(("test_it.py",))})
    assert extras.run_tests(Path(sys.executable), "demo", []) == (2, 0, 1)


def test_the_command_line_names_the_extras(capsys):
    with pytest.raises(SystemExit):
        extras.options(["vewer", "--at", "floor"])
    assert re.search(r"invalid choice: '?vewer'?", capsys.readouterr().err)
    assert extras.options(["mcap", "--at", "floor", "--", "-k", "x"]).pytest == ["-k", "x"]
