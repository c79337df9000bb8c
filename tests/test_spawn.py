# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies and obstacles come and go by the parameters of a node that runs."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import Log, ParameterType
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from scene_files import ROOT, scene_values
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from simulated_clock import SECOND, ClockSource
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.ros import scene_parameters
from softbody_ros.ros.messages import POINT_TYPE
from softbody_ros.ros.simulation_interfaces import SCOPE_ALL, Simulation
from softbody_ros.scene import parameters

SIM = '/softbody_sim'
SMALL = {'ball__subdivisions': 1}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CUBE = {
    'cube.mesh': 'box', 'cube.subdivisions': 0, 'cube.size': 0.2, 'cube.mass': 2,
    'cube.position': [3.0, 0.0, 1.0], 'cube.color': [0.0, 0.0, 1.0, 1.0],
}  # fmt: skip


def messages_of(values):
    # a client cannot say of what type an empty list is
    return [
        Parameter(name, Parameter.Type.STRING_ARRAY, []).to_parameter_msg()
        if value == []
        else Parameter(name, value=value).to_parameter_msg()
        for name, value in values.items()
    ]


def set_atomically(graph, values):
    service = f'{SIM}/set_parameters_atomically'
    return graph.call(SetParametersAtomically, service, parameters=messages_of(values)).result


def set_one_by_one(graph, values):
    """Set as `ros2 param load` does: all in one request, but each by itself."""
    answer = graph.call(SetParameters, f'{SIM}/set_parameters', parameters=messages_of(values))
    return [result.reason for result in answer.results if not result.successful]


def names_of(graph, *owners):
    return [name for name in graph.list_parameters(SIM) if name.split('.')[0] in owners]


def require_agreement(sim):
    """Parameters, world, and what the stepper takes for the config are the same scene."""
    values = sim._parameters_of_scene.values
    assert parameters.make_scene(values).world == sim._scene.world
    assert sim._scene.world == sim._stepper.config == sim._world.config
    declared = {name: sim.get_parameter(name).value for name in values}
    assert declared == values
    table = parameters.table(parameters.scene_lists(values))
    assert list(table) == list(values)
    for name, facts in table.items():
        descriptor = sim.describe_parameter(name)
        assert descriptor.description.startswith(facts.description), name
        assert not descriptor.dynamic_typing, name


@pytest.fixture
def sim(graph):
    node = graph.sim_node(**SMALL)
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    return node


def test_what_is_wrong_with_a_mesh_is_said_once_when_it_comes(graph, tmp_path):
    corners = 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n'
    files = {'double': '1 3 2,1 2 4,1 4 3,2 3 4,2 3 4', 'open': '1 3 2,1 2 4,1 4 3'}
    for name, faces in files.items():
        lines = ''.join(f'f {face}\n' for face in faces.split(','))
        (tmp_path / f'{name}.obj').write_text(corners + lines)
    log = log_of(graph)
    graph.sim_node(**SMALL, ball__mesh=str(tmp_path / 'double.obj'))
    double = f'ball.mesh {tmp_path / "double.obj"} has 1 triangle twice: one of each is left out'
    graph.spin_until(lambda: said(log, double), 'what is said at the start')
    wall = {'wall.type': 'mesh', 'wall.mesh': str(tmp_path / 'double.obj')}
    sheet = {'sheet.mesh': str(tmp_path / 'open.obj'), 'sheet.mesh_scale': 0.2}
    assert set_atomically(graph, {'obstacles': ['ground', 'wall'], **wall}).successful
    assert set_atomically(graph, {'bodies': ['ball', 'sheet'], **sheet}).successful
    opened = f'sheet.mesh {tmp_path / "open.obj"} is not closed (3 edges with one triangle only)'
    graph.spin_until(lambda: said(log, opened), 'what is said of a new body')
    assert set_atomically(graph, {'ball.stiffness': 0.2}).successful
    assert len(said(log, 'wall.mesh', 'has 1 triangle twice')) == 1
    assert len(said(log, str(tmp_path))) == 3


def log_of(graph):
    qos = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return graph.collect(Log, '/rosout', qos)


def said(log, *words):
    return [item.msg for item in log if all(word in item.msg for word in words)]


def numbers(cloud):
    """Return the number of each body of a cloud, with the count of its particles."""
    found = np.frombuffer(cloud.data, POINT_TYPE)['body']
    return dict(
        zip(*(each.tolist() for each in np.unique(found, return_counts=True)), strict=True)
    )


def newest(graph, received):
    """Return the first message that is made after this call."""
    # what is in the queues has been sent before
    for _ in range(20):
        graph.executor.spin_once(timeout_sec=0.0)
    graph.call(Trigger, f'{SIM}/step')
    seen = len(received)
    graph.call(Trigger, f'{SIM}/step')
    graph.spin_until(lambda: len(received) > seen)
    return received[-1]


# ------------------------------------------------------------------------------------ parameters
def test_a_new_name_declares_its_parameters_with_the_values_of_the_request(graph, sim):
    assert names_of(graph, 'cube') == []
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    assert sim._world.names == ('ball', 'cube')
    assert sim._world.rest_shape('cube').particle_count == 8
    assert sim._world.body_config('cube').mass == 2.0
    np.testing.assert_allclose(sim._world.positions('cube').mean(axis=0), [3.0, 0.0, 1.0])
    assert names_of(graph, 'cube') == [f'cube.{name}' for name in parameters.BODY_TABLE]
    assert graph.get_parameters(SIM, ['cube.mass', 'cube.stiffness']) == [2.0, 0.5]
    (mass,) = graph.describe_parameters(SIM, ['cube.mass'])
    assert (mass.type, '[kg]' in mass.description) == (ParameterType.PARAMETER_DOUBLE, True)
    require_agreement(sim)
    assert graph.set_parameter(SIM, 'cube.stiffness', 0.25).successful
    assert sim._world.body_config('cube').stiffness == 0.25
    require_agreement(sim)


def test_values_that_were_set_before_are_start_values(graph, sim):
    for name, value in CUBE.items():
        assert graph.set_parameter(SIM, name, value).successful
    assert sim._world.names == ('ball',)
    assert sorted(names_of(graph, 'cube')) == sorted(CUBE)  # they can be seen
    require_agreement(sim)
    assert graph.set_parameter(SIM, 'cube.mass', 3.0).successful
    result = set_atomically(graph, {'cube.size': 0.3, 'bodies': ['ball', 'cube']})
    assert result.successful
    assert sim._world.body_config('cube').mass == 3.0
    assert sim._world.body_config('cube').size == 0.3
    assert sim._scene.appearances['cube'].color == (0.0, 0.0, 1.0, 1.0)
    require_agreement(sim)
    # the next one of this name begins with defaults
    assert graph.set_parameter(SIM, 'bodies', ['ball']).successful
    assert graph.set_parameter(SIM, 'bodies', ['ball', 'cube']).successful
    assert sim._world.body_config('cube').mass == 1.0
    require_agreement(sim)


def test_values_in_the_file_of_the_start_are_start_values(graph):
    values = {name.replace('.', '__'): value for name, value in CUBE.items()}
    sim = graph.sim_node(**SMALL, **values, bal__mass=3.0, somebody__elses=1.0)
    assert sim._world.names == ('ball',)
    assert sorted(names_of(graph, 'cube', 'bal', 'somebody')) == sorted(CUBE)
    require_agreement(sim)
    assert graph.set_parameter(SIM, 'cube.mass', 3).successful
    assert graph.set_parameter(SIM, 'bodies', ['ball', 'cube']).successful
    assert sim._world.body_config('cube').mass == 3.0
    assert sim._world.body_config('cube').size == 0.2
    require_agreement(sim)


def test_a_start_value_can_be_deleted(graph, sim):
    assert graph.set_parameter(SIM, 'cube.mass', 3.0).successful
    unset = Parameter('cube.mass', Parameter.Type.NOT_SET).to_parameter_msg()
    answer = graph.call(SetParameters, f'{SIM}/set_parameters', parameters=[unset])
    assert answer.results[0].successful
    assert names_of(graph, 'cube') == []
    assert graph.set_parameter(SIM, 'bodies', ['ball', 'cube']).successful
    assert sim._world.body_config('cube').mass == 1.0
    require_agreement(sim)


def test_a_parameter_file_can_be_loaded_whatever_the_order_of_its_lines(graph, sim):
    after = {'bodies': ['ball', 'cube'], **CUBE, 'cube.regions.count': 2}
    assert set_one_by_one(graph, after) == []
    assert sim._world.body_config('cube').size == 0.2
    assert sim._world.rest_shape('cube').particle_count == 8
    require_agreement(sim)
    # when that request is over, what it is made of is fixed
    assert 'read-only' in graph.set_parameter(SIM, 'cube.size', 0.3).reason
    (size,) = graph.describe_parameters(SIM, ['cube.size'])
    assert size.read_only
    obstacle = {'obstacles': ['ground', 'post'], 'post.type': 'capsule', 'post.size': [0.1] * 3}
    assert set_one_by_one(graph, obstacle) == []
    assert sim._world.obstacles[1].config.type == 'capsule'
    assert 'read-only' in graph.set_parameter(SIM, 'post.type', 'box').reason
    require_agreement(sim)


def test_a_file_is_loaded_by_the_client_that_ros2_param_load_uses(graph, sim, tmp_path):
    file = tmp_path / 'more.yaml'
    file.write_text(
        '/softbody_sim: {ros__parameters: {apple: {mass: 0.1, mesh: capsule, subdivisions: 1}, '
        'bodies: [ball, apple, cube], cube: {mesh: box, size: 0.2, subdivisions: 0}, '
        'obstacles: [ground, wall], wall: {type: box, size: [0.1, 2.0, 2.0]}}}'
    )
    client = AsyncParameterClient(graph.node, SIM)
    graph.spin_until(client.services_are_ready)
    future = client.load_parameter_file(str(file))
    graph.spin_until(future.done)
    assert [result.reason for result in future.result().results if not result.successful] == []
    _, apple, cube = sim._world.config.bodies
    assert (apple.mass, apple.mesh, cube.mesh, cube.size) == (0.1, 'capsule', 'box', 0.2)
    assert sim._world.obstacles[1].config.type == 'box'
    require_agreement(sim)


def test_a_removed_name_undeclares_its_parameters(graph, sim):
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    assert graph.set_parameter(SIM, 'bodies', ['cube']).successful
    assert sim._world.names == ('cube',)
    assert names_of(graph, 'ball') == []
    assert 'unknown parameter ball.mas' in graph.set_parameter(SIM, 'ball.mas', 1.0).reason
    require_agreement(sim)
    assert graph.set_parameter(SIM, 'bodies', ['', 'cube', '']).successful
    assert graph.get_parameters(SIM, ['bodies']) == [['cube']]
    assert graph.set_parameter(SIM, 'obstacles', []).successful
    assert graph.get_parameters(SIM, ['obstacles']) == [['']]
    assert sim._world.obstacles == ()
    assert names_of(graph, 'ground') == []
    require_agreement(sim)


def test_a_body_can_become_an_obstacle(graph, sim):
    assert set_atomically(graph, {'bodies': [], 'obstacles': ['ground', 'ball']}).successful
    assert sim._world.names == ()
    assert names_of(graph, 'ball') == [f'ball.{name}' for name in parameters.OBSTACLE_TABLE]
    require_agreement(sim)


def test_the_order_of_the_list_does_no_harm(graph, sim):
    assert set_atomically(graph, {'bodies': ['cube', 'ball'], **CUBE}).successful
    assert graph.get_parameters(SIM, ['bodies']) == [['ball', 'cube']]
    before = sim._world.positions('ball'), sim._world.rebuilds
    assert graph.set_parameter(SIM, 'bodies', ['cube', 'ball']).successful
    assert sim._world.names == ('ball', 'cube')
    assert sim._world.rebuilds == before[1]
    np.testing.assert_array_equal(sim._world.positions('ball'), before[0])
    require_agreement(sim)


REFUSED = [
    ({'bodies': ['ball', 'ball']}, 'the name ball is used twice'),
    ({'bodies': ['ball', 'ground']}, 'the name ground is used twice'),
    ({'bodies': ['ball', '1st']}, "the name '1st' is not usable"),
    ({'bodies': ['ball', 'cube'], 'cube.mesh': '/no.stl'}, 'cube.mesh file /no.stl does not'),
    ({'bodies': ['ball', 'cube'], 'cube.mass': 0.0}, 'cube.mass is 0.0: it must be from'),
    ({'bodies': ['ball', 'cube'], 'cube.mas': 1.0}, 'unknown parameter cube.mas: did you mean'),
    ({'bodies': ['ball', 'cube'], 'cube.type': 'box'}, 'unknown parameter cube.type'),
    ({'bodies': ['ball', 'cube'], 'cube.regions.count': 4000}, 'cube.regions.count is 4000'),
    ({'bodies': ['ball', 'cube'], 'cube.pins.indices': [999]}, 'cube.pins.indices has 999'),
    ({'bodies': ['ball', 'cube'], 'ball.mass': -1.0}, 'ball.mass'),
    ({'bodies': ['ball', 'cube'], 'ball.size': 0.1}, 'read-only'),
    ({'obstacles': ['ground', 'bag'], 'bag.type': 'mesh', 'bag.mesh': 'x.stl'}, 'x.stl does not'),
    ({'bodies': ['cube'], 'gravity.direction': [0.0, 0.0, 0.0]}, 'its length must not be zero'),
    # before it is there
    ({'bal.stiffness': 0.1}, 'unknown parameter bal.stiffness: did you mean ball.stiffness?'),
    ({'grund.size': [1.0] * 3}, 'unknown parameter grund.size: did you mean ground.size?'),
    ({'ground.mass': 1.0}, 'unknown parameter ground.mass: did you mean ground.mesh?'),
    ({'cube.stifness': 0.1}, 'unknown parameter cube.stifness: did you mean cube.stiffness?'),
    ({'cube.mass': -1.0}, 'cube.mass is -1.0: it must be from 1e-06'),
    ({'cube.mesh': 3}, 'cube.mesh is 3: it must be a text'),
    ({'time_scal': 2.0}, 'unknown parameter time_scal: did you mean time_scale?'),
    ({'1st.mass': 2.0}, "unknown parameter 1st.mass: '1st' cannot be the name of a body"),
    ({'other.thing': 2.0}, 'unknown parameter other.thing: no body and no obstacle has that'),
    ({'gravity.magnitud': 2.0}, 'unknown parameter gravity.magnitud: did you mean gravity.magni'),
    ({'bal.stif': 2.0}, 'unknown parameter bal.stif: did you mean ball.stiffness?'),
]  # fmt: skip


@pytest.mark.parametrize(('values', 'sentence'), REFUSED)
def test_what_is_refused_is_said_in_one_sentence_and_leaves_everything_as_it_was(
    graph, sim, values, sentence
):
    before = sim._world.rebuilds, sim._world.config, sim._parameters_of_scene.values
    listed = graph.list_parameters(SIM)
    result = set_atomically(graph, values)
    assert not result.successful
    assert sentence in result.reason
    assert '\n' not in result.reason
    assert (sim._world.rebuilds, sim._world.config, sim._parameters_of_scene.values) == before
    assert graph.list_parameters(SIM) == listed
    require_agreement(sim)
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    require_agreement(sim)


def test_similar_names_with_numbers_are_no_slips(graph, sim):
    assert graph.set_parameter(SIM, 'ball_2.mass', 2.0).successful
    assert graph.set_parameter(SIM, 'ball2.mass', 3.0).successful
    assert graph.set_parameter(SIM, 'bodies', ['ball', 'ball2', 'ball_2']).successful
    assert [body.mass for body in sim._world.config.bodies] == [1.0, 3.0, 2.0]


def test_a_mesh_is_loaded_once_for_many_bodies(graph, sim):
    names = [f'egg{index}' for index in range(20)]
    values = {f'{name}.subdivisions': 2 for name in names}
    assert set_atomically(graph, {'bodies': ['ball', *names], **values}).successful
    rests = {id(sim._world.rest_shape(name)) for name in names}
    assert len(rests) == 1
    rest = sim._world.rest_shape('egg0')
    assert graph.set_parameter(SIM, 'bodies', ['ball']).successful
    assert set_atomically(graph, {'bodies': ['ball', 'egg'], 'egg.subdivisions': 2}).successful
    assert sim._world.rest_shape('egg') is rest  # the history has it


# --------------------------------------------------------------------------------------- outputs
def test_numbers_in_clouds_are_stable_and_the_rest_mesh_comes_anew(graph, sim):
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    meshes = graph.collect(Mesh, f'{SIM}/rest_mesh', LATCHED)
    reports = graph.collect(DiagnosticArray, '/diagnostics')
    graph.spin_until(lambda: clouds and meshes)
    assert numbers(newest(graph, clouds)) == {0: 42}
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    assert numbers(newest(graph, clouds)) == {0: 42, 1: 8}
    graph.spin_until(lambda: len(meshes) == 2)
    assert (len(meshes[1].vertices), len(meshes[1].triangles)) == (50, 80 + 12)
    last = np.array([(p.x, p.y, p.z) for p in meshes[1].vertices[42:]])
    np.testing.assert_allclose(last.mean(axis=0), [3.0, 0.0, 1.0])  # at its start pose
    assert graph.set_parameter(SIM, 'bodies', ['cube', 'third']).successful
    assert numbers(newest(graph, clouds)) == {1: 8, 2: 642}
    graph.spin_until(lambda: len(meshes) == 3)
    assert len(meshes[2].vertices) == 650
    assert graph.set_parameter(SIM, 'bodies', ['cube']).successful
    assert set_atomically(
        graph, {'bodies': ['cube', 'fourth', 'ball'], 'fourth.subdivisions': 0}
    ).successful
    assert numbers(newest(graph, clouds)) == {1: 8, 3: 12, 0: 642}  # a name keeps its number
    del reports[:]
    graph.spin_until(lambda: reports)
    said = {item.key: item.value for item in reports[-1].status[0].values}
    assert said['cube number in ~/points'] == '1'
    assert said['fourth number in ~/points'] == '3'
    require_agreement(sim)


@pytest.mark.oldest
def test_markers_and_topics_of_the_gone_go(graph, sim):
    values = {'bodies': ['ball', 'cube'], **CUBE, 'obstacles': ['ground', 'post']}
    assert set_atomically(graph, {**values, 'post.type': 'box'}).successful
    markers = graph.collect(Marker, f'{SIM}/mesh')
    obstacles = graph.collect(MarkerArray, f'{SIM}/obstacle_markers', LATCHED)
    graph.spin_until(lambda: {marker.ns for marker in markers} == {'ball', 'cube'})
    graph.spin_until(lambda: obstacles and obstacles[-1].markers[-1].ns == 'post')

    def topics():
        return {name for name, _ in graph.node.get_topic_names_and_types()}

    own = {f'{SIM}/contacts/cube', f'{SIM}/obstacle_contacts/post'}
    graph.spin_until(lambda: own <= topics(), 'topics of what is there')
    del markers[:]
    assert set_atomically(graph, {'bodies': ['ball'], 'obstacles': ['ground']}).successful
    graph.spin_until(lambda: any(marker.action == Marker.DELETE for marker in markers))
    deleted = [marker for marker in markers if marker.action == Marker.DELETE]
    assert [(each.ns, each.id, each.header.frame_id) for each in deleted] == [('cube', 0, 'world')]
    later = markers[markers.index(deleted[0]) + 1 :]
    graph.spin_until(lambda: [m.ns for m in obstacles[-1].markers if m.ns] == ['ground'])
    assert {marker.ns for marker in later} <= {'ball'}
    graph.spin_until(lambda: not own & topics(), 'topics of what is gone to go')
    contacts = graph.collect(WrenchStamped, f'{SIM}/contacts/late')
    assert set_atomically(
        graph, {'bodies': ['ball', 'late'], 'late.position': [9.0, 0.0, 0.5]}
    ).successful
    assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    graph.spin_until(lambda: contacts, 'what the late body feels')


def test_a_frame_of_many_bodies_fits_into_the_queues(graph, sim):
    names = [f'egg{index}' for index in range(60)]
    values = {f'{name}.subdivisions': 0 for name in names}
    values |= {f'{name}.position': [float(index), 0.0, 3.0] for index, name in enumerate(names)}
    markers = graph.collect(Marker, f'{SIM}/mesh', 500)
    graph.spin_until(lambda: markers)
    assert set_atomically(graph, {'bodies': ['ball', *names], **values}).successful
    graph.spin_until(lambda: {marker.ns for marker in markers} == {'ball', *names})
    del markers[:]
    assert graph.set_parameter(SIM, 'bodies', ['ball']).successful
    graph.spin_until(
        lambda: {m.ns for m in markers if m.action == Marker.DELETE} == set(names),
        'all markers of the gone are deleted',
    )


def test_an_empty_world_goes_on_in_every_output(graph, sim):
    received = {
        'points': graph.collect(PointCloud2, f'{SIM}/points'),
        'mesh': graph.collect(Mesh, f'{SIM}/rest_mesh', LATCHED),
        'report': graph.collect(DiagnosticArray, '/diagnostics'),
    }
    assert graph.set_parameter(SIM, 'bodies', []).successful
    assert graph.get_parameters(SIM, ['bodies']) == [['']]
    assert graph.call(SetBool, f'{SIM}/pause', data=False).success
    tick = sim._world.tick
    graph.spin_until(lambda: sim._world.tick > tick + 30)
    graph.spin_until(lambda: received['points'] and received['points'][-1].width == 0)
    graph.spin_until(lambda: received['mesh'] and not received['mesh'][-1].vertices)
    del received['report'][:]
    graph.spin_until(lambda: received['report'])
    assert graph.call(Trigger, f'{SIM}/reset').success
    assert graph.call(Trigger, f'{SIM}/apply_initial_velocity').success
    assert graph.set_parameter(SIM, 'bodies', ['ball']).successful
    graph.spin_until(lambda: received['points'][-1].width == 642)


def test_a_node_may_start_empty(graph):
    sim = graph.sim_node(bodies=[''], obstacles=[''])
    clouds = graph.collect(PointCloud2, f'{SIM}/points')
    graph.spin_until(lambda: clouds and sim._world.tick > 5)
    assert set_atomically(graph, {'bodies': ['cube'], **CUBE}).successful
    graph.spin_until(lambda: numbers(clouds[-1]) == {0: 8})


def test_a_wrench_on_a_body_ends_with_it(graph, sim):
    wrenches = graph.node.create_publisher(WrenchStamped, f'{SIM}/wrench', 10)
    graph.spin_until(wrenches.get_subscription_count)
    message = WrenchStamped()
    message.header.frame_id, message.wrench.force.x = 'ball', 100.0
    wrenches.publish(message)
    graph.spin_until(lambda: sim._world.external_inputs.wrenches)
    assert graph.set_parameter(SIM, 'bodies', ['cube']).successful
    assert not sim._world.external_inputs.wrenches
    wrenches.publish(message)  # it is said, and nothing else happens
    assert graph.call(Trigger, f'{SIM}/step').success


# ------------------------------------------------------------------------------------------ time
class Tape(ClockSource):
    """A clock that is shown to the node, forwards and back."""

    def __init__(self, graph, sim):
        super().__init__(graph, sim)
        self.go(0.0)

    def go(self, seconds):
        self.reach(7 * SECOND + round(seconds * SECOND))
        stepper = self.sim._stepper
        self.graph.spin_until(lambda: self.sim._parameters_of_scene._followed is stepper.config)
        return self.state()

    def state(self):
        world = self.sim._world
        return world.tick, {
            name: (world.positions(name).tobytes(), world.velocities(name).tobytes())
            for name in world.names
        }


def test_scrubbing_back_before_a_spawn_removes_it_and_its_parameters(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    tape = Tape(graph, sim)
    log = {0.2: tape.go(0.2)}
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    for seconds in (0.3, 0.7):
        log[seconds] = tape.go(seconds)
    assert set(log[0.7][1]) == {'ball', 'cube'}
    assert tape.go(0.3) == log[0.3]
    assert graph.get_parameters(SIM, ['bodies']) == [['ball', 'cube']]
    require_agreement(sim)
    assert tape.go(0.1)[1].keys() == {'ball'}
    assert graph.get_parameters(SIM, ['bodies']) == [['ball']]
    assert names_of(graph, 'cube') == []
    require_agreement(sim)
    assert tape.go(0.2) == log[0.2]
    # it has not happened: time goes on without it, until it is added again
    assert tape.go(0.25)[1].keys() == {'ball'}
    tape.go(0.2)
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    assert [tape.go(seconds) for seconds in (0.3, 0.7)] == [log[0.3], log[0.7]]
    require_agreement(sim)


def test_scrubbing_back_before_a_removal_brings_it_back_with_its_parameters(graph):
    values = {name.replace('.', '__'): value for name, value in CUBE.items()}
    sim = graph.sim_node(
        **SMALL, **values, bodies=['cube', 'ball'], cube__stiffness=0.25, use_sim_time=True,
        ball__mesh='package://softbody_ros/config/duck.obj',
    )  # fmt: skip
    tape = Tape(graph, sim)
    log = {seconds: tape.go(seconds) for seconds in (0.2, 0.3)}
    before = sim._parameters_of_scene.values
    assert set_atomically(graph, {'bodies': [], 'obstacles': ['post']}).successful
    log[0.6] = tape.go(0.6)
    assert names_of(graph, 'ball', 'cube', 'ground') == []
    assert tape.go(0.2) == log[0.2]
    assert sim._parameters_of_scene.values == before  # with its colour, and the URI of its mesh
    require_agreement(sim)
    assert 'read-only' in graph.set_parameter(SIM, 'cube.size', 0.3).reason
    assert tape.go(0.3) == log[0.3]
    assert set_atomically(graph, {'bodies': [], 'obstacles': ['post']}).successful
    assert tape.go(0.6) == log[0.6]


@pytest.mark.parametrize('memory', [128.0, 0.0])
def test_a_mesh_file_is_not_needed_to_go_back_in_time(graph, tmp_path, memory):
    sim = graph.sim_node(**SMALL, use_sim_time=True, history__memory=memory)
    tape = Tape(graph, sim)
    tape.go(0.1)
    file = tmp_path / 'duck.obj'
    file.write_bytes((ROOT / 'config' / 'duck.obj').read_bytes())
    values = {'bodies': ['ball', 'duck'], 'duck.mesh': str(file), 'duck.position': [3.0, 0.0, 1.0]}
    assert set_atomically(graph, values).successful
    log = tape.go(0.2)
    file.unlink()
    assert graph.set_parameter(SIM, 'bodies', ['ball']).successful
    assert tape.go(0.3)[1].keys() == {'ball'}
    assert tape.go(0.2) == log
    assert log[1].keys() == {'ball', 'duck'}


def test_what_has_been_another_thing_is_that_again(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True)
    tape = Tape(graph, sim)
    log = {0.2: tape.go(0.2)}
    before = sim._parameters_of_scene.values
    assert graph.set_parameter(SIM, 'bodies', []).successful
    assert set_atomically(
        graph, {'bodies': ['ball'], 'ball.mesh': 'box', 'ball.subdivisions': 0}
    ).successful
    log[0.4] = tape.go(0.4)
    assert tape.go(0.2)[1]['ball'][0] == log[0.2][1]['ball'][0]
    assert sim._parameters_of_scene.values == before
    require_agreement(sim)


def test_a_spawn_on_the_way_back_waits_for_the_arrival(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True, history__memory=0.0)
    tape = Tape(graph, sim)
    tape.go(60.0)
    tape.send((7 + 50) * SECOND)
    graph.spin_until(lambda: sim._stepper.replaying)
    assert set_atomically(graph, {'bodies': ['ball', 'cube'], **CUBE}).successful
    assert sim._stepper.replaying and sim._world.names == ('ball',)
    assert names_of(graph, 'cube')
    graph.spin_until(lambda: not sim._stepper.replaying)
    assert sim._world.names == ('ball', 'cube')
    np.testing.assert_allclose(sim._world.positions('cube').mean(axis=0), [3.0, 0.0, 1.0])
    require_agreement(sim)


def test_what_has_come_and_gone_many_times_leaves_nothing_behind(graph, sim):
    add = messages_of({'bodies': ['ball', 'cube'], **CUBE})
    remove = messages_of({'bodies': ['ball']})
    client = graph.node.create_client(SetParametersAtomically, f'{SIM}/set_parameters_atomically')
    graph.spin_until(client.service_is_ready)
    before = sim._world.positions('ball'), len(sim._parameters), len(list(sim.publishers))
    for _ in range(50):
        for request in (add, remove):
            future = client.call_async(SetParametersAtomically.Request(parameters=request))
            graph.spin_until(future.done)
            assert future.result().result.successful
    graph.spin_until(lambda: len(list(sim.publishers)) == before[2])
    assert len(sim._parameters) == before[1]
    np.testing.assert_array_equal(sim._world.positions('ball'), before[0])
    require_agreement(sim)


def test_of_what_has_gone_the_last_looks_are_kept(graph, sim, monkeypatch):
    monkeypatch.setattr(scene_parameters, 'MOST_LOOKS', 2)
    for name in ('a', 'b', 'c', 'b', 'd'):
        assert set_atomically(graph, {'bodies': ['ball', name]}).successful
    assert graph.set_parameter(SIM, 'bodies', ['ball']).successful
    assert list(sim._parameters_of_scene._looks) == ['b', 'd']


# ---------------------------------------------------------------------------------- the standard
def simulation_of(sim):
    return Simulation(
        sim._stepper, sim._parameters_of_scene, sim._paused, sim._restarted, sim._stepped
    )


@pytest.mark.oldest
def test_the_standard_spawns_and_deletes_by_the_same_parameters(graph, sim):
    simulation = simulation_of(sim)
    assert graph.set_parameter(SIM, 'cube.size', 0.125).successful
    pose = (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)
    outcome, name = simulation.spawn('cube', uri='box', pose=pose)
    assert (outcome.message, name) == ('', 'cube')
    assert graph.get_parameters(SIM, ['bodies']) == [['ball', 'cube']]
    assert graph.get_parameters(SIM, ['cube.size', 'cube.position']) == [0.125, [1.0, 2.0, 3.0]]
    assert sim._world.rigid_fit('cube').position == pytest.approx((1.0, 2.0, 3.0))
    require_agreement(sim)
    config = str(ROOT / 'config' / 'cubes.yaml')
    outcome, name = simulation.spawn('', True, uri=config)
    assert (outcome.message, name) == ('', 'cubes')
    require_agreement(sim)
    outcome, name = simulation.spawn('bad', text=SCENE_THAT_DOES_NOT_FIT)
    assert 'bad.regions.count is 4000' in outcome.message
    require_agreement(sim)
    assert simulation.delete('cubes').message == ''
    assert graph.get_parameters(SIM, ['bodies']) == [['ball', 'cube']]
    assert simulation.delete('ball').message == ''
    assert names_of(graph, 'ball') == []
    assert simulation.reset(SCOPE_ALL).message == ''
    assert graph.get_parameters(SIM, ['bodies']) == [['ball']]
    assert (sim._world.tick, sim._world.rest_shape('ball').particle_count) == (0, 42)
    require_agreement(sim)


SCENE_THAT_DOES_NOT_FIT = """
/**: {ros__parameters: {bodies: [a], obstacles: [b], a: {mesh: box, regions.count: 4000}}}
"""


@pytest.mark.parametrize('path', sorted(ROOT.glob('config/*.yaml')), ids=lambda path: path.stem)
def test_every_shipped_scene_can_be_spawned_into_another(graph, sim, path):
    simulation = simulation_of(sim)
    pose = (9.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    outcome, name = simulation.spawn('more', uri=str(path), pose=pose)
    assert (outcome.message, name) == ('', 'more')
    require_agreement(sim)
    alone = parameters.make_scene(scene_values(path.stem)).world
    assert len(sim._world.names) == 1 + len(alone.bodies)
    assert graph.call(Trigger, f'{SIM}/step').success
    assert simulation.delete('more').message == ''
    assert sim._world.names == ('ball',)
    require_agreement(sim)
