# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact problem of rigid bodies alone, with an operator that is written for them."""

import math

from contact_problems import width
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact.problem import RIGID_MODES, Problem
from softbody_ros.core.contact.rows import ROW
from softbody_ros.core.contact.solver import solve


@kernel
def solve_all(rows, jacobian, members, tolerance, result):
    problem = Problem(
        rows,
        jacobian.reshape(-1, jacobian.shape[3]),
        np.full(members, RIGID_MODES),
        np.empty(0),
        np.zeros((3, members, jacobian.shape[3])),
        np.empty((2, 3, 0)),
        np.empty((members, members, RIGID_MODES, RIGID_MODES)),
        np.empty((members, members), np.bool_),
    )
    result[0], sweeps, steps = solve(problem, tolerance, 1.0)
    result[1], result[2] = sweeps, steps


@pytest.mark.parametrize('seed', range(8))
@pytest.mark.parametrize(
    ('members', 'friction'), [(1, 0.0), (1, 0.2), (2, 0.2), (5, 0.0), (5, 0.1)]
)
def test_a_solution_meets_the_laws_of_contact(members, friction, seed):
    random = np.random.default_rng(seed)
    count = 8 * members
    rows = np.zeros(count, ROW)
    rows['one'] = random.integers(0, members, count)
    rows['two'] = random.integers(-1, members, count)
    rows['two'][rows['two'] == rows['one']] = -1
    # contacts around bodies of different masses, with inertia 0.1 per mass
    mass = random.choice([0.5, 1.0, 5.0], members)
    frames = Rotation.random(count, random_state=seed).as_matrix()
    arms = 0.5 * random.normal(size=(count, 2, 1, 3))
    turning = np.cross(arms, frames[:, None]) / math.sqrt(0.1)
    jacobian = np.concatenate([np.broadcast_to(frames[:, None], turning.shape), turning], axis=3)
    for side, sign in ((0, 1.0), (1, -1.0)):
        index = rows['one' if side == 0 else 'two']
        jacobian[:, side] *= sign / np.sqrt(mass[index])[:, None, None]
    jacobian[rows['two'] < 0, 1] = 0.0
    rows['bias'] = random.normal(size=(count, 3)) - (0.5, 0.0, 0.0)
    rows['compliance'] = 0.01
    rows['friction'] = friction
    rows['viscosity'] = -1.0
    rows['base'][:, 0] = random.choice([0.0, 0.2], count)
    rows['radius'] = 0.0
    result = np.zeros(3)
    room = np.zeros((count, 2, 3, width(RIGID_MODES) + 1 - RIGID_MODES))
    room[..., -1] = np.nan
    solve_all(rows, np.concatenate([jacobian, room], axis=3), members, 1e-10, result)
    assert result[0] <= 1e-10
    # the same operator, written independently
    matrix = np.zeros((count, 3, members, RIGID_MODES))
    for k in range(count):
        matrix[k, :, rows['one'][k]] = jacobian[k, 0]
        if rows['two'][k] >= 0:
            matrix[k, :, rows['two'][k]] += jacobian[k, 1]
    matrix = matrix.reshape(3 * count, -1)
    force = rows['force'].ravel()
    s = (rows['bias'].ravel() + 0.01 * force + matrix @ (matrix.T @ force)).reshape(-1, 3)
    total = rows['base'] + rows['force']
    assert total[:, 0].min() >= 0.0
    assert s[:, 0].min() > -1e-8
    assert np.abs(total[:, 0] * s[:, 0]).max() < 1e-7
    size = np.linalg.norm(total[:, 1:], axis=1)
    limit = rows['friction'] * total[:, 0]
    assert (size <= limit + 1e-9).all()
    slip = np.linalg.norm(s[:, 1:], axis=1)
    sticking = size < limit - 1e-6
    assert slip[sticking] == pytest.approx(0.0, abs=1e-8)
    sliding = slip > 1e-6
    against = (total[:, 1:] * s[:, 1:]).sum(axis=1)
    assert against[sliding] == pytest.approx(-(limit * slip)[sliding], abs=1e-7)
