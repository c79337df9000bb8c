# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Plots of what one body does: height of its centre, speed, and force of its contacts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
import viser

from softbody_ros.ros.polling import subscribe, taken

NOTHING = 'nothing'
SPAN = 10.0
"""Seconds that are shown, of simulated time."""
FINEST = 0.01
"""Seconds between two points of a curve, at least."""
MOST_FORCES = 100_000
"""Messages that are kept: of ten seconds at the highest rate."""
PAUSE = 0.5
"""Seconds without a message after which there was a pause rather than a slow rate."""
PERIOD = 0.1
"""Seconds between two pictures of the plots, at least."""
QUEUE = 1000
"""Messages of all bodies between two calls of `update`, at most."""
CURVES = (
    ('height of the centre [m]', '#d96c2e'),
    ('speed [m∕s]', '#3f78c4'),
    ('contact force [N]', '#b01446'),
)
# all begin at 0: otherwise rounding errors of what rests would fill the plot
RANGE: dict[str, Any] = {
    'min': {'pad': 0.1, 'soft': 0.0, 'mode': 1}, 'max': {'pad': 0.1, 'soft': 0.01, 'mode': 1},
}  # fmt: skip


class Track:
    """
    The last `SPAN` seconds of a body, in simulated time, of which only stamps are known.

    While the simulation is paused stamps go on, in one jump: it counts as one usual step. Where
    stamps go back, what came after is forgotten.
    """

    def __init__(self) -> None:
        self._states: deque[tuple[int, float, float, float]] = deque()
        self._forces: deque[tuple[int, float]] = deque(maxlen=MOST_FORCES)
        self._last = 0
        self._time = self._usual = 0.0

    def add_state(self, stamp: int, height: float, speed: float, time_scale: float = 1.0) -> None:
        """
        Add the state at a stamp, ns.

        Parameters
        ----------
        stamp : int
            ns
        height, speed : float
            m, m/s
        time_scale : float
            simulated seconds in one of the stamps

        """
        if stamp <= self._last:
            self._forget_from(stamp)
        step = 1e-9 * (stamp - self._last) if self._states else 0.0
        if step > max(PAUSE, 3.0 * self._usual) and self._usual:
            step = self._usual
        elif step:
            self._usual = step
        self._last, self._time = stamp, self._time + step * time_scale
        if not self._states or self._time - self._states[-1][1] >= FINEST:
            self._states.append((stamp, self._time, height, speed))
        while self._states[0][1] < self._time - SPAN:
            self._states.popleft()
        while self._forces and self._forces[0][0] < self._states[0][0]:
            self._forces.popleft()

    def _forget_from(self, stamp: int) -> None:
        while self._states and self._states[-1][0] >= stamp:
            self._states.pop()
        while self._forces and self._forces[-1][0] >= stamp:
            self._forces.pop()
        self._last, self._time = self._states[-1][:2] if self._states else (stamp, 0.0)

    def add_force(self, stamp: int, force: float) -> None:
        """Add the mean force, N, between the message before and this stamp, ns."""
        if self._forces and stamp <= self._forces[-1][0]:
            self._forget_forces(stamp)
        self._forces.append((stamp, force))

    def _forget_forces(self, stamp: int) -> None:
        while self._forces and self._forces[-1][0] >= stamp:
            self._forces.pop()

    def curves(self) -> tuple[np.ndarray, ...]:
        """
        Return times (n,) before now, s, heights, m, speeds, m/s, and forces, N.

        Without a message between two times nothing was touched.
        """
        stamps = np.array([stamp for stamp, *_ in self._states], np.int64)
        states = np.array([state for _, *state in self._states]).reshape(-1, 3).T
        of = np.searchsorted(stamps, [stamp for stamp, _ in self._forces])
        sums = np.bincount(of, [force for _, force in self._forces], len(stamps) + 1)
        counts = np.bincount(of, minlength=len(stamps) + 1)
        forces = (sums / np.maximum(counts, 1))[: len(stamps)]
        return states[0] - self._time, states[1], states[2], forces


class Plots:
    """
    A folder of the panel with the curves of a body that is chosen there; without it, nothing.

    Parameters
    ----------
    node : Node
    server : viser.ViserServer
    target : str
        name of the node that is observed

    """

    def __init__(self, node: Node, server: viser.ViserServer, target: str) -> None:
        self._node, self._server, self._target = node, server, target
        self.time_scale = 1.0
        self._shown = NOTHING
        self._track = Track()
        self._states: Subscription | None = None
        self._forces: Subscription | None = None
        self._is_new, self._drawn = False, -PERIOD
        gui = server.gui
        with gui.add_folder('plots', expand_by_default=False):
            self._body: Any = gui.add_dropdown(
                'plot', (NOTHING,), hint='the last 10 simulated seconds'
            )
            self._plots = [_plot(gui, title, color) for title, color in CURVES]

    def offer(self, names: Iterable[str]) -> None:
        """Let one of these bodies be chosen."""
        options = (NOTHING, *(name for name in names if name != NOTHING))
        if options != self._body.options:
            chosen = self._body.value
            self._body.options = options
            self._body.value = chosen if chosen in options else NOTHING

    def update(self) -> None:
        """Take what has come, and draw it."""
        if self._body.value != self._shown:
            self._choose(self._body.value)
        if self._states is None or self._forces is None:
            return
        name = self._shown.encode()
        for data, _ in taken(self._states, QUEUE):
            if name in data:  # of several bodies few need to be deserialized
                self._add_state(deserialize_message(data, Odometry))
        for message, _ in taken(self._forces):
            force = message.wrench.force
            size = float(np.linalg.norm([force.x, force.y, force.z]))
            self._track.add_force(_nanoseconds(message), size)
            self._is_new = True
        now = time.monotonic()
        if self._is_new and now - self._drawn >= PERIOD:
            self._is_new, self._drawn = False, now
            self._draw()

    def _add_state(self, message: Odometry) -> None:
        if message.child_frame_id == self._shown:
            velocity = message.twist.twist.linear
            speed = float(np.linalg.norm([velocity.x, velocity.y, velocity.z]))
            height = message.pose.pose.position.z
            self._track.add_state(_nanoseconds(message), height, speed, self.time_scale)
            self._is_new = True

    def _choose(self, name: str) -> None:
        for subscription in (self._states, self._forces):
            if subscription is not None:
                self._node.destroy_subscription(subscription)
        self._states = self._forces = None
        self._shown, self._track = name, Track()
        is_on = name != NOTHING
        for plot in self._plots:
            plot.visible = is_on
        self._draw()
        if is_on:
            topic = f'{self._target}/odometry'
            self._states = subscribe(self._node, Odometry, topic, QUEUE, raw=True)
            topic = f'{self._target}/contacts/{name}'
            self._forces = subscribe(self._node, WrenchStamped, topic, QUEUE)

    def _draw(self) -> None:
        times, *curves = self._track.curves()
        with self._server.atomic():
            for plot, curve in zip(self._plots, curves, strict=True):
                plot.data = times, curve


def _plot(gui: viser.GuiApi, title: str, color: str) -> Any:
    return gui.add_uplot(
        (np.zeros(0), np.zeros(0)),
        ({}, {'stroke': color, 'width': 1.5, 'points': {'show': False}}),
        title=title,
        scales={'x': {'time': False, 'range': (-SPAN, 0.0)}, 'y': {'range': RANGE}},
        axes=(
            {'size': 24, 'incrs': (1.0, 2.0, 5.0), 'ticks': {'show': False}},
            {'size': 42, 'ticks': {'show': False}},
        ),
        legend={'show': False},
        height=120,
        padding=(8, 16, 0, 0),
        visible=False,
    )


def _nanoseconds(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
