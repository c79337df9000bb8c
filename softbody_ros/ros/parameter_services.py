# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameter services that answer every request: those of rclpy leave some without an answer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

from softbody_ros.core.config import shown

LAST_TYPE = ParameterType.PARAMETER_STRING_ARRAY


class ParameterServices(ParameterService):
    """
    The parameter services of a node that allows undeclared parameters and has none of rclpy's.

    A client waits for ever if a callback raises. So do those of rclpy for a value of a type that
    does not exist, of which the values before are set then, and for the type of a parameter that
    is not there.
    """

    # rclpy has no public way to answer otherwise
    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        node = self._get_node()
        response.results = [_set(node, [each]) for each in request.parameters]
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = _set(self._get_node(), request.parameters)
        return response

    def _get_parameter_types_callback(self, request: Any, response: Any) -> Any:
        node = self._get_node()
        response.types = [
            node.get_parameter_type(name)
            if node.has_parameter(name)
            else ParameterType.PARAMETER_NOT_SET
            for name in request.names
        ]
        return response


def _parameter(message: Any) -> Parameter:
    if message.value.type > LAST_TYPE:
        raise ValueError(
            f'the value of {shown(message.name)[1:-1]} has the type {message.value.type}: types '
            f'are from 0 to {LAST_TYPE}, see rcl_interfaces/msg/ParameterType'
        )
    return Parameter.from_parameter_msg(message)


def _set(node: Node, messages: Iterable[Any]) -> SetParametersResult:
    """Set parameters in one go; return the result, or why there is none."""
    try:
        return node.set_parameters_atomically([_parameter(message) for message in messages])
    except ValueError as error:
        return SetParametersResult(successful=False, reason=str(error))
    except Exception as error:
        reason = f'the request failed: {type(error).__name__}: {shown(str(error))}'
        node.get_logger().error(reason, throttle_duration_sec=1.0)
        return SetParametersResult(successful=False, reason=reason)
