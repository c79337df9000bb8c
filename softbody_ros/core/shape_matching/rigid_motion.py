# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rigid part of the motion of a cloud of particles: momentum, inertia, angular velocity.

Everything is per mass and for a stack of B bodies: positions x and velocities v are (B, 3, n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.basis import POSITION, VELOCITY, Basis
from softbody_ros.core.shape_matching.rest_shape import RestShape
from softbody_ros.core.small_matrices import symmetric_inverse
from softbody_ros.core.sums import blocks, mapped, sums, weighted

LEVI_CIVITA = np.zeros((3, 3, 3))
"""Permutation symbol: (a × b)ᵢ = Σ εᵢⱼₖ aⱼ bₖ."""
LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
LEVI_CIVITA[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0
_INERTIA_OF_GRAM = np.outer(np.eye(3), np.eye(3)) - np.eye(9)
INERTIA_CUT = 1e-12
"""Principal inertias below this fraction of the largest count as zero."""
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""Axes after and before x, y and z."""


@dataclass(frozen=True)
class RigidMotion:
    """
    The rigid motion with the momentum and angular momentum of deformed bodies.

    Attributes
    ----------
    centre : (B, 3) float
        centre of mass, m
    velocity : (B, 3) float
        of the centre of mass, m/s
    spin : (B, 3) float
        angular momentum about the centre of mass, m²/s
    inverse_inertia : (B, 3, 3) float
        1/m²

    """

    centre: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    inverse_inertia: np.ndarray

    @property
    def angular_velocity(self) -> np.ndarray:
        """(B, 3) float: rad/s."""
        return applied(self.inverse_inertia, self.spin)

    def take(self, rows: np.ndarray, other: RigidMotion) -> None:
        """Let some bodies, given as indices, have the motions of others, in place."""
        self.centre[rows], self.velocity[rows] = other.centre, other.velocity
        self.spin[rows], self.inverse_inertia[rows] = other.spin, other.inverse_inertia


def momentum(basis: Basis, particles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and spin (B, 3) of particles with coefficients (B, 6, C)."""
    mean, covariance = basis.covariance(particles)
    return mean[:, VELOCITY], _spin(covariance[:, POSITION, VELOCITY])


def of_particles(basis: Basis, particles: np.ndarray) -> RigidMotion:
    """
    Return the rigid part of the motion of particles with coefficients (B, 6, C).

    Its centre counts from the origin of the basis.
    """
    mean, covariance = basis.covariance(particles)
    inertia = _inertia(covariance[:, POSITION, POSITION])
    return RigidMotion(
        centre=mean[:, POSITION],
        velocity=mean[:, VELOCITY],
        spin=_spin(covariance[:, POSITION, VELOCITY]),
        inverse_inertia=_inverse_inertia(inertia, basis.rest),
    )


def combination(
    basis: Basis,
    particles: np.ndarray,
    centre: np.ndarray,
    velocity: np.ndarray,
    angular_velocity: np.ndarray,
) -> np.ndarray:
    """
    Return the coefficients (B, 3, C) of a rigid motion: velocity + ω × (x − centre).

    Parameters
    ----------
    basis : Basis
    particles : (B, 6, C) float
        coefficients
    centre, velocity, angular_velocity : (B, 3) float
        m from the origin of the basis, m/s, rad/s

    """
    cross = cross_matrix(angular_velocity)
    result = cross @ particles[:, POSITION]
    result[..., basis.one] += velocity - applied(cross, centre)
    return result


def rigid_motion(x: np.ndarray, v: np.ndarray, centre: np.ndarray, rest: RestShape) -> RigidMotion:
    """Return the rigid part of a motion about given centres of mass (B, 3)."""
    turning, gram = np.zeros((2, len(x), 3, 3))
    for part in blocks(x.shape[-1]):
        arms = x[..., part] - centre.astype(x.dtype)[..., None]
        heavy_arms = arms * rest.weights[part]
        turning += sums(heavy_arms, v[..., part])
        gram += sums(heavy_arms, arms)
    inverse_inertia = _inverse_inertia(_inertia(gram), rest)
    return RigidMotion(centre, weighted(v, rest.weights), _spin(turning), inverse_inertia)


def inertia(x: np.ndarray, centre: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return the inertia tensors (B, 3, 3) about the centres of mass (B, 3), m²."""
    arms = x - centre.astype(x.dtype)[..., None]
    return _inertia(sums(arms, arms * rest.weights))


def field(
    x: np.ndarray, centre: np.ndarray, velocity: np.ndarray, angular_velocity: np.ndarray
) -> np.ndarray:
    """
    Return the velocities of a rigid motion: velocity + angular_velocity × (x − centre).

    Parameters
    ----------
    x : (B, 3, n) float
        m
    centre, velocity, angular_velocity : (B, 3) float
        m, m/s, rad/s

    Returns
    -------
    (B, 3, n) float
        m/s

    """
    cross = cross_matrix(angular_velocity)
    result = mapped(cross.astype(x.dtype, copy=False), x)
    result += (velocity - applied(cross, centre)).astype(x.dtype, copy=False)[..., None]
    return result


def jacobian(arms: np.ndarray) -> np.ndarray:
    """
    Return what twists do at arms (…, 3) from the centre: matrices (…, 3, 6).

    A twist is the velocity of the centre and the angular velocity: v + ω × arm.
    """
    result = np.zeros((*arms.shape, 6))
    result[..., [0, 1, 2], [0, 1, 2]] = 1.0
    result[..., [0, 1, 2], [4, 5, 3]] = arms[..., [2, 0, 1]]
    result[..., [0, 1, 2], [5, 3, 4]] = -arms[..., [1, 2, 0]]
    return result


def correction(
    x: np.ndarray, present: RigidMotion, velocity: np.ndarray, spin: np.ndarray
) -> np.ndarray:
    """
    Return the velocities (B, 3, n) that bring a motion to a velocity and a spin (B, 3).

    Momentum and angular momentum are then the wanted ones, exactly.
    """
    angular_velocity = applied(present.inverse_inertia, spin - present.spin)
    return field(x, present.centre, velocity - present.velocity, angular_velocity)


def cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """Return the matrices (B, 3, 3) by which vectors (B, 3) are multiplied from the left: a ×."""
    return (vectors @ -LEVI_CIVITA.reshape(3, 9)).reshape(-1, 3, 3)


def applied(tensor: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the products (…, i) of tensors (…, i, j) with vectors (…, j)."""
    return np.matmul(tensor, vectors[..., None])[..., 0]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the vector products (k, 3); several times faster than `numpy.cross` for few rows."""
    a, b = a.T, b.T
    forwards = a.take(NEXT, axis=0) * b.take(LAST, axis=0)
    return (forwards - a.take(LAST, axis=0) * b.take(NEXT, axis=0)).T


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar products (k,) of vectors (k, …)."""
    return np.add.reduce(a * b, axis=1)


def with_moment(vectors: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """Return (k, 6): vectors (k, 3), and arms (k, 3) × vectors."""
    return np.concatenate([vectors.T, cross(arms, vectors).T]).T


def _inertia(gram: np.ndarray) -> np.ndarray:
    """Return tr(G) 1 − G of Gram matrices (B, 3, 3)."""
    return (gram.reshape(-1, 9) @ _INERTIA_OF_GRAM).reshape(-1, 3, 3)


def _spin(product: np.ndarray) -> np.ndarray:
    """Return Σ a × b (B, 3) from Σ a bᵀ (B, 3, 3)."""
    return product.reshape(-1, 9) @ LEVI_CIVITA.reshape(3, 9).T


def _inverse_inertia(tensor: np.ndarray, rest: RestShape) -> np.ndarray:
    """Return the pseudo-inverse: a rod has no inertia about its axis."""
    return symmetric_inverse(tensor, INERTIA_CUT, INERTIA_CUT * rest.scale**2)
