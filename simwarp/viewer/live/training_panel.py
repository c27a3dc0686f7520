"""The training that the policy comes from: its learning curve, the iteration shown, and whether newer ones act."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from simwarp.viewer.live.page_controls import set_changed
from simwarp.viewer.live.page_text import plain_text

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

Array = npt.NDArray[np.float64]
MOST_POINTS: Final = 400
"""Of the curve on the page."""


class Training(Protocol):
    """A training that goes on, or went on, somewhere else.

    Attributes:
        name: for people.
        on: whether newer policies act; the panel switches it.
        iteration: of the policy that acts; None: it is of another origin.
        trouble: why the newest policy does not act; empty where it does.
    """

    name: str
    on: bool
    iteration: int | None
    trouble: str

    def curve(self) -> tuple[Array, Array]:
        """Iterations, and mean returns in them."""


class TrainingPanel:
    """Shows a training."""

    def __init__(self, view: LiveView, training: Training) -> None:
        self._training = training
        gui: Any = view.server.viser.gui
        with gui.add_folder("Training"):
            self._line = gui.add_markdown(self._text())
            reload = gui.add_checkbox("Reload", initial_value=training.on, hint="newer policies of the run act at once")
            iterations, returns = self._points()
            self._plot = gui.add_uplot(
                (iterations, returns),
                ({"label": "iteration"}, {"label": "mean return", "stroke": "#d05c20", "width": 2}),
                scales={"x": {"time": False}}, aspect=1.8, legend={"show": False},
            )  # fmt: skip

        @reload.on_update
        def _(_: Any) -> None:
            training.on = bool(reload.value)

    def refresh(self, now: float) -> None:
        """Text and curve."""
        set_changed(self._line, content=self._text())
        points = self._points()
        if not all(map(np.array_equal, points, self._plot.data)):
            self._plot.data = points

    def _text(self) -> str:
        training = self._training
        acts = "not of this run yet" if training.iteration is None else f"iteration {training.iteration}"
        line = f"**{acts}** &nbsp; {plain_text(training.name)}"
        if training.trouble:
            line += f'\n\n<span style="color:#d33">{plain_text(training.trouble)}</span>'
        return line

    def _points(self) -> tuple[Array, Array]:
        iterations, returns = self._training.curve()
        if len(iterations) < 2:
            return np.array([0.0, 1.0]), np.array([0.0, 0.0]) if not len(returns) else np.repeat(returns, 2)
        chosen = np.unique(np.linspace(0, len(iterations) - 1, MOST_POINTS).round().astype(int))
        return iterations[chosen], returns[chosen]
