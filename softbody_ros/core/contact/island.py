# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""An island of bodies in contact, as the solution of its contacts sees it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.problem import RIGID_MODES, Problem, width_of
from softbody_ros.core.contact.solver import FEW_BODIES, LARGEST_ISLAND, STEPS, solve
from softbody_ros.core.contact.working_set import Flight
from softbody_ros.core.contact.workspace import CORNERS, Workspace, jacobian_of
from softbody_ros.core.geometry.bvh import Trees
from softbody_ros.core.geometry.vectors import IDENTITY, ZERO, put_matrix, put_vector

SWEEPS, NEWTON, UNSOLVED = range(3)
"""Places in `Island.work`."""
MOST_STEPS, FEW_STEPS = 1000, 40
"""Newton steps for all problems of an island in a tick, and what each one has in any case: where
obstacles leave no room, many problems may have no solution. Of few rigid bodies, or with pins."""


class Island(NamedTuple):
    """Bodies in contact with each other, or one with obstacles, and what moves them."""

    members: np.ndarray
    """(m,) MEMBER"""
    particles: np.ndarray
    """(p,) PARTICLE: those at contacts, and room for more"""
    problem: Problem
    """with room for more contacts than take part at first"""
    rows: np.ndarray
    """(k,) ROW: the contacts of all islands"""
    waiting: np.ndarray
    """(w,) OPEN: contacts that wait, see `working_set`"""
    flight: Flight
    obstacles: np.ndarray
    """(o,) OBSTACLE"""
    trees: Trees
    h: float
    """s"""
    scale: float
    """smallest RMS radius of a body, m"""
    mass: float
    """of the lightest body, kg"""
    is_soft: bool
    """whether a body deforms"""
    is_held: bool
    """whether pins hold a body"""
    work: np.ndarray
    """(3,) int: sweeps, Newton steps, problems that are not solved to tolerance; of this tick"""


@helper
def make_island(
    members: np.ndarray,
    room: np.ndarray,
    rows: np.ndarray,
    waiting: np.ndarray,
    flight: Flight,
    obstacles: np.ndarray,
    trees: Trees,
    h: float,
    workspace: Workspace,
) -> Island:
    """Return an island of MEMBERs (m,) before its contacts act, with room (r,) ROW for these."""
    scale, mass, is_soft, is_held = members[0]['scale'], members[0]['mass'], False, False
    for member in members:
        scale, mass = min(scale, member['scale']), min(mass, member['mass'])
        is_soft, is_held = is_soft or member['is_soft'], is_held or member['has_pins']
        put_vector(member['shift'], ZERO)
        put_matrix(member['rotation'], IDENTITY)
        put_vector(member['received'][0], ZERO)
        put_vector(member['received'][1], ZERO)
    problem = new_problem(members, room, workspace)
    return Island(
        members, workspace.particles, problem, rows, waiting, flight, obstacles, trees, h, scale,
        mass, is_soft, is_held, np.zeros(3, np.int64),
    )  # fmt: skip


@helper
def new_problem(members: np.ndarray, rows: np.ndarray, workspace: Workspace) -> Problem:
    """Return room for the contact problem of an island."""
    count, most_touched = len(members), CORNERS * len(rows)
    counts, most, total_modes = np.empty(count, np.int64), RIGID_MODES, 0
    for number in range(count):
        counts[number] = RIGID_MODES + 3 * members[number]['features']
        most, total_modes = max(most, counts[number]), total_modes + counts[number]
    factorised = count if total_modes <= LARGEST_ISLAND else 0
    return Problem(
        rows,
        jacobian_of(workspace, 6 * len(rows), width_of(most) + 1),
        counts,
        np.empty(most_touched),
        np.zeros((3, count, width_of(most) + 1)),
        np.empty((2, 3, most_touched)),
        np.empty((factorised, factorised, most, most)),
        np.empty((factorised, factorised), np.bool_),
    )


@helper
def first_rows(problem: Problem, count: int, touched: int) -> Problem:
    """Return the problem of the first rows and particles."""
    return Problem(
        problem.rows[:count],
        problem.jacobian[: 6 * count],
        problem.counts,
        problem.mobility[:touched],
        problem.modes,
        problem.shifts,
        problem.hessian,
        problem.filled,
    )


@helper
def touched_particles(island: Island, problem: Problem) -> np.ndarray:
    """Return the particles (p,) PARTICLE at the contacts of a problem."""
    return island.particles[: len(problem.mobility)]


@helper
def is_large(island: Island) -> bool:
    """Return whether an island gets sweeps only: that it is not solved to tolerance is usual."""
    return len(island.problem.filled) < len(island.members)


@helper
def is_unsolved(island: Island) -> bool:
    """Return whether no solution was found where it usually is."""
    return island.work[UNSOLVED] > 0 and not is_large(island)


@helper
def solved(problem: Problem, tolerance: float, island: Island, is_rough: bool) -> float:
    """Solve a problem, see `solve`, and count what that takes; return the residual."""
    work = island.work
    # of heaps, what no solution is found for has room
    is_narrow = island.is_held or (not island.is_soft and len(island.members) <= FEW_BODIES)
    most = min(STEPS, max(MOST_STEPS - work[NEWTON], FEW_STEPS)) if is_narrow else STEPS
    residual, sweeps, steps = solve(problem, tolerance, island.mass, most, is_narrow, is_rough)
    work[SWEEPS], work[NEWTON] = work[SWEEPS] + sweeps, work[NEWTON] + steps
    work[UNSOLVED] += residual > tolerance and not is_rough
    return residual
