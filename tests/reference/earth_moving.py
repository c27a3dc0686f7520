"""The fundamental equation of earth moving (Reece 1965; McKyes 1985, Soil Cutting and Tillage, chapter 2), in NumPy.

A wide blade at constant depth: the soil ahead fails along a plane from its edge to the surface. Written from the
equation, P = (gamma d^2 N_gamma + c d N_c + q d N_q + c_a d N_ca) w, and found by trying failure angles.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

G = 9.81


@dataclasses.dataclass(frozen=True)
class Cut:
    """A blade and the soil that it cuts; angles [rad].

    Attributes:
        density: of the soil [kg/m³].
        cohesion: of the soil [Pa].
        phi: angle of internal friction.
        depth: of the edge below the ground [m].
        rake: of the face from the ground ahead.
        delta: angle of friction on the face.
        adhesion: on the face [Pa].
    """

    density: float
    cohesion: float
    phi: float
    depth: float
    rake: float
    delta: float
    adhesion: float = 0.0

    def factors(self, beta: np.ndarray) -> tuple[np.ndarray, ...]:
        """N_gamma, N_c, N_q, N_ca at failure angles."""
        a, b = 1.0 / math.tan(self.rake), 1.0 / np.tan(beta)
        slip = 1.0 / np.tan(beta + self.phi)
        below = math.cos(self.rake + self.delta) + math.sin(self.rake + self.delta) * slip
        below = np.where((below > 1e-9) & (a + b > 0.0), below, np.nan)
        return (a + b) / (2.0 * below), (1.0 + b * slip) / below, (a + b) / below, (1.0 - a * slip) / below

    def failure(self, surcharge: float = 0.0) -> tuple[float, float]:
        """The failure angle with the least P, and that P per metre of width [N/m].

        Args:
            surcharge: q, pressure on the ground ahead [Pa].
        """
        beta = np.linspace(0.01, math.pi - self.rake - self.delta - self.phi - 1e-3, 40001)
        n_gamma, n_c, n_q, n_ca = self.factors(beta)
        d = self.depth
        force = self.density * G * d * d * n_gamma + self.cohesion * d * n_c + surcharge * d * n_q
        force = force + self.adhesion * d * n_ca
        best = int(np.nanargmin(force))
        return float(beta[best]), float(force[best])

    def draft(self, width: float, surcharge: float = 0.0) -> float:
        """Horizontal force on the blade, against its motion [N]."""
        force = self.failure(surcharge)[1]
        grip = self.adhesion * self.depth / math.tan(self.rake)
        return width * (force * math.sin(self.rake + self.delta) + grip)

    def lift(self, width: float, surcharge: float = 0.0) -> float:
        """Vertical force on the blade, positive upwards [N]."""
        force = self.failure(surcharge)[1]
        return width * (self.adhesion * self.depth - force * math.cos(self.rake + self.delta))

    def base(self, surcharge: float = 0.0) -> float:
        """Length of the wedge on the ground, from above the edge on [m]."""
        beta, _ = self.failure(surcharge)
        return self.depth / math.tan(beta)
