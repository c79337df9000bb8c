# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the pages say is so: programs run, commands are accepted, links lead somewhere."""

import os
import re
import shlex
import subprocess
import sys

from geometry_msgs.msg import WrenchStamped
import numpy as np
from pages import PAGES, ROOT, anchors, everything, links, programs
import pytest
from scene_files import file_of_page, scene_values
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
import yaml

from softbody_ros.core import BodyConfig, World, WorldConfig
from softbody_ros.core.config import checked
from softbody_ros.core.shape_matching.gains import damping_ratio
from softbody_ros.core.shape_matching.material import natural_frequency
from softbody_ros.core.shape_matching.polar_decomposition import rotation
from softbody_ros.ensemble.fit_parameters import make_unknown
from softbody_ros.ensemble.fit_problem import evaluate
from softbody_ros.ensemble.fit_targets import Choice, make_problem
from softbody_ros.ensemble.observation_files import read_observation
from softbody_ros.ros.messages import POINT_TYPE
from softbody_ros.scene import parameters

PROGRAMS = programs()
SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}


@pytest.fixture
def program(graph, tmp_path):
    """Start the program of a name as a process; return the file that it prints to."""
    started = []

    def start(name):
        printed = tmp_path / name
        process = subprocess.Popen(
            [sys.executable, '-u', '-c', PROGRAMS[name]],
            env=os.environ | {'ROS_DOMAIN_ID': str(graph.domain)},
            stdout=printed.open('w'), stderr=subprocess.STDOUT,
        )  # fmt: skip
        started.append(process)
        return printed

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.parametrize('name', ['subscribe', 'lowest'])
def test_the_subscriber_sees_the_ball_fall(graph, program, name):
    printed = program(name)
    graph.sim_node(**SMALL)
    line = re.compile(r'lowest (\S+) m, displaced by up to (\S+) m')
    graph.spin_until(lambda: line.search(printed.read_text()), 'a first line')
    graph.call(Trigger, f'{SIM}/reset')  # it may have fallen before anybody looked

    def seen():
        return [(float(low), float(most)) for low, most in line.findall(printed.read_text())]

    def fallen():
        up = next((index for index, (low, _) in enumerate(seen()) if low > 0.9), len(seen()))
        return [low for low, most in seen()[up:] if most > 0.02]

    low = graph.spin_until(fallen, 'a ball in the air, then a deformed one')[0]
    assert -1e-3 < low < 0.1


def test_the_hand_grips_by_what_its_fingers_feel(graph, program):
    values = {name.replace('.', '__'): value for name, value in scene_values('gripper').items()}
    sim = graph.sim_node(**values)
    printed = program('grip')
    line = re.compile(r'lifted to (\S+) m, with (\S+) N')
    graph.spin_until(lambda: line.search(printed.read_text()), 'the ball is lifted')
    height, force = map(float, line.search(printed.read_text()).groups())
    # how much more than the 8 N depends on how soon the program is told, and stops them
    assert height > 0.19 and 6.0 < force < 40.0
    graph.spin_until(lambda: sim._world.is_asleep('ball'))
    assert not sim._world.obstacle_wrench('ground')[0].any()
    weight = 0.2 * sim._world.config.gravity_magnitude
    assert sim._world.contact_wrench('ball')[0] == pytest.approx([0, 0, weight], abs=1e-3 * weight)


def test_it_rains_cubes(graph, program):
    sim = graph.sim_node(**SMALL)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    printed = program('rain')
    last = ('ball', 'cube_2', 'cube_3', 'cube_4', 'cube_5', 'cube_6')
    graph.spin_until(lambda: sim._world.names == last, 'the seventh cube')
    heights = [sim._world.positions(f'cube_{index}')[:, 2].mean() for index in (2, 6)]
    assert heights[0] < 0.5 and heights[1] > 2.0

    def numbers():
        return np.unique(np.frombuffer(clouds[-1].data, POINT_TYPE)['body']).tolist()

    graph.spin_until(lambda: numbers() == [0, 3, 4, 5, 6, 7])
    assert not printed.read_text()


def test_the_gripper_of_a_urdf_closes_lifts_and_holds(graph, program, monkeypatch):
    monkeypatch.chdir(ROOT)
    values = {name.replace('.', '__'): value for name, value in scene_values('robot').items()}
    sim = graph.sim_node(**values)
    felt = graph.collect(WrenchStamped, f'{SIM}/obstacle_contacts/left_finger', 1000)
    program('robot')
    world = sim._world
    graph.spin_until(lambda: world.rigid_fit('ball').position[2] > 0.245, 'the ball is lifted')
    begin = world.tick
    graph.spin_until(lambda: world.tick > begin + 480, 'two seconds')
    assert world.rigid_fit('ball').position[2] == pytest.approx(0.249, abs=2e-3)
    assert not world.obstacle_wrench('ground')[0].any()
    weight = 0.2 * world.config.gravity_magnitude
    force = felt[-1].wrench.force
    assert 5.0 < -force.x < 30.0
    assert force.z == pytest.approx(-weight / 2, rel=0.02)


def test_the_clock_drives_the_node(graph, program):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    program('clock')
    graph.spin_until(lambda: sim._world.tick > 48)
    graph.spin_until(lambda: clouds and clouds[-1].header.stamp.nanosec > 200_000_000)
    # of /clock, which began at 0 when the program did; a subscriber may be found seconds later
    assert clouds[-1].header.stamp.sec < 1000


def test_the_second_body_is_found_in_the_cloud(graph, program):
    graph.sim_node(bodies=['ball', 'cube'], cube__position=[2.0, 0.0, 1.5], **SMALL)
    printed = program('second')
    line = re.compile(r'centre of the second body: (\S+) (\S+) (\S+)')
    graph.spin_until(lambda: line.search(printed.read_text()), 'a first line')
    x, y, z = map(float, line.search(printed.read_text()).groups())
    assert x == pytest.approx(2.0, abs=0.02) and y == pytest.approx(0.0, abs=0.02) and z > 0.3


def run_program(name, folder):
    return subprocess.run(
        [sys.executable, '-c', PROGRAMS[name]],
        cwd=folder, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip


def test_a_film_is_read_as_the_page_does(tmp_path):
    scene = str(ROOT / 'config' / 'contact.yaml')
    film = str(tmp_path / 'soft.npz')
    bake = [sys.executable, '-m', 'softbody_ros.bake', scene, '-o', film, '--seconds', '0.1']
    subprocess.run([*bake, '-p', 'plum.stiffness:=0.05', '--fps', '20'], check=True, cwd=ROOT)
    lines = run_program('film', tmp_path).splitlines()
    assert len(lines) == 3 and lines[2].startswith('0.100 s: the plum is ')


def test_a_sweep_is_made_and_read_as_the_page_does(tmp_path):
    spec = file_of_page('how_to/many_runs.md', 'bounce.yaml')
    coarse = re.sub(r'steps: \d+', 'steps: 2', spec) + 'fps: 20\n'
    (tmp_path / 'bounce.yaml').write_text(coarse)
    sweep = [sys.executable, '-m', 'softbody_ros.ensemble.sweep', 'bounce.yaml', '--workers', '1']
    environment = os.environ | {'PYTHONPATH': str(ROOT)}
    subprocess.run(sweep, cwd=tmp_path, env=environment, check=True)
    assert (tmp_path / 'bounce' / 'ball.highest_rebound.png').exists()
    best, *heights = run_program('store', tmp_path).splitlines()
    assert best == 'stiffness 1.0, bounciness 1.0'
    assert [line.split(':')[0] for line in heights] == ['0.00 s', '1.50 s']


def test_clouds_are_made_and_fitted_as_the_page_does(tmp_path):
    film = str(tmp_path / 'film.npz')
    scene = str(ROOT / 'config' / 'default.yaml')
    bake = [sys.executable, '-m', 'softbody_ros.bake', scene, '-o', film, '--seconds', '0.2']
    subprocess.run([*bake, '--fps', '10'], check=True, cwd=ROOT)
    run_program('clouds', tmp_path)
    observation = read_observation(tmp_path / 'clouds', ['ball'])
    assert observation.times.tolist() == [0.0, 0.1, 0.2]
    values = scene_values('default')
    unknown = make_unknown(values, 'ball.stiffness', None)
    problem = make_problem(values, [unknown], observation, Choice())
    residuals = evaluate(problem, np.array([0.5])).residuals
    assert np.sqrt(np.mean(residuals**2)) == pytest.approx(1.0, abs=0.1)


def test_every_program_has_a_test_here():
    source = (ROOT / 'tests' / 'test_pages.py').read_text()
    assert len(PROGRAMS) > 5
    for name in PROGRAMS:
        assert re.search(rf"(program\(|run_program\(|PROGRAMS\[|\[|, )'{name}'", source), name
    blocks = re.findall(r'^```python\n(.*)', everything(), re.M)
    assert len(blocks) == len(PROGRAMS) + everything().count('\n# example: ')


# ------------------------------------------------------------------------------ links and commands
@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page):
    for target in links(PAGES[page]):
        if target.startswith(('http://', 'https://')):
            continue
        path, _, anchor = target.partition('#')
        file = (page.parent / path).resolve() if path else page
        assert file.is_relative_to(ROOT) and file.exists(), target
        if anchor and file.suffix == '.md':
            assert anchor in anchors(file.read_text()), target


def test_every_page_is_in_the_contents_and_the_readme_is_short():
    index = PAGES[ROOT / 'docs' / 'index.md']
    for page in PAGES:
        if page.parent != ROOT and page.name != 'index.md':
            assert f'\n{page.relative_to(ROOT / "docs").with_suffix("")}\n' in index, page
    assert len(PAGES[ROOT / 'README.md'].splitlines()) <= 250


def test_parameters_are_set_to_what_they_can_be():
    """Each `ros2 param set` of the pages, and each `-p`, by the rules of the parameters."""
    text = everything() + ''.join(path.read_text() for path in ROOT.glob('config/*.yaml'))
    sent = re.findall(r"ros2 param set /softbody_sim (\S+) ('[^']*'|[^\s`]+)", text)
    sent += re.findall(r"-p ([\w.]+):=('[^']*'|\"[^\"]*\"|[^\s`]+)", text)
    assert len(sent) > 30
    for name, written in sent:
        value = yaml.safe_load(shlex.split(written)[0])
        value = '' if value is None else value
        if name in ('use_sim_time', 'NAME'):  # of every node; in the help of `bake`
            continue
        own = name.partition('.')[2]
        tables = [parameters.table(parameters.SceneLists()), parameters.BODY_TABLE]
        facts = tables[0].get(name) or tables[1].get(own) or parameters.OBSTACLE_TABLE[own]
        if isinstance(value, list) and isinstance(facts.default, float):  # bounds for `fit`
            assert len(value) == 2
            checked(name, float(value[0]), facts)
            value = float(value[1])
        checked(name, value, facts)


# --------------------------------------------------------------------------------------- equations
def free_motion(omega, zeta, h):
    """Return the matrix that takes displacement and velocity of a damped oscillator over h."""
    root = np.sqrt(1.0 - zeta**2)
    decay, phase = np.exp(-zeta * omega * h), root * omega * h
    cosine, sine = decay * np.cos(phase), decay * np.sin(phase) / root
    return np.array([[cosine + zeta * sine, sine / omega], [-omega * sine, cosine - zeta * sine]])


def test_a_tick_is_match_and_move():
    config = BodyConfig(name='ball', mode='linear', volume_conservation=0.0, subdivisions=2)
    world = World(WorldConfig(bodies=(config,), obstacles=()))
    random, rest = np.random.default_rng(1), world.rest_shape('ball')
    w, q = rest.weights, rest.surface.vertices - rest.weights @ rest.surface.vertices
    stretch = np.array([[1.05, 0.02, 0.0], [0.0, 0.97, 0.01], [0.005, 0.0, 1.02]])
    x = world.positions('ball') @ stretch.T + 0.02 * random.normal(size=q.shape)
    c = w @ x
    r, v = x - c, random.normal(size=q.shape)
    v -= w @ v
    inertia = np.einsum('n,ni,ni->', w, r, r) * np.eye(3) - (w * r.T) @ r
    u = v - np.cross(np.linalg.solve(inertia, w @ np.cross(r, v)), r)  # without rotation
    velocity, h, a = np.array([1.0, -2.0, 3.0]), 1 / 240, world.gravity
    world.set_state('ball', x, u + velocity)
    world.step()

    moment, inverse = (w * r.T) @ q, np.linalg.inv((w * q.T) @ q)
    R, A, U = rotation(moment), moment @ inverse, (w * u.T) @ q @ inverse
    y, z = r - q @ A.T, u - q @ U.T
    omega, zeta = natural_frequency(0.5, 1 / 120), damping_ratio(0.5)
    (a11, a12), _ = free_motion(natural_frequency(0.25, 1 / 120), zeta, h)
    (b11, b12), _ = free_motion(3.0 * omega, 0.7, h)
    expected = c + h * velocity + 0.5 * h**2 * a
    expected = expected + q @ (R + a11 * (A - R) + a12 * U).T + b11 * y + b12 * z
    np.testing.assert_allclose(world.positions('ball'), expected, atol=1e-12)


@pytest.mark.parametrize('h', [1 / 60, 1 / 240, 1e-3])
def test_a_tick_about_goals_is_a_damped_swing_about_those_of_the_shape_ahead(h):
    config = BodyConfig(name='ball', mode='linear', deformation=0.0, subdivisions=2,
                        regions_count=1, regions_whole_body_weight=1.0)  # fmt: skip
    world = World(WorldConfig(bodies=(config,), obstacles=(), time_step=h))
    random, rest = np.random.default_rng(1), world.rest_shape('ball')
    w, q = rest.weights, rest.surface.vertices - rest.weights @ rest.surface.vertices
    r = q + 0.01 * random.normal(size=q.shape)
    r, u = r - w @ r, random.normal(size=q.shape)
    u -= w @ u
    inertia = np.einsum('n,ni,ni->', w, r, r) * np.eye(3) - (w * r.T) @ r
    u = u - np.cross(np.linalg.solve(inertia, w @ np.cross(r, u)), r)
    world.set_state('ball', r, u)
    world.step()
    omega, zeta = natural_frequency(0.5, 1 / 120), damping_ratio(0.5)
    kept = np.exp(-2.0 * zeta * omega * h)
    phase = np.arccos(np.cos(np.sqrt(1.0 - zeta**2) * omega * h) / np.cosh(zeta * omega * h))
    tau = np.tan(phase / 2.0) / omega
    g0, g = (q @ rotation((w * (r + time * u).T) @ q).T for time in (0.0, tau))
    u = kept * u + (1.0 - kept) * (g - g0) / tau
    expected = 0.5 * h**2 * world.gravity
    expected = expected + g + np.cos(phase) * (r - g) + np.sin(phase) / omega * u
    decay = np.array([[np.cos(phase), np.sin(phase) * kept / omega],
                      [-omega * np.sin(phase), np.cos(phase) * kept]])  # fmt: skip
    eigenvalues = np.linalg.eigvals(decay)
    frequency = np.sqrt(1.0 - zeta**2) * omega
    exact = np.exp((-zeta * omega + 1j * frequency * np.array([1, -1])) * h)
    np.testing.assert_allclose(sorted(eigenvalues, key=np.imag), sorted(exact, key=np.imag))
    np.testing.assert_allclose(world.positions('ball'), expected, atol=1e-12)
    assert omega / (2.0 * np.pi) == pytest.approx(13.8, abs=0.05)
    followed = natural_frequency(0.25, 1 / 120)
    assert followed / (2.0 * np.pi) == pytest.approx(9.7, abs=0.06)


# --------------------------------------------------------------------------------------- the table
def drop(**values):
    """Return the largest dent, % RMS of the radius, and how high the ball jumps, cm."""
    gravity = {key: values.pop(key) for key in list(values) if key.startswith('gravity')}
    ball = BodyConfig(name='ball', subdivisions=2, **values)
    world = World(WorldConfig(bodies=(ball,), **gravity))
    dents, lowest = [], []
    while world.time < (2.0 if not gravity else 1.5):
        world.step(2)
        lowest.append(world.positions('ball')[:, 2].min())
        dents.append(np.sqrt(np.mean(world.rigid_fit('ball').displacement ** 2)) / 0.5)
    hit = int(np.argmax(np.array(lowest) < 1e-3))
    return 100.0 * max(dents), 100.0 * max(lowest[hit:])


@pytest.mark.parametrize(
    ('name', 'values', 'dent', 'jump'),
    [
        ('stiffness', (0.1, 0.5, 1.0), -1, +1),
        ('bounciness', (0.0, 0.5, 0.8), +1, +1),
        ('deformation', (0.0, 0.5, 0.75), +1, -1),
        ('elasticity', (0.0, 0.3, 1.0), +1, +1),
        ('damping', (0.0, 0.2, 0.5), -1, -1),
        ('mass', (0.5, 1.0, 10.0), 0, 0),
        ('gravity_magnitude', (9.81, 20.0), +1, -1),
        ('mode', ('rigid', 'linear', 'quadratic'), +1, None),
    ],
)
def test_turning_a_parameter_up_does_what_the_table_says(name, values, dent, jump):
    dents, jumps = zip(*(drop(**{name: value}) for value in values), strict=True)
    for measured, direction in [(dents, dent), (jumps, jump)]:
        if direction == 0:
            assert np.ptp(measured) < 1e-10
        elif direction is not None:
            assert (direction * np.diff(measured) > 0.0).all(), measured


def test_the_table_has_every_live_parameter_of_the_physics():
    table = (ROOT / 'docs/how_to/tuning.md').read_text()
    start = ('position', 'orientation', 'initial_velocity', 'color')
    for name, facts in parameters.table(parameters.SceneLists()).items():
        first, _, own = name.partition('.')
        if facts.read_only or first not in ('ball', 'gravity') or own.startswith(start):
            continue
        group = name.rpartition('.')[0]
        assert f'`{name}`' in table or f'`{group}`' in table or f'`.{own.split(".")[-1]}`' in table
    assert '`time_scale`' in table
