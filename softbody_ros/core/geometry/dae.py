# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""COLLADA 1.4 and 1.5, as far as meshes are read from it: elements as in its specification."""

from __future__ import annotations

import math
from xml.etree import ElementTree

NOT_NEEDED = {
    'library_animations', 'library_cameras', 'library_effects', 'library_images',
    'library_lights', 'library_materials', 'bind_material', 'instance_camera', 'instance_light',
    'extra',
}  # fmt: skip
"""Elements that do not concern triangles, but whose faults would lose some."""


def for_trimesh(content: bytes) -> tuple[bytes, float, str]:
    """
    Return a document without what is not needed, its unit, m, and the axis that points up.

    By default these are 1 m and y.

    Raises
    ------
    ValueError
        what is wrong, and what to do, as the end of a sentence

    """
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        reason = ' '.join(str(error).split())[:80]
        raise ValueError(
            f'cannot be read as DAE (its XML is damaged: {reason}): export it again'
        ) from None
    unit, up = 1.0, 'y'
    for asset in root:
        for element in asset if _name(asset) == 'asset' else ():
            if _name(element) == 'unit':
                unit = _number(element.get('meter', '1'))
            elif _name(element) == 'up_axis':
                up = {'X_UP': 'x', 'Z_UP': 'z'}.get((element.text or '').strip(), 'y')
    for parent in root.iter():
        for element in list(parent):
            if _name(element) in NOT_NEEDED:
                parent.remove(element)
    try:
        return ElementTree.tostring(root), unit, up
    except RecursionError:
        raise ValueError('is nested too deeply: export it again') from None


def _name(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition('}')[2]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return 1.0
    return value if 0.0 < value < math.inf else 1.0
