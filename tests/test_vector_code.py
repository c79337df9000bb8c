# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The hot loops over particles consist of vector instructions, lest that is lost silently."""

from compiled_code import vector_instructions
import llvmlite.binding
import numpy as np
import pytest

from softbody_ros.core.compiled import is_compiled, kernel
from softbody_ros.core.shape_matching import flight, moments, rigid_motion

pytestmark = pytest.mark.skipif(not is_compiled(), reason='plain Python has no instructions')
COUNT = 512


# each loop as a kernel of its own: in a whole tick other code has vector instructions, too
@kernel
def predict_row(x, v, y):
    moments.predict_row(x, v, 0.1, 0.2, y)


@kernel
def product_row(q, y):
    moments.feature_row((q, q, q), 4, y)


@kernel
def write_positions(y, q, x):
    flight.write_positions(y, (q, q, q), 0.1, 0.2, (0.3, 0.4, 0.5), x)


@kernel
def write_velocities(y, u, q, v):
    m, g = (0.3, 0.4, 0.5), (0.6, 0.7, 0.8)
    flight.write_velocities((y, y, y), u, (q, q, q), 0.1, 0.2, m, g, v)


@kernel
def add_products(t, q, x):
    flight.add_products((q, q, q), t, 0, x)


@kernel
def add_multiples(p, x):
    flight.add_multiples((p, p, p), (0.1, 0.2, 0.3), x)


@kernel
def add_rigid_displacement(x, v):
    linear, angular, centre = (0.1, 0.2, 0.3), (0.4, 0.5, 0.6), (0.7, 0.8, 0.9)
    rigid_motion.add_rigid_displacement(x, v, 0, x.shape[1], centre, linear, angular, 0.1)


ROWS = {
    predict_row: [(COUNT,)] * 3,
    product_row: [(COUNT,)] * 2,
    write_positions: [(COUNT,)] * 3,
    write_velocities: [(COUNT,)] * 4,
    add_products: [(9, 3), (COUNT,), (COUNT,)],
    add_multiples: [(COUNT,)] * 2,
    add_rigid_displacement: [(3, COUNT)] * 2,
}
"""Arguments of each."""
OPERATIONS = {
    'predict_row': 3,
    'product_row': 1,
    'write_positions': 8,
    'write_velocities': 10,
    'add_products': 10,
    'add_multiples': 6,
    'add_rigid_displacement': 12,
}
"""Of floats, about, for one particle: as vectors there are at least as many instructions."""
MANY_ARRAYS = {'add_rigid_displacement'}
"""More than the oldest supported compiler checks for overlap: it leaves this loop scalar."""


@pytest.mark.parametrize('loop', ROWS, ids=lambda loop: loop.__name__)
def test_a_hot_loop_is_vectorised(loop):
    if loop.__name__ in MANY_ARRAYS and llvmlite.binding.llvm_version_info < (15,):
        pytest.skip('six arrays are too many for LLVM 14: other loops tell whether it vectorises')
    loop(*(np.ones(shape) for shape in ROWS[loop]))
    assert vector_instructions(loop) >= OPERATIONS[loop.__name__]


def test_a_sum_in_a_fixed_order_is_not():
    """The count tells one from the other: floats added one after the other need scalars."""

    @kernel
    def total(x):
        result = 0.0
        for i in range(len(x)):
            result += x[i]
        return result

    total(np.ones(COUNT))
    assert vector_instructions(total) == 0
