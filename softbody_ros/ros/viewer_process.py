# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The viewer as a process beside a node: `sim_node --viewer`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import signal
import subprocess
import sys
import threading

AT_ONCE = 2.0
"""Seconds within which a signal to both ends the node after its viewer."""


@contextlib.contextmanager
def viewer_of(
    node: str, arguments: Sequence[str], stop: threading.Event, warn: Callable[[str], object]
) -> Iterator[None]:
    """
    Run a viewer of a node until the end of the block.

    Parameters
    ----------
    node : str
        its full name
    arguments : sequence of str
        more arguments of the viewer
    stop : threading.Event
        set when the node is to end: then it is no news that the viewer has ended
    warn : callable
        called with a sentence if it ends before

    """
    command = [sys.executable, '-m', 'softbody_ros.viewer', '--node', node, '--until-eof']
    try:
        # its standard input closes when this process ends, however that happens
        process = subprocess.Popen([*command, *arguments], stdin=subprocess.PIPE)
    except OSError as error:
        warn(f'the viewer cannot be started ({error.strerror}): the node runs without it')
        yield
        return
    assert process.stdin is not None
    is_over = threading.Event()

    def watch() -> None:
        code = process.wait()  # it leaves no zombie
        if not (is_over.is_set() or stop.wait(AT_ONCE)):
            warn(
                f'the viewer has ended ({_reason(code)}): the node goes on without it; the '
                'command `viewer` starts another one'
            )

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        is_over.set()
        with contextlib.suppress(OSError):
            process.stdin.close()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _reason(code: int) -> str:
    if code >= 0:
        return f'exit code {code}'
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f'signal {-code}'
