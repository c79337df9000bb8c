# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of commands: what they print with --help."""

import os
from unittest.mock import patch

from reference.markdown import page

from softbody_ros.bake.__main__ import parser as bake_parser
from softbody_ros.ensemble.fit import parser as fit_parser
from softbody_ros.ensemble.sweep import parser as sweep_parser
from softbody_ros.ros import cli_help
from softbody_ros.viewer.__main__ import parser as viewer_parser

SHARE = 'share/softbody_ros/config'
BEGIN = """\
In a workspace `ros2 run softbody_ros` stands before each command; pip installs them beside its
Python, as `.venv/bin/sim_node`."""


def command_line_page() -> str:
    """Return the page, with the folder of the scenes relative to the installation."""
    with patch.dict(os.environ, COLUMNS=str(cli_help.WIDTH + 1)):
        helps = {
            'sim_node': cli_help.help_text().replace(str(cli_help.config_folder()), SHARE),
            'viewer': viewer_parser().format_help(),
            'bake': bake_parser().format_help(),
            'sweep': sweep_parser().format_help(),
            'fit': fit_parser().format_help(),
        }
    parts = [f'## {name}\n\n```text\n{text.rstrip()}\n```' for name, text in helps.items()]
    return page('Commands', BEGIN, *parts)
