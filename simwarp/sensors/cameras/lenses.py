"""Lenses of cameras: what part of the world an image shows, and how it bends it.

Directions are in the camera's axes: X forward, Y left, Z up. A point of the image is (u, v): u from -1 at the left edge
to 1 at the right, v upwards in the same unit, so that v reaches height / width at the top. Pixels are square; the
middle of pixel (row, column) is at u = (2 column + 1) / width - 1, v = (height - 2 row - 1) / width.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.constraints import Gt, Lt, Meaning, Read, Tagged
from simwarp.core.types import ModelError
from simwarp.sensors.cameras.lenses_kernels import Lens as LensNumbers, LensKind
from simwarp.sensors.interface import Configuration
from simwarp.sensors.ranging.beams import ROUNDED

Array = npt.NDArray[np.float64]

_FULL_TURN = 2.0 * math.pi


class Lens(Protocol):
    """Interface of a lens."""

    def numbers(self, aspect: float) -> LensNumbers:
        """For the kernels; `aspect` is height / width of the image."""
        ...

    def points(self, directions: npt.ArrayLike) -> Array:
        """(..., 2) places (u, v) of directions (..., 3) in the camera's axes; NaN where the lens does not see them."""
        ...


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pinhole(Configuration):
    """Straight lines stay straight: tan of the angle from the axis grows with the distance from the middle.

    Attributes:
        fov: angle between the left and the right edge of the image [rad], below pi.
    """

    kind: Literal["pinhole"] = "pinhole"
    fov: Annotated[float, Gt(0.0), Lt(math.pi), Meaning("radians, FishEye sees more")] = 1.5

    def numbers(self, aspect: float) -> LensNumbers:
        """The lens as kernels read it; `aspect`: ratio of the image's height to its width."""
        return _numbers(LensKind.PINHOLE, math.tan(0.5 * self.fov))

    def points(self, directions: npt.ArrayLike) -> Array:
        """(..., 2) places (u, v) in the image of directions (..., 3) in the camera's axes.

        u runs from -1 at the left edge to 1 at the right, v upwards in the same unit. NaN behind the camera.
        """
        return _plane(directions) / math.tan(0.5 * self.fov)

    def intrinsics(self, width: int, height: int) -> Array:
        """The (3, 3) matrix that takes a point (right, down, forward) [m] to (column, row, 1) times its depth; the
        middle of the first pixel is at (0.5, 0.5).
        """
        focal = 0.5 * width / math.tan(0.5 * self.fov)
        return np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])


@dataclasses.dataclass(frozen=True, kw_only=True)
class FishEye(Configuration):
    """The FOV model of Devernay and Faugeras (2001), its angle that of the image: the angle from the axis grows in
    proportion to the distance from the middle.

    Attributes:
        fov: angle between the left and the right edge of the image [rad], at most 2 pi (1e-4 more is a
            rounded 2 pi).
    """

    kind: Literal["fish-eye"] = "fish-eye"
    fov: Annotated[float, Gt(0.0), Lt(_FULL_TURN + ROUNDED), Meaning("radians")] = math.pi

    def check(self) -> None:
        """Sets an angle of view that is a rounded full turn to exactly 2 pi [rad]."""
        object.__setattr__(self, "fov", min(self.fov, _FULL_TURN))

    def numbers(self, aspect: float) -> LensNumbers:
        """The lens as kernels read it; `aspect`: ratio of the image's height to its width."""
        return _numbers(LensKind.FISH_EYE, 0.5 * self.fov)

    def points(self, directions: npt.ArrayLike) -> Array:
        """(..., 2) places (u, v) in the image of directions (..., 3) in the camera's axes.

        u runs from -1 at the left edge to 1 at the right, v upwards in the same unit.
        """
        d = np.asarray(directions, dtype=np.float64)
        across = np.hypot(d[..., 1], d[..., 2])
        angle = np.arctan2(across, d[..., 0])
        scale = angle / np.maximum(across, 1e-300) / (0.5 * self.fov)
        return np.stack([-d[..., 1] * scale, d[..., 2] * scale], axis=-1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Radial(Configuration):
    """A pinhole whose image is moved towards or away from its middle: r -> r (1 + k1 r² + k2 r⁴ + k3 r⁶), r being the
    distance from the axis in focal lengths (Brown 1966, and the usual calibration tools).

    k1 < 0 gives a barrel, k1 > 0 a cushion.

    Attributes:
        fov: angle that a pinhole of the same focal length would see between the left and the right edge [rad].
        k1, k2, k3: coefficients. The law has to rise up to the corners of the image.
    """

    kind: Literal["radial"] = "radial"
    fov: Annotated[float, Gt(0.0), Lt(math.pi), Meaning("radians, FishEye sees more")] = 1.5
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0

    def numbers(self, aspect: float) -> LensNumbers:
        """The lens as kernels read it; `aspect`: ratio of the image's height to its width.

        Raises:
            ModelError: the lens folds inside the image: two directions would meet in one pixel.
        """
        scale = math.tan(0.5 * self.fov)
        corner = scale * math.hypot(1.0, aspect)
        limit = self._undistorted_limit(corner)
        made = _numbers(LensKind.RADIAL, scale)
        made.k = wp.vec3(self.k1, self.k2, self.k3)
        made.limit = limit
        return made

    def points(self, directions: npt.ArrayLike) -> Array:
        """(..., 2) places (u, v) in the image of directions (..., 3) in the camera's axes.

        u runs from -1 at the left edge to 1 at the right, v upwards in the same unit.
        NaN beyond the place where the law stops rising: a lens sees nothing there.
        """
        plane = _plane(directions)
        s = (plane**2).sum(axis=-1, keepdims=True)
        moved = plane * (1.0 + s * (self.k1 + s * (self.k2 + s * self.k3)))
        fold = self._fold()
        return np.where(s <= fold**2, moved, np.nan) / math.tan(0.5 * self.fov)

    def intrinsics(self, width: int, height: int) -> Array:
        """The (3, 3) matrix of the pinhole of the same focal length, before the image is moved; see `Pinhole`."""
        return Pinhole(fov=self.fov).intrinsics(width, height)

    def _fold(self) -> float:
        """Distance at which the law stops rising: the least positive root of its derivative; infinite without one."""
        roots = np.roots([7.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1, 1.0])
        real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real
        return math.sqrt(float(real.min())) if len(real) else math.inf

    def _undistorted_limit(self, corner: float) -> float:
        """A distance that is moved to the corner of the image or a little beyond."""

        def law(r: float) -> float:
            s = r * r
            return r * (1.0 + s * (self.k1 + s * (self.k2 + s * self.k3)))

        fold = self._fold()
        if math.isfinite(fold) and law(fold) <= corner * (1.0 + 1e-6):
            half_width = max(law(fold), 0.0)
            raise ModelError(
                f"Radial lens: r (1 + k1 r² + k2 r⁴ + k3 r⁶) must rise up to the corner of the image, "
                f"got k1={self.k1:g}, k2={self.k2:g}, k3={self.k3:g}, which turns back at {half_width:.3g} focal "
                f"lengths, the corner being at {corner:.3g}; lower fov, or the size of the coefficients"
            )
        high = min(fold, 1.0)
        while law(high) < corner * (1.0 + 1e-6):
            high = min(fold, 2.0 * high)
        return high


LensField: TypeAlias = Annotated[Lens, Read(Annotated[Pinhole | FishEye | Radial, Tagged("kind")])]
"""A lens: in a file one of these, in Python anything that is one."""


def directions(lens: Lens, width: int, height: int) -> Array:
    """(height, width, 3) float64 unit directions of the middles of all pixels, as the kernels cast them (in float32).

    For point clouds: a pixel of range r shows the point r * direction in the camera's axes.
    """
    numbers = lens.numbers(height / width)
    u = (2.0 * np.arange(width) + 1.0) / width - 1.0
    v = (height - 2.0 * np.arange(height) - 1.0) / width
    plane = np.stack(np.broadcast_arrays(u[None, :], v[:, None]), axis=-1) * numbers.scale
    r = np.linalg.norm(plane, axis=-1, keepdims=True)
    if numbers.kind == LensKind.FISH_EYE:
        across = np.sinc(r / math.pi) * plane
        return np.concatenate([np.cos(r), -across[..., :1], across[..., 1:]], axis=-1)
    if numbers.kind == LensKind.RADIAL:
        plane = plane * (
            _undistorted(r, np.asarray(numbers.k, dtype=np.float64), numbers.limit) / np.maximum(r, 1e-300)
        )
    forward = np.ones_like(r)
    d = np.concatenate([forward, -plane[..., :1], plane[..., 1:]], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def _undistorted(target: Array, k: Array, limit: float) -> Array:
    """Inverse of the distortion in float64, as the kernel of the same name: bisection, then Newton's method."""
    low, high = np.zeros_like(target), np.full_like(target, limit)
    for _ in range(40):
        middle = 0.5 * (low + high)
        s = middle**2
        above = middle * (1.0 + s * (k[0] + s * (k[1] + s * k[2]))) > target
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    r = 0.5 * (low + high)
    for _ in range(2):
        s = r**2
        error = r * (1.0 + s * (k[0] + s * (k[1] + s * k[2]))) - target
        r = r - error / (1.0 + s * (3.0 * k[0] + s * (5.0 * k[1] + s * 7.0 * k[2])))
    return r


def _numbers(kind: LensKind, scale: float) -> LensNumbers:
    made = LensNumbers()
    made.kind, made.scale = int(kind), scale
    return made


def _plane(directions: npt.ArrayLike) -> Array:
    """(..., 2) right and up per unit of forward; NaN for what is not in front."""
    d = np.asarray(directions, dtype=np.float64)
    forward = np.where(d[..., :1] > 0.0, d[..., :1], np.nan)
    return np.concatenate([-d[..., 1:2], d[..., 2:3]], axis=-1) / forward
