# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mesh files as they come: what their bytes are, and the triangles, unit and axes that they have.

trimesh reads the formats; what it is not asked to read is refused first, by what the file begins
with, so that the sentence names what it is and not where a parser has given up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import importlib.util
import io
import logging
import os
import re
from typing import Any
import warnings

import numpy as np
import trimesh

from softbody_ros.core.geometry import dae, glb
from softbody_ros.core.geometry.surface import MeshError

FILE_TYPES = ('stl', 'obj', 'ply', 'off', 'glb', 'dae')
LARGEST_FILE = 1 << 30
HEAD = 1 << 16
"""Bytes of the beginning of a file that are looked at."""
LONGEST_REASON = 160
"""Characters of what a parser says that are shown."""
LIBRARIES = ('trimesh', 'collada', 'PIL')
"""Loggers of the libraries that read files."""
BYTE_ORDER_MARK = b'\xef\xbb\xbf'
"""Of UTF-8, which some editors write, and no reader expects."""

FOREIGN = (
    (b'version https://git-lfs', 'is a Git LFS pointer, not the mesh: fetch it with git lfs pull'),
    (b'\x1f\x8b', 'is compressed by gzip: unpack it with gunzip'),
    (b'BZh', 'is compressed by bzip2: unpack it with bunzip2'),
    (b'\xfd7zXZ', 'is compressed by xz: unpack it with unxz'),
    (b'\x28\xb5\x2f\xfd', 'is compressed by Zstandard: unpack it with unzstd'),
    (b'7z\xbc\xaf', 'is a 7z archive: unpack it first'),
    (b'Rar!', 'is a RAR archive: unpack it first'),
    (b'PK\x03\x04', 'is a ZIP archive (3MF and others are): unpack it, or export as STL'),
    (b'Kaydara FBX', 'is FBX: export it as GLB, with Blender for example'),
    (b'; FBX', 'is FBX: export it as GLB, with Blender for example'),
    (b'BLENDER', 'is a Blender project: export it as GLB'),
    (b'ISO-10303', 'is STEP: export it as STL from a CAD program'),
    (b'PXR-USDC', 'is USD: export it as GLB'),
    (b'#usda', 'is USD: export it as GLB'),
    (b'#VRML', 'is VRML: export it as GLB'),
    (b'DRACO', 'is a Draco file: decode it with draco_decoder'),
    (b'%PDF', 'is a PDF: give a mesh'),
    (b'\x89PNG', 'is a PNG image: give a mesh'),
    (b'\xff\xd8\xff', 'is a JPEG image: give a mesh'),
    (b'\x7fELF', 'is a program: give a mesh'),
)
"""What files begin with that are no meshes, or none that can be read, and what to do then."""

TO_Z_UP = {
    'z': np.eye(3),
    'y': np.array([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)]),
    'x': np.array([(0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)]),
}
"""By the axis that points up in a file: what turns it to z up. Of x, as COLLADA 1.5 defines it."""


@dataclass(frozen=True)
class MeshFile:
    """
    What a file holds.

    Attributes
    ----------
    vertices : (n, 3) float
        as they are in the file, with the transforms of its scene
    faces : (m, 3) int
    unit : float
        m, if the file says it, else 1
    up : str
        the axis that points up: y of glTF, by its specification, what COLLADA says (y if it does
        not), else z
    notes : tuple of str
        a sentence for each thing that is not as in the file

    """

    vertices: np.ndarray
    faces: np.ndarray
    unit: float
    up: str
    notes: tuple[str, ...]


def read_mesh_file(path: str, primitives: Sequence[str]) -> MeshFile:
    """
    Return the triangles of a file.

    Parameters
    ----------
    path : str
        of a file with one of the endings in `FILE_TYPES`
    primitives : sequence of str
        what else could have been meant, for a sentence

    Raises
    ------
    MeshError
        if the file cannot be read, or holds no triangles.

    """
    ending = os.path.splitext(path)[1].lower().lstrip('.')
    if ending not in FILE_TYPES:
        raise MeshError(
            f'mesh {path[:200]!r} is neither a primitive ({", ".join(primitives)}) '
            f'nor a file that ends in .{", .".join(FILE_TYPES)}'
        )
    content = _content(path)
    if not _is_binary_stl(content[:HEAD], len(content)):
        content = content.removeprefix(BYTE_ORDER_MARK)
    head = content[:HEAD]
    _require_format(path, ending, head, len(content))
    unit, up = 1.0, 'z'
    notes: tuple[str, ...] = ()
    try:
        if ending == 'stl':
            content, surplus = _without_surplus(content)
            if surplus:
                notes = (f'mesh {path} has {surplus} bytes after its triangles, left out',)
        if ending == 'obj' and b'\r' in head and b'\n' not in head:
            content = content.replace(b'\r', b'\n')  # lines as of an old Macintosh
        if ending == 'glb':
            content, obstacles = glb.for_trimesh(content)
            up = 'y'
            if obstacles:
                notes = (
                    f'mesh {path} is a film of this simulator: its obstacles '
                    f'({_some(obstacles)}) are left out',
                )
        elif ending == 'dae':
            content, unit, up = dae.for_trimesh(content)
        _require_whole(ending, content)
    except ValueError as error:
        raise MeshError(f'mesh file {path} {error}') from None
    if ending == 'dae' and importlib.util.find_spec('collada') is None:
        raise MeshError(
            f'mesh file {path} is COLLADA, which needs pycollada: pip install pycollada (or, in '
            "the clone, '.[dae]')"
        )
    vertices, faces = _loaded(path, ending, content)
    if not len(faces):
        raise MeshError(f'mesh {path} holds no triangles{_why_none(ending, head, content)}')
    return MeshFile(vertices, faces, unit, up, notes)


def _why_none(ending: str, head: bytes, content: bytes) -> str:
    """Return the end of the sentence about a file without triangles."""
    if ending == 'ply' and b'element tristrips' in head:
        return ' but strips of them, which are not read: export it as triangles'
    if ending == 'dae' and b'instance_controller' in content:
        return ' but a skinned mesh: apply its armature, and export it again'
    if ending == 'dae' and b'<geometry' in content.replace(b':geometry', b'<geometry'):
        return ' that can be read: export it again, or as GLB'
    return ': give a surface, not points or lines'


def _content(path: str) -> bytes:
    if os.path.isdir(path):
        raise MeshError(f'mesh file {path} is a folder: give a file in it')
    if not os.path.isfile(path):
        raise MeshError(f'mesh file {path[:200]} does not exist: check the path')
    if os.path.getsize(path) > LARGEST_FILE:
        raise MeshError(f'mesh file {path} is larger than 1 GiB: simplify the mesh first')
    try:
        with open(path, 'rb') as file:
            content = file.read()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise MeshError(f'mesh file {path} cannot be read ({reason})') from None
    if not content.strip(b'\0 \t\r\n'):
        what = 'holds nothing but zeros and blanks' if content else 'is empty'
        raise MeshError(f'mesh file {path} {what}: export or copy it again')
    return content


def _loaded(path: str, ending: str, content: bytes) -> tuple[np.ndarray, np.ndarray]:
    options: Any = {'skip_materials': True} if ending in ('obj', 'ply', 'glb') else {}
    try:
        with _silence():
            shape = trimesh.load(
                io.BytesIO(content), file_type=ending, force='mesh', process=False, **options
            )
    except Exception as error:  # the parsers raise all kinds of exceptions
        reason = ' '.join(str(error).split())[:LONGEST_REASON] or type(error).__name__
        raise MeshError(
            f'mesh file {path} cannot be read as {ending.upper()} ({reason}): export it again'
        ) from None
    if not isinstance(shape, trimesh.Trimesh):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    return np.asarray(shape.vertices, np.float64), np.asarray(shape.faces, np.int64)


@contextmanager
def _silence() -> Iterator[None]:
    """Keep libraries from writing to logs and standard error: what is wrong is said here."""
    loggers = [logging.getLogger(name) for name in LIBRARIES]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings(), np.errstate(all='ignore'):
        warnings.simplefilter('ignore')
        try:
            for logger in loggers:
                logger.setLevel(logging.CRITICAL + 1)
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


# ------------------------------------------------------------------------------------- the formats
def _require_format(path: str, ending: str, head: bytes, size: int) -> None:
    """Raise MeshError if a file is recognised as something else than its ending says."""
    text = head.lstrip()
    # the 80 bytes before a binary STL may be anything
    if ending == 'stl' and _is_binary_stl(head, size):
        return
    for begin, what in FOREIGN:
        if text.startswith(begin):
            raise MeshError(f'mesh file {path} {what}')
    if re.match(rb'<(!doctype\s+html|html|head|body)\b', text, re.IGNORECASE):
        raise MeshError(
            f'mesh file {path} is a web page, not the mesh: download the file itself, of GitHub '
            'by its "raw" address'
        )
    found = _format_of(text, size)
    if found == ending or not found:
        return
    if found in FILE_TYPES:
        name = os.path.splitext(os.path.basename(path))[0]
        raise MeshError(
            f'mesh file {path} is not {ending.upper()}, but {found.upper()}: rename it to '
            f'{name}.{found}'
        )
    raise MeshError(f'mesh file {path} is {found}: export it as GLB')


def _is_binary_stl(head: bytes, size: int) -> bool:
    return size >= 84 and size == 84 + 50 * int.from_bytes(head[80:84], 'little')


def _without_surplus(content: bytes) -> tuple[bytes, int]:
    """Return an STL file without what follows its triangles, and how many bytes these were."""
    if len(content) < 84 or _format_of(content[:HEAD].lstrip(), len(content)) == 'stl':
        return content, 0
    count = int.from_bytes(content[80:84], 'little')
    size = 84 + 50 * count
    if len(content) < size:
        raise ValueError(
            f'is cut off, or no STL: it has {len(content)} bytes, and {count} triangles would '
            f'take {size}'
        )
    return content[:size], len(content) - size


def _require_whole(ending: str, content: bytes) -> None:
    """Raise ValueError if a text ends before its last triangle, which trimesh does not say."""
    if ending == 'stl' and _is_text_stl(content[:HEAD].lstrip()):
        end = max(content.lower().rfind(b'endsolid'), 0)
        if re.search(rb'^\s*vertex\s', content[end:], re.IGNORECASE | re.MULTILINE):
            raise ValueError('is cut off, without its endsolid: export or copy it again')
    elif ending == 'ply':
        header, _, body = content.partition(b'end_header')
        elements = rb'^element\s+(\S+)\s+(\d+)(\s+property\s+list\b)?'
        before = 0
        if re.search(rb'^format\s+ascii\b', header, re.MULTILINE):
            for name, count, has_corners in re.findall(elements, header, re.MULTILINE):
                if name == b'face':
                    rows = body.rstrip().splitlines()[1 + before :]
                    _require_faces(rows, int(count), bool(has_corners))
                before += int(count)
    elif ending == 'off':
        lines = [line.partition(b'#')[0].strip() for line in content.splitlines()]
        after = b'\n'.join(filter(None, lines)).partition(b'OFF')[2].strip()
        if counts := re.match(rb'(\d+)[ \t]+(\d+)', after):
            rows = after.splitlines()[1 + int(counts[1]) :]
            _require_faces(rows, int(counts[2]), True)


def _require_faces(rows: Sequence[bytes], count: int, have_corners: bool) -> None:
    """Raise ValueError if rows of faces are missing; they may begin with numbers of corners."""
    present = min(len(rows), count)
    if present and have_corners:
        last = rows[present - 1].split()
        present -= not last or (last[0].isdigit() and len(last) <= int(last[0]))
    if present < count:
        raise ValueError(f'is cut off, with {present} of {count} faces: export or copy it again')


def _is_text_stl(text: bytes) -> bool:
    """Return whether this begins a text; a binary STL has zeros, in its number of triangles."""
    is_solid = re.match(rb'solid\b', text, re.IGNORECASE) is not None
    return is_solid and b'\0' not in text.rstrip(b'\0')


def _format_of(text: bytes, size: int) -> str:
    """Return the ending that fits what a file begins with, another format's name, or ''."""
    if text.startswith(b'glTF'):
        return 'glb'
    if re.match(rb'ply\s', text):
        return 'ply'
    if re.match(rb'(ST)?C?N?4?n?OFF\s', text):
        return 'off'
    if _is_text_stl(text):
        return 'stl'
    if text.startswith(b'<'):
        if re.search(rb'<([\w.-]+:)?COLLADA\b', text):
            return 'dae'
        root = re.search(rb'<([A-Za-z][\w.:-]*)', text)
        return f'XML of <{root[1].decode(errors="replace")[:40]}>' if root else ''
    if text.startswith(b'{'):
        return 'glTF with files of its own (.gltf)' if b'"asset"' in text else 'JSON'
    number = rb'[-+]?[\d.]+(?:[eE][-+]?\d+)?'
    if b'\0' not in text and re.search(rb'^\s*v(\s+' + number + rb'){3}', text, re.MULTILINE):
        return 'obj'
    return 'stl' if _is_binary_stl(text, size) else ''


def _some(names: Sequence[str]) -> str:
    more = f' and {len(names) - 5} more' if len(names) > 5 else ''
    return ', '.join(names[:5]) + more
