"""What every driving task may be given: what its policy sees, the ground, the camera and the lidar."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Annotated, TypeAlias

import simwarp as sw
from simwarp.tasks import Ge, Gt, Le, Lt, NotNegative, Positive

from ..framework.config import require
from ..randomisation.randomisation_config import Uncertainty
from .conditions import ConditionsConfig
from .soil import SoilKind

_LIDAR_ELEVATION = math.radians(15.0)
"""Of the uppermost beams [rad]; the lowest ones point as far down."""


class Observing(enum.Enum):
    """Observations of a policy: a camera's or a lidar's image beside a few numbers, or exact numbers alone."""

    STATE = "state"
    CAMERA = "camera"
    LIDAR = "lidar"


class Frame(enum.Enum):
    """Axes in which the place of a goal or a leader is observed: those of the vehicle, or those of the world."""

    VEHICLE = "vehicle"
    WORLD = "world"


Pixels: TypeAlias = Annotated[int, Ge(36)]
"""Below, the kernels of the networks' convolutions do not fit whole."""


@dataclasses.dataclass(frozen=True)
class DrivingConfig(ConditionsConfig):
    """Fields of every driving task."""

    dt: Positive = 0.0025
    """Time step of the physics [s]; tires and suspensions are stiff."""
    decimation: Annotated[int, Ge(1), Le(100_000)] = 40
    """Physics steps per control step: ten actions a second."""
    obs: Observing = Observing.CAMERA
    """camera: an image and what a vehicle measures; lidar: a range image in its place; state: exact relative positions,
    which trains fast on a CPU."""
    full: bool = False
    """Drive the full vehicle model instead of the reduced one that policies are trained on."""
    soil: SoilKind = SoilKind.NONE
    """Deformable ground below rigid wheels: a soil by name; random: between soft and hard, drawn for every episode, one
    in five nearly rigid. none: rigid ground below the vehicle's own tires. On soil its own strength counts in place of
    `friction`."""
    soil_spacing: Positive = 0.1
    """Of the soil's nodes [m]: at most half the width of a wheel."""
    soil_pages: Annotated[int, Ge(16), Le(2**20)] | None = None
    """8 x 8 nodes each, of every world; None: as many as the ruts of an episode take, or of its last 200 m."""
    images_alone: bool = False
    """By camera there is no group `policy` beside the image."""
    camera_width: Pixels = 80
    """Of the image [pixels], 36 at least."""
    camera_height: Pixels = 45
    """Of the image [pixels], 36 at least."""
    camera_fov: Annotated[float, Gt(0.0), Lt(math.pi)] = math.pi / 3.0
    """Horizontal field of view [rad]."""
    camera_rate: Positive | None = None
    """Images per second [Hz]; None: one at the end of each control step, as no policy sees more."""
    lidar_rows: Annotated[int, Ge(1), Le(1024)] = 16
    """Beams of the lidar above each other, evenly from 15 degrees up to 15 degrees down."""
    lidar_columns: Annotated[int, Ge(1), Le(65_536)] = 900
    """Beams of the lidar in a row."""
    lidar_fan: Annotated[float, Gt(0.0), Le(2.0 * math.pi)] = math.radians(240.0)
    """Angle of a row, from the leftmost to the rightmost beam [rad]."""
    lidar_range: Positive = 30.0
    """Distance beyond which the lidar sees nothing [m]."""
    action_rise_time: NotNegative | tuple[NotNegative, ...] = 0.5
    """Time in which steering and pedals move from 0 to 1 [s]."""

    def validate(self) -> None:
        """Check what depends on several fields."""
        super().validate()
        require(self.tires is None or self.soil is SoilKind.NONE, self, "tires", "None on soil, which has its own")

    @property
    def uncertainty(self) -> Uncertainty:
        """What is drawn, mass and delays of the conditions with it."""
        return self.uncertainty_of(super().uncertainty, camera=self.obs is Observing.CAMERA)

    def camera(self) -> sw.sensors.CameraConfig:
        """Return the numbers of the camera."""
        rate = min(self.camera_rate or 1.0 / self.control_dt, 1.0 / self.dt)
        return sw.sensors.CameraConfig(
            schedule=sw.sensors.Schedule(rate=rate), width=self.camera_width, height=self.camera_height,
            lens=sw.sensors.Pinhole(fov=self.camera_fov),
        )  # fmt: skip

    def lidar(self) -> sw.sensors.LidarConfig:
        """Return the numbers of the lidar, which sees `lidar_range` where nothing is nearer."""
        beams = sw.sensors.beam_grid(
            self.lidar_columns, self.lidar_rows, azimuth=(0.5 * self.lidar_fan, -0.5 * self.lidar_fan),
            elevation=(_LIDAR_ELEVATION, -_LIDAR_ELEVATION),
        )  # fmt: skip
        return sw.sensors.LidarConfig(
            schedule=sw.sensors.Schedule(rate=min(1.0 / self.control_dt, 1.0 / self.dt)), beams=beams,
            far=self.lidar_range, outputs=("ranges",), miss="far",
        )  # fmt: skip
