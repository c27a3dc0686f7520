"""The set-up script asks for the right build of torch; nothing is installed here."""

import importlib.util
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def setup_env():
    spec = importlib.util.spec_from_file_location("setup_env", ROOT / "scripts" / "setup_env.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("system", "cuda", "online", "expected"),
    [
        ("Linux", True, True, ["torch===2.0"]),
        ("Linux", False, False, ["torch==2.0+cpu"]),
        ("Linux", False, True, ["torch==2.0+cpu", "--extra-index-url", "https://download.pytorch.org/whl/cpu"]),
        ("Darwin", False, True, ["torch==2.0"]),
    ],
)
def test_a_cpu_machine_never_asks_for_the_cuda_build(setup_env, monkeypatch, system, cuda, online, expected):
    monkeypatch.setattr(setup_env.platform, "system", lambda: system)
    monkeypatch.setattr(setup_env, "reachable", lambda url: online)
    assert setup_env.torch_request("2.0", cuda) == expected


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
def test_what_is_there_is_kept_if_it_fits(setup_env, found, cuda, expected):
    assert setup_env.fits(found, "2.0", cuda) is expected


def test_constraints_pin_every_direct_dependency(setup_env):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    names = {requirement.split(">=")[0] for requirement in wanted} - {"setuptools"}
    assert all(setup_env.pinned(name) for name in names)
