# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What matching needs of a rest shape: computed once, shared by all bodies that have the shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from softbody_ros.core.geometry.mesh import MeshError, Surface
from softbody_ros.core.sums import sums, weighted

LINEAR, QUADRATIC = 3, 9
"""Number of features that a linear and a quadratic goal combine."""
RANK_CUT = 1e-9
"""Eigenvalues below this fraction of the largest count as zero: sheets, rods, 8-vertex boxes."""
FACE_BLOCK = 1 << 16


@dataclass(frozen=True, eq=False)
class RestShape:
    """
    Constants of one rest shape of n particles.

    Lengths are divided by `scale`, so that the numerics do not depend on the size of the object:
    q = (x⁰ − centre) / scale. Row 0 of `features` is 1 and stands for the translation; rows 1–3
    are q, rows 4–9 the products x² y² z² xy yz zx, all but the first with weighted mean zero.
    Without that mean the quadratic goals would move the centre of mass.

    Attributes
    ----------
    surface : Surface
        the shape in the body's own frame
    centre : (3,) float
        centre of mass in the body's own frame, m
    scale : float
        RMS distance of the particles from the centre of mass (by area), m
    weights : (n,) float
        share of the body's mass that each particle has; they sum to 1
    features : (10, n) float
        what a goal combines linearly: goal = transform @ features
    weighted_features : (10, n) float
        `weights` times `features`; positions @ weighted_featuresᵀ are the moments
    gram : (10, 10) float
        Σ w f fᵀ
    inverse_linear, inverse_quadratic : (3, 3), (9, 9) float
        pseudo-inverse of the Gram matrix of the first 3, or all 9, features after the one
        (Müller et al. 2005, eq. 7 and section 4.3)
    unspanned_linear, unspanned_quadratic : (3, 3), (9, 9) float or None
        projection on the combinations of features that vanish on every particle, if any do
    volume_form : (9, 9, 9) float
        antisymmetric; the enclosed volume of the goal T f, relative to the rest volume, is
        Σ T₀ᵢ T₁ⱼ T₂ₖ volume_formᵢⱼₖ. For an open surface it is the determinant of T's linear block

    """

    surface: Surface
    centre: np.ndarray
    scale: float
    weights: np.ndarray
    features: np.ndarray
    weighted_features: np.ndarray
    gram: np.ndarray
    inverse_linear: np.ndarray
    inverse_quadratic: np.ndarray
    unspanned_linear: np.ndarray | None
    unspanned_quadratic: np.ndarray | None
    volume_form: np.ndarray

    @cached_property
    def volume_forms(self) -> dict[int, np.ndarray]:
        """The volume form (F, F²) of so many features F."""
        counts = LINEAR, QUADRATIC
        return {
            count: self.volume_form[:count, :count, :count].reshape(count, -1) for count in counts
        }

    @property
    def has_volume(self) -> bool:
        """Whether the shape extends in all directions, unlike a sheet or a rod."""
        return self.unspanned_linear is None

    @property
    def particle_count(self) -> int:
        """Number of particles, n."""
        return len(self.weights)


def make_rest_shape(
    surface: Surface, dtype: type = np.float64, weights: np.ndarray | None = None
) -> RestShape:
    """
    Return the constants of a surface, with the large arrays in `dtype`.

    Parameters
    ----------
    surface : Surface
    dtype : numpy float type
    weights : (n,) float, optional
        that sum to 1; by default each vertex has its share of the area

    Raises
    ------
    MeshError
        if all vertices coincide.

    """
    area_weights = _area_weights(surface)
    spread = surface.vertices - weighted(surface.vertices.T, area_weights)
    scale = float(np.sqrt(weighted(np.einsum('ij,ij->i', spread, spread)[None], area_weights)[0]))
    weights = area_weights if weights is None else weights
    centre = weighted(surface.vertices.T, weights)
    offsets = surface.vertices - centre
    if not scale > 0.0:
        raise MeshError('all vertices of the surface coincide: a body needs some extent')
    x, y, z = offsets.T / scale
    features = np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])
    features[1:] -= weighted(features[1:], weights)[:, None]
    gram = np.eye(1 + QUADRATIC)
    gram[1:, 1:] = sums(features[1:] * weights, features[1:])
    inverse_linear, unspanned_linear = pseudo_inverse(gram[1 : 1 + LINEAR, 1 : 1 + LINEAR])
    inverse_quadratic, unspanned_quadratic = pseudo_inverse(gram[1:, 1:])
    return RestShape(
        surface=surface,
        centre=centre,
        scale=scale,
        weights=weights.astype(dtype),
        features=features.astype(dtype),
        weighted_features=(weights * features).astype(dtype),
        gram=gram,
        inverse_linear=inverse_linear,
        inverse_quadratic=inverse_quadratic,
        unspanned_linear=unspanned_linear if unspanned_linear.any() else None,
        unspanned_quadratic=unspanned_quadratic if unspanned_quadratic.any() else None,
        volume_form=_volume_form(surface, features[1:]),
    )


def features_by_others(rest: RestShape, other: RestShape) -> np.ndarray:
    """
    Return the features of a rest shape as combinations (10, 10) of those of another.

    Both are of one surface and differ in their weights, so in their centres of mass: with q + d
    for q, x y becomes x y + d_y x + d_x y, and a constant that keeps its mean zero.
    """
    x, y, z = (other.centre - rest.centre) / rest.scale
    result = np.eye(1 + QUADRATIC)
    result[4:, 1 : 1 + LINEAR] = [
        [2.0 * x, 0.0, 0.0],
        [0.0, 2.0 * y, 0.0],
        [0.0, 0.0, 2.0 * z],
        [y, x, 0.0],
        [0.0, z, y],
        [z, 0.0, x],
    ]
    result[1:, 0] = -result[1:, 1:] @ weighted(other.features[1:], rest.weights)
    return result


def _area_weights(surface: Surface) -> np.ndarray:
    """Return each vertex's share of the area, so that no result depends on the tessellation."""
    count = len(surface.vertices)
    if not len(surface.faces):
        return np.full(count, 1 / count)
    a, b, c = surface.vertices[surface.faces.T]
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    shares = np.bincount(surface.faces.ravel(), np.repeat(areas, 3), minlength=count)
    total = shares.sum()
    return shares / total if total > 0.0 else np.full(count, 1 / count)


def pseudo_inverse(gram: np.ndarray, cut: float = RANK_CUT) -> tuple[np.ndarray, np.ndarray]:
    """Return the pseudo-inverse of a symmetric matrix and the projection on its null space."""
    values, vectors = np.linalg.eigh(gram)
    spanned = values > cut * values[-1]
    basis = vectors[:, spanned]
    inverse = (basis / values[spanned]) @ basis.T
    rest = vectors[:, ~spanned]
    return inverse, rest @ rest.T


def _volume_form(surface: Surface, features: np.ndarray) -> np.ndarray:
    """
    Return the coefficients of the volume as a cubic form (divergence theorem).

    6 V = Σ_faces det(g_a g_b g_c) with g = T f is Σᵢⱼₖ det(Tᵢ Tⱼ Tₖ) Σ_faces f_aᵢ f_bⱼ f_cₖ.
    """
    moments = np.zeros((QUADRATIC,) * 3)
    if surface.closed:
        for start in range(0, len(surface.faces), FACE_BLOCK):
            a, b, c = (features[:, corner] for corner in surface.faces[start:][:FACE_BLOCK].T)
            products = (b[:, None] * c).reshape(QUADRATIC**2, -1)
            moments += sums(a, products).reshape(moments.shape)
    form = _antisymmetric(moments)
    if not surface.closed or form[0, 1, 2] < RANK_CUT:
        moments[:] = 0.0
        moments[0, 1, 2] = 1.0
        form = _antisymmetric(moments)
    return form / form[0, 1, 2]


def _antisymmetric(moments: np.ndarray) -> np.ndarray:
    total = np.zeros_like(moments)
    for order in permutations(range(3)):
        sign = round(np.linalg.det(np.eye(3)[list(order)]))
        total += sign * moments.transpose(order)
    return total
