# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Services of simulation_interfaces on a node: messages to and from `simulation_interfaces`.

Offered if that package can be imported; it is part of ROS Jazzy but not on PyPI.
"""

from __future__ import annotations

from collections.abc import Callable
import importlib
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.type_support import check_for_type_support

from softbody_ros.ros import messages
from softbody_ros.ros.interfaces import STANDARD_SERVICES
from softbody_ros.ros.simulation_interfaces import (
    ENTITIES_SPAWN_FAILED,
    OF_LATER_VERSIONS,
    OK,
    OPERATION_FAILED,
    Outcome,
    Simulation,
    features,
)
from softbody_ros.scene.resources import FORMATS, Pose

PACKAGE = 'simulation_interfaces.srv'


def interfaces(node: Node) -> dict[str, type]:
    """Return the types of the offered services by name; none if the package is not usable."""
    try:
        module = importlib.import_module(PACKAGE)
        kinds = {
            service.name.removeprefix('~/'): service.kind
            for service in STANDARD_SERVICES
            if service.name.removeprefix('~/') not in OF_LATER_VERSIONS
            or hasattr(module, service.short_type)
        }
        for kind in kinds.values():
            check_for_type_support(kind)
    except ImportError:
        node.get_logger().debug('simulation_interfaces is not installed: no such services')
        return {}
    except Exception as error:  # a broken installation raises what it likes
        node.get_logger().warning(f'simulation_interfaces cannot be used and is left out: {error}')
        return {}
    return kinds


def offer(
    node: Node,
    simulation: Simulation,
    frame_id: str,
    stamp: Callable[[], int],
) -> list[str]:
    """
    Create the services on a node, if the package is installed.

    Parameters
    ----------
    node : Node
    simulation : Simulation
    frame_id : str
        the frame of all poses and twists
    stamp : callable
        the clock's time of the present state, ns

    Returns
    -------
    list of str
        names of the services, none without the package

    """
    kinds = interfaces(node)
    server = _Server(simulation, frame_id, stamp, list(kinds))
    for name, kind in kinds.items():
        if name == 'step_simulation':
            # it awaits steps taken by the timer, whose group it must not block
            group = ReentrantCallbackGroup()
            node.create_service(kind, f'~/{name}', server.step_simulation, callback_group=group)
        else:
            node.create_service(kind, f'~/{name}', server.answer(name))
    return list(kinds)


class _Server:
    """Handlers, one for each service, from request to response."""

    def __init__(
        self,
        simulation: Simulation,
        frame_id: str,
        stamp: Callable[[], int],
        names: list[str],
    ) -> None:
        self._simulation = simulation
        self._frame_id = frame_id
        self._names = names
        self._stamp = stamp

    def answer(self, name: str) -> Callable[[Any, Any], Any]:
        """Return the handler of a service that answers errors too: clients would wait for ever."""
        handler = getattr(self, name)

        def answered(request: Any, response: Any) -> Any:
            try:
                return handler(request, response)
            except Exception as error:
                reason = f'{name} failed: {type(error).__name__}: {error}'
                return _with(response, Outcome(OPERATION_FAILED, reason))

        return answered

    async def step_simulation(self, request: Any, response: Any) -> Any:
        return _with(response, await self._simulation.step(request.steps))

    def get_simulator_features(self, _: Any, response: Any) -> Any:
        response.features.features = features(self._names)
        response.features.spawn_formats = list(FORMATS)
        response.features.custom_info = 'softbody_ros: entities are soft bodies'
        return response

    def reset_simulation(self, request: Any, response: Any) -> Any:
        return _with(response, self._simulation.reset(request.scope))

    def get_simulation_state(self, _: Any, response: Any) -> Any:
        response.state.state = self._simulation.state
        return _with(response, Outcome())

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        return _with(response, self._simulation.set_state(request.state.state))

    def get_entities(self, request: Any, response: Any) -> Any:
        filters = request.filters
        outcome, response.entities = self._simulation.entities(
            filters.filter,
            len(filters.categories),
            len(filters.tags.tags),
            filters.bounds.type,
            [(point.x, point.y, point.z) for point in filters.bounds.points],
        )
        return _with(response, outcome)

    def spawn_entity(self, request: Any, response: Any) -> Any:
        outcome, response.entity_name = self._spawned(request)
        return _with(response, outcome)

    def spawn_entities(self, request: Any, response: Any) -> Any:
        result = importlib.import_module('simulation_interfaces.msg').SpawnResult
        outcomes = []
        for each in request.spawn_requests:
            outcome, name = self._spawned(each)
            outcomes.append(outcome)
            response.results.append(_with(result(entity_name=name), outcome))
        failed = [outcome.message for outcome in outcomes if outcome.code != OK]
        if not failed:
            return _with(response, Outcome())
        reason = f'{len(failed)} of {len(outcomes)} are not there: {failed[0]}'
        return _with(response, Outcome(ENTITIES_SPAWN_FAILED, reason))

    def _spawned(self, request: Any) -> tuple[Outcome, str]:
        frame_id = request.initial_pose.header.frame_id
        if frame_id not in ('', self._frame_id):
            reason = f'frame_id is {frame_id!r}: poses are given in {self._frame_id!r}'
            return Outcome(OPERATION_FAILED, reason), ''
        # of the service in version 1 these are fields of its own
        resource = getattr(request, 'entity_resource', request)
        return self._simulation.spawn(
            request.name,
            request.allow_renaming,
            resource.uri,
            resource.resource_string,
            request.entity_namespace,
            _pose(request.initial_pose.pose),
        )

    def delete_entity(self, request: Any, response: Any) -> Any:
        return _with(response, self._simulation.delete(request.entity))

    def get_entity_state(self, request: Any, response: Any) -> Any:
        outcome, fit = self._simulation.entity_state(request.entity)
        if fit is not None:
            messages.fill_entity_state(response.state, self._stamp(), self._frame_id, fit)
        return _with(response, outcome)

    def set_entity_state(self, request: Any, response: Any) -> Any:
        state = request.state
        frame_id = state.header.frame_id
        if frame_id not in ('', self._frame_id):
            reason = f'frame_id is {frame_id!r}: poses and twists are given in {self._frame_id!r}'
            return _with(response, Outcome(OPERATION_FAILED, reason))
        pose = twist = None
        # versions before 2 always set both
        if getattr(request, 'set_pose', True):
            pose = _pose(state.pose)
        if getattr(request, 'set_twist', True):
            linear, angular = state.twist.linear, state.twist.angular
            twist = (linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z)
        return _with(response, self._simulation.set_entity_state(request.entity, pose, twist))


def _pose(pose: Any) -> Pose:
    position, orientation = pose.position, pose.orientation
    return (position.x, position.y, position.z), (
        orientation.x,
        orientation.y,
        orientation.z,
        orientation.w,
    )


def _with(response: Any, outcome: Outcome) -> Any:
    response.result.result, response.result.error_message = outcome.code, outcome.message
    return response
