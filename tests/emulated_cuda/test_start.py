"""How the emulated device starts: what it needs, what the environment may say, and a cache that processes share."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.emulated_cuda import settings
from tests.emulated_cuda.emulated_runs import HERE, ROOT, skip_where_unavailable
from tests.emulated_cuda.settings import Check, Settings, StreamOrder


def test_without_a_compiler_one_line_says_so(tmp_path):
    environment = {**os.environ, "PATH": str(tmp_path)}
    command = [sys.executable, str(HERE), "-c", "raise SystemExit(0)"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "install a C and C++ compiler" in done.stderr or "x86-64 Linux" in done.stderr


@pytest.mark.parametrize(("system", "machine"), [("darwin", "arm64"), ("linux", "aarch64"), ("win32", "AMD64")])
def test_other_machines_are_named(monkeypatch, system, machine):
    monkeypatch.setattr(settings.sys, "platform", system)
    monkeypatch.setattr(settings.platform, "machine", lambda: machine)
    assert settings.why_unavailable() == f"the emulated CUDA device needs x86-64 Linux, not {machine} {system}"


def test_the_environment_sets_it(monkeypatch, tmp_path):
    for name in ("CHECK", "SEED", "STREAMS", "CACHE", "REPORT"):
        monkeypatch.delenv(f"EMULATED_CUDA_{name}", raising=False)
    plain = Settings.from_environment()
    assert (plain.check, plain.seed, plain.streams, plain.report) == (Check.MEMORY, 1, StreamOrder.EAGER, False)
    assert plain.cache.name == "simwarp-emulated-cuda"
    values = {"CHECK": "race", "SEED": "7", "STREAMS": "lazy", "CACHE": str(tmp_path), "REPORT": "1"}
    for name, value in values.items():
        monkeypatch.setenv(f"EMULATED_CUDA_{name}", value)
    chosen = Settings.from_environment()
    assert (chosen.check, chosen.seed, chosen.streams, chosen.report) == (Check.RACE, 7, StreamOrder.LAZY, True)
    assert chosen.cache == tmp_path
    monkeypatch.setenv("EMULATED_CUDA_CHECK", "all")
    with pytest.raises(ValueError, match="'all' is not a valid Check"):
        Settings.from_environment()


@pytest.mark.slow
def test_two_processes_build_into_one_cache(tmp_path):
    skip_where_unavailable()
    code = (
        "import ctypes, pathlib, sys; from tests.emulated_cuda.native.native_library import runtime_library; "
        "ctypes.CDLL(str(runtime_library(pathlib.Path(sys.argv[1]))))"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    both = [subprocess.Popen(command, cwd=ROOT) for _ in range(2)]
    assert [each.wait(timeout=120) for each in both] == [0, 0]
    assert len(list(tmp_path.iterdir())) == 1


def test_warp_may_first_be_asked_for_the_stream_of_torch():
    skip_where_unavailable()
    text = (
        "import torch; from simwarp.core.interop import shared_stream; torch.zeros(1, device='cuda:0')\n"
        "with shared_stream('cuda:0') as stream: print('stream', stream is not None)"
    )
    command = [sys.executable, str(HERE), "-c", text]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "stream True" in done.stdout, done.stderr
