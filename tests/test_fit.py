# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `fit`: it finds again the parameters of films, and says what it cannot know."""

import dataclasses
import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
from observed import seen
from PIL import Image
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore
import yaml

from softbody_ros.core import ConfigError, SimulationError, World
from softbody_ros.ensemble import fit
from softbody_ros.ensemble.cluster import cluster
from softbody_ros.ensemble.fit_estimates import judge
from softbody_ros.ensemble.fit_parameters import make_unknown, separate
from softbody_ros.ensemble.fit_problem import Outcome, evaluate
from softbody_ros.ensemble.fit_search import Solution, _Runs, search
from softbody_ros.ensemble.fit_targets import Choice, make_problem
from softbody_ros.ensemble.observation import ANY_BODY, Observation, ObservationError
from softbody_ros.ensemble.observation_files import read_observation
from softbody_ros.ensemble.running import record, run
from softbody_ros.scene.parameters import make_scene
from softbody_ros.scene.scene_file import read_scene

pytestmark = pytest.mark.usefixtures('compiled_ahead')
ROOT = pathlib.Path(__file__).parent.parent
STEP = 1 / 120
"""Half as many ticks as usual: hundreds of runs are made for each fit."""
SCENE = {
    'time_step': STEP,
    'bodies': ['ball'],
    'ball.subdivisions': 1,
    'ball.position': [0.0, 0.0, 1.2],
    'ball.initial_velocity.linear': [2.0, 0.0, 0.0],
}
"""A thrown ball: it slides, and swings in the air between its jumps."""
TRUTH = {
    'ball.stiffness': 0.4,
    'ball.bounciness': 0.8,
    'ball.friction': 0.15,
    'ball.elasticity': 0.8,
}
CAMERA = (0.3, -0.9, 0.4)


def filmed(values, seconds=1.5, scene=SCENE, fps=30):
    return record(run(scene, values, seconds, fps))


def film_of(recording, body='ball'):
    return Observation(recording.times, {body: list(recording.bodies[body].positions)})


def clouds_of(recording, count=140, noise=0.003, seed=1, body='ball'):
    x = recording.bodies[body]
    points = seen(x.positions, x.faces, CAMERA, count, noise, seed)
    return Observation(recording.times, {ANY_BODY: list(points)})


def problem_of(observation, names, scene=SCENE, **choice):
    unknowns = [make_unknown(scene, *separate([name])[0].popitem()) for name in names]
    return make_problem(scene, unknowns, observation, Choice(**choice))


def here(problem):
    """Return an evaluation in this process."""
    return lambda places: [evaluate(problem, place) for place in places]


def solved(problem, **effort):
    solution = search(problem, here(problem), **effort)
    return judge(problem.unknowns, solution, problem.noise), solution


def values_of(verdict):
    return {each.unknown.name: each.value for each in verdict.estimates}


# --------------------------------------------------------------------------------- own parameters
@pytest.mark.slow  # one of them is, from a film, where workers are compared
def test_all_four_are_found_again_from_a_film_without_noise():
    verdict, _ = solved(problem_of(film_of(filmed(TRUTH)), TRUTH), members=12, generations=5)
    for name, value in TRUTH.items():
        assert values_of(verdict)[name] == pytest.approx(value, rel=0.02), name
    assert verdict.rms < 0.1 and not verdict.warnings


@pytest.mark.parametrize(
    'names',
    [
        pytest.param(list(TRUTH), marks=pytest.mark.slow, id='all four'),
        pytest.param(['ball.stiffness', 'ball.friction'], id='two'),
    ],
)
def test_parameters_are_found_again_by_a_camera_with_noise(names):
    scene = SCENE | {name: value for name, value in TRUTH.items() if name not in names}
    problem = problem_of(clouds_of(filmed(TRUTH, fps=15), 240), names, scene)
    verdict, solution = solved(problem, members=8, generations=4)
    assert len(solution.residuals) > 5000
    for each in verdict.estimates:
        name = each.unknown.name
        assert each.value == pytest.approx(TRUTH[name], rel=0.1), name
        assert abs(each.value - TRUTH[name]) < 5.0 * each.deviation < 0.2, name
    assert verdict.rms == pytest.approx(1.0, abs=0.1) and not verdict.warnings


@pytest.mark.slow
def test_deviations_are_those_of_many_observations():
    recording, name = filmed(TRUTH, 1.0), 'ball.stiffness'
    scene = SCENE | {key: value for key, value in TRUTH.items() if key != name}
    estimates = []
    for seed in range(8):
        observation = clouds_of(recording, 20, 0.005, seed)
        problem = problem_of(observation, [f'{name}:=[0.35,0.45]'], scene, noise=0.005)
        verdict, _ = solved(problem, members=8, generations=0)
        estimates.append(verdict.estimates[0])
    errors = [(each.value - TRUTH[name]) / each.deviation for each in estimates]
    # chi square of 8: beyond these bounds once in a thousand
    assert 1.0 < np.square(errors).sum() < 26.0


def test_the_time_and_the_start_can_be_fitted_too():
    recording = filmed({}, 0.8)
    late = Observation(recording.times + 0.0123, film_of(recording).clouds)
    scene = SCENE | {'ball.position': [0.0, 0.0, 1.15]}
    verdict, _ = solved(
        problem_of(late, ['time_offset', 'ball.position.z:=[1.1,1.3]'], scene, begin=0.1),
        members=8, generations=3,
    )  # fmt: skip
    assert values_of(verdict)['time_offset'] == pytest.approx(-0.0123, abs=2e-4)
    assert values_of(verdict)['ball.position.z'] == pytest.approx(1.2, abs=1e-3)


def test_the_modulus_is_searched_by_its_logarithm():
    scene = SCENE | {'ball.young_modulus': 1e3}
    names = ['ball.young_modulus:=[100.0,100000.0]']
    problem = problem_of(film_of(filmed({'ball.young_modulus': 4e3}, 0.9)), names, scene)
    assert problem.unknowns[0].value(0.5) == pytest.approx(10**3.5)
    verdict, _ = solved(problem, members=8, generations=3)
    assert values_of(verdict)['ball.young_modulus'] == pytest.approx(4e3, rel=0.02)


# -------------------------------------------------------------------------------- an honest word
def test_what_has_no_effect_is_said_and_left_alone():
    names = ['ball.stiffness', 'ball.mass']
    problem = problem_of(film_of(filmed({'ball.stiffness': 0.3}, 0.7)), names)
    verdict, _ = solved(problem, members=8, generations=3)
    assert values_of(verdict) == pytest.approx({'ball.stiffness': 0.3, 'ball.mass': 1.0}, rel=0.02)
    assert verdict.warnings == ['ball.mass has no effect on this observation: it is left alone']
    assert [each.note for each in verdict.estimates] == ['', 'no effect']
    assert verdict.estimates[1].deviation is None


def test_what_cannot_be_told_apart_is_said():
    """Before a ball flies again, only bounciness times elasticity counts."""
    names = ['ball.bounciness', 'ball.elasticity']
    scene = SCENE | {'ball.position': [0.0, 0.0, 0.6]}
    values = {'ball.bounciness': 0.6, 'ball.elasticity': 0.5}
    verdict, _ = solved(
        problem_of(film_of(filmed(values, 0.25, scene)), names, scene), members=8, generations=2
    )
    found = values_of(verdict)
    assert np.prod(list(found.values())) == pytest.approx(0.3, rel=0.02)
    assert [each.deviation for each in verdict.estimates] == [None, None]
    assert verdict.estimates[0].note == 'not apart from ball.elasticity'
    assert verdict.warnings[0].startswith(
        'ball.bounciness and ball.elasticity cannot be told apart: only ball.bounciness × '
        'ball.elasticity is determined'
    )


def test_a_poor_fit_is_said():
    observation = film_of(filmed({'gravity.magnitude': 5.0}, 0.8))
    verdict, _ = solved(problem_of(observation, ['ball.stiffness']), members=8, generations=1)
    assert any(sentence.startswith('the fit is poor: ') for sentence in verdict.warnings)


def test_outliers_count_little_and_are_said():
    recording = filmed(TRUTH, 0.9, fps=15)
    clouds = clouds_of(recording).clouds[ANY_BODY]
    far = np.random.default_rng(5).uniform(-3.0, 3.0, (len(clouds), 15, 3))
    mixed = [np.concatenate(pair) for pair in zip(clouds, far, strict=True)]
    scene = SCENE | {key: value for key, value in TRUTH.items() if key != 'ball.stiffness'}
    problem = problem_of(
        Observation(recording.times, {ANY_BODY: mixed}), ['ball.stiffness'], scene
    )
    verdict, _ = solved(problem, members=8, generations=1)
    assert values_of(verdict)['ball.stiffness'] == pytest.approx(0.4, rel=0.02)
    assert any('% of the points are outliers' in sentence for sentence in verdict.warnings)


def test_a_value_at_its_bound_is_said():
    observation = film_of(filmed({'ball.stiffness': 0.5}, 0.7))
    verdict, _ = solved(
        problem_of(observation, ['ball.stiffness:=[0.1,0.4]']), members=8, generations=1
    )
    assert verdict.estimates[0].note == 'at its upper bound 0.4'
    assert 'ball.stiffness is at its upper bound 0.4: widen its bounds if it can be' in (
        verdict.warnings
    )


# ------------------------------------------------------------------------------------ comparison
def test_between_ticks_positions_are_interpolated():
    recording = filmed({}, 0.2, fps=60)
    x = recording.bodies['ball'].positions
    half = Observation(recording.times[:-1] + STEP, {'ball': list(x[:-1])})
    problem = problem_of(half, ['time_offset'], noise=1.0)
    at = problem.unknowns[0].coordinate
    ticks = evaluate(problem, np.array([at(-STEP)])).residuals
    assert np.abs(ticks).max() < 1e-9
    between = evaluate(problem, np.array([at(-0.5 * STEP)])).residuals
    world = World(make_scene(SCENE).world)
    before = world.positions('ball')
    world.step()
    expected = before - 0.5 * (before + world.positions('ball'))
    np.testing.assert_allclose(between[: expected.size], expected.ravel(), atol=1e-9)


def test_a_camera_that_sees_a_part_is_exact_and_distances_have_a_sign():
    recording = filmed({}, 0.8)
    problem = problem_of(clouds_of(recording, noise=0.0), ['ball.stiffness'], noise=1.0)
    exact = evaluate(problem, np.array([0.5])).residuals
    assert np.abs(exact).max() < 1e-9
    deeper = dataclasses.replace(
        problem.targets[0], points=problem.targets[0].points + [0, 0, 0.01]
    )
    moved = dataclasses.replace(problem, targets=(deeper,))
    residuals = evaluate(moved, np.array([0.5])).residuals
    assert residuals.max() == pytest.approx(0.01, rel=0.02)
    assert residuals.min() < -0.001


def test_points_of_two_bodies_are_compared_with_the_nearer_one():
    scene = {'bodies': ['ball', 'box'], 'ball.subdivisions': 2, 'box.mesh': 'box',
             'box.subdivisions': 2, 'box.position': [2.0, 0.0, 1.0]}  # fmt: skip
    recording = record(run(scene, {}, 0.3, 30))
    parts = [clouds_of(recording, 50, 0.0, 1, body).clouds[ANY_BODY] for body in ('ball', 'box')]
    both = [np.concatenate(pair) for pair in zip(*parts, strict=True)]
    problem = problem_of(
        Observation(recording.times, {ANY_BODY: both}), ['box.stiffness'], scene, noise=1.0
    )
    assert np.abs(evaluate(problem, np.array([0.5])).residuals).max() < 1e-9
    alone = problem_of(
        Observation(recording.times, {ANY_BODY: both}), ['box.stiffness'], scene, body='box'
    )
    assert alone.targets[0].bodies == ('box',)
    assert np.abs(evaluate(alone, np.array([0.5])).residuals).max() > 100.0


def test_many_points_are_thinned_always_in_the_same_way():
    observation = clouds_of(filmed({}, 0.5), 2000)
    one, other = (problem_of(observation, ['ball.stiffness']) for _ in range(2))
    assert 5500 < len(one.targets[0].points) <= 6000
    assert np.array_equal(one.targets[0].points, other.targets[0].points)
    assert set(one.targets[0].frames) == set(range(len(observation.times)))


def test_points_that_are_not_there_are_dropped():
    recording = filmed({}, 0.3)
    x = [each.copy() for each in recording.bodies['ball'].positions]
    for frame in x:
        frame[::3] = np.nan
    problem = problem_of(Observation(recording.times, {'ball': x}), ['ball.stiffness'])
    assert len(problem.targets[0].points) == 28 * len(x)
    assert np.abs(evaluate(problem, np.array([0.5])).residuals).max() < 1e-9


# --------------------------------------------------------------------------------------- failures
def test_runs_that_fail_are_bad_points_and_no_end():
    problem = problem_of(film_of(filmed({'ball.stiffness': 0.3}, 0.6)), ['ball.stiffness'])

    def fragile(places):
        return [
            Outcome(None, 'it broke') if place[0] > 0.5 else evaluate(problem, place)
            for place in places
        ]

    solution = search(problem, fragile)
    assert problem.unknowns[0].value(solution.coordinates[0]) == pytest.approx(0.3, rel=0.02)
    assert 0 < solution.failures < solution.runs
    with pytest.raises(SimulationError, match=r'none of 16 runs .* can be simulated: it broke'):
        search(problem, lambda places: [Outcome(None, 'it broke')] * len(places), generations=0)


def test_an_impossible_value_is_a_failed_run():
    scene = SCENE | {'ball.young_modulus': 1e4}
    problem = problem_of(film_of(filmed({}, 0.1)), ['ball.deformation'], scene)
    outcome = evaluate(problem, np.array([1.0]))
    assert outcome.residuals is None and 'ball.young_modulus is 10000' in outcome.failure


@pytest.mark.parametrize(
    ('argument', 'sentence'),
    [
        ('ball.stifness', r'unknown parameter ball\.stifness: did you mean ball\.stiffness\?'),
        ('ball.mode', r'ball\.mode cannot be fitted: it is a choice; .* -p ball\.mode:=VALUE'),
        ('ball.subdivisions', r'ball\.subdivisions cannot be fitted: it is a whole number'),
        ('ball.mesh', r'ball\.mesh cannot be fitted: it is a text'),
        ('bodies', r'bodies cannot be fitted: it is a list'),
        ('publish_tf', r'publish_tf cannot be fitted: it is a switch'),
        ('ball.color', r'ball\.color cannot be fitted: it is 4 numbers'),
        ('points_rate', r'points_rate cannot be fitted: it is no property of a body'),
        ('time_step', r'time_step cannot be fitted: it is no property of a body'),
        ('ball.position', r'ball\.position is a vector: fit its components, such as -p ball\.pos'),
        ('ball.mass.x', r'ball\.mass has no component x: fit ball\.mass itself'),
        ('ground.position.z:=[1.0,0.0]', r'first must be less than the second'),
        ('ball.stiffness:=[0.5,1.5]', r'bound of ball\.stiffness is 1\.5: it must be from 0 to 1'),
        ('ball.mesh_scale', r'ball\.mesh_scale has a wide range, 0 … 1e\+06: give bounds'),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_a_sentence(argument, sentence):
    with pytest.raises(ConfigError, match=sentence):
        problem_of(None, [argument])


def test_arguments_are_fitted_or_set():
    fitted, assigned = separate(
        [
            'ball.mass',
            'ball.friction:=[0.1,0.5]',
            'ball.stiffness:=0.3',
            'bodies:=[a,b]',
            'ball.pins.indices:=[1,2]',
            'ball.position:=[0,0,1]',
        ]
    )
    assert fitted == {'ball.mass': None, 'ball.friction': [0.1, 0.5]}
    assert set(assigned) == {'ball.stiffness', 'bodies', 'ball.pins.indices', 'ball.position'}
    with pytest.raises(ConfigError, match=r'-p ball\.mass is given twice'):
        separate(['ball.mass', 'ball.mass:=2.0'])


# ---------------------------------------------------------------------------------------- readers
TYPES = get_typestore(Stores.ROS2_JAZZY)
CLOUD = 'sensor_msgs/msg/PointCloud2'


def message(points, seconds, body=None):
    """Return a cloud of points (k, 3), with the field body, if numbers are given."""
    field, header = TYPES.types['sensor_msgs/msg/PointField'], TYPES.types['std_msgs/msg/Header']
    stamp = TYPES.types['builtin_interfaces/msg/Time']
    names = ['x', 'y', 'z'] + (['body'] if body is not None else [])
    records = np.zeros(len(points), [(name, '<u4' if name == 'body' else '<f4') for name in names])
    records['x'], records['y'], records['z'] = np.asarray(points).T
    if body is not None:
        records['body'] = body
    fields = [field(name, 4 * k, 6 if name == 'body' else 7, 1) for k, name in enumerate(names)]
    nanoseconds = round(seconds * 1e9)
    return TYPES.types[CLOUD](
        header(stamp(*divmod(nanoseconds, 1_000_000_000)), 'world'), 1, len(points), fields,
        False, records.itemsize, records.nbytes, np.frombuffer(records.tobytes(), np.uint8), True,
    )  # fmt: skip


def write_bag(folder, topics):
    """Write a bag: for each topic its messages, by their times."""
    with Writer(folder, version=9) as bag:
        for topic, messages in topics.items():
            connection = bag.add_connection(topic, CLOUD, typestore=TYPES)
            for seconds, each in messages.items():
                data = TYPES.serialize_cdr(each, CLOUD)
                bag.write(connection, round(seconds * 1e9), data)
    return folder


def test_a_bag_of_the_node_has_vertices_by_body(tmp_path):
    scene = {'bodies': ['ball', 'box'], 'ball.subdivisions': 1, 'box.mesh': 'box'}
    recording = record(run(scene, {}, 0.2, 10))
    x = [recording.bodies[name].positions for name in ('ball', 'box')]
    numbers = np.repeat([0, 1], [each.shape[1] for each in x])
    start = 1_700_000_000.5
    messages = {
        start + time: message(np.concatenate([each[k] for each in x]), start + time, numbers)
        for k, time in enumerate(recording.times)
    }
    bag = write_bag(tmp_path / 'bag', {'/softbody_sim/points': messages})
    observation = read_observation(bag, ['ball', 'box'])
    np.testing.assert_allclose(observation.times, recording.times, atol=1e-6)
    for name, each in zip(('ball', 'box'), x, strict=True):
        np.testing.assert_allclose(observation.clouds[name], each, atol=1e-6)
    problem = problem_of(observation, ['ball.stiffness'], scene)
    assert all(target.vertices is not None for target in problem.targets)
    assert np.abs(evaluate(problem, np.array([0.5])).residuals).max() < 1e-3
    with pytest.raises(ValueError, match='has the body 1, counted from 0, but the scene has 1'):
        read_observation(bag, ['ball'])


def test_a_bag_of_a_camera_is_read_and_a_topic_chosen(tmp_path):
    points = np.random.default_rng(1).normal(size=(30, 3))
    points[3] = np.nan
    one = {0.5 * k: message(points + k, 0.5 * k + 100.0) for k in range(3)}
    bag = write_bag(tmp_path / 'bag', {'/camera': one, '/other': {0.0: message(points, 0.0)}})
    observation = read_observation(bag, ['ball'], '/camera')
    np.testing.assert_allclose(observation.times, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(observation.clouds[ANY_BODY][2], points + 2, rtol=1e-5)
    with pytest.raises(ValueError, match='has clouds on /camera, /other: choose one with --topic'):
        read_observation(bag, ['ball'])
    with pytest.raises(ValueError, match='no clouds on /nothing: its clouds are on /camera, /oth'):
        read_observation(bag, ['ball'], '/nothing')
    file = next(bag.glob('*.db3'))
    assert len(read_observation(file, ['ball'], '/camera').times) == 3


def test_a_bag_without_clouds_is_refused(tmp_path):
    with Writer(tmp_path / 'bag', version=9) as bag:
        bag.add_connection('/text', 'std_msgs/msg/String', typestore=TYPES)
    with pytest.raises(ValueError, match='has no topic of type sensor_msgs/msg/PointCloud2'):
        read_observation(tmp_path / 'bag', ['ball'])
    empty = write_bag(tmp_path / 'empty', {'/camera': {0.0: message(np.zeros((0, 3)), 0.0)}})
    with pytest.raises(ValueError, match='has no points: all its clouds are empty'):
        read_observation(empty, ['ball'])
    broken = message(np.zeros((5, 3)), 0.0)
    broken.width = 9
    bag = write_bag(tmp_path / 'broken', {'/camera': {0.0: broken}})
    with pytest.raises(ValueError, match='a cloud of /camera is malformed'):
        read_observation(bag, ['ball'])


def test_a_film_is_read_at_its_ticks(tmp_path):
    points = np.random.default_rng(1).normal(size=(3, 5, 3))
    np.savez(tmp_path / 'film.npz', **{
        'bodies': ['ball'], 'ball.positions': points, 'ticks': [0, 5, 10], 'time_step': 1 / 240,
    })  # fmt: skip
    observation = read_observation(tmp_path / 'film.npz', ['ball'])
    assert np.array_equal(observation.times, np.array([0, 5, 10]) / 240)
    assert np.array_equal(observation.clouds['ball'], points)


@pytest.mark.parametrize('suffix', ['.npy', '.csv', '.txt', '.xyz', '.ply'])
def test_a_folder_of_files_is_read(tmp_path, suffix):
    points = np.random.default_rng(1).normal(size=(4, 7, 3)).round(4)
    for k in (2, 0, 3, 1):
        file = tmp_path / f'scan2_{0.25 * k:.3f}{suffix}'
        if suffix == '.npy':
            np.save(file, points[k])
        elif suffix == '.ply':
            rows = '\n'.join(' '.join(map(str, row)) for row in points[k])
            file.write_text(
                'ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\n'
                f'property float z\nend_header\n{rows}\n'
            )
        else:
            head, comma = ('x,y,z,intensity', ',') if suffix == '.csv' else ('', ' ')
            np.savetxt(file, np.column_stack([points[k], np.ones(7)]), '%.4f', comma, header=head,
                       comments='')  # fmt: skip
    observation = read_observation(tmp_path, ['ball'])
    assert observation.times.tolist() == [0.0, 0.25, 0.5, 0.75]
    np.testing.assert_allclose(observation.clouds[ANY_BODY], points, atol=1e-6)


def test_times_of_files_can_stand_in_a_table(tmp_path):
    for name in 'ab':
        np.save(tmp_path / f'{name}.npy', np.ones((2, 3)))
    with pytest.raises(ValueError, match=r'a\.npy has no time in its name'):
        read_observation(tmp_path, ['ball'])
    (tmp_path / 'times.csv').write_text('file,time\nb.npy,0.5\na.npy, 1.5\n')
    assert read_observation(tmp_path, ['ball']).times.tolist() == [0.5, 1.5]
    (tmp_path / 'times.csv').write_text('c.npy,0.5\n')
    with pytest.raises(ValueError, match=r'times\.csv, line 1: it must be the name of a file in'):
        read_observation(tmp_path, ['ball'])


@pytest.mark.parametrize(
    ('name', 'content', 'sentence'),
    [
        ('a_0.1.npy', b'nothing', r'the points .*a_0\.1\.npy cannot be read'),
        ('a_0.1.csv', b'1,2\n3,4\n', r'have the shape \(2, 2\): it must be \(k, 3\)'),
        ('a_0.1.csv', b'1,2,3\n3,4,x\n', r'cannot be read'),
        ('a_0.1.csv', b'', r'has no points: all its clouds are empty'),
        ('a_1.pcd', b'', r'has no point files: they end with \.npy, \.ply'),
    ],
)
def test_files_that_are_no_points_are_refused(tmp_path, name, content, sentence):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=sentence):
        read_observation(tmp_path, ['ball'])


@pytest.mark.parametrize(
    ('choice', 'sentence'),
    [
        ({'begin': 5.0}, r'lasts from 0 to 0\.3 s of the scene, and none of it is from 5 to'),
        ({'offset': -9.0}, r'lasts from -9 to -8\.7 s'),
        ({'body': 'bal'}, r'--body bal is not in the scene: did you mean ball\?'),
    ],
)
def test_what_is_not_there_cannot_be_chosen(choice, sentence):
    with pytest.raises(ValueError, match=sentence):
        problem_of(film_of(filmed({}, 0.3)), ['ball.stiffness'], **choice)


def test_a_film_of_another_mesh_is_compared_by_the_surface_unless_vertices_are_asked_for():
    finer = film_of(filmed({'ball.subdivisions': 3}, 0.2))
    problem = problem_of(finer, ['ball.stiffness'])
    assert problem.targets[0].vertices is None
    assert problem.noise == 0.003
    with pytest.raises(ValueError, match='has 642 points, but ball has 42 vertices'):
        problem_of(finer, ['ball.stiffness'], correspondence=True)
    with pytest.raises(ValueError, match='the observation is of egg, and the scene or --body say'):
        problem_of(Observation(finer.times, {'egg': finer.clouds['ball']}), ['ball.stiffness'])


# ---------------------------------------------------------------------------------- the command
@pytest.fixture
def files(tmp_path):
    """Return a folder with a scene and a film of it with other parameters."""
    (tmp_path / 'ball.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': SCENE}}))
    recording = filmed({'ball.stiffness': 0.3}, 0.6)
    np.savez(tmp_path / 'film.npz', **{
        'bodies': ['ball'], 'ball.positions': recording.bodies['ball'].positions,
        'ticks': recording.ticks, 'time_step': STEP,
    })  # fmt: skip
    return tmp_path


def command(folder, *arguments):
    return subprocess.Popen(
        [sys.executable, '-m', 'softbody_ros.ensemble.fit', *map(str, arguments)],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {'PYTHONPATH': str(ROOT)},
    )  # fmt: skip


def test_one_worker_and_a_cluster_of_two_find_the_same_as_this_process(files):
    def found_by(name, *workers):
        process = command(
            files, 'ball.yaml', 'film.npz', '-p', 'ball.stiffness', *workers,
            '-o', f'{name}.yaml',
        )  # fmt: skip
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        assert out.startswith('parameter       value  ±') and f'{name}.yaml' in out
        return (files / f'{name}.yaml').read_text()

    results = [found_by(1, '--workers', 1)]
    with cluster(workers=2) as client:
        client.wait_for_workers(2)
        results.append(found_by(2, '--scheduler', client.scheduler.address))
        runs = client.run(lambda dask_worker: dask_worker.state.executed_count).values()
        assert len(runs) == 2 and sum(runs) > 200
    assert results[0] == results[1]
    observation = read_observation(files / 'film.npz', ['ball'])
    scene = read_scene(str(files / 'ball.yaml'))
    verdict, _ = solved(problem_of(observation, ['ball.stiffness'], scene))
    found = read_scene(str(files / '1.yaml'))
    assert found == scene | {'ball.stiffness': verdict.estimates[0].value}
    assert found['ball.stiffness'] == pytest.approx(0.3, rel=1e-6)
    facts = yaml.safe_load(results[0])['/softbody_fit']['ros__parameters']
    assert facts['deviation']['ball.stiffness'] < 1e-3 and facts['residual_rms'] < 1e-6
    with Image.open(files / '2.png') as picture:
        assert picture.size == (960, 672)
    assert sorted(path.name for path in files.iterdir()) == [
        '1.png', '1.yaml', '2.png', '2.yaml', 'ball.yaml', 'film.npz',
    ]  # fmt: skip


def test_a_lost_worker_changes_nothing(files):
    observation = read_observation(files / 'film.npz', ['ball'])
    problem = problem_of(observation, ['ball.stiffness'])

    class Bar:
        def update(self, _):
            if not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

    killed = []
    with cluster(workers=2) as client:
        client.wait_for_workers(2)
        pids = sorted(client.run(os.getpid).values())
        places = list(np.linspace(0.1, 0.9, 12)[:, None])
        outcomes = fit.ClusterRuns(client, problem, Bar())(places)
    assert killed
    for place, outcome in zip(places, outcomes, strict=True):
        assert np.array_equal(outcome.residuals, evaluate(problem, place).residuals)


@pytest.mark.parametrize(
    'number', [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_leaves_no_worker_and_no_file(files, number):
    long = ['-p', 'ball.subdivisions:=5', '--correspondence', 'no', '-p', 'ball.stiffness']
    process = command(files, 'ball.yaml', 'film.npz', *long)
    try:
        workers = []
        deadline = time.monotonic() + 120.0
        while len(workers) < 2 and time.monotonic() < deadline:
            assert process.poll() is None, process.communicate()
            workers = children(process.pid)
            time.sleep(0.1)
        process.send_signal(number)
        out, _ = process.communicate(timeout=120.0)
    finally:
        process.kill()
    assert (process.returncode, out) == (128 + number, '')
    deadline = time.monotonic() + 30.0
    while any(alive(pid) for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(alive(pid) for pid in workers)
    assert sorted(path.name for path in files.iterdir()) == ['ball.yaml', 'film.npz']


def children(pid):
    """Return the processes that a process has started and those that they have."""
    found = []
    for task in pathlib.Path(f'/proc/{pid}/task').glob('*/children'):
        for child in map(int, task.read_text().split()):
            command = pathlib.Path(f'/proc/{child}/cmdline').read_text()
            if 'spawn_main' in command:
                found.append(child)
    return found


def alive(pid):
    try:
        return pathlib.Path(f'/proc/{pid}/stat').read_text().split()[2] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['film.npz'], 'nothing is fitted: name parameters, such as -p ball.stiffness'),
        (['none.npz', '-p', 'ball.stiffness'], 'the observation none.npz does not exist'),
        (['ball.yaml', '-p', 'ball.stiffness'], 'the observation ball.yaml has an unknown suffix'),
        (['film.npz', '-p', 'ball.mode'], 'ball.mode cannot be fitted: it is a choice'),
        (['film.npz', '-p', 'ball.stiffness', '-o', 'x.txt'], 'the output x.txt has an unknown'),
        (['film.npz', '-p', 'ball.stiffness', '-o', 'no/x.yaml'], 'the folder of the output no/x'),
        (
            ['film.npz', '-p', 'ball.stiffness:=[0.1]'],
            'nothing is fitted: name parameters, such as -p ball.stiffness, or with bounds, as -p',
        ),
        (
            ['film.npz', '-p', 'ball.stiffness=0.1'],
            'unknown parameter ball.stiffness=0.1: write NAME, NAME:=[LOW,HIGH] or NAME:=VALUE',
        ),
        (
            ['film.npz', '-p', 'gravity'],
            'unknown parameter gravity: it is a group, set one of gravity.magnitude, gravity.dir',
        ),
        (
            ['film.npz', '-p', 'ball.stiffness', '--topic', '/points'],
            '--topic is of a bag, and film.npz is none: leave it out',
        ),
        (['film.npz', '-p', 'ball.stiffness', '--workers', '0'], '--workers is 0: it must be at'),
        (
            ['film.npz', '-p', 'ball.stiffness', '--workers', '1', '--scheduler', 'tcp://a:1'],
            '--workers is of this machine: leave it out beside --scheduler',
        ),
        (['film.npz', '-p', 'ball.stiffness', '--from', '7'], 'the observation lasts from 0 to'),
        (['film.npz', '-p', 'ball.stiffness', '-p', 'ball.mass:=-1'], 'ball.mass is -1'),
        (['film.npz', '-p', 'ball.stiffness', '-p', 'time_offset:=1.0'], 'time_offset is fitted'),
    ],
)
def test_faults_are_one_sentence_and_leave_nothing(
    files, monkeypatch, capsys, arguments, sentence
):
    monkeypatch.chdir(files)
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        assert fit.main(['ball.yaml', *arguments]) == 1
    finally:
        for number, handler in before:
            signal.signal(number, handler)
    out, err = capsys.readouterr()
    assert out == '' and err.startswith(f'fit: {sentence}') and err.count('\n') == 1
    assert sorted(path.name for path in files.iterdir()) == ['ball.yaml', 'film.npz']


# --------------------------------------------------------------------- what is damaged, and lost
FILM = {'bodies': ['ball'], 'ball.positions': np.ones((3, 5, 3)), 'ticks': [0, 5, 10],
        'time_step': 1 / 240}  # fmt: skip


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'ball.positions': np.ones((2, 5, 3))}, r'of ball of the shape \(2, 5, 3\): it must be'),
        ({'ball.positions': np.ones((3, 5, 2))}, r'it must be \(3, n, 3\), the number of its'),
        ({'ball.positions': np.ones(3)}, r'of the shape \(3,\): it must be'),
        ({'ball.positions': ['a', 'b', 'c']}, 'is no film of bake, or damaged: bake it again'),
        ({'time_step': 'x'}, 'is no film of bake, or damaged: bake it again'),
        ({'bodies': ['egg']}, 'is no film of bake, or damaged: bake it again'),
    ],
)
def test_a_film_of_other_arrays_is_refused(tmp_path, change, sentence):
    np.savez(tmp_path / 'film.npz', **FILM | change)
    with pytest.raises(ObservationError, match=sentence):
        read_observation(tmp_path / 'film.npz', ['ball'])


def test_a_damaged_film_is_refused(tmp_path):
    path = tmp_path / 'film.npz'
    np.savez_compressed(
        path, **FILM | {'ball.positions': np.random.default_rng(1).random((3, 90, 3))}
    )
    whole = path.read_bytes()
    begin = whole.find(b'ball.positions') + 400
    for content in (
        b'',
        whole[: len(whole) // 2],
        whole[:begin] + b'\xff' * 200 + whole[begin + 200 :],
    ):
        path.write_bytes(content)
        with pytest.raises(ObservationError, match='is no film of bake, or damaged'):
            read_observation(path, ['ball'])
    path.unlink()
    path.mkdir()
    with pytest.raises(ObservationError, match=r'film\.npz cannot be read: Is a directory'):
        read_observation(path, ['ball'])


def test_a_table_of_times_is_utf_8_with_or_without_a_mark(tmp_path):
    np.save(tmp_path / 'a.npy', np.ones((2, 3)))
    table = tmp_path / 'times.csv'
    table.write_text('a.npy,0.5\n', encoding='utf-8-sig')
    assert read_observation(tmp_path, ['ball']).times.tolist() == [0.5]
    for encoding in ('utf-16', 'latin-1'):
        table.write_text('größe,time\na.npy,0.5\n', encoding=encoding)
        with pytest.raises(ObservationError, match=r'times\.csv cannot be read: it is not UTF-8'):
            read_observation(tmp_path, ['ball'])
    table.unlink()
    table.mkdir()
    with pytest.raises(ObservationError, match=r'times\.csv cannot be read: Is a directory'):
        read_observation(tmp_path, ['ball'])


@pytest.mark.parametrize(
    ('name', 'time'),
    [
        ('cloud_-0.2.txt', -0.2),
        ('cloud-0.2.txt', 0.2),
        ('scan2-0.2.TXT', 0.2),
        ('cloud_1.5e-3.csv', 0.0015),
        ('cloud_+2.5e1.xyz', 25.0),
    ],
)
def test_times_in_names_have_signs_and_exponents(tmp_path, name, time):
    (tmp_path / name).write_text('1 2 3\n', encoding='utf-8-sig')
    observation = read_observation(tmp_path, ['ball'])
    assert observation.times.tolist() == [time]
    assert observation.clouds[ANY_BODY][0].tolist() == [[1.0, 2.0, 3.0]]


def test_arrays_of_other_things_are_no_points(tmp_path):
    np.save(tmp_path / 'a_0.1.npy', np.array([['a', 'b', 'c']]))
    with pytest.raises(ObservationError, match='cannot be read: could not convert'):
        read_observation(tmp_path, ['ball'])


def test_a_seed_is_a_whole_number_from_0(capsys):
    with pytest.raises(SystemExit):
        fit.parser().parse_args(['a.yaml', 'b.npz', '--seed', '-1'])
    assert "argument --seed: '-1' must be a whole number from 0" in capsys.readouterr().err
    assert fit.parser().parse_args(['a.yaml', 'b.npz', '--seed', '7']).seed == 7


def test_a_parameter_beside_which_all_runs_fail_is_not_determined():
    scene = SCENE | {'ball.position': [0.0, 0.0, 0.6]}
    observation = film_of(filmed({'ball.stiffness': 0.3}, 0.4, scene))
    problem = problem_of(observation, ['ball.stiffness', 'ball.bounciness'], scene)
    middle = problem.unknowns[1].coordinate(problem.unknowns[1].start)

    def of_one_bounciness(places):
        return [
            evaluate(problem, place) if place[1] == middle else Outcome(None, 'it broke')
            for place in places
        ]

    runs = _Runs(of_one_bounciness, 2)
    found = runs.descend(np.array([0.5, middle]), (1e-3,))
    assert problem.unknowns[0].value(found.x[0]) == pytest.approx(0.3, rel=0.01)
    jacobian = runs.jacobian(found.x, (1e-3,))
    assert np.isfinite(jacobian[:, 0]).all() and np.isnan(jacobian[:, 1]).all()
    solution = Solution(found.x, jacobian, found.fun, runs.count, runs.failures)
    verdict = judge(problem.unknowns, solution, 0.001)
    stiffness, bounciness = verdict.estimates
    assert stiffness.deviation is not None and not stiffness.note
    assert bounciness.deviation is None
    assert bounciness.note == 'not determined: runs beside it fail'
    assert verdict.warnings == ['ball.bounciness is not determined: runs beside it fail']


def test_steps_over_which_runs_fail_say_nothing_about_the_uncertainty():
    problem = problem_of(film_of(filmed({}, 0.1)), ['ball.stiffness'])

    def fragile(places):
        return [
            Outcome(None, 'it broke')
            if 2e-4 < abs(place[0] - 0.4) < 4e-3
            else Outcome(np.full(3, 500.0 * (place[0] - 0.4)))
            for place in places
        ]

    solution = search(problem, fragile, members=8, generations=2)
    np.testing.assert_allclose(solution.jacobian, 500.0, rtol=1e-6)


def test_what_was_found_is_kept_if_the_scene_as_given_cannot_be_simulated(tmp_path):
    recording = filmed({'ball.stiffness': 0.3}, 0.2)
    problem = problem_of(film_of(recording), ['ball.stiffness'])
    impossible = dataclasses.replace(problem, scene=problem.scene | {'ball.stiffness': -1.0})
    solution = Solution(
        np.array([problem.unknowns[0].coordinate(0.3)]), np.full((len(recording.times), 1), 1e3),
        np.zeros(len(recording.times)), 1, 0,
    )  # fmt: skip
    verdict = judge(problem.unknowns, solution, problem.noise)
    output = tmp_path / 'found.yaml'
    fit._write(impossible, verdict, output, pathlib.Path('film.npz'))
    assert read_scene(str(output))['ball.stiffness'] == pytest.approx(0.3)
    with Image.open(tmp_path / 'found.png') as picture:
        assert picture.size == (960, 672)
