"""Plots of the tension round the tracks, and of the load under their shoes."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simwarp.core.files import replacing
from simwarp.vehicle.results.chain_record import ChainProfile, ChainRecord
from simwarp.vehicle.results.plot_style import GREY, INK, SIDE_COLORS, SIDE_NAMES, dress, legend, title_of
from simwarp.vehicle.spec.track_parts import ShoeTrack

NEAR: Final = 1.2
"""Of the radius of the pins round a sprocket or idler: shoes nearer to its axis lie on it."""


def draw_chains(record: ChainRecord, target: FilePath, title: str) -> None:
    """Writes a picture of both, tension above and load below, in the format of the file's suffix.

    Args:
        record: with one sample or more, whose means are drawn.
        target: .png, .pdf or .svg.
        title: the heading.

    Raises:
        ModelError: there is no sample.
        FileError: the target cannot be written to.
        OutputError: the disk did not take it.
    """
    figure = Figure(figsize=(12.0, 7.5))
    figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.012, ha="left", fontsize=16, fontweight="bold", color=INK)
    above, below = figure.subplots(2, 1)
    draw_tension(above, record)
    draw_shoe_loads(below, record)
    with replacing(target) as draft:
        figure.savefig(draft, dpi=120)


def draw_tension(axes: Any, record: ChainRecord) -> None:
    """The force of the pins along each chain [kN], from below the sprocket round its far side, on matplotlib's axes."""
    dress(axes)
    title_of(axes, "tension round the track: force of the pins [kN]")
    profiles = record.profiles()
    for name, profile in zip(SIDE_COLORS, profiles, strict=True):
        axes.plot(profile.place, 1e-3 * profile.tension, color=SIDE_COLORS[name], linewidth=1.4, label=SIDE_NAMES[name])
    _mark_wheels(axes, profiles[0], record.tracks[0])
    axes.set_ylim(0.0, 1.12e-3 * max(float(profile.tension.max()) for profile in profiles))
    axes.set_xlim(0.0, max(float(profile.place[-1]) for profile in profiles))
    axes.set_xlabel("along the chain, from below the sprocket round its far side [m]", fontsize=9, color=INK)
    legend(axes)


def draw_shoe_loads(axes: Any, record: ChainRecord) -> None:
    """The force of the ground on each shoe, along the shoe's normal [kN], over x in the vehicle's frame."""
    dress(axes)
    title_of(axes, "load under the shoes [kN]; triangles: axes of the road wheels as built")
    top, spans = 1.0e-3, []
    for name, profile, track in zip(SIDE_COLORS, record.profiles(), record.tracks, strict=True):
        lower = profile.z < _middle_height(track)
        order = np.argsort(profile.x[lower])
        x, load = profile.x[lower][order], 1e-3 * profile.load[lower][order]
        axes.plot(x, load, color=SIDE_COLORS[name], linewidth=1.2, marker=".", markersize=5.0, label=SIDE_NAMES[name])
        wheels = [mount.location[0] for mount in track.road_wheels]
        axes.plot(wheels, np.zeros(len(wheels)), "^", color=SIDE_COLORS[name], markersize=7.0, clip_on=False)
        top = max(top, float(load.max()))
        spans += [float(x.min()), float(x.max())]
    axes.set_ylim(0.0, 1.12 * top)
    axes.set_xlim(min(spans), max(spans))
    axes.set_xlabel("x in the vehicle's frame, forwards [m]", fontsize=9, color=INK)
    legend(axes)


def _middle_height(track: ShoeTrack) -> float:
    """Between the upper and the lower run [m]."""
    return 0.5 * (track.sprocket_location[2] + track.idler_location[2])


def _mark_wheels(axes: Any, profile: ChainProfile, track: ShoeTrack) -> None:
    """Shades the places where the chain lies on sprocket and idler."""
    sprocket, idler = track.sprocket_location, track.idler_location
    around = track.idler.wheel.radius + 0.5 * track.shoe.height
    for text, (x, _, z), radius in (
        ("sprocket", sprocket, track.sprocket.assembly_radius), ("idler", idler, around),
    ):  # fmt: skip
        on = np.hypot(profile.x - x, profile.z - z) < NEAR * radius
        for first, last in _stretches(on):
            low, high = profile.place[first], profile.place[last]
            axes.axvspan(low, high, color=GREY, alpha=0.2, linewidth=0.0)
            axes.text(0.5 * (low + high), 0.03, text, transform=axes.get_xaxis_transform(), ha="center", fontsize=9,
                      color=INK)  # fmt: skip


def _stretches(on: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every row of three or more places."""
    edges = np.diff(np.concatenate([[0], on.astype(int), [0]]))
    pairs = zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True)
    return [(first, end - 1) for first, end in pairs if end - first >= 3]
