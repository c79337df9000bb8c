# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What bodies and obstacles exchange by contacts in a tick, and since the start.

A solver of contacts adds to three results for each contact that it resolves:

* `received` of the body, about `centre` of the same record, per mass;
* `obstacle_impulse` (B, 2, O, 2, 3): of each body on each obstacle, the impulse, N s, and its
  moment about the origin of the obstacle at the end of the tick, N m s. The last row is that of
  all point obstacles together, about the origin of the world;
* `normal_impulse` (2, N): along the normals at each particle, N s.

Both are double-buffered as positions are: the half `1 - now` of the body is written, and zero
before. A body on which any contact has acted is marked by `touches` of that half. What a body
asleep exerts stays as it is: so it goes on to weigh on what it lies on.

Pins are no contacts: they prescribe motion. Their wrench is what its momentum says that it must
have been, see `accept_holding`.
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
    scaled,
    vector_of,
)
from softbody_ros.core.lanes import LANES, no_vectors, totals, vectors_at, weights_at


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


@helper
def accept_exchange(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    x: np.ndarray,
    h: float,
    own: np.ndarray,
    normal_impulse: np.ndarray,
    reaction: np.ndarray,
) -> None:
    """
    Write the wrench of a body in its tick, per mass, and clear the half of the tick before.

    Parameters
    ----------
    body, shape : BODY, SHAPE
        `now` of the body is the half of this tick
    weights, x : (M,), (3, N) float
        positions at the end of the tick, m
    h : float
        s
    own : (2, O, 2, 3) float
        row of `obstacle_impulse`
    normal_impulse : (2, N) float
    reaction : (2, 3) float
        m/s², m²/s²

    """
    impulse, moment = vector_of(body['received'][0]), vector_of(body['received'][1])
    if dot(impulse, impulse) > 0.0:
        # position correction has moved the centre away from that of the record
        offset = minus(vector_of(body['centre']), centre_of_mass(body, shape, weights, x))
        moment = plus(moment, cross(offset, impulse))
    put_vector(reaction[0], scaled(1.0 / h, impulse))
    put_vector(reaction[1], scaled(1.0 / h, moment))
    clear(body, 1 - body['now'], own, normal_impulse)


@helper
def clear(body: np.void, half: int, own: np.ndarray, normal_impulse: np.ndarray) -> None:
    """Clear what contacts of a body have exchanged, in one half."""
    if body['touches'][half] > 0:
        body['touches'][half] = 0
        for number in range(own.shape[1]):
            put_vector(own[half, number, 0], ZERO)
            put_vector(own[half, number, 1], ZERO)
        for i in range(body['first'], body['first'] + body['count']):
            normal_impulse[half, i] = 0.0


@kernel
def forget_exchange(
    bodies: np.ndarray,
    chosen: np.ndarray,
    obstacle_impulse: np.ndarray,
    normal_impulse: np.ndarray,
) -> None:
    """Clear what contacts of bodies (c,) have exchanged in the tick that is being computed."""
    for number in chosen:
        body = bodies[number]
        clear(body, 1 - body['now'], obstacle_impulse[number], normal_impulse)


@helper
def accept_holding(
    body: np.void,
    shape: np.void,
    weights: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    h: float,
    reaction: np.ndarray,
    obstacles: np.ndarray,
    holding: np.ndarray,
    holder_impulse: np.ndarray,
) -> None:
    """
    Write the wrench by which pins hold a body in its tick, and what it does to their obstacle.

    It is what gravity, the wrench on the body and contacts lack of the changes of its momentum and
    of its angular momentum about its centre of mass.

    Parameters
    ----------
    body, shape : BODY, SHAPE
        `now` of the body is the half of this tick
    weights, x, v : (M,), (2, 3, N), (2, 3, N) float
        m, m/s
    h : float
        s
    reaction : (2, 3) float
        of contacts, about the centre of mass, per mass: m/s², m²/s²
    obstacles : (O,) OBSTACLE
    holding : (2, 3) float
        likewise
    holder_impulse : (2, 3) float
        N s, and N m s about the origin of the obstacle; 0 without one

    """
    now = body['now']
    centre, velocity, spin = momentum_of(body, shape, weights, x[now], v[now])
    _, velocity_before, spin_before = momentum_of(body, shape, weights, x[1 - now], v[1 - now])
    force = scaled(1.0 / h, minus(velocity, velocity_before))
    torque = scaled(1.0 / h, minus(spin, spin_before))
    put_vector(
        holding[0],
        minus(force, plus(vector_of(body['applied'][0]), vector_of(reaction[0]))),
    )
    put_vector(
        holding[1],
        minus(torque, plus(vector_of(body['applied'][1]), vector_of(reaction[1]))),
    )
    load_holder(body, centre, h, obstacles, holding, holder_impulse)


@helper
def load_holder(
    body: np.void,
    centre: Vector,
    h: float,
    obstacles: np.ndarray,
    holding: np.ndarray,
    holder_impulse: np.ndarray,
) -> None:
    """Write the impulse of a body with that centre, m, on the obstacle that holds it."""
    put_vector(holder_impulse[0], ZERO)
    put_vector(holder_impulse[1], ZERO)
    if body['holder'] >= 0:
        origin = vector_of(obstacles[body['holder']]['position'])
        add_wrench_about(
            holder_impulse, origin, -h * body['mass'], centre, vector_of(holding[0]),
            vector_of(holding[1]),
        )  # fmt: skip


@helper
def momentum_of(
    body: np.void, shape: np.void, weights: np.ndarray, x: np.ndarray, v: np.ndarray
) -> tuple[Vector, Vector, Vector]:
    """
    Return the centre of mass of a body, m, its velocity, and the angular momentum about it.

    Per mass: m/s, m²/s.
    """
    first, last = body['first'], body['first'] + body['count']
    centre = centre_of_mass(body, shape, weights, x)
    momentum, spin = no_vectors(), no_vectors()
    for i in range(first, last, LANES):
        left = last - i
        weight = weights_at(weights, shape['first'] + i - first, left)
        share = scaled(weight, vectors_at(v, i, left))
        momentum = plus(momentum, share)
        spin = plus(spin, cross(minus(vectors_at(x, i, left), centre), share))
    return centre, totals(momentum), totals(spin)


@helper
def centre_of_mass(body: np.void, shape: np.void, weights: np.ndarray, x: np.ndarray) -> Vector:
    """Return the centre of mass of a body in x (3, N), m."""
    total, last = no_vectors(), body['first'] + body['count']
    for i in range(body['first'], last, LANES):
        weight = weights_at(weights, shape['first'] + i - body['first'], last - i)
        total = plus(total, scaled(weight, vectors_at(x, i, last - i)))
    return totals(total)


@helper
def add_up(
    body: np.void,
    reaction: np.ndarray,
    h: float,
    own: np.ndarray,
    holding: np.ndarray,
    holder_impulse: np.ndarray,
    obstacle_total: np.ndarray,
) -> None:
    """
    Add the wrenches of a tick of a body, awake or not, to their integrals over time.

    Parameters
    ----------
    body : BODY
        `total` and `holding_total` are changed
    reaction : (2, 3) float
        force, m/s², and torque, m²/s², per mass
    h : float
        s
    own : (2, O, 2, 3) float
        row of `obstacle_impulse`
    holding, holder_impulse : (2, 3), (2, 3) float
        see `accept_holding`
    obstacle_total : (O, 2, 3) float
        changed, N s, N m s

    """
    seconds = body['mass'] * h
    for row in range(2):
        for axis in range(3):
            body['total'][row, axis] += seconds * reaction[row, axis]
    now = body['now']
    if body['touches'][now] > 0:
        for number in range(len(obstacle_total)):
            for row in range(2):
                for axis in range(3):
                    obstacle_total[number, row, axis] += own[now, number, row, axis]
    if body['pins'] > 0:
        for row in range(2):
            for axis in range(3):
                body['holding_total'][row, axis] += seconds * holding[row, axis]
                if body['holder'] >= 0:
                    obstacle_total[body['holder'], row, axis] += holder_impulse[row, axis]


def balanced(
    obstacle_impulse: np.ndarray, origins: np.ndarray, weight: np.ndarray, centres: np.ndarray
) -> np.ndarray:
    """
    Return what an island of c bodies at rest exerts on obstacles, changed to equal its weight.

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
        return obstacle_impulse
    share = (size / size.sum())[:, :, None]
    moments = obstacle_impulse[:, :, 1] + np.cross(origins, obstacle_impulse[:, :, 0])
    force = weight.sum(axis=0) - obstacle_impulse[:, :, 0].sum(axis=(0, 1))
    torque = np.cross(centres, weight).sum(axis=0) - moments.sum(axis=(0, 1))
    change = share * force, share * (torque - np.cross(origins, force))
    return obstacle_impulse + np.stack(change, axis=2)


def rearranged(values: np.ndarray, source: Sequence[int]) -> np.ndarray:
    """Return rows of an array, the first axis, by their indices; zeros for −1."""
    result = np.zeros((len(source), *values.shape[1:]), values.dtype)
    for row, index in enumerate(source):
        if index >= 0:
            result[row] = values[index]
    return result
