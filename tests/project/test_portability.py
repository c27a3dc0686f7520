"""What Linux, macOS and Windows need of every source: named encodings, no modules of one system, names for all."""

import ast
import subprocess
from pathlib import Path, PureWindowsPath

import pytest

from simwarp.core.operating_system import is_reserved

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("simwarp", "tasks", "train", "scripts", "benchmarks", "examples", "setup.py")
POSIX = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog", "posix"}
# Calls that Windows does not know, or that mean something else there: os.kill(pid, 0) is Ctrl-C
POSIX_CALLS = {
    "fork", "forkpty", "getuid", "geteuid", "getgid", "getpgid", "getppid", "killpg", "kill", "mkfifo", "mknod", "nice",
    "pread", "pwrite", "setsid", "statvfs", "sysconf", "uname", "wait", "waitpid",
    "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK",
}  # fmt: skip
# Module -> what it may use, with a way beside it where the system has none
OF_THE_SYSTEM = {
    "simwarp/core/operating_system.py": {"resource", "sysconf", "O_NONBLOCK"},
    # The page size, behind a limit that only systems with `resource` have
    "simwarp/core/memory.py": {"sysconf"},
    # Behind WINDOWS; with KILL and STOP
    "train/runs/run_lock.py": {"kill"},
    "train/sweeps/launchers.py": {"kill"},
    # Set-up of a checkout, with nothing installed
    "scripts/setup_env.py": {"fcntl"},
}
LONGEST_PATH = 150
"""Windows takes 259 characters unless it was set to take more; a checkout lies in a folder of its own."""


def sources():
    """All modules with their syntax trees."""
    for name in SOURCES:
        folder = ROOT / name
        for path in sorted(folder.rglob("*.py")) if folder.is_dir() else [folder]:
            relative = path.relative_to(ROOT).as_posix()
            if not relative.startswith(("simwarp/tasks/", "simwarp/train/", "examples/robots/")):
                yield relative, ast.parse(path.read_text(encoding="utf-8"))


def name_of(node):
    """Last word of a name such as `os.fork`."""
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def owner_of(node):
    """Word before the last dot."""
    return name_of(node.value) if isinstance(node, ast.Attribute) else ""


def unspecified_text(call):
    """True if a call reads or writes text in whatever encoding the system prefers."""
    name, owner = name_of(call.func), owner_of(call.func)
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    if "encoding" in given or None in given:
        return False
    if name == "read_text":
        return not call.args and owner != "files"
    if name == "write_text":
        return len(call.args) == 1
    if name in ("run", "Popen", "check_output") and owner == "subprocess":
        return "text" in given or "universal_newlines" in given
    if name == "TextIOWrapper":
        return True
    if name != "open" or owner in ("os", "tarfile", "webbrowser", "Image", "RoadSurface", "zipfile"):
        return False
    place = 1 if isinstance(call.func, ast.Name) or owner in ("io", "gzip") else 0
    mode = given.get("mode", call.args[place] if len(call.args) > place else ast.Constant("r"))
    return not (isinstance(mode, ast.Constant) and "b" in str(mode.value))


def text_files(tree):
    """Lines of calls without an encoding."""
    return [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Call) and unspecified_text(node)]


def of_one_system(tree):
    """Modules and calls of POSIX that a module uses."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & POSIX
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or ""} & POSIX
        elif isinstance(node, ast.Attribute) and owner_of(node) == "os":
            found |= {node.attr} & POSIX_CALLS
        elif isinstance(node, ast.Attribute) and owner_of(node) == "signal":
            found |= {node.attr} & {"SIGKILL", "SIGHUP", "SIGXFSZ", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGCHLD", "alarm"}
    return found


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("open('f')", True),
        ("open('f', 'wb')", False),
        ("open('f', encoding='utf-8')", False),
        ("path.open('w')", True),
        ("path.open('rb')", False),
        ("path.read_text()", True),
        ("path.write_text('x')", True),
        ("path.write_text('x', encoding='utf-8')", False),
        ("subprocess.run(c, text=True)", True),
        ("subprocess.run(c, capture_output=True)", False),
        ("os.open('f', os.O_RDONLY)", False),
    ],
)
def test_the_search_for_encodings_finds_what_it_should(code, expected):
    assert bool(text_files(ast.parse(code))) is expected


def test_text_is_read_and_written_in_a_named_encoding():
    assert {name: lines for name, tree in sources() if (lines := text_files(tree))} == {}


def test_what_one_system_alone_has_is_in_one_room():
    found = {name: used for name, tree in sources() if (used := of_one_system(tree))}
    assert found == OF_THE_SYSTEM


def test_the_way_to_other_processes_is_spawn():
    """Windows has no other; where there is a choice, macOS and Python 3.14 do not fork either."""
    methods = []
    for name, tree in sources():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and name_of(node.func) in ("get_context", "set_start_method"):
                methods.append((name, [ast.literal_eval(argument) for argument in node.args]))
            assert not (isinstance(node, ast.ImportFrom) and node.module == "multiprocessing"), name
    assert all(given == ["spawn"] for _, given in methods)


@pytest.fixture(scope="module")
def tracked():
    """Paths of the repository."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("no git repository: an sdist")
    return [name for name in listed.stdout.split("\0") if name]


def test_no_two_paths_differ_by_case_only(tracked):
    folders = {parent.as_posix() for name in tracked for parent in Path(name).parents}
    paths = sorted({*tracked, *folders})
    assert len({path.casefold() for path in paths}) == len(paths)


def test_all_paths_are_names_for_windows(tracked):
    for name in tracked:
        parts = PureWindowsPath(name).parts
        assert parts == tuple(name.split("/")), name
        assert not any(is_reserved(part) or part.endswith((".", " ")) for part in parts), name
        assert not set(name) & set('<>:"|?*\\'), name
        assert name.isascii(), name
        assert name.isprintable(), name
        assert len(name) <= LONGEST_PATH, name


def test_text_of_a_checkout_ends_its_lines_alike(tracked):
    listed = subprocess.run(["git", "ls-files", "--eol"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    rows = [line.split(maxsplit=3) for line in listed.splitlines()]
    crlf = [name.strip() for index, *_, name in rows if index in ("i/crlf", "i/mixed")]
    assert all(name.split("\t")[-1].startswith("tests/data/") for name in crlf), crlf
    attributes = (ROOT / ".gitattributes").read_text(encoding="utf-8")
    assert "* text=auto eol=lf" in attributes
    binary = {Path(line.split("\t")[-1]).suffix for line in listed.splitlines() if line.startswith("i/-text")}
    assert {suffix for suffix in binary if f"*{suffix} binary" not in attributes} == set()
