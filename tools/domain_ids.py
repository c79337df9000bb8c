# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Domain ids for any number of ROS graphs on one machine, so that none hears another."""

from __future__ import annotations

import errno
import itertools
import os
import socket
import time

IDS = range(1, 102)
"""Of larger ones Linux may give the ports to others; 0 is for people who choose none."""
PATIENCE = 300.0
_first = itertools.count(os.getpid())


class Domain:
    """A domain id that nobody else on this machine uses, until it is given back."""

    def __init__(self) -> None:
        deadline = time.monotonic() + PATIENCE
        while True:
            first = next(_first)  # rather not the one of before: something may linger there
            for i in range(len(IDS)):
                self.id = IDS[(first + i) % len(IDS)]
                claim = claimed(self.id)
                if claim is not None:
                    self._claim = claim
                    return
            if time.monotonic() > deadline:
                raise RuntimeError('all domain ids from 1 to 101 are in use: end what uses them')
            time.sleep(0.1)

    def give_back(self) -> None:
        self._claim.close()


def claimed(domain: int) -> socket.socket | None:
    """Return what keeps a domain id for this process until it is closed; None if it is in use."""
    # a name that one socket at a time has, and that ends with its process, whatever ends that
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    if _binds(claim, f'\0softbody_ros domain {domain}') and not _has_nodes(domain):
        return claim
    claim.close()
    return None


def _has_nodes(domain: int) -> bool:
    """Return whether nodes are there that claim nothing: by their first few ports."""
    for participant in range(4):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            if not _binds(port, ('', 7410 + 250 * domain + 2 * participant)):
                return True
    return False


def _binds(end: socket.socket, address: str | tuple[str, int]) -> bool:
    try:
        end.bind(address)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return False
    return True
