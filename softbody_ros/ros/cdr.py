# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Common Data Representation, little endian: the serialization of ROS 2 messages.

Only what the bulk messages need: offsets follow from the alignment rules of the OMG DDS
Interoperability specification (formal/2014-09-01, section 10.2): each primitive is aligned to its
size, counted from the end of the encapsulation header.
"""

from __future__ import annotations

import struct
from typing import Any

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


class CdrReader:
    """
    Reads primitives with their alignment.

    Parameters
    ----------
    data : bytes
        a message with its encapsulation header

    Raises
    ------
    ValueError
        by each method, if the message ends before.

    """

    def __init__(self, data: bytes) -> None:
        if data[: len(ENCAPSULATION)] != ENCAPSULATION:
            raise ValueError('it is no little-endian CDR')
        self._data = memoryview(data)[len(ENCAPSULATION) :]
        self._position = 0

    def primitives(self, kinds: str) -> tuple:
        """Return one value per letter of `kinds`: struct's codes, for example i, I, f, d, ?, B."""
        values: list[Any] = []
        for kind in kinds:
            size = struct.calcsize('<' + kind)
            values += struct.unpack('<' + kind, self._take(size, size))
        return tuple(values)

    def string(self) -> str:
        """Return a string."""
        (length,) = self.primitives('I')
        return bytes(self._take(length, 1)).rstrip(b'\x00').decode(errors='replace')

    def sequence(self, size: int, alignment: int) -> memoryview:
        """Return the bytes of a sequence whose elements have a size, a multiple of alignment."""
        (count,) = self.primitives('I')
        return self._take(size * count, alignment if count else 1)

    def _take(self, length: int, alignment: int) -> memoryview:
        begin = self._position + -self._position % alignment
        self._position = begin + length
        if self._position > len(self._data):
            raise ValueError(f'it is cut off after {len(self._data)} bytes')
        return self._data[begin : self._position]
