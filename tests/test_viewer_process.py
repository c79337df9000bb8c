# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""`sim_node --viewer`: the two processes, and the tab of a browser."""

import os
import pathlib
import re
import signal
import socket
import urllib.request

import browser as browser_of_tests
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile

SIM = '/softbody_sim'
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SMALL = ('--ros-args', '-p', 'ball.subdivisions:=1')


def children_of(process):
    """Return pid and state of each child of a process: Z is a zombie."""
    found = {}
    for path in pathlib.Path('/proc').glob('[0-9]*/stat'):
        try:
            state, parent, *_ = path.read_text().rpartition(')')[2].split()
        except OSError:  # it has ended
            continue
        if int(parent) == process.pid:
            found[int(path.parent.name)] = state
    return found


def address_in(process):
    lines = iter(process.stderr.readline, '')
    found = (re.search(r'open (http://127\.0\.0\.1:(\d+))', line) for line in lines)
    return next(filter(None, found)).groups()


def require_alive(graph, process):
    received = graph.collect(Odometry, f'{SIM}/odometry')
    graph.spin_until(lambda: received)
    assert process.poll() is None


def require_said(logs, graph):
    graph.spin_until(lambda: any('the viewer has ended' in log.msg for log in logs))


def require_one_line(process, reason):
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert 'Traceback' not in errors
    said = [line for line in errors.splitlines() if 'the viewer has ended' in line]
    assert len(said) == 1, errors
    assert f'({reason}): the node goes on without it' in said[0]


def test_a_viewer_that_is_killed_is_said_in_one_line_and_the_node_goes_on(graph):
    node = graph.process('--viewer', *SMALL)
    address_in(node)
    (viewer,) = children_of(node)
    logs = graph.collect(Log, '/rosout', LATCHED)
    os.kill(viewer, signal.SIGKILL)
    graph.spin_until(lambda: not children_of(node), 'no zombie')
    require_alive(graph, node)
    require_said(logs, graph)
    require_one_line(node, 'SIGKILL')


def test_a_viewer_that_cannot_serve_is_said_in_one_line_and_the_node_goes_on(graph):
    logs = graph.collect(Log, '/rosout', LATCHED)
    node = graph.process('--viewer', '--host', '192.0.2.1', *SMALL)  # no address of this machine
    line = next(line for line in iter(node.stderr.readline, '') if line.startswith('viewer: '))
    assert 'viewer: 192.0.2.1 port 8080 cannot be served at' in line
    graph.spin_until(lambda: not children_of(node), 'no zombie')
    require_alive(graph, node)
    require_said(logs, graph)
    require_one_line(node, 'exit code 1')


def test_it_is_served_at_the_next_free_port_and_that_it_ends_with_its_node_is_no_news(graph):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        node = graph.process('--viewer', '--port', str(port), *SMALL)
        address, served = address_in(node)
        assert port < int(served) < port + 100
        with urllib.request.urlopen(address) as page:
            assert page.status == 200
    (viewer,) = children_of(node)
    # as Ctrl-C in a terminal
    os.kill(viewer, signal.SIGINT)
    node.send_signal(signal.SIGINT)
    _, errors = node.communicate(timeout=60)
    assert node.returncode == 0
    assert 'the viewer has ended' not in errors


def test_bad_arguments_end_it_before_anything_is_imported(graph):
    process = graph.process('--port', '8000')
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (1, '')
    expected = '--port is of the viewer: give --viewer, too, or leave it out'
    assert errors == f'softbody_sim: {expected}\n'


def test_the_tab_of_the_browser_has_the_name_of_the_node(graph, browser):
    viewer = graph.process(
        '--port', str(browser_of_tests.free_port()), '--node', '/left/softbody_sim',
        module='softbody_ros.viewer',
    )  # fmt: skip
    address, _ = address_in(viewer)
    for _ in range(2):  # one that comes later, too
        page = browser.new_page()
        browser_of_tests.draw_nothing(page)
        page.goto(address)
        expected = '/left/softbody_sim – softbody_ros'
        page.wait_for_function('expected => document.title === expected', arg=expected)
