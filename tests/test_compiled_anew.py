# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Everything compiled into an empty cache: what is compiled, by whom, and that the bits are the same.

The traps of a cache are tested with small kernels, in test_compiled. Here it takes a minute of two
processors, once: for any processor, while those of this processor are in the usual cache.

CI does that with the oldest packages, whose tests then run on it: COMPILED_FOR_ANY_PROCESSOR is
their virtual environment. There are `source`, `kernels`, the cache, and `printed`, which is what
kernel_worlds.py has printed.
"""

from dataclasses import dataclass
import os
import pathlib
import sys

from kernel_worlds import AHEAD, EVERYTHING, FOR_ANY_PROCESSOR, HASHES, TICKS, hashes, start
import pytest
from python_processes import ROOT, begun, finished, printed

pytestmark = pytest.mark.compile

NOT_OF_A_TICK = (
    'shape_matching.polar_decomposition.rotate_all',
    'collision.obstacles._distances',
)
"""Kernels that no simulation runs: they are compiled when they are called."""


@dataclass(frozen=True)
class CompiledAnew:
    """A cache that was empty, and what the processes that filled it have printed, line by line."""

    environment: dict
    printed: list[list[str]]
    folder: pathlib.Path = ROOT
    python: pathlib.Path | str = sys.executable

    def again(self, code):
        """Return what a process prints that finds everything compiled."""
        return printed(code, self.folder, self.python, **self.environment).splitlines()


def compiled_anew(cache, count, **environment):
    """Compile everything in some processes at once, and step a world."""
    environment |= {'NUMBA_CACHE_DIR': cache, 'NUMBA_DISABLE_JIT': None}
    processes = [begun(AHEAD + EVERYTHING + HASHES, **environment) for _ in range(count)]
    return CompiledAnew(environment, [finished(process).splitlines() for process in processes])


@pytest.fixture(scope='module')
def usual():
    """What a process prints whose kernels are in the usual cache."""
    return printed(EVERYTHING + HASHES).splitlines()


@pytest.fixture(scope='module')
def for_any_processor(tmp_path_factory, usual):
    """Where there are two processors, `compile_ahead` begins a second process: both compile."""
    folder = pathlib.Path(os.environ.get('COMPILED_FOR_ANY_PROCESSOR', 'nowhere')).absolute()
    if folder.exists():
        lines = (folder / 'printed').read_text().splitlines()
        # other versions of NumPy may round the start differently, as docs/explanation/time.md says
        if start(lines) == start(usual):
            environment = FOR_ANY_PROCESSOR | {'NUMBA_CACHE_DIR': folder / 'kernels'}
            python = folder / 'bin' / 'python'
            return CompiledAnew(environment, [lines], folder / 'source', python)
    return compiled_anew(tmp_path_factory.mktemp('cache'), 1, **FOR_ANY_PROCESSOR)


@pytest.fixture(scope='module')
def two_at_once(tmp_path_factory):
    """Compile for this processor, as two nodes do that are started together."""
    return compiled_anew(tmp_path_factory.mktemp('cache'), 2)


CASES = ['for_any_processor', pytest.param('two_at_once', marks=pytest.mark.slow)]


@pytest.mark.parametrize('case', CASES)
def test_everything_is_compiled_ahead_once(case, request):
    compiled = request.getfixturevalue(case)
    for process in compiled.printed:
        assert process[0].startswith('compiling the simulator for this machine, once: ')
        assert process[1].startswith('compiled in ')
    word, seconds = compiled.again(AHEAD)[0].split()
    assert word == 'ahead' and float(seconds) < 0.1


def test_each_kernel_is_compiled_ahead_for_one_set_of_types(for_any_processor):
    """A second one, of arrays that are read-only or not contiguous, takes the time once more."""
    (process,) = for_any_processor.printed
    kernels = [line for line in process if line.startswith('kernel ')]
    others = {line for line in kernels if not line.endswith(' 1')}
    assert others == {f'kernel softbody_ros.core.{name} 0' for name in NOT_OF_A_TICK}


@pytest.mark.parametrize('case', CASES)
def test_compiled_anew_or_before_for_this_processor_or_any_the_bits_are_the_same(
    case, usual, request
):
    compiled = request.getfixturevalue(case)
    assert len(hashes(usual)) == TICKS
    for process in compiled.printed:
        assert hashes(process) == hashes(usual)
    # from the cache
    assert hashes(compiled.again(EVERYTHING + HASHES)) == hashes(usual)
