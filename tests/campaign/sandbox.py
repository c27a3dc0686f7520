"""A folder full of bystanders: files, links, a FIFO and device nodes that no wrong input may change."""

import contextlib
import hashlib
import os
import shutil
import stat
import tempfile
from pathlib import Path
from typing import NamedTuple

DEPTH = ("a", "b", "work")
"""Folders below the root: `../..` stays inside, and is looked at too."""

TEXT_FILES = {"notes.txt": "keep me\n", "table.csv": "t_s,throttle\n0,0\n1,1\n", "folder/keep.txt": "keep me too\n"}
NODES = ("notes.txt", "link", "dangling", "pipe", "null", "full", "folder")
"""What stands in the working folder beside the material."""


class Entry(NamedTuple):
    """What there is to know about a path without reading it."""

    mode: int
    device: int
    size: int
    changed: int
    inode: int
    leads_to: str


class Sandbox:
    """Bystanders below `root`; commands run in `work` and keep their temporary files in `scratch`.

    Args:
        root: an empty folder.
        material: files and folders that are copied into the working folder.
    """

    def __init__(self, root: Path, material: Path | None = None) -> None:
        self.root, self.material = root, material
        self.work = root.joinpath(*DEPTH)
        self.scratch = root / "scratch"
        self.has_devices = True
        self._lay_out()

    def _lay_out(self) -> None:
        """Everything anew."""
        for path in (self.root / DEPTH[0], self.scratch):
            shutil.rmtree(path, ignore_errors=True)
        self.work.mkdir(parents=True)
        self.scratch.mkdir()
        (self.work / "folder").mkdir()
        for name, text in TEXT_FILES.items():
            (self.work / name).write_text(text)
        (self.work / "link").symlink_to("notes.txt")
        (self.work / "dangling").symlink_to("nothing-here.txt")
        os.mkfifo(self.work / "pipe")
        try:
            os.mknod(self.work / "null", stat.S_IFCHR | 0o666, os.makedev(1, 3))
            os.mknod(self.work / "full", stat.S_IFCHR | 0o666, os.makedev(1, 7))
        except PermissionError:  # only root makes devices
            self.has_devices = False
        if self.material is not None:
            shutil.copytree(self.material, self.work, dirs_exist_ok=True, symlinks=True)
        self.entries = self._entries()
        self.contents = {path: self._digest(path) for path in self.entries}

    def _entries(self) -> dict[Path, Entry]:
        found = {}
        for folder, folders, files in os.walk(self.root):
            for name in (*folders, *files):
                path = Path(folder) / name
                info = path.lstat()
                leads_to = os.readlink(path) if stat.S_ISLNK(info.st_mode) else ""
                folderish = stat.S_ISDIR(info.st_mode)
                numbers = (0, 0) if folderish else (info.st_size, info.st_mtime_ns)
                found[path] = Entry(info.st_mode, info.st_rdev, *numbers, 0 if folderish else info.st_ino, leads_to)
        return found

    @staticmethod
    def _digest(path: Path) -> str:
        return hashlib.sha256(path.read_bytes()).hexdigest() if stat.S_ISREG(path.lstat().st_mode) else ""

    def changes(self) -> dict[Path, str]:
        """What is not as it was, by path: new, gone, of another kind, or of other content."""
        now = self._entries()
        if now == self.entries:
            return {}
        found = dict.fromkeys(now.keys() - self.entries.keys(), "new")
        found |= dict.fromkeys(self.entries.keys() - now.keys(), "gone")
        for path in now.keys() & self.entries.keys():
            before, after = self.entries[path], now[path]
            if before == after:
                continue
            kind = (before.mode, before.device, before.leads_to) != (after.mode, after.device, after.leads_to)
            if kind:
                found[path] = "of another kind"
            elif self._digest(path) != self.contents[path]:
                found[path] = "of other content"
        return found

    def restore(self) -> None:
        """Bring back what `changes` found; cheap where only new files came."""
        found = self.changes()
        if any(what != "new" for what in found.values()):
            self._lay_out()
            return
        for path in sorted(found, key=lambda path: len(path.parts), reverse=True):
            with contextlib.suppress(OSError):
                path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
        self.entries = self._entries()

    @contextlib.contextmanager
    def inside(self):
        """Run in the working folder, with temporary files in the sandbox."""
        before, place, variable = Path.cwd(), tempfile.tempdir, os.environ.get("TMPDIR")
        os.chdir(self.work)
        tempfile.tempdir = str(self.scratch)
        os.environ["TMPDIR"] = str(self.scratch)
        try:
            yield
        finally:
            os.chdir(before)
            tempfile.tempdir = place
            os.environ.pop("TMPDIR") if variable is None else os.environ.update(TMPDIR=variable)
