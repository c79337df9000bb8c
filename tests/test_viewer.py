# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The viewer as people use it: a real browser, a real node, each a process of its own."""

import contextlib
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import browser as browser_of_tests
from geometry_msgs.msg import PointStamped
import numpy as np
from playwright.sync_api import expect
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_graph import TIMEOUT, Graph
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from shown_page import BALL, PATIENCE, SIM, Show, button
import viser
from visualization_msgs.msg import Marker, MarkerArray
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from softbody_ros.ros.messages import POINT_TYPE

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope='module')
def show(browser):
    """Return one show for all tests: a browser without a GPU needs seconds for a page."""
    graph = Graph()
    try:
        simulation = graph.process('--ros-args', '-p', 'time_scale:=0.5')
        result = Show(browser, graph)
        result.simulation = simulation
        result.says(f'{SIM}: running')
        expect(result.row('stiffness')).to_be_visible()
        graph.spin_until(result.sees_ball, 'a ball in the view')
        yield result
        result.page.close()
        result.viewer.send_signal(signal.SIGINT)
        _, errors = result.viewer.communicate(timeout=TIMEOUT)
        assert 'failed' not in errors
    finally:
        graph.close()


def heights(cloud):
    return np.frombuffer(cloud.data, POINT_TYPE)['z']


# --------------------------------------------------------------------------------------- the view
def test_the_page_shows_a_body_that_falls_and_the_reset_button_puts_it_back(show):
    show.graph.spin_until(lambda: show.height() < 141, 'a ball on the ground')
    before = show.picture()
    clouds = show.graph.collect(PointCloud2, f'{SIM}/points', 500)
    show.graph.spin_until(lambda: clouds)
    button(show, 'Pause').click()  # a browser that draws slowly would miss it
    show.says(f'{SIM}: paused')
    button(show, 'Reset').click()
    show.graph.spin_until(lambda: show.height() > 183, 'a ball up in the air')
    assert np.mean(np.abs(show.picture() - before).max(axis=-1) > 30) > 0.01
    # the node's ball, too: it starts 1.5 m up, with a radius of 0.5 m
    show.graph.spin_until(lambda: any(heights(cloud).max() > 1.9 for cloud in clouds))
    button(show, 'Go on').click()
    show.says(f'{SIM}: running')
    show.graph.spin_until(lambda: show.height() < 141, 'it falls again')


@pytest.mark.parametrize(
    ('quantity', 'unit'),
    [('displacement', '[cm]?m'), ('pressure', '[kM]?Pa'), ('permanent strain', '%')],
)
def test_colours_by_a_quantity_with_a_legend(show, quantity, unit):
    def blue():
        picture = show.picture()
        return (picture[..., 2] > picture[..., 0] + 30).sum()

    show.graph.spin_until(show.sees_ball)
    browser_of_tests.choose(show.page, 'colour by', quantity)
    # once it has come to rest, little is blue: the ground presses it flat by some millimetres
    show.graph.spin_until(lambda: not show.sees_ball() and blue() > BALL, 'another colour')
    legend = show.page.locator('div[style*="linear-gradient"]')
    expect(legend).to_be_visible()
    expect(legend.locator('xpath=..')).to_contain_text(re.compile(rf'0\s*[\d.]+ {unit}'))
    browser_of_tests.choose(show.page, 'colour by', 'body')
    show.graph.spin_until(show.sees_ball, 'orange again')
    expect(legend).to_be_hidden()


def test_obstacles_are_shown(show):
    before = show.picture()
    publisher = show.graph.node.create_publisher(MarkerArray, f'{SIM}/obstacles', 1)
    show.graph.spin_until(publisher.get_subscription_count)
    box = Marker(ns='tester', type=Marker.CUBE)
    box.header.frame_id = 'world'
    box.pose.position.x, box.pose.position.z, box.pose.orientation.w = -1.2, 0.3, 1.0
    box.scale.x = box.scale.y = box.scale.z = 0.6
    publisher.publish(MarkerArray(markers=[box]))
    show.graph.spin_until(
        lambda: np.mean(np.abs(show.picture() - before).max(axis=-1) > 30) > 0.01, 'a box'
    )


def test_contact_forces_are_arrows_while_they_are_wanted(show):
    def listeners():
        return show.graph.node.count_subscribers(f'{SIM}/contacts/ball')

    def crimson():
        red, green, blue = np.moveaxis(show.picture(), -1, 0)
        return ((red > green + 60) & (blue > green)).sum()

    assert listeners() == 0
    show.graph.spin_until(show.sees_ball)
    assert not crimson()
    box = show.row('contact forces').locator('input')
    box.check()
    # the ground holds it: an arrow into it, which is seen through it
    show.graph.spin_until(lambda: crimson() > 100, 'an arrow')
    show.graph.spin_until(lambda: listeners() == 1)
    box.uncheck()
    show.graph.spin_until(lambda: not crimson() and show.sees_ball(), 'no arrow')
    show.graph.spin_until(lambda: not listeners())


def test_plots_of_a_body_while_it_is_chosen(show):
    def listeners():
        return show.graph.node.count_subscribers(f'{SIM}/odometry')

    def curves():
        """Return times, heights, speeds and forces as in the page; None while it has none."""
        charts = show.page.evaluate(
            'Object.values(window.__viserTestpoints?.uplots ?? {})'
            '.map(({chart}) => [chart.data[0], chart.data[1]].map(each => Array.from(each)))'
        )
        whole = len(charts) == 3 and len({len(each) for chart in charts for each in chart}) == 1
        return np.array([charts[0][0], *(chart[1] for chart in charts)]) if whole else None

    browser_of_tests.open_folder(show.page, 'plots', show.row('plot'))
    assert listeners() == 0
    browser_of_tests.choose(show.page, 'plot', 'ball')
    show.graph.spin_until(lambda: curves() is not None and curves().shape[1] > 1, 'curves')
    button(show, 'Reset').click()
    patience, seen = time.monotonic() + PATIENCE, None

    def has_fallen_and_rests():
        nonlocal patience, seen
        seen = curves()
        if seen is None:  # in the middle of an update
            return False
        _, height, speed, force = seen
        fallen = height.max() > 1.45 and speed.max() > 3.0 and force.max() > 15.0
        rests = height[-1] < 0.52 and speed[-10:].max() < 1e-3 and np.ptp(force[-10:]) < 0.01
        if rests and not fallen and time.monotonic() > patience:
            # of few clouds a second none shows its top, or they are out of the plot by now
            button(show, 'Reset').click()
            patience = time.monotonic() + PATIENCE
        return fallen and rests

    show.graph.spin_until(has_fallen_and_rests)
    times, height, speed, force = seen
    assert times[0] >= -10.0 and np.abs(times[-1]) < 0.011 and (np.diff(times) > 0.0).all()
    # simulated seconds, of which this node has half as many as there are
    falls = (height > 0.6) & (speed > 0.5) & (np.gradient(height) < 0.0)
    slopes = np.gradient(height, times)[falls]
    assert np.median(-slopes / speed[falls]) == pytest.approx(1.0, abs=0.1)
    assert force[-1] == pytest.approx(9.81, rel=0.02)
    browser_of_tests.choose(show.page, 'plot', 'nothing')
    show.graph.spin_until(lambda: not listeners() and curves() is None)


# -------------------------------------------------------------------------------------- the panel
def test_a_slider_sets_the_parameter_of_the_node(show):
    thumb = show.row('stiffness').get_by_role('slider')
    assert (thumb.get_attribute('aria-valuemin'), thumb.get_attribute('aria-valuemax')) == (
        '0',
        '1',
    )

    def drag():
        thumb.scroll_into_view_if_needed()
        track = show.row('stiffness').locator('.mantine-Slider-track').bounding_box()
        middle = track['y'] + track['height'] / 2
        show.page.mouse.move(track['x'] + 0.5 * track['width'], middle)
        show.page.mouse.down()
        for share in np.linspace(0.5, 0.9, 9):
            show.page.mouse.move(track['x'] + share * track['width'], middle)
        show.page.mouse.up()

    def is_shown():
        """Whether all that was done has come to the node."""
        return show.parameter('ball.stiffness') == float(thumb.get_attribute('aria-valuenow'))

    show.act_until(drag, lambda: 0.85 < show.parameter('ball.stiffness') < 0.95 and is_shown())
    # keys take single steps
    value = show.parameter('ball.stiffness')
    show.act_until(
        lambda: thumb.press('ArrowRight'),
        lambda: show.parameter('ball.stiffness') > value and is_shown(),
    )


def test_a_change_made_elsewhere_moves_the_slider(show):
    assert show.graph.set_parameter(SIM, 'ball.stiffness', 0.25).successful
    expect(show.number('stiffness')).to_have_value('0.25')
    slider = show.row('stiffness').get_by_role('slider')
    expect(slider).to_have_attribute('aria-valuenow', '0.25')
    # beyond what a slider of 0 … 2 kg shows
    assert show.graph.set_parameter(SIM, 'ball.mass', 40.0).successful
    expect(show.number('mass [kg]')).to_have_value('40')
    assert show.graph.set_parameter(SIM, 'ball.mode', 'rigid').successful
    expect(show.row('mode').locator('input').first).to_have_value('rigid')
    assert show.graph.set_parameter(SIM, 'ball.mode', 'quadratic').successful


def test_choices_set_the_parameter_of_the_node(show):
    browser_of_tests.choose(show.page, 'mode', 'linear')
    show.graph.spin_until(lambda: show.parameter('ball.mode') == 'linear')


def test_a_refused_value_shows_why_and_snaps_back(show):
    up = show.number('direction', 2)
    expect(up).to_have_value('-1')
    up.fill('0')
    up.press('Enter')
    show.says('its length must not be zero')
    expect(up).to_have_value('-1')
    assert show.parameter('gravity.direction') == [0.0, 0.0, -1.0]


def test_tooltips_are_the_descriptions(show):
    show.number('elasticity').hover()
    show.says('restitution ε')


def test_pause_step_and_apply_velocity(show):
    button(show, 'Pause').click()
    show.says(f'{SIM}: paused')
    step = button(show, 'Step')
    expect(step).to_be_enabled()
    clouds = show.graph.collect(PointCloud2, f'{SIM}/points')
    # who listens anew while it is paused gets what there is: that is no tick yet
    paused = show.graph.spin_until(lambda: clouds and clouds[0])
    step.click()
    show.graph.spin_until(lambda: clouds[-1].header.stamp != paused.header.stamp, 'a tick')
    button(show, 'Go on').click()
    show.says(f'{SIM}: running')
    spin = show.number('linear [m∕s]', 2)
    spin.fill('6')
    spin.press('Enter')
    show.graph.spin_until(lambda: show.parameter('ball.initial_velocity.linear')[2] == 6.0)
    button(show, 'Apply velocity').click()
    show.graph.spin_until(
        lambda: any(heights(cloud).min() > 0.3 for cloud in clouds), 'a ball that is up'
    )


def test_a_click_on_a_body_pokes_it_there(show):
    pokes = show.graph.collect(PointStamped, f'{SIM}/poke')
    clouds = show.graph.collect(PointCloud2, f'{SIM}/points', 500)
    show.graph.spin_until(lambda: clouds)
    button(show, 'Pause').click()
    show.says(f'{SIM}: paused')

    def click():
        browser_of_tests.close_notices(show.page)
        show.graph.spin_until(show.sees_ball)
        rows, columns = np.nonzero(show.orange())
        show.page.mouse.click(columns.mean(), rows.mean())

    # a browser that draws slowly may still show an older picture, or miss a click
    show.act_until(click, lambda: pokes, 'a poke')
    point = pokes[0].point

    def distance(cloud):
        points = np.frombuffer(cloud.data, POINT_TYPE)
        return np.hypot(
            np.hypot(points['x'] - point.x, points['y'] - point.y), points['z'] - point.z
        ).min()

    # it moves: the last cloud that is shown need not be the last one of all
    show.graph.spin_until(lambda: any(distance(cloud) < 0.1 for cloud in clouds))
    assert point.y < 0.0  # the camera's side
    assert pokes[0].header.frame_id == 'world'
    button(show, 'Go on').click()
    show.says(f'{SIM}: running')


def test_it_binds_to_this_machine_only(show):
    # all of 127.0.0.0/8 is this machine, but only 127.0.0.1 is served
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(('127.0.0.2', show.port))


def test_pages_of_others_cannot_steer(show):
    # as what any page in the browser of the same person might try
    with connect(
        f'ws://127.0.0.1:{show.port}', origin='http://elsewhere.example',
        subprotocols=[f'viser-v{viser.__version__}'],
    ) as other, pytest.raises(ConnectionClosed, match='only the page of this server'):  # fmt: skip
        other.recv(timeout=10.0)


# ---------------------------------------------------------------------------- nodes come and go
def test_what_comes_and_goes_is_shown_and_steered(show):
    assert show.graph.set_parameter(SIM, 'late.subdivisions', 1).successful
    assert show.graph.set_parameter(SIM, 'late.stiffness', 0.875).successful
    assert show.graph.set_parameter(SIM, 'late.position', [9.0, 0.0, 1.0]).successful
    assert show.graph.set_parameter(SIM, 'bodies', ['ball', 'late']).successful
    show.says('684 vertices')
    browser_of_tests.choose(show.page, 'body', 'late')
    expect(show.number('stiffness')).to_have_value('0.875')
    show.number('stiffness').fill('0.25')
    show.number('stiffness').press('Enter')
    show.graph.spin_until(lambda: show.parameter('late.stiffness') == 0.25)
    # what is chosen stays so when something else comes
    assert show.graph.set_parameter(SIM, 'obstacles', ['ground', 'post']).successful
    expect(show.row('obstacle')).to_be_visible()
    expect(show.number('stiffness')).to_have_value('0.25')
    assert show.graph.set_parameter(SIM, 'obstacles', ['ground']).successful
    assert show.graph.set_parameter(SIM, 'bodies', ['late']).successful
    show.says('42 vertices')
    expect(show.row('body')).not_to_be_visible()
    expect(show.number('stiffness')).to_have_value('0.25')
    assert show.graph.set_parameter(SIM, 'bodies', ['ball']).successful
    show.says('642 vertices')
    show.graph.spin_until(show.sees_ball, 'a ball in the view')


def test_a_node_that_goes_is_missed_and_one_that_comes_is_shown(show):
    show.says('642 vertices')
    show.simulation.send_signal(signal.SIGKILL)  # without a word
    show.says('is gone')
    expect(button(show, 'Reset')).to_be_disabled()
    show.graph.process(
        '--ros-args', '-p', 'bodies:=[ball, other]', '-p', 'ball.stiffness:=0.125',
        '-p', 'ball.subdivisions:=2', '-p', 'other.subdivisions:=1',
        '-p', 'ball.position:=[30.0, 0.0, 1.5]', '-p', 'other.position:=[30.0, 2.0, 1.0]',
        '-p', 'time_step:=0.015625',  # it runs for long, and looks at its clock each tick
    )  # fmt: skip
    show.says('204 vertices')
    expect(show.number('stiffness')).to_have_value('0.125')
    expect(button(show, 'Reset')).to_be_enabled()
    show.graph.spin_until(show.sees_ball, 'the other ball, far from where the first was')


def meet_again(graph):
    """Ask the node until it answers: what is asked of the one that was killed is lost."""
    client = graph.node.create_client(GetParameters, f'{SIM}/get_parameters')
    futures = []

    def answered():
        if client.service_is_ready():
            futures.append(client.call_async(GetParameters.Request(names=['bodies'])))
        return any(future.done() for future in futures)

    graph.spin_until(answered, 'an answer of the other node')


def test_of_several_bodies_the_chosen_one_is_steered(show):
    meet_again(show.graph)
    assert show.graph.set_parameter(SIM, 'other.stiffness', 0.75).successful

    def choose(body):
        browser_of_tests.choose(show.page, 'body', body)

    choose('other')
    expect(show.number('stiffness')).to_have_value('0.75')
    show.number('stiffness').fill('0.625')
    show.number('stiffness').press('Enter')
    show.graph.spin_until(lambda: show.parameter('other.stiffness') == 0.625)
    assert show.parameter('ball.stiffness') == 0.125
    # what is not shown is kept up to date
    assert show.graph.set_parameter(SIM, 'ball.stiffness', 0.375).successful
    assert show.graph.set_parameter(SIM, 'other.stiffness', 0.5).successful
    expect(show.number('stiffness')).to_have_value('0.5')
    choose('ball')
    expect(show.number('stiffness')).to_have_value('0.375')


def test_messages_alone_are_shown_as_of_a_bag(show, browser, graph):
    """What was recorded of a node is played under another name, where nobody answers."""
    show.page.goto('about:blank')  # one view at a time is work enough
    recorded = graph.process('--ros-args', '-p', 'points_rate:=20.0')
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    meshes = graph.collect(Mesh, f'{SIM}/rest_mesh', LATCHED)
    graph.spin_until(lambda: len(clouds) > 5 and meshes)
    tape = Show(browser, graph, '/tape')
    assert f'open http://127.0.0.1:{tape.port} in a browser' in tape.greeting
    tape.says('Waiting for /tape')
    tape.says('viewer --node /softbody_sim')  # what else there is
    recorded.kill()
    mesh = graph.node.create_publisher(Mesh, '/tape/rest_mesh', LATCHED)
    points = graph.node.create_publisher(PointCloud2, '/tape/points', 10)
    mesh.publish(meshes[0])

    def plays_until(condition):
        graph.spin_until(lambda: points.publish(clouds[0]) or condition())

    plays_until(lambda: 'a recording: nothing to steer' in tape.page.inner_text('body'))
    plays_until(tape.sees_ball)
    expect(button(tape, 'Reset')).to_be_disabled()
    tape.page.close()
    tape.viewer.send_signal(signal.SIGINT)
    _, errors = tape.viewer.communicate(timeout=TIMEOUT)
    assert tape.viewer.returncode == 0, errors
    assert 'Traceback' not in errors


# ------------------------------------------------------------------------------- the command line
@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--port', '99999'], "'99999' is no port: it must be from 1 to 65535"),
        (['--host', 'nowhere'], "'nowhere' is no IP address: give one such as 127.0.0.1"),
        (['--node', 'a b'], "'a b' is no name of a node: give one such as /softbody_sim"),
        (['--rate', '0'], "'0' is no rate: it must be from 0.1 to 240 Hz"),
    ],
)
def test_wrong_arguments_are_refused_in_one_sentence(arguments, sentence):
    run = subprocess.run(
        [sys.executable, '-m', 'softbody_ros.viewer', *arguments], capture_output=True, text=True
    )
    assert run.returncode == 2
    assert sentence in run.stderr


@pytest.mark.parametrize(
    ('host', 'reason'),
    [('192.0.2.1', 'Cannot assign requested address'), ('127.0.0.1', 'Address already in use')],
)
def test_an_address_that_cannot_be_had_is_one_sentence(host, reason):
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # the last port: taken already, or here
            taken.bind(('127.0.0.1', 65535))
            taken.listen()
        run = subprocess.run(
            [sys.executable, '-m', 'softbody_ros.viewer', '--host', host, '--port', '65535'],
            capture_output=True, text=True, timeout=TIMEOUT,
        )  # fmt: skip
    assert run.returncode == 1
    assert f'{host} port 65535 cannot be served at: {reason}' in run.stderr
    assert len(run.stderr.splitlines()) == 1


def test_an_address_for_all_machines_is_said_as_one_that_opens(graph):
    viewer = graph.process(
        '--host',
        '0.0.0.0',
        '--port',
        str(browser_of_tests.free_port()),
        module='softbody_ros.viewer',
    )
    said = (
        re.search(r'open (http://127\.0\.0\.1:\d+) in a browser, elsewhere', line)
        for line in viewer.stderr
    )
    address = next(filter(None, said))
    with urllib.request.urlopen(address[1]) as page:
        assert page.status == 200


@pytest.mark.parametrize(
    'end', [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGKILL]
)
def test_the_node_brings_its_viewer_along(graph, end):
    # no other test gets that port
    port = str(browser_of_tests.free_port())
    node = graph.process(
        '--ros-args', '-p', 'ball.subdivisions:=1', '--', '--viewer', '--port', port
    )
    lines = iter(node.stderr.readline, '')
    address = next(
        filter(None, (re.search(r'open (http://127\.0\.0\.1:\d+)', line) for line in lines))
    )
    with urllib.request.urlopen(address[1]) as page:
        assert page.status == 200
    node.send_signal(end)
    _, errors = node.communicate(timeout=TIMEOUT)  # until both have closed it
    assert node.returncode == (0 if end == signal.SIGINT else -end), errors
    assert 'Traceback' not in errors
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address[1])
