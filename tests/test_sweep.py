# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `sweep`: its runs are the same whatever makes them, and none is lost or half."""

import csv
import os
import pathlib
import re
import resource
import signal
import subprocess
import sys
import time

import numpy as np
from PIL import Image
import psutil
import pytest
import zarr

from softbody_ros.core import ConfigError
from softbody_ros.ensemble import sweep as command
from softbody_ros.ensemble.encoding import encoded
from softbody_ros.ensemble.mesh_transfer import read_meshes
from softbody_ros.ensemble.outcomes import names_of, outcomes
from softbody_ros.ensemble.plot import _texts, draw_plot
from softbody_ros.ensemble.running import BodyRecord, Recording, record, run
from softbody_ros.ensemble.spec import read_spec
from softbody_ros.ensemble.store import Store, attributes_of, stored

pytestmark = pytest.mark.usefixtures('compiled_ahead')
ROOT = pathlib.Path(__file__).parent.parent
SHEET = 'v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n'
SCENE = """
/**:
  ros__parameters:
    bodies: [ball, sheet]
    obstacles: [ground, post]
    ball: {subdivisions: 1, size: 0.2, position: [0.0, 0.0, 0.25]}
    sheet: {mesh: sheet.obj, size: 0.2, position: [1.0, 0.0, 0.1]}
    post: {type: sphere, size: [0.1, 0.1, 0.1], position: [0.1, 0.0, 0.0]}
"""
SPEC = """
scene: scene.yaml
seconds: 2
fps: 60
seed: 7
count: 3
vary:
  ball.stiffness: [0.2, 0.8]
  ball.bounciness: {uniform: [0, 1]}
  sheet.mode: [rigid, linear]
"""
RUNS = 12
FAILING = """
seconds: 0
vary:
  ball.subdivisions: [0]
  ball.regions.count: [0, 12, 13]
"""


def write(folder, spec, scene=SCENE):
    (folder / 'sheet.obj').write_text(SHEET)
    (folder / 'scene.yaml').write_text(scene)
    (folder / 'spec.yaml').write_text(spec)


@pytest.fixture
def run_main(monkeypatch, tmp_path):
    """Run the command in this process and a folder; leave the signals as they were."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path, SPEC)
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    yield lambda *arguments: command.main([str(each) for each in arguments])
    for number, handler in before:
        signal.signal(number, handler)


def await_that(condition, what, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, what
        time.sleep(0.02)
    return found


@pytest.fixture(scope='module')
def scheduler(tmp_path_factory):
    """The address of a Dask cluster: a scheduler and two workers, which have none of the files."""
    folder = tmp_path_factory.mktemp('cluster')
    address = folder / 'scheduler.json'
    dask = [sys.executable, '-m', 'distributed.cli.dask_']
    options = ['--no-dashboard', '--scheduler-file', str(address)]
    commands = [
        ['scheduler', '--host', '127.0.0.1', '--port', '0', *options],
        ['worker', '--nworkers', '2', '--nthreads', '1', *options],
    ]
    processes = []
    try:
        with (folder / 'log').open('w') as log:
            for last, *arguments in commands:
                processes.append(
                    subprocess.Popen(
                        [*dask[:2], dask[2] + last, *arguments],
                        cwd=folder, env=os.environ | {'PYTHONPATH': str(ROOT)},
                        stdout=log, stderr=log,
                    )
                )  # fmt: skip
                await_that(address.exists, (folder / 'log').read_text)
        yield re.search(r'tcp://[\d.:]+', address.read_text())[0]
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def files(store):
    """Return the bytes of all runs, by path."""
    runs = store / 'runs.zarr'
    return {
        str(path.relative_to(runs)): path.read_bytes()
        for path in sorted(runs.rglob('*'))
        if path.is_file()
    }


def index(store):
    with (store / 'index.csv').open(newline='') as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope='module')
def reference(tmp_path_factory, scheduler):
    """The store of `SPEC`, made on the cluster of two other processes."""
    folder = tmp_path_factory.mktemp('reference')
    write(folder, SPEC)
    done = subprocess.run(
        [sys.executable, '-m', 'softbody_ros.ensemble.sweep', 'spec.yaml', '-o', 'store']
        + ['--scheduler', scheduler],
        cwd=folder, env=os.environ | {'PYTHONPATH': str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith(f'store: {RUNS} runs, 0 failed\n{RUNS} made in ')
    return folder / 'store'


# ------------------------------------------------------------------------------------------ specs
@pytest.mark.parametrize(
    ('spec', 'sentence'),
    [
        ('', 'must be a map with some of scene, seconds'),
        ('vary: [', 'spec spec.yaml is not YAML'),
        ('seconds: 1', 'spec.yaml must have a map vary'),
        ('vary: 3', 'line 1 must have a map vary'),
        ('sceen: a.yaml', 'line 1: unknown entry sceen: did you mean scene?'),
        ('seconds: 1\nseconds: 2', 'line 2: seconds is there twice'),
        ('scene: no.yaml\nvary: {a.mass: [1]}', 'line 1: scene no.yaml cannot be read: No such'),
        ('seconds: -1\nvary: {ball.mass: [1]}', 'line 1: seconds is -1.0: it must be from 0'),
        ('fps: 241\nvary: {ball.mass: [1]}', 'line 1: fps is 241: it must be above 0 and at most'),
        ('seed: 1.5\nvary: {ball.mass: [1]}', 'line 1: seed is 1.5: it must be a whole number'),
        ('count: 0\nvary: {ball.mass: [1]}', 'line 1: count is 0: it must be from 1'),
        ('count: 2\nvary: {ball.mass: [1]}', 'line 1: count is 2, but nothing is drawn'),
        ('vary: {ball.mass: {uniform: [1, 2]}}', 'has no count: say how many times values are'),
        ('vary:\n  ball.mas: [1]', 'line 2: unknown parameter ball.mas: did you mean ball.mass?'),
        ('vary:\n  points_rate: [1]', 'line 2: points_rate is a parameter of the node, without'),
        ('vary:\n  bodies: [[a], [b]]', 'line 2: bodies cannot vary'),
        ('vary:\n  ball.mass: [1, 0]', 'line 2: ball.mass is 0.0: it must be from 1e-06'),
        ('vary:\n  ball.mass: []', 'line 2: ball.mass has no values'),
        ('vary:\n  ball.mass: [1, 1.0]', 'line 2: ball.mass has the value 1.0 twice'),
        ('vary:\n  ball.mass: 2', 'line 2: ball.mass is 2: give a list of values, {from, to'),
        ('vary:\n  ball.mass: {even: [1, 2]}', 'ball.mass has even: give a list of values'),
        ('vary:\n  ball.mass: {from: 1, to: 2}', 'ball.mass has no steps: a grid is {from'),
        ('vary:\n  ball.mass: {from: 1, to: 2, steps: 1}', 'has 1 steps: give a whole number'),
        ('vary:\n  ball.mass: {from: 1, to: 2, steps: 3, lin: 1}', 'has lin: a grid is {from'),
        ('vary:\n  ball.damping: {from: 0, to: 1, steps: 3, log: true}', '0.0 has no logarithm'),
        ('vary:\n  ball.subdivisions: {from: 1, to: 2, steps: 3}', 'must be whole numbers'),
        ('vary:\n  ball.mode: {from: 1, to: 2, steps: 3}', 'ball.mode is no number but string'),
        ('vary:\n  ball.mode: [liquid]', "ball.mode is 'liquid': choose one of rigid, linear"),
        ('count: 2\nvary:\n  ball.mass: {uniform: [2, 1]}', 'line 3: ball.mass: 2.0 is more than'),
        ('count: 2\nvary:\n  ball.mass: {uniform: [0, 1]}', 'ball.mass is 0.0: it must be from'),
        ('count: 2\nvary:\n  ball.mass: {uniform: [1]}', 'uniform is followed by two values, low'),
        ('count: 2\nvary:\n  ball.mass: {uniform: 1}', 'uniform is followed by a list'),
        ('count: 2\nvary:\n  ball.mass: {normal: [1, 0]}', 'the deviation 0 must be a number'),
        ('count: 2\nvary:\n  ball.mass: {normal: [1, 1e-9], uniform: [1, 2]}', 'has normal'),
        ('count: 2\nvary:\n  ball.position: {normal: [[0, 0, 1], [1, 1]]}', 'above 0, or 3'),
        ('count: 2\nvary:\n  ball.position: {uniform: [0, 1]}', 'position is 0: it must be 3'),
        ('vary:\n  ball.position: [0, 0, 1]', 'ball.position is 0: it must be 3 numbers'),
        ('vary:\n  ball.mass: {from: {}, to: 1, steps: 2}', 'has a map where a value must be'),
        ('count: 10000000\nvary: {ball.mass: {uniform: [1, 2]}, ball.mode: [rigid, linear]}',
         'means 20,000,000 runs: it must be at most'),
    ],
)  # fmt: skip
def test_each_fault_of_a_spec_is_one_sentence(monkeypatch, tmp_path, spec, sentence):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, spec)
    with pytest.raises(ConfigError) as caught:
        read_spec('spec.yaml')
    said = str(caught.value)
    assert sentence in said and said.startswith('spec spec.yaml') and said.count(', line ') <= 1
    assert '\n' not in said


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['no.yaml'], 'spec no.yaml cannot be read: No such file or directory'),
        (['spec.yaml', '--workers', '0'], '--workers is 0: it must be at least 1'),
        (['spec.yaml', '--workers', '1', '--scheduler', 'tcp://a:1'], 'leave it out beside'),
        (['spec.yaml', '-o', '.'], '. is not empty and no store of a sweep: give another folder'),
        (['spec.yaml', '-o', 'spec.yaml'], 'spec.yaml is a file: give the name of a folder'),
        (['spec.yaml', '--plot', 'largest_dent'], 'over one or two parameters, and 3 vary'),
        (['two.yaml', '--plot', 'largest_dents'], 'did you mean ball.largest_dent?'),
        (['mesh.yaml'], 'mesh file no.obj does not exist'),
        (['spec.yaml', '-o', 'a', '--scheduler', 'tcp://127.0.0.1:9'], 'cannot be reached'),
    ],
)
def test_refusals_are_one_sentence_and_leave_nothing(
    run_main, capsys, monkeypatch, tmp_path, arguments, sentence
):
    from softbody_ros.ensemble import cluster

    monkeypatch.setattr(cluster, 'PATIENCE', 0.5)
    (tmp_path / 'two.yaml').write_text('vary: {ball.mass: [1, 2]}')
    (tmp_path / 'mesh.yaml').write_text('vary: {ball.mesh: [box, no.obj]}')
    assert run_main(*arguments) == 1
    said = capsys.readouterr()
    assert said.err.startswith('sweep: ') and sentence in said.err and said.err.count('\n') == 1
    assert said.out == ''
    assert not list(tmp_path.rglob('0*'))


def test_grids_are_all_combined_once_for_each_draw(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, SPEC)
    spec = read_spec('spec.yaml')
    runs = [spec.values(number) for number in range(len(spec))]
    cells = [(values['ball.stiffness'], values['sheet.mode']) for values in runs]
    assert cells == 3 * [(0.2, 'rigid'), (0.2, 'linear'), (0.8, 'rigid'), (0.8, 'linear')]
    assert len({values['ball.bounciness'] for values in runs}) == RUNS


def test_grids_are_even_or_geometric_also_of_vectors(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    write(
        tmp_path,
        'vary:\n  ball.mass: {from: 0.1, to: 10, steps: 3, log: true}\n'
        '  ball.subdivisions: {from: 0, to: 2, steps: 3}\n'
        '  ball.position: {from: [0, 0, 1], to: [1, 0, 2], steps: 3}',
    )
    mass, fine, position = read_spec('spec.yaml').grids
    assert mass.values == pytest.approx((0.1, 1.0, 10.0), rel=1e-14)
    assert fine.values == (0, 1, 2) and all(type(value) is int for value in fine.values)
    assert position.values == ([0.0, 0.0, 1.0], [0.5, 0.0, 1.5], [1.0, 0.0, 2.0])


def draws(tmp_path, name, distribution, count=2000, seed=0, more=''):
    text = f'seed: {seed}\ncount: {count}\nvary:\n{more}  {name}: {distribution}'
    write(tmp_path, text)
    spec = read_spec(str(tmp_path / 'spec.yaml'))
    return [spec.values(number)[name] for number in range(count)]


@pytest.mark.parametrize(
    ('name', 'distribution', 'quartiles'),
    [
        ('ball.mass', '{uniform: [1, 3]}', (1.5, 2.0, 2.5)),
        ('ball.mass', '{log_uniform: [0.01, 100]}', (0.1, 1.0, 10.0)),
        ('ball.mass', '{normal: [50, 3]}', (47.98, 50.0, 52.02)),
        # of a half of a normal distribution, the other one is out of the range
        ('ball.stiffness', '{normal: [0, 0.1]}', (0.0319, 0.0674, 0.115)),
    ],
)
def test_draws_follow_their_distribution(tmp_path, name, distribution, quartiles):
    drawn = np.array(draws(tmp_path, name, distribution))
    measured = [(drawn < quartile).mean() for quartile in quartiles]
    assert measured == pytest.approx([0.25, 0.5, 0.75], abs=0.04)
    assert drawn.min() >= 0.0


def test_whole_numbers_choices_and_vectors_are_drawn(tmp_path):
    whole = draws(tmp_path, 'ball.subdivisions', '{uniform: [1, 4]}')
    assert {type(value) for value in whole} == {int}
    assert [whole.count(value) / 2000 for value in (1, 2, 3, 4)] == pytest.approx(
        4 * [0.25], abs=0.04
    )
    modes = draws(tmp_path, 'ball.mode', '{choice: [rigid, linear]}')
    assert modes.count('rigid') / 2000 == pytest.approx(0.5, abs=0.04) and len(set(modes)) == 2
    places = np.array(draws(tmp_path, 'ball.position', '{normal: [[0, 0, 2], [0.1, 0.2, 0.3]]}'))
    assert places.mean(axis=0) == pytest.approx([0.0, 0.0, 2.0], abs=0.03)
    assert places.std(axis=0) == pytest.approx([0.1, 0.2, 0.3], rel=0.06)
    assert np.abs(np.corrcoef(places.T) - np.eye(3)).max() < 0.08


def test_a_draw_depends_on_seed_run_and_name_only(tmp_path):
    mass = ('ball.mass', '{uniform: [1, 3]}')
    drawn = draws(tmp_path, *mass, count=20)
    assert drawn == draws(tmp_path, *mass, count=30)[:20]
    assert drawn == draws(tmp_path, *mass, count=20, more='  ball.damping: {uniform: [0, 1]}\n')
    assert not set(drawn) & set(draws(tmp_path, *mass, count=20, seed=1))
    assert drawn != [
        1.0 + 2.0 * each for each in draws(tmp_path, 'ball.damping', '{uniform: [0, 1]}', 20)
    ]


# --------------------------------------------------------------------------------- what is kept
def test_a_run_is_kept_to_the_last_bit(reference, monkeypatch):
    spec = read_spec(str(reference.parent / 'spec.yaml'))
    monkeypatch.chdir(reference.parent)
    group = zarr.open_group(reference / 'runs.zarr', mode='r')
    assert len(list(group.groups())) == RUNS
    kept = group['000005']
    assert kept.attrs['parameters'] == spec.values(5) and kept.attrs['status'] == 'done'
    made = record(run(spec.scene, spec.values(5), 2.0, 60.0))
    assert np.array_equal(kept['times'], np.arange(121) / 60)
    assert np.array_equal(kept['ticks'], made.ticks)
    for name in ('ball', 'sheet'):
        for what in ('positions', 'faces', 'pressure', 'wrenches', 'poses', 'dents', 'asleep'):
            there, expected = kept[f'bodies/{name}/{what}'], getattr(made.bodies[name], what)
            assert there.dtype == expected.dtype
            assert np.array_equal(there, expected), what
    assert np.ptp(kept['bodies/ball/positions'], axis=0).max() > 0.02
    assert np.abs(kept['obstacles/post/wrenches']).max() > 0.1
    assert np.array_equal(kept['obstacles/ground/wrenches'], made.obstacle_wrenches['ground'])
    [row] = [row for row in index(reference) if row['run'] == '5']
    assert float(row['ball.bounciness']) == spec.values(5)['ball.bounciness']
    assert float(row['ball.last_z']) == made.bodies['ball'].poses[-1, 2]
    assert kept.attrs['outcomes'] == outcomes(made)


def test_the_table_has_a_line_for_each_run(reference):
    rows = index(reference)
    assert [row['run'] for row in rows] == [str(number) for number in range(RUNS)]
    assert set(rows[0]) == {
        'run', 'status', 'error', 'ball.stiffness', 'ball.bounciness', 'sheet.mode',
        *names_of(['ball', 'sheet']),
    }  # fmt: skip
    assert {row['status'] for row in rows} == {'done'}


def recording(heights, forces, asleep):
    """Return that of a particle at heights, with contact forces, as a body."""
    count = len(heights)
    positions, wrenches = np.zeros((count, 1, 3)), np.zeros((count, 6))
    positions[:, 0, 2], wrenches[:, 2] = heights, forces
    body = BodyRecord(
        faces=np.zeros((0, 3), int), positions=positions, pressure=np.zeros((count, 1)),
        wrenches=wrenches, poses=np.zeros((count, 7)), dents=np.linspace(0.3, 0.1, count),
        asleep=np.array(asleep, bool),
    )  # fmt: skip
    return Recording(np.arange(count) / 10, np.arange(count), {'dot': body}, {})


def test_outcomes_are_taken_from_the_frames():
    came = outcomes(
        recording([3, 2, 1, 1.5, 1.8, 1.2, 1.1], [0, 0, 5, 0, 0, 0, 1], [0] * 5 + [1] * 2)
    )
    assert came['came_to_rest'] and came['time_of_rest'] == 0.5
    assert came['dot.largest_dent'] == 0.3
    assert came['dot.highest_rebound'] == pytest.approx(0.8)
    came = outcomes(recording([3, 2, 1], [0, 0, 0], [1, 1, 0]))
    assert (came['came_to_rest'], came['time_of_rest']) == (False, None)
    assert came['dot.highest_rebound'] is None


def test_failed_runs_are_kept_with_their_sentence_and_the_others_go_on(
    run_main, capsys, tmp_path, scheduler
):
    write(tmp_path, FAILING)
    assert run_main('spec.yaml', '-o', 'store', '--scheduler', scheduler) == 0
    said = capsys.readouterr()
    assert said.err.startswith('sweep: run 2 failed: ball.regions.count is 13')
    assert said.err.count('\n') == 1 and said.out.startswith('store: 3 runs, 1 failed\n')
    rows = index(tmp_path / 'store')
    assert [row['status'] for row in rows] == ['done', 'done', 'failed']
    assert rows[2]['error'] in said.err and rows[2]['ball.largest_dent'] == ''
    group = zarr.open_group(tmp_path / 'store' / 'runs.zarr', mode='r')
    assert group['000002'].attrs['error'] == rows[2]['error'] and not list(group['000002'])

    before = os.stat(tmp_path / 'store/runs.zarr/000002').st_ino
    assert run_main('spec.yaml', '-o', 'store', '--scheduler', scheduler) == 0
    assert capsys.readouterr().out == 'store: 3 runs, 1 failed\n'
    assert os.stat(tmp_path / 'store/runs.zarr/000002').st_ino == before
    assert run_main('spec.yaml', '-o', 'store', '--retry', '--scheduler', scheduler) == 0
    assert '1 made in' in capsys.readouterr().out


def test_memory_that_is_too_small_is_a_failed_run(monkeypatch):
    from softbody_ros.ensemble import work

    def too_much(*_):
        raise MemoryError

    monkeypatch.setattr(work, 'record', too_much)
    order = work.Order(3, {}, {'ball.subdivisions': 0}, 0.0, 60.0, {}, '')
    kept = attributes_of(work.files_of(order, {}))
    assert kept['status'] == 'failed' and 'does not fit into memory' in kept['error']


# ------------------------------------------------------------------------------- whoever makes it
def begun(folder, *arguments):
    """Start the command as a process and the first of a group, as a terminal would."""
    return subprocess.Popen(
        [sys.executable, '-m', 'softbody_ros.ensemble.sweep', 'spec.yaml', '-o', 'store']
        + [*arguments],
        cwd=folder, env=os.environ | {'PYTHONPATH': str(ROOT)}, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def groups(folder):
    return sorted((folder / 'store' / 'runs.zarr').glob('0*'))


def workers_of(process):
    children = psutil.Process(process.pid).children(recursive=True)
    return [each for each in children if 'spawn_main' in ' '.join(each.cmdline())]


def test_a_killed_worker_loses_no_run_and_changes_no_bit(tmp_path, reference):
    write(tmp_path, SPEC)
    process = begun(tmp_path, '--workers', '2')
    try:
        await_that(lambda: groups(tmp_path) or process.poll() is not None, 'a first run')
        victim, other = workers_of(process)
        victim.kill()
        assert len(groups(tmp_path)) < RUNS, 'it is killed in the midst'
        output, errors = process.communicate(timeout=300)
    finally:
        process.kill()
    assert (process.returncode, errors) == (0, '')
    assert output.startswith(f'store: {RUNS} runs, 0 failed\n')
    assert files(tmp_path / 'store') == files(reference)
    assert index(tmp_path / 'store') == index(reference)
    assert not other.is_running()


def test_a_run_that_kills_its_workers_is_given_up_and_no_other_one(
    run_main, capsys, monkeypatch, tmp_path
):
    from softbody_ros.ensemble import cluster, dispatch

    def simulate(order):  # a local function is sent to workers as such
        from softbody_ros.ensemble.work import files_of

        if order.number == 1:
            os._exit(1)
        return files_of(order, {})

    monkeypatch.setattr(dispatch, 'simulate', simulate)
    monkeypatch.setattr(cluster, 'ALLOWED_FAILURES', 0)
    write(tmp_path, 'seconds: 0\nvary: {ball.mass: [1, 2, 3]}')
    assert run_main('spec.yaml', '-o', 'store', '--workers', '1') == 0
    assert [row['status'] for row in index(tmp_path / 'store')] == ['done', 'failed', 'done']
    assert capsys.readouterr().err.startswith('sweep: run 1 failed: several workers ended while')


def test_ctrl_c_ends_it_and_the_same_command_goes_on(
    run_main, capsys, tmp_path, scheduler, reference
):
    process = begun(tmp_path, '--workers', '1')
    try:
        await_that(lambda: groups(tmp_path) or process.poll() is not None, 'a first run')
        workers = workers_of(process)
        os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to workers, too
        output, errors = process.communicate(timeout=300)
    finally:
        process.kill()
    assert (process.returncode, output, errors) == (130, '', '')
    assert len(workers) == 1 and psutil.wait_procs(workers, timeout=60)[1] == []
    done = {path: path.stat().st_ino for path in groups(tmp_path)}
    assert 0 < len(done) < RUNS
    assert len(index(tmp_path / 'store')) == len(done)
    expected = files(reference)
    assert all(expected[path] == content for path, content in files(tmp_path / 'store').items())

    # by the workers that there are, which is no other sweep
    assert run_main('spec.yaml', '-o', 'store', '--scheduler', scheduler) == 0
    said = capsys.readouterr()
    assert said.err == '' and f'\n{RUNS - len(done)} made in ' in said.out
    assert files(tmp_path / 'store') == expected
    assert {path: path.stat().st_ino for path in done} == done
    assert sorted(os.listdir(tmp_path / 'store')) == ['.lock', 'index.csv', 'runs.zarr']


def test_a_store_takes_more_draws_but_no_other_spec(run_main, capsys, tmp_path, scheduler):
    small = 'seconds: 0\nseed: 3\ncount: 2\nvary:\n  ball.mass: {uniform: [1, 2]}\n'
    write(tmp_path, small)
    arguments = ('spec.yaml', '-o', 'store', '--scheduler', scheduler)
    assert run_main(*arguments) == 0
    before = files(tmp_path / 'store')
    write(tmp_path, small.replace('count: 2', 'count: 5'))
    assert run_main(*arguments) == 0
    after = files(tmp_path / 'store')
    assert len(groups(tmp_path)) == 5 and before.items() <= after.items()
    capsys.readouterr()
    for old, new, differs in (
        ('seed: 3', 'seed: 4', 'seed differs'),
        ('seconds: 0', 'seconds: 1', 'seconds differs'),
        ('[1, 2]', '[1, 3]', 'vary differs'),
        ('seed: 3', 'scene: scene.yaml\nseed: 4', 'scene and seed and meshes differ'),
    ):
        write(tmp_path, small.replace(old, new))
        assert run_main(*arguments) == 1
        sentence = f'sweep: store has runs of another spec ({differs}): give another folder\n'
        assert capsys.readouterr().err == sentence
    assert files(tmp_path / 'store') == after


def test_two_sweeps_into_one_folder_are_refused(run_main, capsys, tmp_path):
    described = command._described(read_spec('spec.yaml'))[0]
    with Store(tmp_path / 'store', described, []):
        assert run_main('spec.yaml', '-o', 'store', '--workers', '1') == 1
    assert capsys.readouterr().err == 'sweep: another sweep writes to store: wait, or end it\n'


@pytest.fixture(params=['limit', 'disk'])
def small_folder(request, tmp_path):
    """A folder for 20 kB in a file, or for 100 kB in all; and what ends that."""
    folder = tmp_path / 'store'
    folder.mkdir()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    if request.param == 'limit':
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    else:
        disk = ['mount', '-t', 'tmpfs', '-o', 'size=100k', 'tmpfs', str(folder)]
        if subprocess.run(disk, capture_output=True).returncode:
            pytest.skip('only root may mount a small disk')
    larger = ['mount', '-o', 'remount,size=10M', str(folder)]

    def widen():
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        if request.param == 'disk':
            subprocess.run(larger, check=True)

    yield widen
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    if request.param == 'disk':
        subprocess.run(['umount', str(folder)], check=True)


def test_a_full_disk_is_one_sentence_and_no_half_run(
    run_main, capsys, tmp_path, scheduler, reference, small_folder
):
    arguments = ('spec.yaml', '-o', 'store', '--scheduler', scheduler)
    assert run_main(*arguments) == 1
    said = capsys.readouterr().err
    assert re.match(
        'sweep: the store cannot be written: (No space left on device|File too large); it is as '
        'far as it got, and the same command again goes on\n$',
        said,
    )
    expected, found = files(reference), files(tmp_path / 'store')
    assert all(expected[path] == content for path, content in found.items())
    for group in groups(tmp_path):
        start = f'{group.name}/'
        assert {path for path in found if path.startswith(start)} == {
            path for path in expected if path.startswith(start)
        }
    small_folder()
    assert run_main(*arguments) == 0
    assert files(tmp_path / 'store') == expected


# ------------------------------------------------------------------------ estimates and pictures
def test_a_dry_run_says_how_many_how_long_and_how_large(run_main, capsys, tmp_path, reference):
    assert run_main('spec.yaml', '-o', 'store', '--dry-run', '--workers', '3') == 0
    said = capsys.readouterr()
    number = r'([\d.]+)'
    found = re.fullmatch(
        rf'{RUNS} runs, of which 0 are done\none takes {number} s and {number} kB\n'
        rf'{RUNS} take about {number} s on 3 cores, and {number} MB\n',
        said.out,
    )
    assert found and said.err == ''
    _, size, _, total = map(float, found.groups())
    assert 1e3 * total == pytest.approx(RUNS * size, rel=0.01)
    whole = sum(map(len, files(reference).values()))
    assert 1e6 * total == pytest.approx(whole, rel=0.1)
    assert not (tmp_path / 'store').exists()


def row(outcome, **values):
    return {
        'parameters': {name.replace('__', '.'): value for name, value in values.items()},
        'outcomes': {'ball.largest_dent': outcome},
    }


def colors_of(path):
    """Return the colours that cover a cell of a small heat map."""
    with Image.open(path) as image:
        counts = image.convert('RGB').getcolors(1 << 24)
        large = 0.05 * image.width * image.height
    return {color for count, color in counts if count > large and color != (255, 255, 255)}


def test_two_parameters_are_a_heat_map_one_a_line(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'plot.png'
    write(tmp_path, 'vary: {ball.mass: [1, 2], ball.mode: [rigid, linear]}')
    spec = read_spec('spec.yaml')
    rows = [
        row(0.1, ball__mass=1.0, ball__mode='rigid'),
        row(0.2, ball__mass=2.0, ball__mode='rigid'),
        row(0.3, ball__mass=1.0, ball__mode='linear'),
        row(None, ball__mass=2.0, ball__mode='linear'),
    ]
    draw_plot(rows, 'ball.largest_dent', spec, path)
    assert len(colors_of(path)) == 3
    draw_plot(rows[:1], 'ball.largest_dent', spec, path)
    assert len(colors_of(path)) == 1
    write(tmp_path, 'vary: {ball.mass: {from: 1, to: 9, steps: 3, log: true}}')
    spec = read_spec('spec.yaml')
    draw_plot(
        [row(0.1 * mass, ball__mass=mass) for mass in (1, 3, 9)], 'ball.largest_dent', spec, path
    )
    assert colors_of(path) == set()


def test_the_command_draws_what_the_spec_asks_for(run_main, tmp_path, scheduler):
    write(
        tmp_path,
        'seconds: 0\nplot: largest_dent\nvary: {ball.mass: [1, 2], ball.mode: [rigid, linear]}',
    )
    assert run_main('spec.yaml', '-o', 'store', '--scheduler', scheduler) == 0
    assert len(colors_of(tmp_path / 'store' / 'ball.largest_dent.png')) == 1  # all are 0
    assert run_main('spec.yaml', '-o', 'store', '--plot', 'last_z', '--workers', '1') == 0
    assert (tmp_path / 'store' / 'ball.last_z.png').exists()


def test_an_encoded_run_has_the_same_bytes_each_time():
    made = record(run({'ball.subdivisions': 0}, {}, 0.1, 20.0))
    assert encoded(made, {'run': 1}) == encoded(made, {'run': 1}) != encoded(made, {'run': 2})


# ----------------------------------------------------------------- what others do, and have done
def test_two_sweeps_of_one_mesh_on_one_cluster_leave_each_other_alone(tmp_path, scheduler):
    from softbody_ros.ensemble.cluster import cluster
    from softbody_ros.ensemble.dispatch import completed

    write(tmp_path, f'scene: scene.yaml\nseconds: 0\nvary: {{sheet.mass: {list(range(1, 9))}}}')
    spec = read_spec(str(tmp_path / 'spec.yaml'))
    values = [('sheet.mesh', str(tmp_path / 'sheet.obj'))]
    spec.scene.update(values)

    def begun_on(client):
        meshes = read_meshes(values)
        orders = command._orders(spec, meshes, list(range(len(spec))))
        return completed(client, orders, meshes, lambda: None)

    with cluster(scheduler) as one, cluster(scheduler) as other:
        longer, shorter = begun_on(one), begun_on(other)
        made = [next(longer)]
        for half in (shorter, longer):
            made += half
    assert len(made) == 2 * len(spec)
    assert {attributes_of(files)['error'] for _, files in made} == {''}


@pytest.mark.parametrize('damage', [b'', b'{', b'{}', b'{"attributes": {"run": 1}}', None])
def test_a_damaged_run_is_made_again(tmp_path, damage):
    files = encoded(None, row(None) | {'run': 1, 'status': 'failed', 'error': ''})
    with Store(tmp_path / 'store', {'vary': []}, []) as store:
        store.add(0, files)
        store.add(1, files)
    path = tmp_path / 'store' / 'runs.zarr' / '000001' / 'zarr.json'
    path.unlink() if damage is None else path.write_bytes(damage)
    assert list(stored(tmp_path / 'store')) == [0]
    with Store(tmp_path / 'store', {'vary': []}, []) as store:
        store.add(1, files)
    assert list(stored(tmp_path / 'store')) == [0, 1]


def test_values_that_differ_little_are_cells_of_their_own(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'plot.png'
    write(
        tmp_path,
        'vary:\n  ball.mass: [1, 2]\n  ball.young_modulus: {from: 100000, to: 100020, steps: 3}\n',
    )
    spec = read_spec('spec.yaml')
    runs = [spec.values(number) for number in range(len(spec))]
    rows = [
        {'parameters': values, 'outcomes': {'ball.largest_dent': 0.1 * number}}
        for number, values in enumerate(runs)
    ]
    draw_plot(rows, 'ball.largest_dent', spec, path)
    assert len(colors_of(path)) == len(rows) == 6
    assert os.listdir(tmp_path).count('plot.png') == 1
    assert _texts([1e5, 100010.0, 100020.0]) == ['1e+05', '1.0001e+05', '1.0002e+05']
    assert _texts([(0.1, 1.0), (0.12345, 1.0)]) == ['0.1, 1', '0.1235, 1']


def test_a_picture_is_there_whole_or_not_at_all(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, 'vary: {ball.mass: [1, 2]}')
    path = tmp_path / 'plot.png'
    path.write_bytes(b'older')
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        with pytest.raises(OSError, match='File too large'):
            draw_plot(
                [row(0.1, ball__mass=1.0)], 'ball.largest_dent', read_spec('spec.yaml'), path
            )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == b'older'


def test_as_many_steps_as_no_sweep_can_have_are_refused(tmp_path):
    write(tmp_path, 'vary: {ball.mass: {from: 1, to: 2, steps: 99999999999}}')
    with pytest.raises(ConfigError, match=r'has 99999999999 steps: .* from 2 to 10,000,000'):
        read_spec(str(tmp_path / 'spec.yaml'))


def test_vectors_are_different_or_refused(tmp_path):
    write(tmp_path, 'vary: {ball.position: [[0, 0, 1], [0, 0, 2], [0.0, 0, 1]]}')
    with pytest.raises(ConfigError, match=r'has the value \[0.0, 0.0, 1.0\] twice'):
        read_spec(str(tmp_path / 'spec.yaml'))
