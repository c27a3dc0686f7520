"""Floors and ceilings of extras: every extra has tests, the lowest versions are chosen, and torch is left alone."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version

from scripts import extra_environments, extra_results, extras
from scripts.extra_results import CORE, Outcome

from .fake_wheels import write_wheel
from .test_setup_env import bare_environment

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = [name for name in PROJECT["optional-dependencies"] if name != "dev"]


def test_every_extra_is_tried_by_tests_that_are_there():
    assert list(extras.TRIALS) == [CORE, *EXTRAS]
    for name, trial in extras.TRIALS.items():
        assert trial.tests or trial.slow, name
        assert all((ROOT / test).exists() for test in trial.tests), name
        for test in trial.slow:
            file, _, function = test.partition("::")
            assert f"def {function}(" in (ROOT / file).read_text(encoding="utf-8"), test


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
    assert extra_environments.lowest(Requirement(requirement), versions) == expected


def test_no_version_is_one_line():
    with pytest.raises(extra_results.ExtraError, match=r"^no wheel of demo>=3 for Python 3\.\d+$"):
        extra_environments.lowest(Requirement("demo>=3"), ["1.0", "2.0"])


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
    monkeypatch.setattr(extra_results, "ROOT", tmp_path)
    monkeypatch.setattr(extra_environments, "RUNNERS", ())
    python = bare_environment(tmp_path / "env")
    extra_environments.pip(python, "torch==1.0")
    return python, own


@pytest.mark.slow
def test_the_lowest_and_the_newest_are_installed(small):
    python, wheel = small
    found = extra_environments.install(python, wheel, "fine", "floor")
    assert {name: found[name] for name in ("core", "fine", "torch")} == {"core": "1.0", "fine": "1.1", "torch": "1.0"}
    extra_environments.pip(python, "--upgrade", "core", "fine")
    found = extra_environments.install(python, wheel, "fine", "ceiling")
    assert {name: found[name] for name in ("core", "fine", "torch")} == {"core": "1.5", "fine": "2.0", "torch": "1.0"}


@pytest.mark.slow
@pytest.mark.parametrize("at", ["floor", "ceiling"])
def test_an_extra_that_brings_another_torch_is_refused_before_it_is_installed(small, at):
    python, wheel = small
    with pytest.raises(extras.ExtraError, match=f"extra 'bad' at its {at} brings another torch: torch 2.0"):
        extra_environments.install(python, wheel, "bad", at)
    assert "bad" not in extra_environments.versions_in(python)
    assert extra_environments.versions_in(python)["torch"] == "1.0"


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


@pytest.mark.slow
def test_slow_tests_that_belong_to_a_trial_are_run_too(tmp_path, monkeypatch):
    text = (
        "import pytest\n\n\ndef test_a():\n    pass\n\n\n@pytest.mark.slow\n@pytest.mark.parametrize('n', range(3))\n"
    )
    (tmp_path / "test_it.py").write_text(text + "def test_b(n):\n    assert n\n", encoding="utf-8")
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    for trial, expected in (
        (extras.Trial(("test_it.py",)), (1, 0, 0)),
        (extras.Trial(("test_it.py",), slow=("test_it.py::test_b",)), (3, 0, 1)),
        (extras.Trial(slow=("test_it.py::test_b",)), (2, 0, 1)),
    ):
        monkeypatch.setattr(extras, "TRIALS", {"demo": trial})
        assert extras.run_tests(Path(sys.executable), "demo", []) == expected


@pytest.mark.slow
def test_a_package_that_no_test_imports_was_not_tried(tmp_path):
    """What processes of an environment import is noted, of those too that others start."""
    wheels = tmp_path / "wheels"
    for name in ("used", "unused"):
        write_wheel(wheels, f"{name}_one", "1.0", module=name)
    base = bare_environment(tmp_path / "base-floor")
    folder = tmp_path / "base-floor"
    done = subprocess.run(
        [str(base), "-m", "pip", "install", "-q", "--no-index", f"--find-links={wheels}", "used-one", "unused-one"],
        env=extra_environments.pip_environment(), check=False,
    )  # fmt: skip
    assert done.returncode == 0
    extra_environments.note_imports(folder)
    requirements = [Requirement(name) for name in ("used-one", "unused-one")]
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import used'], check=True)"
    subprocess.run([str(base), "-c", code], env=extra_environments.trial_environment(base), check=True)
    assert extra_environments.not_imported(base, requirements) == ["unused-one"]
    extra_environments.note_imports(folder)
    assert extra_environments.not_imported(base, requirements) == ["used-one", "unused-one"]


def test_the_command_line_names_the_extras(capsys):
    for words in (["vewer", "--at", "floor"], ["mcap", "vewer", "--at", "floor"]):
        with pytest.raises(SystemExit):
            extras.options(words)
        assert re.search(r"invalid choice: '?vewer'?", capsys.readouterr().err)
    assert extras.options(["mcap", "--at", "floor", "--", "-k", "x"]).pytest == ["-k", "x"]
    with pytest.raises(SystemExit):
        extras.options(["mcap", "--at", "floor", "--json", "x.json", "--", "-k", "x"])
    assert "--json: a part of the tests" in capsys.readouterr().err


def outcome(extra, at, said=(), **changed):
    fields: dict[str, Any] = {
        "passed": 3,
        "skipped": 0,
        "failed": 0,
        "error": "",
        "wall_s": 1.0,
        "date": "2026-01-02",
    } | changed
    return Outcome(extra, at, list(said), {"demo": "1.0"}, "2.0+cpu", "3.11.7", **fields)


@pytest.fixture
def tries(monkeypatch, tmp_path):
    """Trials that make no environments: what is tried, in order; one that is named in the set does not hold."""
    text = '[project]\ndependencies = ["core>=1.0"]\n[project.optional-dependencies]\n'
    text += 'fine = ["fine>=1.1"]\nbad = ["bad>=1.0"]\ndev = []\n'
    (tmp_path / "pyproject.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(extra_results, "ROOT", tmp_path)
    monkeypatch.setattr(extras, "TRIALS", {name: extras.Trial(("x",)) for name in ("core", "fine", "bad")})
    tried: list[tuple[str, str]] = []
    wrong: dict[tuple[str, str], object] = {}

    def trial(extra, at, *_):
        tried.append((extra, at))
        if isinstance(reason := wrong.get((extra, at), ""), BaseException):
            raise reason
        return outcome(extra, at, extra_results.requirements(extra), error=reason)

    monkeypatch.setattr(extras, "try_extra", trial)
    words = ["--wheel", "x.whl", "--folder", str(tmp_path / "envs"), "--json", str(tmp_path / "tried.json")]
    return tried, wrong, words


def test_what_was_tried_is_kept_after_each_extra_and_not_tried_again(tries, capsys, tmp_path):
    tried, wrong, words = tries
    wrong["fine", "ceiling"] = KeyboardInterrupt()
    assert extras.main(["all", "--at", "both", *words]) == 130
    assert "run it again and it goes on" in capsys.readouterr().err
    assert tried == [("core", "floor"), ("core", "ceiling"), ("fine", "floor"), ("fine", "ceiling")]
    kept = extra_results.read(tmp_path / "tried.json")
    assert [(each.extra, each.at) for each in kept] == tried[:3]
    tried.clear()
    wrong.clear()
    wrong["bad", "floor"] = "no wheel of bad"
    assert extras.main(["all", "--at", "both", *words]) == 1
    assert tried == [("fine", "ceiling"), ("bad", "floor"), ("bad", "ceiling")]
    output = capsys.readouterr()
    assert output.out.startswith("3 of 6 trials hold already")
    assert output.err == "extras: bad at its floor: 3 passed; no wheel of bad\n"
    # What does not hold, and what is said otherwise now, is tried again
    tried.clear()
    wrong.clear()
    project = (tmp_path / "pyproject.toml").read_text(encoding="utf-8").replace("fine>=1.1", "fine>=1.2")
    (tmp_path / "pyproject.toml").write_text(project, encoding="utf-8")
    assert extras.main(["all", "--at", "both", *words]) == 0
    assert tried == [("fine", "floor"), ("fine", "ceiling"), ("bad", "floor")]
    tried.clear()
    assert extras.main(["all", "--at", "both", *words]) == 0
    assert tried == []
    assert extras.main(["bad", "fine", "--at", "floor", "--again", *words]) == 0
    assert tried == [("bad", "floor"), ("fine", "floor")]
    assert len(extra_results.read(tmp_path / "tried.json")) == 6


def test_a_file_of_something_else_is_refused_in_one_line(tries, capsys, tmp_path):
    tried, _, words = tries
    (tmp_path / "tried.json").write_text("[{}]", encoding="utf-8")
    assert extras.main(["all", "--at", "floor", *words]) == 1
    assert tried == []
    assert re.fullmatch(r"extras: \S+tried.json: no outcomes of extras .*\n", capsys.readouterr().err)
    assert json.loads((tmp_path / "tried.json").read_text(encoding="utf-8")) == [{}]


def test_the_table_has_both_ends_of_every_extra():
    tried = [outcome("core", "floor"), outcome("core", "ceiling", skipped=2, passed=5, date="2026-01-03")]
    lines = extra_results.table(tried, ["core"]).splitlines()
    assert lines[2:] == [
        "| `core` | demo 1.0 | 3 passed | demo 1.0 | 5 passed, 2 skipped | 2026-01-02, 2026-01-03 |",
    ]
    assert extra_results.table(tried[1:], ["core", "mcap"]).splitlines()[2:] == [
        "| `core` |  | not passed yet | demo 1.0 | 5 passed, 2 skipped | 2026-01-03 |",
        "| `mcap` |  | not passed yet |  | not passed yet |  |",
    ]


def test_the_page_shows_what_was_tried():
    page = extra_results.PAGE.read_text(encoding="utf-8")
    kept = extra_results.read(extra_results.RESULTS)
    made = extra_results.with_table(page, kept, list(extras.TRIALS))
    assert made == page, "run: python -m scripts.extra_results"
    other = [outcome(each.extra, each.at) for each in kept]
    assert extra_results.with_table(page, other, list(extras.TRIALS)) != page


KEPT = [pytest.param(each, id=f"{each.extra}-{each.at}") for each in extra_results.read(extra_results.RESULTS)]


@pytest.mark.parametrize("kept", KEPT)
def test_what_was_tried_holds_by_what_the_project_says_now(kept):
    assert kept.holds, kept.text
    again = f"python -m scripts.extras {kept.extra} --at {kept.at} --json benchmarks/results/extras.json"
    assert kept.requirements == extra_results.requirements(kept.extra), f"run: {again}"
    assert kept.versions


@pytest.mark.parametrize("kept", KEPT)
def test_versions_that_were_tried_are_those_that_the_project_admits(kept):
    """A floor is a version that exists: what was installed is what is written, but for zeros at its end."""
    said = {requirement.name: requirement for requirement in map(Requirement, kept.requirements)}
    for name, version in kept.versions.items():
        assert Version(version) in said[name].specifier
        floor = next(part.version for part in said[name].specifier if part.operator == ">=")
        assert kept.at != "floor" or Version(version) == Version(floor), name
