# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Requests to the parameter services: each is answered, and done whole or not at all."""

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from std_srvs.srv import Trigger

from softbody_ros.ros import scene_parameters
from softbody_ros.scene import parameters

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
UNKNOWN_TYPES = [10, 77, 255]
NAMES = ['', '.', 'ball', '.mass', 'ball..mass', 'a\nb', '球.mass', 'x' * 100_000, 'nobody.mass']


def double(name, value):
    kind = ParameterType.PARAMETER_DOUBLE
    return Parameter(name=name, value=ParameterValue(type=kind, double_value=value))


def of_type(name, kind):
    return Parameter(name=name, value=ParameterValue(type=kind))


@pytest.mark.parametrize('kind', UNKNOWN_TYPES)
def test_a_value_of_an_unknown_type_is_refused_and_the_others_of_the_request_are_set(graph, kind):
    sim = graph.sim_node(**SMALL)
    sent = [double('ball.mass', 2.0), of_type('ball.damping', kind), double('ball.size', 9.0)]
    sent += [double('ball.stiffness', 0.25)]
    results = graph.call(SetParameters, f'{SIM}/set_parameters', parameters=sent).results
    assert [result.successful for result in results] == [True, False, False, True]
    assert results[1].reason == (
        f'the value of ball.damping has the type {kind}: types are from 0 to 9, see '
        'rcl_interfaces/msg/ParameterType'
    )
    body = sim._world.config.bodies[0]
    assert (body.mass, body.stiffness) == (2.0, 0.25)


@pytest.mark.parametrize('kind', UNKNOWN_TYPES)
def test_with_a_value_of_an_unknown_type_an_atomic_request_does_nothing(graph, kind):
    sim = graph.sim_node(**SMALL)
    before = sim._world.config
    sent = [double('ball.mass', 2.0), of_type('x' * 100_000, kind)]
    service = f'{SIM}/set_parameters_atomically'
    result = graph.call(SetParametersAtomically, service, parameters=sent).result
    assert not result.successful
    assert f'… has the type {kind}: types are from 0 to 9' in result.reason
    assert len(result.reason) < 300
    assert sim._world.config is before
    assert sim.get_parameter('ball.mass').value == 1.0


@pytest.mark.parametrize('name', NAMES)
def test_questions_about_unknown_parameters_are_answered(graph, name):
    graph.sim_node(**SMALL)
    names = ['ball.mass', name, 'ball.mode']
    types = graph.call(GetParameterTypes, f'{SIM}/get_parameter_types', names=names).types
    assert list(types) == [3, 0, 4]
    values = graph.call(GetParameters, f'{SIM}/get_parameters', names=names).values
    assert [value.type for value in values] == [3, 0, 4]
    described = graph.call(DescribeParameters, f'{SIM}/describe_parameters', names=names)
    assert [each.type for each in described.descriptors][:1] in ([3], [])
    listed = graph.call(ListParameters, f'{SIM}/list_parameters', prefixes=[name], depth=2**64 - 1)
    assert 'ball.mass' not in listed.result.names or name in ('', 'ball')
    deleted = of_type(name, ParameterType.PARAMETER_NOT_SET)
    graph.call(SetParameters, f'{SIM}/set_parameters', parameters=[deleted])
    result = graph.set_parameter(SIM, name, 1.0)
    assert result.successful == (name == 'nobody.mass')
    assert '\n' not in result.reason and len(result.reason) < 500


def test_the_smallest_and_largest_values_of_each_setting_do_no_harm(graph):
    sim = graph.sim_node(**SMALL)
    table = parameters.table(parameters.SceneLists())
    chosen = [
        (name, facts)
        for name, facts in table.items()
        if isinstance(facts.default, float) and not facts.read_only
    ]
    assert len(chosen) > 25
    refused = {}
    for name, facts in chosen:
        for value in (5e-324, 1e-300, facts.minimum, facts.maximum):
            result = graph.set_parameter(SIM, name, value)
            if not result.successful:
                refused[name] = result.reason
            assert 'failed' not in result.reason
            assert sim._world.config == sim._scene.world
        assert graph.set_parameter(SIM, name, facts.default).successful
    assert (
        'ball.young_modulus is 1e-300: it must be at least 0.001' in refused['ball.young_modulus']
    )
    graph.call(Trigger, f'{SIM}/reset')
    graph.spin_until(lambda: sim._world.tick > 10)
    assert not sim._failure


def test_what_is_kept_for_later_is_bounded(graph, monkeypatch):
    monkeypatch.setattr(scene_parameters, 'LARGEST_START_VALUES', 1000)
    sim = graph.sim_node(**SMALL)
    assert graph.set_parameter(SIM, 'box.pins.indices', [0] * 600).successful
    for name, value in [('bag.pins.indices', [0] * 600), ('bag.mesh', 'x' * 600)]:
        refused = graph.set_parameter(SIM, name, value)
        assert not refused.successful
        assert 'that are not there would have 1200 numbers and characters' in refused.reason
        assert not sim.has_parameter(name)
    assert graph.set_parameter(SIM, 'box.pins.indices', [0] * 900).successful
    assert graph.set_parameter(SIM, 'bodies', ['ball', 'box']).successful
    assert graph.set_parameter(SIM, 'bag.pins.indices', [0] * 600).successful


def test_a_failure_in_the_node_is_an_answer_too(graph, monkeypatch):
    sim = graph.sim_node(**SMALL)

    def fail(_):
        raise RuntimeError('x' * 10_000)

    monkeypatch.setattr(sim._parameters_of_scene, '_proposed', fail)
    result = graph.set_parameter(SIM, 'ball.mass', 2.0)
    assert not result.successful
    assert result.reason.startswith("the request failed: RuntimeError: 'xxx")
    assert len(result.reason) < 200
    assert sim.get_parameter('ball.mass').value == 1.0


@pytest.mark.parametrize('kind', range(5, 10))
@pytest.mark.parametrize(
    'name', ['frame_id', 'ball.mass', 'ball.mode', 'publish_tf', 'step_count']
)
def test_an_empty_list_for_what_is_no_list_is_refused(graph, name, kind):
    sim = graph.sim_node(**SMALL)
    before = sim._parameters_of_scene.values
    sent = [double('ball.stiffness', 0.25), of_type(name, kind)]
    service = f'{SIM}/set_parameters_atomically'
    result = graph.call(SetParametersAtomically, service, parameters=sent).result
    assert not result.successful
    assert 'Wrong parameter type' in result.reason or 'read-only' in result.reason
    assert sim._parameters_of_scene.values == before


def test_services_answer_after_all_that(graph):
    graph.sim_node(**SMALL)
    empty = graph.call(SetParametersAtomically, f'{SIM}/set_parameters_atomically', parameters=[])
    assert not empty.result.successful and empty.result.reason
    assert not graph.call(SetParameters, f'{SIM}/set_parameters', parameters=[]).results
    assert graph.call(Trigger, f'{SIM}/reset').success
