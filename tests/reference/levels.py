"""Levels of a curriculum on rough ground, one world at a time, in float64."""

from __future__ import annotations

import numpy as np


class Climber:
    """One world that climbs.

    Args:
        level: where it begins.
        reach: distance from the middle to where a patch is left [m].
        beyond: distance from the middle that is to be exceeded to go up [m].
        up: share of the way that is enough to go up.
        down: share of the commanded way below which it goes down.
        least: commanded way below which nothing is decided [m].
    """

    def __init__(self, level: int, *, reach: float, beyond: float, up: float, down: float, least: float) -> None:
        self.level, self.reach, self.beyond = level, reach, beyond
        self.up, self.down, self.least = up, down, least
        self.begin()

    def begin(self) -> None:
        """A new episode."""
        self.walked, self.asked, self.to_come, self.farthest = 0.0, 0.0, 0.0, 0.0

    def walk(self, velocity, command, place, dt: float, remaining: float) -> None:
        """A control step of `dt` [s], `remaining` [s] before the end: velocity, command [m/s], where it leads [m]."""
        v, c = np.asarray(velocity, np.float64), np.asarray(command, np.float64)
        speed = float(np.sqrt(c @ c))
        if speed > 1e-3:
            self.walked += dt * min(float(v @ c) / speed, speed)
            self.asked += dt * speed
        self.to_come = speed * remaining
        self.farthest = max(self.farthest, abs(float(place[0])), abs(float(place[1])))

    def judge(self) -> str:
        """What follows: "up", "down" or "stay"."""
        expected = self.asked + self.to_come
        if expected < self.least:
            return "stay"
        if self.walked > self.up * min(self.reach, expected) and self.farthest > self.beyond:
            return "up"
        return "down" if self.walked < self.down * expected else "stay"
