# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scenes of `config`, without a node."""

import pathlib

import yaml

from softbody_ros import parameters
from softbody_ros.core import World

ROOT = pathlib.Path(__file__).parent.parent
SCENES = sorted(path.stem for path in (ROOT / 'config').glob('*.yaml'))


def flattened(tree, prefix=''):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from flattened(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value


def scene_values(name):
    """Return the parameters of a scene, by their ROS names."""
    (node,) = yaml.safe_load((ROOT / 'config' / f'{name}.yaml').read_text()).values()
    return dict(flattened(node['ros__parameters']))


def scene(name):
    """Return what the parameters of a scene say."""
    return parameters.make_scene(scene_values(name))


def world_of(name):
    return World(scene(name).world)
