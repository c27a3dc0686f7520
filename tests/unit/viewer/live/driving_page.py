"""A page of a test that drives: connections to /drive, and a view that runs until something is true."""

import json
import threading

from websockets.sync.client import connect


def address(view, *, token=None):
    """Of the socket, with the view's token unless another one is given."""
    return view.url.replace("http://", "ws://") + f"/drive?token={view.server.token if token is None else token}"


class DrivingPage:
    """What a page with `keys.js` sends: its state, again and again."""

    def __init__(self, view, **state):
        self.state, self.presses = state, []
        self._over = threading.Event()
        self._socket = connect(address(view), origin=view.url)
        self._thread = threading.Thread(target=self._beat, daemon=True)
        self._thread.start()

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


def run_for(view, seconds):
    """Goes on for simulated time [s]; a limit on steps would hide a view that rests after an error."""
    steps = round(seconds / view.subject.dt)
    done = []
    view.listeners.append(lambda: done.append(1))
    view.run(lambda: len(done) >= steps or view.paused)
    view.listeners.pop()
    assert not view.paused
