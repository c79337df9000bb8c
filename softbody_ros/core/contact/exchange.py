# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What bodies and obstacles exchange by contacts in a tick, and since the start.

A solver of contacts adds to three results for each contact that it resolves:

* `received` of the body, about `centre` of the same record, per mass;
* `obstacle_impulse` (B, O, 2, 3): of each body on each obstacle, the impulse, N s, and its moment
  about the origin of the obstacle at the end of the tick, N m s. The last row stands for all point
  obstacles together, about the origin of the world;
* `normal_impulse` (N,): along the normals at each particle, N s.

A body that any contact has acted on is marked by `touches`. The rows of a body asleep stay as they
are: so it goes on to weigh on what it lies on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    cross,
    dot,
    minus,
    plus,
    put_vector,
    vector_of,
)


@kernel
def forget_contacts(
    bodies: np.ndarray,
    awake: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """Set to zero what the awake bodies have exchanged in the tick before."""
    for index in range(len(awake)):
        body = bodies[awake[index]]
        if not body['touches']:
            continue
        body['touches'] = False
        own = obstacle_impulse[awake[index]]
        for number in range(len(own)):
            put_vector(own[number, 0], ZERO)
            put_vector(own[number, 1], ZERO)
        for i in range(body['first'], body['first'] + body['count']):
            normal_impulse[i] = 0.0


@helper
def add_wrench_about(
    total: np.ndarray,
    origin: Vector,
    factor: float,
    point: Vector,
    impulse: Vector,
    moment: Vector,
) -> None:
    """Add a multiple of an impulse and its moment about a point to those about an origin."""
    moment = plus(moment, cross(minus(point, origin), impulse))
    put_vector(total[0], along(vector_of(total[0]), factor, impulse))
    put_vector(total[1], along(vector_of(total[1]), factor, moment))


@kernel
def add_up(
    bodies: np.ndarray,
    reaction: np.ndarray,
    h: float,
    obstacle_impulse: np.ndarray,
    total: np.ndarray,
    obstacle_total: np.ndarray,
) -> None:
    """
    Add the wrenches of a tick to their integrals over time.

    Parameters
    ----------
    bodies : (B,) BODY
        all of them, awake or not
    reaction : (B, 2, 3) float
        force, m/s², and torque, m²/s², per mass
    h : float
        s
    obstacle_impulse : (B, O, 2, 3) float
        N s, N m s
    total, obstacle_total : (B, 2, 3), (O, 2, 3) float
        changed, N s, N m s

    """
    for index in range(len(bodies)):
        body = bodies[index]
        for row in range(2):
            for axis in range(3):
                total[index, row, axis] += body['mass'] * h * reaction[index, row, axis]
        if body['touches']:
            for number in range(len(obstacle_total)):
                for row in range(2):
                    for axis in range(3):
                        given = obstacle_impulse[index, number, row, axis]
                        obstacle_total[number, row, axis] += given


@helper
def moment_about_centre(
    body: np.void, shape: np.void, weights: np.ndarray, x: np.ndarray
) -> Vector:
    """
    Return the moment of what a body has received about its centre of mass in x (3, N), m²/s.

    Position correction moves the centre away from that of its record.
    """
    impulse, moment = vector_of(body['received'][0]), vector_of(body['received'][1])
    if dot(impulse, impulse) == 0.0:
        return moment
    begin, end, first = body['first'], body['first'] + body['count'], shape['first']
    own, x0, x1, x2 = weights[first:], x[0, begin:end], x[1, begin:end], x[2, begin:end]
    a = b = c = 0.0
    for i in range(len(x0)):
        a += own[i] * x0[i]
        b += own[i] * x1[i]
        c += own[i] * x2[i]
    return plus(moment, cross(minus(vector_of(body['centre']), (a, b, c)), impulse))


def balance(
    obstacle_impulse: np.ndarray, origins: np.ndarray, weight: np.ndarray, centres: np.ndarray
) -> None:
    """
    Make what an island of c bodies at rest exerts on its supports equal its weight, in place.

    Before it falls asleep a remnant of motion is left: its wrench is distributed in proportion to
    the impulses.

    Parameters
    ----------
    obstacle_impulse : (c, O, 2, 3) float
        N s, N m s
    origins : (O, 3) float
        of the moments, m
    weight : (c, 3) float
        impulse of gravity on each body in a tick, N s
    centres : (c, 3) float
        of mass, m

    """
    size = np.sqrt((obstacle_impulse[:, :, 0] ** 2).sum(axis=2))
    if not size.any():
        return
    share = (size / size.sum())[:, :, None]
    moments = obstacle_impulse[:, :, 1] + np.cross(origins, obstacle_impulse[:, :, 0])
    force = weight.sum(axis=0) - obstacle_impulse[:, :, 0].sum(axis=(0, 1))
    torque = np.cross(centres, weight).sum(axis=0) - moments.sum(axis=(0, 1))
    obstacle_impulse[:, :, 0] += share * force
    obstacle_impulse[:, :, 1] += share * (torque - np.cross(origins, force))


def rearranged(values: np.ndarray, source: Sequence[int]) -> np.ndarray:
    """Return rows of an array, the first axis, by their indices; zeros for −1."""
    result = np.zeros((len(source), *values.shape[1:]), values.dtype)
    for row, index in enumerate(source):
        if index >= 0:
            result[row] = values[index]
    return result
