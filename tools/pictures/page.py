# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A picture of the viewer's page: a real node, paused at a moment of a scene, a real browser."""

from __future__ import annotations

import io

from browser import choose, chromium, close_notices, free_port
from PIL import Image
from ros_graph import Graph
from scene_files import ROOT
from std_srvs.srv import SetBool, Trigger

NODE = '/softbody_sim'


def page(scene: str, ticks: int, coloring: str, size: tuple[int, int]) -> Image.Image:
    """Return the page of a scene after so many ticks; `coloring` is body or displacement."""
    graph, port = Graph(), free_port()
    graph.process('--ros-args', '--params-file', str(ROOT / 'config' / f'{scene}.yaml'))
    graph.process('--port', str(port), module='softbody_ros.viewer')
    try:
        graph.call(SetBool, f'{NODE}/pause', data=True)
        graph.call(Trigger, f'{NODE}/reset')
        graph.set_parameter(NODE, 'step_count', ticks)
        with chromium() as browser:
            shown = browser.new_page(viewport={'width': size[0], 'height': size[1]})
            shown.goto(f'http://127.0.0.1:{port}')
            shown.get_by_text('stiffness').wait_for(timeout=60_000)
            choose(shown, 'colour by', coloring)
            graph.call(Trigger, f'{NODE}/step')
            shown.wait_for_timeout(6_000)  # a browser without a GPU needs seconds for a picture
            close_notices(shown)
            shown.mouse.move(5, size[1] - 5)
            shown.wait_for_timeout(3_000)
            return Image.open(io.BytesIO(shown.screenshot())).convert('RGB')
    finally:
        graph.close()
