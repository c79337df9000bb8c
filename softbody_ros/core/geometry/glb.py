# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Binary glTF 2.0, as far as meshes are read from it: names as in its specification.

Films that `bake` writes mark the nodes of obstacles in their extras, so that who loads one as a
mesh gets the bodies alone.
"""

from __future__ import annotations

import json
import struct
from typing import Any

MARK = {'softbody_ros': 'obstacle'}
"""Extras of the nodes of obstacles in a film."""
GLB_HEADER = struct.Struct('<4sII')
"""Magic, version, length in bytes."""
CHUNK_HEADER = struct.Struct('<I4s')
"""Length in bytes, type."""
HARMLESS = ('KHR_materials', 'KHR_texture', 'EXT_texture', 'MSFT_texture', 'KHR_lights')
"""What the names of extensions begin with that do not concern triangles."""
FANS = 6
"""Mode of primitives."""
QUANTIZED = 'KHR_mesh_quantization'
DECODE = 'gltf-transform cp in.glb out.glb, or by exporting without compression'
CURES = {
    'KHR_draco_mesh_compression': f'is compressed by Draco: decode it with {DECODE}',
    'EXT_meshopt_compression': f'is compressed by meshopt: decode it with {DECODE}',
    'KHR_meshopt_compression': f'is compressed by meshopt: decode it with {DECODE}',
}
"""What to do about extensions without which a file cannot be read."""


def for_trimesh(content: bytes) -> tuple[bytes, list[str]]:
    """
    Return a binary glTF with triangles and their transforms alone, and what has been left out.

    Materials, textures and animations are not needed, and not all of them can be read.

    Parameters
    ----------
    content : bytes

    Returns
    -------
    content : bytes
    obstacles : list of str
        names of the nodes of obstacles of a film, whose meshes are left out

    Raises
    ------
    ValueError
        what it is, and what to do, as the end of a sentence

    """
    try:
        document, rest = _parts(content)
        return _reduced(document, rest)
    except RecursionError:
        raise ValueError('is nested too deeply: export it again') from None
    except (AttributeError, IndexError, KeyError, TypeError):
        raise ValueError('cannot be read as GLB (its JSON is damaged): export it again') from None


def _reduced(document: dict[str, Any], rest: bytes) -> tuple[bytes, list[str]]:
    _require_readable(document)
    obstacles = []
    nodes = [node for node in document.get('nodes', []) if isinstance(node, dict)]
    for node in nodes:
        extras = node.pop('extras', None)
        if 'mesh' in node and isinstance(extras, dict) and MARK.items() <= extras.items():
            obstacles.append(str(node.get('name', '')))
            del node['mesh']
        for name in ('skin', 'weights', 'camera', 'extensions'):
            node.pop(name, None)
    if obstacles and not any('mesh' in node for node in nodes):
        raise ValueError('is a film of this simulator without any body in it')
    for mesh in document.get('meshes', []):
        mesh.pop('weights', None)
        mesh.pop('extras', None)
        for primitive in mesh.get('primitives', []):
            attributes = primitive.get('attributes', {})
            primitive['attributes'] = {
                name: index for name, index in attributes.items() if name == 'POSITION'
            }
            for name in ('targets', 'material', 'extensions', 'extras'):
                primitive.pop(name, None)
    for name in ('materials', 'textures', 'images', 'samplers', 'animations', 'skins', 'cameras',
                 'extensions', 'extensionsUsed', 'extensionsRequired', 'extras'):  # fmt: skip
        document.pop(name, None)
    text = json.dumps(document).encode()
    text += b' ' * (-len(text) % 4)
    length = GLB_HEADER.size + CHUNK_HEADER.size + len(text) + len(rest)
    header = GLB_HEADER.pack(b'glTF', 2, length) + CHUNK_HEADER.pack(len(text), b'JSON')
    return header + text + rest, obstacles


def _parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the document of a binary glTF, and the chunks after it."""
    if len(content) < GLB_HEADER.size + CHUNK_HEADER.size:
        raise ValueError('is cut off: export or copy it again')
    magic, version, length = GLB_HEADER.unpack_from(content)
    if magic != b'glTF':
        raise ValueError('is no GLB: it does not begin with glTF')
    if version != 2:
        raise ValueError(f'is glTF of version {version}: export it as glTF 2.0')
    size, kind = CHUNK_HEADER.unpack_from(content, GLB_HEADER.size)
    start = GLB_HEADER.size + CHUNK_HEADER.size
    if len(content) < length or start + size > length:
        raise ValueError(
            f'is cut off, at {len(content)} of {length} bytes: export or copy it again'
        )
    try:
        document = json.loads(content[start : start + size])
    except ValueError:
        document = None
    if kind != b'JSON' or not isinstance(document, dict):
        raise ValueError('cannot be read as GLB (its JSON is damaged): export it again')
    return document, content[start + size : length]


def _require_readable(document: dict[str, Any]) -> None:
    required = [str(name) for name in document.get('extensionsRequired') or []]
    for name in required:
        if name in CURES:
            raise ValueError(CURES[name])
    for name in required:
        if name != QUANTIZED and not name.startswith(HARMLESS):
            raise ValueError(
                f'needs the glTF extension {name[:60]}, which cannot be read: export it without'
            )
    for buffer in document.get('buffers', []):
        if not str(buffer.get('uri', 'data:')).startswith('data:'):
            raise ValueError(
                f'keeps its data in another file, {str(buffer["uri"])[:60]}: export it as one GLB'
            )
    accessors = document.get('accessors', [])
    for mesh in document.get('meshes', []):
        for primitive in mesh.get('primitives', []):
            if primitive.get('mode') == FANS:
                raise ValueError('has triangle fans, which cannot be read: export it as triangles')
            index = primitive.get('attributes', {}).get('POSITION')
            if not isinstance(index, int) or not 0 <= index < len(accessors):
                continue
            if accessors[index].get('normalized'):
                raise ValueError(
                    'has quantized coordinates: decode it with gltf-transform dequantize in.glb '
                    'out.glb'
                )
            if 'sparse' in accessors[index]:
                raise ValueError('has sparse accessors, which cannot be read: export it without')
