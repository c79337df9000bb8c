# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How a parameter varies from run to run: by the values of a grid, or by draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from softbody_ros.core.config import ConfigError, Setting, checked, shown
from softbody_ros.scene.parameters import as_parameter, promoted, type_name

DISTRIBUTIONS = ('uniform', 'log_uniform', 'normal', 'choice')
MOST_RUNS = 10_000_000
"""Of a sweep."""
FORMS = f'a list of values, {{from, to, steps}}, or one of {", ".join(DISTRIBUTIONS)}'
LEAST_SHARE = 1e-3
"""Of a normal distribution that must lie in the range of its parameter."""


@dataclass(frozen=True)
class Grid:
    """
    Values that are all taken, each with all of the other grids.

    Attributes
    ----------
    name : str
        of the parameter
    values : tuple
    is_log : bool
        whether they are a geometric sequence, for axes of plots

    """

    name: str
    values: tuple[Any, ...]
    is_log: bool = False

    @property
    def described(self) -> Any:
        """What it is, as JSON."""
        return list(self.values)


@dataclass(frozen=True)
class Draw:
    """
    A value that is drawn for each run.

    Attributes
    ----------
    name : str
        of the parameter
    facts : Setting
    distribution : str
        one of `DISTRIBUTIONS`
    numbers : tuple
        two bounds, mean and deviation, or all choices

    """

    name: str
    facts: Setting
    distribution: str
    numbers: tuple[Any, ...]

    @property
    def is_log(self) -> bool:
        """Whether its logarithm is what is spread evenly, for axes of plots."""
        return self.distribution == 'log_uniform'

    @property
    def described(self) -> Any:
        """What it is, as JSON."""
        return {self.distribution: list(self.numbers)}

    def value(self, seed: int, run: int) -> Any:
        """Return the value of a run: it depends on these and the name, on nothing else."""
        # only the stream of bits of a generator is promised to stay, not its distributions
        bits = np.random.PCG64(np.random.SeedSequence([seed, run, *self.name.encode()]))
        shares = np.random.Generator(bits).random(self.facts.length or 1)
        if self.distribution == 'choice':
            return self.numbers[int(shares[0] * len(self.numbers))]
        first, second = (np.asarray(each, dtype=float) for each in self.numbers)
        is_whole = _is_whole(self.facts)
        if self.distribution == 'normal':
            low, high = _share_below(self.facts, first, second)
            drawn = first + second * ndtri(low + shares * (high - low))
        elif self.distribution == 'log_uniform':
            drawn = np.exp(np.log(first) + shares * (np.log(second) - np.log(first)))
        elif is_whole:
            drawn = np.floor(first + shares * (second - first + 1.0))
        else:
            drawn = first + shares * (second - first)
        bounds = (first, second)
        if self.distribution == 'normal':
            bounds = (self.facts.minimum, self.facts.maximum)  # type: ignore[assignment]
        drawn = np.clip(drawn, *bounds)  # rounding may lead out
        return _from_array(np.rint(drawn) if is_whole else drawn, self.facts)


def as_key(value: Any) -> Any:
    """Return a value of a parameter as what a dict can have as a key."""
    return tuple(value) if isinstance(value, list) else value


def grid(name: str, values: Any, facts: Setting) -> Grid:
    """
    Return the grid of listed values.

    Raises
    ------
    ConfigError
        if there are none, one occurs twice, or one is not a value of the parameter.

    """
    if not values:
        raise ConfigError(f'{name} has no values: give a list with at least one')
    made = tuple(_value(name, each, facts) for each in values)
    seen = set()
    for each in made:
        if as_key(each) in seen:
            raise ConfigError(f'{name} has the value {shown(each)} twice: once is enough')
        seen.add(as_key(each))
    return Grid(name, made)


def spaced_grid(name: str, given: dict[str, Any], facts: Setting) -> Grid:
    """
    Return the grid of `{from, to, steps, log}`: evenly spaced values, or logarithms.

    Raises
    ------
    ConfigError
        if one of these is missing or wrong.

    """
    for key in ('from', 'to', 'steps'):
        if key not in given:
            raise ConfigError(f'{name} has no {key}: a grid is {{from, to, steps}}')
    for key in given:
        if key not in ('from', 'to', 'steps', 'log'):
            raise ConfigError(f'{name} has {key}: a grid is {{from, to, steps}}, and log: true')
    steps, is_log = given['steps'], given.get('log', False)
    if not isinstance(steps, int) or isinstance(steps, bool) or not 2 <= steps <= MOST_RUNS:
        raise ConfigError(
            f'{name} has {shown(steps)} steps: give a whole number from 2 to {MOST_RUNS:,}'
        )
    if not isinstance(is_log, bool):
        raise ConfigError(f'{name} has log: {shown(is_log)}: it must be true or false')
    first, last = _bounds(name, [given['from'], given['to']], facts)
    if is_log:
        _require_positive(name, (first, last))
    space = np.geomspace if is_log else np.linspace
    values = space(np.asarray(first, dtype=float), np.asarray(last, dtype=float), steps)
    if _is_whole(facts) and np.abs(values - np.rint(values)).max() > 1e-9:
        raise ConfigError(f'{name} must be whole numbers: choose steps that give such, or a list')
    if _is_whole(facts):
        values = np.rint(values)
    made = [_from_array(np.atleast_1d(each), facts) for each in values]
    return Grid(name, grid(name, made, facts).values, is_log)


def draw(name: str, distribution: str, given: Any, facts: Setting) -> Draw:
    """
    Return the draws from a distribution.

    Raises
    ------
    ConfigError
        if what describes it is wrong, or hardly any of it lies in the parameter's range.

    """
    if not isinstance(given, list) or not given:
        raise ConfigError(f'{name}: {distribution} is followed by a list')
    if distribution == 'choice':
        return Draw(name, facts, distribution, grid(name, given, facts).values)
    if len(given) != 2:
        what = 'mean and deviation' if distribution == 'normal' else 'lowest and highest'
        raise ConfigError(f'{name}: {distribution} is followed by two values, {what}')
    if distribution == 'normal':
        return Draw(name, facts, distribution, _normal(name, given, facts))
    low, high = _bounds(name, given, facts)
    if np.any(np.asarray(low) > np.asarray(high)):
        raise ConfigError(f'{name}: {shown(low)} is more than {shown(high)}: give the lower first')
    if distribution == 'log_uniform':
        _require_positive(name, (low, high))
    return Draw(name, facts, distribution, (low, high))


def _value(name: str, value: Any, facts: Setting) -> Any:
    """Return a checked value of a parameter, as JSON has it."""
    made = checked(name, promoted(value, facts), facts)
    return as_parameter(made, facts)


def _bounds(name: str, given: Sequence[Any], facts: Setting) -> tuple[Any, Any]:
    _require_numbers(name, facts)
    first, second = (_value(name, each, facts) for each in given)
    return first, second


def _normal(name: str, given: Sequence[Any], facts: Setting) -> tuple[Any, Any]:
    mean, deviation = _bounds(name, [given[0], given[0]], facts)[0], given[1]
    length = facts.length
    if length is not None and not isinstance(deviation, list):
        deviation = [deviation] * length
    numbers = deviation if isinstance(deviation, list) else [deviation]
    fits = len(numbers) == (length or 1) and isinstance(deviation, list) == (length is not None)
    if not fits or not all(
        isinstance(each, (int, float)) and not isinstance(each, bool) and 0.0 < each < math.inf
        for each in numbers
    ):
        raise ConfigError(
            f'{name}: the deviation {shown(given[1])} must be a number above 0'
            + (f', or {length}' if length else '')
        )
    low, high = _share_below(facts, np.asarray(mean, float), np.asarray(deviation, float))
    if np.min(high - low) < LEAST_SHARE:
        raise ConfigError(
            f'{name}: hardly any value of this distribution is in the range of the parameter, '
            f'{facts.range_text}'
        )
    return mean, deviation


def _share_below(facts: Setting, mean: np.ndarray, deviation: np.ndarray) -> tuple[Any, Any]:
    """
    Return the shares of a normal distribution below both ends of a parameter's range.

    A share between them is a value in the range: as if others were drawn again.
    """
    low = -math.inf if facts.minimum is None else facts.minimum
    high = math.inf if facts.maximum is None else facts.maximum
    return ndtr((low - mean) / deviation), ndtr((high - mean) / deviation)


def _require_numbers(name: str, facts: Setting) -> None:
    kind = type(facts.default)
    if facts.length is None and kind not in (int, float):
        raise ConfigError(f'{name} is no number but {type_name(facts)}: give a list, or a choice')


def _require_positive(name: str, bounds: Sequence[Any]) -> None:
    if np.min(np.asarray(bounds, dtype=float)) <= 0.0:
        raise ConfigError(f'{name}: {shown(bounds[0])} has no logarithm: begin above 0')


def _is_whole(facts: Setting) -> bool:
    return isinstance(facts.default, int) and not isinstance(facts.default, bool)


def _from_array(array: np.ndarray, facts: Setting) -> Any:
    """Return an array as the value of a parameter."""
    if facts.length is not None:
        return [float(each) for each in array]
    return int(array[0]) if _is_whole(facts) else float(array[0])
