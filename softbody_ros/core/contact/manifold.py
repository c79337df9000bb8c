# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the bodies of a crowd touch, pair by pair, and how they move there as rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softbody_ros.core.collision.narrow_phase import Touches
from softbody_ros.core.columns import summed
from softbody_ros.core.contact import soft_obstacle
from softbody_ros.core.contact.contact_state import Crowd
from softbody_ros.core.shape_matching import rigid_motion

HELD = 1e-6
"""Share of its mobility that a body counts with when pins hold it altogether."""


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
    def apart(self) -> np.ndarray:
        """(p,) bool: whether they are two bodies."""
        return self.one != self.two

    @cached_property
    def reduced_mass(self) -> np.ndarray:
        """(p,) float: of the two bodies, kg; very large where none of them can move."""
        lightness = self.crowd.body_lightness
        least = HELD / np.minimum(self.crowd.mass[self.one], self.crowd.mass[self.two])
        return 1.0 / np.maximum(lightness[self.one] + lightness[self.two], least)

    @cached_property
    def scale(self) -> np.ndarray:
        """(p,) float: RMS radius of the smaller body, m."""
        return np.minimum(self.crowd.scale[self.one], self.crowd.scale[self.two])

    @property
    def springiness(self) -> np.ndarray:
        """
        (p,) float: speed after a stop, as a share of that before.

        What a body stores on the first half of a swing it gives back on the second, of which
        bounciness leaves a share; and elasticity absorbs as in `soft_obstacle.absorbed_rebound`.
        """
        elasticity, bounciness = (
            between(values, self.one, self.two)
            for values in (self.crowd.elasticity, self.crowd.bounciness)
        )
        return 0.5 * (1.0 + elasticity) * np.sqrt(bounciness)

    def settling(self, gravity: np.ndarray) -> np.ndarray:
        """Return the speeds (p,) at which restitution fades out, m/s."""
        return np.asarray(soft_obstacle.settling_speed(gravity, self.scale))

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
        return summed(values, self.pair, len(self.one))

    def speeds(self, twist: np.ndarray) -> np.ndarray:
        """Return how fast bodies that move with twists (C, 6) part at each place, (k,), m/s."""
        row_one, row_two = self.rows
        speeds = np.einsum('ij,ij->i', row_one, twist[self.one[self.pair]])
        return speeds - np.einsum('ij,ij->i', row_two, twist[self.two[self.pair]])

    def twist_by(self, impulse: np.ndarray) -> np.ndarray:
        """Return the twists (C, 6) that impulses (k,) along the normals cause."""
        row_one, row_two = self.rows
        count = len(self.crowd)
        total = summed(self.sums(impulse[:, None] * row_one), self.one, count)
        total -= summed(self.sums(impulse[:, None] * row_two), self.two, count)
        return rigid_motion.applied(self.crowd.mobility, total)


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


def between(values: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Return the geometric means of what two bodies have; NaN is of no account."""
    one, two = values[one], values[two]
    one, two = np.where(np.isnan(one), two, one), np.where(np.isnan(two), one, two)
    return np.sqrt(one * two)
