"""Pages of manoeuvres: panels of their own, cones and verdicts, drawn of made-up runs."""

from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.assessment.verdicts import verdicts
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver
from simwarp.vehicle.results.channels import COLUMNS, Run
from simwarp.vehicle.results.drive_plot import draw_run, run_figure
from simwarp.vehicle.results.maneuver_panels import has_special
from simwarp.vehicle.results.results import results
from simwarp.vehicle.spec.vehicle_files import load_vehicle

SEDAN = load_vehicle("sedan")
STANDARD = tuple(MANEUVERS)[tuple(MANEUVERS).index("iso-3888-1") :]


def made_up():
    """A vehicle on a curve that becomes narrower, with some of everything."""
    t = np.arange(-200, 801) * 0.01
    later = np.clip(t, 0.0, None)
    rate = 0.03 * later
    columns = {name: np.zeros(len(t)) for name in COLUMNS} | {
        "t_s": t, "speed_mps": np.full(t.shape, 15.0), "x_m": 15.0 * (t + 2.0), "yawrate_radps": rate,
        "yaw_rad": 0.015 * later**2, "latacc_com_mps2": 15.0 * rate, "steer": 0.02 * later, "roll_rad": 0.005 * rate,
    }  # fmt: skip
    columns |= {f"Fz_{wheel}_N": 4e3 + 100.0 * np.sin(t) for wheel in ("FL", "FR", "RL", "RR")}
    columns |= {f"steerangle_{wheel}_rad": 0.01 * later for wheel in ("FL", "FR")}
    return Run(columns)


@pytest.mark.slow
@pytest.mark.parametrize("name", STANDARD)
def test_the_page_of_a_manoeuvre_tells_its_verdicts_and_has_its_panels(tmp_path, name):
    what, run = maneuver(name, SEDAN), made_up()
    judged = verdicts(run, what)
    draw_run(run, tmp_path / "page.svg", name, results(run, what), None, what, judged)
    drawn = (tmp_path / "page.svg").read_text(encoding="utf-8")
    plain = tmp_path / "plain.svg"
    draw_run(run, plain, name, results(run, what))
    assert has_special(what) == (what.course is None)
    # axes are groups of their own: two more, or cones in the place of the way
    axes = [text.count('id="axes_') for text in (drawn, plain.read_text(encoding="utf-8"))]
    assert axes[0] - axes[1] == (2 if has_special(what) else 0)
    if judged:
        assert drawn != plain.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["constant-radius", "steady-state-circle"])
def test_a_circle_fills_its_panel(name):
    """Its diameter spans most of the axes' width; in a panel of the page's width it was a tenth of it."""
    what = maneuver(name, SEDAN)
    angle = np.linspace(0.0, 2.0 * np.pi, 201)
    columns: dict[str, Any] = {key: np.zeros(len(angle)) for key in COLUMNS} | {
        "t_s": 0.1 * np.arange(len(angle)), "x_m": 40.0 * np.sin(angle), "y_m": 40.0 * (1.0 - np.cos(angle)),
    }  # fmt: skip
    assert what.follow is not None
    figure = run_figure(Run(columns), "", (), what.follow.paths[0], what)
    way = next(axes for axes in figure.axes if axes.get_title(loc="left").startswith("way"))
    figure.draw_without_rendering()
    low, high = way.get_xlim()
    box = way.get_window_extent()
    assert 80.0 / (high - low) > 0.8
    assert box.height > 0.2 * figure.bbox.height
    assert box.width / box.height == pytest.approx((high - low) / np.ptp(way.get_ylim()), rel=0.01)
