# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a kernel has become: how many of its instructions work on several numbers at a time."""

import re

import numba

from softbody_ros.core.compiled import OPTIONS

PACKED = re.compile(
    r'^\s+(?:'
    r'v?(?:add|sub|mul|div|sqrt|min|max)pd\s'  # x86: two, four or eight doubles
    r'|f(?:add|sub|mul|div|sqrt|mla|mls)\s+v\d+\.2d'  # ARM: two
    r')',
    re.MULTILINE,
)


def vector_instructions(kernel):
    """
    Return how many instructions of a kernel compute with several doubles at a time.

    With the argument types that it was called with; what came from the cache has no listing, so
    it is compiled anew.
    """
    assert kernel.signatures, 'call it first: its argument types are not known'
    fresh = numba.njit(**OPTIONS)(kernel.py_func)
    for signature in kernel.signatures:
        fresh.compile(signature)
    return sum(len(PACKED.findall(listing)) for listing in fresh.inspect_asm().values())
