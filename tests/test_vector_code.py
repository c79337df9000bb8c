# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The hot loops over particles consist of vector instructions, lest that is lost silently."""

from compiled_code import vector_instructions
import numpy as np
import pytest

from softbody_ros.core.body import BODY
from softbody_ros.core.compiled import is_compiled, kernel
from softbody_ros.core.geometry.vectors import put_matrix, put_vector
from softbody_ros.core.shape_matching import flight_map, moments
from softbody_ros.core.shape_matching.rest_shape import SHAPE

pytestmark = [
    pytest.mark.oldest,
    pytest.mark.skipif(not is_compiled(), reason='plain Python has no instructions'),
]
COUNT = 512


# each loop as a kernel of its own: in a whole tick other code has vector instructions, too
@kernel
def store_offsets(x, y):
    moments.store_offsets(x, 0, x.shape[1], (0.1, 0.2, 0.3), y, 0)


@kernel
def sums_of_tile(y, v, w, result):
    found = moments.sums_of_tile(moments.Tile(0, len(w), 0), y, 0, v, w)
    for k in range(5):
        put_vector(result[k], found[k])


@kernel
def moments_of_tile(y, q, w, result):
    for block in range(3):
        found = moments.moments_of_tile(moments.Tile(0, len(w), 0), y, 0, w, q, block)
        put_matrix(result[block], found)


@kernel
def write(x, v, q, to_x, to_v, bodies, shapes):
    flight_map.write(x, v, bodies[0], shapes[0], q, to_x, to_v)


FIELD = (3, COUNT)
ARRAYS = {
    store_offsets: [FIELD] * 2,
    sums_of_tile: [FIELD, FIELD, (COUNT,), (5, 3)],
    moments_of_tile: [FIELD, FIELD, (COUNT,), (3, 3, 3)],
    write: [FIELD] * 5,
}
"""Arguments of each."""
OPERATIONS = {
    'store_offsets': 3,
    'sums_of_tile': 36,
    'moments_of_tile': 24,
    'write': 156,
}
"""Of floats for one particle: as vectors there are at least as many instructions."""


def records():
    """Return one body and its shape."""
    bodies, shapes = np.zeros(1, BODY), np.zeros(1, SHAPE)
    bodies['count'] = shapes['count'] = COUNT
    bodies['mode'] = 2
    return bodies, shapes


@pytest.mark.parametrize('loop', ARRAYS, ids=lambda loop: loop.__name__)
def test_a_hot_loop_is_vectorised(loop):
    loop(*(np.ones(shape) for shape in ARRAYS[loop]), *(records() if loop is write else ()))
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
