# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Asynchronous client of the parameters of another node."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
import time
from typing import Any, Protocol

from rcl_interfaces.msg import (
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    ParameterValue,
)
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

PATIENCE = 2.0
"""Seconds after which an unanswered request is repeated."""


class Listener(Protocol):
    """Callbacks for the parameters of the other node."""

    def described(self, descriptors: list[ParameterDescriptor], values: dict[str, Any]) -> None:
        """Receive all parameters of the node."""

    def changed(self, name: str, value: Any) -> None:
        """Receive the value of a parameter."""

    def refused(self, name: str, reason: str) -> None:
        """Receive the reason why the node rejected a value."""


class Remote:
    """
    Client of one other node, which may come and go: `forget` drops pending requests.

    While a request is pending only the newest value for a parameter is queued.
    """

    def __init__(self, node: Node, name: str, listener: Listener) -> None:
        self._name, self._listener = name, listener
        self._client = AsyncParameterClient(node, name)
        self._types: dict[str, int] = {}
        self._values: dict[str, Any] = {}
        self._asking: dict[str, float] = {}
        self._wanted: dict[str, Parameter] = {}
        self._missed: set[str] = set()
        self._visit = 0
        node.create_subscription(ParameterEvent, '/parameter_events', self._heard, 100)

    @property
    def is_there(self) -> bool:
        """Whether its parameter services are available."""
        return self._client.services_are_ready()

    def forget(self) -> None:
        """Drop pending requests."""
        self._visit += 1
        self._asking.clear()
        self._wanted.clear()
        self._missed.clear()

    async def describe(self) -> None:
        """Request all parameters, and pass them to the listener."""
        self.forget()
        visit = self._visit
        names = list((await self._client.list_parameters()).result.names)
        descriptors = list((await self._client.describe_parameters(names)).descriptors)
        values = (await self._client.get_parameters(names)).values
        if visit != self._visit or not len(names) == len(descriptors) == len(values):
            return
        # what was removed between the requests has no value any more
        there = [
            (item, value)
            for item, value in zip(descriptors, values, strict=True)
            if value.type == item.type != ParameterType.PARAMETER_NOT_SET
        ]
        self._values = {item.name: parameter_value_to_python(value) for item, value in there}
        self._types = {item.name: item.type for item, _ in there}
        self._listener.described([item for item, _ in there], dict(self._values))

    async def read(self) -> dict[str, Any]:
        """Return all values as they are now, also of parameters that are not described yet."""
        names = list((await self._client.list_parameters()).result.names)
        values = (await self._client.get_parameters(names)).values
        pairs = zip(names, map(parameter_value_to_python, values), strict=False)
        return {name: value for name, value in pairs if value is not None}

    async def set_together(self, values: Mapping[str, Any]) -> str:
        """Set parameters in one request; return '', or why the node has refused all of it."""
        wanted = [Parameter(name, value=value) for name, value in values.items()]
        result = (await self._client.set_parameters_atomically(wanted)).result
        return '' if result.successful else result.reason

    def set(self, name: str, kind: int, value: Any) -> None:
        """Request a parameter to be set to a value of a `ParameterType`."""
        self._wanted[name] = Parameter(name, Parameter.Type(kind), value)
        if time.monotonic() - self._asking.get(name, -PATIENCE) >= PATIENCE:
            self._ask(name)

    def _ask(self, name: str) -> None:
        wanted = self._wanted.pop(name)
        self._asking[name] = time.monotonic()
        future = self._client.set_parameters([wanted])
        future.add_done_callback(partial(self._answered, self._visit, wanted))

    def _answered(self, visit: int, wanted: Parameter, future: Future) -> None:
        if visit != self._visit:
            return
        name = wanted.name
        self._asking.pop(name, None)
        result = future.result().results[0]
        if result.successful:
            self._values[name] = wanted.value
        if name in self._wanted:
            self._ask(name)
            return
        if not result.successful:
            self._listener.refused(name, result.reason)
        self._listener.changed(name, self._values[name])
        if name in self._missed:
            self._missed.remove(name)
            future = self._client.get_parameters([name])
            future.add_done_callback(partial(self._read, self._visit, name))

    def _read(self, visit: int, name: str, future: Future) -> None:
        if visit == self._visit and name not in self._busy:
            self._take(name, future.result().values[0])

    @property
    def _busy(self) -> frozenset[str]:
        """Parameters with pending requests: responses are newer than events received meanwhile."""
        return frozenset(self._asking) | frozenset(self._wanted)

    def _take(self, name: str, value: ParameterValue) -> None:
        if value.type == self._types.get(name):
            self._values[name] = parameter_value_to_python(value)
            self._listener.changed(name, self._values[name])

    def _heard(self, event: ParameterEvent) -> None:
        if event.node != self._name:
            return
        for item in [*event.new_parameters, *event.changed_parameters]:
            if item.name in self._busy:
                # the event may be of an older value, or of one set by another client since
                self._missed.add(item.name)
            else:
                self._take(item.name, item.value)
