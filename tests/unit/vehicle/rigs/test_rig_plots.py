"""Pages of plots of rigs: one legend outside the panels, a colour for a tire and a style for a load."""

import pytest
from matplotlib.figure import Figure

from simwarp.vehicle.rigs.rig_plots import draw_suspension, draw_tires
from simwarp.vehicle.rigs.suspension_rig import run_suspension_rig
from simwarp.vehicle.rigs.tire_rig import TireSweep, run_tire_rig
from simwarp.vehicle.spec.variants import with_options
from tests.physics.sample_vehicles import shipped


@pytest.fixture
def pages(monkeypatch):
    """Figures that are saved."""
    saved, save = [], Figure.savefig

    def keep(figure, *arguments, **options):
        saved.append(figure)
        save(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    return saved


def outside(figure) -> None:
    """The legend is one, and on no panel."""
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert not any(axes.get_legend() for axes in figure.axes)
    assert not any(box.overlaps(axes.get_tightbbox()) for axes in figure.axes)


@pytest.mark.slow
def test_tires_over_each_other_have_one_legend_outside(pages, tmp_path):
    names, sweep = ("fiala", "tmeasy", "pacejka89"), TireSweep(loads=(3000.0, 5000.0, 7000.0), points=5)
    curves = {
        name: run_tire_rig(with_options(shipped("hmmwv"), tire=name).axles[0].tire, sweep) for name in names
    }  # fmt: skip
    draw_tires(curves, tmp_path / "a.png", "tires")
    (figure,) = pages
    outside(figure)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [*names, "F_z 3 kN", "F_z 5 kN", "F_z 7 kN"]
    looks = {(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines}
    assert len(looks) == len(figure.axes[0].lines) == 9
    assert len({color for color, _ in looks}) == len({style for _, style in looks}) == 3


@pytest.mark.slow
def test_stops_are_marked_and_named_on_the_page(pages, tmp_path):
    run = run_suspension_rig(shipped("hmmwv"), 1, travel=0.06, points=13)
    draw_suspension(run, tmp_path / "a.png", "rear")
    (figure,) = pages
    outside(figure)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["parallel", "opposite", "in a stop", "wheel rate without stops"]
    assert figure.axes[5].get_title(loc="left") == "anti-lift in braking [%]"
    marks = [line for line in figure.axes[7].lines if line.get_marker() == "o"]
    curve = next(iter(run.curves.values()))
    assert len(marks[0].get_xdata()) == (curve.into_stop[:, 0] != 0.0).sum() > 0
