# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `viewer`: a web page beside a running `sim_node`, a bag, or another machine."""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import sys
import threading

from softbody_ros.signals import stop_at_signal
from softbody_ros.startup import without_garbage_collection
from softbody_ros.web_address import add_address

EPILOG = """\
examples:
  viewer                              beside a sim_node on this machine or in this network
  viewer --node /left/softbody_sim    of several nodes, the one with this name
  viewer --host 0.0.0.0               for browsers on other machines, too: whoever reaches the
                                      port can steer the node
  ros2 bag play my_bag                a bag with /softbody_sim/points and /softbody_sim/rest_mesh
                                      is shown like a node, without anything to steer; with
                                      visual_mesh as well where bodies carry fine surfaces

Drag turns the view, a click on a body pokes it, a mesh file that is dropped becomes a body; the
folder help of the page lists the keys. What follows --ros-args goes to ROS.
"""


def main() -> int:
    """Serve the page until SIGINT or SIGTERM; a second one ends it at once."""
    stop = stop_at_signal()

    arguments = sys.argv[1:]
    split = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    options = parser().parse_args(arguments[:split])
    for module, remedy in (
        ('viser', "install it with pip install '.[viewer]'"),
        ('rclpy', "source ROS 2 Jazzy, or install it with pip install '.[jazzy]'"),
    ):
        if importlib.util.find_spec(module) is None:
            print(f'viewer: the module {module} is not installed: {remedy}', file=sys.stderr)
            return 1

    if options.until_eof:
        threading.Thread(target=_wait_for_eof, args=(stop,), daemon=True).start()

    with without_garbage_collection():
        from softbody_ros.viewer.app import run

    return run(options, arguments[split:], stop)


def _wait_for_eof(stop: threading.Event) -> None:
    # not sys.stdin.read: a daemon thread that holds its lock at exit is a fatal error
    while os.read(0, 1024):
        pass
    stop.set()


def parser() -> argparse.ArgumentParser:
    """Return the parser of the arguments before `--ros-args`."""
    result = argparse.ArgumentParser(
        'viewer',
        description='Show soft bodies in a web page, live, with a slider for each property.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    result.add_argument(
        '--node', default='/softbody_sim', type=_node_name, metavar='NAME',
        help='the node to show: its full name [%(default)s]',
    )  # fmt: skip
    add_address(result)
    result.add_argument(
        '--rate', default=30.0, type=_rate, metavar='HZ',
        help='pictures a second, at most [%(default)g]',
    )  # fmt: skip
    result.add_argument(
        '--no-shadows', dest='shadows', action='store_false',
        help='for browsers without a GPU, which draw several times as fast without them',
    )  # fmt: skip
    result.add_argument(
        '--until-eof', action='store_true', help='end when the standard input ends'
    )
    return result


def _node_name(text: str) -> str:
    name = '/' + text.removeprefix('/')
    if not re.fullmatch(r'(/[A-Za-z_]\w*)+', name, re.ASCII):
        raise argparse.ArgumentTypeError(
            f'{text!r} is no name of a node: give one such as /softbody_sim'
        )
    return name


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0.1 <= rate <= 240.0:
        raise argparse.ArgumentTypeError(f'{text!r} is no rate: it must be from 0.1 to 240 Hz')
    return rate


if __name__ == '__main__':
    sys.exit(main())
