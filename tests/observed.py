# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a depth camera would see of a film."""

import numpy as np


def seen(positions, faces, towards, count, noise=0.0, seed=0):
    """
    Return random points of the surface that face a far camera, (frames, count, 3).

    Parameters
    ----------
    positions : (frames, n, 3) float
        m
    faces : (m, 3) int
    towards : (3,) float
        direction to the camera
    count : int
    noise : float
        standard deviation of each coordinate, m
    seed : int

    """
    random, result = np.random.default_rng(seed), []
    for x in positions:
        a, b, c = x[faces.T]
        facing = np.maximum(np.cross(b - a, c - a) @ towards, 0.0)
        k = random.choice(len(faces), count, p=facing / facing.sum())
        u, v = random.random((2, count, 1))
        u = np.sqrt(u)
        points = (1.0 - u) * a[k] + u * (1.0 - v) * b[k] + u * v * c[k]
        result.append(points + noise * random.normal(size=points.shape))
    return np.array(result)
