# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact problem of an island: forces within friction cones, by Newton's method in mode space.

A contact has a normal and two tangents. With f the forces that are sought, f⁰ those that act
already, and s the relative displacements (or velocities) of the two sides,

    s = b + c f + J Jᵀ f,    0 ≤ f⁰ₙ + fₙ ⟂ sₙ ≥ 0,    |f⁰ₜ + fₜ| ≤ μ (f⁰ₙ + fₙ), fₜ against sₜ.

J are the responses of the modes of the bodies, scaled to compliance 1: of a rigid body three
translations and three rotations. c > 0 is the compliance of the contact itself.

For given amplitudes y = Jᵀ f of the modes each contact is explicit: its force is the point of its
cone nearest to −(b + J y) / c. What is left is to minimise a convex function of y, with a
continuous gradient y − Jᵀ f(y): few unknowns however many contacts there are. The radii
μ (f⁰ₙ + fₙ) of the friction discs are those of the last iterate, so that in the limit the law of
Coulomb holds exactly.

Gauss–Seidel sweeps come first; often they suffice. The numbers of sweeps and steps are bounded,
and so is the time; how far the result is from a solution is returned.
"""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.rows import MODES

SWEEPS, LAST_SWEEPS = 4, 30
"""Gauss–Seidel sweeps before Newton's method, and of islands that are too large for it."""
LARGEST_ISLAND = 30
"""Bodies of an island up to which Newton's equations are factorised."""
OUTER, INNER, STEPS = 60, 40, 400
"""Most updates of the friction discs, Newton steps between them, and Newton steps in all."""
SLOW = 0.05
"""Ratio of changes of the discs, and distance from 1, from which on they are extrapolated."""
SEARCHES = 30
"""Most evaluations of a line search."""
ROUNDING = 1e-13
"""Gradient, relative to the amplitudes, that is rounding."""
FLAT = 0.05
"""Slope, relative to that at its start, at which a line search ends."""
PRECISION = 0.03
"""Displacement by the gradient, relative to the tolerance, at which Newton's method ends."""


@helper
def solve(
    rows: np.ndarray,
    jacobian: np.ndarray,
    members: int,
    tolerance: float,
    mass: float,
    modes: np.ndarray,
) -> tuple[float, int, int]:
    """
    Solve the contact problem of one island.

    Parameters
    ----------
    rows : (k,) ROW
        `force` is the start, and the result
    jacobian : (k, 2, 3, 6) float
        J of both sides; of the second one negative
    members : int
        number of bodies m
    tolerance : float
        of s
    mass : float
        of the lightest body, kg
    modes : (3, m, 6) float
        scratch

    Returns
    -------
    residual : float
        largest change of s by a projection of one contact
    sweeps, steps : int
        of Gauss–Seidel, and of Newton's method

    """
    find_diagonals(rows, jacobian)
    distribute_viscous_friction(rows, jacobian)
    y = modes[0]
    sum_modes(rows, jacobian, y)
    is_large = members > LARGEST_ISLAND
    residual, sweeps, most = math.inf, 0, LAST_SWEEPS if is_large else SWEEPS
    while sweeps < most:
        residual = sweep(rows, jacobian, y)
        sweeps += 1
        distribute_viscous_friction(rows, jacobian)
        if residual <= tolerance:
            break
    for k in range(len(rows)):
        # of the problem before, or of another: nothing to extrapolate
        rows[k]['radius'] = radius_for(rows[k], rows[k]['base'][0] + rows[k]['force'][0])
        rows[k]['disc_change'] = 0.0
    if is_large or residual <= tolerance:
        settle(rows, jacobian, y)
        return residual, sweeps, 0
    steps, least = 0, (PRECISION * tolerance) * (PRECISION * tolerance) * mass
    settle(rows, jacobian, y)
    hessian = np.zeros((members, members, MODES, MODES))
    filled = np.zeros((members, members), np.bool_)
    for _ in range(OUTER):
        steps += minimise(rows, jacobian, members, least, modes, hessian, filled)
        residual = settle(rows, jacobian, y)
        distribute_viscous_friction(rows, jacobian)
        if residual <= tolerance or steps >= STEPS:
            break
    return residual, sweeps, steps


@helper
def radius_for(row: np.void, normal: float) -> float:
    """Return the radius of the friction disc for a normal force."""
    return row['friction'] * normal if normal > 0.0 else 0.0


@helper
def update_discs(rows: np.ndarray) -> None:
    """
    Take the radii of the present normal forces, or of those that they tend to.

    Their changes often shrink like a geometric series: then its sum is taken at once (Aitken).
    """
    product = square = 0.0
    for k in range(len(rows)):
        row = rows[k]
        target = radius_for(row, row['base'][0] + row['force'][0])
        change = target - row['radius'] if target < math.inf and row['radius'] < math.inf else 0.0
        product += change * row['disc_change']
        square += row['disc_change'] * row['disc_change']
        row['radius'], row['disc_change'] = target, change
    ratio = product / square if square > 0.0 else 0.0
    if SLOW < ratio < 1.0 - SLOW:
        for k in range(len(rows)):
            row = rows[k]
            row['radius'] = max(row['radius'] + ratio / (1.0 - ratio) * row['disc_change'], 0.0)
            row['disc_change'] = 0.0


@helper
def keep_on_disc(row: np.void) -> None:
    """Project friction on the disc of a contact."""
    base, force = row['base'], row['force']
    one, two = on_disc(base[1] + force[1], base[2] + force[2], row['radius'])
    force[1], force[2] = one - base[1], two - base[2]


@helper
def find_diagonals(rows: np.ndarray, jacobian: np.ndarray) -> None:
    """Write the response of each contact to its own force."""
    for k in range(len(rows)):
        row = rows[k]
        size = (0.0, 0.0, 0.0)
        for side in range(2):
            if side == 1 and row['two'] < 0:
                continue
            n, one, two = size
            for mode in range(MODES):
                a = jacobian[k, side, 0, mode]
                b = jacobian[k, side, 1, mode]
                c = jacobian[k, side, 2, mode]
                n, one, two = n + a * a, one + b * b, two + c * c
            size = (n, one, two)
        row['diagonal'][0] = row['compliance'][0] + size[0]
        row['diagonal'][1] = row['compliance'][1] + max(size[1], size[2])


@helper
def sum_modes(rows: np.ndarray, jacobian: np.ndarray, y: np.ndarray) -> None:
    """Write y = Jᵀ f."""
    for member in range(len(y)):
        for mode in range(MODES):
            y[member, mode] = 0.0
    for k in range(len(rows)):
        force = rows[k]['force']
        add_modes(rows[k], jacobian[k], (force[0], force[1], force[2]), y)


@helper
def add_modes(
    row: np.void, jacobian: np.ndarray, force: tuple[float, float, float], y: np.ndarray
) -> None:
    """Add Jᵀ f of one contact."""
    n, one, two = force
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0:
            j = jacobian[side]
            for mode in range(MODES):
                y[member, mode] += j[0, mode] * n + j[1, mode] * one + j[2, mode] * two


@helper
def response(row: np.void, jacobian: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Return J y of one contact."""
    n = one = two = 0.0
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0:
            j = jacobian[side]
            for mode in range(MODES):
                amplitude = y[member, mode]
                n += j[0, mode] * amplitude
                one += j[1, mode] * amplitude
                two += j[2, mode] * amplitude
    return n, one, two


@helper
def on_disc(one: float, two: float, radius: float) -> tuple[float, float]:
    """Return the point of a disc about 0 that is nearest to a point."""
    size = math.sqrt(one * one + two * two)
    if size > radius:
        return one * (radius / size), two * (radius / size)
    return one, two


# -------------------------------------------------------------------------------- Gauss–Seidel
@helper
def sweep(rows: np.ndarray, jacobian: np.ndarray, y: np.ndarray) -> float:
    """Project each contact once, one after the other; return the largest change of s."""
    residual = 0.0
    for k in range(len(rows)):
        row = rows[k]
        change = relaxed(row, jacobian[k], y)
        residual = max(residual, abs(change[0]) * row['diagonal'][0])
        residual = max(residual, max(abs(change[1]), abs(change[2])) * row['diagonal'][1])
        if change != (0.0, 0.0, 0.0):
            add_modes(row, jacobian[k], change, y)
            for axis in range(3):
                row['force'][axis] += change[axis]
    return residual


@helper
def relaxed(row: np.void, jacobian: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Return the change of the force of one contact that satisfies its own conditions."""
    n, one, two = response(row, jacobian, y)
    force, base, bias, compliance = row['force'], row['base'], row['bias'], row['compliance']
    n = force[0] - (bias[0] + compliance[0] * force[0] + n) / row['diagonal'][0]
    n = max(n, -base[0])
    one = base[1] + force[1] - (bias[1] + compliance[1] * force[1] + one) / row['diagonal'][1]
    two = base[2] + force[2] - (bias[2] + compliance[1] * force[2] + two) / row['diagonal'][1]
    one, two = on_disc(one, two, radius_for(row, base[0] + n))
    return n - force[0], one - base[1] - force[1], two - base[2] - force[2]


@helper
def settle(rows: np.ndarray, jacobian: np.ndarray, y: np.ndarray) -> float:
    """
    Take the friction discs of the present normal forces, and return the residual before.

    That is the largest change of s by a projection of a contact, all from the same state.
    """
    residual = 0.0
    for k in range(len(rows)):
        row = rows[k]
        change = relaxed(row, jacobian[k], y)
        residual = max(residual, abs(change[0]) * row['diagonal'][0])
        residual = max(residual, max(abs(change[1]), abs(change[2])) * row['diagonal'][1])
    update_discs(rows)
    for k in range(len(rows)):
        keep_on_disc(rows[k])
    sum_modes(rows, jacobian, y)
    return residual


# ------------------------------------------------------------------------------------- Newton
@helper
def minimise(
    rows: np.ndarray,
    jacobian: np.ndarray,
    members: int,
    least: float,
    modes: np.ndarray,
    hessian: np.ndarray,
    filled: np.ndarray,
) -> int:
    """
    Minimise the function of the mode amplitudes for given friction discs.

    Semismooth Newton: its Hessian is 1 + Jᵀ G J, G the derivatives of the projections; with an
    exact line search it converges from anywhere. Written are the forces, and y = Jᵀ f.

    Returns
    -------
    int
        number of Newton steps

    """
    y, gradient, step = modes[0], modes[1], modes[2]
    steps, solved = 0, False
    for _ in range(INNER):
        size = evaluate(rows, jacobian, members, y, gradient, hessian, filled)
        if size <= max(least, ROUNDING * ROUNDING * squared(y, members)):
            solved = True
            break
        factorise(members, hessian, filled)
        for member in range(members):
            for mode in range(MODES):
                step[member, mode] = -gradient[member, mode]
        substitute(members, hessian, filled, step)
        steps += 1
        length = line_search(rows, jacobian, members, y, gradient, step)
        if length == 0.0:
            break
        for member in range(members):
            for mode in range(MODES):
                y[member, mode] += length * step[member, mode]
    approach_forces(rows, jacobian, y, modes, solved)
    return steps


@helper
def squared(y: np.ndarray, members: int) -> float:
    """Return |y|²."""
    total = 0.0
    for member in range(members):
        for mode in range(MODES):
            total += y[member, mode] * y[member, mode]
    return total


@helper
def approach_forces(
    rows: np.ndarray, jacobian: np.ndarray, y: np.ndarray, modes: np.ndarray, solved: bool
) -> None:
    """
    Take the forces for given mode amplitudes, and make the amplitudes theirs.

    If they are no solution, since Newton's method has ended early: only as far towards them as
    f · (b + (c + J Jᵀ) f / 2) decreases, of which the solution is the minimum.
    """
    present, change = modes[1], modes[2]
    sum_modes(rows, jacobian, present)
    for member in range(len(change)):
        for mode in range(MODES):
            change[member, mode] = 0.0
    slope = curvature = 0.0
    for k in range(len(rows)):
        row = rows[k]
        target, force = explicit(row, response(row, jacobian[k], y)), row['force']
        now = response(row, jacobian[k], present)
        step = (target[0] - force[0], target[1] - force[1], target[2] - force[2])
        for axis in range(3):
            compliance = row['compliance'][0 if axis == 0 else 1]
            slip = row['bias'][axis] + compliance * force[axis] + now[axis]
            slope += slip * step[axis]
            curvature += compliance * step[axis] * step[axis]
            row['target'][axis] = target[axis]
        add_modes(row, jacobian[k], step, change)
    for member in range(len(change)):
        for mode in range(MODES):
            curvature += change[member, mode] * change[member, mode]
    share = 1.0
    if curvature > 0.0 and not solved:
        share = min(max(-slope / curvature, 0.0), 1.0)
    for k in range(len(rows)):
        force, target = rows[k]['force'], rows[k]['target']
        for axis in range(3):
            if share == 1.0:
                force[axis] = target[axis]
            else:
                force[axis] += share * (target[axis] - force[axis])
    sum_modes(rows, jacobian, y)


@helper
def explicit(row: np.void, motion: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the force of a contact for given J y."""
    base, bias, compliance = row['base'], row['bias'], row['compliance']
    n = max(-(bias[0] + motion[0]) / compliance[0], -base[0])
    one, two = on_disc(
        base[1] - (bias[1] + motion[1]) / compliance[1],
        base[2] - (bias[2] + motion[2]) / compliance[1],
        row['radius'],
    )
    return n, one - base[1], two - base[2]


@helper
def stiffness(
    row: np.void, motion: tuple[float, float, float]
) -> tuple[float, float, float, float]:
    """Return G, minus the derivative of `explicit`: nn, and 11, 12, 22 of the tangents."""
    base, bias, compliance = row['base'], row['bias'], row['compliance']
    normal = 1.0 / compliance[0] if -(bias[0] + motion[0]) / compliance[0] > -base[0] else 0.0
    tangent, radius = 1.0 / compliance[1], row['radius']
    if radius <= 0.0:
        return normal, 0.0, 0.0, 0.0
    one = base[1] - (bias[1] + motion[1]) * tangent
    two = base[2] - (bias[2] + motion[2]) * tangent
    size = math.sqrt(one * one + two * two)
    if size <= radius:
        return normal, tangent, 0.0, tangent
    one, two, tangent = one / size, two / size, tangent * (radius / size)
    return normal, tangent * two * two, -tangent * one * two, tangent * one * one


@helper
def evaluate(
    rows: np.ndarray,
    jacobian: np.ndarray,
    members: int,
    y: np.ndarray,
    gradient: np.ndarray,
    hessian: np.ndarray,
    filled: np.ndarray,
) -> float:
    """Write gradient y − Jᵀ f and Hessian (lower blocks); return the squared gradient."""
    for a in range(members):
        for b in range(a + 1):
            if filled[a, b]:
                for i in range(MODES):
                    for j in range(MODES):
                        hessian[a, b, i, j] = 0.0
            filled[a, b] = a == b
        for i in range(MODES):
            for j in range(MODES):
                hessian[a, a, i, j] = 1.0 if i == j else 0.0
            gradient[a, i] = y[a, i]
    for k in range(len(rows)):
        row, j = rows[k], jacobian[k]
        motion = response(row, j, y)
        force = explicit(row, motion)
        add_modes(row, j, (-force[0], -force[1], -force[2]), gradient)
        g = stiffness(row, motion)
        if g != (0.0, 0.0, 0.0, 0.0):
            one, two = row['one'], row['two']
            add_block(hessian[one, one], j[0], j[0], g)
            if two >= 0:
                add_block(hessian[two, two], j[1], j[1], g)
                if one > two:
                    filled[one, two] = True
                    add_block(hessian[one, two], j[0], j[1], g)
                else:
                    filled[two, one] = True
                    add_block(hessian[two, one], j[1], j[0], g)
    size = 0.0
    for a in range(members):
        for i in range(MODES):
            size += gradient[a, i] * gradient[a, i]
    return size


@helper
def add_block(
    block: np.ndarray, one: np.ndarray, two: np.ndarray, g: tuple[float, float, float, float]
) -> None:
    """Add Jᵀ G J of two sides of a contact, J (3, 6)."""
    for i in range(MODES):
        n, t, u = one[0, i], one[1, i], one[2, i]
        n, t, u = g[0] * n, g[1] * t + g[2] * u, g[2] * t + g[3] * u
        for j in range(MODES):
            block[i, j] += n * two[0, j] + t * two[1, j] + u * two[2, j]


@helper
def line_search(
    rows: np.ndarray,
    jacobian: np.ndarray,
    members: int,
    y: np.ndarray,
    gradient: np.ndarray,
    step: np.ndarray,
) -> float:
    """
    Return the length at which the slope along a step vanishes, at most 1.

    The slope increases: bisection, with the secant where it lies in the bracket's inner part.
    """
    first = 0.0
    for member in range(members):
        for mode in range(MODES):
            first += gradient[member, mode] * step[member, mode]
    if not first < 0.0:
        return 0.0
    low, low_slope, high, high_slope = 0.0, first, 1.0, math.inf
    length = 1.0
    for _ in range(SEARCHES):
        slope = slope_at(rows, jacobian, members, y, step, length)
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
def slope_at(
    rows: np.ndarray,
    jacobian: np.ndarray,
    members: int,
    y: np.ndarray,
    step: np.ndarray,
    length: float,
) -> float:
    """Return the derivative of the function along a step, at a length."""
    slope = 0.0
    for member in range(members):
        for mode in range(MODES):
            slope += step[member, mode] * (y[member, mode] + length * step[member, mode])
    for k in range(len(rows)):
        motion = response(rows[k], jacobian[k], y)
        change = response(rows[k], jacobian[k], step)
        force = explicit(
            rows[k],
            (
                motion[0] + length * change[0],
                motion[1] + length * change[1],
                motion[2] + length * change[2],
            ),
        )
        slope -= force[0] * change[0] + force[1] * change[1] + force[2] * change[2]
    return slope


# ------------------------------------------------------------------------------- linear systems
@helper
def factorise(members: int, h: np.ndarray, filled: np.ndarray) -> None:
    """
    Factorise a positive definite matrix of blocks in place: L of the Cholesky factorisation.

    Golub and Van Loan, Matrix Computations, section 4.2; only blocks that are not zero.
    """
    for c in range(members):
        diagonal = h[c, c]
        for i in range(MODES):
            for j in range(i + 1):
                total = diagonal[i, j]
                for k in range(j):
                    total -= diagonal[i, k] * diagonal[j, k]
                diagonal[i, j] = math.sqrt(total) if i == j else total / diagonal[j, j]
        for r in range(c + 1, members):
            if filled[r, c]:
                block = h[r, c]
                for i in range(MODES):
                    for j in range(MODES):
                        total = block[i, j]
                        for k in range(j):
                            total -= block[i, k] * diagonal[j, k]
                        block[i, j] = total / diagonal[j, j]
        for r in range(c + 1, members):
            if not filled[r, c]:
                continue
            for s in range(c + 1, r + 1):
                if not filled[s, c]:
                    continue
                filled[r, s] = True
                target, one, two = h[r, s], h[r, c], h[s, c]
                for i in range(MODES):
                    for j in range(MODES):
                        total = target[i, j]
                        for k in range(MODES):
                            total -= one[i, k] * two[j, k]
                        target[i, j] = total


@helper
def substitute(members: int, h: np.ndarray, filled: np.ndarray, x: np.ndarray) -> None:
    """Solve L Lᵀ x = b in place."""
    for r in range(members):
        for c in range(r):
            if filled[r, c]:
                for i in range(MODES):
                    for j in range(MODES):
                        x[r, i] -= h[r, c, i, j] * x[c, j]
        for i in range(MODES):
            for j in range(i):
                x[r, i] -= h[r, r, i, j] * x[r, j]
            x[r, i] /= h[r, r, i, i]
    for r in range(members - 1, -1, -1):
        for c in range(r + 1, members):
            if filled[c, r]:
                for i in range(MODES):
                    for j in range(MODES):
                        x[r, i] -= h[c, r, j, i] * x[c, j]
        for i in range(MODES - 1, -1, -1):
            for j in range(i + 1, MODES):
                x[r, i] -= h[r, r, j, i] * x[r, j]
            x[r, i] /= h[r, r, i, i]


# --------------------------------------------------------------------------------------- friction
@helper
def distribute_viscous_friction(rows: np.ndarray, jacobian: np.ndarray) -> None:
    """
    Write the law of viscous friction as a compliance along the tangents.

    A patch, the contacts of the same two sides, loses the share φ of its sliding. A compliance of
    w (1 − φ) / φ does that, w the response at its centre to a force there; each of n contacts has
    n times that.
    """
    start = 0
    while start < len(rows):
        first, end = rows[start], start + 1
        while end < len(rows) and is_same_patch(first, rows[end]):
            end += 1
        if first['viscosity'] >= 0.0:
            distribute_over(rows[start:end], jacobian[start:end])
        start = end


@helper
def is_same_patch(one: np.void, two: np.void) -> bool:
    """Return whether contacts are between the same sides."""
    return (
        one['one'] == two['one']
        and one['two'] == two['two']
        and one['obstacle'] == two['obstacle']
    )


@helper
def distribute_over(rows: np.ndarray, jacobian: np.ndarray) -> None:
    """Write the tangential laws of one patch."""
    acting = 0
    for k in range(len(rows)):
        acting += rows[k]['base'][0] + rows[k]['force'][0] > 0.0
    # at first nothing is known of the pressure
    every = acting == 0
    share = 1.0 / (len(rows) if every else acting)
    one = two = 0.0
    for side in range(2):
        if side == 1 and rows[0]['two'] < 0:
            continue
        for mode in range(MODES):
            a = b = 0.0
            for k in range(len(rows)):
                if every or rows[k]['base'][0] + rows[k]['force'][0] > 0.0:
                    a += share * jacobian[k, side, 1, mode]
                    b += share * jacobian[k, side, 2, mode]
            one, two = one + a * a, two + b * b
    for k in range(len(rows)):
        row, phi = rows[k], rows[k]['viscosity']
        own = row['diagonal'][1] - row['compliance'][1]
        row['friction'], row['compliance'][1] = 0.0, row['compliance'][0]
        if phi > 0.0:
            row['friction'] = math.inf
            compliance = 0.5 * (one + two) * (1.0 - phi) / (phi * share)
            row['compliance'][1] = max(compliance, row['compliance'][0])
        row['diagonal'][1] = own + row['compliance'][1]
        for axis in range(2):
            row['bias'][1 + axis] = row['free'][axis] + (
                row['compliance'][1] * row['base'][1 + axis]
            )
