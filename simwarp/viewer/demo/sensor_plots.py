"""Pictures of the measurements of `simwarp sensor-demo`."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simwarp.core.rotation import matrix_of
from simwarp.core.types import Pose
from simwarp.scenery.visual import Label
from simwarp.sensors.motion.gps import GeoOrigin, to_local
from simwarp.viewer.demo.sensor_suite import COUNTS
from simwarp.viewer.demo.sheet import BLANK, Bar, Color, Panel, Picture

Array = npt.NDArray[Any]
Traces = Mapping[str, Mapping[str, Array]]

_TALL: Final = 130
"""Height of a picture beside which a long name of an axis has room [pixels]."""
SETTLED: Final = 1.0
"""Time from which on traces are shown: the truck has settled on its springs [s]."""
TRUTH: Final = "#1f2933"
MEASURED: Final = "#d1495b"
OTHER: Final = "#2a7fb8"
CLASSES: Final[dict[int, tuple[str, Color]]] = {
    0: ("sky", (96, 125, 158)),
    Label.GROUND: ("ground", (96, 130, 72)),
    Label.ROAD: ("trail", (150, 118, 84)),
    Label.ROCK: ("rock", (150, 152, 158)),
    Label.BUSH: ("bush", (164, 190, 80)),
    Label.TREE: ("tree", (28, 84, 52)),
    Label.CONE: ("cone", (255, 126, 40)),
    Label.PILLAR: ("pillar", (60, 70, 220)),
    Label.BARRIER: ("barrier", (224, 214, 196)),
    Label.CRATE: ("crate", (214, 170, 60)),
    Label.VEHICLE: ("vehicle", (210, 56, 90)),
}
"""Names and colours of semantic classes; 0 stands for nothing."""


def instance_colors(image: Array) -> Picture:
    """(height, width, 3) a colour for every instance; nothing is dark."""
    count = max(int(image.max()) + 1, 1)
    table = [
        colorsys.hsv_to_rgb((0.31 + 0.618034 * k) % 1.0, 0.45 + 0.4 * ((k * 7) % 3) / 2, 0.98 - 0.3 * ((k * 5) % 4) / 3)
        for k in range(count)
    ]
    colors = np.concatenate([np.round(255.0 * np.array(table)), [BLANK]]).astype(np.uint8)
    return np.asarray(colors[image])


def semantic_panel(labels: Array, instance: Array) -> Panel:
    """Classes by colour, those in sight named."""
    shown = np.where(instance < 0, 0, labels)
    table = np.full((max(CLASSES) + 1, 3), BLANK, np.uint8)
    for label, (_, color) in CLASSES.items():
        table[label] = color
    present = [CLASSES[label] for label in CLASSES if (shown == label).any()]
    return Panel("semantic segmentation", "class of each instance", table[shown], legend=present)


def depth_panel(depth: Array, instance: Array) -> Panel:
    """Depth by colour, near things in finer steps than far ones."""
    bar = Bar("viridis_r", 0.0, 60.0, "m")
    return Panel("depth", "along the optical axis", bar.paint(depth, instance >= 0), bar)


def normals_panel(normals: Array, instance: Array) -> Panel:
    """Unit normals in camera axes as colours."""
    colors = np.round(255.0 * (0.5 + 0.5 * normals)).astype(np.uint8)
    colors[instance < 0] = BLANK
    return Panel("normals", "camera axes X, Y, Z as red, green, blue", colors)


def stretched(image: Array, width: int, height: int) -> Array:
    """A small image in a larger one, without mixing its pixels."""
    rows = np.arange(height) * image.shape[0] // height
    columns = np.arange(width) * image.shape[1] // width
    return np.asarray(image[rows[:, None], columns[None]])


def range_panels(ranges: Array, width: int, height: int) -> tuple[Panel, Panel]:
    """Range image and intensity image of a lidar."""
    large = stretched(ranges, width, height)
    seen = large[..., 1] > 0.0
    far, bright = Bar("turbo_r", 0.0, 50.0, "m"), Bar("inferno", 0.0, 0.4, "")
    rows, columns = ranges.shape[:2]
    return (
        Panel("lidar range image", f"{rows} × {columns} beams, full turn, ahead in the middle",
              far.paint(large[..., 0], seen), far),
        Panel("lidar intensity", "reflectance · |n · d|, strongest return", bright.paint(large[..., 1], seen), bright),
    )  # fmt: skip


def cloud_panel(cloud: Array, background: Picture, view: Pose, fov: float, ground: float) -> Panel:
    """A point cloud over a dim picture of what is there.

    Args:
        cloud: (n, 3) [m], world axes.
        background: (height, width, 3), taken by a pinhole at `view`.
        view: its pose.
        fov: its field of view [rad].
        ground: height that counts as zero [m].
    """
    bar = Bar("turbo", -1.0, 7.0, "m")
    height, width = background.shape[:2]
    local = (cloud - view.position) @ matrix_of(view.rotation)
    order = np.argsort(-local[:, 0])
    order = order[local[order, 0] > 1.0]
    local, colors = local[order], bar.paint(cloud[order, 2] - ground)
    focal = 0.5 * width / np.tan(0.5 * fov)
    column = np.floor(0.5 * width - focal * local[:, 1] / local[:, 0]).astype(int)
    row = np.floor(0.5 * height - focal * local[:, 2] / local[:, 0]).astype(int)
    image = np.asarray(0.42 * background.mean(axis=2, keepdims=True) + np.array(BLANK) * 0.5).astype(np.uint8)
    # near points are drawn last and larger
    for size, near in ((2, np.inf), (3, 22.0)):
        chosen = local[:, 0] < near
        for dy in range(size):
            for dx in range(size):
                r, c = row[chosen] + dy, column[chosen] + dx
                inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
                image[r[inside], c[inside]] = colors[chosen][inside]
    return Panel("lidar point cloud", f"VLP-16, {len(cloud):,} returns; height above the ground", image, bar)


def radar_panel(returns: Array, clusters: Array, speed: float, width: int, height: int) -> Panel:
    """Returns and clusters seen from above, ahead to the right."""
    figure, axes = _axes(width, height)
    bar = Bar("RdBu", -18.0, 18.0, "m/s")
    seen = returns[returns[..., 5] >= 0.0]
    flat = seen[:, 0] * np.cos(seen[:, 2])
    x, y = flat * np.cos(seen[:, 1]), flat * np.sin(seen[:, 1])
    for angle in (-0.8, 0.8):
        axes.plot([0.0, 70.0 * np.cos(angle)], [0.0, 70.0 * np.sin(angle)], color="#c3cad1", linewidth=0.8)
    axes.scatter(
        x, y, c=bar.paint(seen[:, 3]) / 255.0, s=16.0 * np.sqrt(seen[:, 4] + 0.05), linewidths=0.3, edgecolors="#555c64"
    )
    for cluster in clusters:
        axes.plot(cluster[0], cluster[1], "o", markersize=13, markerfacecolor="none", markeredgecolor=TRUTH,
                  markeredgewidth=0.8)  # fmt: skip
        if abs(cluster[3] + speed * cluster[0] / np.linalg.norm(cluster[:3])) > 3.0:  # it moves itself
            axes.annotate(f"{cluster[3]:.1f} m/s", cluster[:2], xytext=(10, -3), textcoords="offset points", fontsize=8)
    axes.set_aspect("equal")
    axes.set_xlim(0.0, 60.0)
    axes.set_ylim(-8.5, 8.5)
    axes.set_xlabel("ahead [m]", fontsize=8)
    axes.set_ylabel("to the left [m]" if height >= _TALL else "left [m]", fontsize=8)
    return Panel("radar", "returns and clusters from above; range rate, approaching red", _drawn(figure), bar)


def traces(found: Traces, radius: float, width: int, height: int) -> list[Panel]:
    """Inertial unit, satellite receiver and wheel encoder (on a wheel of this radius [m]) against the truth."""
    imu, gps, encoder, speed = (
        {name: values[fields["time"] > SETTLED] for name, values in fields.items()}
        for fields in (found[name] for name in ("imu", "gps", "encoder", "speedometer"))
    )
    panels = [
        _trace("accelerometer", "vertical specific force [m/s²]", width, height,
               (imu["time"], imu["data"][:, 2], "measured"), (imu["time"], imu["truth"][:, 2])),
        _trace("gyroscope", "yaw rate [rad/s], bias 0.03", width, height,
               (imu["time"], imu["data"][:, 5], "measured"), (imu["time"], imu["truth"][:, 5])),
    ]  # fmt: skip
    figure, axes = _axes(width, height)
    true = to_local(GeoOrigin(), *gps["truth"].T)
    axes.plot(gps["position"][:, 0], gps["position"][:, 1], ".", markersize=3.5, color=MEASURED, label="measured")
    axes.plot(true[:, 0], true[:, 1], color=TRUTH, linewidth=1.1, label="truth")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east [m]", fontsize=8)
    _legend(axes)
    panels.append(Panel("GPS", "track at 5 Hz, east and north [m]", _drawn(figure)))
    figure, axes = _axes(width, height)
    gps_speed = np.linalg.norm(gps["velocity"], axis=1)
    axes.plot(gps["time"], gps_speed, ".", markersize=3.5, color=OTHER, label="GPS")
    axes.step(encoder["time"], radius * np.abs(encoder["data"][:, 0]), where="mid", linewidth=0.9, color=MEASURED,
              label=f"wheel, {COUNTS} counts")  # fmt: skip
    axes.plot(speed["time"], speed["data"][:, 0], color=TRUTH, linewidth=1.1, label="truth")
    axes.set_xlabel("time [s]", fontsize=8)
    _legend(axes)
    panels.append(Panel("speed", "of GPS and of a front wheel [m/s]", _drawn(figure)))
    return panels


def _trace(
    title: str, note: str, width: int, height: int, measured: tuple[Array, Array, str], true: tuple[Array, Array]
) -> Panel:
    figure, axes = _axes(width, height)
    axes.plot(measured[0], measured[1], color=MEASURED, linewidth=0.5, alpha=0.9, label=measured[2])
    axes.plot(true[0], true[1], color=TRUTH, linewidth=0.9, label="truth")
    axes.set_xlim(true[0][0], true[0][-1])
    axes.set_xlabel("time [s]", fontsize=8)
    _legend(axes)
    return Panel(title, note, _drawn(figure))


def _legend(axes: Any) -> None:
    legend = axes.legend(fontsize=7, frameon=True, framealpha=0.85, edgecolor="none", loc="best", handlelength=1.4)
    legend.get_frame().set_facecolor("#fafaf9")


def _axes(width: int, height: int) -> tuple[Figure, Any]:
    """A figure of exactly this size [pixels] with one set of axes."""
    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100, facecolor="#fafaf9")
    figure.set_layout_engine("constrained", w_pad=0.02, h_pad=0.03)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_facecolor("#fafaf9")
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#9aa5b1")
    axes.tick_params(colors=TRUTH, labelsize=7.5, length=2.5)
    axes.grid(alpha=0.3, linewidth=0.5)
    return figure, axes


def _drawn(figure: Figure) -> Picture:
    """(height, width, 3) of a figure."""
    canvas: Any = figure.canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()
