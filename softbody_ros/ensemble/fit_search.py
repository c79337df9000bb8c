# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The search for the parameters: differential evolution, then least squares from its best.

The time of an impact, and whether something slides or rolls, make many local minima, and contacts
make a motion piecewise smooth: derivatives are differences to one side, of both sides that in
which less changes, over steps that are large beside the pieces first, and become smaller. All is
in coordinates from 0 to 1 between the bounds, and in units of the noise. Nothing depends on how
many runs are made at a time.

References
----------
R. Storn and K. Price, Differential Evolution, Journal of Global Optimization 11 (4), 1997.
M. A. Branch, T. F. Coleman and Y. Li, A Subspace, Interior, and Conjugate Gradient Method for
Large-Scale Bound-Constrained Minimization Problems, SIAM Journal on Scientific Computing 21 (1),
1999.

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
import threading

import numpy as np
from scipy.optimize import OptimizeResult, differential_evolution, least_squares
from scipy.stats import qmc

from softbody_ros.core import SimulationError
from softbody_ros.ensemble.fit_problem import Outcome, Problem

COARSE = (1e-2,)
"""Step of the differences of the first descents, in coordinates."""
FINE = ((1e-3,), (1e-3, 3e-4, 1e-4))
"""Of the last ones: of several that is taken over which the motion does not jump."""
UNCERTAINTY = (3e-3, 1e-3, 3e-4, 1e-4)
"""Of those for the uncertainties: of several that which says least."""
ROBUST = 2.0
"""Residual, in units of the noise, from which on the loss grows slower than its square."""
POOR = 2.0
"""RMS of the residuals, in units of the noise, from which on a fit is poor."""
MEMBERS = 16
"""Of the population, for each parameter."""
GENERATIONS = 10
ATTEMPTS = 3
"""Most evolutions: another one, if the best fit is poor."""
STARTS, APART = 3, 0.1
"""Of descents, and how far they are from each other at least, in coordinates."""
EVALUATIONS = 40
"""Most in one descent."""

Evaluate = Callable[[Sequence[np.ndarray]], list[Outcome]]
"""Returns the outcomes at coordinates, in order; several threads call it at a time."""


@dataclass(frozen=True)
class Solution:
    """
    The best parameters.

    Attributes
    ----------
    coordinates : (p,) float
    jacobian : (n, p) float
        of the residuals by the coordinates, NaN where all runs beside the solution fail
    residuals : (n,) float
        in units of the noise
    runs, failures : int
        how many runs were made, and failed

    """

    coordinates: np.ndarray
    jacobian: np.ndarray
    residuals: np.ndarray
    runs: int
    failures: int


def cost(residuals: np.ndarray) -> float:
    """Return half the sum of the loss soft_l1 of residuals in units of the noise."""
    return float(ROBUST**2 * (np.sqrt(1.0 + (residuals / ROBUST) ** 2) - 1.0).sum())


def search(
    problem: Problem,
    evaluate: Evaluate,
    seed: int = 0,
    members: int = MEMBERS,
    generations: int = GENERATIONS,
) -> Solution:
    """
    Return the parameters with which the scene reproduces the observation best.

    Parameters
    ----------
    problem : Problem
    evaluate : callable
    seed : int
        of the population
    members, generations : int
        of the population for each parameter, and how often it is renewed

    Raises
    ------
    SimulationError
        if no run succeeds.

    """
    runs, random = _Runs(evaluate, len(problem.unknowns)), np.random.default_rng(seed)
    found: list[OptimizeResult] = []
    for _ in range(ATTEMPTS):
        starts = _starts(problem, runs, random, members, generations)
        with ThreadPoolExecutor(len(starts)) as threads:
            found += threads.map(lambda start: runs.descend(start, COARSE), starts)
        best = min(found, key=lambda result: cost(result.fun))
        if np.sqrt(np.mean(best.fun**2)) < POOR:
            break
    for steps in FINE:
        finer = runs.descend(best.x, steps)
        best = finer if cost(finer.fun) <= cost(best.fun) else best
    # columns of one step, or they would seem to differ; a jump would add information
    jacobian = min(
        (runs.jacobian(best.x, (step,)) for step in UNCERTAINTY),
        key=_information,
    )
    return Solution(best.x, jacobian, best.fun, runs.count, runs.failures)


def _information(jacobian: np.ndarray) -> tuple[int, float]:
    """Return in how many columns (n, p) all runs failed, and what the others say, to compare."""
    is_known = ~np.isnan(jacobian).any(axis=0)
    known = jacobian[:, is_known]
    return int(np.sum(~is_known)), float(np.linalg.slogdet(known.T @ known).logabsdet)


def _starts(
    problem: Problem,
    runs: _Runs,
    random: np.random.Generator,
    members: int,
    generations: int,
) -> list[np.ndarray]:
    """Return the best places of an evolution, apart from each other."""
    count = len(problem.unknowns)
    places = qmc.LatinHypercube(count, rng=random).random(members * count)
    own = np.array([unknown.coordinate(unknown.start) for unknown in problem.unknowns])
    if own.min() >= 0.0 and own.max() <= 1.0:
        places[0] = own
    result = differential_evolution(
        lambda columns: runs.costs(list(columns.T)),
        [(0.0, 1.0)] * count,
        init=places, maxiter=generations, tol=0.0, rng=random, polish=False,
        vectorized=True, updating='deferred',
    )  # fmt: skip
    if not np.isfinite(result.fun):
        raise SimulationError(
            f'none of {runs.count} runs within the bounds can be simulated: {runs.failure}'
        )
    starts: list[np.ndarray] = []
    for index in np.argsort(result.population_energies, kind='stable'):
        place = result.population[index]
        is_new = all(np.abs(place - other).max() > APART for other in starts)
        if np.isfinite(result.population_energies[index]) and is_new and len(starts) < STARTS:
            starts.append(place)
    return starts


class _Runs:
    """Makes runs, and counts them."""

    def __init__(self, evaluate: Evaluate, parameters: int) -> None:
        self._evaluate = evaluate
        self._parameters = parameters
        self._lock = threading.Lock()
        self.count = 0
        self.failures = 0
        self.failure = ''

    def outcomes(self, places: Sequence[np.ndarray]) -> list[Outcome]:
        outcomes = self._evaluate(places)
        failed = [outcome.failure for outcome in outcomes if outcome.residuals is None]
        with self._lock:
            self.count += len(outcomes)
            self.failures += len(failed)
            self.failure = self.failure or next(iter(failed), '')
        return outcomes

    def costs(self, places: Sequence[np.ndarray]) -> np.ndarray:
        """Return the loss at places; where a run fails it is infinite."""
        return np.array(
            [
                np.inf if outcome.residuals is None else cost(outcome.residuals)
                for outcome in self.outcomes(places)
            ]
        )

    def descend(self, start: np.ndarray, steps: Sequence[float]) -> OptimizeResult:
        """Return the least squares from a start, at which a run succeeds."""

        def residuals(place: np.ndarray) -> np.ndarray:
            outcome = self.outcomes([place])[0]
            # least_squares takes a smaller step where there is no number
            return np.full(size, np.inf) if outcome.residuals is None else outcome.residuals

        first = self.outcomes([start])[0].residuals
        assert first is not None
        size = len(first)
        return least_squares(
            residuals,
            start,
            # where all runs beside it fail, a parameter stays as it is
            jac=lambda place: np.nan_to_num(self.jacobian(place, steps)),
            bounds=(0.0, 1.0),
            loss='soft_l1',
            # far from the solution every point is an outlier, and has to count as none
            f_scale=max(ROBUST, float(np.median(np.abs(first)))),
            # what is not resolved is not worth a run
            xtol=min(steps) ** 2, ftol=min(steps) ** 2, max_nfev=EVALUATIONS,
        )  # fmt: skip

    def jacobian(self, place: np.ndarray, steps: Sequence[float]) -> np.ndarray:
        """
        Return differences (n, p), for each parameter over a step without a jump.

        They are NaN where all runs beside the place fail.
        """
        ends, widths = [], []
        for k in range(self._parameters):
            for width in (side * step for step in steps for side in (1.0, -1.0)):
                end = place.copy()
                end[k] = np.clip(place[k] + width, 0.0, 1.0)
                ends.append(end)
                # at a bound there is a side only
                widths.append(width if end[k] == place[k] + width else 0.0)
        here, *outcomes = (outcome.residuals for outcome in self.outcomes([place, *ends]))
        assert here is not None
        columns = []
        for k in range(self._parameters):
            rows = range(2 * len(steps) * k, 2 * len(steps) * (k + 1))
            differences = [
                (residuals - here) / widths[row]
                for row in rows
                if (residuals := outcomes[row]) is not None and widths[row]
            ]
            # a jump adds to the norm, the more the smaller the step
            least = min(differences, key=np.linalg.norm, default=np.full_like(here, np.nan))
            columns.append(least)
        return np.stack(columns, axis=1)
