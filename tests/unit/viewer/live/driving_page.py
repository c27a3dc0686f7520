"""A page of a test that drives: connections to /drive, and a view that runs until something is true."""

import json
import threading
import time

from websockets.sync.client import connect

PATIENCE = 60.0
"""Longest wait for the server [s]: nothing here is about how fast it is."""


def address(view, *, token=None):
    """Of the socket, with the view's token unless another one is given."""
    return view.url.replace("http://", "ws://") + f"/drive?token={view.server.token if token is None else token}"


class DrivingPage:
    """What a page with `keys.js` sends: its state, again and again."""

    def __init__(self, view, **state):
        self.view, self.state, self.presses = view, state, []
        self._over = threading.Event()
        self._socket = connect(address(view), origin=view.url)
        self._thread = threading.Thread(target=self._beat, daemon=True)
        self._thread.start()
        self.say(**state)

    def say(self, **state):
        """Holds something else, once the server has heard it."""
        self.state = state
        wanted = {"steer": 0.0, "throttle": 0.0, "brake": 0.0, "clutch": 0.0} | state
        self._until(lambda: (wish := self.view.wheel.wish()) and all(getattr(wish, k) == wanted[k] for k in wanted))

    def _until(self, true):
        end = time.monotonic() + PATIENCE
        while self.view.wheel.open and not true():
            assert time.monotonic() < end, "the server does not hear"
            time.sleep(0.005)

    def _beat(self):
        while not self._over.is_set():
            presses, self.presses = self.presses, []
            self._socket.send(json.dumps({**self.state, "presses": presses}))
            self._over.wait(0.03)

    def silent(self):
        """Sends nothing any more, without leaving."""
        self._over.set()
        self._thread.join()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.silent()
        self._socket.close()
        self._until(lambda: not self.view.wheel.occupied)


def run_for(view, seconds):
    """Goes on for simulated time [s]; a limit on steps would hide a view that rests after an error."""
    steps = round(seconds / view.subject.dt)
    done = []
    view.listeners.append(lambda: done.append(1))
    view.run(lambda: len(done) >= steps or view.paused)
    view.listeners.pop()
    assert not view.paused
