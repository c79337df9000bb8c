# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What of moving bodies gets into the viewer's page, and at what cost.

python3 tools/benchmarks/viewer.py [--seconds 10]

Prints Markdown. Node, viewer and browser are processes of their own. The browser draws without a
GPU: the page is small, so that the way into the page is measured rather than the drawing.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import subprocess
import sys
import time

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1]))

from browser import choose, chromium, free_port
from node import cpu_seconds, machine, print_table
from playwright.sync_api import Page

LARGE = 5_000
"""Bytes of a message that can only be vertices."""
PAGE = {'width': 640, 'height': 300}


def start(module: str, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, '-m', module, *arguments],
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        stderr=subprocess.DEVNULL,
    )


class Watched:
    """A page whose incoming vertices and main thread are watched."""

    def __init__(self, page: Page, port: int) -> None:
        self.sizes: list[int] = []
        page.on('websocket', lambda socket: socket.on('framereceived', self._received))
        page.goto(f'http://127.0.0.1:{port}')
        self.page = page
        self._session = page.context.new_cdp_session(page)
        self._session.send('Performance.enable')

    def _received(self, data: str | bytes) -> None:
        if len(data) > LARGE:
            self.sizes.append(len(data))

    def busy(self) -> float:
        """Return the seconds for which its main thread has worked."""
        metrics = self._session.send('Performance.getMetrics')['metrics']
        return next(item['value'] for item in metrics if item['name'] == 'TaskDuration')


def measure(subdivisions: int, bodies: int, seconds: float) -> list[list[str]]:
    """Return a row for each way to colour balls that turn in free space."""
    names = [f'ball{index}' for index in range(bodies)]
    arguments = ['-p', f'bodies:=[{", ".join(names)}]', '-p', 'gravity.magnitude:=0.0']
    for index, name in enumerate(names):
        arguments += ['-p', f'{name}.subdivisions:={subdivisions}']
        arguments += ['-p', f'{name}.position:=[{1.2 * index}, 0.0, 1.0]']
        arguments += ['-p', f'{name}.initial_velocity.angular:=[0.0, 0.0, 1.0]']
    port = free_port()
    node = start('softbody_ros', '--ros-args', *arguments)
    viewer = start('softbody_ros.viewer', '--port', str(port))
    rows = []
    try:
        time.sleep(4.0)
        with chromium() as browser:
            watched = Watched(browser.new_page(viewport=PAGE), port)
            watched.page.get_by_text('stiffness').wait_for()
            for way in ('body', 'displacement'):
                choose(watched.page, 'colour by', way)
                watched.page.wait_for_timeout(4000)
                before = [cpu_seconds(node.pid), cpu_seconds(viewer.pid), watched.busy()]
                watched.sizes.clear()
                begin = time.monotonic()
                watched.page.wait_for_timeout(1000 * seconds)
                passed = time.monotonic() - begin
                after = [cpu_seconds(node.pid), cpu_seconds(viewer.pid), watched.busy()]
                used = [(b - a) / passed for a, b in zip(before, after, strict=True)]
                rows.append(
                    [
                        f'{bodies * 20 * 4**subdivisions}', way,
                        f'{len(watched.sizes) / passed:.1f}',
                        f'{sum(watched.sizes) / passed / 1e6:.1f}',
                        *(f'{share:.2f}' for share in used),
                    ]
                )  # fmt: skip
    finally:
        for process in (viewer, node):
            process.terminate()
            process.wait()
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description='what gets into the page of the viewer')
    parser.add_argument('--seconds', type=float, default=10.0)
    seconds = parser.parse_args().seconds
    rows = []
    for subdivisions, bodies in ((3, 1), (5, 2)):
        rows += measure(subdivisions, bodies, seconds)
    print_table(
        ['triangles', 'colour by', 'updates/s', 'MB/s', 'node, cores', 'viewer, cores',
         'page, cores'],
        rows,
    )  # fmt: skip
    print(f'\n{machine()}')


if __name__ == '__main__':
    main()
