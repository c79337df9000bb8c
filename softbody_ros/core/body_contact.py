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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core import contact, rigid_motion, touch
from softbody_ros.core.boxes import Boxes, joined
from softbody_ros.core.crowd import Crowd, Fixed, Source, make_crowd
from softbody_ros.core.dynamics import Flight
from softbody_ros.core.obstacles import Obstacle
from softbody_ros.core.point_obstacles import NO_POINTS, PointObstacles
from softbody_ros.core.skin import Skin
from softbody_ros.core.sums import weighted
from softbody_ros.core.touch import Touches

DEEPEST = 0.1
"""How deep goals may be in each other, in RMS radii, before bodies stop each other as wholes."""
RETREAT = 0.2
"""Share of what is deeper by which they move apart in a tick."""
BODY_ROUNDS = 20
SOFT_ROUNDS, RIGID_ROUNDS, FRICTION_ROUNDS, PUSH_OUT_ROUNDS = 4, 16, 4, 4
STICKING = 0.5
"""Share of the way that full friction takes back in a tick; with all of it heaps begin to sway."""
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
    pushes = collide(meeting, carried, shift, tick.slow, tick.h)
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
    numbers = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    found = joined(
        [
            touch.boxes(flight.particles.x, skin, flight.tick.gains.thickness, number)
            for flight, skin, number in zip(flights, skins, numbers, strict=True)
        ]
    )
    of_bodies = [skins[index] for index, size in enumerate(sizes) for _ in range(size)]
    one, two = touch.pairs(found, of_bodies)
    fixed, box, place = _fixed_points(found, spiky, points)
    involved = np.zeros(sum(sizes), dtype=bool)
    involved[found.body[np.concatenate([one, two, box])]] = True
    if not involved.any():
        return None
    sources, first = [], 0
    for flight, skin, number in zip(flights, skins, numbers, strict=True):
        rows = np.flatnonzero(involved[number])
        if len(rows):
            sources.append(Source(flight, skin, rows, first))
            first += len(rows)
    crowd = make_crowd(sources, fixed, flights[0].tick.h)
    found = dataclasses.replace(found, body=(np.cumsum(involved) - 1)[found.body])
    touches = touch.find(crowd, found, one, two, crowd.first[first] + place, box)
    return (crowd, touches) if len(touches) else None


def _fixed_points(
    found: Boxes, obstacles: Sequence[Obstacle], points: PointObstacles
) -> tuple[list[Fixed], np.ndarray, np.ndarray]:
    """
    Return points that do not give way and are in boxes: boxes (k,), and places (k,) of the points.

    Particles meet obstacles; but corners, and whatever is smaller than the faces of a body, would
    get in between its particles. So the points of obstacles meet the faces of bodies, too.
    """
    sets = [(points, np.zeros(3), np.zeros(6))] if len(points) else []
    for index in np.flatnonzero(_close(found, obstacles)).tolist():
        config = obstacles[index].config
        twist = np.array([*config.velocity_linear, *config.velocity_angular])
        sets.append((obstacles[index].spikes, obstacles[index].position, twist))
    fixed: list[Fixed] = []
    boxes, places, count = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    for each, centre, twist in sets:
        box, point = each.inside(found.low, found.high)
        near, place = np.unique(point, return_inverse=True)
        if len(near):
            fixed.append(Fixed(each.some(near), centre, twist))
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
    gap = np.maximum(np.maximum(found.low - centre, centre - found.high), 0.0)
    return np.einsum('ijk,ijk->ij', gap, gap).min(axis=1) < radius**2


# --------------------------------------------------------------------------------------- meetings
@dataclass(frozen=True)
class Meeting:
    """
    Where the bodies of a crowd touch: k places, of p pairs of bodies.

    Attributes
    ----------
    crowd : Crowd
    touches : Touches
    pair : (k,) int
    one, two : (p,) int
        the bodies of each pair, the same one if a body touches itself
    sign : (k,) float
        1 where the particle is that of the first, −1 where it is that of the second
    normal : (k, 3) float
        from the second body to the first
    share : (k,) float
        of the mass that touches in its pair
    point : (k, 3) float
        where they touch, m

    """

    crowd: Crowd
    touches: Touches
    pair: np.ndarray
    one: np.ndarray
    two: np.ndarray
    sign: np.ndarray
    normal: np.ndarray
    share: np.ndarray
    point: np.ndarray

    @cached_property
    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """(k, 6) float of each body: what its twist does along the normal."""
        return self._row(self.one[self.pair]), self._row(self.two[self.pair])

    def _row(self, body: np.ndarray) -> np.ndarray:
        arms = self.point - self.crowd.centre[body]
        return np.hstack([self.normal, rigid_motion.cross(arms, self.normal)])

    @cached_property
    def mobility(self) -> np.ndarray:
        """(C, 6, 6) float: see `Crowd`."""
        return self.crowd.mobility()

    @cached_property
    def apart(self) -> np.ndarray:
        """(p,) bool: whether they are two bodies."""
        return self.one != self.two

    @cached_property
    def reduced_mass(self) -> np.ndarray:
        """(p,) float: of the two bodies, kg."""
        lightness = self.crowd.body_lightness
        return 1.0 / (lightness[self.one] + lightness[self.two])

    @cached_property
    def scale(self) -> np.ndarray:
        """(p,) float: RMS radius of the smaller body, m."""
        return np.minimum(self.crowd.scale[self.one], self.crowd.scale[self.two])

    @property
    def springiness(self) -> np.ndarray:
        """
        (p,) float: speed after a stop, as a share of that before.

        What a body stores on the first half of a swing it gives back on the second, of which
        bounciness leaves a share; and elasticity absorbs as in `contact.absorbed_rebound`.
        """
        elasticity, bounciness = (
            _between(values, self.one, self.two)
            for values in (self.crowd.elasticity, self.crowd.bounciness)
        )
        return 0.5 * (1.0 + elasticity) * np.sqrt(bounciness)

    def settling(self, gravity: np.ndarray) -> np.ndarray:
        """Return the speeds (p,) at which restitution fades out, m/s: of bodies that settle."""
        magnitude = max(float(np.linalg.norm(gravity)), 1e-300)
        return np.sqrt(magnitude * contact.SINKAGE * self.scale)

    @cached_property
    def sunk(self) -> np.ndarray:
        """(k,) float: how deep the goal of each particle lies in that of the face, m, or 0."""
        touches, goals = self.touches, self.crowd.goals
        faces = np.einsum('ki,kij->kj', touches.share, goals[touches.corners])
        gap = np.einsum('ij,ij->i', goals[touches.particle] - faces, touches.normal)
        return np.maximum(touches.thickness - gap, 0.0)

    @cached_property
    def depth(self) -> np.ndarray:
        """(p,) float: mean of it, m."""
        return self.mean(self.sunk)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (p,) of values (k,) at the places of each pair."""
        return np.bincount(self.pair, self.share * values, len(self.one))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Return the sums (p, …) of values (k, …) at the places of each pair."""
        return _sums(values, self.pair, len(self.one))

    def speeds(self, twist: np.ndarray) -> np.ndarray:
        """Return how fast bodies that move with twists (C, 6) part at each place, (k,), m/s."""
        row_one, row_two = self.rows
        speeds = np.einsum('ij,ij->i', row_one, twist[self.one[self.pair]])
        return speeds - np.einsum('ij,ij->i', row_two, twist[self.two[self.pair]])

    def twist_by(self, impulse: np.ndarray) -> np.ndarray:
        """Return the twists (C, 6) that impulses (k,) along the normals cause."""
        row_one, row_two = self.rows
        count = len(self.crowd)
        total = _sums(self.sums(impulse[:, None] * row_one), self.one, count)
        total -= _sums(self.sums(impulse[:, None] * row_two), self.two, count)
        return rigid_motion.applied(self.mobility, total)


def make_meeting(crowd: Crowd, touches: Touches) -> Meeting:
    """Return where the bodies of a crowd touch, pair by pair."""
    count = len(crowd)
    body, other = touches.body, touches.other
    keys, pair = np.unique(
        np.minimum(body, other) * count + np.maximum(body, other), return_inverse=True
    )
    one, two = np.divmod(keys, count)
    sign = np.where(body == one[pair], 1.0, -1.0)
    # of what does not give way, the mass of what it touches counts
    corners = np.einsum('ij,ij->i', touches.share, crowd.lightness[touches.corners])
    lightness = crowd.lightness[touches.particle]
    weight = 1.0 / np.where(lightness > 0.0, lightness, corners)
    return Meeting(
        crowd=crowd,
        touches=touches,
        pair=pair,
        one=one,
        two=two,
        sign=sign,
        normal=sign[:, None] * touches.normal,
        share=weight / np.bincount(pair, weight, len(keys))[pair],
        point=crowd.x[touches.particle],
    )


def _sums(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Return the sums (count, j) of values (k, j) by group, in a fixed order."""
    return np.stack([np.bincount(group, column, count) for column in values.T], axis=1)


# ----------------------------------------------------------------------------- bodies as wholes
def carried_weight(meeting: Meeting, gravity: np.ndarray, h: float) -> np.ndarray:
    """
    Return the impulses (k,) by which bodies carry the weight of those that lie on them, N s.

    The same spring as `contact.carried_weight`, for the load that each pair has to bear.

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
    softness = np.maximum(contact.SINKAGE * meeting.scale, 4.0 * load * h**2)
    spring = load * -np.expm1(-depth / softness)
    damping = 2.0 * np.sqrt(load / softness)
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
    heavy = meeting.apart & (crowd.body_lightness[upper] > 0.0)
    grip = np.maximum(np.bincount(upper, cosine**2, len(crowd)), LEAST_GRIP)
    share = np.where(heavy, cosine / grip[upper], 0.0).tolist()
    with np.errstate(divide='ignore'):
        weight = (magnitude / crowd.body_lightness).tolist()
    handed_on = cosine.tolist()
    # plain numbers: one after the other, this is faster than arrays
    above, below = upper.tolist(), lower.tolist()
    for index in np.argsort((crowd.centre @ down)[upper], kind='stable').tolist():
        if share[index]:
            load[index] = weight[above[index]] * share[index]
            weight[below[index]] += load[index] * handed_on[index]
    return load


@dataclass(frozen=True)
class Stops:
    """
    What stops bodies as wholes.

    Attributes
    ----------
    twist : (C, 6) float
        the change of twists
    retreat : (C, 6) float
        a small motion that they make, m and rad
    impulse : (k,) float
        along the normals, N s
    from_obstacles : (C, 2, 3) float
        impulse, N s, and turning impulse about the centre of mass, N m s

    """

    twist: np.ndarray
    retreat: np.ndarray
    impulse: np.ndarray
    from_obstacles: np.ndarray


def stopped_bodies(
    meeting: Meeting,
    twist: np.ndarray,
    obstacles: Sequence[Obstacle],
    gravity: np.ndarray,
    h: float,
) -> Stops:
    """
    Return what keeps bodies from sinking deeper than `DEEPEST` into each other, without rebound.

    The particles that touch are light: between heavy or fast bodies they would give way until the
    bodies had passed through each other. Obstacles, which particles cannot enter, take part only
    to hold what stands on them: impulses go through a pile in one tick.

    Parameters
    ----------
    meeting : Meeting
    twist : (C, 6) float
        of the bodies, m/s and rad/s
    obstacles : sequence of Obstacle
    gravity : (3,) float
        m/s²
    h : float
        s

    """
    room = DEEPEST * meeting.scale - meeting.depth
    enough = meeting.mean(meeting.speeds(twist)) >= -room / h
    if (enough | ~meeting.apart).all():
        return no_stops(meeting)
    crowd, mobility, pairs = meeting.crowd, meeting.mobility, len(meeting.one)
    share = np.where(meeting.apart[meeting.pair], meeting.share, 0.0)[:, None]
    standing, row_standing, room_standing = _standing(crowd, obstacles)
    room = np.concatenate([room, room_standing])
    row_one = np.concatenate([meeting.sums(share * meeting.rows[0]), row_standing])
    row_two = meeting.sums(share * meeting.rows[1])
    one, two = np.concatenate([meeting.one, standing]), meeting.two
    by_one = rigid_motion.applied(mobility[one], row_one)
    by_two = rigid_motion.applied(mobility[two], row_two)
    felt, caused = (
        _by_body(a, one, -b, two, len(crowd)) for a, b in ((row_one, row_two), (by_one, by_two))
    )
    caused = caused.T.tocsr()
    coupling = felt @ caused
    # each body counts as many times as it touches something: so all can be stopped at once
    contacts = np.bincount(one, minlength=len(crowd)) + np.bincount(two, minlength=len(crowd))
    stiffness = np.einsum('ij,ij->i', row_one, by_one) * contacts[one]
    stiffness[:pairs] += np.einsum('ij,ij->i', row_two, by_two) * contacts[two]
    compliance = np.where(stiffness > 0.0, 1.0 / np.where(stiffness > 0.0, stiffness, 1.0), 0.0)

    def solved(speed: np.ndarray, least: np.ndarray) -> np.ndarray:
        """Return impulses that are not negative, after which no speed is below the least."""
        impulse = np.zeros(len(speed))
        for _ in range(BODY_ROUNDS):
            missing = least - speed - coupling @ impulse
            impulse = np.maximum(impulse + compliance * missing, 0.0)
        return impulse

    before = felt @ twist.ravel()
    least = -np.maximum(room, 0.0) / h
    impulse = solved(before, least)
    if impulse[:pairs].any():
        fast = np.clip(-before[:pairs] / meeting.settling(gravity) - contact.SETTLED, 0.0, 1.0)
        back = np.where(
            impulse[:pairs] > 0.0, meeting.springiness * fast * -before[:pairs], least[:pairs]
        )
        rebounding = solved(
            before, np.concatenate([np.maximum(back, least[:pairs]), least[pairs:]])
        )
        gained = rebounding @ (before + 0.5 * (coupling @ rebounding))
        # rebounds that go through a whole pile at once could give more than there was
        impulse = rebounding if gained <= 0.0 else impulse
    retreat = solved(np.zeros(len(room)), RETREAT * np.maximum(-room, 0.0))
    from_obstacles = impulse[pairs:, None] * row_standing
    return Stops(
        twist=(caused @ impulse).reshape(-1, 6),
        retreat=(caused @ retreat).reshape(-1, 6),
        impulse=impulse[:pairs][meeting.pair] * meeting.share,
        from_obstacles=_sums(from_obstacles, standing, len(crowd)).reshape(-1, 2, 3),
    )


def no_stops(meeting: Meeting) -> Stops:
    """Return what it is when nothing has to be stopped."""
    count = len(meeting.crowd)
    still = np.zeros((count, 6))
    return Stops(still, still, np.zeros(len(meeting.touches)), np.zeros((count, 2, 3)))


def _by_body(
    row_one: np.ndarray, one: np.ndarray, row_two: np.ndarray, two: np.ndarray, bodies: int
) -> csr_array:
    """Return a sparse matrix with the blocks (q, 6) of bodies; some rows have one only."""
    rows = np.concatenate([np.arange(len(one)), np.arange(len(two))])
    columns = 6 * np.concatenate([one, two])[:, None] + np.arange(6)
    values = np.concatenate([row_one, row_two])
    return csr_array(
        (values.ravel(), (np.repeat(rows, 6), columns.ravel())), shape=(len(one), 6 * bodies)
    )


def _standing(
    crowd: Crowd, obstacles: Sequence[Obstacle]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which bodies stand on obstacles (q,), their rows (q, 6), the room left (q,), m."""
    body, rows, room = [np.zeros(0, np.int64)], [np.zeros((0, 6))], [np.zeros(0)]
    for source in crowd.sources:
        flight, tick = source.flight, source.flight.tick
        x, bodies = flight.particles.x, len(flight.batch.x)
        for obstacle in obstacles:
            contacts = contact.find(x, obstacle, tick.gains.thickness, bodies=source.rows)
            if not len(contacts):
                continue
            patch = contact.make_patch(x, contacts, flight.motion, tick.rest)
            sunk = contact.depth_of_goals(x, contacts, obstacle, flight.match.goals[1], tick)
            touching = np.unique(contacts.body)
            row = patch.share[:, None] * np.hstack([contacts.normal, patch.levers])
            body.append(source.first + np.searchsorted(source.rows, touching))
            rows.append(_sums(row, contacts.body, bodies)[touching])
            room.append((DEEPEST * tick.rest.scale - patch.mean(sunk))[touching])
    return np.concatenate(body), np.concatenate(rows), np.concatenate(room)


# ------------------------------------------------------------------------------------- particles
@dataclass(frozen=True)
class Pushes:
    """
    What touching particles and faces get: impulses (k,) along the normals, (k, 3) of friction.

    Those of friction are what the first body of a pair gets.
    """

    normal: np.ndarray
    friction: np.ndarray


def collide(
    meeting: Meeting, carried: np.ndarray, shift: np.ndarray, slow: float, h: float
) -> Pushes:
    """
    Stop the approach of particles and faces and move them out of each other, in place.

    Parameters
    ----------
    meeting : Meeting
    carried : (k,) float
        load that is carried besides, N s: friction may count on it
    shift : (N, 3) float
        by which the particles have been moved since they were found to touch, m
    slow : float
        speed up to which nothing bounces, m/s
    h : float
        s

    """
    crowd, touches = meeting.crowd, meeting.touches
    grip, normal = Grip(meeting), touches.normal
    stiffness = grip.stiffness(normal)
    before = crowd.v[grip.particle]

    speed = grip.along(normal, before)
    bounces = crowd.rigid[touches.body] & crowd.rigid[touches.other] & (speed < -slow)
    wanted = np.where(
        bounces, -_between(crowd.elasticity, touches.body, touches.other) * speed, 0.0
    )
    push, velocity = np.zeros(len(touches)), before
    for _ in range(RIGID_ROUNDS if grip.some_rigid else SOFT_ROUNDS):
        missing = wanted - grip.along(normal, velocity)
        push = np.maximum(push + missing / stiffness, 0.0)
        velocity = before + grip.spread(push[:, None] * normal)

    sliding = grip.tangential(normal, velocity)
    left = 1.0 - _rubbed(crowd, touches, sliding, (push + carried) * stiffness)[:, None]
    friction = np.zeros_like(sliding)
    for _ in range(FRICTION_ROUNDS):
        now = grip.tangential(normal, velocity + grip.spread(friction))
        friction += (left * sliding - now) / grip.along_faces[:, None]

    # friction takes back some of the way, too: what sticks hardly creeps
    kept = 1.0 - STICKING * (1.0 - left)
    way = crowd.x[grip.particle] - crowd.start[grip.particle]
    slid = grip.tangential(normal, way)
    depth = touches.depth - grip.along(normal, shift[grip.particle])
    out, back = np.zeros(len(touches)), np.zeros_like(slid)
    for _ in range(PUSH_OUT_ROUNDS):
        moved = grip.spread(back + out[:, None] * normal)
        out = np.maximum(out + (depth - grip.along(normal, moved)) / stiffness, 0.0)
        now = grip.tangential(normal, way + moved)
        back += (kept * slid - now) / grip.along_faces[:, None]

    grip.give(crowd.v, push[:, None] * normal + friction)
    grip.give(crowd.x, back + out[:, None] * normal)
    return Pushes(push, meeting.sign[:, None] * friction)


class Grip:
    """
    What impulses at touching places do to the particles there: each acts on a particle and a face.

    Particles and bodies count as many times as they are touched: so all impulses can be found at
    once without more than stopping anything (mass splitting: Tonge, Benevolenski, Voroshilov 2012,
    Mass splitting for jitter-free parallel rigid body simulation).

    Attributes
    ----------
    particle : (u,) int
        the particles that touch, and those at the corners of touched faces
    some_rigid : bool
        whether some of them belong to rigid bodies, which are moved as wholes

    """

    def __init__(self, meeting: Meeting) -> None:
        self._crowd, self._touches = meeting.crowd, meeting.touches
        crowd, touches, count = meeting.crowd, meeting.touches, len(meeting.touches)
        columns = np.column_stack([touches.particle, touches.corners])
        values = np.column_stack([np.ones(count), -touches.share])
        self.particle, place = np.unique(columns, return_inverse=True)
        shape = (count, len(self.particle))
        self._relative = csr_array(
            (values.ravel(), place.ravel(), np.arange(0, 4 * count + 1, 4)), shape=shape
        )
        self._spread = self._relative.T.tocsr()
        rigid = crowd.rigid[crowd.body[self.particle]]
        self.some_rigid = bool(rigid.any())
        self._rigid_particle = np.flatnonzero(rigid)
        self._lightness = np.where(rigid, 0.0, crowd.lightness[self.particle])
        touched = np.diff(self._spread.indptr)
        square = csr_array(
            (self._relative.data**2, self._relative.indices, self._relative.indptr), shape=shape
        )
        self._soft_stiffness = square @ (self._lightness * touched)
        if self.some_rigid:
            sides = (touches.body, touches.other)
            touched = sum(np.bincount(body, minlength=len(crowd)) for body in sides)
            # of bodies that are not rigid, and of those that do not give way, none
            counted = np.where(crowd.rigid, touched, 0)[:, None, None]
            self._rigid_mobility = meeting.mobility * (crowd.rigid[:, None, None])
            self._counted_mobility = meeting.mobility * counted
            self._arms = [meeting.point - crowd.centre[body] for body in sides]

    def stiffness(self, direction: np.ndarray) -> np.ndarray:
        """Return what unit impulses along directions (k, 3) do to relative speeds, (k,), 1/kg."""
        if not self.some_rigid:
            return self._soft_stiffness
        total = self._soft_stiffness.copy()
        for body, arms in zip((self._touches.body, self._touches.other), self._arms, strict=True):
            row = np.hstack([direction, rigid_motion.cross(arms, direction)])
            total += np.einsum('ij,ijk,ik->i', row, self._counted_mobility[body], row)
        return np.maximum(total, 1e-300)

    @cached_property
    def along_faces(self) -> np.ndarray:
        """(k,) float: not less than the stiffness along any direction, 1/kg."""
        if not self.some_rigid:
            return self._soft_stiffness
        total = self._soft_stiffness.copy()
        for body, arms in zip((self._touches.body, self._touches.other), self._arms, strict=True):
            mobility = self._counted_mobility[body]
            total += mobility[:, 0, 0]
            square = np.einsum('ij,ij->i', arms, arms)
            total += square * np.einsum('ijj->i', mobility[:, 3:, 3:])
        return np.maximum(total, 1e-300)

    def along(self, normal: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Return how far a field (u, 3) brings particles from their faces along normals, (k,)."""
        return np.einsum('ij,ij->i', self._relative @ field, normal)

    def tangential(self, normal: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Return how far it brings them along the faces, (k, 3)."""
        relative = self._relative @ field
        return relative - np.einsum('ij,ij->i', relative, normal)[:, None] * normal

    def spread(self, impulse: np.ndarray) -> np.ndarray:
        """Return what impulses (k, 3) on the particles, and back on faces, change: (u, 3)."""
        change = self._lightness[:, None] * (self._spread @ impulse)
        if self.some_rigid:
            particle = self.particle[self._rigid_particle]
            change[self._rigid_particle] = self._crowd.field(self._rigid_twist(impulse))[particle]
        return change

    def give(self, field: np.ndarray, impulse: np.ndarray) -> None:
        """Change a field (N, 3) of the crowd by impulses (k, 3), in place."""
        field[self.particle] += self._lightness[:, None] * (self._spread @ impulse)
        if self.some_rigid:
            field += self._crowd.field(self._rigid_twist(impulse))

    def _rigid_twist(self, impulse: np.ndarray) -> np.ndarray:
        total = np.zeros((len(self._crowd), 6))
        sides = zip(
            (1.0, -1.0), (self._touches.body, self._touches.other), self._arms, strict=True
        )
        for sign, body, arms in sides:
            both = np.hstack([impulse, rigid_motion.cross(arms, impulse)])
            total += sign * _sums(both, body, len(total))
        return rigid_motion.applied(self._rigid_mobility, total)


def _between(values: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Return the geometric means of what two bodies have; NaN is of no account."""
    one, two = values[one], values[two]
    one, two = np.where(np.isnan(one), two, one), np.where(np.isnan(two), one, two)
    return np.sqrt(one * two)


def _rubbed(
    crowd: Crowd, touches: Touches, sliding: np.ndarray, pressed: np.ndarray
) -> np.ndarray:
    """
    Return the share (k,) of the sliding that friction takes.

    Coulomb's law counts as soon as one of the bodies has it.
    """
    share = _between(crowd.friction, touches.body, touches.other)
    if not crowd.coulomb.any():
        return share
    coulomb = crowd.coulomb[touches.body] | crowd.coulomb[touches.other]
    own = np.where(crowd.coulomb, crowd.friction, np.nan)
    coefficient = np.where(coulomb, _between(own, touches.body, touches.other), 0.0)
    speed = np.linalg.norm(sliding, axis=1)
    bound = coefficient * pressed / np.where(speed > 0.0, speed, 1.0)
    return np.where(coulomb, np.minimum(bound, 1.0), share)


# --------------------------------------------------------------------------------------- the end
def absorbed_rebound(
    meeting: Meeting, pushes: Pushes, twist: np.ndarray, gravity: np.ndarray
) -> np.ndarray:
    """
    Return the impulses (k,) that bodies of little elasticity do not get back when they rebound.

    As `contact.absorbed_rebound`, for each pair: along the normals, not positive, N s.
    """
    crowd = meeting.crowd
    # the speed halfway through the push
    given = np.bincount(meeting.pair, pushes.normal, len(meeting.one)) / meeting.reduced_mass
    speed = (meeting.mean(meeting.speeds(twist)) + 0.5 * given) / meeting.settling(gravity)
    leaving = np.clip(speed - contact.SETTLED, 0.0, 1.0)
    # rigid ones bounce at once
    soft = meeting.apart & ~(crowd.rigid[meeting.one] & crowd.rigid[meeting.two])
    lost = 0.5 * (1.0 - _between(crowd.elasticity, meeting.one, meeting.two)) * leaving * soft
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
    total = _sums(both, meeting.one[meeting.pair], count)
    total -= _sums(both, meeting.two[meeting.pair], count)
    turning = total[:, 3:] - rigid_motion.cross(crowd.centre, total[:, :3])
    received = np.stack([total[:, :3], turning], axis=1) + from_obstacles
    received *= crowd.body_lightness[:, None, None]
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
        about = spin[own] - rigid_motion.cross(centre - crowd.centre[own], velocity[own])
        now = rigid_motion.rigid_motion(x, v, centre, rest)
        turn = rigid_motion.applied(now.inverse_inertia, about - now.spin)
        v += rigid_motion.field(x, centre, velocity[own] - now.velocity, turn)
        flight.particles.v[rows] = v
        motion = flight.motion
        motion.centre[rows], motion.velocity[rows], motion.spin[rows] = (
            centre,
            velocity[own],
            about,
        )
        motion.inverse_inertia[rows] = now.inverse_inertia
        flight.particles.received[rows] += received[own]
        flight.particles.pressed[rows] += pressed[own]
