# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node: parameters, topics and services around a stepped world."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockChange, ClockType, JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.event_handler import QoSPublisherMatchedInfo
from rclpy.exceptions import ParameterException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from softbody_ros.core import ConfigError, MeshError, RigidFit, SimulationError, World
from softbody_ros.core.shape_matching.gains import damping_ratio
from softbody_ros.core.warm_up import compile_ahead
from softbody_ros.ros import cli_help, interfaces, messages, simulation_interfaces_node
from softbody_ros.ros.body_frames import BodyFrames
from softbody_ros.ros.command_line import CommandLine
from softbody_ros.ros.contact_topics import ContactTopics
from softbody_ros.ros.frames import Frames, tf_lookup
from softbody_ros.ros.obstacle_markers import ObstacleMarkers
from softbody_ros.ros.parameter_services import ParameterServices
from softbody_ros.ros.publishers import Publishers, create_publisher
from softbody_ros.ros.robot import RobotLinks
from softbody_ros.ros.scene_parameters import SceneParameters
from softbody_ros.ros.simulation_interfaces import MOST_STEPS, Simulation
from softbody_ros.ros.spinning import spin
from softbody_ros.ros.start import NO_LOG_FILE, start_ros
from softbody_ros.ros.subscribers import InputTopics
from softbody_ros.ros.viewer_process import viewer_of
from softbody_ros.scene.parameters import Scene
from softbody_ros.scene.robot import Robot
from softbody_ros.startup import without_garbage_collection
from softbody_ros.timeline.stepper import MEBIBYTE, Stepper

SHORTEST_PERIOD = 0.004
"""Shortest period of the timer that reads the clock, s: a call costs rclpy about 0.1 ms."""


class SimNode(Node):
    """
    Connects parameters, clock, world and messages; contains no physics.

    Raises
    ------
    ConfigError, MeshError
        if the parameters do not describe a scene; with the reason in one sentence.

    """

    NAME = 'softbody_sim'

    def __init__(self, **node_arguments: Any) -> None:
        # names of parameters are checked by the scene
        super().__init__(
            self.NAME,
            allow_undeclared_parameters=True,
            start_parameter_services=False,
            **node_arguments,
        )
        self._parameter_services = ParameterServices(self)
        self._parameters_of_scene = SceneParameters(self)
        self._world = World(self._scene.world)
        self._stepper = Stepper(self._world, {})
        self._failure = ''
        self._jumped_back = self._clock_changed = False
        self._first_clock = 0
        self._paused_before_failure = False
        self._after_slice: Future | None = None
        self._publish_seconds = 0.0

        self._numbers: dict[str, int] = {}
        self._notes: tuple[str, ...] = ()
        self._robot: RobotLinks | None = None
        self._parameters_of_scene.offer(
            self._stepper,
            self._use_parameters,
            lambda: self._robot.names if self._robot is not None else (),
        )
        self._use_parameters()
        self._create_publishers()
        self._create_services()
        self._frames = Frames(self._frame_id, lambda: tf_lookup(self, self._frame_id))
        self._inputs = InputTopics(self, self._stepper, lambda: self._scene.node, self._frames)
        self._gravity_source = self._inputs.gravity_source
        self._robot = RobotLinks(
            self._stepper,
            lambda: self._scene.node,
            self._inputs.warn,
            self._use_links,
            self._frames.lookup,
        )
        self._hears_robot = False
        self._configure_robot(self._robot)
        self._describe_bodies(0)
        self._obstacle_markers = ObstacleMarkers(self, self._stepper, self._frame_id)
        self._world.load_kernels()
        self._start_clocks()
        self._announce()

    # -------------------------------------------------------------------------------- parameters
    @property
    def _scene(self) -> Scene:
        return self._parameters_of_scene.scene

    def _use_parameters(self) -> None:
        """Use the settings of the node, and number new bodies: a name keeps its number."""
        for body in self._scene.world.bodies:
            self._numbers.setdefault(body.name, len(self._numbers))
        settings = self._scene.node
        self._stepper.history.memory = settings.history_memory * MEBIBYTE
        self._stepper.set_time_scale(settings.time_scale, self._now())
        self._stepper.rates = {'points': settings.points_rate, 'mesh': settings.mesh_rate}
        if self._robot is not None:
            self._configure_robot(self._robot)
        self._say_notes()

    def _say_notes(self) -> None:
        """Say what is to be known about the meshes of new bodies and obstacles."""
        before, self._notes = self._notes, self._world.notes
        for note in self._notes:
            if note not in before:
                self.get_logger().warning(note)

    def _configure_robot(self, robot: RobotLinks) -> None:
        if self._scene.node.robot_links and not self._hears_robot:
            self._hears_robot = True
            self._inputs.listen(interfaces.ROBOT_DESCRIPTION, robot.describe)
            self._inputs.listen(interfaces.JOINT_STATES, robot.note_joints, polled=True)
        robot.configure()

    def _use_links(self, robot: Robot | None) -> None:
        links = robot.links if robot is not None else ()
        self._contacts.use_links(links)

    # -------------------------------------------------------------------------------- interfaces
    def _create_publishers(self) -> None:
        count = len(self._world.names)
        self._outputs = Publishers(self, self._on_match)
        self._points = self._outputs.make(interfaces.POINTS)
        self._mesh = self._outputs.for_each(interfaces.MESH, count)
        self._odometry = self._outputs.for_each(interfaces.ODOMETRY, count)
        self._contacts = ContactTopics(self._world, self._outputs)
        self._body_frames = BodyFrames(self)
        self._diagnostics = create_publisher(self, interfaces.DIAGNOSTICS)
        self._rest_mesh = create_publisher(self, interfaces.REST_MESH)
        self._visual_mesh = create_publisher(self, interfaces.VISUAL_MESH)
        self._described: tuple[str, ...] = ()

    def _create_services(self) -> None:
        # it awaits steps taken by the timer, whose group it must not block
        group = ReentrantCallbackGroup()
        for service, answer, own_group in (
            (interfaces.RESET, self._reset, None),
            (interfaces.APPLY_INITIAL_VELOCITY, self._apply_initial_velocity, None),
            (interfaces.PAUSE, self._pause, None),
            (interfaces.STEP, self._step, group),
        ):
            self.create_service(service.kind, service.name, answer, callback_group=own_group)
        simulation = Simulation(
            self._stepper, self._parameters_of_scene, self._paused, self._restarted, self._stepped
        )
        simulation_interfaces_node.offer(self, simulation, self._frame_id, self._stamp)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._restarted()
        response.success, response.message = True, 'the bodies are back at their start'
        return response

    def _restarted(self) -> None:
        """Reset the bodies; resume if a failure had paused the simulation."""
        self._stepper.reset(self._now())
        self._parameters_of_scene.follow()
        if self._failure:
            self._failure = ''
            self._stepper.pause(self._paused_before_failure, self._now())

    def _apply_initial_velocity(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        self._stepper.act(World.apply_initial_velocity)
        response.success, response.message = True, 'the bodies have their initial velocities'
        return response

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.message = self._paused(request.data)
        response.success = not response.message
        if response.success:
            state = 'paused' if request.data else 'running'
            response.message = f'{state} at tick {self._world.tick}'
        return response

    def _paused(self, paused: bool) -> str:
        """Pause or resume; return the reason if that is refused, or ''."""
        if self._failure and not paused:
            return self._until_reset()
        self._stepper.pause(paused, self._now())
        return ''

    def _until_reset(self) -> str:
        return f'the simulation has stopped ({self._failure}): call ~/reset'

    async def _step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._stepper.paused:
            response.success = False
            response.message = 'the simulation is running: call ~/pause with data true first'
            return response
        failure = await self._stepped(self._scene.node.step_count)
        response.success = not failure
        response.message = failure or f'now at tick {self._world.tick}'
        return response

    async def _stepped(self, ticks: int) -> str:
        """Take ticks while paused; return the reason if they are not all taken, or ''."""
        if self._failure:
            return self._until_reset()
        waiting = self._stepper.steps_left
        if waiting + ticks > MOST_STEPS:
            return (
                f'{waiting} steps are still to be taken, and {ticks} more would be above '
                f'{MOST_STEPS}: wait until they are answered, or call ~/reset'
            )
        request = self._stepper.single_step(ticks)
        while request.waits:
            self._after_slice = self._after_slice or Future(executor=self.executor)
            await self._after_slice
        return request.failure

    # -------------------------------------------------------------------------------------- time
    def _start_clocks(self) -> None:
        self._counted = _Counters(time.perf_counter(), 0, 0.0, 0.0, 0.0, 0, 0, 0)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        # one timer for wall time and /clock: it reads the clock of the node
        period = max(self._world.config.time_step, SHORTEST_PERIOD)
        self.create_timer(period, self._drive, clock=steady)
        self.create_timer(1.0, self._report, clock=steady)
        threshold = JumpThreshold(
            min_forward=Duration(nanoseconds=1),
            min_backward=Duration(nanoseconds=-1),
            on_clock_change=True,
        )
        # C keeps only a pointer to the handle
        self._jump_handle = self.get_clock().create_jump_callback(
            threshold, post_callback=self._on_jump
        )

    def _on_jump(self, jump: TimeJump) -> None:
        # called while the clock is being set: only set flags
        if jump.clock_change in (
            ClockChange.ROS_TIME_ACTIVATED,
            ClockChange.ROS_TIME_DEACTIVATED,
        ):
            self._clock_changed = True
        elif jump.delta.nanoseconds < 0:
            self._jumped_back = True
        elif not self._first_clock:
            # the first jump of /clock is the one from 0: the simulation begins there, however late
            # the timer reads it
            self._first_clock = jump.delta.nanoseconds

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds

    def _stamp(self) -> int:
        """Return the clock's time of the present state, ns."""
        return self._stepper.time_of(self._world.tick)

    def _follows_clock(self) -> bool:
        clock = self.get_clock()
        return isinstance(clock, ROSClock) and clock.ros_time_is_active

    def _waits_for_clock(self) -> bool:
        return self._follows_clock() and self._now() == 0

    def _drive(self) -> None:
        self._parameters_of_scene.settle()
        self._inputs.poll()
        if self._robot is not None:
            self._robot.update()
        self._advance()
        self._parameters_of_scene.follow()
        self._contacts.update()
        self._obstacle_markers.update(due=False)

    def _advance(self) -> None:
        if self._stepper.stepping:
            self._take_steps()
        # also after steps that have been ended: who has requested them waits
        waiting, self._after_slice = self._after_slice, None
        if waiting is not None:
            waiting.set_result(None)
        if self._waits_for_clock():
            return
        now, follows_clock = self._now(), self._follows_clock()
        if follows_clock and self._first_clock and not self._stepper.started:
            self._stepper.reanchor(min(self._first_clock, now))
        if self._clock_changed:
            self._stepper.switch_clock(now)
        elif self._jumped_back and follows_clock:
            self._stepper.rewind(now)
            self.get_logger().info(
                f'/clock went back: so do the bodies, from {self._world.time:g} s'
            )
        elif not follows_clock and self._stepper.lag(now) < 0.0:
            self._stepper.reanchor(now)  # the system clock was set back
        self._clock_changed = self._jumped_back = False
        try:
            for outputs in self._stepper.advance(now, drop_overload=not follows_clock):
                self._publish(outputs)
        except SimulationError as error:
            self._stop(error)

    def _take_steps(self) -> None:
        """Take a slice of the steps that services await."""
        try:
            self._stepper.take_steps(self._now())
        except SimulationError as error:
            self._stop(error)

    def _stop(self, error: SimulationError) -> None:
        """Pause at the last good state until ~/reset, and log the reason."""
        if not self._failure:
            self._paused_before_failure = self._stepper.paused
        self._failure = str(error)
        self.get_logger().error(f'{error}; call ~/reset to go on')
        self._stepper.pause(True, self._now())

    # ----------------------------------------------------------------------------------- outputs
    def _on_match(self, info: QoSPublisherMatchedInfo) -> None:
        """Publish the state to a new subscriber if the next output may be long in coming."""
        is_new = info.current_count_change > 0
        if is_new and (self._stepper.paused or self._follows_clock()):
            self._stepper.publish_now()

    def _publish(self, outputs: set[str]) -> None:
        """Publish the outputs that are due; nothing is packed for topics without subscribers."""
        begin = time.perf_counter()
        stamp = self._stamp()
        self._parameters_of_scene.follow()
        if self._world.rebuilds != self._described_rebuilds:
            self._describe_bodies(stamp)
        fit = cache(self._world.rigid_fit)
        positions = cache(self._world.positions)
        if 'points' in outputs and self._points.get_subscription_count():
            self._publish_points(stamp, positions, fit)
        if 'points' in outputs and self._odometry.get_subscription_count():
            for name in self._world.names:
                self._odometry.publish(messages.odometry(stamp, self._frame_id, name, fit(name)))
        if 'points' in outputs and self._scene.node.publish_tf:
            self._body_frames.publish(stamp, self._frame_id, self._world.names, fit)
        if 'points' in outputs:
            self._contacts.publish(stamp, self._frame_id)
        if 'mesh' in outputs and self._mesh.get_subscription_count():
            self._publish_mesh(stamp, positions)
        if 'mesh' in outputs:
            self._obstacle_markers.update(due=True)
        self._publish_seconds += time.perf_counter() - begin

    def _publish_points(
        self,
        stamp: int,
        positions: Callable[[str], np.ndarray],
        fit: Callable[[str], RigidFit],
    ) -> None:
        records = messages.points_array(
            [
                (
                    positions(name),
                    fit(name).displacement,
                    self._world.pressure(name),
                    self._world.permanent_strains(name),
                )
                for name in self._world.names
            ],
            [self._numbers[name] for name in self._world.names],
        )
        self._points.publish(messages.serialized_cloud(stamp, self._frame_id, records))

    def _publish_mesh(self, stamp: int, positions: Callable[[str], np.ndarray]) -> None:
        for name in self._world.names:
            vertices = self._world.visual_positions(name, positions(name))
            faces = self._world.visual_surface(name).faces
            # several times faster than fancy indexing
            corners = vertices.take(faces.reshape(-1), axis=0)
            color = self._scene.appearances[name].color
            self._mesh.publish(
                messages.serialized_marker(stamp, self._frame_id, name, color, corners)
            )

    def _describe_bodies(self, stamp: int) -> None:
        """Say which bodies there are: delete the markers of the gone, publish the rest mesh."""
        names, count = self._world.names, max(len(self._world.names), len(self._described))
        self._mesh = self._outputs.deepened(self._mesh, interfaces.MESH, count)
        self._odometry = self._outputs.deepened(self._odometry, interfaces.ODOMETRY, count)
        if self._mesh.get_subscription_count():
            for name in self._described:
                if name not in names:
                    self._mesh.publish(messages.deletion(stamp, self._frame_id, name))
        vertices, faces, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
        for name in names:
            vertices.append(self._world.start_positions(name))
            faces.append(self._world.rest_shape(name).surface.faces + first)
            first += len(vertices[-1])
        self._visual_mesh.publish(
            messages.serialized_surfaces(
                stamp,
                self._frame_id,
                [
                    messages.ShownSurface(
                        name,
                        self._numbers[name],
                        self._scene.appearances[name].color,
                        self._world.visual_start_positions(name).take(
                            self._world.visual_surface(name).faces.reshape(-1), axis=0
                        ),
                    )
                    for name in names
                    if self._world.embedding(name) is not None
                ],
            )
        )
        self._rest_mesh.publish(
            messages.serialized_mesh(np.concatenate(vertices), np.concatenate(faces))
        )
        self._described, self._described_rebuilds = names, self._world.rebuilds

    @property
    def _frame_id(self) -> str:
        return self._scene.node.frame_id

    # ------------------------------------------------------------------------------- diagnostics
    def _state(self) -> tuple[bytes, str]:
        if self._failure:
            return DiagnosticStatus.ERROR, f'stopped: {self._failure}'
        if self._waits_for_clock():
            return DiagnosticStatus.WARN, 'waiting for /clock'
        if self._stepper.paused:
            return DiagnosticStatus.OK, 'paused'
        return DiagnosticStatus.OK, 'running'

    def _report(self) -> None:
        """Publish the diagnostics of the second since the last report."""
        now = _Counters(
            time.perf_counter(),
            self._world.tick,
            self._stepper.busy,
            self._publish_seconds,
            self._stepper.dropped,
            *self._world.solver_work,
        )
        last, self._counted = self._counted, now
        level, summary = self._state()
        if self._waits_for_clock():
            self.get_logger().warning(
                'use_sim_time is true, but nothing is received on /clock: start its publisher, '
                'or set use_sim_time to false',
                throttle_duration_sec=10.0,
            )
        seconds = now.wall - last.wall
        ticks = max(now.tick - last.tick, 0)
        dropped = now.dropped - last.dropped

        def per_tick(counted: int, before: int) -> float:
            return max(counted - before, 0) / max(ticks, 1)

        if dropped > 0.0:
            level = max(level, DiagnosticStatus.WARN)
            summary += f', too slow: {dropped / seconds:.0%} of the time dropped'
        values = {
            'real-time factor': f'{ticks * self._world.config.time_step / seconds:.3f}',
            'step time (ms)': f'{1e3 * (now.busy - last.busy) / max(ticks, 1):.3f}',
            'publish time (ms/s)': f'{1e3 * (now.publishing - last.publishing) / seconds:.3f}',
            'dropped time (s)': f'{now.dropped:.3f}',
            'lag behind the clock (s)': f'{self._stepper.lag(self._now()):.3f}',
            'history (MiB)': f'{self._stepper.history.nbytes / MEBIBYTE:.1f}',
            'contact solver sweeps (1/tick)': f'{per_tick(now.sweeps, last.sweeps):.1f}',
            'contact solver Newton steps (1/tick)': f'{per_tick(now.newton, last.newton):.1f}',
            'contact problems not solved to tolerance': str(max(now.unsolved - last.unsolved, 0)),
            'tick': str(now.tick),
            'simulated time (s)': f'{self._world.time:.3f}',
        }
        self._inputs.hear_everyone()
        values |= self._inputs.report()
        if self._robot is not None:
            values |= self._robot.report()
        if self._gravity_source != self._inputs.gravity_source:
            self._gravity_source = self._inputs.gravity_source
            self.get_logger().info(
                f'gravity is now {values["gravity (m/s²)"]} m/s², from {self._gravity_source}'
            )
        for body in self._world.config.bodies:
            values[body.name + messages.NUMBER_IN_POINTS] = str(self._numbers[body.name])
            material = self._world.material(body.name)
            values[f'{body.name} frequency (Hz)'] = f'{material.frequency / (2 * np.pi):.3f}'
            values[f'{body.name} material'] = messages.material_text(
                material, body.mode, self._world.config.reference_step
            )
            values[f'{body.name} asleep'] = str(self._world.is_asleep(body.name)).lower()
            values[f'{body.name} damping ratio'] = f'{damping_ratio(body.bounciness):.3f}'
            strain = self._world.permanent_strain(body.name)
            values[f'{body.name} permanent strain'] = f'{strain:.4f}'
        self._diagnostics.publish(
            messages.diagnostics(
                self._now(), self.get_fully_qualified_name(), level, summary, values
            )
        )

    def _announce(self) -> None:
        rests = {name: self._world.rest_shape(name) for name in self._world.names}
        self.get_logger().info(
            cli_help.where_to_look(
                self.get_fully_qualified_name(),
                '/clock' if self._follows_clock() else 'wall time',
                {name: rest.surface_count for name, rest in rests.items()},
                (self._points.topic_name, self._mesh.topic_name),
            )
        )


@dataclass(frozen=True)
class _Counters:
    """Counters from whose differences the diagnostics are computed."""

    wall: float
    tick: int
    busy: float
    publishing: float
    dropped: float
    # of contacts, since bodies were last added or removed
    sweeps: int
    newton: int
    unsolved: int


def run(command: CommandLine, stop: threading.Event) -> int:
    """Run the node until `stop` is set; an invalid scene is one sentence and exit code 1."""
    logger = get_logger(SimNode.NAME)
    try:
        problem = start_ros(command.for_ros)
        if problem:
            logger.warning(problem)
        # before the node exists: once discovered, it must answer at once
        if not compile_ahead(logger.info, logger.warning, stop.is_set):
            rclpy.try_shutdown()
            return 0
        with without_garbage_collection():
            node = SimNode()
    except (ConfigError, MeshError, ParameterException, RuntimeError) as error:
        rclpy.try_shutdown()
        print('softbody_sim:', ' '.join(str(error).split()), file=sys.stderr)
        return 1
    viewer: AbstractContextManager = nullcontext()
    if command.for_viewer is not None:
        arguments = command.for_viewer
        if problem:  # said once
            arguments = (*arguments, '--ros-args', NO_LOG_FILE)
        name = node.get_fully_qualified_name()
        viewer = viewer_of(name, arguments, stop, logger.warning)
    with viewer:
        try:
            spin(node, stop)
        finally:
            rclpy.try_shutdown()
    return 0
