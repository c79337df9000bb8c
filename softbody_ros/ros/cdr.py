# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Writer of Common Data Representation, little endian: the serialization of ROS 2 messages.

Only what the bulk messages need: offsets follow from the alignment rules of the OMG DDS
Interoperability specification (formal/2014-09-01, section 10.2): each primitive is aligned to its
size, counted from the end of the encapsulation header.
"""

from __future__ import annotations

import struct

ENCAPSULATION = b'\x00\x01\x00\x00'


class CdrWriter:
    """
    Appends primitives with their alignment.

    Parameters
    ----------
    offset : int
        of the first byte in the message, without the encapsulation header; a fragment that begins
        at a multiple of 8 can be written with 0

    """

    def __init__(self, offset: int = 0) -> None:
        self._bytes = bytearray()
        self._offset = offset

    def primitives(self, kinds: str, *values: float | bool) -> CdrWriter:
        """Append one value per letter of `kinds`: struct's codes, for example i, I, f, d, ?, B."""
        for kind, value in zip(kinds, values, strict=True):
            self._align(struct.calcsize('<' + kind))
            self._bytes += struct.pack('<' + kind, value)
        return self

    def string(self, text: str) -> CdrWriter:
        """Append a string: its length with the terminating zero, then the bytes."""
        encoded = text.encode() + b'\x00'
        self.primitives('I', len(encoded))
        self._bytes += encoded
        return self

    def sequence(self, count: int, alignment: int) -> CdrWriter:
        """Append the length of a sequence, and the padding up to its first element."""
        self.primitives('I', count)
        if count:
            self._align(alignment)
        return self

    def pad(self, alignment: int) -> CdrWriter:
        """Append padding up to an alignment."""
        self._align(alignment)
        return self

    def take(self) -> bytes:
        """Return the bytes written."""
        return bytes(self._bytes)

    def _align(self, size: int) -> None:
        position = self._offset + len(self._bytes)
        self._bytes += bytes(-position % size)
