# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How well each parameter is known: standard deviations, and what cannot be told apart.

The covariance is that of an M-estimator, ⟨ψ²⟩ / ⟨ψ'⟩² (Jᵀ J)⁻¹ with the derivative ψ of the loss
and the residuals that there are; of least squares it would be σ² (Jᵀ J)⁻¹. It takes the errors of
points as independent, and the scene as right in all else.

References
----------
P. J. Huber, Robust Regression: Asymptotics, Conjectures and Monte Carlo, The Annals of Statistics
1 (5), 1973.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softbody_ros.ensemble.fit_parameters import Unknown
from softbody_ros.ensemble.fit_search import POOR, ROBUST, Solution

VAGUE = 0.15
"""Standard deviation, as a share of the bounds, from which on a parameter is not determined."""
DEPENDENT = 1e-3
"""Singular value of the Jacobian with columns of length 1 up to which some depend on others."""
PARTNER = 0.3
"""Component of a singular vector from which on a parameter takes part in it."""
AT_BOUND = 2e-3
"""Share of the bounds."""
SIMPLE = 0.1
"""How far a ratio of relative changes may be from 1 for a product or a quotient."""
OUTLIER = 5.0
"""Residual, in units of the noise, from which on a point is an outlier."""


@dataclass(frozen=True)
class Estimate:
    """A value, its standard deviation, None if it is not determined, and what is to be said."""

    unknown: Unknown
    value: float
    deviation: float | None
    note: str = ''


@dataclass(frozen=True)
class Verdict:
    """
    What a fit is worth.

    Attributes
    ----------
    estimates : list of Estimate
    warnings : list of str
        sentences about what is not determined, at a bound, or poorly reproduced
    rms : float
        of the residuals, in units of the noise
    coordinates : (p,) float
        of the values

    """

    estimates: list[Estimate]
    warnings: list[str]
    rms: float
    coordinates: np.ndarray


def judge(unknowns: Sequence[Unknown], solution: Solution, noise: float) -> Verdict:
    """Return how well each unknown is known; noise in m."""
    residuals, place = solution.residuals, solution.coordinates.copy()
    rms = float(np.sqrt(np.mean(residuals**2)))
    freedom = max(len(residuals) - len(unknowns), 1)
    weights = 1.0 / (1.0 + (residuals / ROBUST) ** 2)
    spread = float(np.sqrt((weights * residuals**2).sum() / freedom) / np.mean(weights**1.5))
    lengths = np.linalg.norm(solution.jacobian, axis=0)
    # a film without noise determines nothing that a real observation would not
    information = lengths / max(spread, 1.0)
    active = [k for k, each in enumerate(information) if each * VAGUE > 1.0]
    notes = ['' if k in active else 'no effect' for k in range(len(unknowns))]
    warnings = []
    for k, unknown in enumerate(unknowns):
        if np.isnan(lengths[k]):
            notes[k] = 'not determined: runs beside it fail'
            warnings.append(f'{unknown.name} is {notes[k]}')
        elif notes[k]:
            # as the scene has it, rather than anything
            place[k] = np.clip(unknown.coordinate(unknown.start), 0.0, 1.0)
            warnings.append(f'{unknown.name} has no effect on this observation: it is left alone')
    values, vectors = _directions(solution.jacobian[:, active] / lengths[active])
    vague = {k for k in range(len(unknowns)) if k not in active}
    for value, vector in zip(values, vectors, strict=True):
        spreads = np.abs(vector) / (value * information[active])
        if value < DEPENDENT or spreads.max(initial=0.0) > VAGUE:
            partners = {k: part for k, part in zip(active, vector, strict=True)
                        if abs(part) > PARTNER}  # fmt: skip
            changes = {k: part / information[k] for k, part in partners.items()}
            warnings.append(_together(unknowns, place, changes, notes))
            vague |= set(partners)
    inverse = np.linalg.norm(vectors.T / values, axis=1) / lengths[active]
    deviations = {
        k: float(spread * each * unknowns[k].slope(place[k]))
        for k, each in zip(active, inverse, strict=True)
        if k not in vague
    }
    for k, unknown in enumerate(unknowns):
        if not notes[k] and (note := _bound(unknown, place[k])):
            notes[k] = note
            warnings.append(f'{unknown.name} is {note}: widen its bounds if it can be')
    estimates = [
        Estimate(unknown, unknown.value(place[k]), deviations.get(k), notes[k])
        for k, unknown in enumerate(unknowns)
    ]
    return Verdict(estimates, warnings + _poor(residuals, rms, noise), rms, place)


def _directions(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the singular values (p,) of a Jacobian (n, p), above 0, and directions (p, p)."""
    _, values, vectors = np.linalg.svd(jacobian, full_matrices=False)
    return np.maximum(values, np.finfo(float).tiny), vectors


def _together(
    unknowns: Sequence[Unknown], place: np.ndarray, changes: dict[int, float], notes: list[str]
) -> str:
    """
    Note which parameters change without an effect; return the sentence.

    Parameters
    ----------
    unknowns : sequence of Unknown
    place : (p,) float
        coordinates
    changes : dict
        by how much the coordinates of parameters change together, at any scale
    notes : list of str
        of each unknown

    """
    names = [unknowns[k].name for k in changes]
    for k in changes:
        others = [name for name in names if name != unknowns[k].name]
        notes[k] = f'not apart from {", ".join(others)}' if others else 'not determined'
    if len(names) == 1:
        return f'{names[0]} is not determined: this observation hardly depends on it'
    known = 'a combination of them'
    relative = [
        change * unknowns[k].slope(place[k]) / value
        for k, change in changes.items()
        if (value := unknowns[k].value(place[k])) and change
    ]
    if len(names) == len(relative) == 2:
        ratio = relative[0] / relative[1]
        if abs(ratio + 1.0) < SIMPLE:
            known = f'{names[0]} × {names[1]}'
        elif abs(ratio - 1.0) < SIMPLE:
            known = f'{names[0]} / {names[1]}'
    return (
        f'{" and ".join(names)} cannot be told apart: only {known} is determined; set all but '
        'one of them, or observe more'
    )


def _bound(unknown: Unknown, coordinate: float) -> str:
    if coordinate < AT_BOUND:
        return f'at its lower bound {unknown.low:g}'
    return f'at its upper bound {unknown.high:g}' if coordinate > 1.0 - AT_BOUND else ''


def _poor(residuals: np.ndarray, rms: float, noise: float) -> list[str]:
    if rms < POOR:
        return []
    far = float(np.mean(np.abs(residuals) > OUTLIER))
    size = f'{1e3 * rms * noise:.3g} mm RMS, for a noise of {1e3 * noise:.3g} mm (--noise)'
    if np.median(np.abs(residuals)) < 1.0:
        return [
            f'{100.0 * far:.0f} % of the points are outliers, which count little: the residual is '
            f'{size}; are there things in the observation that the scene lacks?'
        ]
    return [
        f'the fit is poor: the residual is {size}; the scene differs from what was observed in '
        'more than these parameters, such as the start, the time offset or the mesh'
    ]
