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

from softbody_ros.core import contact, rigid_motion
from softbody_ros.core.crowd import Crowd
from softbody_ros.core.meeting import Meeting, summed
from softbody_ros.core.obstacles import Obstacle

DEEPEST = 0.1
"""How deep goals may be in each other, in RMS radii, before bodies stop each other as wholes."""
RETREAT = 0.2
"""Share of what is deeper by which they move apart in a tick."""
ROUNDS = 20


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
        for _ in range(ROUNDS):
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
        from_obstacles=summed(from_obstacles, standing, len(crowd)).reshape(-1, 2, 3),
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
            rows.append(summed(row, contacts.body, bodies)[touching])
            room.append((DEEPEST * tick.rest.scale - patch.mean(sunk))[touching])
    return np.concatenate(body), np.concatenate(rows), np.concatenate(room)
