# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Bodies stopped as wholes, before they sink through each other.

The particles that touch are light: between heavy or fast bodies they would give way until the
bodies had passed through each other. Impulses between whole bodies, found for a heap at once,
keep them from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.columns import summed
from softbody_ros.core.contact import soft_obstacle
from softbody_ros.core.contact.contact_state import Crowd
from softbody_ros.core.contact.manifold import Meeting
from softbody_ros.core.shape_matching import rigid_motion

DEEPEST = 0.1
"""How deep goals may be in each other, in RMS radii, before bodies stop each other as wholes."""
RETREAT = 0.2
"""Share of what is deeper by which they move apart in a tick."""
ROUNDS = 20
LEAST_STIFFNESS = 0.01
"""Share of its mobility that a body must have along the mean normal of what it touches."""


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
    Return what keeps bodies from sinking deeper than `DEEPEST` into each other.

    They rebound as springily as they are. Obstacles, which particles cannot enter, take part only
    to hold what stands on them: so impulses go through a heap in one tick.

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
    heap = make_heap(meeting, obstacles)
    before = heap.felt @ twist.ravel() - heap.carried_along
    least = -np.maximum(heap.room, 0.0) / h
    impulse = heap.solved(least - before)
    retreat = heap.solved(RETREAT * np.maximum(-heap.room, 0.0))
    back = np.zeros(len(heap.room))
    pairs = len(meeting.one)
    fast = np.clip(-before[:pairs] / meeting.settling(gravity) - soft_obstacle.SETTLED, 0.0, 1.0)
    back[:pairs] = -meeting.springiness * fast * before[:pairs]
    rebounds = (impulse > 0.0) & (back > 0.0)
    if rebounds.any():
        rebounding = heap.solved(np.where(rebounds, back, least) - before)
        gained = rebounding @ (before + 0.5 * (heap.coupling @ rebounding))
        # rebounds that go through a whole heap at once could give more than there was
        if gained <= 0.0:
            impulse = rebounding
            # they turn round within the tick: where they are deepest in each other
            retreat -= np.where(rebounds, heap.compliance * np.maximum(heap.room, 0.0), 0.0)
    return heap.stops(meeting, impulse, retreat)


@dataclass(frozen=True)
class Heap:
    """
    Bodies that touch each other and obstacles, as constraints: first the pairs, then those.

    Attributes
    ----------
    room : (q,) float
        how much deeper they may sink, m
    felt : (q, 6 C) sparse
        from twists to the speeds with which they part
    caused : (6 C, q) sparse
        from impulses to twists
    coupling : (q, q) sparse
        from impulses to speeds
    compliance : (q,) float
        impulse that a speed takes, if all are stopped at once, kg
    standing : (s,) int
        bodies on obstacles
    row_standing : (s, 6) float
        what their twists do along the normals
    carried_along : (q,) float
        speeds along the normals of the obstacles, m/s

    """

    room: np.ndarray
    felt: csr_array
    caused: csr_array
    coupling: csr_array
    compliance: np.ndarray
    standing: np.ndarray
    row_standing: np.ndarray
    carried_along: np.ndarray

    def solved(self, missing: np.ndarray) -> np.ndarray:
        """Return impulses that are not negative, after which no speed is missing, (q,)."""
        impulse = np.zeros(len(missing))
        for _ in range(ROUNDS):
            step = self.compliance * (missing - self.coupling @ impulse)
            impulse = np.maximum(impulse + step, 0.0)
        return impulse

    def stops(self, meeting: Meeting, impulse: np.ndarray, retreat: np.ndarray) -> Stops:
        """Return what impulses, and moves as if they were impulses, do to the bodies."""
        pairs, count = len(meeting.one), len(meeting.crowd)
        from_obstacles = impulse[pairs:, None] * self.row_standing
        return Stops(
            twist=(self.caused @ impulse).reshape(-1, 6),
            retreat=(self.caused @ retreat).reshape(-1, 6),
            impulse=impulse[:pairs][meeting.pair] * meeting.share,
            from_obstacles=summed(from_obstacles, self.standing, count).reshape(-1, 2, 3),
        )


def make_heap(meeting: Meeting, obstacles: Sequence[Obstacle]) -> Heap:
    """Return the constraints between the bodies of a meeting, and the obstacles they stand on."""
    crowd, mobility, pairs = meeting.crowd, meeting.crowd.mobility, len(meeting.one)
    share = np.where(meeting.apart[meeting.pair], meeting.share, 0.0)[:, None]
    standing, row_standing, room_standing, speed = _standing(crowd, obstacles)
    row_one = np.concatenate([meeting.sums(share * meeting.rows[0]), row_standing])
    row_two = meeting.sums(share * meeting.rows[1])
    one, two = np.concatenate([meeting.one, standing]), meeting.two
    by_one = rigid_motion.applied(mobility[one], row_one)
    by_two = rigid_motion.applied(mobility[two], row_two)
    felt = _by_body(row_one, one, -row_two, two, len(crowd))
    caused = _by_body(by_one, one, -by_two, two, len(crowd)).T.tocsr()
    # each body counts as many times as it touches something: so all can be stopped at once
    contacts = np.bincount(np.concatenate([one, two]), minlength=len(crowd))
    stiffness = np.einsum('ij,ij->i', row_one, by_one) * contacts[one]
    stiffness[:pairs] += np.einsum('ij,ij->i', row_two, by_two) * contacts[two]
    # where normals point all ways there is no way out for bodies as wholes
    least = LEAST_STIFFNESS * crowd.body_lightness * contacts
    able = stiffness > np.maximum(
        least[one], np.concatenate([least[two], np.zeros(len(standing))])
    )
    compliance = np.where(able, 1.0 / np.where(able, stiffness, 1.0), 0.0)
    room = np.concatenate([DEEPEST * meeting.scale - meeting.depth, room_standing])
    carried_along = np.concatenate([np.zeros(pairs), speed])
    coupling = felt @ caused
    return Heap(room, felt, caused, coupling, compliance, standing, row_standing, carried_along)


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
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """
    Return which bodies stand on obstacles (s,), their rows (s, 6), and the room left (s,), m.

    And the speeds (s,) of the obstacles along the normals, m/s.
    """
    body, rows = [np.zeros(0, np.int64)], [np.zeros((0, 6))]
    room, speed = [np.zeros(0)], [np.zeros(0)]
    for source in crowd.sources:
        flight, tick = source.flight, source.flight.tick
        x, bodies = flight.particles.x, len(flight.batch.x)
        near = soft_obstacle.nearby(flight.particles, obstacles, tick.gains.thickness)
        for obstacle, within in zip(obstacles, near, strict=True):
            within = np.intersect1d(within, source.rows)
            if not len(within):
                continue
            contacts = soft_obstacle.find(x, obstacle, tick.gains.thickness, bodies=within)
            if not len(contacts):
                continue
            patch = soft_obstacle.make_patch(contacts, flight.motion, tick.rest)
            goals = flight.match.goals_of(contacts.body, contacts.particle)
            sunk = soft_obstacle.depth_of_goals(contacts, obstacle, goals, tick)
            touching = np.unique(contacts.body)
            row = patch.share[:, None] * np.hstack([contacts.normal, patch.levers])
            body.append(source.first + np.searchsorted(source.rows, touching))
            rows.append(summed(row, contacts.body, bodies)[touching])
            room.append((DEEPEST * tick.rest.scale - patch.mean(sunk))[touching])
            along = np.einsum('ij,ij->i', contacts.surface_velocity, contacts.normal)
            speed.append(patch.mean(along)[touching])
    return tuple(np.concatenate(parts) for parts in (body, rows, room, speed))  # type: ignore
