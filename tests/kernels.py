# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Functions that only kernels call, for arrays from Python: a kernel each that goes over rows."""

import numpy as np

from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact.energy import keep_energy, kinetic_energy, share_for
from softbody_ros.core.geometry.vectors import (
    matrix_of,
    put_column,
    put_matrix,
    put_vector,
    vector_of,
)
from softbody_ros.core.shape_matching import matching, plasticity, regions
from softbody_ros.core.shape_matching import polar_decomposition as polar


def over(function, arrays, *others, out):
    """Call a kernel with arrays (…, rows, columns) as stacks, and return what it writes."""
    lead = np.shape(arrays[0])[:-2]
    stacks = [np.ascontiguousarray(a, float).reshape(-1, *np.shape(a)[-2:]) for a in arrays]
    result = np.empty((len(stacks[0]), *out))
    function(*stacks, *others, result)
    return result.reshape(*lead, *out)


# -------------------------------------------------------------------------------------- matching
def transposed(transform):
    """Return transforms (…, 3, F) as kernels have them, (…, F, 3), and back."""
    return np.ascontiguousarray(np.swapaxes(transform, -1, -2))


def moments(x, rest, features):
    """Return the centres (B, 3) and moments (B, 3, features) of positions x (B, 3, n)."""
    centre = x @ rest.weights
    f = rest.features[1 : 1 + features]
    return centre, (x - centre[..., None]) @ (f * rest.weights).T / rest.scale


@kernel
def fits(moment, undeformed, shape, result):
    for k in range(len(moment)):
        matching.fit(moment[k], matrix_of(undeformed[k]), shape[0], result[k])


def fit(moment, undeformed, rest):
    """Return the transforms (B, 3, F) nearest to particles with moments (B, 3, F)."""
    out = moment.shape[-1], 3
    rows = transposed(moment), np.broadcast_to(undeformed, (*moment.shape[:-1], 3))
    return transposed(over(fits, rows, rest.record()[None], out=out))


@kernel
def gradients(transform, shape, result):
    for k in range(len(transform)):
        if transform.shape[1] == 3:
            matching.volume_gradient(transform[k], shape[0]['volume_linear'], result[k])
        else:
            matching.volume_gradient(transform[k], shape[0]['volume_quadratic'], result[k])


def volume_gradient(transform, rest):
    """Return the derivatives (B, 3, F) of the relative volume of transforms (B, 3, F)."""
    rows = transposed(transform)
    return transposed(over(gradients, [rows], rest.record()[None], out=rows.shape[-2:]))


def relative_volume(transform, rest):
    """Return the volumes (B,) of transforms (B, 3, F), as multiples of the rest volume."""
    return np.sum(volume_gradient(transform, rest) * transform, axis=(-2, -1)) / 3.0


@kernel
def nearest_volumes(transform, shape, result):
    scratch = np.empty((2, transform.shape[1], 3))
    for k in range(len(transform)):
        result[k, -1, 0] = matching.move_to_rest_volume(
            transform[k], shape[0], result[k, :-1], scratch[0], scratch[1], 1.0
        )


def of_rest_volume(transform, rest):
    """Return the nearest transforms (B, 3, F) of relative volume 1, and the volumes before."""
    rows = transposed(transform)
    out = rows.shape[-2] + 1, 3
    result = over(nearest_volumes, [rows], rest.record()[None], out=out)
    return transposed(result[..., :-1, :]), result[..., -1, 0]


@kernel
def all_degeneracies(transform, volume, shapes, result):
    bend_gram = shapes[0]['bend_gram']
    for k in range(len(transform)):
        elastic = matching.linear_block(transform[k])
        degeneracy = matching.degeneracy_of(transform[k], elastic, volume[k, 0, 0], bend_gram)
        result[k, 0, 0] = degeneracy


def degeneracy(transform, volume, rest):
    """Return how far (B,) transforms (B, 3, F) are beyond what a goal can follow."""
    rows = transposed(transform), np.asarray(volume)[..., None, None]
    return over(all_degeneracies, rows, rest.record()[None], out=(1, 1))[..., 0, 0]


@kernel
def blends(fitted, undeformed, beta, result):
    for k in range(len(fitted)):
        matching.blend(
            fitted[k], fitted[k], 0.0, beta[k, 0, 0], matrix_of(undeformed[k]), result[k]
        )


def blended(fitted, undeformed, beta):
    """Return β · fit + (1 − β) [R 0 0] of fits (B, 3, F)."""
    rows = transposed(fitted)
    stacks = rows, undeformed, np.asarray(beta)[..., None, None]
    return transposed(over(blends, stacks, out=rows.shape[-2:]))


def goals(centre, transform, rest):
    """Return the goals (B, 3, n) of transforms (B, 3, F) about centres (B, 3)."""
    features = rest.features[1 : 1 + transform.shape[-1]]
    return centre[..., None] + rest.scale * transform @ features


def padded(transform):
    """Return linear transforms (B, 3, 3) as those of all nine features."""
    wide = np.zeros((*transform.shape[:-1], 9))
    wide[..., : transform.shape[-1]] = transform
    return wide


# ---------------------------------------------------------------------------------- small matrices
@kernel
def inverses(matrices, cut, least, result):
    for k in range(len(matrices)):
        put_matrix(result[k], polar.symmetric_inverse(matrix_of(matrices[k]), cut, least))


def symmetric_inverse(matrices, cut, least):
    """Return the pseudo-inverses of positive semidefinite matrices (…, 3, 3)."""
    return over(inverses, [matrices], cut, least, out=(3, 3))


@kernel
def all_orthogonal_columns(matrices, result):
    for k in range(len(matrices)):
        columns, v = polar.orthogonal_columns(matrix_of(matrices[k]))
        for i in range(3):
            put_column(result[k, :3], i, columns[i])
            put_column(result[k, 3:], i, v[i])


def orthogonal_columns(matrices):
    """Return M V, with columns that are orthogonal, and the rotations V of M (…, 3, 3)."""
    result = over(all_orthogonal_columns, [matrices], out=(6, 3))
    return result[..., :3, :], result[..., 3:, :]


@kernel
def least_rotations(pairs, result):
    for k in range(len(pairs)):
        one, two = vector_of(pairs[k, 0]), vector_of(pairs[k, 1])
        put_matrix(result[k], polar.least_rotation(one, two))


def least_rotation(a, b):
    """Return the rotations (k, 3, 3) by the least angles that take unit vectors (k, 3) to b."""
    return over(least_rotations, [np.stack([a, b], axis=1)], out=(3, 3))


@kernel
def rotations_by_vectors(vectors, result):
    for k in range(len(vectors)):
        put_matrix(result[k], polar.rotation_by_vector(vector_of(vectors[k, 0])))


def rotation_by_vector(a):
    """Return the rotations (k, 3, 3) by vectors (k, 3)."""
    return over(rotations_by_vectors, [a[:, None]], out=(3, 3))


@kernel
def cube_roots(values, result):
    for k in range(len(values)):
        result[k] = matching.cube_root(values[k])


# -------------------------------------------------------------------------------------- plasticity
@kernel
def all_flowed(stretch, strained, limits, result):
    for k in range(len(stretch)):
        _, plastic = plasticity.flowed(
            matrix_of(stretch[k]),
            matrix_of(strained[k]),
            limits[k, 0, 0],
            limits[k, 0, 1],
            limits[k, 0, 2],
        )
        put_matrix(result[k], plastic)


def flowed(stretch, strained, yield_strain, creeping, largest_strain):
    """Return the plastic states (…, 3, 3) after a tick, for limits (…)."""
    limits = np.stack(
        np.broadcast_arrays(yield_strain, creeping, largest_strain, stretch[..., 0, 0])[:3], -1
    )
    return over(all_flowed, (stretch, strained[..., :3], limits[..., None, :]), out=(3, 3))


@kernel
def all_undeformed(moment, stretch, result):
    for k in range(len(moment)):
        plastic = matrix_of(stretch[k])
        put_matrix(result[k], plasticity.undeformed_of(matrix_of(moment[k]), plastic, True))


def undeformed(moment, stretch):
    """Return the goals without elastic deformation, R S_p, of moments (…, 3, F)."""
    return over(all_undeformed, (moment[..., :3], stretch), out=(3, 3))


# ----------------------------------------------------------------------------------------- regions
@kernel
def match_each(x, records, member, features, weighted, scale, centre, moment, posture, place):
    for k in range(len(records)):
        a, c = regions.region_moment(records[k], member, weighted, x, 0)
        put_vector(centre[k], vector_of(np.array(c) / records[k]['mass']))
        put_matrix(moment[k], matrix_of(np.array(a) / scale))
        rotation = polar.rotation_of(matrix_of(moment[k]))
        put_matrix(posture[k], rotation)
        regions.add_region_goals(
            records[k], member, features, vector_of(centre[k]),
            matrix_of(scale * posture[k]), place, 0,
        )  # fmt: skip


def match_regions(x, parts, rest):
    """Return centres (K, 3), moments (K, 3, 3) and goals (3, n) of regions at x (3, n)."""
    count = parts.count
    centre, moment, posture = (
        np.empty((count, 3)),
        np.empty((count, 3, 3)),
        np.empty((count, 3, 3)),
    )
    place = np.zeros(x.shape)
    match_each(
        np.ascontiguousarray(x), parts.records(), parts.particle, parts.features,
        parts.weighted_features, rest.scale, centre, moment, posture, place,
    )  # fmt: skip
    return centre, moment, place


def goals_at(world, index, x):
    """Return the goals (3, n) of a body with regions of a world at rest at x (3, n)."""
    state, record = world._state, world._state.bodies[index]
    state.positions(index)[:], state.velocities(index)[:] = x, 0.0
    world._integrator.fly(np.array([index]), np.zeros(3), 1e-12)
    first = record['first_goal']
    return state.q[:, first : first + record['count']] + record['origin'][:, None]


# ------------------------------------------------------------------------------------------ energy
@kernel
def all_shares(a, b, most, result):
    for k in range(len(a)):
        result[k] = share_for(a[k], b[k], most[k])


def shares_for(a, b, most):
    """Return shares (k,) of forces whose work a s + b s² is at most so much, all (k,)."""
    result = np.empty(len(a))
    all_shares(a, b, most, result)
    return result


@kernel
def keep(members, rows, most, result):
    """Write the share of impulses that is kept, and the energy before and after that, J."""
    result[1] = kinetic_energy(members)
    result[0] = keep_energy(members, rows, most[0])
    result[2] = kinetic_energy(members)


def kept(members, rows, most):
    """Return the share of impulses that is kept, and the energy before and after that, J."""
    result = np.empty(3)
    keep(members, rows, np.array([most]), result)
    return result
