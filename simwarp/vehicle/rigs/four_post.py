"""A four-post rig: a vehicle on posts that move as a sine of one frequency in each world, or as the roads of ISO 8608.

All frequencies, modes and roads of a run are worlds of one batch. Wheels are held by their brakes; there is a post for
every wheel, whatever their number.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Readable, Row, plural
from simwarp.vehicle.rigs.post_rig import SLIDING, PostRig
from simwarp.vehicle.rigs.rig_rows import Progress, Reasons, RigRows, RowStatus, Statuses
from simwarp.vehicle.roads.road_profiles import ROAD_CLASSES, RoadClass, RoadProfile, road_profile
from simwarp.vehicle.spec.parts import Array, SpecError
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

Complex = npt.NDArray[np.complex128]
RAMP: Final = 1.0
"""In which posts reach their amplitude [s]."""
LEAST_CYCLES: Final = 2.0
"""Periods after that before anything is measured."""
ROAD_DT: Final = 2.0e-3
"""Between two samples of a drive over a road [s]."""
SHORTEST: Final = 0.1
"""Drive that has accelerations at the longest time step [s]."""


class PostMode(enum.Enum):
    """How posts move together."""

    HEAVE = "heave"
    """All alike."""
    PITCH = "pitch"
    """The first axle's against those behind."""
    ROLL = "roll"
    """The left ones against the right ones."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SineSweep:
    """Sines of a four-post rig: each mode at each frequency is a world."""

    modes: tuple[PostMode, ...] = (PostMode.HEAVE, PostMode.PITCH)
    low: float = 0.5
    """Lowest frequency [Hz]."""
    high: float = 20.0
    """Highest frequency [Hz]."""
    points: int = 21
    """Frequencies, evenly on a logarithmic axis."""
    amplitude: float = 0.005
    """Of the posts, as far as their speed allows [m]."""
    speed: float = 0.1
    """Largest amplitude of the posts' speed [m/s]."""
    settle: float = 3.0
    """Before posts move [s]."""
    transient: float = 2.0
    """For vibrations of the start to die out [s]."""
    cycles: int = 4
    """Periods that are measured."""
    grip: float = SLIDING
    """Ratio of the posts' friction to that on which a tire was measured: small where patches slide aside as those of
    rolling wheels, large where they are held.
    """

    def check(self) -> None:
        """Ranges are not empty.

        Raises:
            SpecError: one is.
        """
        if not (0.0 < self.low < self.high < 100.0):
            raise SpecError(f"frequencies: must be 0 < low < high < 100 Hz, got {self.low:g} to {self.high:g} Hz")
        if self.points < 2 or self.cycles < 1 or not self.modes:
            got = f"{len(self.modes)} modes, {self.points} points and {self.cycles} cycles"
            raise SpecError(f"sweep: must have a mode, 2 points and 1 cycle at least, got {got}")
        for name in ("amplitude", "speed"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise SpecError(f"{name}: must be > 0 and finite, got {getattr(self, name):g}")
        for name in ("settle", "transient"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise SpecError(f"{name}: must be >= 0 s and finite, got {getattr(self, name):g}")

    @property
    def frequencies(self) -> Array:
        """(points,) of one mode [Hz]."""
        return np.geomspace(self.low, self.high, self.points)


@dataclasses.dataclass(frozen=True, repr=False)
class FourPostResponse(Readable):
    """Transfer functions from the posts to the vehicle; n worlds. NaN where a world is not DONE.

    Attributes:
        sweep: that was asked for.
        mode: (n,) indices into its modes.
        frequency: (n,) [Hz].
        amplitude: (n,) of the posts [m].
        heave: (n,) ratio of the motion of the chassis' centre of mass to that of the posts, complex.
        pitch: (n,) angle of the chassis, nose down, to the posts' motion [rad/m], complex.
        roll: (n,) angle of the chassis to the posts' motion [rad/m], complex.
        acceleration: (n,) of the chassis' centre of mass upwards to the posts' motion [1/s²], complex.
        load: (n, wheels) change of the wheel load to the posts' motion [N/m], complex.
        travel: (n, wheels) ratio of the wheels' travel against the chassis to the posts' motion, complex.
        static_load: (wheels,) of the standing vehicle [N].
        status: (n,) `RowStatus`.
        reason: (n,) texts: why a world diverged; empty of the others.
    """

    sweep: SineSweep
    mode: npt.NDArray[np.int64]
    frequency: Array
    amplitude: Array
    heave: Complex
    pitch: Complex
    roll: Complex
    acceleration: Complex
    load: Complex
    travel: Complex
    static_load: Array
    status: Statuses
    reason: Reasons

    def _readable_title(self) -> str:
        return f": {plural(len(self.frequency), 'world')}"

    def of(self, mode: PostMode) -> npt.NDArray[np.bool_]:
        """(n,) which worlds are of a mode."""
        return np.asarray([self.sweep.modes[k] is mode for k in self.mode])

    def rows(self) -> RigRows:
        """Worlds as rows: sizes, and the phase of the chassis' heave in degrees."""
        columns: dict[str, npt.NDArray[Any]] = {
            "mode": np.array([self.sweep.modes[k].value for k in self.mode]), "frequency_Hz": self.frequency,
            "amplitude_m": self.amplitude, "heave_per_post": np.abs(self.heave),
            "heave_phase_deg": np.rad2deg(np.angle(self.heave)),
            "acceleration_per_post_1_per_s2": np.abs(self.acceleration),
            "pitch_per_post_rad_per_m": np.abs(self.pitch), "roll_per_post_rad_per_m": np.abs(self.roll),
        }  # fmt: skip
        for wheel in range(self.load.shape[1]):
            columns[f"load{wheel}_per_post_N_per_m"] = np.abs(self.load[:, wheel])
            columns[f"travel{wheel}_per_post"] = np.abs(self.travel[:, wheel])
        return RigRows(columns, self.status, self.reason, ("mode", "frequency_Hz"))

    def parameters(self) -> dict[str, float]:
        """Peaks of the chassis' motion and of the first wheel's load, and where they are [Hz]; keys name units."""
        found: dict[str, float] = {f"static_load{k}_N": float(v) for k, v in enumerate(self.static_load)}
        for mode in self.sweep.modes:
            chosen = self.of(mode)
            motion = {PostMode.HEAVE: self.heave, PostMode.PITCH: self.pitch, PostMode.ROLL: self.roll}[mode]
            for name, values in ((f"{mode.value}_peak", motion), (f"{mode.value}_load_peak", self.load[:, 0])):
                size = np.where(chosen & np.isfinite(np.abs(values)), np.abs(values), -1.0)
                best = int(size.argmax())
                known = size[best] >= 0.0
                found[name] = float(size[best]) if known else math.nan
                found[f"{name}_Hz"] = float(self.frequency[best]) if known else math.nan
        return found


def run_four_post(
    spec: VehicleSpec, sweep: SineSweep | None = None, *, dt: float = 1.0e-3, device: str = "cpu",
    progress: Progress | None = None,
) -> FourPostResponse:  # fmt: skip
    """Transfer functions of a vehicle on posts that move as sines.

    An interruption leaves the worlds whose cycles are complete.

    Args:
        spec: the vehicle.
        sweep: what to go through; None: heave and pitch from 0.5 to 20 Hz.
        dt: time step [s].
        device: that runs the worlds.
        progress: is called with the share that is done.

    Raises:
        SpecError: an empty range, or a tire that makes no forces of its own.
    """
    asked = SineSweep() if sweep is None else sweep
    asked.check()
    modes = np.repeat(np.arange(len(asked.modes)), asked.points)
    frequency = np.tile(asked.frequencies, len(asked.modes))
    rig = PostRig(spec, len(frequency), dt=dt, grip=asked.grip, device=device)
    amplitude = np.minimum(asked.amplitude, asked.speed / (2.0 * math.pi * frequency))
    shape = np.stack([_shape(asked.modes[k], rig) for k in modes])
    start = asked.settle + RAMP + np.maximum(asked.transient, LEAST_CYCLES / frequency)
    end = start + asked.cycles / frequency
    total = math.ceil(float(end.max()) / dt)
    wheels = len(rig.spindles)
    fit = _SineFit(len(frequency), 3 + 2 * wheels)
    static = np.zeros(wheels)
    time = 0.0
    try:
        for step in range(total):
            begin, time = step * dt, (step + 1) * dt
            if begin > asked.settle:  # posts are where they are when the step's forces are found
                if not static.any():
                    static = rig.loads()[0]
                rig.move(*_sines(amplitude, frequency, begin - asked.settle, shape))
            rig.step()
            inside = (time >= start) & (time < end)
            if inside.any():
                signals = [rig.chassis_motion(), rig.loads(), rig.suspension_travel()]
                fit.add(2.0 * math.pi * frequency * (time - asked.settle), np.concatenate(signals, axis=1), inside)
            if progress is not None and step % 100 == 0:
                progress(step / total)
    except KeyboardInterrupt:
        if not (time >= end).any():
            raise
    found = fit.amplitudes() / amplitude[:, None]
    found[:, 3 : 3 + wheels] *= np.exp(2j * math.pi * frequency * dt)[:, None]  # loads are of the steps' beginning
    status = np.where(time >= end - dt, RowStatus.DONE, RowStatus.UNFINISHED).astype(np.int8)
    odd = (status == RowStatus.DONE) & ~np.isfinite(found).all(axis=1) & ~rig.broken()
    rig.reason[odd] = "a signal that is measured is not finite"
    status[rig.broken() | odd] = RowStatus.DIVERGED
    found[status != RowStatus.DONE] = np.nan
    heave, roll, pitch = found[:, 0], found[:, 1], found[:, 2]
    return FourPostResponse(
        asked, modes, frequency, amplitude, heave, pitch, roll, -((2.0 * math.pi * frequency) ** 2) * heave,
        found[:, 3 : 3 + wheels], found[:, 3 + wheels :], static, status, rig.reason,
    )  # fmt: skip


def _shape(mode: PostMode, rig: PostRig) -> Array:
    """(wheels,) motion of the posts in a mode, for a unit of its amplitude."""
    sides = rig.vehicle.parts.sides
    if mode is PostMode.HEAVE:
        return np.ones(len(sides))
    if mode is PostMode.ROLL:
        return np.array([side.side for side in sides])
    if len({side.axle for side in sides}) == 1:
        raise SpecError("mode: pitch needs two axles, and this vehicle has one; take heave")
    return np.array([1.0 if side.axle == 0 else -1.0 for side in sides])


def _sines(amplitude: Array, frequency: Array, time: float, shape: Array) -> tuple[Array, Array]:
    """(n, wheels) heights [m] and speeds [m/s] of posts a time [s] after they began to move."""
    share = min(time / RAMP, 1.0)
    ramp, rate = share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share) / RAMP
    omega = 2.0 * math.pi * frequency
    sine, cosine = np.sin(omega * time), omega * np.cos(omega * time)
    return (amplitude * ramp * sine)[:, None] * shape, (amplitude * (rate * sine + ramp * cosine))[:, None] * shape


class _SineFit:
    """Least squares of a constant and a sine to signals that come in sample by sample, world by world."""

    def __init__(self, worlds: int, signals: int) -> None:
        self._square = np.zeros((worlds, 3, 3))
        self._target = np.zeros((worlds, 3, signals))

    def add(self, phase: Array, signals: Array, inside: npt.NDArray[np.bool_]) -> None:
        """A sample of (n, signals) at phases (n,) of the posts [rad], of the worlds that are inside their time."""
        basis = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1) * inside[:, None]
        self._square += basis[:, :, None] * basis[:, None, :]
        self._target += basis[:, :, None] * signals[:, None, :]

    def amplitudes(self) -> Complex:
        """(n, signals) complex amplitudes against that of a sine; NaN where nothing was measured."""
        found = np.full((len(self._square), self._target.shape[2]), np.nan + 0j)
        known = np.abs(np.linalg.det(self._square)) > 0.0
        fitted = np.linalg.solve(self._square[known], self._target[known])
        found[known] = fitted[:, 2] + 1j * fitted[:, 1]
        return found


# ---- roads -----------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, kw_only=True)
class RoadSweep:
    """Roads of a four-post rig: each class at each speed is a world."""

    roads: tuple[RoadClass, ...] = ROAD_CLASSES
    speeds: tuple[float, ...] = (15.0,)
    """[m/s]."""
    duration: float = 20.0
    """Of the drive that is measured [s]."""
    settle: float = 3.0
    """Before it [s]."""
    seed: int = 0
    """Of the roads: the same waves in every class."""
    grip: float = SLIDING
    """As that of `SineSweep`."""

    def check(self) -> None:
        """Ranges are not empty.

        Raises:
            SpecError: one is.
        """
        if not self.roads or not self.speeds:
            raise SpecError("roads: must hold one class and one speed at least, got none")
        for speed in self.speeds:
            if not 0.0 < speed < math.inf:
                raise SpecError(f"speeds: must be > 0 m/s and finite, got {speed:g}")
        if not SHORTEST <= self.duration < math.inf:
            raise SpecError(f"duration: must be finite and at least {SHORTEST:g} s, got {self.duration:g}")
        if not 0.0 <= self.settle < math.inf:
            raise SpecError(f"settle: must be >= 0 s and finite, got {self.settle:g}")
        if self.seed < 0:
            raise SpecError(f"seed: must be 0 or more, got {self.seed}")


@dataclasses.dataclass(frozen=True, repr=False)
class RoadResponse(Readable):
    """What roads do to a vehicle; n worlds. NaN where a world is not DONE.

    Attributes:
        roads: (n) their classes.
        speed: (n,) [m/s].
        acceleration: (n,) root mean square of the chassis' centre of mass upwards [m/s²].
        pitch_acceleration: (n,) root mean square of the chassis [rad/s²].
        load_variation: (n, wheels) ratio of the root mean square of a wheel load's change to its mean.
        least_load: (n, wheels) ratio of the least load of a wheel to its mean.
        travel: (n, wheels) root mean square of a wheel's travel against the chassis [m].
        most_travel: (n, wheels) largest size of it [m].
        status: (n,) `RowStatus`.
        reason: (n,) texts: why a world diverged; empty of the others.
    """

    roads: tuple[RoadClass, ...]
    speed: Array
    acceleration: Array
    pitch_acceleration: Array
    load_variation: Array
    least_load: Array
    travel: Array
    most_travel: Array
    status: Statuses
    reason: Reasons

    def _readable_title(self) -> str:
        return f": {plural(len(self.roads), 'road')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        names = (f"class {road.value}, {speed:g} m/s" for road, speed in zip(self.roads, self.speed, strict=True))
        return {name: f"{value:.3g} m/s²" for name, value in zip(names, self.acceleration, strict=True)}

    def rows(self) -> RigRows:
        """Worlds as rows."""
        columns: dict[str, npt.NDArray[Any]] = {
            "road": np.array([road.value for road in self.roads]), "speed_mps": self.speed,
            "acceleration_rms_mps2": self.acceleration, "pitch_acceleration_rms_radps2": self.pitch_acceleration,
        }  # fmt: skip
        for wheel in range(self.travel.shape[1]):
            columns[f"load{wheel}_rms_per_mean"] = self.load_variation[:, wheel]
            columns[f"load{wheel}_least_per_mean"] = self.least_load[:, wheel]
            columns[f"travel{wheel}_rms_mm"] = 1e3 * self.travel[:, wheel]
            columns[f"travel{wheel}_most_mm"] = 1e3 * self.most_travel[:, wheel]
        return RigRows(columns, self.status, self.reason, ("road", "speed_mps"))

    def parameters(self) -> list[dict[str, Any]]:
        """One entry for every road; keys name units, such as [m/s²]."""
        return [
            {
                "road": road.value,
                "speed_mps": float(self.speed[k]),
                "acceleration_rms_mps2": float(self.acceleration[k]),
                "pitch_acceleration_rms_radps2": float(self.pitch_acceleration[k]),
                "load_rms_per_mean": float(self.load_variation[k].max()),
                "load_least_per_mean": float(self.least_load[k].min()),
                "travel_rms_mm": 1e3 * float(self.travel[k].max()),
                "travel_most_mm": 1e3 * float(self.most_travel[k].max()),
            }
            for k, road in enumerate(self.roads)
        ]


def run_four_post_roads(
    spec: VehicleSpec, sweep: RoadSweep | None = None, *, dt: float = 1.0e-3, device: str = "cpu",
    progress: Progress | None = None,
) -> RoadResponse:  # fmt: skip
    """A vehicle on posts that move as roads of ISO 8608 under it, those of the rear axles as much later as they follow.

    An interruption leaves the statistics of the drive so far; its rows are UNFINISHED and keep their numbers.

    Args:
        spec: the vehicle.
        sweep: what to go through; None: classes A to E at 15 m/s.
        dt: time step [s].
        device: that runs the worlds.
        progress: is called with the share that is done.

    Raises:
        SpecError: an empty range, or a tire that makes no forces of its own.
    """
    asked = RoadSweep() if sweep is None else sweep
    asked.check()
    worlds = [(road, speed) for road in asked.roads for speed in asked.speeds]
    rig = PostRig(spec, len(worlds), dt=dt, grip=asked.grip, device=device)
    places = rig.wheel_places()[0]
    track = float(places[0, 1] - places[1, 1])
    span = RAMP + asked.duration
    length = max(100.0, max(asked.speeds) * span + float(np.ptp(places[:, 0])))
    profile = road_profile(RoadClass.A, length, track=track, seed=asked.seed)
    # the same waves in every class: heights grow with the root of their density
    size = np.sqrt([road.roughness / RoadClass.A.roughness for road, _ in worlds])[:, None]
    speed = np.array([each for _, each in worlds])
    every, total = max(1, round(ROAD_DT / dt)), math.ceil((asked.settle + span) / dt)
    samples: list[Array] = []
    last = np.zeros((len(worlds), len(rig.spindles)))
    try:
        for step in range(total):
            driven = (step + 1) * dt - asked.settle
            if driven > 0.0:
                height = min(driven / RAMP, 1.0) * size * _heights(profile, speed * driven, places)
                rig.move(height, (height - last) / dt)
                last = height
            rig.step()
            if driven > RAMP and step % every == 0:
                samples.append(np.concatenate([rig.chassis_motion(), rig.loads(), rig.suspension_travel()], axis=1))
            if progress is not None and step % 100 == 0:
                progress(step / total)
        finished = True
    except KeyboardInterrupt:
        finished = False
        if len(samples) < 3:
            raise
    status = np.full(len(worlds), RowStatus.DONE if finished else RowStatus.UNFINISHED, np.int8)
    status[rig.broken()] = RowStatus.DIVERGED
    return _summed(tuple(road for road, _ in worlds), speed, np.array(samples), every * dt, status, rig.reason)


def _heights(road: RoadProfile, driven: Array, places: Array) -> Array:
    """(n, wheels) heights of the road [m] under wheels at places (wheels, 3), after (n,) distances [m]."""
    distance = driven[:, None] - (places[0, 0] - places[:, 0])
    return np.where(places[:, 1] > 0.0, road.at(distance, 0), road.at(distance, 1))


def _summed(
    roads: tuple[RoadClass, ...], speed: Array, samples: Array, spacing: float, status: Statuses, reason: Reasons
) -> RoadResponse:
    """Statistics of samples (times, n, signals), a spacing [s] apart."""
    wheels = (samples.shape[2] - 3) // 2
    second = (samples[2:] - 2.0 * samples[1:-1] + samples[:-2])[..., :3] / spacing**2
    rms = np.sqrt((second**2).mean(axis=0))
    load, travel = samples[..., 3 : 3 + wheels], samples[..., 3 + wheels :]
    mean, away = load.mean(axis=0), travel - travel.mean(axis=0)
    mean = np.where(mean > 0.0, mean, np.nan)
    found = RoadResponse(
        roads=roads, speed=speed, acceleration=rms[:, 0], pitch_acceleration=rms[:, 2],
        load_variation=load.std(axis=0) / mean, least_load=load.min(axis=0) / mean, travel=travel.std(axis=0),
        most_travel=np.abs(away).max(axis=0), status=status, reason=reason,
    )  # fmt: skip
    odd = (status == RowStatus.DONE) & ~np.isfinite(found.load_variation).all(axis=1)
    status[odd], reason[odd] = RowStatus.DIVERGED, "a wheel never stands on its post, or a signal is not finite"
    for name in ("acceleration", "pitch_acceleration", "load_variation", "least_load", "travel", "most_travel"):
        getattr(found, name)[status == RowStatus.DIVERGED] = np.nan
    return found
