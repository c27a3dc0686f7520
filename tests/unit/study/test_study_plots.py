"""Plots of studies say in which units their axes are."""

import numpy as np
import pytest

from simwarp.study import search_plot, study_plot
from simwarp.study.design_goal import Goal
from simwarp.study.design_search import Design
from simwarp.study.monte_carlo import StudyResult, StudyRow
from simwarp.study.study_figures import Figure
from simwarp.study.varied_vehicle import varied_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle

FACTOR, NUMBER = "chassis.components[0].mass", "ground.friction"
KEYS = (f"{FACTOR}=-5%..5%", f"{NUMBER}=0.5..1")


@pytest.fixture
def below(monkeypatch, tmp_path):
    """Texts below the axes of the page that a call draws."""
    pages = []

    class Kept(study_plot.Page):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            pages.append(self)

    monkeypatch.setattr(study_plot, "Page", Kept)
    monkeypatch.setattr(search_plot, "Page", Kept)

    def drawn(draw, *arguments):
        draw(*arguments, tmp_path / "page.png", "title")
        assert (tmp_path / "page.png").read_bytes()[:4] == b"\x89PNG"
        return [axes.get_xlabel() for axes in pages.pop().axes]

    return drawn


def test_histograms_have_the_unit_of_their_figure_and_keys_theirs(below):
    rows = tuple(
        StudyRow(world=w, values=(1.0 + 0.01 * w, 0.9), figures={"roll": v, "share": -v}, passed=True, trouble="")
        for w, v in enumerate(np.linspace(1.0, 2.0, 9))
    )
    figures = (Figure("roll", "roll", "°"), Figure("share", "share", ""))
    result = StudyResult(
        keys=(FACTOR, NUMBER), figures=figures, nominal={}, rows=rows, factors=frozenset({FACTOR})
    )  # fmt: skip
    assert below(study_plot.draw_study, result) == ["[°]", "", "times as built", "[1]", "", "times as built"]


def test_keys_of_a_search_have_theirs(below):
    vehicle = varied_vehicle(load_vehicle("sedan"), "step-input", KEYS, options={}, friction=0.9)
    designs = [
        Design(
            number=n, values=(1.0, 0.6 + 0.1 * n), goal=1.0 * n, objective=1.0 * n, highest=np.nan, kept=True,
            figures={}, trouble="",
        )
        for n in range(3)
    ]  # fmt: skip
    found = below(search_plot.draw_search, designs, vehicle.keys, Goal("roll", maximise=True))
    assert found == ["design", "times as built", "as in the file [SI]"]
