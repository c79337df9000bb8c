# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of bodies with each other, of the regions of one body, and with points in the way.

As with obstacles, see `contact`: particles are stopped, with friction; weight is carried by bodies
as wholes; restitution is that of the bodies. What one body gets, the other one gives, along the
same line, so momentum and angular momentum are conserved; and impulses along normals only ever
take energy.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

import numpy as np

from softbody_ros.core.collision import narrow_phase
from softbody_ros.core.collision.collision_surface import Skin
from softbody_ros.core.collision.narrow_phase import Touches
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import NO_POINTS, PointObstacles
from softbody_ros.core.columns import joined, summed
from softbody_ros.core.contact import soft_obstacle
from softbody_ros.core.contact.body_constraints import stopped_bodies
from softbody_ros.core.contact.contact_state import Crowd, Fixed, Source, make_crowd
from softbody_ros.core.contact.manifold import Meeting, between, make_meeting
from softbody_ros.core.contact.particle_solver import Pushes, collide
from softbody_ros.core.geometry.bounding_boxes import Boxes, distances
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.shape_matching.dynamics import Flight
from softbody_ros.core.shape_matching.rigid_motion import RigidMotion
from softbody_ros.core.sums import weighted

LEAST_GRIP = 0.1
"""Support, as the sum of squared cosines, below which a load is not divided any further."""


def meet(
    flights: Sequence[Flight],
    skins: Sequence[Skin],
    obstacles: Sequence[Obstacle],
    points: PointObstacles = NO_POINTS,
) -> None:
    """
    Let bodies meet each other, and points that do not give way, in place.

    Parameters
    ----------
    flights : sequence of Flight
    skins : sequence of Skin
        of each flight
    obstacles : sequence of Obstacle
        on which bodies stand that others lie on
    points : PointObstacles

    """
    touching = _touching(flights, skins, obstacles, points)
    if touching is None:
        return
    crowd, tick = touching[0], flights[0].tick
    meeting = make_meeting(*touching)
    carried = carried_weight(meeting, tick.gravity, tick.h)
    lift = meeting.twist_by(carried)
    stops = stopped_bodies(meeting, crowd.twist + lift, obstacles, tick.gravity, tick.h)

    crowd.v[:] += crowd.field(lift + stops.twist)
    # a load acts all through the tick
    shift = crowd.field(0.5 * tick.h * lift + stops.retreat)
    crowd.x[:] += shift
    pushes = collide(meeting, carried, shift, float(tick.slow(tick.gravity)))
    absorbed = absorbed_rebound(meeting, pushes, crowd.twist + lift, tick.gravity)

    along = carried + stops.impulse + absorbed
    impulses = along[:, None] * meeting.normal + pushes.friction
    impulses += pushes.normal[:, None] * meeting.normal
    part(meeting, impulses, stops.from_obstacles, pressed=lift[:, :3] / tick.h)


# -------------------------------------------------------------------------------------- detection
def _touching(
    flights: Sequence[Flight],
    skins: Sequence[Skin],
    obstacles: Sequence[Obstacle],
    points: PointObstacles,
) -> tuple[Crowd, Touches] | None:
    """Return the bodies that may touch something, and what does."""
    sizes = [len(flight.batch.x) for flight in flights]
    spiky = [obstacle for obstacle in obstacles if obstacle.config.type != 'plane']
    alone = sum(sizes) < 2 and all(skin.pieces == 1 for skin in skins)
    if not flights or (alone and not spiky and not len(points)):
        return None
    numbers = [sum(sizes[:index]) for index in range(len(sizes))]
    found = joined(
        [
            narrow_phase.boxes(flight.particles.x, skin, flight.tick.gains.thickness, number)
            for flight, skin, number in zip(flights, skins, numbers, strict=True)
        ]
    )
    one, two = narrow_phase.pairs(found, skins, sizes)
    if not len(one) and not spiky and not len(points):
        return None
    fixed, box, place = _fixed_points(found, spiky, points)
    involved = np.zeros(sum(sizes), dtype=bool)
    involved[found.body[np.concatenate([one, two, box])]] = True
    if not involved.any():
        return None
    sources, first = [], 0
    for flight, skin, number, size in zip(flights, skins, numbers, sizes, strict=True):
        rows = np.flatnonzero(involved[number : number + size])
        if len(rows):
            sources.append(Source(flight, skin, rows, first))
            first += len(rows)
    crowd = make_crowd(sources, fixed, flights[0].tick.h)
    found = dataclasses.replace(found, body=(np.cumsum(involved) - 1)[found.body])
    touches = narrow_phase.find(crowd, found, one, two, crowd.first[first] + place, box)
    return (crowd, touches) if len(touches) else None


def _fixed_points(
    found: Boxes, obstacles: Sequence[Obstacle], points: PointObstacles
) -> tuple[list[Fixed], np.ndarray, np.ndarray]:
    """
    Return points that do not give way and are in boxes: boxes (k,), and places (k,) of the points.

    Particles meet obstacles; but corners, and whatever is smaller than the faces of a body, would
    get in between its particles. So the points of obstacles meet the faces of bodies, too.
    """
    sets = [(points, np.zeros(3), np.zeros(6), False)] if len(points) else []
    for index in np.flatnonzero(_close(found, obstacles)).tolist():
        config = obstacles[index].config
        twist = np.array([*config.velocity_linear, *config.velocity_angular])
        sets.append((obstacles[index].spikes, obstacles[index].position, twist, True))
    fixed: list[Fixed] = []
    boxes, places, count = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    for each, centre, twist, is_spiky in sets:
        box, point = each.inside(found.low, found.high)
        near, place = np.unique(point, return_inverse=True)
        if len(near):
            fixed.append(Fixed(each.some(near), centre, twist, is_spiky))
            boxes.append(box)
            places.append(count + place)
            count += len(near)
    return fixed, np.concatenate(boxes), np.concatenate(places)


def _close(found: Boxes, obstacles: Sequence[Obstacle]) -> np.ndarray:
    """Return which obstacles reach into boxes, by balls about them, (o,) bool."""
    if not obstacles:
        return np.zeros(0, dtype=bool)
    centre = np.array([obstacle.position for obstacle in obstacles])[:, None]
    radius = np.array([obstacle.radius for obstacle in obstacles])
    return distances(found.low, found.high, centre).min(axis=1) < radius


# ----------------------------------------------------------------------------- bodies as wholes
def carried_weight(meeting: Meeting, gravity: np.ndarray, h: float) -> np.ndarray:
    """
    Return the impulses (k,) by which bodies carry the weight of those that lie on them, N s.

    The same spring as `soft_obstacle.carried_weight`, for the load that each pair has to bear.

    Parameters
    ----------
    meeting : Meeting
    gravity : (3,) float
        m/s²
    h : float
        s

    """
    pair, depth = meeting.pair, meeting.depth
    load = loads(meeting, gravity) / meeting.reduced_mass
    spring, damping = soft_obstacle.support(load, depth, meeting.scale, h)
    pressure = meeting.sunk / np.where(depth > 0.0, depth, 1.0)[pair]
    # a damper at each place: it calms rocking, too
    speeds = meeting.speeds(meeting.crowd.twist)
    force = spring[pair] * pressure - damping[pair] * speeds
    force = np.maximum(force, 0.0) / (1.0 + damping * h)[pair]
    total = meeting.mean(force)
    within = np.minimum(load / np.where(total > 0.0, total, 1.0), 1.0)
    return h * (meeting.reduced_mass * within)[pair] * meeting.share * force


def loads(meeting: Meeting, gravity: np.ndarray) -> np.ndarray:
    """
    Return the forces (p,) that the weight of a pile makes between its bodies, N.

    From the top down: each body hands its weight, and what lies on it, on to those below it, more
    to those that are more straight below.
    """
    crowd, one, two = meeting.crowd, meeting.one, meeting.two
    load = np.zeros(len(one))
    magnitude = float(np.linalg.norm(gravity))
    if magnitude == 0.0:
        return load
    down = gravity / magnitude
    normal = meeting.sums(meeting.share[:, None] * meeting.normal)
    length = np.linalg.norm(normal, axis=1)
    cosine = -(normal @ down) / np.where(length > 0.0, length, 1.0)
    upper, lower = np.where(cosine > 0.0, (one, two), (two, one))
    cosine = np.abs(cosine)
    # pins bear the weight of what hangs on them
    free = np.isfinite(crowd.mass) & ~crowd.pinned
    heavy = meeting.apart & free[upper] & ~crowd.spiky[lower]
    square = np.bincount(upper, np.where(heavy, cosine**2, 0.0), len(crowd))
    grip = np.maximum(square, LEAST_GRIP)
    share = np.where(heavy, cosine / grip[upper], 0.0).tolist()
    weight = (magnitude * np.where(free, crowd.mass, 0.0)).tolist()
    handed_on = cosine.tolist()
    # plain numbers: one after the other, this is faster than arrays
    above, below = upper.tolist(), lower.tolist()
    for index in np.argsort((crowd.centre @ down)[upper], kind='stable').tolist():
        if share[index]:
            load[index] = weight[above[index]] * share[index]
            weight[below[index]] += load[index] * handed_on[index]
    return load


def absorbed_rebound(
    meeting: Meeting, pushes: Pushes, twist: np.ndarray, gravity: np.ndarray
) -> np.ndarray:
    """
    Return the impulses (k,) that bodies of little elasticity do not get back when they rebound.

    As `soft_obstacle.absorbed_rebound`, for each pair: along the normals, not positive, N s.
    """
    crowd = meeting.crowd
    # the speed halfway through the push
    given = np.bincount(meeting.pair, pushes.normal, len(meeting.one)) / meeting.reduced_mass
    speed = (meeting.mean(meeting.speeds(twist)) + 0.5 * given) / meeting.settling(gravity)
    leaving = np.clip(speed - soft_obstacle.SETTLED, 0.0, 1.0)
    # rigid ones bounce at once
    soft = meeting.apart & ~(crowd.rigid[meeting.one] & crowd.rigid[meeting.two])
    lost = 0.5 * (1.0 - between(crowd.elasticity, meeting.one, meeting.two)) * leaving * soft
    return -lost[meeting.pair] * pushes.normal


def part(
    meeting: Meeting, impulses: np.ndarray, from_obstacles: np.ndarray, pressed: np.ndarray
) -> None:
    """
    Give the bodies back to their flights with the momentum that follows from the impulses.

    That moving particles out of each other changes angular momentum is made good here.

    Parameters
    ----------
    meeting : Meeting
    impulses : (k, 3) float
        that the first body of each pair has got from the second, N s
    from_obstacles : (C, 2, 3) float
        impulses and turning impulses about the centres of mass that come besides, N s, N m s
    pressed : (C, 3) float
        acceleration by the weight of others, m/s²

    """
    crowd, count = meeting.crowd, len(meeting.crowd)
    both = np.hstack([impulses, rigid_motion.cross(meeting.point, impulses)])
    total = summed(both, meeting.one[meeting.pair], count)
    total -= summed(both, meeting.two[meeting.pair], count)
    turning = total[:, 3:] - rigid_motion.cross(crowd.centre, total[:, :3])
    received = np.stack([total[:, :3], turning], axis=1) + from_obstacles
    received /= crowd.mass[:, None, None]
    velocity = crowd.twist[:, :3] + received[:, 0]
    # angular momentum about the old centre of mass; of the way to the new one see below
    spin = crowd.spin + received[:, 1]
    for source in crowd.sources:
        own, rows, flight = source.bodies, source.rows, source.flight
        first, last = crowd.first[own.start], crowd.first[own.stop]
        source.put(flight.particles.x, crowd.x[first:last])
        source.put(flight.particles.v, crowd.v[first:last])
        x, v, rest = flight.particles.x[rows], flight.particles.v[rows], flight.tick.rest
        centre = weighted(x, rest.weights)
        now = rigid_motion.rigid_motion(x, v, centre, rest)
        about = spin[own] - rigid_motion.cross(centre - crowd.centre[own], velocity[own])
        # pins change the momentum as they like
        held = crowd.pinned[own, None]
        wanted = np.where(held, now.velocity, velocity[own])
        about = np.where(held, now.spin, about)
        v += rigid_motion.correction(x, now, wanted, about)
        flight.particles.v[rows] = v
        flight.motion.take(rows, RigidMotion(centre, wanted, about, now.inverse_inertia))
        flight.particles.received[rows] += received[own]
        flight.particles.pressed[rows] += pressed[own]
