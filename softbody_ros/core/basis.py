# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The functions on particles of which a flight is a linear combination, and their Gram matrix.

Until a body meets something, its particles move to combinations of their predicted positions and
velocities, of the features of the rest shape, and of what its regions make of their places, with
coefficients that all particles of the body share. Moments, momentum and inertia are inner
products of such combinations. So a tick reads the particles once, for the Gram matrix of these
functions, works with matrices as small as that one, exactly as if with the particles themselves,
and writes the particles once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softbody_ros.core.shape_matching.rest_shape import RestShape
from softbody_ros.core.sums import blocks, mapped, sums

POSITION, VELOCITY, REGIONS = slice(0, 3), slice(3, 6), slice(6, 9)
"""Rows of a basis; those of the regions only if there are some, then the one, the features."""
PARTICLE = slice(0, 6)


def row_of_one(with_regions: bool) -> int:
    """Return which row of a basis the one is."""
    return REGIONS.stop if with_regions else PARTICLE.stop


def room(bodies: int, rest: RestShape, features: int, one: int) -> np.ndarray:
    """
    Return room for the functions (B, C, n) of a basis, the one and 3 or 9 features filled in.

    Parameters
    ----------
    bodies : int
        B
    rest : RestShape
    features : int
        3 or 9
    one : int
        row of the one

    """
    result = np.zeros((bodies, one + 1 + features, rest.particle_count), rest.features.dtype)
    result[:, one:] = rest.features[: 1 + features]
    return result


def products(functions: np.ndarray, rest: RestShape, one: int, part: slice) -> np.ndarray:
    """
    Return what some particles add to the inner products of positions and velocities.

    Parameters
    ----------
    functions : (B, C, n) float
        see `Basis`
    rest : RestShape
    one : int
        row of the one
    part : slice
        of the particles

    Returns
    -------
    (B, 6, C) float64
        of velocities only those with the one and the features, else zero

    """
    bodies, count = functions.shape[:2]
    functions, features = functions[..., part], rest.weighted_features[: count - one, part]
    result = np.zeros((bodies, PARTICLE.stop, count))
    result[:, POSITION] = sums(functions[:, POSITION] * rest.weights[part], functions)
    result[:, VELOCITY, one:] = sums(functions[:, VELOCITY], features)
    return result


def gram_matrix(products: np.ndarray, rest: RestShape, one: int) -> np.ndarray:
    """Return the Gram matrix (B, C, C) of a `Basis` from all `products`."""
    bodies, _, count = products.shape
    result = np.zeros((bodies, count, count))
    result[:, PARTICLE] = products
    result[:, VELOCITY, POSITION] = products[:, POSITION, VELOCITY].swapaxes(1, 2)
    result[:, one:, PARTICLE] = products[..., one:].swapaxes(1, 2)
    result[:, one:, one:] = rest.gram[: count - one, : count - one]
    return result


@dataclass(frozen=True, eq=False)
class Basis:
    """
    C functions on the particles of B bodies, and their inner products.

    A field on the particles, such as their positions, has coefficients (B, 3, C).

    Attributes
    ----------
    rest : RestShape
    origin : (B, 3) float
        from which positions count, m: near the body, so that inner products are precise
    functions : (B, C, n) float
        positions, m, and velocities, m/s, as predicted; what regions make of the positions, m,
        where there are some; the one; the features
    one : int
        row of the one; the features follow
    gram : (B, C, C) float64
        Σ w fᵢ fⱼ, but for velocities with velocities, which nothing needs: zero

    """

    rest: RestShape
    origin: np.ndarray
    functions: np.ndarray
    one: int
    gram: np.ndarray

    def __len__(self) -> int:
        return len(self.functions)

    @property
    def particles(self) -> np.ndarray:
        """(B, 6, C) float: coefficients of the predicted positions and velocities."""
        count = self.functions.shape[1]
        result = np.empty((len(self), PARTICLE.stop, count))
        result[:] = np.eye(PARTICLE.stop, count)
        return result

    def covariance(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return means and central moments of particles.

        Parameters
        ----------
        coefficients : (B, 6, C) float

        Returns
        -------
        mean : (B, 6) float
            position from the origin, m, and velocity, m/s, of the centre of mass
        covariance : (B, 6, 6) float
            Σ w of the products of what is left; means nothing for velocities with velocities

        """
        products = coefficients @ self.gram
        mean = products[..., self.one]
        products = products @ coefficients.swapaxes(1, 2)
        return mean, products - mean[:, :, None] * mean[:, None]

    def use_regions(self, places: np.ndarray) -> None:
        """Put what regions make of the positions, (B, 3, n), m from the origin, into the basis."""
        self.functions[:, REGIONS] = places
        products = sums(places * self.rest.weights, self.functions)
        self.gram[:, REGIONS] = products
        self.gram[:, :, REGIONS] = products.swapaxes(1, 2)

    def in_world(self, coefficients: np.ndarray) -> np.ndarray:
        """Return the coefficients (B, 3, C) of positions that do not count from the origin."""
        result = coefficients.copy()
        result[..., self.one] += self.origin
        return result

    def evaluate(self, coefficients: np.ndarray, out: np.ndarray) -> None:
        """Write particles (B, 6, n), m and m/s, that have coefficients (B, 6, C)."""
        coefficients = coefficients.copy()
        is_single = out.dtype != np.float64
        if not is_single:
            coefficients[:, POSITION, self.one] += self.origin
        coefficients = coefficients.astype(out.dtype, copy=False)
        for part in blocks(out.shape[-1]):
            mapped(coefficients, self.functions[..., part], out[..., part])
            if is_single:
                # each particle is rounded by itself then: what all share would make bodies drift
                out[:, POSITION, part] += self.origin.astype(out.dtype)[..., None]

    def at(self, coefficients: np.ndarray, body: np.ndarray, particle: np.ndarray) -> np.ndarray:
        """Return positions (k, 3), m, with coefficients (B, 3, C), of particles of bodies (k,)."""
        coefficients = self.in_world(coefficients)
        if len(self) == 1:
            return mapped(coefficients[0], self.functions[0].take(particle, axis=1)).T
        values = self.functions[body, :, particle]
        return np.matmul(coefficients[body], values[..., None])[..., 0]
