# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Films as binary glTF 2.0, float32: y up by a root node that rotates the scene, metres.

Each body is a mesh whose morph target k is the offset of frame k + 1 from frame 0; the animation
blends from each to the next. Vertices on a crease are duplicated for each of their normals.
Obstacles are meshes, with animated nodes where they move, and extras that say what they are.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pygltflib
from pygltflib import GLTF2, Accessor, Attributes, BufferView

from softbody_ros.bake.writing import OBSTACLE_COLOR, linear, quaternion
from softbody_ros.core import ConfigError, Surface
from softbody_ros.core.collision.shapes import obstacle_surface
from softbody_ros.core.geometry.glb import MARK
from softbody_ros.core.geometry.shading import shading
from softbody_ros.ensemble.film import Film, Frame

LARGEST = 2**32 - 1
"""Most bytes in a file: the length in its header has 32 bits."""
Z_UP_TO_Y_UP = [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]


def size(film: Film) -> int:
    """Return the approximate number of bytes of the file of a film."""
    frames = len(film.times)
    pictures = [film.picture(name) for name in film.world.names]
    vertices = sum(len(shading(each.vertices, each.faces).origin) for each in pictures)
    return 24 * frames * vertices + 4 * frames**2 * len(film.world.names)


class GltfWriter:
    """
    Collects all frames, float32, and writes them at the end.

    Raises
    ------
    ConfigError
        if the film exceeds the format's largest file.

    """

    def __init__(self, path: Path, film: Film) -> None:
        expected = size(film)
        if expected > LARGEST:
            raise ConfigError(
                f'a .glb of {expected / 1e9:.1f} GB is more than the format can hold, 4.3 GB: '
                'take fewer frames, or .usdc'
            )
        self._path = path
        self._film = film
        self._frames: list[Frame] = []

    def add(self, frame: Frame) -> None:
        """Take a frame."""
        pictures = {name: each.astype(np.float32) for name, each in frame.pictures.items()}
        self._frames.append(Frame(frame.index, {}, pictures, frame.obstacles))

    def finish(self) -> None:
        """Write the file."""
        _Document(self._film, self._frames).gltf.save_binary(str(self._path))


class _Document:
    """The glTF document of a film; names as in the specification of glTF 2.0."""

    def __init__(self, film: Film, frames: list[Frame]) -> None:
        self._frames = frames
        self._blob = bytearray()
        root = pygltflib.Node(name='scene', rotation=Z_UP_TO_Y_UP, children=[])
        self._animation = pygltflib.Animation(name='film')
        self.gltf = GLTF2(
            asset=pygltflib.Asset(generator='softbody_ros'),
            scene=0,
            scenes=[pygltflib.Scene(nodes=[0])],
            nodes=[root],
        )
        times = film.times.astype(np.float32)
        self._times = self._accessor(times, pygltflib.SCALAR, bounded=True)
        for name in film.world.names:
            self._add_body(name, film)
        grey = self._material('obstacles', OBSTACLE_COLOR, False)
        for item in film.world.obstacles:
            reach = film.plane_reach(item.config)
            self._add_obstacle(item.config.name, obstacle_surface(item.config, reach), grey)
        root.children = list(range(1, len(self.gltf.nodes)))
        if self._animation.channels:
            self.gltf.animations.append(self._animation)
        self.gltf.buffers.append(pygltflib.Buffer(byteLength=len(self._blob)))
        self.gltf.set_binary_blob(self._blob)

    def _add_body(self, name: str, film: Film) -> None:
        surface = film.picture(name)
        first, *later = (frame.pictures[name] for frame in self._frames)
        shown = shading(surface.vertices, surface.faces)
        normals, *later_normals = (shown.normals(each) for each in (first, *later))
        material = self._material(name, film.color(name), not surface.closed)
        mesh = self._mesh(name, first[shown.origin], normals, shown.faces, material)
        node = pygltflib.Node(name=name, mesh=mesh)
        self.gltf.nodes.append(node)
        if not later:
            return
        position_targets = self._accessors([(each - first)[shown.origin] for each in later])
        normal_targets = self._accessors([each - normals for each in later_normals])
        self.gltf.meshes[mesh].primitives[0].targets = [
            Attributes(POSITION=position, NORMAL=normal)
            for position, normal in zip(position_targets, normal_targets, strict=True)
        ]
        self.gltf.meshes[mesh].weights = [0.0] * len(later)
        # at frame k + 1 target k only
        weights = np.eye(len(self._frames), len(later), k=-1, dtype=np.float32)
        self._animate('weights', self._accessor(weights.ravel(), pygltflib.SCALAR))

    def _add_obstacle(self, name: str, surface: Surface, grey: int) -> None:
        poses = [frame.obstacles[name] for frame in self._frames]
        shown = shading(surface.vertices, surface.faces)
        vertices = surface.vertices[shown.origin].astype(np.float32)
        mesh = self._mesh(name, vertices, shown.normals(surface.vertices), shown.faces, grey)
        node = pygltflib.Node(name=name, mesh=mesh, extras=MARK)
        node.translation = poses[0].position.tolist()
        node.rotation = list(quaternion(poses[0]))
        self.gltf.nodes.append(node)
        if len(poses) == 1 or not poses[0].moves:
            return
        positions = np.array([pose.position for pose in poses], np.float32)
        rotations = np.array([quaternion(pose) for pose in poses], np.float32)
        self._animate('translation', self._accessor(positions, pygltflib.VEC3))
        self._animate('rotation', self._accessor(rotations, pygltflib.VEC4))

    def _animate(self, path: str, values: int) -> None:
        """Animate the newest node with the values."""
        sampler = pygltflib.AnimationSampler(
            input=self._times, output=values, interpolation=pygltflib.ANIM_LINEAR
        )
        target = pygltflib.AnimationChannelTarget(node=len(self.gltf.nodes) - 1, path=path)
        channel = pygltflib.AnimationChannel(sampler=len(self._animation.samplers), target=target)
        self._animation.samplers.append(sampler)
        self._animation.channels.append(channel)

    def _mesh(
        self,
        name: str,
        vertices: np.ndarray,
        normals: np.ndarray,
        faces: np.ndarray,
        material: int,
    ) -> int:
        [position], [normal] = self._accessors([vertices]), self._accessors([normals])
        corners = faces.astype(np.uint32).ravel()
        primitive = pygltflib.Primitive(
            attributes=Attributes(POSITION=position, NORMAL=normal),
            indices=self._accessor(
                corners, pygltflib.SCALAR, target=pygltflib.ELEMENT_ARRAY_BUFFER
            ),
            material=material,
        )
        self.gltf.meshes.append(pygltflib.Mesh(name=name, primitives=[primitive]))
        return len(self.gltf.meshes) - 1

    def _material(self, name: str, color: tuple[float, ...], double_sided: bool) -> int:
        surface = pygltflib.PbrMetallicRoughness(
            baseColorFactor=list(linear(color)), metallicFactor=0.0, roughnessFactor=0.5
        )
        self.gltf.materials.append(
            pygltflib.Material(
                name=name,
                pbrMetallicRoughness=surface,
                doubleSided=double_sided,
                alphaMode=pygltflib.BLEND if color[3] < 1.0 else pygltflib.OPAQUE,
            )
        )
        return len(self.gltf.materials) - 1

    # ----------------------------------------------------------------------------- binary arrays
    def _accessors(self, vertices: list[np.ndarray]) -> list[int]:
        """Append arrays (n, 3) of equal length as one view; return their indices."""
        view = self._view(np.concatenate(vertices), pygltflib.ARRAY_BUFFER)
        # required for views that several attributes share
        self.gltf.bufferViews[view].byteStride = 12
        first = len(self.gltf.accessors)
        for index, each in enumerate(vertices):
            self.gltf.accessors.append(
                Accessor(
                    bufferView=view,
                    byteOffset=index * each.nbytes,
                    componentType=pygltflib.FLOAT,
                    count=len(each),
                    type=pygltflib.VEC3,
                    min=each.min(axis=0).tolist(),
                    max=each.max(axis=0).tolist(),
                )
            )
        return list(range(first, len(self.gltf.accessors)))

    def _accessor(
        self, array: np.ndarray, kind: str, bounded: bool = False, target: int | None = None
    ) -> int:
        """Append an array of float32 or uint32; return its index."""
        number = pygltflib.FLOAT if array.dtype == np.float32 else pygltflib.UNSIGNED_INT
        accessor = Accessor(
            bufferView=self._view(array, target),
            componentType=number,
            count=len(array),
            type=kind,
        )
        if bounded:
            accessor.min, accessor.max = [float(array.min())], [float(array.max())]
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def _view(self, array: np.ndarray, target: int | None) -> int:
        view = BufferView(
            buffer=0, byteOffset=len(self._blob), byteLength=array.nbytes, target=target
        )
        self._blob += np.ascontiguousarray(array).view(np.uint8).data
        self.gltf.bufferViews.append(view)
        return len(self.gltf.bufferViews) - 1
