"""Light, sky and the colours of grounds by day and by night."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np

Color = tuple[int, int, int]


@dataclasses.dataclass(frozen=True)
class PageLight:
    """How a page looks.

    Attributes:
        dark: whether its panels are.
        above, horizon: colours of the sky.
        from_sky: colour of the light that comes from everywhere.
        sky, sun: intensities of the light from everywhere, and of the sun.
        ground: share of a ground's colour that is seen.
    """

    dark: bool
    above: Color
    horizon: Color
    from_sky: Color
    sky: float
    sun: float
    ground: float

    def shaded(self, color: Any) -> Color:
        """A ground's colour in this light."""
        red, green, blue = (int(self.ground * int(value)) for value in color)
        return red, green, blue

    def background(self) -> Any:
        """(64, 8, 3) picture of the sky, uint8."""
        shade = np.linspace(0.0, 1.0, 64)[:, None, None]
        sky = (1.0 - shade) * np.array(self.above) + shade * np.array(self.horizon)
        return np.repeat(sky, 8, axis=1).astype(np.uint8)

    def shine(self, viser: Any) -> Any:
        """Lights a server's scene and colours its panels; returns the sun's handle."""
        viser.gui.configure_theme(
            control_layout="floating", control_width="medium", dark_mode=self.dark, show_logo=False,
            show_share_button=False, brand_color=(208, 92, 32),
        )  # fmt: skip
        scene = viser.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=False)
        scene.set_background_image(self.background(), format="png")
        scene.add_light_hemisphere(
            "/lights/sky", sky_color=self.from_sky, ground_color=(112, 104, 92), intensity=self.sky
        )
        return scene.add_light_directional(
            "/lights/sun", color=(255, 244, 224), intensity=self.sun, cast_shadow=True, position=(-6.0, -8.0, 14.0)
        )


DAY: Final = PageLight(False, (150, 186, 226), (232, 239, 246), (216, 230, 255), 1.0, 2.1, 1.0)
NIGHT: Final = PageLight(True, (18, 22, 30), (52, 60, 72), (150, 170, 205), 0.8, 1.5, 0.28)
