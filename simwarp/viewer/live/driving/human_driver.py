"""A person's hands and feet: from what keys and gamepads say to steering and pedals. Pure logic, without a server."""

from __future__ import annotations

import dataclasses
import enum
import json
import math
from typing import Any, Final

FULL_STEER: Final = 0.5
"""From the middle to full steering [s]."""
BACK_STEER: Final = 0.3
"""From full steering to the middle [s]."""
PEDAL: Final = 0.25
"""From a free pedal to a full one, and back [s]."""
HALF_SPEED: Final = 15.0
"""At this speed half of the steering is left [m/s]."""
SILENCE: Final = 0.5
"""Without a message for so long, nobody is at the wheel [s]."""
HELD_BRAKE: Final = 0.3
"""Of a vehicle with nobody at the wheel."""
CHRONO_STEP: Final = 1.0 / 50.0
CHRONO_GAIN: Final = 4.0
"""Of Chrono's interactive driver: inputs follow their targets at first order [1/s]."""
CHRONO_REPEAT: Final = 30.0
"""Steps of a target per second while a key is held: the usual key repeat."""
LONGEST: Final = 2000
"""Of a message [characters]."""
MOST_PRESSES: Final = 16


class Keys(enum.Enum):
    """What a held key does: moves the input to its end at a fixed rate, or steps its target as Chrono does."""

    SMOOTH = "smooth"
    CHRONO = "chrono"


@dataclasses.dataclass(frozen=True)
class Wish:
    """What a page says.

    Attributes:
        steer: -1..1, positive to the left.
        throttle, brake, clutch: 0..1.
        presses: buttons that went down since the message before: "gear_up", "gear_down", "reset", "camera".
    """

    steer: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0
    clutch: float = 0.0
    presses: tuple[str, ...] = ()

    @classmethod
    def read(cls, text: Any) -> Wish | None:
        """A message of `keys.js`; None for anything else."""
        if not isinstance(text, str) or len(text) > LONGEST:
            return None
        try:
            content = json.loads(text)
        except (ValueError, RecursionError):
            return None
        if not isinstance(content, dict):
            return None
        values = [content.get(name, 0.0) for name in ("steer", "throttle", "brake", "clutch")]
        presses = content.get("presses", [])
        if not all(isinstance(value, int | float) and math.isfinite(value) for value in values):
            return None
        if not isinstance(presses, list) or not all(isinstance(word, str) for word in presses):
            return None
        steer, throttle, brake, clutch = values
        pedals = _clip(throttle, 0.0), _clip(brake, 0.0), _clip(clutch, 0.0)
        return cls(_clip(steer, -1.0), *pedals, presses=tuple(presses[:MOST_PRESSES]))


@dataclasses.dataclass(frozen=True)
class Inputs:
    """Of a vehicle: steering -1..1, positive to the left; pedals 0..1."""

    steering: float = 0.0
    throttle: float = 0.0
    braking: float = 0.0
    clutch: float = 0.0

    @property
    def row(self) -> tuple[float, float, float, float]:
        """As `Vehicle.input` has them."""
        return self.steering, self.throttle, self.braking, self.clutch


class HumanDriver:
    """Turns wishes into inputs, step by step.

    Steering goes to full in 0.5 s and back in 0.3 s, and is limited to 1 / (1 + v / 15 m/s); pedals take 0.25 s. With
    Chrono's keys, targets move by 1/50 per repeat of a key, and inputs follow at first order with 4/s.

    Args:
        keys: what a held key does.

    Attributes:
        inputs: in force.
    """

    def __init__(self, keys: Keys = Keys.SMOOTH) -> None:
        self.keys = keys
        self.release()

    def release(self) -> None:
        """Lets go of everything at once: a new vehicle, or a new episode."""
        self.inputs = Inputs()
        self._targets = Inputs()
        self._held = False
        self._due = 0.0

    def step(self, wish: Wish | None, dt: float, speed: float) -> Inputs:
        """The inputs after `dt`.

        Args:
            wish: newest one; None: nobody is at the wheel, no throttle and 0.3 of the brake.
            dt: simulated time since the last call [s].
            speed: of the vehicle [m/s].
        """
        if wish is None:
            self._targets = Inputs()
            self.inputs = Inputs(_towards(self.inputs.steering, 0.0, dt), 0.0, HELD_BRAKE, 0.0)
            return self.inputs
        if self.keys is Keys.CHRONO:
            self.inputs = self._as_chrono(wish, dt)
            return self.inputs
        limit = 1.0 / (1.0 + abs(speed) / HALF_SPEED)
        steering = _towards(self.inputs.steering, min(max(wish.steer, -limit), limit), dt)
        now, reach = self.inputs, dt / PEDAL
        self.inputs = Inputs(
            steering, _moved(now.throttle, wish.throttle, reach), _moved(now.braking, wish.brake, reach),
            _moved(now.clutch, wish.clutch, reach),
        )  # fmt: skip
        return self.inputs

    def _as_chrono(self, wish: Wish, dt: float) -> Inputs:
        target = self._targets
        steer, throttle, brake = target.steering, target.throttle, target.braking
        for _ in range(self._repeats(wish, dt)):
            steer = _clip(steer + CHRONO_STEP * wish.steer, -1.0)
            if wish.throttle > 0.0:
                throttle = _clip(throttle + CHRONO_STEP * wish.throttle, 0.0)
                brake = _clip(brake - 3.0 * CHRONO_STEP * wish.throttle, 0.0)
            elif wish.brake > 0.0:
                throttle = _clip(throttle - 3.0 * CHRONO_STEP * wish.brake, 0.0)
                if throttle <= 0.0:
                    brake = _clip(brake + CHRONO_STEP * wish.brake, 0.0)
        self._targets = Inputs(steer, throttle, brake, wish.clutch)
        share = 1.0 - math.exp(-CHRONO_GAIN * dt)
        rows = zip(self.inputs.row, self._targets.row, strict=True)
        return Inputs(*(now + share * (there - now) for now, there in rows))

    def _repeats(self, wish: Wish, dt: float) -> int:
        """Steps that held keys make in this time: one at once, then as keys repeat."""
        held = bool(wish.steer or wish.throttle or wish.brake)
        if held and not self._held:
            self._due = 1.0
        elif held:
            self._due += CHRONO_REPEAT * dt
        self._held = held
        count = int(self._due + 1e-9) if held else 0
        self._due -= count
        return count


def shifted(gear: int, up: bool, *, speed: float, gears: int, manual: bool) -> int:
    """The gear after a press of a gear key: all gears of a manual gearbox; reverse, neutral and drive of others.

    Args:
        gear: now: -1 reverse, 0 neutral, 1 and up forward.
        up: one up, else one down.
        speed: ahead [m/s]; an automatic gearbox takes no reverse above 2 m/s, nor drive while it rolls back.
        gears: forward gears.
        manual: whether the driver chooses among them.
    """
    if manual:
        return min(max(gear + (1 if up else -1), -1), gears)
    chosen = min(max(min(gear, 1) + (1 if up else -1), -1), 1)
    if chosen * speed < -2.0:
        return gear
    return gear if chosen == 1 and gear > 1 else chosen


def _towards(steering: float, target: float, dt: float) -> float:
    """Steering after `dt`: out to its target in 0.5 s, back through the middle in 0.3 s."""
    if steering * target < 0.0 or abs(target) < abs(steering):
        back = 0.0 if steering * target < 0.0 else target
        needed = BACK_STEER * abs(steering - back)
        if needed >= dt or back == target:
            return _moved(steering, back, dt / BACK_STEER)
        return _moved(0.0, target, (dt - needed) / FULL_STEER)
    return _moved(steering, target, dt / FULL_STEER)


def _moved(value: float, target: float, reach: float) -> float:
    """The value, nearer to its target by at most `reach`."""
    return min(max(target, value - reach), value + reach)


def _clip(value: float, low: float) -> float:
    return min(max(float(value), low), 1.0)
