"""The Dockerfile: what it copies exists and reaches the builder, and nobody is root at the end."""

import fnmatch
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from scripts import dependencies, setup_env

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def instructions():
    """Word and rest of every instruction, in order."""
    lines = "\n".join(line for line in TEXT.splitlines() if not line.startswith("#"))
    joined = re.sub(r"\\\n\s*", "", lines)
    return [tuple(line.split(maxsplit=1)) for line in joined.splitlines() if line.strip()]


def of(kind):
    """Rests of one kind of instruction."""
    return [rest for word, rest in instructions() if word == kind]


def copied():
    """What is copied from the repository."""
    return [name for rest in of("COPY") if "--from" not in rest for name in rest.split()[:-1]]


def ignored(name):
    """Whether .dockerignore keeps a path from the builder: the last line that matches counts."""
    verdict = False
    for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        pattern = line.removeprefix("!")
        if any(fnmatch.fnmatch(part, pattern) for part in (name, name.split("/")[0])):
            verdict = not line.startswith("!")
    return verdict


@pytest.mark.parametrize("name", copied())
def test_what_is_copied_is_there_and_reaches_the_builder(name):
    assert (ROOT / name).exists()
    assert not ignored(name)


def test_the_builder_gets_nothing_else():
    for name in (".git", ".venv", "tests", "docs", "runs", "benchmarks", "simwarp/__pycache__"):
        assert ignored(name) or name.endswith("__pycache__"), name


def test_every_word_is_an_instruction_and_the_first_chooses_the_base():
    known = {"ARG", "FROM", "ENV", "RUN", "WORKDIR", "COPY", "USER", "VOLUME", "EXPOSE", "ENTRYPOINT", "CMD"}
    words = [word for word, _ in instructions()]
    assert set(words) <= known
    assert instructions()[0] == ("ARG", "BASE=ubuntu:24.04")
    assert [rest.split()[0] for rest in of("FROM")] == ["${BASE}", "python", "python"]
    assert {rest.split("=")[0] for rest in of("ARG")} == {"BASE", "TORCH", "EXTRAS"}


def test_commands_run_as_a_user_with_a_cache_of_kernels_to_keep():
    words = [word for word, _ in instructions()]
    (user,) = of("USER")
    assert f"--uid 1001 {user}" in TEXT
    assert "RUN" not in words[words.index("USER") :]
    (volume,) = of("VOLUME")
    assert f"WARP_CACHE_PATH={volume}" in TEXT
    assert re.search(rf"install --directory --mode 1777 .*{volume}\b", TEXT)
    assert of("ENTRYPOINT") == ['["simwarp"]']


def test_layers_leave_nothing_behind_and_change_with_their_own_files():
    for step in of("RUN"):
        if "apt-get" in step:
            assert "--no-install-recommends" in step
            assert step.endswith("rm -rf /var/lib/apt/lists/*")
        if "pip " in step:
            assert "--no-cache-dir" in step
    order = [rest for word, rest in instructions() if word in ("COPY", "RUN")]
    torch = next(k for k, rest in enumerate(order) if "--only-torch" in rest)
    required = next(k for k, rest in enumerate(order) if "scripts.dependencies" in rest)
    code = next(k for k, rest in enumerate(order) if "--from=wheel" in rest)
    assert torch < required < code
    # Code that changes must not make torch be downloaded again
    assert not any(
        "simwarp" in name.split("/")[0] for rest in order[4:required] for name in rest.split()[:-1] if "COPY" in rest
    )


def test_the_requirements_are_those_of_the_package(capsys, monkeypatch):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert dependencies.dependencies([]) == project["dependencies"]
    monkeypatch.setattr(sys, "argv", ["dependencies", "viewer,mcap"])
    assert dependencies.main() == 0
    printed = capsys.readouterr().out.splitlines()
    extras = project["optional-dependencies"]
    assert printed == [*project["dependencies"], *extras["viewer"], *extras["mcap"]]
    monkeypatch.setattr(sys, "argv", ["dependencies", "vewer"])
    assert dependencies.main() == 1
    assert capsys.readouterr().err.startswith("dependencies: no extra 'vewer'; there are viewer, ")


def test_its_scripts_need_nothing_that_is_not_copied(tmp_path):
    """They run before anything is installed, from the files of their layer alone."""
    for name in (*copied(), "pyproject.toml"):
        if name.startswith("scripts/") or name in ("constraints.txt", "pyproject.toml"):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    for module in ("scripts.setup_env", "scripts.dependencies"):
        code = f"import {module}"
        subprocess.run([sys.executable, "-S", "-c", code], cwd=tmp_path, env={"PATH": os.environ["PATH"]}, check=True)


def test_an_image_begins_with_torch_alone(monkeypatch, tmp_path):
    done: list[object] = []

    def made(folder: Path) -> Path:
        done.append(folder)
        return folder / "bin" / "python"

    def installed(python: Path, cuda: bool) -> str:
        done.append(cuda)
        return "2.0"

    monkeypatch.setattr(setup_env, "ROOT", tmp_path)
    monkeypatch.setattr(setup_env, "make_venv", made)
    monkeypatch.setattr(setup_env, "install_torch", installed)
    monkeypatch.setattr(setup_env, "pip_install", lambda *_: pytest.fail("more than torch"))
    monkeypatch.setattr(sys, "argv", ["setup_env", "--only-torch", str(tmp_path / "env")])
    monkeypatch.setenv("SIMWARP_TORCH", "cuda")
    assert setup_env.main() == 0
    assert done == [tmp_path / "env", True]
