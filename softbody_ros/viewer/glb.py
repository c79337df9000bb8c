# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Surfaces with vertex colours as binary glTF, which viser can display."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import trimesh


class ColoredFile:
    """
    A GLB file of a surface whose vertices can be replaced.

    trimesh writes it once, which takes ten times as long as replacing them. The bounds in the file
    remain those of the first vertices: viser computes them itself.

    Parameters
    ----------
    vertices : (n, 3) float
        the first ones, m
    faces : (m, 3) int
    opacity : float
        1 is opaque

    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, opacity: float = 1.0) -> None:
        mesh = trimesh.Trimesh(
            vertices,
            faces,
            vertex_normals=np.ones_like(vertices),
            vertex_colors=np.full((len(vertices), 4), 255, np.uint8),
            process=False,
        )

        def see_through(tree: dict[str, Any]) -> None:
            if opacity < 1.0:
                color = {'baseColorFactor': [1.0, 1.0, 1.0, opacity]}
                tree['materials'] = [{'alphaMode': 'BLEND', 'pbrMetallicRoughness': color}]
                tree['meshes'][0]['primitives'][0]['material'] = 0

        data = mesh.export(file_type='glb', tree_postprocessor=see_through)
        assert isinstance(data, bytes)
        self._bytes = bytearray(data)
        # a header of 12 bytes, then chunks of length, type and data: JSON, binary
        (length,) = struct.unpack_from('<I', data, 12)
        tree = json.loads(data[20 : 20 + length])
        begin = 20 + length + 8
        (primitive,) = tree['meshes'][0]['primitives']
        self._place = {}
        for name, index in primitive['attributes'].items():
            accessor = tree['accessors'][index]
            view = tree['bufferViews'][accessor['bufferView']]
            self._place[name] = begin + view.get('byteOffset', 0) + accessor.get('byteOffset', 0)

    def filled(self, positions: np.ndarray, normals: np.ndarray, colors: np.ndarray) -> bytes:
        """
        Return the bytes of the file with other vertices.

        Parameters
        ----------
        positions, normals : (n, 3) float
        colors : (n, 4) uint8

        """
        for name, array, kind in (
            ('POSITION', positions, np.float32),
            ('NORMAL', normals, np.float32),
            ('COLOR_0', colors, np.uint8),
        ):
            count, place = array.size, self._place[name]
            np.frombuffer(self._bytes, kind, count, place)[:] = array.reshape(-1)
        return bytes(self._bytes)
