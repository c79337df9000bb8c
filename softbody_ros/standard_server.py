# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The services of simulation_interfaces on a node: messages in, `standard_services`, messages out.

Offered where that package is importable; it is part of ROS Jazzy but not on PyPI.
"""

from __future__ import annotations

from collections.abc import Callable
import importlib
import types
from typing import Any

from rclpy.node import Node

from softbody_ros import messages
from softbody_ros.standard_services import (
    FEATURES,
    OPERATION_FAILED,
    Outcome,
    Simulation,
    features,
)

PACKAGE = 'simulation_interfaces.srv'


def interfaces() -> types.ModuleType | None:
    """Return the package's services, or None where it is not installed."""
    try:
        return importlib.import_module(PACKAGE)
    except ImportError:
        return None


def offer(
    node: Node, simulation: Simulation, frame_id: str, stamp: Callable[[], int]
) -> list[str]:
    """
    Create the services on a node, where the package is installed.

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
    srv = interfaces()
    if srv is None:
        node.get_logger().debug(
            'simulation_interfaces is not installed: its services are left out'
        )
        return []
    server = _Server(simulation, frame_id, node.get_clock, stamp)
    for name in FEATURES:
        kind = getattr(srv, ''.join(word.capitalize() for word in name.split('_')))
        node.create_service(kind, f'~/{name}', getattr(server, name))
    return list(FEATURES)


class _Server:
    """One method for each service: from the request to the response."""

    def __init__(
        self,
        simulation: Simulation,
        frame_id: str,
        clock: Callable[[], Any],
        stamp: Callable[[], int],
    ) -> None:
        self._simulation = simulation
        self._frame_id = frame_id
        self._clock, self._stamp = clock, stamp

    def get_simulator_features(self, _: Any, response: Any) -> Any:
        response.features.features = features(FEATURES)
        response.features.custom_info = 'softbody_ros: entities are soft bodies'
        return response

    def reset_simulation(self, request: Any, response: Any) -> Any:
        return _with(response, self._simulation.reset(request.scope))

    def get_simulation_state(self, _: Any, response: Any) -> Any:
        response.state.state = self._simulation.state
        return _with(response, Outcome())

    def set_simulation_state(self, request: Any, response: Any) -> Any:
        return _with(response, self._simulation.set_state(request.state.state))

    def step_simulation(self, request: Any, response: Any) -> Any:
        now = self._clock().now().nanoseconds
        return _with(response, self._simulation.step(request.steps, now))

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
        if request.set_pose:
            position, orientation = state.pose.position, state.pose.orientation
            pose = (
                (position.x, position.y, position.z),
                (orientation.x, orientation.y, orientation.z, orientation.w),
            )
        if request.set_twist:
            linear, angular = state.twist.linear, state.twist.angular
            twist = (linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z)
        return _with(response, self._simulation.set_entity_state(request.entity, pose, twist))


def _with(response: Any, outcome: Outcome) -> Any:
    response.result.result, response.result.error_message = outcome.code, outcome.message
    return response
