# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Kernels as plain Python: where there is no numba, and to check what machine code hides."""

import json
import pathlib

import numpy as np
import pytest
from python_processes import WITHOUT_NUMBA, printed

from softbody_ros.core import compiled

WORLD = """
from softbody_ros.core import compiled, BodyConfig, World, WorldConfig
world = World(WorldConfig(bodies=(BodyConfig(name='ball', subdivisions=1, position=(0, 0, 0.5)),)))
world.step(10)
assert world.positions('ball')[:, 2].min() > -1e-6
print(compiled.notice())
"""
TOO_NEW = "raise ImportError('Numba needs NumPy 2.3 or less.\\nGot NumPy 2.9.')"


def test_without_numba_a_small_world_steps_and_one_sentence_says_so():
    assert printed(WITHOUT_NUMBA + WORLD) == (
        'numba is not installed: bodies are simulated by plain Python, about 1000 times slower; '
        'pip install numba\n'
    )


def test_a_numba_that_refuses_numpy_is_done_without_and_says_why(tmp_path):
    (tmp_path / 'numba.py').write_text(TOO_NEW)
    path = f'{tmp_path}:{pathlib.Path(__file__).parent.parent}'
    assert printed(WORLD, PYTHONPATH=path) == (
        'numba cannot be loaded (Numba needs NumPy 2.3 or less. Got NumPy 2.9): bodies are '
        'simulated by plain Python, about 1000 times slower; pip install --upgrade numba\n'
    )


def test_a_node_without_numba_warns_and_runs(graph, tmp_path):
    (tmp_path / 'numba.py').write_text(TOO_NEW)
    path = f'{tmp_path}:{pathlib.Path(__file__).parent.parent}'
    process = graph.process(
        '--ros-args', '-p', 'ball.subdivisions:=0', environment={'PYTHONPATH': path}
    )
    lines = [process.stderr.readline() for _ in range(2)]
    assert '[WARN]' in lines[0] and 'numba cannot be loaded' in lines[0]
    assert 'simulating ball (12 vertices)' in lines[1]


@pytest.mark.skipif(not compiled.is_compiled(), reason='kernels are plain Python')
def test_plain_python_computes_the_same_and_divides_by_no_zero():
    """Not to the last bit: powers and functions of the C library may differ by it."""
    code = """
import json
import numpy
from softbody_ros.core import warm_up
numpy.seterr(divide='raise')  # it would be inf or nan in machine code
world = warm_up.everything(subdivisions=0)
world.step(2)
print(json.dumps([world.positions(name).tolist() for name in world.names]))
"""
    machine, plain = (json.loads(printed(code, NUMBA_DISABLE_JIT=jit)) for jit in (None, '1'))
    for one, other in zip(machine, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-10)


@pytest.mark.slow  # the kernels of a tick do so above
@pytest.mark.parametrize('subdivisions', [0, 1])
def test_kernels_divide_by_no_zero(subdivisions):
    """Python raises an exception at what is inf or nan in machine code."""
    code = f"""
import numpy
from softbody_ros.core import warm_up
numpy.seterr(divide='raise')
for function in (warm_up.everything, warm_up._body):
    function.__defaults__ = ({subdivisions},)
warm_up.warm_up()
"""
    printed(code, NUMBA_DISABLE_JIT='1')
