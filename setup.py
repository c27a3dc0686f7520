"""Build step that pyproject.toml cannot say: `simwarp/tasks` and `simwarp/train` as folders in every checkout.

They are symbolic links. A clone without them (Windows by default, some network drives) has text files in their
place, and would be packaged without its tasks.
"""

import os
import shutil
import sys
from pathlib import Path

from setuptools import setup  # type: ignore[import-untyped]

ROOT = Path(__file__).resolve().parent
LINKED = ("tasks", "train")


def join_folder(name: str) -> None:
    """Put a link to a top-level folder in the place of the text that git left there; a copy where none can be made."""
    link, folder = ROOT / "simwarp" / name, ROOT / name
    if not link.is_file() or not folder.is_dir():
        return
    link.unlink()
    try:
        link.symlink_to(Path("..") / name, target_is_directory=True)
    except OSError:
        if not _join_on_windows(folder, link):
            shutil.copytree(folder, link)


def _join_on_windows(folder: Path, link: Path) -> bool:
    """Make a junction, for which Windows demands no right; False elsewhere, and where the drive has none."""
    if sys.platform != "win32":
        return False
    import _winapi

    try:
        _winapi.CreateJunction(os.fspath(folder), os.fspath(link))
    except OSError:
        return False
    return True


for linked in LINKED:
    join_folder(linked)
setup()
