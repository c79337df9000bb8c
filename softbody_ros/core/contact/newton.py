# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for contact, in the space of the modes, and conjugate gradients for what it omits.

With R = S g Sᵀ − K Kᵀ replaced by a diagonal D, at least R, each row is explicit for given
amplitudes y: its force is the point of its cone nearest to −(b + J y) / (c + D), b such that the
slip at the present force is right. What is left is to minimise a convex function of y, with a
continuous gradient y − Jᵀ f(y) and Hessian 1 + Jᵀ G J, G the derivatives of the projections: few
unknowns however many rows there are. Castro, Permenter, Han: An Unconstrained Convex Formulation
of Compliant Contact, arXiv:2110.10107; without its relaxation of Coulomb's law, as radii of
friction discs are given.

As D ≥ R the model is at least the objective, f · (b + (c + W) f / 2), and equal to it at the
present force: so each step decreases it (majorisation–minimisation). Where no particle is shared,
and K = 0, D = R, and the model is the problem.

Where particles are shared, as by contacts of each of two bodies with faces of the other, R is
close to singular, and the steps are small; so they may be with K. So conjugate gradients on the
true W follow, of the forces that may change: neither at 0 nor pressed against the edge of a disc.
The factorised Hessian preconditions them. Moré, Toraldo: On the solution of large quadratic
programming problems with bound constraints, SIAM J. Optim. 1991.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.problem import (
    RIGID_MODES,
    Problem,
    add_modes,
    add_particles,
    any_mobile,
    approach_targets,
    clear,
    line_of,
    mode_response,
    own_mobility,
    particle_response,
    projected,
    response_of,
    slip_of,
    squared,
    stiffer,
    sum_forces,
    take_targets,
)
from softbody_ros.core.geometry.block_systems import factorise, fill, substitute
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    dot,
    minus,
    plus,
    put_vector,
    scaled,
    vector_of,
)

EQUAL = 1e-9
"""Relative difference of D and R that is rounding."""
INNER = 40
"""Most Newton steps for one model."""
SEARCHES = 30
"""Most evaluations of a line search."""
ROUNDING = 1e-13
"""Gradient, relative to the amplitudes, that is rounding."""
FLAT = 0.05
"""Slope, relative to that at its start, at which a line search ends."""
LEAST_COMPLIANCE = 1e-6
"""Of the model, relative to the whole response of a row."""
CONJUGATE, REDUCTION = 20, 0.1
"""Most steps of conjugate gradients, and the reduction of their residual that suffices."""


@helper
def minimise(problem: Problem, least: float, patience: int) -> int:
    """
    Minimise the model for given friction discs, and move the forces to its minimum.

    Semismooth Newton with an exact line search, which converges from anywhere.

    Parameters
    ----------
    problem : Problem
        after `majorise`
    least : float
        square of the gradient that suffices
    patience : int
        steps after which the gradient is to be less

    Returns
    -------
    int
        number of Newton steps

    """
    y, gradient, step = problem.modes[0], problem.modes[1], problem.modes[2]
    steps, solved, smallest, stalled = 0, False, math.inf, 0
    for _ in range(INNER):
        size = evaluate(problem, y, gradient)
        if size <= max(least, ROUNDING * ROUNDING * squared(problem, y)):
            solved = True
            break
        stalled = 0 if size < smallest else stalled + 1
        if stalled == patience:
            # what is left may be rounding, as of large forces that all but cancel
            break
        smallest = min(smallest, size)
        assemble(problem)
        factorise(problem.counts, problem.hessian, problem.filled)
        for member in range(len(problem.counts)):
            for mode in range(problem.counts[member]):
                step[member, mode] = -gradient[member, mode]
        substitute(problem.counts, problem.hessian, problem.filled, step)
        steps += 1
        length = line_search(problem, y, gradient, step)
        if length == 0.0:
            break
        for member in range(len(problem.counts)):
            for mode in range(problem.counts[member]):
                y[member, mode] += length * step[member, mode]
    for k in range(len(problem.rows)):
        row = problem.rows[k]
        motion = mode_response(row, problem.jacobian, k, problem.counts, y)
        put_vector(row['target'], explicit(row, motion))
    if solved:
        take_targets(problem, 1.0)
    else:
        # no minimum: only as far as it is good
        sum_forces(problem)
        approach_targets(problem)
    return steps


# ----------------------------------------------------------------------------------------- model
@helper
def majorise(problem: Problem, load: np.ndarray) -> bool:
    """
    Write the model: with a diagonal D ≥ R in place of R, and the same slip at the present force.

    For the forces of contacts on a particle, |Σ aₖ fₖ|² ≤ Σ |aₖ| |fₖ|² Σ |aₗ|.

    Parameters
    ----------
    problem : Problem
    load : (p,) float
        scratch: sums of shares

    Returns
    -------
    bool
        whether D is more than R

    """
    rows, mobility, is_shared = problem.rows, problem.mobility, False
    jacobian, counts, y = problem.jacobian, problem.counts, problem.modes[0]
    is_mobile = any_mobile(problem)
    if is_mobile:
        sum_loads(problem, load)
    for k in range(len(rows)):
        row, force = rows[k], rows[k]['force']
        compliance, diagonal = row['compliance'], row['diagonal']
        model, bias = row['model_compliance'], row['model_bias']
        largest, shift = 0.0, ZERO
        if is_mobile:
            largest = majorant(row, mobility, load)
            is_shared |= largest > (1.0 + EQUAL) * own_mobility(row, mobility)
            is_shared |= is_stiffer(row, jacobian, k, counts)
            shift = particle_response(row, jacobian, k, counts, y, problem.shifts[0])
        model[0] = max(compliance[0] + largest, LEAST_COMPLIANCE * diagonal[0])
        model[1] = max(compliance[1] + largest, LEAST_COMPLIANCE * diagonal[1])
        for axis in range(3):
            which = 0 if axis == 0 else 1
            added = model[which] - compliance[which]
            bias[axis] = row['bias'][axis] + (shift[axis] - added * force[axis])
            if model[which] == 0.0:
                # nothing moves: the force remains
                bias[axis] = -force[axis]
        for which in range(2):
            model[which] = model[which] if model[which] > 0.0 else 1.0
    return is_shared


@helper
def sum_loads(problem: Problem, load: np.ndarray) -> None:
    """Write for each particle the sum of the shares of rows that may act."""
    rows = problem.rows
    for particle in range(len(load)):
        load[particle] = 0.0
    for k in range(len(rows)):
        row, motion = rows[k], response_of(problem, k, True)
        if row['base'][0] + row['force'][0] > 0.0 or slip_of(row, motion)[0] < 0.0:
            for corner in range(4):
                if row['shares'][corner] != 0.0:
                    load[row['particles'][corner]] += abs(row['shares'][corner])


@helper
def majorant(row: np.void, mobility: np.ndarray, load: np.ndarray) -> float:
    """Return D of one row."""
    largest = 0.0
    for corner in range(4):
        share = abs(row['shares'][corner])
        if share > 0.0:
            particle = row['particles'][corner]
            largest += mobility[particle] * share * max(load[particle], share)
    return largest


@helper
def is_stiffer(row: np.void, jacobian: np.ndarray, k: int, counts: np.ndarray) -> bool:
    """Return whether K of a row is not 0."""
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        is_soft = member >= 0 and counts[member] > RIGID_MODES
        if is_soft and stiffer(jacobian, line_of(k, side), counts[member]) != ZERO:
            return True
    return False


@helper
def explicit(row: np.void, motion: Vector) -> Vector:
    """Return the force of a row of the model for given J y."""
    bias, compliance = row['model_bias'], row['model_compliance']
    return projected(
        row,
        row['radius'],
        -(bias[0] + motion[0]) / compliance[0],
        -(bias[1] + motion[1]) / compliance[1],
        -(bias[2] + motion[2]) / compliance[1],
    )


@helper
def put_stiffness(row: np.void, motion: Vector) -> None:
    """Write G, minus the derivative of `explicit`."""
    base, bias, compliance = row['base'], row['model_bias'], row['model_compliance']
    g, tangent, radius = row['stiffness'], 1.0 / compliance[1], row['radius']
    g[0] = 1.0 / compliance[0] if -(bias[0] + motion[0]) / compliance[0] > -base[0] else 0.0
    g[1] = g[2] = g[3] = 0.0
    if radius > 0.0:
        one = base[1] - (bias[1] + motion[1]) * tangent
        two = base[2] - (bias[2] + motion[2]) * tangent
        size = math.sqrt(one * one + two * two)
        g[1] = g[3] = tangent
        if size > radius:
            one, two, tangent = one / size, two / size, tangent * (radius / size)
            g[1], g[2], g[3] = tangent * two * two, -tangent * one * two, tangent * one * one


@helper
def evaluate(problem: Problem, y: np.ndarray, gradient: np.ndarray) -> float:
    """Write the gradient y − Jᵀ f and the stiffnesses G; return the squared gradient."""
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    for member in range(len(counts)):
        for mode in range(counts[member]):
            gradient[member, mode] = y[member, mode]
    for k in range(len(rows)):
        row = rows[k]
        motion = mode_response(row, jacobian, k, counts, y)
        add_modes(row, jacobian, k, counts, scaled(-1.0, explicit(row, motion)), gradient)
        put_stiffness(row, motion)
    return squared(problem, gradient)


@helper
def assemble(problem: Problem) -> None:
    """Write the lower blocks of the Hessian 1 + Jᵀ G J."""
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    hessian, filled = problem.hessian, problem.filled
    for a in range(len(counts)):
        for b in range(a):
            filled[a, b] = False
        fill(a, a, counts, hessian, filled)
        for i in range(counts[a]):
            hessian[a, a, i, i] = 1.0
    for k in range(len(rows)):
        row = rows[k]
        g = (row['stiffness'][0], row['stiffness'][1], row['stiffness'][2], row['stiffness'][3])
        if g != (0.0, 0.0, 0.0, 0.0):
            one, two, line, other = row['one'], row['two'], line_of(k, 0), line_of(k, 1)
            add_block(hessian[one, one], counts[one], 0, jacobian, line, line, g)
            if two >= 0:
                add_block(hessian[two, two], counts[two], 0, jacobian, other, other, g)
                if one > two:
                    if not filled[one, two]:
                        fill(one, two, counts, hessian, filled)
                    add_block(
                        hessian[one, two], counts[one], counts[two], jacobian, line, other, g
                    )
                else:
                    if not filled[two, one]:
                        fill(two, one, counts, hessian, filled)
                    add_block(
                        hessian[two, one], counts[two], counts[one], jacobian, other, line, g
                    )


@helper
def add_block(
    block: np.ndarray,
    rows: int,
    columns: int,
    jacobian: np.ndarray,
    one: int,
    two: int,
    g: tuple[float, float, float, float],
) -> None:
    """Add Jᵀ G J of two sides of a row, from their first lines of J."""
    for i in range(rows):
        n, t, u = jacobian[one, i], jacobian[one + 1, i], jacobian[one + 2, i]
        n, t, u = g[0] * n, g[1] * t + g[2] * u, g[2] * t + g[3] * u
        for j in range(columns if columns > 0 else i + 1):
            added = n * jacobian[two, j] + t * jacobian[two + 1, j]
            block[i, j] += added + u * jacobian[two + 2, j]


@helper
def line_search(problem: Problem, y: np.ndarray, gradient: np.ndarray, step: np.ndarray) -> float:
    """
    Return the length at which the slope along a step vanishes, at most 1.

    The slope increases: bisection, with the secant where it lies in the bracket's inner part.
    """
    first = 0.0
    for member in range(len(problem.counts)):
        for mode in range(problem.counts[member]):
            first += gradient[member, mode] * step[member, mode]
    if not first < 0.0:
        return 0.0
    low, low_slope, high, high_slope = 0.0, first, 1.0, math.inf
    length = 1.0
    for _ in range(SEARCHES):
        slope = slope_at(problem, y, step, length)
        if abs(slope) <= -FLAT * first or (length == 1.0 and slope < 0.0):
            break
        if slope < 0.0:
            low, low_slope = length, slope
        else:
            high, high_slope = length, slope
        length = 0.5 * (low + high)
        if high_slope < math.inf:
            secant = (low * high_slope - high * low_slope) / (high_slope - low_slope)
            margin = 0.1 * (high - low)
            length = min(max(secant, low + margin), high - margin)
    return length


@helper
def slope_at(problem: Problem, y: np.ndarray, step: np.ndarray, length: float) -> float:
    """Return the derivative of the function along a step, at a length."""
    slope = 0.0
    for member in range(len(problem.counts)):
        for mode in range(problem.counts[member]):
            slope += step[member, mode] * (y[member, mode] + length * step[member, mode])
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    for k in range(len(rows)):
        row = rows[k]
        motion = mode_response(row, jacobian, k, counts, y)
        change = mode_response(row, jacobian, k, counts, step)
        slope -= dot(explicit(row, along(motion, length, change)), change)
    return slope


# --------------------------------------------------------------------------- conjugate gradients
@helper
def descend(problem: Problem, vectors: np.ndarray) -> int:
    """
    Minimise the objective over the forces that may change, and project the result.

    On the edge of a disc only the direction along it may change: there the force that presses
    against it adds the curvature of the edge.

    Parameters
    ----------
    problem : Problem
        after `majorise`
    vectors : (5, k, 3) float
        scratch

    Returns
    -------
    int
        number of steps

    """
    rows = problem.rows
    x, residual, ahead = vectors[0], vectors[1], vectors[2]
    direction, image = vectors[3], vectors[4]
    for k in range(len(rows)):
        row, slip = rows[k], slip_of(rows[k], response_of(problem, k, True))
        put_face(row, slip)
        put_vector(direction[k], ZERO)
        put_vector(residual[k], scaled(-1.0, through(row['face'], slip)))
        put_vector(x[k], ZERO)
    assemble(problem)
    factorise(problem.counts, problem.hessian, problem.filled)
    size = precondition(problem, residual, ahead)
    enough, ratio = REDUCTION * REDUCTION * size, 0.0
    steps = 0
    while steps < CONJUGATE and size > enough:
        steps += 1
        for k in range(len(rows)):
            put_vector(direction[k], along(vector_of(ahead[k]), ratio, vector_of(direction[k])))
        curvature = put_image(problem, direction, image)
        if not curvature > 0.0:
            break
        length = size / curvature
        for k in range(len(rows)):
            put_vector(x[k], along(vector_of(x[k]), length, vector_of(direction[k])))
            left = along(vector_of(residual[k]), -length, vector_of(image[k]))
            put_vector(residual[k], left)
        before = size
        size = precondition(problem, residual, ahead)
        ratio = size / before
    for k in range(len(rows)):
        row = rows[k]
        n, one, two = plus(vector_of(row['force']), vector_of(x[k]))
        put_vector(row['target'], projected(row, row['radius'], n, one, two))
    approach_targets(problem)
    return steps


@helper
def put_face(row: np.void, slip: Vector) -> None:
    """Write the projector on forces that may change, and G on them."""
    base, force, radius, face = row['base'], row['force'], row['radius'], row['face']
    model, g = row['model_compliance'], row['stiffness']
    face[0] = 1.0 if base[0] + force[0] > 0.0 and row['diagonal'][0] > 0.0 else 0.0
    face[1] = face[2] = face[3] = row['curvature'] = 0.0
    if radius > 0.0 and row['diagonal'][1] > 0.0:
        one, two = base[1] + force[1], base[2] + force[2]
        size = math.sqrt(one * one + two * two)
        face[1] = face[3] = 1.0
        if size >= (1.0 - 1e-9) * radius:
            one, two = one / size, two / size
            pressing = -(slip[1] * one + slip[2] * two)
            if pressing > 0.0:
                face[1], face[2], face[3] = two * two, -one * two, one * one
                row['curvature'] = pressing / radius
    g[0], tangent = face[0] / model[0], 1.0 / (model[1] + row['curvature'])
    for component in range(1, 4):
        g[component] = tangent * face[component]


@helper
def through(matrix: np.ndarray, a: Vector) -> Vector:
    """Return the product with a matrix of components nn, and 11, 12, 22 of the tangents."""
    return (
        matrix[0] * a[0],
        matrix[1] * a[1] + matrix[2] * a[2],
        matrix[2] * a[1] + matrix[3] * a[2],
    )


@helper
def put_image(problem: Problem, direction: np.ndarray, image: np.ndarray) -> float:
    """Write the product of W, restricted to forces that may change; return d · W d."""
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    mobility, y, shifts = problem.mobility, problem.modes[1], problem.shifts[1]
    clear(problem, y, shifts)
    for k in range(len(rows)):
        force = vector_of(direction[k])
        add_modes(rows[k], jacobian, k, counts, force, y)
        add_particles(rows[k], jacobian, k, counts, mobility, force, y, shifts)
    total = 0.0
    for k in range(len(rows)):
        row, d = rows[k], vector_of(direction[k])
        motion = mode_response(row, jacobian, k, counts, y)
        n, one, two = plus(motion, particle_response(row, jacobian, k, counts, y, shifts))
        compliance, edge = row['compliance'], row['compliance'][1] + row['curvature']
        result = (n + compliance[0] * d[0], one + edge * d[1], two + edge * d[2])
        put_vector(image[k], through(row['face'], result))
        total += dot(vector_of(image[k]), d)
    return total


@helper
def precondition(problem: Problem, residual: np.ndarray, result: np.ndarray) -> float:
    """
    Write (D + J Jᵀ)⁻¹ r = G r − G J H⁻¹ Jᵀ G r on forces that may change; return r · result.

    Woodbury's identity, with the factorised H = 1 + Jᵀ G J.
    """
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    y = problem.modes[2]
    clear(problem, y, problem.shifts[1])
    for k in range(len(rows)):
        force = through(rows[k]['stiffness'], vector_of(residual[k]))
        add_modes(rows[k], jacobian, k, counts, force, y)
    substitute(counts, problem.hessian, problem.filled, y)
    total = 0.0
    for k in range(len(rows)):
        row, r = rows[k], vector_of(residual[k])
        left = minus(r, mode_response(row, jacobian, k, counts, y))
        put_vector(result[k], through(row['stiffness'], left))
        total += dot(vector_of(result[k]), r)
    return total
