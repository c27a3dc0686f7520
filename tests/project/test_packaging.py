"""The wheel and the sdist: one top-level name, nothing missing, and they work where nothing else is."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"simwarp": "simwarp", "tasks": "simwarp/tasks", "train": "simwarp/train"}
DATA = {".py", ".pyi", ".json", ".csv", ".npz", ".pt", ".onnx", ".xml", ".urdf", ".tir", ".js"}
BUILD = """
import sys
from setuptools import build_meta
out = sys.argv[1]  # the build replaces sys.argv
build_meta.build_wheel(out)
build_meta.build_sdist(out)
"""


def run(*command: str | Path, cwd: Path, code: int = 0) -> str:
    """Run a command away from the checkout's own import paths; its standard output."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=env, capture_output=True, text=True, timeout=600)
    assert done.returncode == code, f"{command}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}"
    return done.stdout


def expected_files() -> set[str]:
    """What the wheel must hold, by the checkout."""
    found = set()
    for folder, target in FOLDERS.items():
        for path in (ROOT / folder).rglob("*"):
            if "__pycache__" not in path.parts and (path.suffix in DATA or path.name == "py.typed"):
                found.add(f"{target}/{path.relative_to(ROOT / folder).as_posix()}")
    return found


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with the wheel and the sdist, built from a copy so that no stale `build` folder gets in."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name in (*FOLDERS, "scripts"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, source / path.name)
    run(sys.executable, "-c", BUILD, out, cwd=source)
    return out


@pytest.fixture(scope="module")
def wheel(built):
    return next(built.glob("*.whl"))


def test_the_wheel_has_one_name_and_all_files(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"simwarp"}
    assert {name for name in names if name.startswith("simwarp/")} == expected_files()
    assert {"simwarp/vehicle/data/hmmwv.json", "simwarp/vehicle/data/sedan/tires/pacejka2002.tir"} <= names
    assert {"simwarp/py.typed", "simwarp/tasks/__init__.py", "simwarp/train/__init__.py"} <= names
    assert any(name.endswith("LICENSE") for name in names)


def test_the_sdist_builds_the_same_wheel(built, wheel, tmp_path):
    archive = next(built.glob("*.tar.gz"))
    with tarfile.open(archive) as tar:
        tar.extractall(tmp_path, filter="data")
    source = tmp_path / archive.name.removesuffix(".tar.gz")
    assert (source / "constraints.txt").is_file()
    run(sys.executable, "-c", BUILD, tmp_path, cwd=source)
    rebuilt = next(tmp_path.glob("*.whl"))
    assert sorted(zipfile.ZipFile(rebuilt).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())


def test_a_clone_without_links_has_the_same_files(wheel, tmp_path):
    """Where git has no symbolic links it writes their text: Windows by default."""
    source, out = tmp_path / "source", tmp_path / "dist"
    shutil.copytree(ROOT / "simwarp", source / "simwarp", symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("tasks", "train"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        (source / "simwarp" / name).unlink()
        (source / "simwarp" / name).write_text(f"../{name}", encoding="utf-8")
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, source / path.name)
    out.mkdir()
    run(sys.executable, "-c", BUILD, out, cwd=source)
    flat = next(out.glob("*.whl"))
    assert sorted(zipfile.ZipFile(flat).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())


def test_where_a_drive_has_no_links_at_all_folders_are_copied(tmp_path):
    (tmp_path / "setup.py").write_text((ROOT / "setup.py").read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks" / "__init__.py").write_text("", encoding="utf-8")
    (tmp_path / "simwarp").mkdir()
    (tmp_path / "simwarp" / "tasks").write_text("../tasks", encoding="utf-8")

    # In a process of its own: setuptools cannot be imported behind Python's own distutils
    without = f"""
import runpy, pathlib, setuptools
def refuse(*_, **__):
    raise OSError(1314, "A required privilege is not held by the client")
pathlib.Path.symlink_to = refuse
setuptools.setup = lambda: None
runpy.run_path({str(tmp_path / "setup.py")!r})
"""
    subprocess.run([sys.executable, "-c", without], check=True)
    assert (tmp_path / "simwarp" / "tasks" / "__init__.py").is_file()
    assert not (tmp_path / "simwarp" / "tasks").is_symlink()


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Folder `bin` of a new environment that holds the wheel and, by a path entry, only its dependencies.

    A .pth file inside a folder that another .pth names is not read: the editable install stays out.
    """
    folder = tmp_path_factory.mktemp("empty")
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index", wheel, cwd=folder)
    site = next((folder / "lib").glob("python3.*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", encoding="utf-8")
    return folder / "bin"


@pytest.mark.slow
def test_the_wheel_imports_from_its_own_environment(installed, tmp_path):
    code = "import simwarp, simwarp.tasks, simwarp.train; print(simwarp.__file__, simwarp.tasks.__file__)"
    for path in run(installed / "python", "-c", code, cwd=tmp_path).split():
        assert Path(path).is_relative_to(installed.parent)


@pytest.mark.slow
def test_the_command_works_from_another_folder(installed, tmp_path):
    assert "pendulum" in run(installed / "simwarp", "list", cwd=tmp_path)
    assert "pendulum" in run(installed / "python", "-m", "simwarp", "list", cwd=tmp_path)
