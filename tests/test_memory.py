# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Memory of the node under floods of requests: a process of its own, as the system counts it."""

import pathlib

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

SIM = '/softbody_sim'
LENGTH = 100_000
FINE = 10_242
"""Vertices of the ball."""


def resident_mebibytes(process):
    status = pathlib.Path(f'/proc/{process.pid}/status').read_text()
    (line,) = [line for line in status.splitlines() if line.startswith('RssAnon:')]
    return int(line.split()[1]) / 1024


def accepted_repeated(random):
    return random.integers(0, FINE, LENGTH)


def accepted_distinct(random):
    return random.permutation(FINE)[: FINE - 100]


def refused(random):
    return random.integers(FINE, 2**31, LENGTH)


@pytest.mark.parametrize(
    ('values', 'service'),
    [
        pytest.param(accepted_repeated, SetParameters, marks=pytest.mark.slow),
        (accepted_distinct, SetParametersAtomically),
        (refused, SetParameters),
        pytest.param(refused, SetParametersAtomically, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize(
    ('first', 'last'), [(30, 90), pytest.param(200, 2000, marks=pytest.mark.slow)]
)
def test_a_flood_of_long_lists_leaves_nothing_behind(graph, values, service, first, last):
    """The history keeps what was set, within its budget; a request takes 0.8 MB and more."""
    process = graph.process(
        '--ros-args', '-p', 'ball.subdivisions:=5', '-p', 'history.memory:=1.0',
        '-p', 'time_scale:=0.0',
    )  # fmt: skip
    is_atomic = service is SetParametersAtomically
    name = f'{SIM}/set_parameters' + ('_atomically' if is_atomic else '')
    client = graph.node.create_client(service, name)
    graph.spin_until(client.service_is_ready)
    random = np.random.default_rng(0)
    taken = {}
    for index in range(last + 1):
        if index in (first, last):
            taken[index] = resident_mebibytes(process)
        value = ParameterValue(type=7, integer_array_value=values(random).tolist())
        sent = [Parameter(name='ball.pins.indices', value=value)]
        future = client.call_async(service.Request(parameters=sent))
        graph.spin_until(future.done)
        answer = future.result().result if is_atomic else future.result().results[0]
        assert answer.successful == (values is not refused), answer.reason
    assert taken[last] - taken[first] < 16.0
