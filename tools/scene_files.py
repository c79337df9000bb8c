# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scenes of `config`, without a node, and the files in the pages."""

import pathlib
import re

from softbody_ros.core import World
from softbody_ros.scene import parameters
from softbody_ros.scene.scene_file import read_scene

ROOT = pathlib.Path(__file__).parent.parent
SCENES = sorted(path.stem for path in (ROOT / 'config').glob('*.yaml'))


def scene_values(name):
    """Return the parameters of a scene, by their ROS names."""
    return read_scene(str(ROOT / 'config' / f'{name}.yaml'))


def scene(name):
    """Return what the parameters of a scene say."""
    return parameters.make_scene(scene_values(name))


def world_of(name):
    return World(scene(name).world)


def file_of_page(page, name):
    """Return the text of a file that a page shows, with its name in the first line."""
    text = (ROOT / 'docs' / page).read_text()
    return re.search(rf'^```\w+\n(# {name}: .*?)^```', text, re.M | re.S)[1]
