# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arrows of the forces of contacts in the view, each with its size in N."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import time
from typing import Any

import numpy as np
from rclpy.node import Node
import trimesh
import viser
from visualization_msgs.msg import Marker

from softbody_ros.core.geometry.shading import shading
from softbody_ros.viewer.decoding import Frame, Surface
from softbody_ros.viewer.forces import ContactForces, Force, Scale, poses_of
from softbody_ros.viewer.panel import with_unit

ON_BODY, ON_OBSTACLE = (176, 20, 70), (24, 84, 190)
WIDTH = 1.6
"""Length of the longest arrow in RMS radii of the largest body."""
SHAFT, HEAD = 0.022, (0.06, 0.25)
"""Radius of the shaft, radius and length of the head, in lengths of the longest arrow."""
SPARE = 8
"""Arrows that the page is told of at a time."""
LABELS = 12
"""Largest forces that have their sizes written beside them."""
APART, BEYOND = 0.16, 0.04
"""Least distance of these from each other, and from the tips, in lengths of the longest arrow."""
READABLE = 0.3
"""Seconds for which a number stays as it is."""
LEAST = 0.01
"""Length, as a share of the longest, from which an arrow is drawn."""
UNITS = ((1e3, 'kN'), (1.0, 'N'), (1e-3, 'mN'))


class ForceArrows:
    """
    Draws the forces while it is switched on, and listens to them only then.

    Parameters
    ----------
    node : Node
    server : viser.ViserServer
    target : str
        name of the node that is observed

    """

    def __init__(self, node: Node, server: viser.ViserServer, target: str) -> None:
        self._server = server
        self._scene: Any = server.scene
        self._forces = ContactForces(node, target)
        self._frame: Frame | None = None
        self._numbers: Mapping[str, int] = {}
        self._markers: Iterable[Marker] = ()
        self._scale: Scale | None = None
        self._length = 1.0
        self._is_new = False
        self._arrows: Any = None
        self._labels: list[Any] = []
        self._written = 0.0

    def set_obstacles(self, markers: Iterable[Marker]) -> None:
        """Use the poses of other obstacles."""
        self._markers, self._is_new = markers, True

    def set_surface(self, surface: Surface, body: np.ndarray) -> None:
        """Let the longest arrow be about as long as the largest body of this surface."""
        _, index = np.unique(body, return_inverse=True)
        count = np.bincount(index)
        squares = np.zeros(len(count))
        for axis in surface.vertices.T:
            away = axis - (np.bincount(index, axis) / count)[index]
            squares += np.bincount(index, away**2) / count
        self._length = WIDTH * float(np.sqrt(squares.max(initial=0.0)))

    def show(self, frame: Frame, numbers: Mapping[str, int]) -> None:
        """Show the forces at another frame, of bodies with these numbers by their names."""
        self._frame, self._numbers, self._is_new = frame, numbers, True

    def update(self, is_on: bool) -> None:
        """Draw what acts now, if that has changed, or nothing."""
        if not is_on:
            if self._scale is not None:
                self._scale = None
                self._forces.stop()
                self._draw([], 1.0)
            return
        if self._scale is None:
            self._scale = Scale()
        self._forces.listen(self._numbers)
        is_new, self._is_new = self._forces.take() or self._is_new, False
        if self._frame is None or not is_new:
            return
        poses = poses_of(self._markers, self._frame.frame_id)
        forces = self._forces.present(self._frame, self._numbers, poses)
        self._draw(forces, self._scale.longest(each.force for each in forces))

    def _draw(self, forces: list[Force], longest: float) -> None:
        sizes = np.array([np.linalg.norm(each.force) for each in forces])
        drawn = np.argsort(-sizes)
        drawn = drawn[sizes[drawn] > LEAST * longest]
        shown, sizes = [forces[index] for index in drawn], sizes[drawn]
        lengths = self._length * sizes / max(longest, 1e-300)
        along = np.array([each.force for each in shown]).reshape(-1, 3) / sizes[:, None]
        on_body = np.array([each.on_body for each in shown], bool)
        # what acts on a body begins where it acts, what it does to an obstacle ends there
        points = np.array([each.point for each in shown]).reshape(-1, 3)
        starts = points - np.where(on_body, 0.0, lengths)[:, None] * along
        with self._server.atomic():
            self._draw_arrows(starts, along, lengths, on_body)
            self._write(starts + (lengths + BEYOND * self._length)[:, None] * along, sizes)

    def _draw_arrows(
        self, starts: np.ndarray, along: np.ndarray, lengths: np.ndarray, on_body: np.ndarray
    ) -> None:
        if not len(starts):
            if self._arrows is not None:
                self._arrows.remove()
                self._arrows = None
            return
        # short arrows are thicker for their length, to be seen
        width = np.sqrt(lengths * self._length)
        scales = np.stack([width, width, lengths], axis=1)
        colors = np.where(on_body[:, None], ON_BODY, ON_OBSTACLE)
        # some more of no size: with another number of them the page begins anew
        spare = (0, -len(starts) % SPARE), (0, 0)
        shown = {
            'batched_positions': np.pad(starts, spare).astype(np.float32),
            'batched_wxyzs': np.pad(turns(along), spare, 'edge').astype(np.float32),
            'batched_scales': np.pad(scales, spare).astype(np.float32),
            'batched_colors': np.pad(colors, spare).astype(np.uint8),
        }
        rows = len(starts) + spare[0][1]
        if self._arrows is not None and len(self._arrows.batched_positions) == rows:
            for name, values in shown.items():
                setattr(self._arrows, name, values)
            return
        if self._arrows is not None:
            self._arrows.remove()
        self._arrows = self._scene.add_batched_meshes_simple(
            '/forces/arrows', *arrow(), lod='off', cast_shadow=False, receive_shadow=False,
            **shown,
        )  # fmt: skip

    def _write(self, places: np.ndarray, sizes: np.ndarray) -> None:
        """Write the largest of the sizes, in descending order, at these places."""
        free: list[int] = []
        for index in range(len(sizes)):
            apart = np.linalg.norm(places[free] - places[index], axis=1)
            if len(free) < LABELS and apart.min(initial=np.inf) > APART * self._length:
                free.append(index)
        places, sizes, count = places[free], sizes[free], len(free)
        is_due = count != len(self._labels) or time.monotonic() - self._written >= READABLE
        while len(self._labels) > count:
            self._labels.pop().remove()
        for index in range(count):
            if index == len(self._labels):
                self._labels.append(
                    self._scene.add_label(f'/forces/{index}', '', anchor='bottom-center')
                )
            label = self._labels[index]
            label.position = places[index]
            if is_due:
                label.text = with_unit(float(f'{sizes[index]:.3g}'), UNITS)
        if is_due:
            self._written = time.monotonic()


def arrow() -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) and faces (m, 3) of an arrow of length 1 along z."""
    shaft = trimesh.creation.cylinder(SHAFT, 1.0 - HEAD[1], sections=16)
    shaft.apply_translation([0.0, 0.0, (1.0 - HEAD[1]) / 2.0])
    head = trimesh.creation.cone(*HEAD, sections=24)
    head.apply_translation([0.0, 0.0, 1.0 - HEAD[1]])
    vertices = np.concatenate([shaft.vertices, head.vertices])
    faces = np.concatenate([shaft.faces, head.faces + len(shaft.vertices)])
    shaded = shading(vertices, faces)
    return vertices[shaded.origin], shaded.faces


def turns(along: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4), w first, that turn z to directions (n, 3)."""
    x, y, z = along.T
    quaternions = np.stack([1.0 + z, -y, x, np.zeros(len(z))], axis=1)
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    turned = quaternions / np.maximum(lengths, 1e-9)
    return np.where(lengths > 1e-9, turned, (0.0, 1.0, 0.0, 0.0))
