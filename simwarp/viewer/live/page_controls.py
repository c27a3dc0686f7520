"""Controls of the page: their values go to the thread of the view, and texts to the page where they have changed."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView


def post_value(
    view: LiveView, listen: Callable[[Any], Any], act: Callable[[Any], None], *, by_person: bool = False
) -> None:
    """Calls a function with each new value of a control, on the thread of the view.

    Args:
        view: whose thread it is.
        listen: `on_update` or `on_click` of the control.
        act: gets the value.
        by_person: only for values that a page sent, not for those that the program has set.
    """

    @listen
    def _(event: Any) -> None:
        value = event.target.value
        if event.client is not None or not by_person:
            view.post(functools.partial(act, value))


def set_changed(handle: Any, **values: object) -> None:
    """Sets attributes of a control that differ: each one set is sent to all pages."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
