# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled, kept and done without: caches have traps, each with a test."""

import json
import shutil
import signal

from compiled_code import vector_instructions
from kernel_worlds import FOR_ANY_PROCESSOR
import numpy as np
import pytest
from python_processes import WITHOUT_NUMBA, begun, finished, printed

from softbody_ros.core import BodyConfig, World, WorldConfig, compiled
from softbody_ros.core.compiled import kernel

HELPERS = """
from tiny.compiled import helper

@helper
def weighted(a):
    return {factor} * a
"""
KERNELS = """
from tiny.compiled import kernel
from tiny.helpers import weighted

@kernel
def total(x):
    result = 0.0
    for i in range(x.shape[0]):
        result += weighted(x[i])
    return result
"""
CALL = """
import json
import numpy as np
from tiny import compiled
from tiny.kernels import total
result = total(np.arange(5.0))
total(np.arange(3))
stats = getattr(total, 'stats', None)
print(json.dumps({
    'result': result,
    'compiled': sum(stats.cache_misses.values()) if stats else None,
    'loaded': sum(stats.cache_hits.values()) if stats else None,
    'notice': compiled.notice(),
}))
"""
MARK = 'from tiny import compiled, kernels; compiled.mark_complete()'
IS_COMPLETE = 'from tiny import compiled; print(compiled.is_complete())'


class Tiny:
    """A package of one kernel with a helper in another file, and a place for its cache."""

    def __init__(self, folder):
        self.folder, self.package = folder, folder / 'tiny'
        self.package.mkdir()
        (self.package / '__init__.py').touch()
        shutil.copy(compiled.__file__, self.package)
        (self.package / 'kernels.py').write_text(KERNELS)
        self.change_helper(2.0)
        self.cache = folder / 'cache'
        self.environment = {
            'NUMBA_CACHE_DIR': self.cache, 'NUMBA_DISABLE_JIT': None, 'NUMBA_CPU_NAME': None,
            'XDG_CACHE_HOME': folder / 'user',
        }  # fmt: skip

    def change_helper(self, factor):
        (self.package / 'helpers.py').write_text(HELPERS.format(factor=factor))

    def begun(self, code=CALL, **environment):
        return begun(code, self.folder, **self.environment | environment)

    def printed(self, code=CALL, **environment):
        return finished(self.begun(code, **environment)).strip()

    def call(self, before='', **environment):
        return json.loads(self.printed(before + CALL, **environment))

    def without_places(self):
        """Return an environment in which no cache can be written, whoever the tests run as."""
        (self.folder / 'file').touch()
        shutil.rmtree(self.package / '__pycache__', ignore_errors=True)
        (self.package / '__pycache__').touch()
        nowhere = self.folder / 'file' / 'folder'
        return {'NUMBA_CACHE_DIR': nowhere, 'XDG_CACHE_HOME': nowhere}


@pytest.fixture
def tiny(tmp_path):
    return Tiny(tmp_path)


# ------------------------------------------------------------------------------------------- cache
@pytest.mark.oldest
def test_a_second_process_compiles_nothing(tiny):
    """Numba lets its cache be replaced by a name that it might change: then this fails."""
    first = tiny.call()
    assert (first['result'], first['compiled'], first['loaded']) == (20.0, 2, 0)
    second = tiny.call()
    assert (second['result'], second['compiled'], second['loaded']) == (20.0, 0, 2)
    assert first['notice'] == second['notice'] == ''


@pytest.mark.oldest
def test_a_helper_that_changes_in_another_file_never_leaves_old_machine_code(tiny):
    assert tiny.call()['result'] == 20.0
    tiny.change_helper(3.0)
    assert tiny.call()['result'] == 30.0
    tiny.change_helper(2.0)  # back to a version that is still kept
    back = tiny.call()
    assert (back['result'], back['compiled']) == (20.0, 0)


@pytest.mark.oldest
def test_options_of_numba_and_the_processor_have_machine_code_of_their_own(tiny):
    assert tiny.call()['compiled'] == 2
    assert tiny.call(NUMBA_BOUNDSCHECK='1')['compiled'] == 2
    assert tiny.call(**FOR_ANY_PROCESSOR)['compiled'] == 2
    assert tiny.call()['compiled'] == 0


def test_two_processes_that_compile_at_once_into_one_empty_cache_are_both_right(tiny):
    both = [tiny.begun(), tiny.begun()]
    assert [json.loads(finished(process))['result'] for process in both] == [20.0, 20.0]
    third = tiny.call()
    assert (third['result'], third['compiled']) == (20.0, 0)
    assert not [path for path in tiny.cache.rglob('*') if path.is_file() and path.suffix != '.nbc']


@pytest.mark.oldest
def test_half_a_file_is_compiled_again(tiny):
    tiny.call()
    one, two = tiny.cache.rglob('*.nbc')
    one.write_bytes(one.read_bytes()[:-9])
    two.write_bytes(b'')
    again = tiny.call()
    assert (again['result'], again['compiled']) == (20.0, 2)
    assert tiny.call()['compiled'] == 0


def test_the_cache_lies_beside_the_sources_or_with_the_users_other_ones(tiny):
    tiny.call(NUMBA_CACHE_DIR=None)
    assert list((tiny.package / '__pycache__').rglob('*.nbc'))
    nowhere = tiny.without_places()
    del nowhere['XDG_CACHE_HOME']
    assert tiny.call(**nowhere)['notice'] == ''
    assert list((tiny.folder / 'user' / 'softbody_ros').rglob('*.nbc'))


@pytest.mark.oldest
def test_where_no_place_is_writable_it_works_and_says_so_once(tiny):
    nowhere = tiny.without_places()
    for _ in range(2):
        answer = tiny.call(**nowhere)
        assert (answer['result'], answer['compiled']) == (20.0, 2)
        assert answer['notice'].startswith('the compiled simulator cannot be kept (nowhere in ')
        assert 'NUMBA_CACHE_DIR' in answer['notice'] and '\n' not in answer['notice']
    process = tiny.begun(**nowhere)
    _, errors = process.communicate(timeout=60)
    assert errors == ''


def test_a_full_disk_ends_nothing(tiny):
    limit = 'import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n'
    answer = tiny.call(before=limit, PYTHONDONTWRITEBYTECODE='1')
    assert answer['result'] == 20.0
    assert 'cannot be kept (File too large in ' in answer['notice']
    assert not [path for path in tiny.cache.rglob('*') if path.is_file()]


def test_kernels_of_other_folders_are_not_kept(tiny):
    tiny.package.joinpath('kernels.py').rename(tiny.folder / 'elsewhere.py')
    code = CALL.replace('tiny.kernels', 'elsewhere')
    for _ in range(2):
        assert json.loads(tiny.printed(code))['result'] == 20.0
    assert not list(tiny.folder.rglob('*.nbc'))


def test_what_is_complete_is_known_for_each_processor_and_version(tiny):
    assert tiny.printed(IS_COMPLETE) == 'False'
    tiny.printed(MARK)
    assert tiny.printed(IS_COMPLETE) == 'True'
    assert tiny.printed(IS_COMPLETE, **FOR_ANY_PROCESSOR) == 'False'
    tiny.change_helper(3.0)
    assert tiny.printed(IS_COMPLETE) == 'False'


def test_where_nothing_can_be_kept_nothing_is_complete(tiny):
    nowhere = tiny.without_places()
    assert tiny.printed(f'{MARK}; print(compiled.is_complete())', **nowhere) == 'False'


def test_a_complete_cache_that_others_have_installed_is_used(tiny):
    tiny.printed(CALL + MARK)
    refuse = """
import tempfile
def refuse(*_, **__):
    raise OSError
tempfile.TemporaryFile = refuse
"""
    answer = tiny.call(before=refuse)
    assert (answer['compiled'], answer['notice']) == (0, '')


def test_caches_of_old_versions_are_removed_but_for_the_newest(tiny):
    tiny.printed(f"""
from tiny import compiled, kernels
for factor in range({compiled.KEPT + 3}):
    with open(compiled.SOURCES / 'helpers.py', 'a') as helpers:
        helpers.write('# another version')
    compiled.digest.cache_clear(), compiled.cache_folder.cache_clear()
    compiled.mark_complete()
""")
    tiny.call()
    assert len(list(tiny.cache.iterdir())) == compiled.KEPT + 1
    assert tiny.call()['compiled'] == 0


def test_without_compiling_the_same_is_computed(tiny):
    answer = tiny.call(NUMBA_DISABLE_JIT='1')
    assert (answer['result'], answer['compiled']) == (20.0, None)
    assert answer['notice'].startswith('NUMBA_DISABLE_JIT is set: bodies are simulated by plain')
    assert not tiny.cache.exists()
    assert tiny.call(before=WITHOUT_NUMBA)['result'] == 20.0


@pytest.mark.oldest
@pytest.mark.skipif(not compiled.is_compiled(), reason='nothing is compiled')
def test_a_helper_becomes_machine_code_only_as_a_part_of_kernels():
    @compiled.helper
    def doubled(a):
        return a + a

    @kernel
    def total(x):
        result = 0.0
        for i in range(x.shape[0]):
            result += doubled(x[i])
        return result

    assert total(np.arange(4.0)) == 12.0
    (part,), (whole,) = doubled.overloads.values(), total.overloads.values()
    machine_code = whole.library._codegen._engine
    assert machine_code.is_symbol_defined(whole.fndesc.mangled_name)
    assert not machine_code.is_symbol_defined(part.fndesc.mangled_name)


@pytest.mark.oldest
@pytest.mark.skipif(not compiled.is_compiled(), reason='nothing is compiled')
def test_only_helpers_that_make_or_return_arrays_count_references():
    @compiled.helper
    def last_of(pair):
        total = 0.0
        for array in pair:
            rest = array[1:]
            total += rest[len(rest) - 1]
        return total

    @compiled.helper
    def rest_of(array):
        return array[1:]

    @compiled.helper
    def sum_of_counted(count):
        return np.arange(count).sum()

    @compiled.helper
    def sum_of_chosen(array, places):
        return array[places].sum()

    @kernel
    def total(x, y, places):
        rest = rest_of(x)
        return last_of((rest, y)) + sum_of_counted(4) + sum_of_chosen(y, places)

    assert total(np.arange(5.0), np.arange(3.0), np.array([0, 2])) == 4.0 + 2.0 + 6.0 + 2.0
    counts = {
        function.__name__: part.target_context.enable_nrt
        for function in (last_of, rest_of, sum_of_counted, sum_of_chosen)
        for part in function.overloads.values()
    }
    assert counts == {
        'last_of': False, 'rest_of': True, 'sum_of_counted': True, 'sum_of_chosen': True,
    }  # fmt: skip


@pytest.mark.oldest
@pytest.mark.skipif(not compiled.is_compiled(), reason='nothing is compiled')
def test_ticks_free_all_memory_that_they_take():
    from numba.core.runtime import _nrt_python, rtsys

    modes = 'rigid', 'linear', 'quadratic', 'rigid'
    bodies = tuple(
        BodyConfig(name=f'body{i}', mesh='box', mode=mode, size=0.4, position=(0.1 * i, 0.0, z))
        for i, (mode, z) in enumerate(zip(modes, (0.3, 0.7, 1.1, 1.5), strict=True))
    )
    world = World(WorldConfig(time_step=1 / 60, bodies=bodies))
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        world.step(60)
        held = 1  # the contacts that are remembered
        after = rtsys.get_allocation_stats()
        assert after.alloc - before.alloc > 60
        assert after.alloc - before.alloc == after.free - before.free + held
    finally:
        _nrt_python.memsys_disable_stats()


# --------------------------------------------------------------------------- ahead of a start
STOPPED = """
import numpy as np
from softbody_ros.core import compiled, warm_up

@compiled.kernel
def total(x):
    result = 0.0
    for i in range(x.shape[0]):
        result += x[i]
    return result

looks = []
def is_stopped():
    looks.append(1)
    return len(looks) > 5

warm_up.warm_up = lambda before_contact: total(np.ones(3))
print(warm_up.compile_ahead(print, print, is_stopped), len(looks), compiled.is_complete())
"""


def test_a_second_process_helps_until_the_first_one_has_done(tmp_path):
    """It is ended then, and whether it gets anywhere does not matter."""
    code = f"""
import os, time
from softbody_ros.core import warm_up
warm_up._processors = lambda: 2
for waiting, begun in (('time.sleep(60)', {str(tmp_path / 'one')!r}),
                       ('1 / 0', {str(tmp_path / 'two')!r})):
    program = 'import time, pathlib; pathlib.Path(' + repr(begun) + ').touch(); ' + waiting
    warm_up.SECOND_PROCESS = program
    begin = time.monotonic()
    with warm_up._second_process():
        while not os.path.exists(begun) and time.monotonic() < begin + 20.0:
            time.sleep(0.01)
    print(os.path.exists(begun), time.monotonic() < begin + 30.0)
"""
    said = printed(code, NUMBA_CACHE_DIR=tmp_path / 'cache', NUMBA_DISABLE_JIT=None)
    assert said == 'True True\n' * 2


def test_on_one_processor_no_second_process_is_begun(tmp_path):
    code = """
import os
from softbody_ros.core import warm_up
os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
warm_up.subprocess = None
with warm_up._second_process():
    print('alone')
"""
    assert printed(code, NUMBA_CACHE_DIR=tmp_path, NUMBA_DISABLE_JIT=None) == 'alone\n'


HELP = """
import os
from softbody_ros.core import compiled, warm_up
warm_up.compile_other_half({parent})
print(len(list(compiled.cache_folder().glob('*.nbc'))))
"""


def test_the_second_process_ends_when_the_first_one_is_no_more(tmp_path):
    code = HELP.format(parent=-1)
    assert printed(code, NUMBA_CACHE_DIR=tmp_path, NUMBA_DISABLE_JIT=None) == '0\n'


def test_the_second_process_has_something_to_compile():
    """It is allowed to fail, and would do so silently."""
    printed(HELP.format(parent='os.getppid()'), NUMBA_DISABLE_JIT='1')


@pytest.mark.oldest
def test_compiling_can_be_stopped(tmp_path):
    said = printed(STOPPED, NUMBA_CACHE_DIR=tmp_path, NUMBA_DISABLE_JIT=None).splitlines()
    assert said[1:] == ['False 6 False']


@pytest.mark.parametrize(
    'signal_number', [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_while_the_node_compiles_ends_it_cleanly(graph, tmp_path, signal_number):
    process = graph.process(environment={'NUMBA_CACHE_DIR': str(tmp_path)})
    assert 'compiling the simulator for this machine, once' in process.stderr.readline()
    process.send_signal(signal_number)
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (0, '')
    assert 'Traceback' not in errors


# ------------------------------------------------------------------------------------ machine code
@kernel
def _blended(x, y):
    """Add what vectorises."""
    for i in range(x.shape[0]):
        y[i] = 0.5 * x[i] + y[i]


@kernel
def _folded(x):
    """Add in a strict order, which does not."""
    total = 0.0
    for i in range(x.shape[0]):
        total = 0.5 * total + x[i]
    return total


@pytest.mark.oldest
@pytest.mark.skipif(not compiled.is_compiled(), reason='kernels are plain Python')
def test_instructions_on_several_numbers_are_counted():
    x = np.ones(100)
    _blended(x, x.copy())
    _folded(x)
    assert vector_instructions(_blended) >= 2
    assert vector_instructions(_folded) == 0
