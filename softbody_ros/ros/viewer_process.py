# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The viewer as a process beside a node: `sim_node --viewer`."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import subprocess
import sys


@contextlib.contextmanager
def viewer_of(node: str) -> Iterator[None]:
    """Run a viewer of the node of this name until the end of the block."""
    # its standard input closes when this process ends, however that happens
    process = subprocess.Popen(
        [sys.executable, '-m', 'softbody_ros.viewer', '--node', node, '--until-eof'],
        stdin=subprocess.PIPE,
    )
    assert process.stdin is not None
    try:
        yield
    finally:
        process.stdin.close()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
