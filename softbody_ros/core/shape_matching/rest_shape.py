# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rest shapes: precomputed constants for matching, shared by all bodies of a shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from math import fsum

import numpy as np

from softbody_ros.core.geometry.surface import MeshError, Surface
from softbody_ros.core.shape_matching.solid import fill

LINEAR, QUADRATIC = 3, 9
"""Number of features of a linear and a quadratic goal."""
RANK_CUT = 1e-9
"""Eigenvalues below this fraction of the largest count as zero: of sheets, rods, boxes."""
FACE_BLOCK = 1 << 16
BALL = 0.4
"""Mean of |∇(x y)|² along a ball of radius 1."""

SHAPE = np.dtype(
    [
        ('first', np.int64),  # its particles in the weights and q of all rest shapes of a world
        ('count', np.int64),
        ('first_region', np.int64),
        ('regions', np.int64),
        ('first_face', np.int64),  # its faces in those of all
        ('faces', np.int64),
        ('scale', np.float64),
        ('enclosed', np.float64),  # volume, in units of scale³; 0 of open surfaces
        ('centre', np.float64, (3,)),
        ('has_volume', np.bool_),
        ('spanned_linear', np.bool_),
        ('spanned_quadratic', np.bool_),
        ('feature_means', np.float64, (QUADRATIC,)),
        ('feature_rounding', np.float64, (QUADRATIC,)),
        ('weight_rounding', np.float64),
        ('gram', np.float64, (QUADRATIC, QUADRATIC)),
        ('bend_gram', np.float64, (QUADRATIC - LINEAR, QUADRATIC - LINEAR)),
        ('inverse_linear', np.float64, (LINEAR, LINEAR)),
        ('inverse_quadratic', np.float64, (QUADRATIC, QUADRATIC)),
        ('unspanned_linear', np.float64, (LINEAR, LINEAR)),
        ('unspanned_quadratic', np.float64, (QUADRATIC, QUADRATIC)),
        ('whitening_linear', np.float64, (LINEAR, LINEAR)),
        ('whitening_quadratic', np.float64, (QUADRATIC, QUADRATIC)),
        ('volume_linear', np.float64, (LINEAR, LINEAR, LINEAR)),
        ('volume_quadratic', np.float64, (QUADRATIC, QUADRATIC, QUADRATIC)),
    ],
    align=True,
)
"""The constants of a rest shape as kernels read them, see `RestShape`."""


@dataclass(frozen=True, eq=False)
class RestShape:
    """
    Constants of one rest shape of n particles at its surface and k inner ones, after these.

    Inner particles carry mass and are matched like all others; nothing touches them, and they are
    not part of what is published. N = n + k.

    Lengths are divided by `scale`, to make the numerics independent of the size of the object:
    q = (x⁰ − centre) / scale. The nine features are q and the products x² y² z² xy yz zx minus
    their weighted means, without which quadratic goals would move the centre of mass.

    Attributes
    ----------
    surface : Surface
        the shape in the body's own frame
    centre : (3,) float
        centre of mass in the body's own frame, m
    scale : float
        RMS distance of the particles from the centre of mass (by area), m
    areas : (n,) float
        a third of the triangles at each vertex, m²
    inner : (k, 3) float
        inner particles in the body's own frame, m; none if the mass is at the surface
    weights : (N,) float
        share of the body's mass that each particle has; they sum to 1
    q : (3, N) float
        rest positions
    feature_means : (9,) float
        the subtracted means Σ w f; 0 for q
    feature_rounding, weight_rounding : (9,) float, float
        what rounding leaves of Σ w f = 0 after that, and of Σ w − 1 = 0
    gram : (9, 9) float
        Σ w f fᵀ
    bend_gram : (6, 6) float
        mean of ∇f ∇fᵀ over the surface, of products of coordinates and gradients along it, such
        that it is 1 for x y of a ball; 1 without faces
    inverse_linear, inverse_quadratic : (3, 3), (9, 9) float
        pseudo-inverse of the Gram matrix of the first 3, or all 9, features (Müller et al. 2005,
        eq. 7 and section 4.3)
    unspanned_linear, unspanned_quadratic : (3, 3), (9, 9) float
        projection on the null space of that Gram matrix
    whitening_linear, whitening_quadratic : (3, 3), (9, 9) float
        W of the whitened features ψ = W f: Σ w ψ ψᵀ = 1, but for rows of zeros in place of
        combinations of features that the shape does not span
    volume_form : (9, 9, 9) float
        antisymmetric; the enclosed volume of the goal T f, relative to the rest volume, is
        Σ T₀ᵢ T₁ⱼ T₂ₖ volume_formᵢⱼₖ. For an open surface it is the determinant of T's linear block

    """

    surface: Surface
    centre: np.ndarray
    scale: float
    areas: np.ndarray
    inner: np.ndarray
    weights: np.ndarray
    q: np.ndarray
    feature_means: np.ndarray
    feature_rounding: np.ndarray
    weight_rounding: float
    gram: np.ndarray
    bend_gram: np.ndarray
    inverse_linear: np.ndarray
    inverse_quadratic: np.ndarray
    unspanned_linear: np.ndarray
    unspanned_quadratic: np.ndarray
    whitening_linear: np.ndarray
    whitening_quadratic: np.ndarray
    volume_form: np.ndarray

    @property
    def features(self) -> np.ndarray:
        """(10, N) float: 1, and the nine features; a goal combines them linearly."""
        features = _products(self.q)
        features[1:] -= self.feature_means[:, None]
        return features

    @property
    def has_volume(self) -> bool:
        """Whether the shape extends in all directions, unlike a sheet or a rod."""
        return not self.unspanned_linear.any()

    @cached_property
    def enclosed(self) -> float:
        """Enclosed volume of a closed surface, in units of scale³; 0 of an open one."""
        if not self.surface.closed:
            return 0.0
        a, b, c = (self.q[:, corner] for corner in self.surface.faces.T)
        return float((np.cross(a, b, axis=0) * c).sum() / 6.0)

    @property
    def volume(self) -> float:
        """Enclosed volume of a closed surface, m³; 0 of an open one."""
        return self.enclosed * self.scale**3

    @property
    def particle_count(self) -> int:
        """Number of particles, N."""
        return len(self.weights)

    @property
    def surface_count(self) -> int:
        """Number of particles at the surface, n: the first ones."""
        return len(self.surface.vertices)

    @property
    def particles(self) -> np.ndarray:
        """(N, 3) float: the particles in the body's own frame, m."""
        return np.concatenate([self.surface.vertices, self.inner])

    def inner_following(self, positions: np.ndarray) -> np.ndarray:
        """
        Return inner particles (3, k) as they follow the surface (3, n): by the best affine fit.

        By area. Of velocities of the surface, it returns those of the inner particles.
        """
        count = self.surface_count
        affine = np.concatenate([np.ones((1, self.particle_count)), self.q])
        weighted = affine[:, :count] * self.areas
        share = np.linalg.solve(weighted @ affine[:, :count].T, affine[:, count:])
        return np.asarray(positions @ (weighted.T @ share))

    def record(self) -> np.ndarray:
        """Return the constants as a SHAPE record, (); its indices into arrays are not set."""
        record = np.zeros((), SHAPE)
        record['count'] = self.particle_count
        record['scale'], record['centre'] = self.scale, self.centre
        record['enclosed'] = self.enclosed
        record['has_volume'] = self.has_volume
        record['spanned_linear'] = not self.unspanned_linear.any()
        record['spanned_quadratic'] = not self.unspanned_quadratic.any()
        record['feature_means'], record['gram'] = self.feature_means, self.gram
        record['feature_rounding'] = self.feature_rounding
        record['weight_rounding'] = self.weight_rounding
        record['bend_gram'] = self.bend_gram
        record['inverse_linear'] = self.inverse_linear
        record['inverse_quadratic'] = self.inverse_quadratic
        record['unspanned_linear'] = self.unspanned_linear
        record['unspanned_quadratic'] = self.unspanned_quadratic
        record['whitening_linear'] = self.whitening_linear
        record['whitening_quadratic'] = self.whitening_quadratic
        record['volume_linear'] = self.volume_form[:LINEAR, :LINEAR, :LINEAR]
        record['volume_quadratic'] = self.volume_form
        return record


def make_rest_shape(
    surface: Surface, weights: np.ndarray | None = None, inner: np.ndarray | None = None
) -> RestShape:
    """
    Return the constants of a surface.

    Parameters
    ----------
    surface : Surface
    weights : (N,) float, optional
        that sum to 1; by default each vertex has its share of the area
    inner : (k, 3) float, optional
        inner particles, the last k of N, in the body's own frame, m

    Raises
    ------
    MeshError
        if all vertices coincide.

    """
    around = _areas_around(surface)
    area_weights = _shares_of(around)
    scale = _rms_radius(surface, area_weights)
    weights = area_weights if weights is None else weights
    inner = np.zeros((0, 3)) if inner is None else inner
    particles = np.concatenate([surface.vertices, inner])
    centre = weighted_mean(particles, weights)
    q = np.ascontiguousarray((particles - centre).T / scale)
    q -= weighted_mean(q.T, weights)[:, None]
    features = _products(q)[1:]
    means = np.zeros(QUADRATIC)
    means[LINEAR:] = (features[LINEAR:] * weights).sum(axis=1)
    features -= means[:, None]
    gram = np.empty((QUADRATIC, QUADRATIC))
    for row in range(QUADRATIC):
        weighted = features[row] * weights
        for column in range(row, QUADRATIC):
            gram[row, column] = gram[column, row] = (weighted * features[column]).sum()
    inverse_linear, unspanned_linear = pseudo_inverse(gram[:LINEAR, :LINEAR])
    inverse_quadratic, unspanned_quadratic = pseudo_inverse(gram)
    return RestShape(
        surface=surface,
        centre=centre,
        scale=scale,
        areas=around / 6.0,
        inner=inner,
        weights=weights,
        q=q,
        feature_means=means,
        feature_rounding=np.array([fsum((weights * f).tolist()) for f in features]),
        weight_rounding=fsum([-1.0, *weights.tolist()]),
        gram=gram,
        bend_gram=_bend_gram(surface.faces, q),
        inverse_linear=inverse_linear,
        inverse_quadratic=inverse_quadratic,
        unspanned_linear=unspanned_linear,
        unspanned_quadratic=unspanned_quadratic,
        whitening_linear=whitening(gram[:LINEAR, :LINEAR]),
        whitening_quadratic=whitening(gram),
        volume_form=_volume_form(surface, features),
    )


def make_solid_rest_shape(surface: Surface) -> RestShape:
    """
    Return the constants of a surface whose mass is spread over the volume that it encloses.

    See `solid`.

    Raises
    ------
    MeshError
        if it encloses none.

    """
    shares = area_shares(surface)
    inside = fill(surface, shares, _rms_radius(surface, shares))
    weights = np.concatenate([inside.surface, inside.weights])
    return make_rest_shape(surface, weights, inside.points)


def _rms_radius(surface: Surface, shares: np.ndarray) -> float:
    """Return the RMS distance of the vertices from their centre, m, given shares of the area."""
    spread = surface.vertices - weighted_mean(surface.vertices, shares)
    scale = float(np.sqrt((np.einsum('ij,ij->i', spread, spread) * shares).sum()))
    if not scale > 0.0:
        raise MeshError('all vertices of the surface coincide: a body needs some extent')
    return scale


def weighted_mean(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return Σ w p (3,) of points (n, 3), by pairwise sums that do not depend on threads."""
    return np.array([(axis * weights).sum() for axis in np.ascontiguousarray(points.T)])


def pseudo_inverse(gram: np.ndarray, cut: float = RANK_CUT) -> tuple[np.ndarray, np.ndarray]:
    """Return the pseudo-inverse of a symmetric matrix and the projection on its null space."""
    values, vectors = np.linalg.eigh(gram)
    spanned = values > cut * values[-1]
    basis = vectors[:, spanned]
    inverse = (basis / values[spanned]) @ basis.T
    null = vectors[:, ~spanned]
    return inverse, null @ null.T


def whitening(gram: np.ndarray, cut: float = RANK_CUT) -> np.ndarray:
    """Return W with W G Wᵀ = 1 for a symmetric matrix G; rows of its null space are zeros."""
    values, vectors = np.linalg.eigh(gram)
    spanned = values > cut * values[-1]
    return np.where(spanned, vectors, 0.0).T / np.sqrt(np.where(spanned, values, 1.0))[:, None]


def _products(q: np.ndarray) -> np.ndarray:
    """Return (10, n) float: 1, q and the products of its coordinates."""
    x, y, z = q
    return np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])


def area_shares(surface: Surface) -> np.ndarray:
    """Return the share (n,) of the area that each vertex has; they sum to 1."""
    return _shares_of(_areas_around(surface))


def _areas_around(surface: Surface) -> np.ndarray:
    """Return twice the area of the triangles at each vertex, m²."""
    a, b, c = surface.vertices[surface.faces.T]
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    count = len(surface.vertices)
    return np.bincount(surface.faces.ravel(), np.repeat(doubled, 3), minlength=count)


def _shares_of(areas: np.ndarray) -> np.ndarray:
    """Return the area share of each vertex, for results independent of the tessellation."""
    total = areas.sum()
    return areas / total if total > 0.0 else np.full(len(areas), 1 / len(areas))


def _volume_form(surface: Surface, features: np.ndarray) -> np.ndarray:
    """
    Return the coefficients of the volume as a cubic form (divergence theorem).

    6 V = Σ_faces det(g_a g_b g_c) with g = T f is Σᵢⱼₖ det(Tᵢ Tⱼ Tₖ) Σ_faces f_aᵢ f_bⱼ f_cₖ.
    """
    moments = np.zeros((QUADRATIC,) * 3)
    if surface.closed:
        for start in range(0, len(surface.faces), FACE_BLOCK):
            a, b, c = (features[:, corner] for corner in surface.faces[start:][:FACE_BLOCK].T)
            for i in range(QUADRATIC):
                for j in range(QUADRATIC):
                    moments[i, j] += (a[i] * b[j] * c).sum(axis=1)
    form = _antisymmetric(moments)
    if not surface.closed or form[0, 1, 2] < RANK_CUT:
        moments[:] = 0.0
        moments[0, 1, 2] = 1.0
        form = _antisymmetric(moments)
    return form / form[0, 1, 2]


def _bend_gram(faces: np.ndarray, q: np.ndarray) -> np.ndarray:
    """
    Return the mean of ∇f ∇fᵀ over the surface, see `RestShape`.

    Of f as linear on each face between its values at the corners: on a ball x² + y² + z² does not
    change, however coarse the mesh.
    """
    total, area = np.zeros((QUADRATIC - LINEAR,) * 2), 0.0
    products = _products(q)[1 + LINEAR :]
    for start in range(0, len(faces), FACE_BLOCK):
        a, b, c = faces[start:][:FACE_BLOCK].T
        along, aside = q[:, b] - q[:, a], q[:, c] - q[:, a]
        one, two, both = (
            (along * along).sum(axis=0),
            (aside * aside).sum(axis=0),
            (along * aside).sum(axis=0),
        )
        double = np.sqrt(np.maximum(one * two - both * both, 0.0))
        per_area = 1.0 / np.where(double > RANK_CUT * (one + two), double, np.inf)
        first, second = products[:, b] - products[:, a], products[:, c] - products[:, a]
        # the inverse of the metric of each face
        conjugate = (
            (two * first - both * second) * per_area,
            (one * second - both * first) * per_area,
        )
        for i in range(len(total)):
            for j in range(len(total)):
                total[i, j] += (conjugate[0][i] * first[j] + conjugate[1][i] * second[j]).sum()
        area += double.sum()
    return total / (BALL * area) if area > 0.0 else np.eye(len(total))


def _antisymmetric(moments: np.ndarray) -> np.ndarray:
    total = np.zeros_like(moments)
    for order in permutations(range(3)):
        sign = round(np.linalg.det(np.eye(3)[list(order)]))
        total += sign * moments.transpose(order)
    return total
