# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Permanent deformation: the rest shape itself flows when it is strained beyond its yield.

Müller, Heidelberger, Teschner, Gross 2005, section 4.5. The plastic state is a symmetric stretch
S_p of determinant 1 for each match, by which the rest shape is multiplied before it is rotated.
All functions work on stacks of matches.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.shape_matching.polar_decomposition import rotation
from softbody_ros.core.shape_matching.rest_shape import LINEAR

LEAST_GROWTH, LARGEST_GROWTH = 0.8, 1.2
"""Stretch that may become permanent in one tick."""


def undeformed(moment: np.ndarray, stretch: np.ndarray | None) -> np.ndarray:
    """
    Return the linear transforms of the goals without elastic deformation: R, or R S_p.

    Parameters
    ----------
    moment : (…, 3, F) float
        its first three columns are A_pq
    stretch : (…, 3, 3) float or None
        S_p, symmetric; None where nothing has ever become permanent

    Returns
    -------
    (…, 3, 3) float

    """
    if stretch is None:
        return rotation(moment)
    return rotation(moment[..., :LINEAR] @ stretch) @ stretch


def elastic(fits: np.ndarray, stretch: np.ndarray | None) -> np.ndarray:
    """Return the fits (…, 3, F) as seen from the permanently deformed shape: A S_p⁻¹."""
    if stretch is None:
        return fits
    result = fits.copy()
    result[..., :LINEAR] = fits[..., :LINEAR] @ np.linalg.inv(stretch)
    return result


def flowed(
    stretch: np.ndarray,
    strained: np.ndarray,
    yield_strain: np.ndarray,
    creeping: np.ndarray,
    largest_strain: np.ndarray,
) -> np.ndarray:
    """
    Return the plastic state after a tick: S_p ← [I + c (S − I)] S_p, its rotation left out.

    The strain S − I is that of the polar decomposition of the elastic fit, which is symmetric; the
    one of A_pq is not. An inverted shape does not flow.

    Parameters
    ----------
    stretch : (…, 3, 3) float
        S_p
    strained : (…, 3, F) float
        the elastic fits
    yield_strain, creeping, largest_strain : (…) float
        strain up to which nothing flows, share of the strain that flows in this tick, and largest
        permanent strain

    Returns
    -------
    (…, 3, 3) float
        symmetric, of determinant 1

    """
    _, sizes, axes = np.linalg.svd(strained[..., :LINEAR])
    flows = np.abs(sizes - 1.0).max(axis=-1) > yield_strain
    flows &= (np.linalg.det(strained[..., :LINEAR]) > 0.0) & (creeping > 0.0)
    if not flows.any():
        return stretch
    growth = np.clip(1.0 + creeping[..., None] * (sizes - 1.0), LEAST_GROWTH, LARGEST_GROWTH)
    _, sizes, axes = np.linalg.svd(_symmetric(growth, axes) @ stretch)
    # in logarithms neither the volume nor the limit disturbs the other
    logarithms = np.log(sizes)
    logarithms -= logarithms.mean(axis=-1, keepdims=True)
    limit = largest_strain[..., None]
    ends = np.where(logarithms > 0.0, np.log1p(limit), np.log1p(-limit))
    beyond = np.max(logarithms / np.where(ends != 0.0, ends, np.inf), axis=-1)
    beyond = np.where(largest_strain > 0.0, np.maximum(beyond, 1.0), np.inf)
    after = _symmetric(np.exp(logarithms / beyond[..., None]), axes)
    return np.where(flows[..., None, None], after, stretch)


def _symmetric(sizes: np.ndarray, axes: np.ndarray) -> np.ndarray:
    return (axes.swapaxes(-1, -2) * sizes[..., None, :]) @ axes


def strain(stretch: np.ndarray) -> float:
    """Return the largest permanent strain |σ − 1| among plastic states (…, 3, 3)."""
    return float(np.abs(np.linalg.eigvalsh(stretch) - 1.0).max())
