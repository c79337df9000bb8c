# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact problem of an island: its data, its operator and its laws.

With f the forces that are sought, f⁰ those that act already, and s the relative displacements (or
velocities) of two sides of a contact along a normal and two tangents,

    s = b + c f + W f,    0 ≤ f⁰ₙ + fₙ ⟂ sₙ ≥ 0,    |f⁰ₜ + fₜ| ≤ μ (f⁰ₙ + fₙ), fₜ against sₜ.

W = J Jᵀ − K Kᵀ + S g Sᵀ are the responses of bodies. J are those of their modes, scaled to
compliance 1: of a rigid body three translations and three rotations, of a deformable one also
those that its goal shape can follow. What no goal follows, particles do one by one: g are their
mobilities, S the shares of f that act on them: 1 on the particle of the first side, −λ on the
corners of the face of the second one. So rows that share particles are coupled. A change of volume
can be stiffer than that: K takes the difference away. c ≥ 0 is the compliance of a contact itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.rows import in_world
from softbody_ros.core.geometry.vectors import (
    ZERO,
    Vector,
    along,
    column_of,
    dot,
    minus,
    plus,
    vector_of,
)
from softbody_ros.core.lanes import (
    LANES,
    LaneVector,
    lanes_at,
    lanes_of,
    no_vectors,
    put_lanes,
    total,
    totals,
)

RIGID_MODES = 6
"""Modes of any body: three translations, three rotations; a rigid one has no others."""


class Problem(NamedTuple):
    """
    The arrays of one problem: k contacts, m bodies of at most M modes, p particles.

    Amplitudes of a body have room for full lanes, with zeros beyond its modes. Bodies of more
    modes than those of a rigid one have one more, that of K, after that room.
    """

    rows: np.ndarray
    """(k,) ROW; `force` is the start, and the result"""
    jacobian: np.ndarray
    """(6 k, width of M + 1) float, J of both sides of each row, see `line_of`; of the second one
    negative"""
    counts: np.ndarray
    """(m,) int, numbers of modes, multiples of 3"""
    mobility: np.ndarray
    """(p,) float, g ≥ 0"""
    modes: np.ndarray
    """(3, m, width of M + 1) float, zeros at first; the first is written: amplitudes y = Jᵀ f, and
    Kᵀ f; the others are scratch"""
    shifts: np.ndarray
    """(2, 3, p) float, the first is written: displacements g Sᵀ f; the second is scratch"""
    hessian: np.ndarray
    """(m, m, M, M) float, scratch of any content; of a large island empty"""
    filled: np.ndarray
    """(m, m) bool, scratch of any content; of a large island empty"""


# -------------------------------------------------------------------------------------- operator
@helper
def line_of(k: int, side: int) -> int:
    """
    Return the first of the three lines of J of one side of a row: of the normal and two tangents.

    J is one array of lines: a view of a part of it for each row would be counted (an atomic
    operation of the processor) as often as it is made.
    """
    return 6 * k + 3 * side


@helper
def any_mobile(problem: Problem) -> bool:
    """
    Return whether particles have a mobility of their own.

    Loops ask once, before: in problems of rigid bodies what is done for them costs nothing.
    """
    return len(problem.mobility) > 0


@helper
def add_modes(
    row: np.void, jacobian: np.ndarray, k: int, counts: np.ndarray, force: Vector, y: np.ndarray
) -> None:
    """Add Jᵀ f of row k."""
    n, one, two = force
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0:
            line = line_of(k, side)
            for mode in range(0, counts[member], LANES):
                a, b, c = modes_at(jacobian, line, mode)
                added = a * n + b * one + c * two
                put_lanes(y, member, mode, LANES, lanes_at(y, member, mode, LANES) + added)


@helper
def add_particles(
    row: np.void,
    jacobian: np.ndarray,
    k: int,
    counts: np.ndarray,
    mobility: np.ndarray,
    force: Vector,
    y: np.ndarray,
    shifts: np.ndarray,
) -> None:
    """Add g Sᵀ f and Kᵀ f of row k."""
    world = in_world(row, force)
    for corner in range(4):
        share = row['shares'][corner]
        if share != 0.0:
            particle = row['particles'][corner]
            for axis in range(3):
                shifts[axis, particle] += mobility[particle] * share * world[axis]
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0 and counts[member] > RIGID_MODES:
            last = width_of(counts[member])
            y[member, last] += dot(stiffer(jacobian, line_of(k, side), counts[member]), force)


@helper
def modes_at(jacobian: np.ndarray, line: int, mode: int) -> LaneVector:
    """Return J of four modes, in the three lines from the given one."""
    return (
        lanes_at(jacobian, line, mode, LANES),
        lanes_at(jacobian, line + 1, mode, LANES),
        lanes_at(jacobian, line + 2, mode, LANES),
    )


@helper
def stiffer(jacobian: np.ndarray, line: int, modes: int) -> Vector:
    """Return K of one side of a row, in the three lines from the given one."""
    last = width_of(modes)
    return jacobian[line, last], jacobian[line + 1, last], jacobian[line + 2, last]


@helper
def width_of(modes: int) -> int:
    """Return the room for amplitudes of the modes of a body, a multiple of LANES."""
    return (modes + LANES - 1) // LANES * LANES


@helper
def mode_response(
    row: np.void, jacobian: np.ndarray, k: int, counts: np.ndarray, y: np.ndarray
) -> Vector:
    """Return J y of row k."""
    motion = no_vectors()
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0:
            line = line_of(k, side)
            for mode in range(0, counts[member], LANES):
                amplitudes = lanes_at(y, member, mode, LANES)
                motion = along(motion, amplitudes, modes_at(jacobian, line, mode))
    return totals(motion)


@helper
def particle_response(
    row: np.void,
    jacobian: np.ndarray,
    k: int,
    counts: np.ndarray,
    y: np.ndarray,
    shifts: np.ndarray,
) -> Vector:
    """Return S u − K y of row k."""
    apart, tangents = ZERO, row['tangents']
    for corner in range(4):
        share = row['shares'][corner]
        if share != 0.0:
            apart = along(apart, share, column_of(shifts, row['particles'][corner]))
    motion = (
        dot(vector_of(row['normal']), apart),
        dot(vector_of(tangents[0]), apart),
        dot(vector_of(tangents[1]), apart),
    )
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0 and counts[member] > RIGID_MODES:
            size = y[member, width_of(counts[member])]
            motion = along(motion, -size, stiffer(jacobian, line_of(k, side), counts[member]))
    return motion


@helper
def response_of(problem: Problem, k: int, is_mobile: bool) -> Vector:
    """Return W f of row k, of modes and, as `any_mobile` says, particles."""
    row, jacobian, counts = problem.rows[k], problem.jacobian, problem.counts
    motion = mode_response(row, jacobian, k, counts, problem.modes[0])
    if is_mobile:
        shifts = problem.shifts[0]
        own = particle_response(row, jacobian, k, counts, problem.modes[0], shifts)
        motion = plus(motion, own)
    return motion


@helper
def normal_response(
    row: np.void, jacobian: np.ndarray, k: int, counts: np.ndarray, y: np.ndarray
) -> float:
    """Return the normal component of J y of row k."""
    motion = lanes_of(0.0)
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0:
            line = line_of(k, side)
            for mode in range(0, counts[member], LANES):
                amplitudes = lanes_at(y, member, mode, LANES)
                motion = motion + lanes_at(jacobian, line, mode, LANES) * amplitudes
    return total(motion)


@helper
def normal_particle_response(
    row: np.void,
    jacobian: np.ndarray,
    k: int,
    counts: np.ndarray,
    y: np.ndarray,
    shifts: np.ndarray,
) -> float:
    """Return the normal component of S u − K y of row k."""
    # the loop of `particle_response`: a helper for both would not be inlined, and cost a tenth
    apart = ZERO
    for corner in range(4):
        share = row['shares'][corner]
        if share != 0.0:
            apart = along(apart, share, column_of(shifts, row['particles'][corner]))
    motion = dot(vector_of(row['normal']), apart)
    for side in range(2):
        member = row['one'] if side == 0 else row['two']
        if member >= 0 and counts[member] > RIGID_MODES:
            last = width_of(counts[member])
            motion -= y[member, last] * jacobian[line_of(k, side), last]
    return motion


@helper
def slip_of(row: np.void, motion: Vector) -> Vector:
    """Return s = b + c f + W f of one row, for a given response W f."""
    bias, compliance, force = row['bias'], row['compliance'], row['force']
    return (
        bias[0] + compliance[0] * force[0] + motion[0],
        bias[1] + compliance[1] * force[1] + motion[1],
        bias[2] + compliance[1] * force[2] + motion[2],
    )


@helper
def find_diagonals(problem: Problem) -> int:
    """Write the response of each row to its own force; return the most modes of a body there."""
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    is_mobile, most = any_mobile(problem), 0
    for k in range(len(rows)):
        row, size = rows[k], ZERO
        for side in range(2):
            member = row['one'] if side == 0 else row['two']
            if member < 0:
                continue
            line, count, squares = line_of(k, side), counts[member], no_vectors()
            most = max(most, count)
            for mode in range(0, count, LANES):
                squares = plus(squares, squared_components(modes_at(jacobian, line, mode)))
            size = plus(size, totals(squares))
            if count > RIGID_MODES:
                size = minus(size, squared_components(stiffer(jacobian, line, count)))
        own = own_mobility(row, problem.mobility) if is_mobile else 0.0
        row['diagonal'][0] = row['compliance'][0] + (size[0] + own)
        row['diagonal'][1] = row['compliance'][1] + (max(size[1], size[2]) + own)
    return most


@helper
def squared_components(a):  # type: ignore[no-untyped-def]
    """Return the squares of the components of a vector, or of vectors of lanes."""
    return a[0] * a[0], a[1] * a[1], a[2] * a[2]


@helper
def own_mobility(row: np.void, mobility: np.ndarray) -> float:
    """Return S g Sᵀ of one row, the same in any direction."""
    own = 0.0
    for corner in range(4):
        share = row['shares'][corner]
        if share != 0.0:
            own += share * share * mobility[row['particles'][corner]]
    return own


@helper
def clear(problem: Problem, y: np.ndarray, shifts: np.ndarray) -> None:
    """Set amplitudes and shifts to 0."""
    for member in range(len(problem.counts)):
        for mode in range(width_of(problem.counts[member]) + 1):
            y[member, mode] = 0.0
    for axis in range(3):
        for particle in range(len(problem.mobility)):
            shifts[axis, particle] = 0.0


@helper
def sum_forces(problem: Problem) -> None:
    """Write y = Jᵀ f and the shifts g Sᵀ f."""
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    mobility, y, shifts = problem.mobility, problem.modes[0], problem.shifts[0]
    clear(problem, y, shifts)
    is_mobile = any_mobile(problem)
    for k in range(len(rows)):
        force = vector_of(rows[k]['force'])
        if force == ZERO:
            continue
        add_modes(rows[k], jacobian, k, counts, force, y)
        if is_mobile:
            add_particles(rows[k], jacobian, k, counts, mobility, force, y, shifts)


@helper
def squared(problem: Problem, y: np.ndarray) -> float:
    """Return |y|² of the modes."""
    total = 0.0
    for member in range(len(problem.counts)):
        for mode in range(problem.counts[member]):
            total += y[member, mode] * y[member, mode]
    return total


@helper
def squared_shifts(problem: Problem, y: np.ndarray, shifts: np.ndarray) -> float:
    """Return Σ u² / g of given shifts, less the squared amplitudes of K."""
    mobility, total = problem.mobility, 0.0
    for particle in range(len(mobility)):
        if mobility[particle] > 0.0:
            shift = column_of(shifts, particle)
            total += dot(shift, shift) / mobility[particle]
    for member in range(len(problem.counts)):
        last = width_of(problem.counts[member])
        if problem.counts[member] > RIGID_MODES:
            total -= y[member, last] * y[member, last]
    return total


@helper
def approach_targets(problem: Problem) -> None:
    """
    Move the forces towards the targets of their rows, as far as it is good.

    That is as long as f · (b + (c + W) f / 2) decreases, of which the solution is the minimum for
    given friction discs.
    """
    rows, jacobian, counts = problem.rows, problem.jacobian, problem.counts
    mobility = problem.mobility
    y_step, shifts_step = problem.modes[1], problem.shifts[1]
    clear(problem, y_step, shifts_step)
    slope = curvature = 0.0
    is_mobile = any_mobile(problem)
    for k in range(len(rows)):
        row = rows[k]
        target, force = row['target'], row['force']
        slip = slip_of(row, response_of(problem, k, is_mobile))
        step = (target[0] - force[0], target[1] - force[1], target[2] - force[2])
        for axis in range(3):
            slope += slip[axis] * step[axis]
            compliance = row['compliance'][0 if axis == 0 else 1]
            curvature += compliance * step[axis] * step[axis]
        add_modes(row, jacobian, k, counts, step, y_step)
        if is_mobile:
            add_particles(row, jacobian, k, counts, mobility, step, y_step, shifts_step)
    curvature += squared(problem, y_step) + squared_shifts(problem, y_step, shifts_step)
    share = 1.0
    if curvature > 0.0:
        share = min(max(-slope / curvature, 0.0), 1.0)
    take_targets(problem, share)


@helper
def take_targets(problem: Problem, share: float) -> None:
    """Move the forces towards the targets of their rows by a share of the way."""
    for k in range(len(problem.rows)):
        force, target = problem.rows[k]['force'], problem.rows[k]['target']
        for axis in range(3):
            if share == 1.0:
                force[axis] = target[axis]
            else:
                force[axis] += share * (target[axis] - force[axis])
    sum_forces(problem)


# ------------------------------------------------------------------------------------------ laws
@helper
def radius_for(row: np.void, normal: float) -> float:
    """Return the radius of the friction disc for a normal force f."""
    total = row['base'][0] + normal
    if row['rubs']:
        return math.inf
    # no ∞ · 0: friction may be ∞ where nothing presses
    return row['friction'] * total if row['friction'] > 0.0 and total > 0.0 else 0.0


@helper
def on_disc(one: float, two: float, radius: float) -> tuple[float, float]:
    """Return the point of a disc about 0 that is nearest to a point."""
    size = math.sqrt(one * one + two * two)
    if size > radius:
        return one * (radius / size), two * (radius / size)
    return one, two


@helper
def projected(row: np.void, radius: float, n: float, one: float, two: float) -> Vector:
    """Return the force nearest to a given one that is neither adhesion nor outside of a disc."""
    base = row['base']
    one, two = on_disc(base[1] + one, base[2] + two, radius)
    return max(n, -base[0]), one - base[1], two - base[2]


@helper
def relaxed(row: np.void, slip: Vector) -> Vector:
    """Return the change of the force of one row that satisfies its own conditions."""
    force, diagonal = row['force'], row['diagonal']
    n, one, two = force[0], force[1], force[2]
    if diagonal[0] > 0.0:
        n = max(n - slip[0] / diagonal[0], -row['base'][0])
    if diagonal[1] > 0.0:
        one, two = one - slip[1] / diagonal[1], two - slip[2] / diagonal[1]
    n, one, two = projected(row, radius_for(row, n), n, one, two)
    return n - force[0], one - force[1], two - force[2]
