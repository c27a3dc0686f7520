"""Set-up: the right build of torch from whatever pip can reach, and nothing half-made after any failure.

Package folders on this machine take the place of the network, and a bare environment that of the checkout's.
"""

import os
import shutil
import subprocess
import sys
import tomllib
import venv
from pathlib import Path

import pip
import pytest

from scripts import pip_calls, setup_env, torch_build

from .fake_wheels import write_index, write_wheel

ROOT = Path(__file__).resolve().parents[2]
TORCH = torch_build.pinned("torch")
CPU, NEWER = f"{TORCH}+cpu", "99.0"


@pytest.mark.parametrize(
    ("linux", "cuda", "here", "index", "expected"),
    [
        (True, False, ["1.9", "2.0", "2.0+cpu"], [], ("2.0+cpu", ())),
        (True, False, ["2.0"], ["2.0", "2.0+cpu"], ("2.0+cpu", ("--extra-index-url", torch_build.CPU_INDEX))),
        (True, False, ["1.9", "2.0", "2.1"], [], ("2.0", ())),
        (True, False, ["2.0+cu126"], [], ("2.0+cu126", ())),
        (True, True, ["2.0", "2.0+cpu"], ["2.0+cpu"], ("2.0", ())),
        (True, True, ["2.0+cpu", "2.0+cu126"], [], ("2.0+cu126", ())),
        (False, False, ["1.9", "2.0"], ["2.0+cpu"], ("2.0", ())),
        (False, True, ["2.0"], [], ("2.0", ())),
    ],
)
def test_the_order_of_builds(linux, cuda, here, index, expected):
    build = torch_build.choose(
        "2.0", cuda=cuda, linux=linux, offers=lambda *more: index if more else here, target="this machine"
    )
    assert (build.version, build.arguments) == expected
    assert ("some 2.5 GB" in build.note) == (linux and "cpu" not in build.version)


@pytest.mark.parametrize(
    ("cuda", "here", "expected"),
    [
        (False, [], "pip finds none; without a network"),
        (False, ["1.9", "2.0.1", "3.0"], "pip finds only 1.9, 2.0.1, 3.0"),
        (True, ["2.0+cpu"], "only the CPU build"),
    ],
)
def test_no_build_is_one_line_with_the_remedy(cuda, here, expected):
    with pytest.raises(torch_build.TorchError, match=expected) as caught:
        torch_build.choose("2.0", cuda=cuda, linux=True, offers=lambda *more: here, target="this machine")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("found", "cuda", "expected"),
    [
        ("2.0+cpu", False, True),
        ("2.0", True, True),
        ("2.0", False, True),
        ("2.0+cpu", True, False),
        ("1.9+cpu", False, False),
        ("", False, False),
    ],
)
def test_what_is_there_is_kept_if_it_fits(found, cuda, expected):
    assert setup_env.fits(found, "2.0", cuda) is expected


def test_constraints_pin_every_direct_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    names = {requirement.split(">=")[0] for requirement in wanted} - {"setuptools"}
    assert all(torch_build.pinned(name) for name in names)


def bare_environment(folder):
    """Interpreter of a new environment that sees nothing but the pip of this one."""
    venv.create(folder, with_pip=False, symlinks=True)
    site = next((folder / "lib").glob("python3.*/site-packages"))
    (folder / "beside").mkdir()
    (folder / "beside" / "pip").symlink_to(Path(pip.__file__).parent)
    (site / "beside.pth").write_text(f"{folder / 'beside'}\n")
    return folder / "bin" / "python"


@pytest.fixture(scope="module")
def shared_python(tmp_path_factory):
    """Making an environment takes time."""
    return bare_environment(tmp_path_factory.mktemp("env") / ".venv")


@pytest.fixture
def python(shared_python, monkeypatch, tmp_path):
    """The same without what earlier tests installed, and cut off from every package index."""
    site = next((shared_python.parent.parent / "lib").glob("python3.*/site-packages"))
    for path in site.iterdir():
        if path.name.startswith(("torch", "demo")):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setattr(torch_build, "CPU_INDEX", (tmp_path / "torch-index").as_uri())
    return shared_python


@pytest.mark.quick("versions0-2.13.0+cpu-CPU build", "versions1-2.13.0-some 2.5 GB")
@pytest.mark.parametrize(
    ("versions", "expected", "said"),
    [((CPU,), CPU, "CPU build"), ((TORCH,), TORCH, "some 2.5 GB"), ((TORCH, CPU, NEWER), CPU, "CPU build")],
)
@pytest.mark.slow
def test_torch_from_a_folder_of_wheels(python, monkeypatch, tmp_path, capsys, versions, expected, said):
    for version in versions:
        write_wheel(tmp_path / "wheels", "torch", version)
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    assert setup_env.install_torch(python, cuda=False) == expected
    assert setup_env.installed_torch(python) == expected
    assert said in capsys.readouterr().out
    # The second time it is there.
    monkeypatch.delenv("PIP_FIND_LINKS")
    assert setup_env.install_torch(python, cuda=False) == expected
    assert "is there" in capsys.readouterr().out


@pytest.mark.slow
def test_a_cuda_machine_never_takes_the_cpu_build(python, monkeypatch, tmp_path):
    for version in (CPU, TORCH):
        write_wheel(tmp_path / "wheels", "torch", version)
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    setup_env.install_torch(python, cuda=False)
    setup_env.install_torch(python, cuda=True)
    assert setup_env.installed_torch(python) == TORCH


@pytest.mark.slow
@pytest.mark.parametrize(
    ("configured", "own", "expected"), [(TORCH, CPU, CPU), (TORCH, NEWER, TORCH), (CPU, TORCH, CPU)]
)
def test_torch_from_package_indexes(python, monkeypatch, tmp_path, configured, own, expected):
    monkeypatch.delenv("PIP_NO_INDEX")
    monkeypatch.setenv("PIP_INDEX_URL", write_index(tmp_path / "simple", ("torch", configured)))
    write_index(tmp_path / "torch-index", ("torch", own))
    assert setup_env.install_torch(python, cuda=False) == expected
    assert setup_env.installed_torch(python) == expected


@pytest.mark.parametrize("versions", [(), (NEWER,)])
def test_neither_build_is_one_line(python, monkeypatch, tmp_path, versions):
    (tmp_path / "wheels").mkdir()
    for version in versions:
        write_wheel(tmp_path / "wheels", "torch", version)
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    with pytest.raises(torch_build.TorchError, match=f"no torch {TORCH} for Python 3") as caught:
        setup_env.install_torch(python, cuda=False)
    assert "\n" not in str(caught.value)
    assert setup_env.installed_torch(python) == ""


def test_a_pip_that_does_not_work_is_not_taken_for_empty_indexes():
    with pytest.raises(pip_calls.PipError, match="No module named nopip"):
        pip_calls.offered([sys.executable, "-m", "nopip"], "torch")


def test_a_changed_pin_is_installed_and_a_missing_one_is_one_line(python, monkeypatch, tmp_path):
    for version in ("1.0", "2.0"):
        write_wheel(tmp_path / "wheels", "demo", version)
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    monkeypatch.setattr(setup_env, "CONSTRAINTS", tmp_path / "constraints.txt")
    show = "import importlib.metadata as m; print(m.version('demo'))"
    for version in ("1.0", "2.0"):
        (tmp_path / "constraints.txt").write_text(f"demo=={version}\ntorch=={TORCH}\n")
        setup_env.pip_install(python, CPU, "demo>=0.5")
        assert setup_env.runs(python, show).stdout.strip() == version
    (tmp_path / "constraints.txt").write_text("demo==3.0\n")
    with pytest.raises(setup_env.SetupError, match=r"could not install demo>=0.5: .*conflicting.*setup.log") as caught:
        setup_env.pip_install(python, CPU, "demo>=0.5")
    assert "\n" not in str(caught.value)


def test_constraints_of_pips_own_configuration_do_not_hide_what_there_is(python, monkeypatch, tmp_path):
    write_wheel(tmp_path / "wheels", "torch", f"{TORCH}+cpu")
    (tmp_path / "site.txt").write_text("torch<=99\n")
    (tmp_path / "pip.conf").write_text(f"[global]\nconstraint = {tmp_path / 'site.txt'}\n")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    monkeypatch.setenv("PIP_CONFIG_FILE", str(tmp_path / "pip.conf"))
    assert setup_env.install_torch(python, cuda=False) == f"{TORCH}+cpu"


def test_settings_that_would_install_elsewhere_are_put_aside(monkeypatch):
    for name in ("PIP_TARGET", "PIP_PREFIX", "PIP_CONSTRAINT", "PYTHONPATH"):
        monkeypatch.setenv(name, "/elsewhere")
    monkeypatch.setenv("PIP_USER", "1")
    monkeypatch.setenv("PIP_PROXY", "http://proxy")
    environment = pip_calls.pip_environment()
    assert "/elsewhere" not in environment.values()
    assert (environment["PIP_USER"], environment["PIP_PROXY"]) == ("0", "http://proxy")


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("WARNING: Retrying (Retry(total=4\nERROR: No matching distribution found for a==1\n", "a==1 .*no network"),
        ("ERROR: Could not install: No space left on device\n", "^Could not install: No space left on device$"),
        ("ERROR: Cannot install a and b\nERROR: ResolutionImpossible: for help visit x\n", "^Cannot install a and b$"),
        ("Traceback\n  File x\nZeroDivisionError: y\n\n", "^ZeroDivisionError: y$"),
        ("", "no message"),
    ],
)
def test_what_pip_wrote_in_one_line(output, expected):
    with pytest.raises(setup_env.SetupError, match=expected):
        raise setup_env.SetupError(pip_calls.pip_reason(output))


def stand_in(folder, name, text):
    """A program of this name, found first."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{text}\n")
    (folder / name).chmod(0o755)


NO_SMI = None
SMI = {
    "a GPU": ("echo 'GPU 0: NVIDIA H100 (UUID: GPU-1)'", True),
    "no GPU": ("echo 'No devices were found'", False),
    "a driver that fails": ("echo 'GPU 0?' && exit 9", False),
    "no nvidia-smi": (NO_SMI, False),
}


@pytest.fixture
def without_driver(monkeypatch, tmp_path):
    """Neither a driver nor a wish; the folder of stand-ins is the only one on PATH."""
    (tmp_path / "programs").mkdir()
    monkeypatch.delenv("SIMWARP_TORCH", raising=False)
    monkeypatch.setenv("PATH", f"{tmp_path / 'programs'}:/usr/bin:/bin")
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path / "programs"))
    if torch_build.has_cuda():
        pytest.skip("this machine has a CUDA driver")
    return tmp_path / "programs"


@pytest.mark.parametrize("machine", SMI)
def test_a_driver_is_known_by_its_program(without_driver, monkeypatch, machine):
    text, expected = SMI[machine]
    if text is not NO_SMI:
        stand_in(without_driver, "nvidia-smi", text)
    assert torch_build.has_cuda() is expected
    for wish in ("cpu", "cuda"):
        monkeypatch.setenv("SIMWARP_TORCH", wish)
        assert torch_build.has_cuda() is (wish == "cuda")


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize(
    ("init", "devices", "expected"),
    [("return 0", 1, True), ("return 0", 0, False), ("return 100", 1, False), ("return *(volatile int *)0", 1, False)],
    ids=["a GPU", "no GPU", "no device", "a driver that crashes"],
)
def test_without_nvidia_smi_the_drivers_library_is_asked(without_driver, init, devices, expected):
    text = f"int cuInit(unsigned flags) {{ {init}; }}\nint cuDeviceGetCount(int *n) {{ *n = {devices}; return 0; }}\n"
    (without_driver / "driver.c").write_text(text)
    command = ["gcc", "-shared", "-fPIC", "-o", "libcuda.so.1", "driver.c"]
    subprocess.run(command, cwd=without_driver, check=True)
    assert torch_build.has_cuda() is expected


PIP = """
echo "$@" >> {log}
case "$*" in
    *===0*) echo "ERROR: Could not find a version (from versions: {offers})" >&2; exit 1 ;;
esac
"""


@pytest.mark.parametrize(("machine", "expected"), [("a GPU", TORCH), ("no GPU", CPU), ("no nvidia-smi", CPU)])
def test_set_up_asks_pip_for_the_build_of_the_machine(without_driver, monkeypatch, tmp_path, machine, expected):
    """The whole set-up, with stand-ins for the driver and for a Python that writes the calls of pip down."""
    text, _ = SMI[machine]
    if text is not NO_SMI:
        stand_in(without_driver, "nvidia-smi", text)
    log = tmp_path / "calls"
    folder = tmp_path / ".venv"
    folder.mkdir()
    stand_in(folder / "bin", "python", PIP.format(log=log, offers=f"{TORCH}, {CPU}"))
    monkeypatch.setattr(setup_env, "make_venv", lambda where: where / "bin" / "python")
    setup_env.set_up(folder)
    installs = [line for line in log.read_text().splitlines() if " install -q " in line]
    assert installs[0].endswith(f" torch==={expected}")
    assert [line.split()[-1] for line in installs[1:]] == ["setuptools>=77", ".[dev]"]
    assert f"torch==={expected}" in (folder / "constraints.txt").read_text()
    assert (folder / ".setup-done").exists()


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A folder that set-up takes for its checkout."""
    folder = tmp_path / "check out"
    folder.mkdir()
    for name in ("Makefile", "constraints.txt", "pyproject.toml"):
        shutil.copy(ROOT / name, folder)
    shutil.copytree(ROOT / "scripts", folder / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def set_up(checkout, **settings):
    """Run the real script with no package anywhere."""
    empty = {
        "PIP_NO_INDEX": "1",
        "PIP_FIND_LINKS": str(checkout),
        "PIP_CONFIG_FILE": os.devnull,
        "SIMWARP_TORCH": "cpu",
    }
    return subprocess.run(
        [sys.executable, "-m", "scripts.setup_env", ".venv"],
        cwd=checkout, env=os.environ | empty | settings, capture_output=True, text=True, timeout=120,
    )  # fmt: skip


def test_a_failed_set_up_is_one_line_and_leaves_no_mark(checkout):
    bare_environment(checkout / ".venv")
    (checkout / ".venv" / ".setup-done").touch()
    done = set_up(checkout)
    assert done.returncode == 1
    assert done.stdout == "[1/3] virtual environment .venv is there\n"
    assert done.stderr.startswith(f"setup: no torch {TORCH} for Python 3")
    assert done.stderr.count("\n") == 1
    assert not (checkout / ".venv" / ".setup-done").exists()


@pytest.mark.slow
def test_a_broken_environment_is_made_anew(checkout):
    (checkout / ".venv" / "bin").mkdir(parents=True)
    (checkout / ".venv" / "pyvenv.cfg").write_text("home = /gone\n")
    (checkout / ".venv" / "bin" / "python").symlink_to("/gone/python3")
    assert set_up(checkout).stdout == f"[1/3] virtual environment .venv with Python {sys.version.split()[0]}\n"
    assert "is there" in set_up(checkout).stdout


@pytest.mark.parametrize(
    ("make", "settings", "expected"),
    [
        (lambda path: path.write_text("mine"), {}, ".venv is not a folder"),
        (
            lambda path: (path.mkdir(), (path / "thesis.tex").write_text("mine")),
            {},
            "not empty; move it out of the way",
        ),
        (lambda path: path.symlink_to("/nowhere/at/all"), {}, ".venv is not a folder"),
        (lambda path: None, {"SIMWARP_TORCH": "gpu"}, "SIMWARP_TORCH is 'gpu'"),
    ],
)
def test_what_is_in_the_way_is_named_and_kept(checkout, make, settings, expected):
    make(checkout / ".venv")
    before = sorted(checkout.rglob("*"))
    done = set_up(checkout, PYTHONDONTWRITEBYTECODE="1", **settings)
    assert done.returncode == 1
    assert expected in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(checkout.rglob("*")) == before


@pytest.mark.parametrize("module", ["venv", "ensurepip"])
def test_a_python_without_venv_says_what_to_install(monkeypatch, tmp_path, module):
    monkeypatch.setattr(setup_env.importlib.util, "find_spec", lambda name: None if name == module else object())
    with pytest.raises(setup_env.SetupError, match=f"no module {module} .*apt install python3.*-venv"):
        setup_env.make_venv(tmp_path / ".venv")
    assert not (tmp_path / ".venv").exists()


def test_an_environment_that_was_moved_is_made_anew(tmp_path):
    config = tmp_path / "pyvenv.cfg"
    config.write_text("home = /usr/bin\nversion = 3.12.1\n")
    assert setup_env.belongs(tmp_path)
    config.write_text(f"home = /usr/bin\ncommand = /usr/bin/python3 -m venv --clear {tmp_path}\n")
    assert setup_env.belongs(tmp_path)
    config.write_text("home = /usr/bin\ncommand = /usr/bin/python3 -m venv --clear /home/me/old place/.venv\n")
    assert not setup_env.belongs(tmp_path)


@pytest.mark.slow
def test_a_package_whose_installation_was_cut_off_is_installed_again(python, monkeypatch, tmp_path):
    write_wheel(tmp_path / "wheels", "demo", "1.0")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    setup_env.pip_install(python, CPU, "demo")
    folder = python.parent.parent
    site = next(folder.glob("lib/python3.*/site-packages"))
    (site / "demo-1.0.dist-info" / "RECORD").unlink()
    (site / "demo.py").unlink()
    setup_env.drop_half_installed(folder)
    setup_env.pip_install(python, CPU, "demo")
    assert setup_env.runs(python, "import demo; print(demo.__version__)").stdout.strip() == "1.0"


SET_UP = """
import pathlib, sys
folder = pathlib.Path.cwd() / ".venv"
(folder / "bin").mkdir(parents=True, exist_ok=True)
python = folder / "bin" / "python"
python.unlink(missing_ok=True)
python.symlink_to(sys.executable)
(folder / ".setup-done").write_text(f"{pathlib.Path.cwd()}\\n")
print("set up")
"""


def test_make_sets_up_when_it_has_to(checkout):
    (checkout / "scripts" / "setup_env.py").write_text(SET_UP)

    def make():
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
        command = ["make", "setup", f"PYTHON={sys.executable}"]
        done = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return "set up" in done.stdout

    assert make()
    assert not make()
    newer = (checkout / ".venv" / ".setup-done").stat().st_mtime + 5
    os.utime(checkout / "constraints.txt", (newer, newer))  # `git pull` brought other versions
    assert make()
    os.utime(checkout / "constraints.txt", (0, 0))
    assert not make()
    (checkout / ".venv" / "bin" / "python").unlink()  # Python was upgraded
    (checkout / ".venv" / "bin" / "python").symlink_to("/gone/python3")
    assert make()
    checkout = checkout.rename(checkout.with_name("moved"))
    assert make()
    assert not make()
