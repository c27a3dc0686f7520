"""Wheels of a few hundred bytes and folders of them, laid out as pip finds packages."""

import zipfile
from pathlib import Path


def write_wheel(
    folder: Path,
    name: str,
    version: str,
    requires: tuple[str, ...] = (),
    module: str = "",
    extras: tuple[str, ...] = (),
) -> Path:
    """A valid wheel for any machine with one module that knows its version."""
    info = f"{name}-{version}.dist-info"
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    metadata += "".join(f"Provides-Extra: {extra}\n" for extra in extras)
    files = {
        f"{module or name}.py": f"__version__ = {version!r}\n",
        f"{info}/METADATA": metadata + "".join(f"Requires-Dist: {text}\n" for text in requires),
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{info}/RECORD"] = "".join(f"{path},,\n" for path in (*files, f"{info}/RECORD"))
    folder.mkdir(parents=True, exist_ok=True)
    wheel = folder / f"{name}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for path, text in files.items():
            archive.writestr(zipfile.ZipInfo(path), text)  # the same bytes each time
    return wheel


def write_index(folder: Path, *wheels: tuple[str, str]) -> str:
    """A simple package index with these names and versions; its address."""
    for name, version in wheels:
        wheel = write_wheel(folder / name, name, version)
        with (folder / name / "index.html").open("a") as page:
            page.write(f'<a href="{wheel.name.replace("+", "%2B")}">{wheel.name}</a><br>\n')
    return folder.as_uri()
