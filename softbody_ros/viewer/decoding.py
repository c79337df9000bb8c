# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decoding of messages, colour maps, and ray casting for clicks: pure functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
import struct
from typing import Any

import numpy as np
from sensor_msgs.msg import PointField
from visualization_msgs.msg import Marker

from softbody_ros.core import Embedding, compiled
from softbody_ros.core.geometry import mesh
from softbody_ros.core.geometry.shading import Shading, shading
from softbody_ros.ros.cdr import CdrReader
from softbody_ros.ros.messages import NUMBER_IN_POINTS, POINT_FIELDS, POINT_TYPE

COLORS = np.array(
    [
        [69, 117, 180], [116, 173, 209], [171, 217, 233], [224, 243, 248], [255, 255, 191],
        [254, 224, 144], [253, 174, 97], [244, 109, 67], [215, 48, 39],
    ],
    float,
)  # fmt: skip
"""RdYlBu of ColorBrewer, from blue, evenly spaced; bright enough to be shaded."""
PALETTE = (
    (230, 115, 51), (84, 140, 214), (106, 176, 76), (198, 92, 140),
    (228, 184, 60), (80, 176, 176), (146, 110, 200), (150, 130, 110),
)  # fmt: skip
"""Colours of bodies without a colour parameter."""


LATER_FIELDS = {'pressure', 'permanent_strain'}
"""Fields of the clouds that those of the first releases lack."""

Color = tuple[int, int, int, int]


class FrameError(ValueError):
    """A message that cannot be displayed; with the reason in one sentence."""


@dataclass(frozen=True)
class Frame:
    """All particles at one time: positions (n, 3), and what each has besides, (n,)."""

    frame_id: str
    positions: np.ndarray
    displacement: np.ndarray
    pressure: np.ndarray
    permanent_strain: np.ndarray
    body: np.ndarray


def frame(cloud: Any) -> Frame:
    """
    Decode a sensor_msgs/PointCloud2 of `~/points`.

    Recordings of earlier releases have no pressure or permanent strain: there it is 0.

    Raises
    ------
    FrameError
        if it lacks fields of `~/points`, or is truncated.

    """
    kinds = dict(POINT_FIELDS)
    offsets = {
        item.name: item.offset
        for item in cloud.fields
        if item.datatype == kinds.get(item.name, PointField.FLOAT32)
    }
    for name in LATER_FIELDS - offsets.keys():
        del kinds[name]
    missing = [name for name in kinds if name not in offsets]
    if missing:
        raise FrameError(f'the cloud is not one of ~/points: it lacks {", ".join(missing)}')
    if cloud.is_bigendian:
        raise FrameError('the cloud is not one of ~/points: it is big-endian')
    if not 4 + max(offsets.values()) <= cloud.point_step < 2**31:
        raise FrameError(f'the cloud has no room for its fields: point_step {cloud.point_step}')
    layout = np.dtype(
        {
            'names': list(kinds),
            'formats': [POINT_TYPE[name] for name in kinds],
            'offsets': [offsets[name] for name in kinds],
            'itemsize': cloud.point_step,
        }
    )
    count = cloud.width * cloud.height
    if len(cloud.data) < count * layout.itemsize:
        raise FrameError(f'the cloud is cut off: {len(cloud.data)} bytes for {count} points')
    records = np.frombuffer(cloud.data, layout, count)
    positions = np.stack([records['x'], records['y'], records['z']], axis=-1)
    pressure, strain = (
        records[name] if name in kinds else np.zeros(count, np.float32)
        for name in ('pressure', 'permanent_strain')
    )
    return Frame(
        cloud.header.frame_id,
        positions,
        records['displacement'],
        pressure,
        strain,
        records['body'],
    )


def numbers_of_bodies(report: Mapping[str, str]) -> dict[int, str]:
    """Return the names of the bodies by their numbers in clouds, as the diagnostics say."""
    return {
        int(value): key.removesuffix(NUMBER_IN_POINTS)
        for key, value in report.items()
        if key.endswith(NUMBER_IN_POINTS) and value.isdecimal()
    }


@dataclass(frozen=True)
class Surface:
    """The triangles (m, 3) of all bodies, and the rest positions (n, 3) that they index."""

    vertices: np.ndarray
    faces: np.ndarray

    @cached_property
    def shading(self) -> Shading:
        """How it is shaded: edges that turn by more than 50° at rest stay sharp."""
        return shading(self.vertices, self.faces)

    def is_where(self, other: Surface | None) -> bool:
        """Whether another surface has nearly the same bounding box; false without one."""
        if other is None or not len(other.vertices):
            return False
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        near = 0.1 * float(np.linalg.norm(high - low))
        gaps = np.abs([other.vertices.min(axis=0) - low, other.vertices.max(axis=0) - high])
        return bool(gaps.max() <= near)

    def fits(self, frame: Frame) -> bool:
        """Whether the triangles are those of this frame's particles."""
        return len(self.vertices) == len(frame.positions)


def surface(data: bytes) -> Surface:
    """
    Decode a serialized shape_msgs/Mesh of `~/rest_mesh`.

    Deserializing 100 000 triangles to objects takes rclpy most of a second.

    Raises
    ------
    FrameError
        if it is truncated, an index is out of range, or a vertex is not finite.

    """
    try:
        (encoding,) = struct.unpack_from('>H', data)
        order = '<' if encoding & 1 else '>'
        (count,) = struct.unpack_from(order + 'I', data, 4)
        faces = np.frombuffer(data, order + 'u4', 3 * count, 8).reshape(-1, 3)
        place = 8 + faces.nbytes
        (count,) = struct.unpack_from(order + 'I', data, place)
        place += 4 + -place % 8  # doubles begin at multiples of 8 after the encoding
        vertices = np.frombuffer(data, order + 'f8', 3 * count, place if count else 0)
    except (struct.error, ValueError):
        raise FrameError(f'the mesh is cut off after {len(data)} bytes') from None
    vertices = vertices.reshape(-1, 3)
    if faces.size and faces.max() >= len(vertices):
        raise FrameError(f'the mesh has {len(vertices)} vertices, but not number {faces.max()}')
    if not np.abs(vertices).max(initial=0.0) < np.finfo(np.float32).max:
        raise FrameError('the mesh has a vertex whose place is not finite')
    return Surface(vertices.astype(float), faces.astype(np.uint32))


def visuals(data: bytes) -> dict[int, Surface]:
    """
    Decode a serialized visualization_msgs/MarkerArray of `~/visual_mesh`.

    Returns
    -------
    dict of Surface
        at the start pose, by the number of the body in `~/points`

    Raises
    ------
    FrameError
        if it is truncated, or a corner is not finite.

    """
    result: dict[int, Surface] = {}
    try:
        reader = CdrReader(data)
        (count,) = reader.primitives('I')
        for _ in range(count):
            number, action, corners = _marker(reader)
            if action == Marker.ADD and len(corners):
                result[number] = _welded(corners)
    except ValueError as error:
        raise FrameError(f'the markers cannot be read: {error}') from None
    return result


def _marker(reader: CdrReader) -> tuple[int, int, np.ndarray]:
    """Read a Marker; return its id, action and points (n, 3)."""
    reader.primitives('iI'), reader.string(), reader.string()  # stamp, frame_id, ns
    number, _, action = reader.primitives('iii')
    reader.primitives('d' * 10 + 'f' * 4 + 'iI?')  # pose, scale, color, lifetime, frame_locked
    points = np.frombuffer(reader.sequence(24, 8), '<f8').reshape(-1, 3)
    reader.sequence(16, 4), reader.string()  # colors, texture_resource
    reader.primitives('iI'), reader.string(), reader.string(), reader.sequence(1, 1)  # texture
    reader.sequence(8, 4), reader.string(), reader.string()  # uv_coordinates, text, mesh_resource
    reader.string(), reader.sequence(1, 1), reader.primitives('?')  # mesh_file, materials
    return number, action, points


def _welded(corners: np.ndarray) -> Surface:
    """Return the surface with corners (3 m, 3): equal ones are one vertex."""
    if not np.abs(corners).max() < np.finfo(np.float32).max:
        raise FrameError('a marker has a corner whose place is not finite')
    rows = np.ascontiguousarray(corners + 0.0).view(np.dtype((np.void, 24))).ravel()
    _, first, index = np.unique(rows, return_index=True, return_inverse=True)
    faces = index[: len(rows) // 3 * 3].reshape(-1, 3).astype(np.uint32)
    return Surface(corners[first], faces)


class Picture:
    """
    What is drawn of the bodies: their particles, or the surfaces that these carry.

    Parameters
    ----------
    surface : Surface
        of all particles, at rest
    body : (n,) int
        the number of the body of each particle
    visuals : mapping of int to Surface
        that bodies carry, by their numbers

    Attributes
    ----------
    surface : Surface
        that is drawn, at rest
    body : (k,) int
        the number of the body of each of its vertices

    """

    def __init__(self, surface: Surface, body: np.ndarray, visuals: Mapping[int, Surface]) -> None:
        self.surface, self.body = surface, body
        self._carried: list[tuple[np.ndarray, Embedding]] = []
        present = [number for number in np.unique(body).tolist() if number in visuals]
        # without machine code it would take minutes
        if not present or not compiled.is_compiled():
            return
        self._plain = np.flatnonzero(~np.isin(body, present))
        shown, bodies = [_restricted(surface, self._plain)], [body[self._plain]]
        for number in present:
            particles = np.flatnonzero(body == number)
            simulated, visual = _restricted(surface, particles), visuals[number]
            try:
                embedding = Embedding(
                    mesh.Surface(simulated.vertices, simulated.faces),
                    mesh.Surface(visual.vertices, visual.faces),
                )
            except mesh.MeshError as error:
                raise FrameError(f'body {number}: {error}') from None
            self._carried.append((particles, embedding))
            shown.append(visual)
            bodies.append(np.full(len(visual.vertices), number, body.dtype))
        first = np.cumsum([0, *(len(each.vertices) for each in shown)])
        faces = [each.faces + begin for each, begin in zip(shown, first, strict=False)]
        self.surface = Surface(
            np.concatenate([each.vertices for each in shown]),
            np.concatenate(faces).astype(np.uint32),
        )
        self.body = np.concatenate(bodies)

    def of(self, frame: Frame) -> Frame:
        """Return a frame with the vertices of what is drawn in place of the particles."""
        if not self._carried:
            return frame
        places = [frame.positions[self._plain]]
        for particles, embedding in self._carried:
            places.append(embedding.positions(frame.positions[particles]).astype(np.float32))
        return Frame(
            frame.frame_id,
            np.concatenate(places),
            self._carry(frame.displacement),
            self._carry(frame.pressure),
            self._carry(frame.permanent_strain),
            self.body,
        )

    def _carry(self, values: np.ndarray) -> np.ndarray:
        """Return values (k,) at the vertices of what is drawn, of those at the particles (n,)."""
        carried = [embedding.values(values[particles]) for particles, embedding in self._carried]
        return np.concatenate([values[self._plain], *carried])


def _restricted(surface: Surface, vertices: np.ndarray) -> Surface:
    """Return what is left of a surface with some vertices (k,) only, in ascending order."""
    kept = np.zeros(len(surface.vertices), bool)
    kept[vertices] = True
    renumbered = np.cumsum(kept) - 1
    faces = renumbered[surface.faces[kept[surface.faces].all(axis=1)]]
    return Surface(surface.vertices[vertices], faces.astype(np.uint32))


@dataclass(frozen=True)
class Part:
    """
    The bodies of one colour: their particles (k,), and triangles (m, 3) among these.

    A particle on a crease is there several times: what is shown is smooth across edges that share
    their vertices.
    """

    color: Color
    particles: np.ndarray
    faces: np.ndarray


def parts(surface: Surface, body: np.ndarray, colors: Mapping[int, Color]) -> list[Part]:
    """
    Split the surface by colour: few parts, however many bodies there are.

    Parameters
    ----------
    surface : Surface
    body : (n,) int
        the number of the body of each particle
    colors : mapping of int to (4,) int
        of each body, by its number; 0 … 255

    """
    numbers, index_of = np.unique(body, return_inverse=True)
    distinct = list(dict.fromkeys(colors[number] for number in numbers.tolist()))
    color_of = np.array([distinct.index(colors[number]) for number in numbers.tolist()], int)
    result = []
    origin, corners = surface.shading.origin, surface.shading.faces
    for index, color in enumerate(distinct):
        mine = color_of[index_of[origin]] == index
        renumbered = np.cumsum(mine) - 1
        faces = renumbered[corners[mine[corners[:, 0]]]]
        result.append(Part(color, origin[mine], faces.astype(np.uint32)))
    return result


def to_bytes(color: Iterable[float]) -> tuple[int, ...]:
    """Return intensities of 0 … 1 as 0 … 255, clipped; NaN is 0."""
    limited = np.clip(np.nan_to_num(list(color)), 0.0, 1.0)
    return tuple(int(item) for item in (255.0 * limited).round())


def _heat_table() -> np.ndarray:
    """Return 256 colours of `COLORS` in linear light, as glTF requires."""
    places = np.linspace(0.0, len(COLORS) - 1.0, 256)
    srgb = np.stack([np.interp(places, range(len(COLORS)), channel) for channel in COLORS.T], -1)
    table = np.full((256, 4), 255.0)
    table[:, :3] = 255.0 * ((srgb / 255.0 + 0.055) / 1.055) ** 2.4
    return table.round().astype(np.uint8)


_HEAT = _heat_table()


def heat(values: np.ndarray, most: float) -> np.ndarray:
    """Return the colours (n, 4), uint8, for glTF, of values (n,) on a scale from 0 to `most`."""
    return _HEAT[np.clip(255.0 / most * values, 0.0, 255.0).astype(np.uint8)]


def round_up(value: float, steps: tuple[float, ...] = (1.0, 2.0, 5.0)) -> float:
    """Round a positive value up to the next of the steps times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    step = next(step for step in (*steps, 10.0) if step * power >= value * (1 - 1e-9))
    return float(f'{step * power:.6g}')


def first_hit(
    origin: np.ndarray, direction: np.ndarray, positions: np.ndarray, faces: np.ndarray
) -> np.ndarray | None:
    """
    Return the first intersection of a ray with a surface, (3,), or None.

    Möller & Trumbore, Fast, minimum storage ray-triangle intersection (1997).
    """
    a, b, c = positions[faces].astype(float).transpose(1, 0, 2)
    ab, ac, from_a = b - a, c - a, origin - a
    across = np.cross(direction, ac)
    with np.errstate(divide='ignore', invalid='ignore'):
        scale = 1.0 / np.sum(ab * across, axis=-1)
        u = scale * np.sum(from_a * across, axis=-1)
        crossed = np.cross(from_a, ab)
        v = scale * (crossed @ direction)
        distance = scale * np.sum(ac * crossed, axis=-1)
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    return origin + distance[hit].min() * direction if hit.any() else None
