"""What a dashboard shows: speed, engine, pedals, steering, wheels, and how far the task is."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle
from simwarp.viewer.live.driving.browser_driving import GOAL, read_row
from simwarp.viewer.live.page_controls import set_changed

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

SLIDING: Final = 0.15
"""Slip, as a ratio or in radians, from which on a wheel is shown in red."""
RPM: Final = 30.0 / math.pi


@dataclasses.dataclass(frozen=True)
class Dashboard:
    """Readings of one vehicle.

    Attributes:
        name: of the vehicle.
        speed: ahead [m/s].
        engine: speed of its shaft [rad/s]; None without one.
        gear: -1 reverse, 0 neutral; None without gears.
        steering: -1..1, positive to the left.
        pedals: throttle, brake, 0..1.
        wheels: load [N], slip ratio and slip angle [rad] of each, front left first.
        tracks: speed of the sprocket [rad/s] and tension [N] of the left and the right one, in the place of wheels.
        goal: named numbers of the task.
    """

    name: str
    speed: float
    engine: float | None
    gear: int | None
    steering: float
    pedals: tuple[float, float]
    wheels: tuple[tuple[float, float, float], ...]
    goal: Mapping[str, float] = dataclasses.field(default_factory=dict)
    tracks: tuple[tuple[float, float], ...] = ()

    @classmethod
    def read(cls, vehicle: AnyVehicle, world: int, goal: Callable[[int], Mapping[str, float]] | None) -> Dashboard:
        """Those of one world, from its arrays."""
        spec = vehicle.parts.spec
        steering, throttle, brake, _ = (float(value) for value in read_row(vehicle.input, world))
        return cls(
            spec.name, float(read_row(vehicle.velocity_b, world)[0]),
            None if spec.engine is None else float(read_row(vehicle.engine_speed, world)),
            int(read_row(vehicle.gear, world)) if spec.has_gears else None,
            steering, (throttle, brake), _wheels_of(vehicle, world), {} if goal is None else goal(world),
            _tracks_of(vehicle, world),
        )  # fmt: skip

    def html(self) -> str:
        """As a page shows them, in the page's own colours."""
        gear = "" if self.gear is None else {-1: "R", 0: "N"}.get(self.gear, str(self.gear))
        rpm = "" if self.engine is None else f"{10 * round(0.1 * RPM * self.engine):,} rpm".replace(",", " ")
        throttle, brake = self.pedals
        head = (
            f'<div style="display:flex;justify-content:space-between;align-items:baseline">'
            f'<span><b style="font-size:2.1em;line-height:1">{abs(3.6 * self.speed):.0f}</b> km/h</span>'
            f'<span>{rpm}</span><b style="font-size:1.5em">{gear}</b></div>'
        )
        bars = (
            _row("throttle", _bar(throttle, "#2f9e44"))
            + _row("brake", _bar(brake, "#e03131"))
            + _row("steering", _middle_bar(self.steering))
        )
        below = _wheels(self.wheels) + _tracks(self.tracks)
        tail = "".join(
            _row(html.escape(name), f"<span>{value:.4g}</span>") for name, value in self.goal.items()
        )  # numbers of the task
        return (
            f'<div style="font-size:.82em;padding:2px 12px 8px;font-variant-numeric:tabular-nums">'
            f'<div style="opacity:.6">{html.escape(self.name)}</div>{head}{bars}{below}{tail}</div>'
        )


def _row(name: str, value: str) -> str:
    return (
        f'<div style="display:flex;align-items:center;gap:8px;margin-top:3px">'
        f'<span style="width:5.5em;flex:none;opacity:.7">{name}</span>{value}</div>'
    )


def _track(inside: str) -> str:
    return (
        '<span style="position:relative;flex:1;height:7px;border-radius:4px;overflow:hidden;'
        f'background:rgba(128,128,128,.28)">{inside}</span>'
    )


def _bar(share: float, color: str, left: float = 0.0) -> str:
    width = 100.0 * min(max(share, 0.0), 1.0)
    fill = f"position:absolute;left:{left:.0f}%;width:{width:.0f}%;height:100%;background:{color}"
    return _track(f'<span style="{fill}"></span>')


def _middle_bar(steering: float) -> str:
    """From the middle to the left for positive values."""
    share = 0.5 * min(abs(steering), 1.0)
    return _bar(share, "#1c7ed6", 50.0 - 100.0 * share if steering > 0.0 else 50.0)


def _wheels(wheels: Sequence[tuple[float, float, float]]) -> str:
    """Two columns, left and right, front first: load, slip ratio, slip angle."""
    cells = "".join(_wheel(*wheel) for wheel in wheels)
    return f'<div style="display:grid;grid-template-columns:1fr 1fr;gap:4px;margin-top:6px">{cells}</div>'


def _wheel(load: float, ratio: float, angle: float) -> str:
    sliding = abs(ratio) > SLIDING or abs(angle) > SLIDING
    border = "#e03131" if sliding else ("rgba(128,128,128,.45)" if load > 0.0 else "#f08c00")
    weight = f"{1e-3 * load:.1f} kN" if load >= 1000.0 else f"{load:.0f} N"
    slip = f"{100.0 * ratio:+.0f} % {math.degrees(angle):+.1f}°"
    return (
        f'<div style="border:1px solid {border};border-radius:6px;padding:1px 7px;display:flex;'
        f'justify-content:space-between"><b>{weight}</b><span style="opacity:.75">{slip}</span></div>'
    )


def _wheels_of(vehicle: AnyVehicle, world: int) -> tuple[tuple[float, float, float], ...]:
    """Load, slip ratio and slip angle of each wheel; none on tracks."""
    if isinstance(vehicle, TrackedVehicle):
        return ()
    tires = vehicle.tires
    columns = (read_row(array, world) for array in (tires.load, tires.slip_ratio, tires.slip_angle))
    return tuple((float(a), float(b), float(c)) for a, b, c in zip(*columns, strict=True))


def _tracks_of(vehicle: AnyVehicle, world: int) -> tuple[tuple[float, float], ...]:
    """Speed of the sprocket and tension of each track; none on wheels."""
    if not isinstance(vehicle, TrackedVehicle):
        return ()
    columns = (read_row(array, world) for array in (vehicle.sprocket_speed, vehicle.tension))
    return tuple((float(a), float(b)) for a, b in zip(*columns, strict=True))


def _tracks(tracks: Sequence[tuple[float, float]]) -> str:
    """Two rows: speed of the sprocket, tension."""
    return "".join(
        _row(f"{name} track", f"<b>{1e-3 * tension:.0f} kN</b><span>{speed:+.1f} rad/s</span>")
        for name, (speed, tension) in zip(("left", "right"), tracks, strict=False)
    )


class VehiclePanel:
    """The read-out of the chosen world's vehicle, rewritten where it changes, with the panels' 10 Hz."""

    def __init__(self, view: LiveView, vehicle: AnyVehicle) -> None:
        self._view, self._vehicle = view, vehicle
        self._goal: Callable[[int], Mapping[str, float]] | None = view.subject.details.get(GOAL)
        gui = view.server.viser.gui
        with gui.add_folder("Vehicle"):
            self._out: Any = gui.add_html("")

    def refresh(self, now: float) -> None:
        """The present readings."""
        set_changed(self._out, content=Dashboard.read(self._vehicle, self._view.page.world, self._goal).html())
