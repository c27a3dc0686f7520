"""Bundles for machines without network: which wheels, the parts, and install.sh on what came over.

The wheels are fakes of a few hundred bytes, but for pip's own.
"""

import ensurepip
import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
from itertools import pairwise
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from scripts import bundle
from scripts.bundle_wheels import Shelf, Target, WheelError, requirements

from .fake_wheels import write_wheel

HERE = ".".join(map(str, sys.version_info[:2]))
TORCH = bundle.pinned("torch")
WHEELS = {
    "numpy": "2.0",
    "warp_lang": "1.19.0",
    "nvidia_thing": "13.0",
    "nvidia_part": "13.1",
    "triton": "3.7",
    "helper": "1.0",
    "newer": "1.0",
    "unneeded": "1.0",
}
BELOW = getattr(sys, "_base_executable", sys.executable)
"""The Python that this environment was made with."""
DEFAULT = bundle.options([]).platform
PINS = {"numpy": "2.0", "warp-lang": "1.19.0", "helper": "1.0"}


@pytest.fixture(scope="module")
def market(tmp_path_factory):
    """The folder that takes the place of all package indexes."""
    folder = tmp_path_factory.mktemp("market")
    for name, version in WHEELS.items():
        asks = {"nvidia_thing": ('nvidia-part==13.1; extra == "part"',)}
        write_wheel(folder, name, version, asks.get(name, ()), module={"warp_lang": "warp"}.get(name, name))
    write_wheel(folder, "helper", "2.0")
    write_wheel(folder, "torch", f"{TORCH}+cpu", ("helper",))
    cuda = ('nvidia-thing[part]==13.0; platform_system == "Linux"', 'triton; sys_platform == "linux"')
    write_wheel(folder, "torch", TORCH, ("helper", *cuda, 'newer; python_version >= "3.13"'))
    pip = sorted((Path(ensurepip.__file__).parent / "_bundled").glob("pip-*.whl"))
    if not pip:
        pytest.skip("this Python comes without a wheel of pip")
    shutil.copy(pip[0], folder)
    return folder


def work_at(tmp_path, monkeypatch, market):
    """The market is all that pip finds, the cache is empty, and simwarp's own wheel is quickly built."""
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(market))
    monkeypatch.setattr(bundle, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(bundle, "PART_BYTES", 600_000)
    monkeypatch.setattr(bundle, "pins", lambda: dict(PINS))
    asks = ("torch>=2.9", "numpy", "warp-lang", 'unneeded; extra == "viewer"')
    monkeypatch.setattr(bundle, "own_wheel", lambda folder: write_wheel(folder, "simwarp", "0.1.0", asks))
    return tmp_path


@pytest.fixture
def at_home(tmp_path, monkeypatch, market):
    """A folder to write bundles in."""
    return work_at(tmp_path, monkeypatch, market)


@pytest.fixture(scope="module")
def made(market, tmp_path_factory):
    """A bundle for this machine."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("made")
        work_at(folder, patch, market)
        bundle.bundle(["--output", str(folder / "bundle")])
    return folder / "bundle"


def contents(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def names_in_parts(folder):
    joined = b"".join(path.read_bytes() for path in sorted(folder.glob("wheels.tar.*")))
    with tarfile.open(fileobj=io.BytesIO(joined)) as archive:
        return {name.split("-")[0] for name in archive.getnames()}


def test_parts_lists_and_a_second_run(at_home, monkeypatch, capsys):
    output = at_home / "out" / "bundle"
    bundle.bundle(["--output", str(output)])
    sizes = [path.stat().st_size for path in sorted(output.glob("wheels.tar.*"))]
    assert len(sizes) > 2
    assert set(sizes[:-1]) == {600_000}
    assert 0 < sizes[-1] <= 600_000
    assert names_in_parts(output) == {"pip", "torch", "numpy", "warp_lang", "helper"}
    about = json.loads((output / "bundle.json").read_text())
    assert (about["python"], about["torch"], about["without"]) == (HERE, f"{TORCH}+cpu", [])
    assert f"torch==={TORCH}+cpu\n" in (output / "requirements.txt").read_text()
    sums = dict(reversed(line.split("  ")) for line in (output / "SHA256SUMS").read_text().splitlines())
    before = contents(output)
    assert sums == {name: digest for name, digest in before.items() if name != "SHA256SUMS"}
    # What was downloaded is used again, no index is asked, and the same wheels give the same bytes.
    monkeypatch.setenv("PIP_FIND_LINKS", "/nowhere")
    bundle.bundle(["--output", str(output)])
    assert contents(output) == before
    assert [path.name for path in output.parent.iterdir()] == ["bundle"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--without", "torch"], set()),
        (["--without", "torch", "--cuda"], set()),
        (["--without", "Warp_Lang"], {"torch", "helper"}),
        (["--cuda"], {"torch", "helper", "nvidia_thing", "nvidia_part", "triton"}),
        (["--cuda", "--python", "3.13"], {"torch", "helper", "nvidia_thing", "nvidia_part", "triton", "newer"}),
        (["--platform", "macosx_14_0_arm64"], {"torch", "helper"}),
    ],
)
@pytest.mark.sweep
def test_which_wheels(at_home, monkeypatch, market, arguments, expected):
    # Nothing needs to be downloaded.
    monkeypatch.setattr(bundle, "CACHE", at_home / "full")
    (at_home / "full").mkdir()
    for python, platform in ((HERE, DEFAULT), ("3.13", DEFAULT), (HERE, "macosx_14_0_arm64")):
        shutil.copytree(market, at_home / "full" / f"{python}-{platform}", dirs_exist_ok=True)
    output = at_home / "bundle"
    bundle.bundle([*arguments, "--output", str(output)])
    warp = set() if "Warp_Lang" in arguments else {"warp_lang"}
    assert names_in_parts(output) == {"pip", "numpy"} | warp | expected
    if "--cuda" in arguments and expected:
        assert f"torch==={TORCH}\n" in (output / "requirements.txt").read_text()


@pytest.mark.parametrize(
    ("text", "python", "platform", "expected"),
    [
        ('a; python_version >= "3.12"', "3.12", "manylinux_2_28_x86_64", True),
        ('a; python_version >= "3.12"', "3.11", "manylinux_2_28_x86_64", False),
        ('a; python_full_version < "3.12.0"', "3.12", "manylinux_2_28_x86_64", False),
        ('a; sys_platform == "darwin"', "3.12", "macosx_14_0_arm64", True),
        ('a; platform_machine == "aarch64"', "3.12", "manylinux_2_28_aarch64", True),
        ('a; platform_machine == "x86_64" and os_name == "posix"', "3.12", "manylinux_2_28_x86_64", True),
        ('a; extra == "dev"', "3.12", "manylinux_2_28_x86_64", False),
    ],
)
def test_markers_are_those_of_the_other_machine(tmp_path, text, python, platform, expected):
    wheel = write_wheel(tmp_path, "thing", "1.0", (text,))
    assert bool(list(requirements(wheel, (), Target(python, platform).markers()))) is expected


def test_old_libraries_of_c_are_named_for_pip():
    flags = Target("3.12", "manylinux_2_28_x86_64").pip_flags()
    named = {value for flag, value in pairwise(flags) if flag == "--platform"}
    assert {"manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64", "linux_x86_64"} <= named
    assert "manylinux_2_29_x86_64" not in named


def test_a_pin_that_a_wheel_refuses_is_named(tmp_path, at_home):
    shelf = Shelf(tmp_path, Target(HERE, "manylinux_2_28_x86_64"), dict(PINS))
    with pytest.raises(WheelError, match=r"helper is needed as >=1.5, but constraints.txt allows 1.0 only"):
        shelf.fill([Requirement("helper>=1.5")])


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (["--python", "3.14"], 2, "'3.14' is not one of"),
        (["--python", "3" * 400], 2, "is not one of"),
        (["--platform", "amiga"], 2, "manylinux_2_28_x86_64"),
        (["--cuda", "--platform", "macosx_14_0_arm64"], 2, "no CUDA build"),
        (["--without", "pip"], 2, "install.sh works with it"),
        (["--without", "trch"], 2, "--without trch: simwarp needs no such package"),
        (["--unknown"], 2, "unrecognized arguments"),
        (["--output", ""], 2, "empty"),
        (["--output", "n" * 300], 2, "File name too long"),
        (["--output", "mine"], 2, "'thesis.tex', which is of no bundle"),
        (["--output", "mine/thesis.tex"], 2, "Not a directory"),
        (["--output", "mine/thesis.tex/bundle"], 2, "File exists"),
    ],
)
@pytest.mark.sweep
def test_wrong_input_is_one_line_and_changes_nothing(at_home, monkeypatch, capsys, arguments, code, expected):
    monkeypatch.chdir(at_home)
    (at_home / "mine").mkdir()
    (at_home / "mine" / "thesis.tex").write_text("mine")
    monkeypatch.setattr(sys, "argv", ["bundle", *arguments])
    assert bundle.main() == code
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert {path.name for path in at_home.iterdir()} <= {"mine", "cache"}
    assert (at_home / "mine" / "thesis.tex").read_text() == "mine"


def test_a_failed_run_keeps_the_earlier_bundle(at_home, monkeypatch, capsys):
    output = at_home / "bundle"
    bundle.bundle(["--without", "torch", "--output", str(output)])
    before = contents(output)
    monkeypatch.setenv("PIP_FIND_LINKS", "/nowhere")
    monkeypatch.setattr(sys, "argv", ["bundle", "--cuda", "--output", str(output)])
    assert bundle.main() == 1
    assert f"no torch {TORCH}" in capsys.readouterr().err
    assert contents(output) == before
    assert {path.name for path in at_home.iterdir()} == {"bundle", "cache"}


def install(folder, *arguments, cwd, python=sys.executable):
    """Run install.sh where every network would be a dead one."""
    dead = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9", "PYTHON": str(python)}
    return subprocess.run(
        ["sh", str(folder / "install.sh"), *arguments],
        cwd=cwd, env=os.environ | dead, capture_output=True, text=True, timeout=120,
    )  # fmt: skip


@pytest.mark.slow
def test_install_into_an_environment(made, tmp_path):
    done = install(made, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["simwarp-env"]
    assert (
        f"[3/3] simwarp 0.1.0 with torch {TORCH}+cpu starts: {tmp_path}/simwarp-env/bin/simwarp doctor" in done.stdout
    )


@pytest.mark.slow
def test_install_again_into_the_same_environment(made, tmp_path):
    assert install(made, cwd=tmp_path).returncode == 0
    site = next((tmp_path / "simwarp-env").glob("lib/python3*/site-packages"))
    (site / "simwarp.py").unlink()
    again = install(made, "--venv", str(tmp_path / "simwarp-env"), cwd=made.parent)
    assert again.returncode == 0, again.stderr
    assert (site / "simwarp.py").exists()


def test_install_into_a_folder(made, tmp_path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / ".simwarp-site").touch()
    (tmp_path / "site" / "old.py").touch()  # of an earlier version, which is replaced as a whole
    done = install(made, "--site", "site", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"PYTHONPATH={tmp_path}/site {sys.executable} -m simwarp doctor" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
    names = {path.name for path in (tmp_path / "site").iterdir()}
    assert {"simwarp.py", "torch.py", "warp.py"} <= names
    assert "old.py" not in names


def lose(path):
    path.unlink()


def damage(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("spoil", "name", "expected"),
    [
        (lose, "wheels.tar.002", "1 are missing: wheels.tar.002; bring them too"),
        (damage, "wheels.tar.003", "damaged (checksum differs): wheels.tar.003; bring them again"),
        (lose, "simwarp-0.1.0-py3-none-any.whl", "1 are missing: simwarp-0.1.0"),
        (lose, "SHA256SUMS", "SHA256SUMS: No such file"),
        (damage, "SHA256SUMS", "bring"),
        (lose, "bundle.json", "bundle.json is missing or damaged"),
    ],
)
def test_what_did_not_come_over_is_named(made, tmp_path, spoil, name, expected):
    folder = shutil.copytree(made, tmp_path / "came over")
    spoil(folder / name)
    done = install(folder, cwd=tmp_path)
    assert done.returncode == 1
    assert expected in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["came over"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--venv", "mine"], "mine is there and no virtual environment"),
        (["--site", "mine"], "mine holds something else"),
        (["--site", "mine/thesis.tex"], "mine/thesis.tex holds something else"),
        (["--site", "a", "--venv", "b"], "not allowed with"),
        (["--home", "a"], "unrecognized arguments"),
    ],
)
def test_install_keeps_what_is_there(made, tmp_path, arguments, expected):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    done = install(made, *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "thesis.tex"]


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("python", "3.9", "the bundle is for Python 3.9, and"),
        ("platform", "manylinux_2_28_vax", "the bundle is for manylinux_2_28_vax, this is"),
        (
            "without",
            ["torch"],
            f"the bundle leaves out torch; install into the environment that has it: --venv {sys.prefix}",
        ),
    ],
)
def test_a_bundle_for_another_machine_is_refused(made, tmp_path, key, value, expected):
    if key == "without" and sys.prefix == sys.base_prefix:
        pytest.skip("these tests run in no environment")
    folder = shutil.copytree(made, tmp_path / "came over")
    about = json.loads((folder / "bundle.json").read_text())
    (folder / "bundle.json").write_text(json.dumps(about | {key: value}))
    done = install(folder, cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_machine_that_lacks_what_was_left_out_is_told(at_home, tmp_path):
    bundle.bundle(["--without", "torch", "--output", str(at_home / "bundle")])
    done = install(at_home / "bundle", "--site", "site", cwd=tmp_path, python=BELOW)
    if done.returncode == 0:
        pytest.skip("the Python below this environment has torch")
    assert "it does not start: ModuleNotFoundError: No module named 'torch'; the bundle was written" in done.stderr
    assert done.stderr.count("\n") == 1
