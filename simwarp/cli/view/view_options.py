"""Options of ``simwarp view``."""

from __future__ import annotations

import dataclasses
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from simwarp.cli import UsageError
from simwarp.cli.options import CommonOptions

if TYPE_CHECKING:
    from simwarp.viewer.live.web_server import WebServer

LONGEST = 86_400.0
"""Of --seconds."""
ACTORS = ("shipped", "zero", "random")
"""Words for --checkpoint that name no file."""


@dataclasses.dataclass(frozen=True)
class ViewOptions(CommonOptions):
    """Open a page that shows a task, a vehicle, a scene, a model file or the dump of a broken world as it moves."""

    worlds: int | None = None
    """Worlds that are simulated and shown; by default 16 of a task or scene, 1 of a vehicle or model file."""
    layout: Literal["grid", "overlay", "one"] | None = None
    """Worlds side by side, all in the scenery of one, or one alone; by default what suits their size."""
    port: int = 8080
    """Of the page; the next free one is taken."""
    host: str = "127.0.0.1"
    """Address to serve on; others than this machine's own need the token that is printed."""
    speed: float = 1.0
    """Times real time; 0: as fast as it goes."""
    paused: bool = False
    """Begin paused."""
    open: bool = True
    """Open a browser."""
    seconds: float | None = None
    """End after this much time by the clock [s]; with --record of simulated time, at full speed, without a browser."""
    record: Path | None = None
    """Record to this file from the start: .html, which plays in any browser, .viser, or .mcap for tools of ROS 2."""
    drive: bool = False
    """Drive by hand at once: the page's keys and gamepad, the camera behind the vehicle."""
    keys: Literal["smooth", "chrono"] = "smooth"
    """Of driving: a held key moves its input to the end, or steps its target as Chrono's driver does."""
    road: str | None = None
    """Below a vehicle: a random road of ISO 8608, iso8608:CLASS[:SEED], or a .json or .crg file."""
    base: Literal["fixed", "floating"] | None = None
    """Of a URDF: its root link is welded to the world, or floats."""
    allow: tuple[str, ...] = ()
    """Kinds of refused elements of a model file to drop."""
    packages: tuple[str, ...] = ()
    """Folders of a URDF's packages, NAME=FOLDER each."""
    density: float | None = None
    """Of all parts of a STEP file, or of the links of a URDF whose mass it does not tell [kg/m³]."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""


@dataclasses.dataclass(frozen=True)
class TaskViewOptions(ViewOptions):
    """Open a page that shows a task under a policy."""

    checkpoint: str | None = None
    """Checkpoint file or run folder, `shipped`, `zero` or `random`; by default the newest run, else the shipped one."""
    reload: Path | None = None
    """Run folder, of a training that may still go on: its newest checkpoint acts, and newer ones as they come."""
    seed: int = 1_000_003
    """Seed of the worlds."""
    runs: Path = Path("runs")
    """Folder of the run folders."""
    record_trajectories: Path | None = None
    """Write what is driven by hand to this .npz file, which `simwarp clone` reads."""


def announce(server: WebServer, options: ViewOptions) -> None:
    """Prints the address of a page, and opens a browser on it."""
    if server.token in server.url:
        print(f"warning: view: everybody who can reach {options.host} and has this address can look", file=sys.stderr)
    options.console().print(f"view  {server.url}", highlight=False, soft_wrap=True)
    if options.open:
        webbrowser.open(server.url)


def check_view_options(options: ViewOptions) -> None:
    """Refuse what no page can be opened with.

    Raises:
        UsageError: a value is out of bounds, or two outputs are one file.
        FileError: an output cannot be written.
    """
    trajectories = options.record_trajectories if isinstance(options, TaskViewOptions) else None
    if trajectories is not None and trajectories.suffix != ".npz":
        raise UsageError(f"--record-trajectories must end in .npz, got '{trajectories}'")
    if options.record is not None:
        from simwarp.cli.view.view_record import check_view_record

        check_view_record(options.record)
    options.check(record=options.record, record_trajectories=trajectories)
    if options.road is not None:
        from simwarp.cli.drive.drive_road import check_road_option

        check_road_option(options.road)
    if options.seconds is not None and not 0.0 < options.seconds <= LONGEST:
        raise UsageError(f"seconds must be positive and at most {LONGEST:g}, got {options.seconds:g}")
    if options.worlds is not None and not 1 <= options.worlds <= 65536:
        raise UsageError(f"worlds must be from 1 to 65536, got {options.worlds}")
    if not 0.0 <= options.speed <= 1000.0:
        raise UsageError(f"speed must be from 0 (as fast as it goes) to 1000, got {options.speed:g}")
