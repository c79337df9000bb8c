# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the page does beyond parameters: scenes, meshes, films, keys, its look.

All tests share one page, since a browser needs seconds for one; each finds the same scene.
"""

import base64
import io
import os
import pathlib
import re
import signal
import threading

import browser as browser_of_tests
import numpy as np
from playwright.sync_api import expect
import pytest
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from ros_graph import Graph
from scene_files import ROOT, SCENES, scene_values
from sensor_msgs.msg import PointCloud2
from shown_page import SIM, Show, button
from std_srvs.srv import Trigger

from softbody_ros.core import make_surface
from softbody_ros.ros.messages import POINT_TYPE
from softbody_ros.viewer.page import LARGEST_FILE
from softbody_ros.viewer.recording import Baking
from softbody_ros.viewer.scene_requests import NOTHING, scene_request, shipped_scenes

DROP = """([name, base64, size]) => {
  const bytes = size ? new Uint8Array(size) : Uint8Array.from(atob(base64), c => c.charCodeAt(0));
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([bytes], name));
  for (const kind of ['dragover', 'drop'])
    document.body.dispatchEvent(
      new DragEvent(kind, {bubbles: true, cancelable: true, dataTransfer}));
}"""


START = {
    'ball.subdivisions': 1,
    'gravity.magnitude': 5.0,
    'time_step': 0.015625,  # it runs for long, and looks at its clock each tick
}


@pytest.fixture(scope='module')
def only_show(browser, compiled_ahead):
    graph = Graph()
    try:
        arguments = [part for name in START for part in ('-p', f'{name}:={START[name]}')]
        graph.process('--ros-args', *arguments)
        result = Show(browser, graph, draws=False)
        result.node = Parameters(graph)
        result.says(f'{SIM}: running')
        expect(button(result, 'Reset')).to_be_enabled()
        for folder, inside in (('scene', 'Open scene file'), ('film', 'Record')):
            browser_of_tests.open_folder(result.page, folder, button(result, inside))
        yield result
        result.page.close()
        result.viewer.send_signal(signal.SIGINT)
        _, errors = result.viewer.communicate(timeout=30)
        assert 'failed' not in errors
        assert 'Traceback' not in errors
    finally:
        graph.close()


@pytest.fixture
def show(only_show):
    """Return the page of a node that simulates the ball of `START`, whatever was there before."""
    node = only_show.node
    before = node.values()
    request = scene_request(START, before)
    if request.from_nothing:
        node.ask(NOTHING)
    if {name: before.get(name) for name in request.values} != request.values:
        node.ask(request.values)
    if button(only_show, 'Go on').is_visible():
        button(only_show, 'Go on').click()
    return only_show


class Parameters:
    """All parameters of a node."""

    def __init__(self, graph):
        self._graph, self._client = graph, AsyncParameterClient(graph.node, SIM)
        graph.spin_until(self._client.services_are_ready)

    def _answer(self, future):
        self._graph.spin_until(future.done, 'an answer')
        return future.result()

    def ask(self, values):
        sent = [Parameter(name, value=value) for name, value in values.items()]
        result = self._answer(self._client.set_parameters_atomically(sent)).result
        assert result.successful, result.reason

    def values(self):
        names = self._answer(self._client.list_parameters()).result.names
        values = self._answer(self._client.get_parameters(names)).values
        return dict(zip(names, map(parameter_value_to_python, values), strict=True))


def drop(show, name, content=b'', size=0):
    show.page.evaluate(DROP, [name, base64.b64encode(content).decode(), size])


def is_told(show, *texts):
    """Wait for a notice with these texts, and close it."""
    notice = show.page.locator('.mantine-Notification-root')
    for text in texts:
        notice = notice.filter(has_text=text)
    expect(notice.first).to_be_visible()
    browser_of_tests.close_notices(show.page)


def scene(**values):
    lines = [f'    {name.replace("__", ".")}: {value}\n' for name, value in values.items()]
    return '/**:\n  ros__parameters:\n' + ''.join(lines)


def in_a_file(text):
    return {'name': 'mine.yaml', 'mimeType': 'text/yaml', 'buffer': text.encode()}


def open_scene(show, text):
    with show.page.expect_file_chooser() as chooser:
        button(show, 'Open scene file').click()
    chooser.value.set_files(in_a_file(text))


# ------------------------------------------------------------------------------------- the look
def test_a_page_is_as_dark_as_its_system_until_somebody_chooses(show, browser):
    context = browser.new_context(color_scheme='dark', viewport={'width': 390, 'height': 844})
    page = context.new_page()
    browser_of_tests.slow_down(page)
    browser_of_tests.draw_nothing(page)
    dark, light = (
        page.locator(f'html[data-mantine-color-scheme={scheme}]') for scheme in ('dark', 'light')
    )
    page.goto(f'http://127.0.0.1:{show.port}')
    expect(dark).to_be_attached()
    # a phone: the panel is folded
    reset = page.get_by_role('button', name='Reset')
    expect(reset).not_to_be_in_viewport()
    page.get_by_text('softbody_ros', exact=True).click()
    expect(reset).to_be_in_viewport()
    change = page.get_by_role('button', name='Dark or light')
    browser_of_tests.open_folder(page, 'help', change)
    change.click()
    expect(light).to_be_attached()
    page.reload()
    page.get_by_text('softbody_ros', exact=True).click()
    expect(reset).to_be_in_viewport()
    expect(light).to_be_attached()
    expect(show.page.locator('html[data-mantine-color-scheme=light]')).to_be_attached()
    context.close()


def test_keys_pause_and_step_and_reset(show):
    clouds = show.graph.collect(PointCloud2, f'{SIM}/points', 500)

    def top():
        return np.frombuffer(clouds[-1].data, POINT_TYPE)['z'].max() if clouds else None

    show.graph.spin_until(lambda: clouds and top() < 1.2, 'a ball on the ground')
    show.page.keyboard.press('r')
    show.graph.spin_until(lambda: top() > 1.5, 'a ball in the air')
    show.page.keyboard.press('Space')
    show.says(f'{SIM}: paused')
    clouds.clear()
    show.page.keyboard.press('.')
    show.graph.spin_until(lambda: clouds, 'a tick')
    button(show, 'Go on').click()
    show.says(f'{SIM}: running')
    # the button that was clicked is not pressed by the space bar as well
    show.page.keyboard.press('Space')
    show.says(f'{SIM}: paused')
    show.page.keyboard.press('Space')
    show.says(f'{SIM}: running')


# ---------------------------------------------------------------------------------------- scenes
def test_an_example_replaces_the_scene(show):
    browser_of_tests.choose(show.page, 'example', 'gripper')
    button(show, 'Load').click()
    is_told(show, 'gripper.yaml is loaded')
    given = scene_values('gripper')
    names = ['bodies', 'obstacles', 'ball.size', 'left.position']
    assert show.graph.get_parameters(SIM, names) == [given[name] for name in names]
    assert show.parameter('gravity.magnitude') == 9.81  # it does not say
    show.says('162 vertices')


def test_a_file_of_ones_own_is_a_scene_but_for_what_cannot_change(show):
    open_scene(show, scene(time_step=0.01, ball__subdivisions=1, ball__stiffness=0.75))
    is_told(show, 'mine.yaml is loaded', 'time_step stays 0.01562: the scene has 0.01')
    assert show.parameter('ball.stiffness') == 0.75
    assert show.parameter('obstacles') == ['ground']


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        (scene(ball__mesh='/nowhere.stl'), '/nowhere.stl does not exist'),
        (scene(ball__stiffness=2.0), 'ball.stiffness is 2.0: it must be from 0 to 1'),
        ('a: b', 'parameters stand below the name of a node'),
    ],
)
def test_a_scene_that_is_refused_leaves_the_one_that_is_there(show, text, sentence):
    before = show.graph.get_parameters(SIM, show.graph.list_parameters(SIM))
    open_scene(show, text)
    is_told(show, 'mine.yaml is not loaded', sentence)
    after = show.graph.get_parameters(SIM, show.graph.list_parameters(SIM))
    assert after == before


# ---------------------------------------------------------------------------------------- meshes
def ball_file(subdivisions=1):
    surface = make_surface('icosphere', 0.03, subdivisions)
    lines = [f'v {x} {y} {z}\n' for x, y, z in surface.vertices]
    lines += ['f {} {} {}\n'.format(*face) for face in surface.faces + 1]
    return ''.join(lines).encode()


def test_a_mesh_that_is_dropped_is_a_body_above_the_others(show):
    # its size is like that of what the viewer has got
    expect(show.page.locator('body')).to_contain_text(re.compile(r'\D42 vertices'))
    drop(show, 'my ball.obj', ball_file())
    is_told(show, 'my ball.obj is the body my_ball')
    assert show.parameter('bodies') == ['ball', 'my_ball']
    assert show.parameter('my_ball.size') == pytest.approx(show.parameter('ball.size'), rel=0.1)
    assert show.parameter('my_ball.position')[2] > 2.0 * show.parameter('ball.size')
    show.number('its size [m]').fill('0.125')
    show.number('its size [m]').press('Enter')
    drop(show, 'my ball.obj', ball_file())
    is_told(show, 'is the body my_ball_2')
    assert show.parameter('my_ball_2.size') == 0.125
    show.says('126 vertices')
    show.number('its size [m]').fill('0')
    show.number('its size [m]').press('Enter')


def test_what_is_no_mesh_is_refused_in_a_sentence(show):
    bodies = show.parameter('bodies')
    drop(show, 'empty.stl')
    is_told(show, 'empty.stl is not added', 'is empty')
    for name, size, sentence in [
        ('large.stl', LARGEST_FILE + 1, 'large.stl has 101 MB: the viewer takes up to 100 MB'),
        ('letter.doc', 0, 'letter.doc is neither a mesh'),
    ]:
        with show.page.expect_event('dialog') as dialog:
            # the page waits for it
            show.page.once('dialog', lambda each: each.accept())
            drop(show, name, size=size)
        assert sentence in dialog.value.message
    assert show.parameter('bodies') == bodies


# ----------------------------------------------------------------------------------------- files
def test_a_saved_scene_starts_a_node_with_the_same_parameters(show, tmp_path):
    drop(show, 'my ball.obj', ball_file())
    is_told(show, 'is the body my_ball')
    with show.page.expect_download() as download:
        button(show, 'Save scene file').click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    assert '# my_ball.mesh is the file of a mesh that was dropped' in file.read_text()
    names = show.graph.list_parameters(SIM)
    show.graph.process('--ros-args', '--params-file', str(file), '-r', '__node:=again')
    show.graph.call(Trigger, '/again/reset')
    assert sorted(show.graph.list_parameters('/again')) == sorted(names)
    again = show.graph.get_parameters('/again', names)
    assert dict(zip(names, again, strict=True)) == dict(
        zip(names, show.graph.get_parameters(SIM, names), strict=True)
    )


def test_a_film_is_recorded_and_downloaded(show):
    browser_of_tests.choose(show.page, 'format', '.npz')
    drop(show, 'my ball.obj', ball_file())
    is_told(show, 'is the body my_ball')
    bodies = show.parameter('bodies')
    # a film that takes a minute: one of small balls may be ready before the page has clicked
    drop(show, 'soft.obj', ball_file(subdivisions=4))
    is_told(show, 'soft.obj is the body soft')
    for name, value in {
        'mode': 'quadratic',
        'natural_frequency': 2.0,
        'friction': 0.0,
        'initial_velocity.linear': [1.0, 0.0, 0.0],
    }.items():
        assert show.graph.set_parameter(SIM, f'soft.{name}', value).successful
    show.number('seconds').fill('60')
    show.number('seconds').press('Enter')
    button(show, 'Record').click()
    expect(button(show, 'Record')).not_to_be_visible()
    button(show, 'Cancel').dispatch_event('click')  # at once, not when it has ceased to move
    expect(button(show, 'Record')).to_be_visible()
    ready = show.page.get_by_role('button', name=re.compile(r'Download film.npz'))
    expect(ready).not_to_be_visible()
    assert show.graph.set_parameter(SIM, 'bodies', bodies).successful
    show.number('seconds').fill('0.5')
    show.number('seconds').press('Enter')
    button(show, 'Record').click()
    expect(ready).to_be_visible()
    with show.page.expect_download() as download:
        ready.click()
    film = np.load(io.BytesIO(pathlib.Path(download.value.path()).read_bytes()))
    assert film['bodies'].tolist() == bodies == ['ball', 'my_ball']
    assert film['times'][-1] == 0.5
    assert len(film['times']) == 16


def test_a_film_that_fails_says_why(show):
    drop(show, 'my ball.obj', ball_file())
    is_told(show, 'is the body my_ball')
    pathlib.Path(show.parameter('my_ball.mesh')).unlink()
    button(show, 'Record').click()
    is_told(show, 'no film', 'my_ball.mesh', 'does not exist')
    expect(button(show, 'Record')).to_be_visible()


# -------------------------------------------------------------------------------- without a page
class Bake:
    """A bake of the default scene, and what it says."""

    def __init__(self, film, seconds):
        self.parts, self.ends, self._ended = [], [], threading.Event()
        scene = str(ROOT / 'config' / 'default.yaml')
        arguments = [scene, f'--seconds={seconds}', '--fps=60', f'--output={film}']
        self.baking = Baking(arguments, self.parts.append, self._end)

    def _end(self, *outcome):
        self.ends.append(outcome)
        self._ended.set()

    def end(self):
        """Wait for its end; return its status and what it has said."""
        assert self._ended.wait(60.0)
        assert len(self.ends) == 1
        return self.ends[0]


def test_a_bake_that_is_killed_says_so(compiled_ahead, tmp_path):
    bake = Bake(tmp_path / 'film.npz', 10_000)
    bake.baking._process.kill()
    status, sentence = bake.end()
    assert status == -signal.SIGKILL
    assert sentence.startswith('bake was ended (Killed), perhaps for lack of memory: take fewer')


def test_a_bake_that_fails_unexpectedly_says_what_of(compiled_ahead, tmp_path, monkeypatch):
    (tmp_path / 'tqdm.py').write_text("raise RuntimeError('it is broken')")
    places = [str(tmp_path), *filter(None, [os.environ.get('PYTHONPATH')])]
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(places))
    status, sentence = Bake(tmp_path / 'film.npz', 0.1).end()
    assert status == 1
    assert sentence.startswith('bake has failed (RuntimeError: it is broken): save the scene')


def test_a_bake_says_how_far_it_is(compiled_ahead, tmp_path):
    film = tmp_path / 'film.npz'
    bake = Bake(film, 30)
    assert bake.end() == (0, '')
    parts = bake.parts
    assert film.exists()
    assert len(parts) > 1
    assert parts == sorted(parts)
    assert 0.0 <= parts[0] < parts[-1] <= 1.0


def test_every_example_follows_every_other_in_a_node_that_runs(graph):
    graph.process('--ros-args', '-p', 'ball.subdivisions:=1')
    assert list(shipped_scenes()) == SCENES

    node = Parameters(graph)
    for name in SCENES:
        request = scene_request(scene_values(name), node.values())
        if request.from_nothing:
            node.ask(NOTHING)
        node.ask(request.values)
        now = node.values()
        assert {each: now[each] for each in request.values} == request.values
        assert scene_request(scene_values(name), now).from_nothing is False
