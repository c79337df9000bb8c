# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Impacts that go on from one rigid body to the next, as in Newton's cradle.

Solved at once with those that approach, a contact that is loaded by their impact does not rebound:
of a row of balls all would leave together. So first those that approach rebound, then those that
approach because of that, until none does: all of each time at once, so that no order matters.

Smith, Kaufman, Vouga, Tamstorf, Grinspun: Reflections on Simultaneous Impact, ACM Transactions on
Graphics 31, 2012.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.island import Island, solved
from softbody_ros.core.contact.problem import Problem, normal_response
from softbody_ros.core.contact.rows import copy_record
from softbody_ros.core.geometry.vectors import ZERO, put_vector

MOST_TIMES = 64
"""How often contacts rebound one after the other, at most."""
NEGLIGIBLE, FAR = 1e-3, 1e6
"""Speeds relative to the fastest impact: of approach up to which a contact does not rebound, and
that of parting which keeps a contact from taking part."""


@helper
def pass_on_impacts(island: Island, problem: Problem, slow: float, tolerance: float) -> None:
    """
    Let contacts leave each other with the speeds of impacts that go on from body to body.

    Where none goes on, speeds are those of the contacts' own impacts, as they were.

    Parameters
    ----------
    island : Island
        of rigid bodies
    problem : Problem
        of velocities; biases, approaches and elasticities are written
    slow : float
        speed of the fastest impact up to which nothing is passed on, m/s
    tolerance : float
        of speeds, m/s

    """
    rows, fastest = problem.rows, 0.0
    for row in rows:
        fastest = max(fastest, -row['approach'])
    if fastest <= slow:
        return
    impact, speeds, rebounds = begin_impacts(problem), np.empty(len(rows)), np.empty(len(rows))
    for k in range(len(rows)):
        speeds[k], rebounds[k] = rows[k]['approach'], 0.0
    times = 0
    while times < MOST_TIMES and begin_rebounds(impact.rows, speeds, fastest, rebounds):
        solved(impact, tolerance, island, False)
        for k in range(len(rows)):
            row = impact.rows[k]
            speeds[k] += normal_response(row, impact.jacobian, k, impact.counts, impact.modes[0])
        times += 1
    if times < 2:
        return
    for k in range(len(rows)):
        row = rows[k]
        # of contacts that did not rebound, none must be left with any speed
        speed = rebounds[k] * max(speeds[k], 0.0)
        row['bias'][0] -= row['elasticity'] * row['approach'] + speed
        row['approach'], row['elasticity'] = -speed, 1.0


@helper
def begin_impacts(problem: Problem) -> Problem:
    """Return a problem of impulses without friction, of the same contacts and bodies."""
    rows = np.empty(len(problem.rows), problem.rows.dtype)
    for k in range(len(rows)):
        copy_record(rows, k, problem.rows, k)
        row = rows[k]
        row['friction'], row['viscosity'], row['rubs'] = 0.0, -1.0, False
        put_vector(row['base'], ZERO)
        put_vector(row['bias'], ZERO)
    return Problem(
        rows, problem.jacobian, problem.counts, problem.mobility, problem.modes, problem.shifts,
        problem.hessian, problem.filled,
    )  # fmt: skip


@helper
def begin_rebounds(
    rows: np.ndarray, speeds: np.ndarray, fastest: float, rebounds: np.ndarray
) -> bool:
    """Let contacts that approach rebound, at once, and mark them by 1; return if any does."""
    found = False
    for k in range(len(rows)):
        row, speed = rows[k], speeds[k]
        put_vector(row['force'], ZERO)
        row['bias'][0] = FAR * fastest
        if speed < -NEGLIGIBLE * fastest:
            row['bias'][0] = (1.0 + row['elasticity']) * speed
            rebounds[k], found = 1.0, True
    return found
