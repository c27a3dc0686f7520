"""Other systems, as far as this one can stand in for them: missing modules and signals, files that others hold open."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path, PureWindowsPath

import psutil
import pytest

from simwarp.cli import UsageError
from simwarp.cli.new_task import check_name
from simwarp.core import memory, operating_system as system
from simwarp.core.files import FileError, OutputError, check_output, write_file

TREES = "import importlib.util as u; s = u.spec_from_file_location('system', {path!r}); m = u.module_from_spec(s)"


@pytest.fixture
def windows(monkeypatch):
    """What asks for the system is told that it is Windows."""
    monkeypatch.setattr(system, "WINDOWS", True)


def in_another_process(setting, code):
    """Run the room by itself in a process whose standard modules lack something; what it prints."""
    lines = [setting, TREES.format(path=system.__file__), "s.loader.exec_module(m)", code]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_without_posix_signals_requests_are_ctrl_break_and_ends_are_terminate():
    names = ("SIGKILL", "SIGHUP", "SIGXFSZ")
    setting = "import signal\n" + "".join(f"del signal.{name}\n" for name in names) + "signal.CTRL_BREAK_EVENT = 1"
    assert in_another_process(setting, "print(m.STOP, m.KILL + 0, m.ended_by_file_size(-25))") == ["1", "15", "False"]


def test_without_sysconf_and_resource_psutil_counts_memory_and_there_is_no_limit():
    setting = "import os, psutil, sys\nsys.modules['resource'] = None\ndel os.sysconf"
    total, limit = in_another_process(setting, "print(m.total_memory(), m.address_space_limit())")
    assert int(total) == os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    assert limit == "None"


def test_where_linux_does_not_count_psutil_does(monkeypatch, tmp_path):
    """Both read the same counter of the kernel, moments apart: a quarter covers what others allocate meanwhile."""
    by_linux = memory._meminfo()
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "absent")
    assert memory._meminfo() == pytest.approx(by_linux, rel=0.25)


def test_without_psutil_memory_is_not_known_but_no_error(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "psutil", None)
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "absent")
    assert memory._meminfo() == []
    assert system.process_started(os.getpid()) == ""


def test_a_process_is_known_by_its_start():
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    started = system.process_started(child.pid)
    assert started is not None
    assert float(started) == pytest.approx(time.time(), abs=60.0)  # of this minute, by the same clock
    child.communicate(b"\n")
    assert system.process_started(child.pid) is None
    assert system.process_started(os.getpid()) == str(psutil.Process().create_time())


def test_a_session_of_its_own_on_both_kinds_of_systems(monkeypatch):
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, **system.own_session())
    assert os.getsid(child.pid) == child.pid
    child.communicate(b"\n")
    monkeypatch.setattr(system, "WINDOWS", True)
    assert system.own_session() == {"creationflags": 0x200}  # CREATE_NEW_PROCESS_GROUP of winbase.h


def test_a_process_that_does_not_listen_yet_ends_with_a_known_code():
    child = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(60)"])
    os.kill(child.pid, system.STOP)
    assert child.wait(30.0) in system.STOPPED_UNHEARD


@pytest.mark.parametrize("name", ["con", "AUX", "nul.txt", "Com1", "lpt9.tar.gz", "prn .json", "CONOUT$"])
def test_devices_of_windows_are_no_names(name):
    assert system.is_reserved(name)
    assert PureWindowsPath(name).is_reserved()


@pytest.mark.parametrize("name", ["cone", "auxiliary.py", "com10", "nul_.txt", "run.con", ".con", "com0"])
def test_other_names_are_free(name):
    assert not system.is_reserved(name)


def test_a_file_with_the_name_of_a_device_is_refused_on_windows_alone(tmp_path, monkeypatch):
    for name, reason in (("aux.json", "is a device"), ("a:b.csv", "has :"), ("what?.csv", r"has \?")):
        write_file(tmp_path / name, "x")
        monkeypatch.setattr(system, "WINDOWS", True)
        with pytest.raises(FileError, match=f"--json: the name '.*' {reason}.*; choose another name") as caught:
            check_output(tmp_path / name, "--json")
        assert "\n" not in str(caught.value)
        monkeypatch.setattr(system, "WINDOWS", False)


def test_a_device_itself_is_written_to_on_windows_too(windows):
    assert check_output(os.devnull) == Path(os.devnull)


def test_a_package_with_the_name_of_a_device_is_made_nowhere():
    for name in ("aux", "con", "lpt1"):
        with pytest.raises(UsageError, match=f"'{name}' is a device of Windows"):
            check_name(name)


@pytest.fixture
def held(monkeypatch):
    """A file that another process holds open, as Windows says it: the first `held[0]` replacements are refused."""
    left, replace = [3], Path.replace

    def refuse(draft, target):
        if left[0] > 0:
            left[0] -= 1
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(draft))
        return replace(draft, target)

    monkeypatch.setattr(Path, "replace", refuse)
    return left


def test_a_file_that_is_read_for_a_moment_is_replaced_afterwards(windows, held, tmp_path):
    write_file(tmp_path / "f", "new")
    assert (tmp_path / "f").read_text(encoding="utf-8") == "new"
    assert held == [0]


@pytest.mark.parametrize("on_windows", [False, True])
def test_a_file_that_stays_open_is_one_line_and_stays_as_it_is(on_windows, held, tmp_path, monkeypatch):
    (tmp_path / "f").write_text("old", encoding="utf-8")
    monkeypatch.setattr(system, "WINDOWS", on_windows)
    monkeypatch.setattr(system, "PATIENCE", 0.05)
    held[0] = 10**9
    with pytest.raises(OutputError, match="cannot write"):
        write_file(tmp_path / "f", "new")
    assert [path.read_text(encoding="utf-8") for path in tmp_path.iterdir()] == ["old"]
    assert (held[0] < 10**9 - 1) is on_windows  # it was tried again


def test_a_device_is_written_to_where_there_is_no_nonblock(monkeypatch):
    monkeypatch.delattr(os, "O_NONBLOCK")
    write_file(os.devnull, "x")
    assert Path(os.devnull).is_char_device()  # no file has taken its place


def test_ctrl_break_is_heard_where_it_is():
    code = "import signal\nsignal.SIGBREAK = signal.SIGUSR1\ndel signal.SIGHUP\n"
    code += "from simwarp.core.stopping import stop_on_signals\nwith stop_on_signals() as stop:\n"
    code += "    signal.raise_signal(signal.SIGBREAK)\n    print(stop.requested)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]


def square(number):
    """In a process that was started anew."""
    return number * number


def test_a_spawned_process_finds_what_it_is_given():
    """`spawn`, the way of Windows and macOS, imports modules anew: nothing in the package may rely on `fork`."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(square, [3]) == [9]


def test_signals_of_this_system_are_those_of_posix():
    assert (system.STOP, system.KILL) == (signal.SIGTERM, signal.SIGKILL)
