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

from softbody_ros.core.contact.manifold import Meeting, between
from softbody_ros.core.shape_matching import rigid_motion
from softbody_ros.core.sums import BLOCK

SOFT_ROUNDS, RIGID_ROUNDS, FRICTION_ROUNDS, PUSH_OUT_ROUNDS = 4, 16, 4, 4
TINY = 1e-300
LARGEST_MOVE = 0.2
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
    before = grip.relative(crowd.v)
    push = _pushes(meeting, grip, before, slow)
    velocity = before + grip.reply(push[:, None] * normal)
    sliding = along(normal, velocity)
    rubbed = _rubbed(meeting, sliding, (push + carried) * grip.stiffness)[:, None]
    friction = np.zeros_like(sliding)
    if rubbed.any():
        for _ in range(FRICTION_ROUNDS):
            now = along(normal, velocity + grip.reply(friction))
            friction += ((1.0 - rubbed) * sliding - now) / grip.stiffness_along[:, None]
    moves = _moves(meeting, grip, shift, rubbed)
    grip.give(crowd.v, push[:, None] * normal + friction)
    grip.give(crowd.x, moves)
    return Pushes(push, meeting.sign[:, None] * friction)


def along(normal: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return vectors (k, 3) without what they have along normals (k, 3)."""
    return vectors - np.einsum('ij,ij->i', vectors, normal)[:, None] * normal


def _pushes(meeting: Meeting, grip: Grip, velocity: np.ndarray, slow: float) -> np.ndarray:
    """Return the impulses (k,) that stop all approach; of two rigid bodies, that reflect it."""
    crowd, touches = meeting.crowd, meeting.touches
    normal = touches.normal
    speed = np.einsum('ij,ij->i', velocity, normal)
    bounces = crowd.rigid[touches.body] & crowd.rigid[touches.other] & (speed < -slow)
    elasticity = between(crowd.elasticity, touches.body, touches.other)
    wanted = np.where(bounces, -elasticity * speed, 0.0)
    push, change = np.zeros(len(touches)), np.zeros(len(touches))
    for _ in range(RIGID_ROUNDS if grip.some_rigid else SOFT_ROUNDS):
        push = np.maximum(push + (wanted - speed - change) / grip.stiffness, 0.0)
        change = np.einsum('ij,ij->i', grip.reply(push[:, None] * normal), normal)
    if bounces.any() and push @ (speed + 0.5 * change) > 0.0:
        # rebounds at many places at once could give more than there was
        push *= -2.0 * (push @ speed) / (push @ change)
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
    normal = touches.normal
    farthest = LARGEST_MOVE * np.minimum(crowd.scale[touches.body], crowd.scale[touches.other])
    sunk = touches.depth - np.einsum('ij,ij->i', grip.relative(shift), normal)
    depth = np.minimum(sunk, farthest)
    way = grip.relative(crowd.x - crowd.start)
    kept = (1.0 - STICKING * rubbed) * along(normal, way)
    out, back, moved = np.zeros(len(touches)), np.zeros_like(way), np.zeros_like(way)
    for _ in range(PUSH_OUT_ROUNDS):
        back += (kept - along(normal, way + moved)) / grip.stiffness_along[:, None]
        left = depth - np.einsum('ij,ij->i', moved, normal)
        out = np.maximum(out + left / grip.stiffness, 0.0)
        moved = grip.reply(back + out[:, None] * normal)
    return back + out[:, None] * normal


class Grip:
    """
    What impulses at touching places do there: each acts on a particle, and back on a face.

    Particles and bodies count as many times as they are touched: so all impulses can be found at
    once without more than stopping anything (mass splitting: Tonge, Benevolenski, Voroshilov 2012,
    Mass splitting for jitter-free parallel rigid body simulation). Rigid bodies move as wholes.

    Attributes
    ----------
    some_rigid : bool
        whether some of the bodies are rigid

    """

    def __init__(self, meeting: Meeting) -> None:
        crowd, touches, count = meeting.crowd, meeting.touches, len(meeting.touches)
        self._crowd, self._touches = crowd, touches
        columns = np.column_stack([touches.particle, touches.corners])
        values = np.column_stack([np.ones(count), -touches.share])
        self._particle, place = np.unique(columns, return_inverse=True)
        shape = (count, len(self._particle))
        ends = np.arange(0, 4 * count + 1, 4)
        self._relative = csr_array((values.ravel(), place.ravel(), ends), shape=shape)
        rigid = crowd.rigid[crowd.body[self._particle]]
        self.some_rigid = bool(rigid.any())
        lightness = np.where(rigid, 0.0, crowd.lightness[self._particle])
        touched = np.bincount(place.ravel(), minlength=shape[1])
        square = csr_array((values.ravel() ** 2, place.ravel(), ends), shape=shape)
        self._soft_stiffness = square @ (lightness * touched)
        self._spread = self._relative.T.tocsr()
        self._spread.data *= np.repeat(lightness, np.diff(self._spread.indptr))
        # few places: one small dense product is several times faster than two sparse ones
        few = count**2 <= BLOCK
        self._coupling = (self._relative @ self._spread).toarray() if few else None
        if self.some_rigid:
            self._prepare_rigid(meeting)

    def _prepare_rigid(self, meeting: Meeting) -> None:
        crowd, touches, count = meeting.crowd, meeting.touches, len(meeting.touches)
        sides = (touches.body, touches.other)
        self._mobility = crowd.mobility * crowd.rigid[:, None, None]
        touched = np.bincount(np.concatenate(sides), minlength=len(crowd))
        counted = self._mobility * touched[:, None, None]
        self._counted_mobility = [counted[body] for body in sides]
        self._arms = [meeting.point - crowd.centre[body] for body in sides]
        # (3 k, 6 C): what twists do to relative velocities
        blocks = [
            sign * rigid_motion.jacobian(arms)
            for sign, arms in zip((1.0, -1.0), self._arms, strict=True)
        ]
        rows = np.broadcast_to(np.arange(3 * count).reshape(-1, 3, 1), (count, 3, 6))
        columns = [
            np.broadcast_to(6 * body[:, None, None] + np.arange(6), (count, 3, 6))
            for body in sides
        ]
        twists = csr_array(
            (np.ravel(blocks), (np.ravel([rows, rows]), np.ravel(columns))),
            shape=(3 * count, 6 * len(crowd)),
        )
        self._twists = twists.toarray() if np.prod(twists.shape) <= BLOCK else twists

    @cached_property
    def stiffness(self) -> np.ndarray:
        """(k,) float: what unit impulses along the normals do to relative speeds, 1/kg."""
        if not self.some_rigid:
            return self._soft_stiffness
        total, normal = self._soft_stiffness.copy(), self._touches.normal
        for mobility, arms in zip(self._counted_mobility, self._arms, strict=True):
            row = np.hstack([normal, rigid_motion.cross(arms, normal)])
            total += np.einsum('ij,ijk,ik->i', row, mobility, row)
        return np.maximum(total, TINY)

    @cached_property
    def stiffness_along(self) -> np.ndarray:
        """(k,) float: not less than what they do along any direction, 1/kg."""
        if not self.some_rigid:
            return self._soft_stiffness
        total = self._soft_stiffness.copy()
        for mobility, arms in zip(self._counted_mobility, self._arms, strict=True):
            turning = np.einsum('ijj->i', mobility[:, 3:, 3:])
            moving = np.einsum('ijj->i', mobility[:, :3, :3])
            total += moving + turning * np.einsum('ij,ij->i', arms, arms)
        return np.maximum(total, TINY)

    def relative(self, field: np.ndarray) -> np.ndarray:
        """Return what a field (N, 3) of the crowd has at particles more than at faces, (k, 3)."""
        return self._relative @ field[self._particle]

    def reply(self, impulse: np.ndarray) -> np.ndarray:
        """Return what impulses (k, 3) do to the relative velocities, (k, 3)."""
        if self._coupling is not None:
            change = self._coupling @ impulse
        else:
            change = self._relative @ (self._spread @ impulse)
        if self.some_rigid:
            change += (self._twists @ self._rigid_twist(impulse).ravel()).reshape(-1, 3)
        return change

    def give(self, field: np.ndarray, impulse: np.ndarray) -> None:
        """Change a field (N, 3) of the crowd by impulses (k, 3), in place."""
        field[self._particle] += self._spread @ impulse
        if self.some_rigid:
            field += self._crowd.field(self._rigid_twist(impulse))

    def _rigid_twist(self, impulse: np.ndarray) -> np.ndarray:
        total = (self._twists.T @ impulse.ravel()).reshape(-1, 6)
        return rigid_motion.applied(self._mobility, total)
