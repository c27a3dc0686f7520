"""Tension round the tracks of a vehicle, and the load under its shoes: at one instant, or means over many."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import ModelError
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.chassis_motion import ChassisMotion, matrices
from simwarp.vehicle.spec.track_parts import ShoeTrack
from simwarp.vehicle.tracks.shoe_construction import ShoeTrackParts
from simwarp.vehicle.tracks.tracked_vehicle import TrackedVehicle

Array = npt.NDArray[np.float64]

NORMAL: Final = 2
"""Axis of a shoe's frame that points inwards: loads are along it."""


@dataclasses.dataclass(frozen=True)
class ChainProfile:
    """One track, at places that rest in the vehicle's frame while shoes pass them.

    Attributes:
        place: (N,) distance along the chain from below the sprocket round its far side, a pitch apart [m].
        x, z: (N,) of these places in the vehicle's frame [m].
        tension: (N,) force of the pin there [N].
        load: (N,) force of the ground on the shoe there, along its normal, inwards [N].
    """

    place: Array
    x: Array
    z: Array
    tension: Array
    load: Array


class ChainRecord(Readable):
    """Collects what the pins and shoes of a tracked vehicle bear; `sample` reads from the device.

    Args:
        simulation: with `joint_reactions=True` and the vehicle among its elements.
        vehicle: on tracks of shoes.
        world: index of the world.

    Attributes:
        samples: how many there are so far.

    Raises:
        ModelError: the simulation records no reactions of joints.
    """

    def __init__(self, simulation: Simulation, vehicle: TrackedVehicle, *, world: int = 0) -> None:
        if not vehicle.parts.chains:
            raise ModelError(f"ChainRecord: '{vehicle.parts.spec.name}' is on belts, which have no pins; record chains")
        if not simulation.diagnostics.joint_reaction_force.size:
            raise ModelError(
                "ChainRecord: the simulation records no reactions of joints; make it with joint_reactions=True"
            )
        self._simulation, self._vehicle, self._worlds = simulation, vehicle, slice(world, world + 1)
        spec = vehicle.parts.spec
        tracks = [track for track in (spec.left, spec.right) if isinstance(track, ShoeTrack)]
        self._sides = tuple(zip(vehicle.parts.chains, tracks, strict=True))
        self._sums = [np.zeros((4, len(side.shoes))) for side, _ in self._sides]
        self.samples = 0

    def _readable_title(self) -> str:
        return f" of vehicle '{self._vehicle.parts.spec.name}': {plural(self.samples, 'sample')}"

    @property
    def tracks(self) -> tuple[ShoeTrack, ShoeTrack]:
        """Descriptions of the left and the right track."""
        return self._sides[0][1], self._sides[1][1]

    def sample(self) -> None:
        """Adds the present state; waits for the device."""
        motion = ChassisMotion.of(self._simulation, self._vehicle, self._worlds)
        for (side, track), total in zip(self._sides, self._sums, strict=True):
            total += self._rows(side, track, motion)
        self.samples += 1

    def profiles(self) -> tuple[ChainProfile, ChainProfile]:
        """Means of the left and the right track.

        Raises:
            ModelError: there is no sample yet.
        """
        if self.samples == 0:
            raise ModelError("ChainRecord: must have a sample to tell means of, got none; call sample()")
        found = []
        for (_, track), total in zip(self._sides, self._sums, strict=True):
            x, z, tension, load = total / self.samples
            place = np.asarray(track.shoe.pitch * np.arange(len(x)), np.float64)
            found.append(ChainProfile(place=place, x=x, z=z, tension=tension, load=load))
        left, right = found
        return left, right

    def _rows(self, side: ShoeTrackParts, track: ShoeTrack, motion: ChassisMotion) -> Array:
        """(4, N) x, z, tension and load at the places of the profile."""
        simulation, shoes = self._simulation, list(side.shoes)
        state, world = simulation.state, self._worlds.start
        rotation = motion.rotation[0]
        centres = (state.body_x.numpy()[world, shoes] - motion.position[0]) @ rotation
        normals = matrices(state.body_rot.numpy()[world, shoes].astype(float))[..., NORMAL]
        forces = simulation.contacts.shape_contact_force.numpy()[world]
        load = np.zeros(len(shoes))
        for k, (pads, normal) in enumerate(zip(self._pads(shoes), normals, strict=True)):
            load[k] = forces[pads].sum(axis=0) @ normal
        tension = np.linalg.norm(simulation.diagnostics.joint_reaction_force.numpy()[world, list(side.pins)], axis=1)
        count = len(shoes)
        start = lowest_shoe(centres[:, 0], centres[:, 2], track)
        period, wanted = float(count), np.arange(count, dtype=float)
        own = np.mod(np.arange(count) - start, count)
        values = [np.interp(wanted, own, row, period=period) for row in (centres[:, 0], centres[:, 2])]
        values.append(np.interp(wanted, np.mod(own - 0.5, count), tension, period=period))  # pin k is before shoe k
        values.append(np.interp(wanted, own, load, period=period))
        return np.array(values)

    def _pads(self, shoes: list[int]) -> list[list[int]]:
        """Shapes of each shoe that meet what is fixed."""
        shapes = self._simulation.model.builder.shapes
        found: dict[int, list[int]] = {body: [] for body in shoes}
        fixed = 0
        for shape in shapes:
            fixed |= shape.group if shape.body < 0 else 0
        for index, shape in enumerate(shapes):
            if shape.body in found and shape.mask & fixed:
                found[shape.body].append(index)
        return [found[body] for body in shoes]


def lowest_shoe(x: Array, z: Array, track: ShoeTrack) -> float:
    """Where the chain passes below the sprocket's axis, as an index of shoes with a fraction.

    Args:
        x, z: (N,) centres of the shoes in the vehicle's frame [m].
        track: its description.
    """
    across, height = x - track.sprocket_location[0], z - track.sprocket_location[2]
    crosses = np.flatnonzero((across * np.roll(across, -1) <= 0.0) & (height < 0.0))
    if not crosses.size:
        return float(np.argmin(np.hypot(across, height + track.sprocket.assembly_radius)))
    k = int(crosses[np.argmin(np.abs(height[crosses] + track.sprocket.assembly_radius))])
    first, second = across[k], across[(k + 1) % len(x)]
    return k + (float(first / (first - second)) if first != second else 0.0)
