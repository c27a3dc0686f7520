"""Radar once more: range rates from the definition, clusters by looking at every pair."""

from __future__ import annotations

import numpy as np


def range_rate(point, point_velocity, sensor, sensor_velocity, dt=1e-6):
    """Change of the distance between two points, by central difference [m/s]."""
    point, sensor = np.asarray(point, float), np.asarray(sensor, float)
    ahead = np.linalg.norm(point + dt * np.asarray(point_velocity) - sensor - dt * np.asarray(sensor_velocity))
    behind = np.linalg.norm(point - dt * np.asarray(point_velocity) - sensor + dt * np.asarray(sensor_velocity))
    return (ahead - behind) / (2.0 * dt)


def positions(returns):
    """(N, 3) of returns (N, 6), sensor axes."""
    r, azimuth, elevation = returns[:, 0], returns[:, 1], returns[:, 2]
    return np.stack(
        [r * np.cos(elevation) * np.cos(azimuth), r * np.cos(elevation) * np.sin(azimuth), r * np.sin(elevation)],
        axis=1,
    )


def labels(points, distance):
    """Number of each point's cluster, counted by first points: DBSCAN whose clusters need no more than one point."""
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= distance
    label = np.full(len(points), -1)
    for first in range(len(points)):
        if label[first] < 0:
            label[first] = label.max() + 1
            queue = [first]
            while queue:
                for other in np.flatnonzero(near[queue.pop()]):
                    if label[other] < 0:
                        label[other] = label[first]
                        queue.append(int(other))
    return label


def clusters(returns, distance, least=1):
    """(clusters, 6) of returns (N, 6): centroid, mean velocity, sum of amplitudes, number of returns."""
    returns = returns[returns[:, 4] > 0.0].astype(float)
    if not len(returns):
        return np.zeros((0, 6))
    points = positions(returns)
    label = labels(points, distance)
    rows = []
    for k in range(label.max() + 1):
        inside = label == k
        if inside.sum() >= least:
            rows.append(
                [*points[inside].mean(axis=0), returns[inside, 3].mean(), returns[inside, 4].sum(), inside.sum()]
            )
    return np.array(rows).reshape(-1, 6)
