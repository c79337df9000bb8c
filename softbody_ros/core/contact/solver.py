# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Solve the contact problem of an island, see `problem`.

Gauss–Seidel sweeps come first, for bodies of many modes as long as they converge fast; often they
suffice. Most of them go over the contacts that act, and some over all, so that those that may act
but do not cost little. Then Newton's method, of a model for which the radii μ (f⁰ₙ + fₙ) of the
friction discs are those of the last iterate, so that in the limit the law of Coulomb holds
exactly. If it omits something, conjugate gradients and sweeps follow each time, which solve that.
The numbers of all are bounded, and so is the time; how far the result is from a solution is
returned.

A problem may have no solution: where a contact that holds against sliding presses itself on, as of
a door on a wedge (Painlevé), forces would grow without bound from disc to disc. Where the result
is far from a solution, Coulomb friction is that of the normal forces without friction: a problem
that has a solution, of bounded forces.

Where contacts of each of two bodies are with faces of the other, nearly the same contact is there
twice, and W nearly singular. A compliance of about a tenth of the particles' own response makes
such problems easy; with b = b − c f at the start f, it acts on the change of the force only
(the proximal point method), and in rest not at all.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.newton import INNER, descend, majorise, minimise
from softbody_ros.core.contact.problem import (
    RIGID_MODES,
    Problem,
    add_modes,
    add_particles,
    any_mobile,
    find_diagonals,
    line_of,
    normal_particle_response,
    normal_response,
    on_disc,
    own_mobility,
    radius_for,
    relaxed,
    response_of,
    slip_of,
    sum_forces,
    width_of,
)
from softbody_ros.core.geometry.vectors import ZERO, Vector, put_vector, vector_of

SWEEPS, ENOUGH_SWEEPS, MOST_SWEEPS = 4, 20, 200
"""From how many sweeps the speed of convergence is found; and how many more sweeps cost what
Newton's method does for one body, with all that follows it (of more bodies by the square of their
number): if it seems to take no more, they go on. And the most of them."""
FIRST_SWEEPS, FEW_ACT = 2, 0.75
"""Sweeps over all contacts at first, before those over the contacts that act; and the share of
these up to which others are left out."""
FEW_MODES, FEW_BODIES = 6, 4
"""Of bodies, and bodies of so few modes, up to which Newton's method costs little more than SWEEPS
sweeps."""
LARGE_SWEEPS, LARGE_SWEEPS_FEW, ROUGH_SWEEPS, SHARED_SWEEPS = 40, 30, 10, 3
"""Most sweeps of islands that are too large for Newton's method, the same of bodies with few
modes, of what will be solved again, and those after each model."""
LARGEST_ISLAND = 180
"""Modes of all bodies of an island up to which Newton's equations are factorised."""
OUTER, STEPS = 60, 400
"""Most updates of the friction discs, and Newton steps for one problem."""
EXTRAPOLATED, ALTERNATING = 0.05, -0.5
"""Ratio of changes of the discs, and distance from 1, from which on they are extrapolated; and the
ratio of changes that alternate, up to which they are."""
STUBBORN = 5
"""Updates after which sweeps follow in any case: where normal forces and friction depend on each
other strongly, updates by themselves would alternate. Not where viscous friction changes with the
contacts that act, which sweeps would not end."""
LONG, PATIENCE = 120, 8
"""Newton steps after which models are not minimised any more that do not get on for so many."""
SETTLED = 8
"""Updates after which viscous friction is that of the contacts that press then, and ends where one
ceases to."""
LAST = 10
"""Updates before the last one, from which on there is no viscous friction, if there is still no
solution."""
FAR, MODELS = 1e6, 4
"""Residual, relative to the tolerance, from which on friction is that of the normal forces without
friction; and how many models are minimised for that where they omit something."""
DIVERGING = 10.0
"""Ratio of residuals of sweeps, the last one to the least, from which on they diverge, if they are
far as well: then none of them is taken."""
PRECISION = 0.03
"""Displacement by the gradient, relative to the tolerance, at which Newton's method ends."""


@helper
def solve(
    problem: Problem,
    tolerance: float,
    mass: float,
    most_steps: int,
    is_narrow: bool,
    is_rough: bool,
) -> tuple[float, int, int]:
    """
    Solve the contact problem of one island.

    Parameters
    ----------
    problem : Problem
        forces are written
    tolerance : float
        of s
    mass : float
        of the lightest body, kg
    most_steps : int
        of Newton's method, up to those of the last model
    is_narrow : bool
        whether there may be no solution, as obstacles may leave no room: if so, models that do not
        get on are left, and friction is bounded
    is_rough : bool
        whether a few sweeps of a large island will do, as it is solved again after that

    Returns
    -------
    residual : float
        largest change of s by a projection of one row
    sweeps, steps : int
        of Gauss–Seidel; of Newton's method and of conjugate gradients

    """
    rows = problem.rows
    are_few = find_diagonals(problem) <= FEW_MODES
    is_viscous = distribute_viscous_friction(problem)
    sum_forces(problem)
    is_large = len(problem.counts) > len(problem.filled)
    is_small = are_few and len(problem.counts) <= FEW_BODIES
    limit, enough = MOST_SWEEPS, ENOUGH_SWEEPS * len(problem.counts) ** 2
    if is_large:
        limit = LARGE_SWEEPS_FEW if are_few else LARGE_SWEEPS
        limit = ROUGH_SWEEPS if is_rough else limit
    residual, before, first, sweeps = math.inf, math.inf, math.inf, 0
    keep(rows)
    period = 2 * SWEEPS if is_large else SWEEPS
    every, acting, count, over_all = np.arange(len(rows)), np.empty(len(rows), np.int64), 0, True
    while sweeps < limit:
        residual, is_other_patch = sweep(problem, every if over_all else acting[:count])
        sweeps += 1
        first = min(first, residual)
        if is_viscous and is_other_patch:
            distribute_viscous_friction(problem)
        if residual <= tolerance:
            if over_all:
                return residual, sweeps, 0
            over_all = True
            continue
        if over_all:
            count = find_acting(rows, acting)
        is_worth_while = count <= FEW_ACT * len(rows)
        # the last one, too, as what is not solved is to be known
        over_all = (
            sweeps < FIRST_SWEEPS
            or sweeps % period == 0
            or sweeps == limit - 1
            or not is_worth_while
        )
        if is_small and sweeps == SWEEPS:
            break
        if sweeps % SWEEPS == 1:
            if not is_large and sweeps_ahead(before, residual, tolerance) > enough:
                break
            before = residual
    diverges = not residual < max(DIVERGING * first, FAR * tolerance)
    if diverges:
        restore(problem)
    if is_large:
        return residual, sweeps, 0
    for k in range(len(rows)):
        # of the problem before, or of another: nothing to extrapolate
        rows[k]['radius'] = radius_for(rows[k], rows[k]['force'][0])
        rows[k]['disc_change'] = 0.0
    best = imbalance(problem)
    keep(rows)
    take_discs(problem, best > tolerance)
    newton, conjugate, most = 0, 0, most_steps
    least = (PRECISION * tolerance) * (PRECISION * tolerance) * mass
    points = len(problem.mobility)
    load, vectors = np.empty(points), np.empty((5, len(rows) if points > 0 else 0, 3))
    for update in range(OUTER):
        is_shared = majorise(problem, load)
        newton += minimise(problem, least, PATIENCE if is_narrow and newton >= LONG else INNER)
        if is_shared:
            conjugate += descend(problem, vectors)
        if (is_shared or (update >= STUBBORN and not is_viscous)) and not diverges:
            for _ in range(SHARED_SWEEPS):
                sweep(problem, every)
            sweeps += SHARED_SWEEPS
        residual = imbalance(problem)
        if residual < best:
            best = residual
            keep(rows)
        take_discs(problem, residual > tolerance)
        if is_viscous and update <= SETTLED:
            distribute_viscous_friction(problem)
            if update == SETTLED:
                settle_viscous_friction(rows)
        elif is_viscous and release_viscous_friction(rows):
            residual = best = math.inf
        if residual <= tolerance:
            break
        if is_viscous and (newton >= most or update == OUTER - LAST):
            omit_viscous_friction(rows)
            is_viscous, best, most = False, math.inf, newton + most_steps
        elif newton >= most:
            break
    if residual > tolerance:
        # what Newton's method ends at without a solution may be far from all that is possible
        residual = best
        restore(problem)
    if is_narrow and residual > FAR * tolerance and not is_viscous:
        more, conjugate_more = bound_friction(problem, least, load, vectors)
        newton, conjugate = newton + more, conjugate + conjugate_more
        residual = imbalance(problem)
    return residual, sweeps, newton + conjugate


@helper
def bound_friction(
    problem: Problem, least: float, load: np.ndarray, vectors: np.ndarray
) -> tuple[int, int]:
    """
    Solve the problem with the friction discs of the normal forces that it has without friction.

    Parameters
    ----------
    problem : Problem
    least : float
        see `minimise`
    load, vectors
        see `majorise`, `descend`

    Returns
    -------
    newton, conjugate : int
        steps

    """
    rows, newton, conjugate = problem.rows, 0, 0
    for has_friction in range(2):
        for k in range(len(rows)):
            row = rows[k]
            row['radius'] = 0.0
            if has_friction == 1 or row['friction'] == math.inf:
                row['radius'] = radius_for(row, row['force'][0])
        project_on_discs(problem)
        for _ in range(MODELS):
            is_shared = majorise(problem, load)
            newton += minimise(problem, least, PATIENCE)
            if not is_shared:
                break
            conjugate += descend(problem, vectors)
    return newton, conjugate


@helper
def sweeps_ahead(before: float, residual: float, tolerance: float) -> float:
    """Return how many more sweeps it takes if each SWEEPS do as much as the last ones."""
    if before == math.inf:
        return 0.0
    if residual >= before:
        return math.inf
    return SWEEPS * math.log(residual / tolerance) / math.log(before / residual)


@helper
def keep(rows: np.ndarray) -> None:
    """Keep the present forces."""
    for k in range(len(rows)):
        put_vector(rows[k]['best'], vector_of(rows[k]['force']))


@helper
def restore(problem: Problem) -> None:
    """Take the forces that were kept."""
    rows = problem.rows
    for k in range(len(rows)):
        put_vector(rows[k]['force'], vector_of(rows[k]['best']))
    sum_forces(problem)


@helper
def sweep(problem: Problem, order: np.ndarray) -> tuple[float, bool]:
    """
    Project each force once, one after the other.

    Parameters
    ----------
    problem : Problem
    order : (j,) int
        of which rows

    Returns
    -------
    residual : float
        largest change of s
    is_other_patch : bool
        whether a contact begins or ceases to act

    """
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    mobility, y, shifts = problem.mobility, problem.modes[0], problem.shifts[0]
    is_mobile, residual, is_other_patch = any_mobile(problem), 0.0, False
    for k in order:
        row = rows[k]
        if is_idle(row):
            # mostly it stays so, which takes a third of the work to see
            apart = normal_response(row, jacobian, k, counts, y)
            if is_mobile:
                apart += normal_particle_response(row, jacobian, k, counts, y, shifts)
            if row['bias'][0] + row['compliance'][0] * row['force'][0] + apart >= 0.0:
                continue
        motion = response_of(problem, k, is_mobile)
        change = relaxed(row, slip_of(row, motion))
        residual = max(residual, squared_change(row, change))
        if change != ZERO:
            add_modes(row, jacobian, k, counts, change, y)
            if is_mobile:
                add_particles(row, jacobian, k, counts, mobility, change, y, shifts)
            acted = acts(row)
            for axis in range(3):
                row['force'][axis] += change[axis]
            # exactly none, not next to none by rounding
            row['force'][0] = max(row['force'][0], -row['base'][0])
            is_other_patch = is_other_patch or acted != acts(row)
    return math.sqrt(residual), is_other_patch


@helper
def is_idle(row: np.void) -> bool:
    """Return whether a contact exerts no force, and could exert none without pressing."""
    base, force = row['base'], row['force']
    return (
        not acts(row)
        and row['friction'] < math.inf
        and base[1] + force[1] == 0.0
        and base[2] + force[2] == 0.0
    )


@helper
def find_acting(rows: np.ndarray, acting: np.ndarray) -> int:
    """Write the indices of the contacts that press (k,); return their number."""
    count = 0
    for k in range(len(rows)):
        if acts(rows[k]):
            acting[count] = k
            count += 1
    return count


@helper
def acts(row: np.void) -> bool:
    """Return whether a contact presses."""
    return row['base'][0] + row['force'][0] > 0.0


@helper
def squared_change(row: np.void, change: Vector) -> float:
    """Return the square of the change of s by a change of force: normal or tangents, if larger."""
    normal, tangent = change[0] * row['diagonal'][0], row['diagonal'][1]
    one, two = change[1] * tangent, change[2] * tangent
    return max(normal * normal, one * one + two * two)


@helper
def imbalance(problem: Problem) -> float:
    """Return the residual: the largest change of s by a projection of a row, from this state."""
    is_mobile, residual = any_mobile(problem), 0.0
    for k in range(len(problem.rows)):
        row, motion = problem.rows[k], response_of(problem, k, is_mobile)
        residual = max(residual, squared_change(row, relaxed(row, slip_of(row, motion))))
    return math.sqrt(residual)


@helper
def take_discs(problem: Problem, extrapolates: bool) -> None:
    """Take the friction discs of the present normal forces, or of those that they tend to."""
    update_discs(problem.rows, extrapolates)
    project_on_discs(problem)


@helper
def project_on_discs(problem: Problem) -> None:
    """Move the tangential forces into the friction discs."""
    rows = problem.rows
    for k in range(len(rows)):
        row = rows[k]
        base, force = row['base'], row['force']
        one, two = on_disc(base[1] + force[1], base[2] + force[2], row['radius'])
        force[1], force[2] = one - base[1], two - base[2]
    sum_forces(problem)


# --------------------------------------------------------------------------------------- friction
@helper
def update_discs(rows: np.ndarray, extrapolates: bool) -> None:
    """
    Take the radii of the present normal forces, or of those that they tend to.

    Their changes often shrink like a geometric series, or alternate: then its sum is taken at once
    (Aitken).
    """
    product = square = 0.0
    for k in range(len(rows)):
        row = rows[k]
        target = radius_for(row, row['force'][0])
        change = target - row['radius'] if target < math.inf and row['radius'] < math.inf else 0.0
        product += change * row['disc_change']
        square += row['disc_change'] * row['disc_change']
        row['radius'], row['disc_change'] = target, change
    ratio = product / square if square > 0.0 else 0.0
    shrinks = EXTRAPOLATED < ratio < 1.0 - EXTRAPOLATED
    if extrapolates and (shrinks or ratio < ALTERNATING):
        for k in range(len(rows)):
            row = rows[k]
            row['radius'] = max(row['radius'] + ratio / (1.0 - ratio) * row['disc_change'], 0.0)
            row['disc_change'] = 0.0


@helper
def distribute_viscous_friction(problem: Problem) -> bool:
    """
    Write the law of viscous friction as a compliance along the tangents; return if there is any.

    A patch, the contacts of the same two sides, loses the share φ of its sliding. A compliance of
    w (1 − φ) / φ does that, w the response to a force that is shared out by area; that of each
    contact is so many times more as its area is less than that of the patch.
    """
    rows, start, is_viscous = problem.rows, 0, False
    while start < len(rows):
        first, end = rows[start], start + 1
        while end < len(rows) and is_same_patch(first, rows[end]):
            end += 1
        if first['viscosity'] >= 0.0:
            distribute_over(problem, start, end)
            is_viscous = True
        start = end
    return is_viscous


@helper
def settle_viscous_friction(rows: np.ndarray) -> None:
    """
    Decide which contacts have viscous friction: those that press now.

    Each time that one begins or ceases to press, all of its friction would begin or cease at
    once, and so there may be no solution.
    """
    for k in range(len(rows)):
        row = rows[k]
        if row['viscosity'] > 0.0:
            row['rubs'] = acts(row)
            if not row['rubs']:
                row['friction'] = 0.0


@helper
def release_viscous_friction(rows: np.ndarray) -> bool:
    """Take the friction from contacts that had it, but do not press after all; return if any."""
    is_released = False
    for k in range(len(rows)):
        row = rows[k]
        if row['rubs'] and not acts(row):
            row['rubs'], row['friction'] = False, 0.0
            is_released = True
    return is_released


@helper
def omit_viscous_friction(rows: np.ndarray) -> None:
    """Take viscous friction from all contacts: without it there is a solution."""
    for k in range(len(rows)):
        if rows[k]['viscosity'] > 0.0:
            rows[k]['rubs'], rows[k]['friction'] = False, 0.0


@helper
def is_same_patch(one: np.void, two: np.void) -> bool:
    """Return whether contacts are between the same sides."""
    return (
        one['one'] == two['one']
        and one['two'] == two['two']
        and one['obstacle'] == two['obstacle']
        and (one['viscosity'] >= 0.0) == (two['viscosity'] >= 0.0)
    )


@helper
def distribute_over(problem: Problem, start: int, end: int) -> None:
    """Write the tangential laws of one patch."""
    rows = problem.rows
    acting = every = 0.0
    for k in range(start, end):
        every += 1.0 / rows[k]['softness']
        if acts(rows[k]):
            acting += 1.0 / rows[k]['softness']
    # at first nothing is known of the pressure
    is_first, area = acting == 0.0, every if acting == 0.0 else acting
    own = 0.0
    clear_side(problem, rows[start]['one'])
    clear_side(problem, rows[start]['two'])
    for k in range(start, end):
        if is_first or acts(rows[k]):
            share = 1.0 / (area * rows[k]['softness'])
            add_tangents(problem, k, share)
            own += share * share * own_mobility(rows[k], problem.mobility)
    one, two = squared_tangents(problem, rows[start]['one'], own, own)
    one, two = squared_tangents(problem, rows[start]['two'], one, two)
    for k in range(start, end):
        row, phi = rows[k], rows[k]['viscosity']
        row['rubs'] = False
        own = row['diagonal'][1] - row['compliance'][1]
        row['friction'], row['compliance'][1] = 0.0, row['compliance'][0]
        if phi > 0.0:
            row['friction'] = math.inf
            compliance = 0.5 * (one + two) * (1.0 - phi) / phi * area * row['softness']
            row['compliance'][1] = max(compliance, row['compliance'][0])
        row['diagonal'][1] = own + row['compliance'][1]
        for axis in range(2):
            row['bias'][1 + axis] = row['free'][axis] + (
                row['compliance'][1] * row['base'][1 + axis]
            )


@helper
def clear_side(problem: Problem, member: int) -> None:
    """Begin to add up what a body does by forces along both tangents of a patch."""
    if member >= 0:
        for mode in range(width_of(problem.counts[member]) + 1):
            problem.modes[1, member, mode] = problem.modes[2, member, mode] = 0.0


@helper
def add_tangents(problem: Problem, k: int, share: float) -> None:
    """Add the amplitudes of modes, and those of K, by forces along both tangents of one row."""
    row, jacobian, modes = problem.rows[k], problem.jacobian, problem.modes
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0:
            line, count = line_of(k, side), problem.counts[member]
            for mode in range(count):
                modes[1, member, mode] += share * jacobian[line + 1, mode]
                modes[2, member, mode] += share * jacobian[line + 2, mode]
            if count > RIGID_MODES:
                last = width_of(count)
                modes[1, member, last] += share * jacobian[line + 1, last]
                modes[2, member, last] += share * jacobian[line + 2, last]


@helper
def squared_tangents(problem: Problem, member: int, one: float, two: float) -> tuple[float, float]:
    """Return two sums with the squared amplitudes, less those of K, of a body."""
    if member >= 0:
        count, first, second = problem.counts[member], problem.modes[1], problem.modes[2]
        for mode in range(count):
            one += first[member, mode] * first[member, mode]
            two += second[member, mode] * second[member, mode]
        if count > RIGID_MODES:
            last = width_of(count)
            one -= first[member, last] * first[member, last]
            two -= second[member, last] * second[member, last]
    return one, two
