# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Particles and faces of bodies stopped where they touch, with friction, and moved out of each other.

All places at once: each impulse acts on a particle, and back on the corners of a face.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core import rigid_motion
from softbody_ros.core.meeting import Meeting, between, summed

SOFT_ROUNDS, RIGID_ROUNDS, FRICTION_ROUNDS, PUSH_OUT_ROUNDS = 4, 16, 4, 4
LARGEST_MOVE = 0.3
"""How far, in RMS radii, what is deep in each other is moved apart in a tick."""
STICKING = 0.5
"""Share of the way that full friction takes back in a tick; with all of it heaps begin to sway."""


@dataclass(frozen=True)
class Pushes:
    """
    What touching particles and faces get: impulses (k,) along the normals, (k, 3) of friction.

    Those of friction are what the first body of a pair gets.
    """

    normal: np.ndarray
    friction: np.ndarray


def collide(meeting: Meeting, carried: np.ndarray, shift: np.ndarray, slow: float) -> Pushes:
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

    """
    crowd, normal = meeting.crowd, meeting.touches.normal
    grip = Grip(meeting)
    before = crowd.v[grip.particle]
    push = _pushes(meeting, grip, before, slow)
    velocity = before + grip.spread(push[:, None] * normal)
    sliding = grip.tangential(velocity)
    rubbed = _rubbed(meeting, sliding, (push + carried) * grip.stiffness)[:, None]
    friction = np.zeros_like(sliding)
    for _ in range(FRICTION_ROUNDS):
        now = grip.tangential(velocity + grip.spread(friction))
        friction += ((1.0 - rubbed) * sliding - now) / grip.stiffness_along[:, None]
    moves = _moves(meeting, grip, shift[grip.particle], rubbed)
    grip.give(crowd.v, push[:, None] * normal + friction)
    grip.give(crowd.x, moves)
    return Pushes(push, meeting.sign[:, None] * friction)


def _pushes(meeting: Meeting, grip: Grip, velocity: np.ndarray, slow: float) -> np.ndarray:
    """Return the impulses (k,) that stop all approach; of two rigid bodies, that reflect it."""
    crowd, touches = meeting.crowd, meeting.touches
    speed = grip.along_normals(velocity)
    bounces = crowd.rigid[touches.body] & crowd.rigid[touches.other] & (speed < -slow)
    elasticity = between(crowd.elasticity, touches.body, touches.other)
    wanted = np.where(bounces, -elasticity * speed, 0.0)
    push = np.zeros(len(touches))
    for _ in range(RIGID_ROUNDS if grip.some_rigid else SOFT_ROUNDS):
        now = speed + grip.along_normals(grip.spread(push[:, None] * touches.normal))
        push = np.maximum(push + (wanted - now) / grip.stiffness, 0.0)
    gained = speed + 0.5 * grip.along_normals(grip.spread(push[:, None] * touches.normal))
    if wanted.any() and push @ gained > 0.0:
        # rebounds at many places at once could give more than there was
        push *= -(push @ speed) / (push @ (gained - speed)) / 2.0
    return push


def _rubbed(meeting: Meeting, sliding: np.ndarray, pressed: np.ndarray) -> np.ndarray:
    """
    Return the share (k,) of the sliding (k, 3), m/s, that friction takes.

    Coulomb's law counts as soon as one of the bodies has it; `pressed` (k,) is how fast they are
    pressed together, m/s.
    """
    crowd, body, other = meeting.crowd, meeting.touches.body, meeting.touches.other
    share = between(crowd.friction, body, other)
    if not crowd.coulomb.any():
        return share
    coulomb = crowd.coulomb[body] | crowd.coulomb[other]
    coefficient = between(np.where(crowd.coulomb, crowd.friction, np.nan), body, other)
    speed = np.linalg.norm(sliding, axis=1)
    bound = coefficient * pressed / np.where(speed > 0.0, speed, 1.0)
    return np.where(coulomb, np.minimum(bound, 1.0), share)


def _moves(meeting: Meeting, grip: Grip, shift: np.ndarray, rubbed: np.ndarray) -> np.ndarray:
    """
    Return what moves particles (k, 3) out of the faces, as if it were impulses.

    Friction takes back some of the way, too: what sticks hardly creeps.
    """
    crowd, touches = meeting.crowd, meeting.touches
    farthest = LARGEST_MOVE * np.minimum(crowd.scale[touches.body], crowd.scale[touches.other])
    depth = np.minimum(touches.depth - grip.along_normals(shift), farthest)
    way = crowd.x[grip.particle] - crowd.start[grip.particle]
    kept = (1.0 - STICKING * rubbed) * grip.tangential(way)
    out, back = np.zeros(len(touches)), np.zeros_like(kept)
    for _ in range(PUSH_OUT_ROUNDS):
        moved = grip.spread(back + out[:, None] * touches.normal)
        out = np.maximum(out + (depth - grip.along_normals(moved)) / grip.stiffness, 0.0)
        back += (kept - grip.tangential(way + moved)) / grip.stiffness_along[:, None]
    return back + out[:, None] * touches.normal


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
            touched = np.bincount(np.concatenate(sides), minlength=len(crowd))
            self._rigid_mobility = meeting.crowd.mobility * crowd.rigid[:, None, None]
            counted = self._rigid_mobility * touched[:, None, None]
            self._counted_mobility = [counted[body] for body in sides]
            self._arms = [meeting.point - crowd.centre[body] for body in sides]

    @cached_property
    def stiffness(self) -> np.ndarray:
        """(k,) float: what unit impulses along the normals do to relative speeds, 1/kg."""
        if not self.some_rigid:
            return self._soft_stiffness
        total, normal = self._soft_stiffness.copy(), self._touches.normal
        for mobility, arms in zip(self._counted_mobility, self._arms, strict=True):
            row = np.hstack([normal, rigid_motion.cross(arms, normal)])
            total += np.einsum('ij,ijk,ik->i', row, mobility, row)
        return total

    @cached_property
    def stiffness_along(self) -> np.ndarray:
        """(k,) float: not less than what they do along any direction, 1/kg."""
        if not self.some_rigid:
            return self._soft_stiffness
        total = self._soft_stiffness.copy()
        for mobility, arms in zip(self._counted_mobility, self._arms, strict=True):
            turning = np.einsum('ijj->i', mobility[:, 3:, 3:])
            total += mobility[:, 0, 0] + turning * np.einsum('ij,ij->i', arms, arms)
        return total

    def along_normals(self, field: np.ndarray) -> np.ndarray:
        """Return how far a field (u, 3) brings particles from their faces, (k,)."""
        return np.einsum('ij,ij->i', self._relative @ field, self._touches.normal)

    def tangential(self, field: np.ndarray) -> np.ndarray:
        """Return how far it brings them along the faces, (k, 3)."""
        relative, normal = self._relative @ field, self._touches.normal
        return relative - np.einsum('ij,ij->i', relative, normal)[:, None] * normal

    def spread(self, impulse: np.ndarray) -> np.ndarray:
        """Return what impulses (k, 3) on the particles, and back on faces, change: (u, 3)."""
        change = self._lightness[:, None] * (self._spread @ impulse)
        if self.some_rigid:
            rigid = self._rigid_particle
            twist = self._rigid_twist(impulse)
            change[rigid] = self._crowd.field(twist, self.particle[rigid])
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
            total += sign * summed(both, body, len(total))
        return rigid_motion.applied(self._rigid_mobility, total)
