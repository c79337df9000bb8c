# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rotations nearest to matrices, and what else is known of small matrices, against LAPACK."""

from hypothesis import example, given, settings, strategies
from kernels import symmetric_inverse
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core.shape_matching.polar_decomposition import rotation

pytestmark = pytest.mark.oldest

# as those of a compact body, of a part of a shell, of a sheet, and of something hardly inverted
WELL_CONDITIONED = [
    (1.0, 1.0, 1.0),
    (1.0, 0.9, 0.7),
    (1.0, 0.5, 0.3),
    (1.0, 0.9, 0.01),
    (1.0, 0.3, 1e-9),
    (1.0, 1.0, 0.0),
    (1.0, 0.8, -1e-3),
]
ILL_CONDITIONED = [
    (1.0, 1.0, -1.0),
    (1.0, 1.0, -0.5),
    (1.0, 0.5, -0.499),
    (1.0, 1e-3, 1e-4),
    (1.0, 1e-3, -1e-3),
    (1.0, 1e-9, 1e-9),
    (1.0, 1e-15, 0.0),
    (1.0, 0.0, 0.0),
    (0.0, 0.0, 0.0),
]


def turned(values, seed):
    """Return matrices (N, 3, 3) of signed singular values (N, 3), and the turns in them."""
    left, right = (
        Rotation.random(len(values), random_state=2 * seed + side).as_matrix() for side in (0, 1)
    )
    return (left * np.asarray(values)[:, None, :]) @ right, left @ right


def repeated(values, count=40):
    return np.repeat(np.array(values), count, axis=0)


def assert_nearest(R, matrices):
    """Of all proper rotations, R is to have the largest trace with the matrices, Σ ± σ."""
    assert np.abs(R @ R.swapaxes(-1, -2) - np.eye(3)).max() < 1e-13
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-13)
    sizes = np.linalg.svd(matrices, compute_uv=False)
    sizes[..., 2] *= np.where(np.linalg.det(matrices / sizes[..., :1, None]) < 0.0, -1.0, 1.0)
    trace = np.einsum('kij,kij->k', R, matrices / sizes[:, :1, None])
    assert trace == pytest.approx((sizes / sizes[:, :1]).sum(axis=-1), abs=1e-13)


# -------------------------------------------------------------------------------------- rotation
@pytest.mark.parametrize('size', [1e-90, 1e-6, 1.0, 1e6, 1e90])
def test_the_rotation_of_usual_shapes_is_found_to_the_last_digits(size):
    matrices, turn = turned(repeated(WELL_CONDITIONED), seed=1)
    R = rotation(size * matrices)
    assert np.abs(R - turn).max() < 1e-14
    assert np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() < 2e-15


def test_the_rotation_is_right_on_both_sides_of_the_limits_of_the_formula():
    """A fine grid of shapes: lines, sheets and inverted ones are as accurate as LAPACK."""
    second, third = np.meshgrid(np.linspace(0.0, 1.0, 201), np.linspace(-1.0, 1.0, 401))
    grid = np.stack([np.ones(second.size), second.ravel(), (third * second).ravel()], axis=1)
    # where two singular values are as far from zero the nearest rotation is not unique
    grid = grid[grid[:, 1] + grid[:, 2] > 0.01]
    matrices, turn = turned(grid, seed=3)
    gap = grid[:, 1] + grid[:, 2]
    assert np.all(np.abs(rotation(matrices) - turn).max(axis=(1, 2)) < 2e-14 / gap)


@pytest.mark.parametrize('size', [1e-200, 1e-90, 1.0, 1e90, 1e200])
def test_all_matrices_of_a_stack_get_the_nearest_proper_rotation(size):
    shapes = repeated(WELL_CONDITIONED + ILL_CONDITIONED[:-1])
    matrices, _ = turned(shapes, seed=4)
    assert_nearest(rotation(size * matrices), size * matrices)


def test_nothing_at_all_is_not_turned_inside_out():
    matrices = turned(repeated(WELL_CONDITIONED), seed=5)[0]
    matrices[::7] = 0.0
    R = rotation(matrices)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() < 1e-14


@settings(max_examples=300)
@example([[0.0] * 8 + [5e-324]])
@given(
    strategies.lists(
        strategies.lists(strategies.floats(-1e3, 1e3), min_size=9, max_size=9),
        min_size=1,
        max_size=4,
    )
)
def test_any_matrix_gets_the_nearest_proper_rotation(numbers):
    matrices = np.array(numbers).reshape(-1, 3, 3)
    R = rotation(matrices)
    assert np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() < 1e-13
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-13)
    u, _, vt = np.linalg.svd(matrices)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    # where two are equally near they need not be the same one
    trace, best = (np.einsum('kij,kij->k', each, matrices) for each in (R, u @ vt))
    assert np.abs(trace - best).max() <= 1e-13 * max(np.abs(matrices).max(), 1e-300)


def test_stacks_have_any_shape():
    matrices, _ = turned(repeated(WELL_CONDITIONED + ILL_CONDITIONED, 3), seed=7)
    flat = rotation(matrices)
    assert np.array_equal(rotation(matrices.reshape(4, 12, 3, 3)).reshape(-1, 3, 3), flat)
    assert rotation(matrices[:0]).shape == (0, 3, 3)


# -------------------------------------------------------------------------------- small matrices
def symmetric(values, seed):
    axes = Rotation.random(len(values), random_state=seed).as_matrix()
    result = (axes * np.asarray(values)[:, None, :]) @ axes.swapaxes(1, 2)
    return (result + result.swapaxes(1, 2)) / 2.0


@pytest.mark.parametrize('count', [1, 40])
@pytest.mark.parametrize('size', [1e-60, 1.0, 1e60])
@pytest.mark.parametrize(
    'values',
    [(1.0, 1.0, 1.0), (1.0, 0.5, 0.5), (1.0, 1.0, 0.02), (1.0, 1.0, 1e-6), (1.0, 1.0, 0.0),
     (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)],
)  # fmt: skip
def test_the_inverse_of_a_symmetric_matrix_is_its_pseudo_inverse(values, size, count):
    matrices = size * symmetric(repeated([values], count), seed=11)
    inverse = symmetric_inverse(matrices, 1e-12, 1e-200)
    expected = np.linalg.pinv(matrices, rcond=1e-12, hermitian=True)
    error = np.abs(inverse - expected).max(axis=(1, 2))
    assert np.all(error <= 1e-9 * np.abs(expected).max(axis=(1, 2)))
    assert np.array_equal(inverse, inverse.swapaxes(1, 2)) or min(values) < 0.01


def test_what_is_smaller_than_the_least_has_no_inverse():
    matrices = np.stack([np.diag([2.0, 3.0, 4.0]), 1e-20 * np.eye(3), np.diag([1.0, 1.0, 1e-13])])
    inverse = symmetric_inverse(matrices, 1e-12, least=1e-3)
    expected = np.diag([1 / 2, 1 / 3, 1 / 4]), np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0])
    assert inverse == pytest.approx(np.stack(expected))
