# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node, a viewer and a page that shows it: three processes."""

import io
import math
import time

import browser as browser_of_tests
import numpy as np
from PIL import Image
from playwright.sync_api import expect
from ros_graph import TIMEOUT

SIM = '/softbody_sim'
VIEW = {'x': 0, 'y': 0, 'width': 400, 'height': 400}
"""The part of the page beside the panel."""
BALL = 1500
"""Orange pixels that are no detail of the page."""
PATIENCE = 10.0
"""Seconds after which something that was done on a page has been missed."""


class Show:
    """
    A node, a viewer and a page that shows it.

    Parameters
    ----------
    browser : playwright.sync_api.Browser
    graph : Graph
    node : str
    draws : bool
        whether somebody looks at the view

    """

    def __init__(self, browser, graph, node=SIM, draws=True):
        self.graph = graph
        self.port = browser_of_tests.free_port()
        self.viewer = graph.process(
            '--port',
            str(self.port),
            '--node',
            node,
            '--rate',
            '15',
            '--no-shadows',
            module='softbody_ros.viewer',
        )
        # the port is open before it says so
        said = (line for line in self.viewer.stderr if ' in a browser' in line)
        self.greeting = next(said, '')
        self.page = browser.new_page(viewport={'width': 720, 'height': 400})
        browser_of_tests.slow_down(self.page)
        if not draws:
            browser_of_tests.draw_nothing(self.page)
        self.page.goto(f'http://127.0.0.1:{self.port}')

    def picture(self):
        """Return the view, (400, 400, 3), 0 … 255."""
        picture = self.page.screenshot(clip=VIEW, timeout=1e3 * TIMEOUT)
        image = Image.open(io.BytesIO(picture))
        return np.asarray(image.convert('RGB')).astype(int)

    def orange(self):
        """Return which pixels are of the ball's colour."""
        red, green, blue = np.moveaxis(self.picture(), -1, 0)
        return (red > green + 40) & (green > blue + 20)

    def sees_ball(self):
        return self.orange().sum() > BALL

    def height(self):
        """Return how far up in the view the ball's middle is, pixels; nan if it is not there."""
        rows, _ = np.nonzero(self.orange())
        return 400.0 - rows.mean() if len(rows) > BALL else math.nan

    def act_until(self, act, condition, what='the condition'):
        """
        Act until something is true.

        A page that draws may miss a click; but what was done may also still be under way, and
        would come true later, in the midst of the next test, once for each time.
        """
        again = 0.0

        def is_true():
            nonlocal again
            if condition():
                return True
            if time.monotonic() > again:
                act()
                again = time.monotonic() + PATIENCE
            return False

        self.graph.spin_until(is_true, what)

    def row(self, label):
        """Return the row of the panel with a label."""
        return browser_of_tests.row(self.page, label)

    def number(self, label, index=0):
        return self.row(label).locator('input[inputmode=decimal]').nth(index)

    def parameter(self, name):
        return self.graph.get_parameters(SIM, [name])[0]

    def says(self, text):
        expect(self.page.locator('body')).to_contain_text(text)


def button(show, name):
    return show.page.get_by_role('button', name=name, exact=True)
