"""Warp starts silently, and compiling is one line."""

import os
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor, wait

import pytest
import warp as wp

from simwarp.core import warp_start
from simwarp.core.warp_start import COMPILING, report_compiling

FOUR_BAR = """
    import simwarp as sw
    from simwarp.scenes import four_bar
    simulation = sw.Simulation(four_bar().finalize(2, "cpu"), 0.001)
    simulation.step()
"""


def printed(code):
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_a_script_prints_what_it_prints_itself():
    sw_simulation = printed(FOUR_BAR)  # the first one may compile
    assert sw_simulation[0] == ""
    assert printed(FOUR_BAR) == ("", "")


def test_who_asks_warp_to_talk_is_told():
    out, _ = printed("import warp as wp\nwp.config.log_level = wp.LOG_DEBUG\n" + textwrap.dedent(FOUR_BAR))
    assert "Module simwarp.kernels" in out


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    monkeypatch.setattr(warp_start, "COMPILING_SHOWS", 0.02)
    return tmp_path


def compile_something(cache):
    """As Warp does: a folder of this process, for as long as it takes."""
    (cache / f"wp_module_p{os.getpid()}_t1").mkdir()
    time.sleep(0.5)


def test_compiling_is_one_line(cache, capsys):
    with report_compiling(), report_compiling():
        compile_something(cache)
    assert capsys.readouterr().err == f"simwarp: {COMPILING}\n"


def test_the_line_goes_where_it_is_said_to_go(cache, capsys):
    lines: list[str] = []
    with report_compiling(lines.append):
        compile_something(cache)
    assert lines == [COMPILING]
    assert capsys.readouterr().err == ""


def test_a_terminal_sees_how_long_it_takes(cache, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with report_compiling():
        compile_something(cache)
    said = capsys.readouterr().err
    assert said.startswith(f"\r\x1b[Ksimwarp: {COMPILING}; module 1, module, 0 s")
    assert said.endswith("\n")


def test_modules_are_counted_and_named(cache):
    """A second line comes after the time that was asked for, and only while something is compiled."""
    lines: list[str] = []
    with report_compiling(lines.append, every=0.1):
        for name in ("simwarp.kernels.first", "simwarp.tires_kernels"):
            folder = cache / f"wp_{name}_0123abc_p{os.getpid()}_t12"
            folder.mkdir()
            time.sleep(0.3)
            folder.rmdir()
        told = len(lines)
        time.sleep(0.3)
    assert lines[0] == COMPILING
    assert lines[1] == f"{COMPILING}; module 1, simwarp.kernels.first, 0 s"
    assert lines[-1].startswith(f"{COMPILING}; module 2, simwarp.tires_kernels, ")
    assert len(lines) <= told + 1


def test_without_compiling_nothing_is_told(cache, capsys):
    (cache / f"wp_module_p{os.getpid() + 1}_t1").mkdir()  # another process compiles
    with report_compiling():
        time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_a_silent_warp_is_silent(cache, capsys, monkeypatch):
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_ERROR)
    with report_compiling():
        compile_something(cache)
    assert capsys.readouterr().err == ""


def test_nobody_goes_on_before_warp_is_initialised(monkeypatch):
    """A second thread would otherwise make a runtime of its own, whose devices are others."""
    begun, go = threading.Event(), threading.Event()

    def init():
        begun.set()
        go.wait(60.0)

    monkeypatch.setattr(warp_start, "_started", threading.Event())
    monkeypatch.setattr(wp, "init", init)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(warp_start.start_warp)
        assert begun.wait(60.0)
        second = pool.submit(warp_start.start_warp)
        early, _ = wait([second], timeout=0.2)
        go.set()
        assert early == set()
        assert first.result(60.0) is second.result(60.0) is None


def fails(code, **variables):
    environment = os.environ | variables
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=300, env=environment
    )
    assert done.returncode == 1
    return done.stderr.splitlines()[-1]


def test_a_home_without_room_for_compiled_kernels_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / "cache"  # below a file there can be no folder, whoever asks for it
    told = fails(FOUR_BAR, WARP_CACHE_PATH=str(place))
    assert told.startswith(f"simwarp.core.warp_start.CacheError: the folder '{place}")
    assert told.endswith(
        "of compiled kernels cannot be used: Not a directory; set WARP_CACHE_PATH to a folder of your own"
    )


def test_a_kernel_that_cannot_be_written_is_one_line():
    """A cache that is read-only serves as long as all kernels are in it."""
    place = os.path.join(str(wp.config.kernel_cache_dir), "wp_module_p1_t1")
    with pytest.raises(warp_start.CacheError) as caught, report_compiling():
        raise OSError(30, "Read-only file system", place)
    assert str(caught.value) == (
        f"the folder '{place}' of compiled kernels cannot be used: Read-only file system; "
        "set WARP_CACHE_PATH to a folder of your own"
    )
    with pytest.raises(FileNotFoundError) as other, report_compiling():
        raise FileNotFoundError(2, "No such file or directory", "/some/mesh.stl")
    assert not isinstance(other.value, warp_start.CacheError)
