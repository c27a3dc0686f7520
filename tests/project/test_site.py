"""The site: it builds without a warning, every page is in a table of contents, every public name in the reference.

Beside it, what a code host reads: workflows, templates and hooks are YAML that says what they are for.
"""

import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path, PurePosixPath

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PACKAGES = (
    "simwarp", "simwarp.actuators", "simwarp.analysis", "simwarp.exporters", "simwarp.flex",
    "simwarp.importers", "simwarp.mcap", "simwarp.motions", "simwarp.planning",
    "simwarp.scenery",
    "simwarp.scenes", "simwarp.sensors", "simwarp.tasks", "simwarp.tasks.driving", "simwarp.tasks.locomotion",
    "simwarp.tasks.locomotion.velocity", "simwarp.tasks.locomotion.velocity.mdp", "simwarp.train", "simwarp.vehicle",
    "simwarp.vehicle.rigs",
    "simwarp.viewer",
)  # fmt: skip
YAML_FILES = sorted([*(ROOT / ".github").rglob("*.yml"), ROOT / ".pre-commit-config.yaml"])


def page_of(package):
    return DOCS / "api" / f"{package.rpartition('.')[2]}.md"


def toctree_entries(page):
    """Pages that the tables of contents of a page name, relative to docs."""
    blocks = re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line and not line.startswith(":")]


def names_in(page, directive):
    """Names that an autosummary lists, or that other directives of autodoc have as their argument."""
    text = page.read_text(encoding="utf-8")
    if directive == "autosummary":
        block = text.partition(".. autosummary::")[2].partition(".. automodule::")[0]
        return re.findall(r"^   (\w+)$", block, re.MULTILINE)
    return re.findall(rf"^\.\. {directive}:: (\S+)$", text, re.MULTILINE)


def site(folder):
    """Build the site as `make docs` does, without the network; the finished process."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    options = re.search(r"-m sphinx (.*) -b html", makefile)
    assert options is not None
    command = [
        sys.executable, "-m", "sphinx", *options[1].split(), "-b", "html", "-d", str(folder / "trees"), str(DOCS),
        str(folder / "site"),
    ]  # fmt: skip
    # A proxy on a closed port: whatever asks for the network fails.
    nowhere = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
    environment = {**os.environ, **nowhere, "CUDA_VISIBLE_DEVICES": ""}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_has_every_public_name(tmp_path):
    from sphinx.util.inventory import InventoryFile

    done = site(tmp_path)
    assert done.returncode == 0, done.stderr[-4000:]
    with (tmp_path / "site" / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda base, path: path)
    listed = {name for kind, names in inventory.items() if kind.startswith("py:") for name in names}
    for package in PACKAGES:
        names = {f"{package}.{name}" for name in importlib.import_module(package).__all__}
        assert names <= listed


@pytest.mark.parametrize("package", PACKAGES)
def test_the_reference_lists_the_public_names_of_a_package(package):
    page = page_of(package)
    assert names_in(page, "automodule") == [package]
    assert sorted(names_in(page, "autosummary")) == sorted(importlib.import_module(package).__all__)


def test_constants_have_entries_of_their_own():
    # autodoc passes over what is neither a class nor a function, and is documented where it is defined
    for package in PACKAGES:
        module = importlib.import_module(package)
        plain = {name for name in module.__all__ if not callable(getattr(module, name))}
        assert plain <= set(names_in(page_of(package), "autodata")), package


def test_make_docs_turns_warnings_into_errors():
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ndocs: ")[2].partition("\n\n")[0]
    assert {"--nitpicky", "--fail-on-warning", "--keep-going"} <= set(recipe.split())


def test_every_page_is_in_a_table_of_contents():
    entries = [entry for page in DOCS.rglob("*.md") for entry in toctree_entries(page)]
    pages = {PurePosixPath(page.relative_to(DOCS).with_suffix("")).as_posix() for page in DOCS.rglob("*.md")}
    assert len(entries) == len(set(entries)), "a page stands in two places"
    assert pages - {"index"} == set(entries)


@pytest.mark.parametrize("path", YAML_FILES, ids=lambda path: path.name)
def test_yaml_can_be_read(path):
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)


def test_the_workflow_runs_what_make_offers():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    jobs = workflow["jobs"]
    assert set(jobs) == {"tests", "lint", "docs", "wheel", "extras", "image"}
    python = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    assert python == ">=3.11,<3.14"
    assert jobs["tests"]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13"]
    targets = set(re.findall(r"^(\w[\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    used = {step["run"].split()[1] for job in jobs.values() for step in job["steps"] if "run" in step
            and step["run"].startswith("make ")}  # fmt: skip
    assert used == {"setup", "test", "lint", "docs"}
    assert used <= targets


def test_issue_forms_ask_for_the_doctor():
    forms = [path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml"]
    assert len(forms) >= 2
    for path in forms:
        form = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert {"name", "description", "body"} <= form.keys()
        labels = [part["attributes"]["label"] for part in form["body"]]
        assert any("simwarp doctor --json -" in label for label in labels), path.name


def test_hooks_name_commands_that_are_there():
    hooks = [
        hook
        for repo in yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
        for hook in repo["hooks"]
    ]
    assert {"ruff-check", "ruff-format", "mypy"} <= {hook["id"] for hook in hooks}
    for hook in hooks:
        assert hook["language"] == "system"
        module = re.search(r"-m (scripts\.\w+)", hook["entry"])
        assert module is None or (ROOT / f"{module[1].replace('.', '/')}.py").is_file()
