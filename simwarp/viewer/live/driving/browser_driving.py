"""A person at the wheel of one world's vehicle: the socket that keys arrive by, and what they are written to."""

from __future__ import annotations

import asyncio
import dataclasses
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import warp as wp

from simwarp.viewer.live.driving.human_driver import HELD_BRAKE, SILENCE, HumanDriver, Inputs, Keys, Wish, shifted
from simwarp.viewer.live.subject import Subject
from simwarp.viewer.live.web_server import ConnectionClosed

if TYPE_CHECKING:
    from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle

PATH: Final = "/drive"
WHEEL: Final = "wheel"
"""Key of a subject's `details`: its `Wheel`, or None where nobody may drive."""
GOAL: Final = "goal"
"""Key of a subject's `details`: a callable that takes a world's index and returns named numbers of the task."""
PATIENCE: Final = 1.0
"""For which a page waits for a wheel that another one holds: one that is loaded anew has just left it [s]."""
TAKEN: Final = "occupied"
PARKED: Final = Inputs(braking=HELD_BRAKE)


class DriveSocket:
    """Connections to /drive: one driver at a time.

    Attributes:
        open: whether anybody may drive now.
    """

    def __init__(self) -> None:
        self.open = False
        self._driver: Any = None
        self._wish: Wish | None = None
        self._heard = 0.0
        self._presses: deque[str] = deque(maxlen=64)

    @property
    def occupied(self) -> bool:
        """Whether somebody is connected."""
        return self._driver is not None

    async def handle(self, connection: Any) -> None:
        """One connection, from its opening to its end."""
        until = time.perf_counter() + PATIENCE
        while self.open and self.occupied and time.perf_counter() < until:
            await asyncio.sleep(0.05)
        if not self.open:
            await connection.close(1008, "Drive is off")
        elif self.occupied:
            await connection.close(1013, "another page is driving")
        else:
            await self._listen(connection)

    async def _listen(self, connection: Any) -> None:
        self._driver = connection
        try:
            async for message in connection:
                wish = Wish.read(message)
                if wish is None:
                    await connection.close(1007, "that is no driving message")
                    return
                if not self.open:
                    await connection.close(1000)
                    return
                self._wish, self._heard = wish, time.perf_counter()
                self._presses.extend(wish.presses)
        except ConnectionClosed:
            pass
        finally:
            self._driver = self._wish = None

    def wish(self) -> Wish | None:
        """The newest one; None if there is none or it is too old."""
        wish = self._wish
        return wish if self.open and time.perf_counter() - self._heard < SILENCE else None

    def presses(self) -> list[str]:
        """Buttons pressed since the last call."""
        found = []
        while self._presses:
            found.append(self._presses.popleft())
        return found


@dataclasses.dataclass(frozen=True, eq=False)
class Wheel:
    """What a person may drive.

    Attributes:
        vehicle: in every world.
        give: writes inputs of one world for the control step that follows.
        leave: called when nobody drives a world any more.
        gears: whether the driver may choose gears.
    """

    vehicle: AnyVehicle
    give: Callable[[int, Inputs], None]
    leave: Callable[[int], None]
    gears: bool = False


def vehicle_of(subject: Subject) -> AnyVehicle | None:
    """The first vehicle of a subject."""
    if not {"simwarp.vehicle.vehicle", "simwarp.vehicle.tracks.tracked_vehicle"} & sys.modules.keys():
        return None  # nothing is of a class that nobody imported, and importing all of a vehicle takes seconds
    from simwarp.vehicle.tracks.tracked_vehicle import TrackedVehicle
    from simwarp.vehicle.vehicle import Vehicle

    elements = [*subject.elements.values(), *subject.simulation.elements]
    return next((element for element in elements if isinstance(element, (Vehicle, TrackedVehicle))), None)


def wheel_of(subject: Subject) -> Wheel | None:
    """What a person may drive of a subject: its own `details`, else a vehicle that nothing else drives."""
    if WHEEL in subject.details:
        wheel: Wheel | None = subject.details[WHEEL]
        return wheel
    vehicle = vehicle_of(subject)
    if vehicle is None or _driven(vehicle, subject.simulation.elements):
        return None

    def give(world: int, inputs: Inputs) -> None:
        write_row(vehicle.input, world, inputs.row)

    return Wheel(vehicle, give, lambda world: give(world, PARKED), gears=vehicle.parts.spec.has_gears)


def _driven(vehicle: AnyVehicle, elements: Sequence[Any]) -> bool:
    """Whether a driver is among the elements: it would write over what a person gives."""
    return any(getattr(element, "vehicle", None) is vehicle for element in elements)


def write_row(array: Any, world: int, values: Sequence[float]) -> None:
    """Writes one world's row of a (W, N) float array from the host, on any device, in order with its launches."""
    row: wp.array = wp.array(np.asarray(values, np.float32), dtype=wp.float32, device="cpu")
    wp.copy(array.flatten(), row, dest_offset=world * len(values), count=len(values))


def read_row(array: Any, world: int) -> Any:
    """One world's entry of an array, on the host."""
    return array[world : world + 1].numpy()[0]


def change_gear(vehicle: AnyVehicle, world: int, *, up: bool) -> None:
    """One gear up or down, as far as the gearbox lets a driver choose."""
    from simwarp.vehicle.spec.vehicle_spec import ManualShafts

    gearbox: Any = vehicle.parts.spec.transmission
    gears = len(getattr(gearbox, "forward_ratios", (1.0,)))
    speed = float(read_row(vehicle.velocity_b, world)[0])
    gear = int(read_row(vehicle.gear, world))
    chosen = shifted(gear, up, speed=speed, gears=gears, manual=isinstance(gearbox, ManualShafts))
    if chosen != gear:
        row: wp.array = wp.array(np.array([chosen], np.int32), dtype=wp.int32, device="cpu")
        wp.copy(vehicle.gear, row, dest_offset=world, count=1)


class Driving:
    """Hands a person's inputs to the wheel before every control step.

    Args:
        wheel: that is driven.
        socket: where wishes come from.
        dt: time of a control step [s].
        world: returns the index of the world that is driven.
        pressed: called with every other button, "reset" and "camera", and with `TAKEN` for another world.

    Attributes:
        driver: its `keys` may be changed at any time.
    """

    def __init__(
        self, wheel: Wheel, socket: DriveSocket, dt: float, world: Callable[[], int], pressed: Callable[[str], None]
    ) -> None:
        self.wheel, self.socket = wheel, socket
        self.driver = HumanDriver(Keys.SMOOTH)
        self._dt, self._world, self._pressed = dt, world, pressed
        self._now: int | None = None

    @property
    def on(self) -> bool:
        """Whether a person drives."""
        return self.socket.open

    def before_step(self) -> None:
        """Takes what was pressed, and gives the inputs of this control step."""
        if not self.on:
            self._leave()
            return
        world = self._world()
        if world != self._now:
            self._leave()
            self._now = world
            self.socket.presses()
            self._pressed(TAKEN)
        for press in self.socket.presses():
            self._press(press, world)
        speed = float(read_row(self.wheel.vehicle.velocity_b, world)[0])
        self.wheel.give(world, self.driver.step(self.socket.wish(), self._dt, speed))

    def _press(self, press: str, world: int) -> None:
        if press in ("gear_up", "gear_down"):
            if self.wheel.gears:
                change_gear(self.wheel.vehicle, world, up=press == "gear_up")
            return
        if press == "reset":
            self.driver.release()
        self._pressed(press)

    def _leave(self) -> None:
        if self._now is not None:
            self.driver.release()
            self.wheel.leave(self._now)
            self._now = None
