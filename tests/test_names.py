# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Names of bodies and obstacles, which become parameters, topics and frames."""

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.validate_full_topic_name import validate_full_topic_name
from std_msgs.msg import String

from softbody_ros.bake.__main__ import main as bake
from softbody_ros.core import ConfigError
from softbody_ros.core.config import LONGEST_NAME
from softbody_ros.ros.simulation_interfaces import (
    NAME_INVALID,
    NAME_NOT_UNIQUE,
    RESOURCE_PARSE_ERROR,
    Simulation,
)
from softbody_ros.scene import parameters

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NOT_USABLE = [
    '1st', 'two words', 'a.b', 'a/b', '~', '_hidden', 'größe', '球', '-', 'a\nb', '*', ' ', "it's",
    '{node}', 'a\x00b', 'x' * (LONGEST_NAME + 1), 'x' * 100_000,
]  # fmt: skip
RESERVED = sorted(parameters.RESERVED_NAMES)
USABLE = ['a', 'Ball_2', 'a__b', 'a_', 'class', 'name', 'others', 'x' * LONGEST_NAME]


def refusal_of(values):
    with pytest.raises(ConfigError) as refusal:
        parameters.make_scene(values)
    return str(refusal.value)


def require_one_sentence(text, name):
    assert '\n' not in text and len(text) < 400, text
    assert repr(name)[1:20] in text or name in text


@pytest.mark.parametrize('kind', ['bodies', 'obstacles'])
@pytest.mark.parametrize('name', [*NOT_USABLE, *RESERVED, 'world'])
def test_a_name_that_is_not_possible_is_one_sentence_with_the_remedy(name, kind):
    said = refusal_of({kind: [name]})
    require_one_sentence(said, name)
    assert any(word in said for word in ('begin with a letter', 'choose another', 'shorten it'))
    # in a file it is the same, whatever else is wrong with it
    assert str(refusal_of_known({kind: [name], f'{name}.mass': 'x'})) == said or name == 'world'


def refusal_of_known(values):
    try:
        parameters.make_scene(parameters.known_values(values)[0])
    except ConfigError as refusal:
        return refusal
    return ''


def test_all_parameters_of_the_node_are_reserved():
    own = {name.split('.')[0] for name in parameters.table(parameters.SceneLists((), ()))}
    assert own <= parameters.RESERVED_NAMES
    assert {'gravity', 'qos_overrides', 'use_sim_time', 'robot', 'bodies'} < set(RESERVED)


@pytest.mark.parametrize('name', USABLE)
def test_what_topics_and_parameters_can_have_is_possible(name):
    parameters.make_scene({'bodies': [name], f'{name}.mass': 2.0})
    validate_full_topic_name(f'{SIM}/obstacle_contacts/{name}')


@pytest.mark.parametrize('frame_id', ['ball', '/ball', 'ground'])
def test_the_frame_of_everything_has_a_name_of_its_own(frame_id):
    assert 'is that of the frame of everything' in refusal_of({'frame_id': frame_id})


# ------------------------------------------------------------------------------------ of a node
def set_atomically(graph, values):
    sent = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    service = f'{SIM}/set_parameters_atomically'
    return graph.call(SetParametersAtomically, service, parameters=sent).result


def state_of(sim):
    return (
        sim._world.config,
        sim._world.rebuilds,
        sim._parameters_of_scene.values,
        sorted(sim._parameters),
    )


def topics_of(sim):
    return sorted(publisher.topic_name for publisher in sim.publishers)


def simulation_of(sim):
    return Simulation(
        sim._stepper, sim._parameters_of_scene, sim._paused, sim._restarted, sim._stepped
    )


HOSTILE = st.one_of(
    st.text(st.characters(exclude_categories=['Cs']), max_size=30),
    st.text('aB1_.-/~ é', min_size=1, max_size=8),
    st.text('ab_', min_size=1, max_size=2 * LONGEST_NAME),
    st.sampled_from([*NOT_USABLE, *RESERVED, *USABLE, 'world', 'ball', 'ground']),
)


def test_a_request_with_any_name_is_applied_whole_or_not_at_all_and_answered(graph):
    sim = graph.sim_node(**SMALL)
    simulation = simulation_of(sim)
    begin, topics = state_of(sim), topics_of(sim)

    @settings(
        max_examples=60,
        derandomize=True,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(
        name=HOSTILE, kind=st.sampled_from(['bodies', 'obstacles']), damping=st.floats(0.0, 1.0)
    )
    def ask(name, kind, damping):
        before = state_of(sim)
        names = [*sim._parameters_of_scene.values[kind], name]
        answer = set_atomically(graph, {kind: names, 'ball.damping': damping})
        if answer.successful:
            if name:  # an empty one is none
                validate_full_topic_name(f'{SIM}/obstacle_contacts/{name}')
                assert name in [item.name for item in sim._world.config.items]
                assert f'{name}.position' in sim._parameters
        else:
            require_one_sentence(answer.reason, name)
            assert state_of(sim) == before
        # spawning takes and refuses the same names, and says it by a code of the standard
        before = state_of(sim)
        outcome, spawned = simulation.spawn(name or ' ', uri='box')
        if outcome.message:
            assert outcome.code in (NAME_INVALID, NAME_NOT_UNIQUE)
            require_one_sentence(outcome.message, name)
            assert state_of(sim) == before
        else:
            assert not answer.successful or not name
            assert simulation.delete(spawned).message == ''
        assert set_atomically(graph, {'bodies': ['ball'], 'obstacles': ['ground']}).successful
        assert set_atomically(graph, {'ball.damping': begin[0].bodies[0].damping}).successful

    ask()
    after = state_of(sim)
    assert (after[0], after[2]) == (begin[0], begin[2])
    graph.spin_until(lambda: topics_of(sim) == topics, 'topics of what is gone to go')


def test_a_name_that_makes_topics_of_this_node_too_long_is_refused(graph):
    namespace = '/' + 'n' * 180
    sim = graph.sim_node(namespace=namespace, **SMALL)
    node = sim.get_fully_qualified_name()
    longest = 'x' * (247 - len(f'{node}/obstacle_contacts/'))
    refused = graph.set_parameter(node, 'bodies', ['ball', longest + 'x'])
    assert not refused.successful
    require_one_sentence(refused.reason, longest)
    assert 'shorten it, or the namespace' in refused.reason
    assert sim._world.names == ('ball',)
    assert graph.set_parameter(node, 'obstacles', ['ground', longest]).successful
    topic = f'{node}/obstacle_contacts/{longest}'
    graph.spin_until(lambda: topic in topics_of(sim))
    with pytest.raises(ConfigError, match='shorten it, or the namespace'):
        graph.sim_node(namespace=namespace, bodies=[longest + 'x'])


def test_the_name_of_a_link_of_the_robot_is_taken(graph):
    sim = graph.sim_node(**SMALL, robot__links=['*'])
    link = (
        '<link name="{}"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    )
    long = 'l' * 300
    joint = f'<joint name="j" type="fixed"><parent link="table"/><child link="{long}"/></joint>'
    urdf = f'<robot name="r">{link.format("table")}{link.format(long)}{joint}</robot>'
    graph.node.create_publisher(String, '/robot_description', LATCHED).publish(String(data=urdf))
    graph.spin_until(lambda: 'table' in sim._robot.names)
    assert max(map(len, sim._robot.names)) < LONGEST_NAME
    before = state_of(sim)
    for kind in ('bodies', 'obstacles'):
        names = [*sim._parameters_of_scene.values[kind], 'table']
        refused = graph.set_parameter(SIM, kind, names)
        assert 'the name table is that of a link of the robot' in refused.reason
    assert simulation_of(sim).spawn('table', uri='box')[0].code == NAME_NOT_UNIQUE
    assert simulation_of(sim).spawn('table', True, uri='box')[1] == 'table_2'
    assert simulation_of(sim).delete('table_2').message == ''
    assert state_of(sim)[2] == before[2]


def test_spawning_by_files_with_odd_names_gives_possible_ones(graph, tmp_path):
    simulation = simulation_of(graph.sim_node(**SMALL))
    scene = '/**: {ros__parameters: {bodies: [a], obstacles: [b], a: {mesh: box}}}'
    assert simulation.spawn('', text=scene)[1] == 'a'  # its own name, which is taken now
    for stem, expected in [
        ('robot', 'thing_robot'), ('1 größe', 'thing_1_gr__e'), ('world', 'world_2'),
        ('y' * 200, 'y' * (LONGEST_NAME // 2)),
    ]:  # fmt: skip
        path = tmp_path / f'{stem}.yaml'
        path.write_text(scene)
        outcome, name = simulation.spawn('', True, uri=str(path))
        assert (outcome.message, name) == ('', expected)
    outcome, _ = simulation.spawn('x' * LONGEST_NAME, uri=str(path))
    assert outcome.code == NAME_INVALID and 'shorten it' in outcome.message
    for bad in ('gravity', '"two words"', '"a.b"'):
        text = f'/**: {{ros__parameters: {{bodies: [{bad}]}}}}'
        outcome, _ = simulation.spawn('', text=text)
        assert outcome.code == RESOURCE_PARSE_ERROR
        require_one_sentence(outcome.message, bad.strip('"'))


# --------------------------------------------------------------------------- files and processes
@pytest.mark.parametrize(
    ('name', 'sentence'),
    [
        ('gravity', "the name 'gravity' is that of parameters of the node: choose another"),
        ('a.b', "the name 'a.b' is not usable: begin with a letter"),
        pytest.param('world', 'that of the frame of everything', marks=pytest.mark.slow),
        pytest.param('größe', "the name 'größe' is not usable", marks=pytest.mark.slow),
        pytest.param('x' * 101, 'has 101 characters', marks=pytest.mark.slow),
    ],
)
def test_at_the_start_of_a_process_and_when_baking_it_is_one_sentence(
    graph, tmp_path, capsys, name, sentence
):
    path = tmp_path / 'scene.yaml'
    path.write_text(f'/**: {{ros__parameters: {{bodies: ["{name}"]}}}}', encoding='utf-8')
    by_file = graph.process('--ros-args', '--params-file', str(path))
    by_argument = graph.process('--ros-args', '-p', f'bodies:=["{name}"]')
    assert bake([str(path), '-o', str(tmp_path / 'film.npz')]) == 1
    errors = [capsys.readouterr().err]
    for process in (by_file, by_argument):
        errors.append(process.communicate(timeout=120)[1])
        assert process.returncode == 1
    for said in errors:
        (own,) = [
            line for line in said.splitlines() if line.startswith(('softbody_sim:', 'bake:'))
        ]
        assert sentence in own
        assert 'Traceback' not in said
