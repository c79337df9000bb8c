# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sums over particles and maps of them, in blocks or not."""

import numpy as np
import pytest

from softbody_ros.core.sums import BLOCK, mapped, sums, weighted

COUNTS = [1, 5, 642, BLOCK // 10, BLOCK // 10 + 1, BLOCK, BLOCK + 1, 20_000]


@pytest.mark.parametrize('count', COUNTS)
@pytest.mark.parametrize(('bodies', 'rows', 'columns'), [(1, 3, 10), (4, 3, 4), (2, 6, 1)])
def test_sums_are_products_with_the_transpose(count, bodies, rows, columns):
    random = np.random.default_rng(count)
    a = random.normal(size=(bodies, rows, count))
    b, c = random.normal(size=(columns, count)), random.normal(size=(bodies, columns, count))
    assert sums(a, b) == pytest.approx(np.einsum('bin,jn->bij', a, b), abs=1e-10)
    assert sums(a, c) == pytest.approx(np.einsum('bin,bjn->bij', a, c), abs=1e-10)
    assert sums(a[0], b) == pytest.approx(a[0] @ b.T, abs=1e-10)
    assert weighted(a, b[0]) == pytest.approx(a @ b[0], abs=1e-10)


def test_sums_of_float32_are_added_up_in_float64():
    ones = np.ones((1, 1, 3 * BLOCK), dtype=np.float32)
    assert sums(ones, ones).dtype == np.float64


@pytest.mark.parametrize('count', COUNTS)
def test_maps_are_products(count):
    random = np.random.default_rng(count)
    a, b = random.normal(size=(2, 4, 3, 10)), random.normal(size=(10, count))
    assert mapped(a, b) == pytest.approx(a @ b, abs=1e-12)
    turns, x = random.normal(size=(4, 3, 3)), random.normal(size=(4, 3, count))
    assert mapped(turns, x) == pytest.approx(turns @ x, abs=1e-12)
