"""``simwarp import``: what becomes of a robot's file, in tables; the robot saved and drawn."""

from __future__ import annotations

import dataclasses
import math
import shlex
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, UsageError
from simwarp.cli.options import CommonOptions, parse_options, split_path
from simwarp.cli.robots.robot_sources import Base, Format, RobotOptions, SelfCollisionWord, load_file
from simwarp.core.types import Dof, ModelError, PositionDrive, VelocityMotor
from simwarp.core.warp_start import report_compiling
from simwarp.importers.imported import Imported
from simwarp.importers.report import Fate, ReportLine
from simwarp.importers.saved_robot import save_robot
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.specifications import JointSpec
from simwarp.simulation.state_check import Overlap, PassedLimit, StateFaults, initial_faults

MOST_NAMED = 6
"""Names of equal lines of the report that a table lists."""


@dataclasses.dataclass(frozen=True)
class ImportOptions(CommonOptions):
    """Read a robot from MJCF, URDF, USD, STEP or a SolidWorks-Chrono export, and tell what became of every element.

    What is held has the same equations, what is near has others, what is refused stops the import unless --allow drops
    its kind.
    """

    base: Base | None = None
    """Of a URDF: its root link is welded to the world, or floats."""
    allow: tuple[str, ...] = ()
    """Kinds of refused elements to drop, as the error names them."""
    packages: tuple[str, ...] = ()
    """Folders of a URDF's packages, NAME=FOLDER each."""
    density: float | None = None
    """Of all parts of a STEP file, or of the links of a URDF whose mass it does not tell [kg/m³]."""
    up: Literal["y", "z"] | None = None
    """Vertical axis of a SolidWorks export."""
    self_collision: SelfCollisionWord | None = None
    """Whether the robot's own parts touch each other, in place of what the file says: all pairs, none, all but those of
    bodies that a joint ties, or those of the file that do not overlap as built."""
    save: Path | None = None
    """Write the robot, without what only shows, to this .json file."""
    picture: Path | None = None
    """Draw the robot into this .png file: in its keyframe `home`, else in its first one, else as built."""


def run(arguments: list[str]) -> int:
    """Import as the arguments say."""
    path, arguments = split_path(arguments, "import", "FILE")
    options = parse_options(ImportOptions, arguments, "simwarp import FILE")
    options.check(path, save=options.save, picture=options.picture)
    for target, suffix in ((options.save, ".json"), (options.picture, ".png")):
        if target is not None and target.suffix.lower() != suffix:
            raise UsageError(f"cannot write '{target}': the name must end in {suffix}")
    begin = time.perf_counter()
    kind, robot = load_file(
        path, RobotOptions(
            options.base, options.allow, options.packages, options.density, options.up, options.self_collision
        ),
    )  # fmt: skip
    wall = time.perf_counter() - begin
    console = options.console()
    with report_compiling(partial(console.print, highlight=False)):
        faults = _faults(robot)
    _print_summary(console, path, kind, robot, faults, options, wall)
    if options.save is not None:
        save_robot(robot, options.save)
        console.print(f"wrote {options.save}", highlight=False, soft_wrap=True)
    if options.picture is not None:
        with report_compiling(partial(console.print, highlight=False)):
            _draw(robot, options.picture)
        console.print(f"wrote {options.picture}", highlight=False, soft_wrap=True)
    _print_next(console, path, kind, options)
    options.emit(_results(path, kind, robot, faults, wall, options))
    return DONE


# ---- for people ------------------------------------------------------------------------------------------------------


def _print_summary(
    console: Console, path: Path, kind: Format, robot: Imported, faults: StateFaults, options: ImportOptions,
    wall: float,
) -> None:  # fmt: skip
    builder = robot.builder
    facts = {
        "file": f"{path.name} ({kind.title}), read in {wall:.2f} s",
        "mass": f"{robot.mass:.6g} kg in {len(robot.bodies)} bodies",
        "moves": f"{builder.dof_count} coordinates of {len(robot.dofs)} joints, {len(robot.actuators)} actuators",
        "touches": f"{len(builder.shapes)} shapes of contact",
    }
    told = [f"{len(robot.report.of(fate))} {fate.value}" for fate in Fate]
    facts["elements"] = ", ".join(told)
    if robot.timestep is not None:
        facts["time step"] = f"{robot.timestep:g} s"
    endless = [line.name for line in robot.report.near if line.element == "limit"]
    if endless:
        named = ", ".join(endless[:2]) + (f" and {len(endless) - 2} more" if len(endless) > 2 else "")
        facts["warning"] = f"{len(endless)} joint{'s have' if len(endless) > 1 else ' has'} no limits: {named}"
    facts |= {
        name: _first(found) for name, found in (("overlaps", faults.overlaps), ("outside", faults.limits)) if found
    }
    if faults.overlaps and options.self_collision is None and "self_collision" in kind.options:
        facts["overlaps"] += "; --self-collision overlapping-off keeps such pairs apart"
    for name, words in facts.items():
        console.print(f"{name:<10} {words}", highlight=False, soft_wrap=True)
    rows: list[tuple[str, ...]] = [(name, f"{builder.bodies[body].mass:.5g}") for name, body in robot.bodies.items()]
    _print_table(console, ("body", "mass [kg]"), rows, right=(1,))
    _print_table(console, ("joint", "type", "column", "limits", "driven by"), _joint_rows(robot), right=(2,))
    _print_table(console, ("actuator", "law", "moves", "control"), _actuator_rows(robot))
    _print_table(console, ("fate", "element", "count", "names, or reason"), _report_rows(robot), right=(2,))


def _first(found: Sequence[Overlap | PassedLimit]) -> str:
    """The first few of a list."""
    more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
    return ", ".join(map(str, found[:MOST_NAMED])) + more


def _print_table(
    console: Console, heads: tuple[str, ...], rows: list[tuple[str, ...]], right: tuple[int, ...] = ()
) -> None:
    """A table, or nothing where it would be empty."""
    if not rows:
        return
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for index, head in enumerate(heads):
        table.add_column(head, justify="right" if index in right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    console.print()
    console.print(table, highlight=False, markup=False)


def _joint_rows(robot: Imported) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, column in robot.dofs.items():
        index, local = robot.builder.coordinate_of(column)
        joint = robot.builder.joints[index]
        count = len(joint.dofs)
        columns = f"{column}" if count == 1 else f"{column}-{column + count - 1}"
        dof = joint.dofs[local]
        limits = _range(dof.limit, "" if dof.limit is None else _unit(joint, local)) if count == 1 else ""
        rows.append((name, joint.type.name.lower(), columns, limits, _driver(robot, column, dof)))
    return rows


def _unit(joint: JointSpec, local: int) -> str:
    return " rad" if ELEMENTS[joint.type].dofs[local].kind.name.startswith(("ANGLE", "SHAFT")) else " m"


def _range(limit: tuple[float, float] | None, unit: str = "") -> str:
    return "" if limit is None else f"{limit[0]:.4g} to {limit[1]:.4g}{unit}"


def _driver(robot: Imported, column: int, dof: Dof) -> str:
    """What moves a coordinate: actuators by name, else its drive."""
    names = [spec.name for spec in robot.actuators if column in [term[0] for term in spec.terms]]
    if names:
        return ", ".join(names)
    match dof.drive:
        case PositionDrive():
            return "position drive"
        case VelocityMotor():
            return "velocity motor"
    return ""


def _actuator_rows(robot: Imported) -> list[tuple[str, ...]]:
    joints = {column: name for name, column in (*robot.tendons.items(), *robot.dofs.items())}
    rows: list[tuple[str, ...]] = []
    for spec in robot.actuators:
        terms = [
            f"{'' if factor == 1.0 else f'{factor:g} '}{joints.get(column, column)}" for column, factor in spec.terms
        ]
        moves = " + ".join(terms) if spec.site is None else f"a site on '{robot.builder.bodies[spec.site.body].name}'"
        law = f"{spec.law.name.lower()}{f', {spec.activation.name.lower()}' if spec.has_activation else ''}"
        rows.append((spec.name, law, moves, _range(spec.ctrl_range)))
    return rows


def _report_rows(robot: Imported) -> list[tuple[str, ...]]:
    """Equal lines of the report as one."""
    groups: dict[tuple[str, str, str], list[ReportLine]] = {}
    for line in robot.report.lines:
        groups.setdefault((line.fate.value, line.element, line.reason), []).append(line)
    rows: list[tuple[str, ...]] = []
    order = [fate.value for fate in Fate]
    for (fate, element, reason), lines in sorted(groups.items(), key=lambda group: order.index(group[0][0])):
        names = [line.name for line in lines if line.name]
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        told = ", ".join(names[:MOST_NAMED]) + more
        rows.append((fate, element, str(len(lines)), f"{told}: {reason}" if told and reason else told or reason))
    return rows


def _print_next(console: Console, path: Path, kind: Format, options: ImportOptions) -> None:
    given = f" --base {options.base}" if options.base else ""
    given += f" --density {options.density:g}" if options.density else ""
    given += f" --allow {shlex.join(options.allow)}" if options.allow else ""
    given += f" --packages {shlex.join(options.packages)}" if options.packages else ""
    argument = f', base="{options.base}"' if options.base else ""
    argument += f", density={options.density:g}" if options.density else ""
    argument += f", allow={list(options.allow)!r}" if options.allow else ""
    argument += f", packages={dict(word.split('=', 1) for word in options.packages)!r}" if options.packages else ""
    saved = options.save is not None
    source = str(options.save) if saved else f"{path}{given}"
    lines = [] if saved or kind.reader == "load_robot" else [f"simwarp import {path}{given} --save {path.stem}.json"]
    lines += [f"simwarp new-task my-{_slug(path.stem)} --robot {source}"]
    reader = "load_robot" if saved else kind.reader
    lines += [f'robot = sw.importers.{reader}("{options.save if saved else path}"{"" if saved else argument})']
    console.print()
    for index, line in enumerate(lines):
        head = "" if index else "next"
        console.print(f"{head:<10} {line}", highlight=False, soft_wrap=True)


def _slug(stem: str) -> str:
    """A file's name as a part of that of a task."""
    return "-".join(
        "".join(letter if letter.isascii() and letter.isalnum() else " " for letter in stem.lower()).split()
    )


# ---- for scripts -----------------------------------------------------------------------------------------------------


def _faults(robot: Imported) -> StateFaults:
    """Overlaps and limits that are passed, of the robot as built; none where nothing can be made of it alone."""
    try:
        return initial_faults(robot.builder.finalize(1, "cpu"))
    except ModelError:
        return StateFaults()


def _results(
    path: Path, kind: Format, robot: Imported, faults: StateFaults, wall: float, options: ImportOptions
) -> dict[str, Any]:
    builder = robot.builder
    joints = []
    for name, column in robot.dofs.items():
        index, _ = builder.coordinate_of(column)
        joint = builder.joints[index]
        limits = [None if dof.limit is None else [_number(side) for side in dof.limit] for dof in joint.dofs]
        joints.append({"name": name, "type": joint.type.name.lower(), "dof": column, "limits": limits})
    return {
        "file": str(path), "format": kind.title, "bodies": dict(robot.bodies), "dofs": dict(robot.dofs),
        "dof_count": builder.dof_count, "mass": robot.mass,
        "masses": {name: builder.bodies[body].mass for name, body in robot.bodies.items()},
        "joints": joints, "actuators": [spec.name for spec in robot.actuators],
        "shapes": len(builder.shapes), "timestep": robot.timestep, **robot.report.to_json(),
        "overlaps": [
            {"shapes": list(each.names), "bodies": list(each.bodies), "depth": each.depth} for each in faults.overlaps
        ],
        "outside_limits": [
            {"joint": each.joint, "dof": each.dof, "value": each.value, "lower": each.limit[0], "upper": each.limit[1]}
            for each in faults.limits
        ],
        "saved": None if options.save is None else str(options.save),
        "picture": None if options.picture is None else str(options.picture), "wall_s": wall,
    }  # fmt: skip


def _number(side: float) -> float | None:
    return side if math.isfinite(side) else None


def _draw(robot: Imported, path: Path) -> None:
    from simwarp.sensors import Visuals
    from simwarp.viewer import portrait
    from simwarp.viewer.sheets import write_image

    visuals = Visuals(robot.builder)
    robot.add_visuals(visuals)
    keyframes = robot.keyframes
    home = keyframes.get("home") or next(iter(keyframes.values()), None)
    write_image(path, portrait(visuals, None if home is None else home.q))
