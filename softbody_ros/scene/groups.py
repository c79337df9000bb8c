# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Groups of parameters, in the order of the reference page, default.yaml and `--help`.

Nothing is imported for them, so that `--help` is immediate; a test compares them with the table.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

BODY, OBSTACLE = 'ball', 'ground'
"""The names of the default scene, which stand for any."""


@dataclass(frozen=True)
class Group:
    """
    Parameters under one heading.

    Attributes
    ----------
    title : str
    names : tuple of str
        of the parameters without the name of the body or obstacle; `gravity` is all of `gravity.*`
    owner : str
        the body or obstacle that they belong to, '' for the node

    """

    title: str
    names: tuple[str, ...]
    owner: str = ''

    @property
    def full_names(self) -> tuple[str, ...]:
        """The names of the parameters, or what they begin with."""
        return tuple(f'{self.owner}.{name}' if self.owner else name for name in self.names)

    def members(self, known: Iterable[str]) -> list[str]:
        """Return those of the known parameters that belong to it, in its order."""
        known = list(known)
        return [
            name
            for first in self.full_names
            for name in known
            if name == first or name.startswith(f'{first}.')
        ]


MESH = ('mesh', 'size', 'subdivisions', 'mesh_scale', 'mesh_origin', 'mesh_up')
POSE = ('position', 'orientation')

GROUPS = (
    Group('Node', ('frame_id', 'points_rate', 'mesh_rate', 'publish_tf')),
    Group(
        'Time and gravity',
        ('time_step', 'reference_step', 'time_scale', 'step_count', 'history', 'gravity'),
    ),
    Group('External inputs', ('input_timeout', 'obstacle_points', 'poke', 'robot')),
    Group('Scene', ('bodies', 'obstacles')),
    Group('Body: mesh', MESH, BODY),
    Group('Body: start', (*POSE, 'initial_velocity'), BODY),
    Group(
        'Body: material',
        (
            'mass',
            'density',
            'mass_distribution',
            'mode',
            'stiffness',
            'natural_frequency',
            'young_modulus',
            'bounciness',
            'deformation',
            'volume_conservation',
            'damping',
        ),
        BODY,
    ),
    Group('Body: contact', ('elasticity', 'friction', 'friction_model', 'thickness'), BODY),
    Group('Body: regions', ('regions',), BODY),
    Group('Body: plasticity', ('plasticity',), BODY),
    Group('Body: pins and attachment', ('pins', 'attach'), BODY),
    Group('Body: appearance', ('color', 'visual_mesh', 'simplify_to'), BODY),
    Group(
        'Obstacle',
        ('type', *MESH, *POSE, 'velocity', 'surface_velocity', 'friction', 'elasticity'),
        OBSTACLE,
    ),
)
