# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a sweep is to do, as a YAML file says it: a scene, and how parameters vary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
import math
import os
from pathlib import Path
from typing import Any

import yaml

from softbody_ros.core.config import (
    ConfigError,
    Setting,
    checked,
    settings,
    shown,
    unknown_name,
)
from softbody_ros.ensemble import variation
from softbody_ros.ensemble.film import require_rate
from softbody_ros.ensemble.variation import MOST_RUNS, Draw, Grid
from softbody_ros.scene import parameters
from softbody_ros.scene.scene_file import composed, line_of, read_scene, scalar

ENTRIES = ('scene', 'seconds', 'fps', 'seed', 'count', 'vary', 'plot')
LARGEST_SEED = 2**32 - 1
WITHOUT_EFFECT = frozenset(dotted for _, dotted, _ in settings(parameters.NodeConfig))
"""Parameters of the node, which a run does not have."""


@dataclass(frozen=True)
class Spec:
    """
    The runs of a sweep: each combination of the grids, `count` times.

    Attributes
    ----------
    scene : dict
        parameter values, by name
    unknown : dict
        a hint for each name in the scene that belongs to nothing
    seconds, fps : float
        of each run: simulated time, s, and frames in a simulated second
    seed, count : int
        of the draws
    variations : tuple of Grid or Draw
    plot : str
        the outcome to be drawn, '' for none

    """

    scene: dict[str, Any]
    unknown: dict[str, str]
    seconds: float
    fps: float
    seed: int
    count: int
    variations: tuple[Grid | Draw, ...]
    plot: str

    @cached_property
    def grids(self) -> tuple[Grid, ...]:
        """The variations that are grids."""
        return tuple(each for each in self.variations if isinstance(each, Grid))

    @property
    def cells(self) -> int:
        """Number of combinations of the grids."""
        return math.prod(len(each.values) for each in self.grids)

    def __len__(self) -> int:
        """Return the number of runs."""
        return self.cells * self.count

    def values(self, run: int) -> dict[str, Any]:
        """
        Return the values of the varied parameters in a run.

        Runs go through the grids, the last one fastest, once for each draw: so another `count`
        changes none of them.
        """
        cell, chosen = run % self.cells, {}
        for each in reversed(self.grids):
            cell, place = divmod(cell, len(each.values))
            chosen[each.name] = each.values[place]
        return {
            each.name: chosen[each.name] if isinstance(each, Grid) else each.value(self.seed, run)
            for each in self.variations
        }

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of the bodies."""
        return parameters.scene_lists(self.scene).bodies

    @property
    def described(self) -> dict[str, Any]:
        """What decides on the runs, as JSON; but not how many draws there are."""
        return {
            'scene': self.scene,
            'seconds': self.seconds,
            'fps': self.fps,
            'seed': self.seed,
            'vary': [[each.name, each.described] for each in self.variations],
        }


class _Fault(ConfigError):  # noqa: N818
    """What is wrong, with the line; it is not to get another one."""


def read_spec(path: str) -> Spec:
    """
    Read what a sweep is to do.

    Raises
    ------
    ConfigError
        if the file, or its scene, cannot be read, or something in it is wrong; with one sentence
        that has the line.

    """
    what = f'spec {path}'
    try:
        text = Path(path).read_text(encoding='utf-8')
    except (OSError, UnicodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is not UTF-8 text'
        raise ConfigError(f'{what} cannot be read: {reason}') from None
    root = composed(text, what)
    if not isinstance(root, yaml.MappingNode):
        raise ConfigError(f'{what} must be a map with some of {", ".join(ENTRIES)}')
    nodes = _entries(root, what)
    for name, node in nodes.items():
        if name not in ENTRIES:
            hint = unknown_name(name, ENTRIES)
            raise _Fault(f'{_at(node, what)}unknown entry {name[:80]}: {hint}')
    scene, unknown = _scene(nodes, path, what)
    numbers = {
        'seconds': Setting(5.0, '', minimum=0.0, maximum=86400.0),
        'fps': Setting(60.0, '', minimum=1e-6, maximum=1e6),
        'seed': Setting(0, '', minimum=0, maximum=LARGEST_SEED),
        'count': Setting(1, '', minimum=1, maximum=MOST_RUNS),
        'plot': Setting('', ''),
    }
    made = {name: facts.default for name, facts in numbers.items()}
    for name in set(numbers) & set(nodes):
        made[name] = _with_line(nodes[name], what, _number, name, nodes[name], numbers[name])
    spec = Spec(scene, unknown, variations=_variations(nodes, scene, what), **made)
    if 'time_step' not in (each.name for each in spec.variations):
        _require_rate(spec, nodes, root, what)
    has_draws = len(spec.grids) < len(spec.variations)
    if has_draws and 'count' not in nodes:
        raise ConfigError(f'{what} has no count: say how many times values are drawn')
    if spec.count > 1 and not has_draws:
        raise _Fault(f'{_at(nodes["count"], what)}count is {spec.count}, but nothing is drawn: '
                     'the runs would all be the same')  # fmt: skip
    if len(spec) > MOST_RUNS:
        raise ConfigError(f'{what} means {len(spec):,} runs: it must be at most {MOST_RUNS:,}')
    return spec


def _require_rate(spec: Spec, nodes: Mapping[str, yaml.Node], root: yaml.Node, what: str) -> None:
    time_step = parameters.make_scene(spec.scene).world.time_step
    _with_line(nodes.get('fps', root), what, require_rate, spec.seconds, spec.fps, time_step)


def _scene(
    nodes: Mapping[str, yaml.Node], path: str, what: str
) -> tuple[dict[str, Any], dict[str, str]]:
    if 'scene' not in nodes:
        return {}, {}
    name = _with_line(nodes['scene'], what, _number, 'scene', nodes['scene'], Setting('', ''))
    file = Path(path).parent / os.path.expanduser(name)
    values, unknown = _with_line(
        nodes['scene'], what, lambda: parameters.known_values(read_scene(str(file)))
    )
    _with_line(nodes['scene'], what, parameters.make_scene, values)
    return values, unknown


def _number(name: str, node: yaml.Node, facts: Setting) -> Any:
    given = parameters.promoted(_plain(node, name), facts)
    return checked(name, given, facts)


def _variations(
    nodes: Mapping[str, yaml.Node], scene: Mapping[str, Any], what: str
) -> tuple[Grid | Draw, ...]:
    node = nodes.get('vary')
    if not isinstance(node, yaml.MappingNode) or not node.value:
        at = f'{what} ' if node is None else f'{_at(node, what)[:-2]} '
        raise _Fault(f'{at}must have a map vary, for example vary: {{ball.mass: [1.0, 2.0]}}')
    known = parameters.table(parameters.scene_lists(scene))
    return tuple(
        _with_line(each, what, _variation, name, each, known, what)
        for name, each in _entries(node, what).items()
    )


def _variation(name: str, node: yaml.Node, known: Mapping[str, Setting], what: str) -> Grid | Draw:
    if name in WITHOUT_EFFECT:
        raise ConfigError(f'{name} is a parameter of the node, without effect on a run')
    if name in ('bodies', 'obstacles'):
        raise ConfigError(f'{name} cannot vary: write a scene for each list of names')
    if name not in known:
        can = [each for each in known if each not in WITHOUT_EFFECT]
        hint = parameters.unknown_parameter(name, can)
        raise ConfigError(f'unknown parameter {name[:80]}: {hint}')
    facts = known[name]
    if isinstance(node, yaml.SequenceNode):
        return variation.grid(name, _plain(node, name), facts)
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(f'{name} is {shown(_plain(node, name))}: give {variation.FORMS}')
    given = {key: _plain(each, name) for key, each in _entries(node, what).items()}
    if 'from' in given or 'to' in given or 'steps' in given:
        return variation.spaced_grid(name, given, facts)
    if len(given) != 1 or next(iter(given)) not in variation.DISTRIBUTIONS:
        raise ConfigError(f'{name} has {", ".join(given) or "nothing"}: give {variation.FORMS}')
    [(distribution, numbers)] = given.items()
    return variation.draw(name, distribution, numbers, facts)


def _plain(node: yaml.Node, what: str) -> Any:
    """Return the value of a scalar or of nested lists of scalars, with the rules of rcl."""
    if isinstance(node, yaml.ScalarNode):
        return scalar(node, what)
    if isinstance(node, yaml.SequenceNode):
        return [_plain(each, what) for each in node.value]
    raise ConfigError(f'{what} has a map where a value must be')


def _entries(node: yaml.MappingNode, what: str) -> dict[str, yaml.Node]:
    entries: dict[str, yaml.Node] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise _Fault(f'{_at(key, what)}a name must be a text')
        if key.value in entries:
            raise _Fault(f'{_at(key, what)}{key.value[:80]} is there twice: once is enough')
        entries[key.value] = value
    return entries


def _with_line(node: yaml.Node, what: str, made: Any, *arguments: Any) -> Any:
    """Call a function; what it refuses gets the line of the node."""
    try:
        return made(*arguments)
    except _Fault:
        raise
    except ConfigError as error:
        raise _Fault(f'{_at(node, what)}{error}') from None


def _at(node: yaml.Node, what: str) -> str:
    return f'{what}, line {line_of(node)}: '
