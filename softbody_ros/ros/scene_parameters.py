# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scene as parameters of a node, which come and go with its bodies and obstacles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    MeshError,
    ObstacleConfig,
    PreparedConfig,
)
from softbody_ros.core.config import Setting, shown
from softbody_ros.ros import messages
from softbody_ros.scene import parameters
from softbody_ros.scene.parameters import Scene, SceneLists
from softbody_ros.timeline.stepper import Stepper

MOST_START_VALUES, LARGEST_START_VALUES = 10_000, 1_000_000
"""
Largest number of values that are kept for bodies and obstacles that are not there, and of the
numbers and characters in these.
"""
LONGEST_TOPIC = 247
"""Characters with which the middleware takes the full name of a topic."""
MOST_LOOKS = 10_000
"""Bodies and obstacles whose meshes and colours, as they were set, outlast their removal."""
LISTS = ('bodies', 'obstacles')
LOOKS = ('mesh', 'visual_mesh', 'color')
"""What the config of a world does not have as it was set."""

Values = Mapping[str, Any]


@dataclass(frozen=True)
class _Proposal:
    """What a request leads to: the values of what is there, and of what is not, and the scene."""

    values: Values
    start_values: Values
    scene: Scene
    prepared: PreparedConfig


class SceneParameters:
    """
    Declares the parameters of a scene on a node, and applies changes to a stepper.

    Setting `bodies` or `obstacles` adds and removes: a new name gets its parameters, with the
    values of the same request or those that were set before, and a removed one loses them. What is
    set before is a parameter of any type until then, so that it is listed and can be deleted.
    Read-only parameters of what is new can be set until `settle`: a request that sets many
    parameters one by one, as `ros2 param load` does, may have them after the lists.

    Parameters
    ----------
    node : Node
        which allows undeclared parameters

    Raises
    ------
    ConfigError
        if its overrides do not describe a scene.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._start_values: Values = {}
        self.values: Values = self._override_values()
        self.scene = parameters.make_scene(self.values)
        self._links: Callable[[], Collection[str]] = tuple
        for item in self.scene.world.items:
            self._require_free(item.name)
        self._known: Mapping[str, Setting] = {}
        self._proposal: _Proposal | None = None
        self._is_own_change = False
        self._new: set[str] = set()
        self._looks: dict[str, Values] = {}  # of what has been removed

    def _override_values(self) -> dict[str, Any]:
        """Return the values from YAML files and the command line that are this node's."""
        # rclpy has no public access to overrides of undeclared parameters
        overrides = {name: item.value for name, item in self._node._parameter_overrides.items()}
        values, unknown = parameters.known_values(overrides)
        lists = parameters.scene_lists(values)
        values |= {'bodies': lists.bodies, 'obstacles': lists.obstacles}
        known, kept = parameters.table(lists), {}
        for name in unknown:
            try:
                kept[name] = parameters.start_value(name, overrides[name], known)
            except ConfigError as error:
                self._node.get_logger().warning(f'{error}; it is ignored')
        self._keep(kept)
        return {
            name: parameters.normal(value, known[name]) if name in known else value
            for name, value in values.items()
        }

    def _keep(self, start_values: Values) -> None:
        """Keep values for bodies and obstacles that are not there, and say so."""
        before = {_owner(name) for name in self._start_values}
        for owner in sorted({_owner(name) for name in start_values} - before):
            self._node.get_logger().info(
                f'{owner} is neither in bodies nor in obstacles: its parameters are kept for when '
                'it is'
            )
        self._start_values = start_values

    def offer(
        self,
        stepper: Stepper,
        changed: Callable[[], None],
        links: Callable[[], Collection[str]],
    ) -> None:
        """
        Declare the parameters, and apply changes of them.

        Parameters
        ----------
        stepper : Stepper
        changed : callable
            called after each change
        links : callable
            returns the names that links of a robot have, as obstacles

        """
        self._stepper, self._changed, self._links = stepper, changed, links
        self._declare(self.values, self.scene)
        self.settle()
        self.start = self.values
        for name, value in self._start_values.items():
            of_any_type = ParameterDescriptor(dynamic_typing=True)
            self._node.declare_parameter(name, value, of_any_type, ignore_override=True)
        self._node.add_pre_set_parameters_callback(self._normalised)
        self._node.add_on_set_parameters_callback(self._check)
        self._node.add_post_set_parameters_callback(self._use)

    # ----------------------------------------------------------------------- requests of clients
    def _normalised(self, proposed: list[Parameter]) -> list[Parameter]:
        """Return values as they are declared: floats, typed empty lists, names in their order."""
        if self._is_own_change:
            return proposed
        result = []
        for item in proposed:
            if item.name in self._known:
                value = self._normal_value(item.name, item.value)
                # an empty list that stays has a type that its value does not tell
                item = item if value is item.value else Parameter(item.name, value=value)
            result.append(item)
        return result

    def _normal_value(self, name: str, value: Any) -> Any:
        facts = self._known[name]
        if facts.items is not None and value is not None and not isinstance(value, str):
            try:
                value = list(value) or parameters.as_parameter([], facts)
            except TypeError:
                return value
        if name in LISTS and isinstance(value, list):
            place = {each: index for index, each in enumerate(self.values[name])}
            value = sorted(filter(None, value), key=lambda each: place.get(each, len(place)))
            value = value or parameters.as_parameter([], facts)
        return parameters.promoted(value, facts)

    def _check(self, proposed: list[Parameter]) -> SetParametersResult:
        if self._is_own_change:
            return SetParametersResult(successful=True)
        try:
            self._proposal = self._proposed(proposed)
        except (ConfigError, MeshError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _proposed(self, proposed: Iterable[Parameter]) -> _Proposal:
        """
        Return what a request leads to, or raise ConfigError or MeshError.

        Nothing is changed. Meshes of what is new are loaded.
        """
        given = {item.name: item.value for item in proposed}
        lists = {name: given.get(name, self.values[name]) for name in LISTS}
        known = parameters.table(parameters.scene_lists(lists))
        # of a body that becomes an obstacle nothing stays
        present, start_values = self._known, dict(self._start_values)
        values = {
            name: value for name, value in self.values.items() if known.get(name) is present[name]
        }
        for name, value in given.items():
            if name in known or name in self._known:
                continue
            if value is None:  # it is deleted
                start_values.pop(name, None)
            elif name in start_values or not self._node.has_parameter(name):
                start_values[name] = parameters.start_value(name, value, self._known)
        if any(name in start_values for name in given):
            _require_room(start_values)
        new = {_owner(name) for name in known if known[name] is not present.get(name)}
        for name in sorted(new):
            self._require_free(name)
        taken = [name for name in start_values if _owner(name) in new]
        others = {name: start_values.pop(name) for name in taken}
        others |= {name: value for name, value in given.items() if name in known}
        for name, value in others.items():
            facts = known.get(name)  # the scene refuses others
            values[name] = value if facts is None else parameters.normal(value, facts)
        scene = parameters.make_scene(values)
        prepared = self._stepper.prepare(scene.world, self._new)
        return _Proposal(values, start_values, scene, prepared)

    @property
    def taken(self) -> Collection[str]:
        """Names that nothing else can have."""
        frame_id = self.scene.node.frame_id.lstrip('/')
        return {*self.values['bodies'], *self.values['obstacles'], *self._links(), frame_id}

    def _require_free(self, name: str) -> None:
        """Raise ConfigError if this node cannot have topics of its own for something new."""
        if name in self._links():
            raise ConfigError(
                f'the name {name} is that of a link of the robot, which has topics and a frame of '
                'that name: choose another'
            )
        node = self._node.get_fully_qualified_name()
        room = LONGEST_TOPIC - len(f'{node}/obstacle_contacts/')
        if len(name) > room:
            raise ConfigError(
                f'the name {shown(name)} has {len(name)} characters, but topics of the node '
                f'{shown(node)} have room for {max(room, 0)}: shorten it, or the namespace'
            )

    def _use(self, _: list[Parameter]) -> None:
        if self._is_own_change:
            return
        proposal, self._proposal = self._proposal, None
        assert proposal is not None  # of the check just before
        self._keep(proposal.start_values)
        self._stepper.adopt(proposal.prepared)
        self._declare(proposal.values, proposal.scene)
        self._changed()

    def request(self, values: Values) -> None:
        """
        Set parameters in one request, as a client does.

        Raises
        ------
        ConfigError, MeshError
            if it is refused; nothing has changed then.

        """
        items = [
            Parameter(name, value=list(value) or [''] if name in LISTS else value)
            for name, value in values.items()
        ]
        proposal = self._proposed(self._normalised(items))  # to know the kind of error
        result = self._node.set_parameters_atomically(items)
        if not result.successful:
            raise ConfigError(result.reason)
        del proposal  # till now: what it has loaded is not loaded again

    # ------------------------------------------------------------------------------ declarations
    def _declare(self, values: Values, scene: Scene, renewed: Collection[str] = ()) -> None:
        """
        Use a scene: undeclare the parameters of what is gone, declare those of what is new.

        Those of the `renewed` bodies and obstacles are declared anew.
        """
        before, known = self._known, parameters.table(parameters.scene_lists(values))
        gone = {
            name
            for name in before
            if known.get(name) is not before[name] or _owner(name) in renewed
        }
        new = [name for name in known if name in gone or name not in before]
        for name in {_owner(name) for name in gone} - {''}:
            self._looks.pop(name, None)  # the last ones that were removed are the last ones
            self._looks[name] = {
                f'{name}.{each}': self.values[f'{name}.{each}']
                for each in LOOKS
                if f'{name}.{each}' in self.values
            }
        for name in list(self._looks)[:-MOST_LOOKS]:
            del self._looks[name]
        self._new = {name for name in self._new | {_owner(name) for name in new} if name}
        self._known, self.scene = known, scene
        self.values = {
            name: values[name] if name in values else parameters.normal(facts.default, facts)
            for name, facts in known.items()
        }
        with self._own_change():
            for name in (*gone, *new):
                if self._node.has_parameter(name):
                    # rclpy refuses to undeclare what is read-only
                    del self._node._parameters[name], self._node._descriptors[name]
            for name in new:
                descriptor = messages.descriptor(known[name])
                descriptor.read_only &= _owner(name) not in self._new
                self._node.declare_parameter(
                    name, self.values[name], descriptor, ignore_override=True
                )
            for name in LISTS:
                if self._node.get_parameter(name).value != self.values[name]:
                    self._node.set_parameters([Parameter(name, value=self.values[name])])
        self._followed = self._stepper.config

    @contextmanager
    def _own_change(self) -> Iterator[None]:
        """Let the callbacks ignore changes in this context: they follow the scene."""
        self._is_own_change = True
        try:
            yield
        finally:
            self._is_own_change = False

    def settle(self) -> None:
        """Make the read-only parameters of what is new so."""
        new, self._new = self._new, set()
        if not new:
            return
        for name, facts in self._known.items():
            if facts.read_only and _owner(name) in new:
                descriptor = messages.descriptor(facts)
                descriptor.type = self._node.describe_parameter(name).type
                self._node.set_descriptor(name, descriptor)

    # ------------------------------------------------------------------------------- the way back
    def follow(self) -> None:
        """Have the parameters of what is there after the history of the stepper went back."""
        config = self._stepper.config
        if config is self._followed:
            return
        self._followed = config
        present = {item.name: item for item in self.scene.world.items}
        wanted = {item.name: item for item in config.items}
        renewed = {name for name, item in wanted.items() if present.get(name) != item}
        if not renewed and list(present) == list(wanted):
            return
        lists = {
            'bodies': tuple(body.name for body in config.bodies),
            'obstacles': tuple(obstacle.name for obstacle in config.obstacles),
        }
        known = parameters.table(SceneLists(**lists))
        values = {name: value for name, value in self.values.items() if name in known}
        values |= {name: parameters.normal(value, known[name]) for name, value in lists.items()}
        for name in renewed:
            values |= self._values_of(wanted[name])
        self._declare(values, parameters.make_scene(values), renewed)
        self._changed()

    def _values_of(self, item: BodyConfig | ObstacleConfig) -> Values:
        """Return the parameters of a body or an obstacle that comes back."""
        values, looks = parameters.values_of(item), self._looks.get(item.name, {})
        for field in parameters.mesh_fields(item):
            name = f'{item.name}.{field}'
            if name in looks and parameters.mesh_path(looks[name]) == getattr(item, field):
                values[name] = looks[name]
        color = f'{item.name}.color'
        if isinstance(item, BodyConfig) and color in looks:
            values[color] = looks[color]
        return values


def _require_room(start_values: Values) -> None:
    """Raise ConfigError if more is kept than anybody needs."""
    if len(start_values) > MOST_START_VALUES:
        raise ConfigError(
            f'there are values of {MOST_START_VALUES} parameters of bodies and obstacles that '
            'are not there: delete some, or add these'
        )
    size = sum(_size(value) for value in start_values.values())
    if size > LARGEST_START_VALUES:
        raise ConfigError(
            f'parameters of bodies and obstacles that are not there would have {size} numbers '
            f'and characters, at most {LARGEST_START_VALUES} are kept: delete some, or add these'
        )


def _size(value: Any) -> int:
    if isinstance(value, list):
        return sum(map(_size, value)) if isinstance(value[0], str) else len(value)
    return len(value) if isinstance(value, str) else 1


def _owner(name: str) -> str:
    """Return the name of the body, obstacle or group that a parameter belongs to, or ''."""
    return name.rpartition('.')[0].split('.')[0]
