"""Environments in which extras are tried, with pip: what simwarp itself needs comes from a base that is made once."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping, Sequence
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from scripts import setup_env
from scripts.bundle_wheels import pins
from scripts.extra_results import CORE, ExtraError, named, requirements
from scripts.pip_calls import offered, pip_environment, pip_reason
from scripts.torch_build import has_cuda

# They run the tests and are no part of what is tried.
RUNNERS = ("pytest", "pytest-xdist", "hypothesis", "psutil")
COMPILED = "import matplotlib.pyplot, pytest, rsl_rl.runners, scipy.spatial, torch, trimesh, tyro, warp"
BUILDS_OF_TORCH = {"torch", "triton"}
IMPORTS = "SIMWARP_TRIAL_IMPORTS"
"""Variable of the file in which every process of an environment notes the packages that it has imported."""
NOTING = f"""\
import atexit
import os
import sys


def note(path):
    with open(path, "a", encoding="utf-8") as file:
        file.write("".join(f"{{name}}\\n" for name in {{name.partition(".")[0] for name in list(sys.modules)}}))


if path := os.environ.get("{IMPORTS}"):
    atexit.register(note, path)
"""


def lowest(requirement: Requirement, versions: Sequence[str]) -> str:
    """The lowest of the versions that a requirement admits.

    Raises:
        ExtraError: it admits none.
    """
    fitting = [Version(text) for text in versions if Version(text) in requirement.specifier]
    if not fitting:
        raise ExtraError(f"no wheel of {requirement} for Python {sys.version_info.major}.{sys.version_info.minor}")
    return str(min(fitting))


def floors(python: Path, extra: str, there: Mapping[str, str]) -> list[str]:
    """Pins of all packages that pyproject.toml names for an extra at their lowest versions.

    Args:
        python: Interpreter of the environment that they are for.
        extra: Name of the extra, or `core`.
        there: Versions that were chosen already of what simwarp itself needs, by canonical name.

    Raises:
        ExtraError: a package has none.
    """
    pip = [str(python), "-m", "pip", "install"]
    core = {each.name: there.get(canonicalize_name(each.name)) for each in named(CORE)}
    wanted = [each for each in named(CORE) if not core[each.name]] + ([] if extra == CORE else named(extra))
    chosen = [f"{name}=={version}" for name, version in core.items() if version]
    return [*chosen, *(f"{each.name}=={lowest(each, offered(pip, each.name))}" for each in wanted)]


def pip(python: Path, *arguments: str) -> str:
    """Run pip install; what it printed.

    Raises:
        ExtraError: it failed.
    """
    command = [str(python), "-m", "pip", "install", "-q", *arguments]
    done = subprocess.run(
        command, env=pip_environment(), capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if done.returncode:
        conflicts = [line.strip() for line in done.stdout.splitlines() if " depends on " in line or "requested" in line]
        raise ExtraError("; ".join([pip_reason(done.stderr), *conflicts[:6]]))
    return done.stdout


def other_torch(report: str) -> list[str]:
    """Builds of torch that an installation would bring, by pip's report of it."""
    items = [item["metadata"] for item in json.loads(report)["install"]]
    return [f"{each['name']} {each['version']}" for each in items if canonicalize_name(each["name"]) in BUILDS_OF_TORCH]


def install(python: Path, wheel: Path, extra: str, at: str, readers: Sequence[str] = ()) -> dict[str, str]:
    """Install the wheel with an extra, and readers that go with it; the versions of all packages then.

    Readers have the versions of constraints.txt, or older ones that fit what is tried.

    Raises:
        ExtraError: it cannot be installed, or another torch would be.
    """
    target = str(wheel) if extra == CORE else f"{wheel}[{extra}]"
    pinned = floors(python, extra, versions_in(python)) if at == "floor" else []
    if torches := other_torch(pip(python, "--dry-run", "--report", "-", target, *pinned)):
        raise ExtraError(f"extra '{extra}' at its {at} brings another torch: {', '.join(torches)}")
    pip(python, target, *pinned)
    tested = pins()
    installed = versions_in(python)
    held = [f"{name}=={version}" for name, version in installed.items() if name not in BUILDS_OF_TORCH]
    held = [pin for pin in held if not pin.startswith("simwarp==")]
    names = [canonicalize_name(name) for name in (*RUNNERS, *readers)]
    wanted = [f"{name}<={tested[name]}" for name in names if name not in installed]
    if not wanted:
        return installed
    # What the tests need changes nothing of what is tried
    with tempfile.NamedTemporaryFile("w", suffix=".txt", encoding="utf-8", delete=False) as file:
        file.write("\n".join(held))
    try:
        pip(python, "--constraint", file.name, *wanted)
    finally:
        Path(file.name).unlink()
    return versions_in(python)


def versions_in(python: Path) -> dict[str, str]:
    """Versions of all packages of an environment, by canonical name."""
    code = "import importlib.metadata as m; print(*(f'{d.name}=={d.version}' for d in m.distributions()), sep='\\n')"
    done = subprocess.run([str(python), "-I", "-c", code], capture_output=True, encoding="utf-8", check=True)
    pairs = (line.split("==", 1) for line in done.stdout.splitlines())
    return {canonicalize_name(name): version for name, version in pairs}


def linked(source: str, target: str) -> None:
    """A second name of a file, or a copy on file systems that have none; pip unlinks what it replaces."""
    try:
        os.link(source, target)
    except FileExistsError:
        pass  # of a trial that was interrupted, or kept
    except OSError:
        shutil.copy2(source, target)


def imports_file(python: Path) -> Path:
    """File in which processes of an environment note what they have imported."""
    return python.parent.parent / "imports.txt"


def trial_environment(python: Path) -> dict[str, str]:
    """Variables for processes of an environment: the user's, but for packages of elsewhere.

    Bytecode is kept, for tests start many processes.
    """
    kept = {name: value for name, value in pip_environment().items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {IMPORTS: str(imports_file(python))}


def site_packages(folder: Path) -> Path:
    """Where an environment keeps its packages."""
    return next(found for place in ("lib/python3.*", "Lib") for found in folder.glob(f"{place}/site-packages"))


def make_base(folder: Path, at: str) -> None:
    """Make the environment that those of extras begin with: torch, what simwarp itself needs, and what runs tests.

    Raises:
        ExtraError, SetupError, TorchError, PipError: it cannot be made.
    """
    setup_env.make_venv(folder)
    python = setup_env.environment_python(folder)
    setup_env.install_torch(python, has_cuda())
    asked = floors(python, CORE, {}) if at == "floor" else [str(each) for each in named(CORE)]
    tested = pins()
    pip(python, *asked, *(f"{name}=={tested[name]}" for name in RUNNERS))
    # What is imported is compiled here, once for all
    command = [str(python), "-I", "-c", COMPILED]
    imported = subprocess.run(
        command, env=trial_environment(python), capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if imported.returncode:
        raise ExtraError(f"packages of simwarp at their {at} cannot be imported: {pip_reason(imported.stderr)}")


def note_imports(folder: Path) -> None:
    """Let processes of an environment note what they import, from now on."""
    imports_file(setup_env.environment_python(folder)).unlink(missing_ok=True)
    (site_packages(folder) / "noted_imports.py").write_text(NOTING, encoding="utf-8")
    (site_packages(folder) / "noted_imports.pth").write_text("import noted_imports\n", encoding="utf-8")


def make_environment(folder: Path, at: str) -> tuple[Path, str]:
    """Make an environment with the files of a base, which is made once; its Python, and the version of torch in it.

    Raises:
        ExtraError, SetupError, TorchError, PipError: it cannot be made.
    """
    base, python = folder.with_name(f"base-{at}"), setup_env.environment_python(folder)
    made, said = base / "requirements.txt", "\n".join(requirements(CORE))
    if not made.exists() or made.read_text(encoding="utf-8") != said:
        if (base / "pyvenv.cfg").exists():
            shutil.rmtree(base, ignore_errors=True)
        make_base(base, at)
        made.write_text(said, encoding="utf-8")
    # Its pip is the base's, too
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    for each in site_packages(base).iterdir():
        place = site_packages(folder) / each.name
        if each.name == "torch" and os.name != "nt":
            # The half of all files, and what is refused before it changes
            if not place.exists():
                place.symlink_to(each, target_is_directory=True)
        elif each.is_dir():
            shutil.copytree(each, place, copy_function=linked, dirs_exist_ok=True)
        else:
            linked(str(each), str(place))
    note_imports(folder)
    return python, setup_env.installed_torch(python)


def not_imported(python: Path, wanted: Sequence[Requirement]) -> list[str]:
    """Packages of an environment of which no process has noted an import; those without modules are not meant."""
    code = "import importlib.metadata as m, json; print(json.dumps(m.packages_distributions()))"
    done = subprocess.run([str(python), "-I", "-c", code], capture_output=True, encoding="utf-8", check=True)
    noted = imports_file(python)
    imported = set(noted.read_text(encoding="utf-8").split()) if noted.exists() else set()
    modules: dict[str, set[str]] = {}
    for module, packages in json.loads(done.stdout).items():
        for package in packages:
            modules.setdefault(canonicalize_name(package), set()).add(module)
    own = {each.name: modules.get(canonicalize_name(each.name), set()) for each in wanted}
    return [name for name, offered in own.items() if offered and not offered & imported]
