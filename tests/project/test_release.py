"""A release: one version everywhere, notes for it, and a workflow whose steps are those of the repository."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
WORKFLOWS = {path.stem: path for path in (ROOT / ".github" / "workflows").glob("*.yml")}


def workflow(name):
    """A workflow as its runner reads it; YAML reads the key `on` as true."""
    return yaml.safe_load(WORKFLOWS[name].read_text(encoding="utf-8"))


def test_the_newest_section_of_the_changelog_is_of_this_version():
    versions = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d{2}-\d{2}$", CHANGES, re.MULTILINE)
    assert versions[0] == VERSION
    assert versions == sorted(versions, key=lambda text: [int(part) for part in text.split(".")], reverse=True)
    assert CHANGES.index("## [Unreleased]") < CHANGES.index(f"## [{VERSION}]")


def test_pages_name_the_wheel_of_this_version():
    named = {}
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        if found := set(re.findall(r"simwarp-(\d+\.\d+\.\d+)", page.read_text(encoding="utf-8"))):
            named[page.name] = found
    assert named == {"installation.md": {VERSION}}


def test_notes_of_a_release_are_for_people():
    """They begin with what is new in words, before the long lists, and end where the next version begins."""
    text = CHANGES.partition(f"## [{VERSION}]")[2].partition("\n## [")[0]
    words = text.partition("\n### ")[0].split("\n", 1)[1]
    assert 5 <= words.count("\n- ") <= 15
    assert "To change in code" in words


def test_a_release_is_started_by_a_person():
    content = workflow("release")
    assert list(content[True]) == ["workflow_dispatch"]
    assert list(content["jobs"]) == ["build", "try", "publish"]
    assert content["jobs"]["try"]["needs"] == "build"
    assert content["jobs"]["publish"]["needs"] == "try"


def test_only_the_job_that_publishes_may_write_and_no_secret_is_kept():
    content = workflow("release")
    assert content["permissions"] == {"contents": "read"}
    assert [name for name, job in content["jobs"].items() if "permissions" in job] == ["publish"]
    assert content["jobs"]["publish"]["permissions"]["id-token"] == "write"
    assert content["jobs"]["publish"]["environment"]
    assert "secrets." not in WORKFLOWS["release"].read_text(encoding="utf-8")


def test_what_is_tried_is_what_was_built_and_nothing_else():
    steps = workflow("release")["jobs"]["try"]["steps"]
    assert not any("checkout" in step.get("uses", "") for step in steps)
    assert any('simwarp" train' in step.get("run", "") for step in steps)


@pytest.mark.parametrize("name", ["ci", "release"])
def test_inputs_of_people_reach_a_shell_by_the_environment_alone(name):
    for job in workflow(name)["jobs"].values():
        for step in job["steps"]:
            assert "${{ inputs" not in step.get("run", "")
            assert "${{ github.event" not in step.get("run", "")


def test_systems_and_pythons_of_the_matrix():
    matrix = workflow("ci")["jobs"]["wheel"]["strategy"]["matrix"]
    assert [system.split("-")[0] for system in matrix["system"]] == ["ubuntu", "ubuntu", "windows", "macos"]
    assert "ubuntu-24.04-arm" in matrix["system"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    known = [text.rpartition(" ")[2] for text in project["classifiers"] if "Python :: 3." in text]
    assert matrix["python"] == known == workflow("ci")["jobs"]["tests"]["strategy"]["matrix"]["python"]


def test_files_that_steps_name_are_there():
    text = "".join(path.read_text(encoding="utf-8") for path in WORKFLOWS.values())
    for name in re.findall(r"\b(?:tests|scripts|simwarp)/[\w/]+\.py\b", text):
        assert (ROOT / name).is_file(), name
    for module in re.findall(r"python -m (scripts\.\w+)", text):
        assert (ROOT / f"{module.replace('.', '/')}.py").is_file(), module
