# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ROS node of the viewer: displays received messages, and forwards actions on the page."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from std_srvs.srv import SetBool, Trigger
import viser
from visualization_msgs.msg import MarkerArray

from softbody_ros.core.config import NAME_PATTERN
from softbody_ros.ros.spinning import spin
from softbody_ros.ros.start import start_ros
from softbody_ros.viewer import decoding, widgets
from softbody_ros.viewer.decoding import Color, Frame, FrameError, Picture, Surface
from softbody_ros.viewer.force_arrows import ForceArrows
from softbody_ros.viewer.keyboard import Keyboard
from softbody_ros.viewer.page import Page
from softbody_ros.viewer.panel import (
    BY_BODY,
    BY_DISPLACEMENT,
    BY_PRESSURE,
    BY_STRAIN,
    UNITS,
    Panel,
)
from softbody_ros.viewer.plots import Plots
from softbody_ros.viewer.recording import FilmMenu
from softbody_ros.viewer.remote import PATIENCE, Remote
from softbody_ros.viewer.scene_menu import SceneMenu
from softbody_ros.viewer.server import PageServer, free_port, page_address
from softbody_ros.viewer.view3d import View3D
from softbody_ros.viewer.widgets import Field

SILENCE = 3.0
"""Seconds without a message after which a node is gone: diagnostics come once a second."""
IN_FLIGHT = 0.5
"""Seconds after the response to a pause in which older diagnostics may still arrive."""
MEMORY = 5.0
"""Seconds for which the legend holds the largest value."""
LEGEND_ENDS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Viewer(Node):
    """
    Displays the node `target` on the pages of a server.

    Everything runs in the thread that spins this node; the server's threads only queue tasks.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        target: str,
        rate: float,
        shadows: bool = True,
        **node_arguments: Any,
    ) -> None:
        super().__init__('softbody_viewer', **node_arguments)
        self._server, self._target = server, target
        self._view = View3D(server, shadows)
        self._page = Page(server)
        self._panel = Panel(server.gui, self._later, self._act, self._change)
        self._arrows = ForceArrows(self, server, target)
        self._plots = Plots(self, server, target)
        self._remote = Remote(self, target, self)
        self._scenes = SceneMenu(
            server.gui, self._later, self._remote, self._notify, lambda: self._frame,
            self._expect_scene, self._reset,
        )  # fmt: skip
        self._film = FilmMenu(
            server.gui, self._later, self._notify, self._scenes.text, self._count_vertices
        )
        self._keyboard = Keyboard(server.gui, self._later, self._act, self._page.toggle)
        self._is_other_scene = False
        self._names: list[str] = []
        self._asked = -PATIENCE
        self._is_described = self._is_outdated = False
        self._surface: Surface | None = None
        self._visuals: dict[int, Surface] = {}
        self._picture: Picture | None = None
        self._colors: dict[str, Color] = {}
        self._numbers: dict[int, str] = {}
        self._drawn = ''
        self._drawn_body = np.zeros(0, np.uint32)
        self._drawn_numbers: list[int] = []
        self._cloud: bytes | None = None
        self._frame: Frame | None = None
        self._last_heard = self._last_answer = -SILENCE
        self._clouds = self._shown = 0
        self._report: dict[str, str] = {}
        self._summary = ''
        self._peaks: list[tuple[float, float]] = []
        self._colored_by = ''
        self._look = BY_BODY, False
        self._problem = ''

        def listen(kind: type, topic: str, use: Callable, qos: Any, raw: bool = False) -> None:
            self.create_subscription(kind, topic, use, qos, raw=raw)

        # raw: only those clouds that are shown get deserialized
        listen(PointCloud2, f'{target}/points', self._take_cloud, 1, raw=True)
        listen(Mesh, f'{target}/rest_mesh', self._take_mesh, LATCHED, raw=True)
        listen(MarkerArray, f'{target}/visual_mesh', self._take_visuals, LATCHED, raw=True)
        listen(MarkerArray, f'{target}/obstacle_markers', self._take_obstacles, LATCHED)
        listen(DiagnosticArray, '/diagnostics', self._take_diagnostics, 10)
        self._poke = self.create_publisher(PointStamped, f'{target}/poke', 10)
        self._triggers = {
            name: self.create_client(Trigger, f'{target}/{name}')
            for name in ('reset', 'step', 'apply_initial_velocity')
        }
        self._pause = self.create_client(SetBool, f'{target}/pause')
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / rate, self._show, clock=steady)
        self._counted = time.monotonic()
        self.create_timer(1.0, self._tell, clock=steady)
        self.create_timer(0.25, self._look_for_node, clock=steady)
        server.scene.on_click()(self._clicked)
        self._tell()

    def _later(self, task: Callable[[], Any]) -> None:
        """Queue a task for the thread of this node."""
        if self.executor is not None:
            self.executor.create_task(task)

    # ----------------------------------------------------------------------------------- messages
    def _take_cloud(self, cloud: bytes) -> None:
        self._cloud, self._last_heard = cloud, time.monotonic()
        self._clouds += 1

    def _take_mesh(self, mesh: bytes, info: Mapping[str, Any]) -> None:
        try:
            surface = decoding.surface(mesh)
        except FrameError as error:
            self._problem = f'{self._target}/rest_mesh: {error}'
            return
        # a later one of the same node has other bodies, beside those that are looked at
        is_first = self._surface is None or info['publication_sequence_number'] in (None, 1)
        is_first |= self._is_other_scene
        if is_first and len(surface.vertices) and not surface.is_where(self._surface):
            self._view.look_at(surface)
        self._is_other_scene &= not len(surface.vertices)  # without bodies it is not there yet
        # after an earlier one: a new node of this name may have other parameters
        self._is_outdated = self._surface is not None
        self._surface, self._picture = surface, None

    def _take_visuals(self, markers: bytes) -> None:
        try:
            self._visuals = decoding.visuals(markers)
        except FrameError as error:
            self._problem = f'{self._target}/visual_mesh: {error}'
            return
        self._picture = None

    def _take_obstacles(self, message: MarkerArray) -> None:
        self._view.set_obstacles(message.markers)
        self._arrows.set_obstacles(message.markers)

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._target:
                self._last_heard = time.monotonic()
                self._summary = status.message
                self._report = {item.key: item.value for item in status.values}
                self._numbers = decoding.numbers_of_bodies(self._report)
                if self._last_heard - self._last_answer >= IN_FLIGHT:
                    self._panel.paused(status.message.startswith('paused'))

    # ------------------------------------------------------------------------------------ display
    def _show(self) -> None:
        """Show the newest cloud if there is a new one, and the newest forces."""
        self._show_cloud()
        look = self._panel.coloring, self._panel.shows_forces
        if look != self._look:  # also while no clouds come
            self._look = look
            self._view.see_through(self._panel.shows_forces)
            self._draw()
        self._arrows.update(self._panel.shows_forces)
        self._plots.update()

    def _show_cloud(self) -> None:
        cloud, self._cloud = self._cloud, None
        if cloud is None or self._surface is None:
            return
        try:
            self._frame = decoding.frame(deserialize_message(cloud, PointCloud2))
        except FrameError as error:
            self._problem = f'{self._target}/points: {error}'
            return
        self._problem = ''
        self._draw()

    def _draw(self) -> None:
        frame = self._frame
        if frame is None or self._surface is None or not self._surface.fits(frame):
            return
        picture = self._picture
        if picture is None or not np.array_equal(frame.body, self._drawn_body):
            picture = self._compose(self._surface, frame.body)
        numbers = self._drawn_numbers if self._drawn else np.unique(frame.body).tolist()
        colors = {number: self._color_of(number) for number in numbers}
        if self._drawn != repr(colors):
            self._drawn, self._drawn_numbers = repr(colors), numbers
            self._view.set_bodies(picture.surface, picture.body, colors)
        names = {self._name_of(number): number for number in numbers}
        named = {name: number for name, number in names.items() if NAME_PATTERN.fullmatch(name)}
        self._arrows.show(frame, named)
        self._plots.offer(named)
        frame = picture.of(frame)
        coloring = self._panel.coloring
        values = {
            BY_DISPLACEMENT: frame.displacement,
            BY_PRESSURE: frame.pressure,
            BY_STRAIN: frame.permanent_strain,
        }.get(coloring)
        if values is None:
            self._panel.legend(None)
            self._view.show(frame, None, 0.0)
        else:
            most = self._largest(values, coloring)
            self._panel.legend(most)
            self._view.show(frame, values, most)
        self._shown += 1

    def _compose(self, surface: Surface, body: np.ndarray) -> Picture:
        """Choose what is drawn: the particles, or what they carry."""
        try:
            picture = Picture(surface, body, self._visuals)
        except FrameError as error:
            self._problem = f'{self._target}/visual_mesh: {error}'
            picture = Picture(surface, body, {})
        self._picture, self._drawn, self._drawn_body = picture, '', body
        self._arrows.set_surface(surface, body)
        return picture

    def _color_of(self, number: int) -> Color:
        """Return the colour of a body by its number in the clouds."""
        return self._colors.get(self._name_of(number), _palette(number))

    def _name_of(self, number: int) -> str:
        """Return the name of a body by its number in the clouds, '' if it is not known."""
        if number < len(self._names) and not self._numbers:
            return self._names[number]
        return self._numbers.get(number, '')

    def _largest(self, values: np.ndarray, coloring: str) -> float:
        """Return the end of the legend: a round number above the recent values."""
        largest = float(np.nan_to_num(values, posinf=0.0).max(initial=0.0))
        now = time.monotonic()
        if coloring != self._colored_by:
            self._colored_by, self._peaks = coloring, []
        self._peaks = [
            peak for peak in self._peaks if now - peak[0] < MEMORY and peak[1] > largest
        ]
        self._peaks.append((now, largest))
        least, _ = UNITS[coloring][-1]
        return decoding.round_up(max(self._peaks[0][1], least), LEGEND_ENDS)

    def _tell(self) -> None:
        """Update the status text with the last second."""
        now = time.monotonic()
        seconds, self._counted = now - self._counted, now
        clouds, shown_rate = self._clouds / max(seconds, 1e-9), self._shown / max(seconds, 1e-9)
        self._clouds = self._shown = 0
        silent = now - self._last_heard
        if self._frame is None and silent >= SILENCE:
            text = f'**Waiting for {self._target}.** {self._others()}'
        elif silent >= SILENCE:
            text = (
                f'**{self._target} is gone**, for {silent:.0f} s: this is the last that came. '
                'When it is back, it is shown again.'
            )
        else:
            state = 'a recording: nothing to steer'
            if self._remote.is_there:
                state = (
                    self._summary.split(': ')[0] if 'too slow' in self._summary else self._summary
                )
            # always the same number of lines: the sliders below must not jump
            vertices = 0 if self._frame is None else len(self._frame.positions)
            facts = f'{clouds:.0f} clouds/s, {shown_rate:.0f} shown · {vertices} vertices'
            if self._report:
                facts += (
                    f'  \nreal-time factor {self._report.get("real-time factor", "?")} · '
                    f'{self._report.get("dropped time (s)", "?")} s dropped'
                )
            text = f'**{self._target}**: {state}  \n{facts}'
        self._panel.status(f'{text}\n\n{self._problem}' if self._problem else text)
        self._panel.settle()
        self._page.paint(self._view.grids)

    def _others(self) -> str:
        """Return advice for when the node is not found."""
        names = [
            topic.removesuffix('/rest_mesh')
            for topic, _ in self.get_topic_names_and_types()
            if topic.endswith('/rest_mesh') and topic != f'{self._target}/rest_mesh'
        ]
        if names:
            return f'There is {", ".join(names)}: to show it, start `viewer --node {names[0]}`.'
        return 'Start it with `sim_node`, or play a bag; the same `ROS_DOMAIN_ID` is needed.'

    # ---------------------------------------------------------------- parameters, see `Listener`
    def _look_for_node(self) -> None:
        now = time.monotonic()
        is_there = self._remote.is_there and now - self._last_heard < SILENCE
        if not is_there:
            self._remote.forget()
            self._is_described = False
        elif (not self._is_described or self._is_outdated) and now - self._asked >= PATIENCE:
            self._asked, self._is_outdated = now, False
            self._later(self._remote.describe)
        for part in (self._panel, self._scenes, self._film, self._keyboard):
            part.steerable(self._is_described)

    def described(self, descriptors: list[ParameterDescriptor], values: dict[str, Any]) -> None:
        """Build the panel from the parameters of the node."""
        self._is_described = True
        shown = [
            widgets.field(item, values[item.name])
            for item in descriptors
            if not item.read_only and item.type in widgets.TYPES
        ]
        self._names = [name for name in values.get('bodies', []) if name]
        obstacles = [name for name in values.get('obstacles', []) if name]
        self._panel.describe(shown, values, self._names, obstacles)
        self._colors = {name: _rgba(values.get(f'{name}.color')) for name in self._names}
        self._plots.time_scale = values.get('time_scale', 1.0)
        self._draw()

    def changed(self, name: str, value: Any) -> None:
        """Display the value of a parameter."""
        self._panel.show(name, value)
        body, _, rest = name.partition('.')
        if rest == 'color' and body in self._names:
            self._colors[body] = _rgba(value)
            self._draw()
        if name == 'time_scale':
            self._plots.time_scale = value
        # other parameters come and go with them
        self._is_outdated |= name in ('bodies', 'obstacles')

    def refused(self, name: str, reason: str) -> None:
        """Display why the node has rejected a value."""
        self._notify(f'{name} stays as it is', reason, 'red')

    def _notify(self, title: str, text: str, color: Any) -> None:
        for client in self._server.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=10.0, color=color)

    # ------------------------------------------------------------------------- actions on the page
    def _change(self, field: Field, value: Any) -> None:
        try:
            self._remote.set(field.name, field.type, widgets.from_widget(field, value))
        except widgets.FieldError as error:
            self.refused(field.name, str(error))
            self._panel.restore(field.name)

    def _act(self, action: str) -> None:
        if action == 'pause':
            future = self._pause.call_async(SetBool.Request(data=not self._panel.is_paused))
        else:
            future = self._triggers[action].call_async(Trigger.Request())
        future.add_done_callback(lambda done: self._acted(action, done))

    def _acted(self, action: str, future: Future) -> None:
        answer = future.result()
        if not answer.success:
            self._notify(f'no {action}'.replace('_', ' '), answer.message, 'red')
        elif action == 'pause':
            self._last_answer = time.monotonic()
            self._panel.paused(answer.message.startswith('paused'))

    def _expect_scene(self, is_coming: bool) -> None:
        """Look at the bodies that come, or no longer."""
        self._is_other_scene = is_coming

    async def _reset(self) -> None:
        await self._triggers['reset'].call_async(Trigger.Request())

    def _count_vertices(self) -> int:
        return 0 if self._picture is None else len(self._picture.surface.vertices)

    def close(self) -> None:
        """End what the page has started, and remove its files."""
        self._film.close()
        self._scenes.close()

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        origin, direction = np.array(event.ray_origin), np.array(event.ray_direction)
        self._later(lambda: self._poke_along(origin, direction))

    def _poke_along(self, origin: np.ndarray, direction: np.ndarray) -> None:
        if self._frame is None or self._picture is None:
            return
        shown, surface = self._picture.of(self._frame), self._picture.surface
        if not surface.fits(shown):
            return
        point = decoding.first_hit(origin, direction, shown.positions, surface.faces)
        if point is None:
            return
        message = PointStamped()
        message.header.frame_id = self._frame.frame_id
        message.point.x, message.point.y, message.point.z = (float(item) for item in point)
        self._poke.publish(message)


def _palette(index: int) -> Color:
    red, green, blue = decoding.PALETTE[index % len(decoding.PALETTE)]
    return red, green, blue, 255


def _rgba(color: Any) -> Color:
    if color is None or len(color) != 4:
        return _palette(0)
    red, green, blue, alpha = decoding.to_bytes(color)
    return red, green, blue, alpha


def run(options: argparse.Namespace, ros_arguments: list[str], stop: threading.Event) -> int:
    """Serve until `stop` is set; an unusable address is one sentence and exit code 1."""
    try:
        server = PageServer(options.host, free_port(options.host, options.port))
    except OSError as error:
        print(
            f'viewer: {options.host} port {options.port} cannot be served at: {error.strerror}; '
            'choose another --host or --port',
            file=sys.stderr,
        )
        return 1
    node = None
    try:
        problem = start_ros(ros_arguments)
        node = Viewer(server, options.node, options.rate, options.shadows)
        if problem:
            node.get_logger().warning(problem)
        server.name_pages(f'{options.node} – softbody_ros')
        address = page_address(options.host, server.get_port())
        node.get_logger().info(f'open {address}; it shows {options.node}')
        spin(node, stop)
    except (ParameterException, RuntimeError) as error:
        print('viewer:', ' '.join(str(error).split()), file=sys.stderr)
        return 1
    finally:
        if node is not None:
            node.close()
        rclpy.try_shutdown()
        server.stop()
    return 0
