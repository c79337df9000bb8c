# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""An outcome over the parameters that vary: a line over one, a heat map over two."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt

from softbody_ros.core.config import ConfigError, unknown_name
from softbody_ros.ensemble.outcomes import names_of
from softbody_ros.ensemble.spec import Spec
from softbody_ros.ensemble.variation import Draw, Grid, as_key
from softbody_ros.scene.parameters import scene_lists, table
from softbody_ros.whole_file import whole_file

MOST_TICKS = 12
"""With a text, on an axis."""
LEAST_DIGITS, MOST_DIGITS = 4, 17
"""Of such a text; the most tell any two numbers apart."""
UNITS = {'largest_dent': 'm', 'highest_rebound': 'm', 'time_of_rest': 's',
         'last_x': 'm', 'last_y': 'm', 'last_z': 'm'}  # fmt: skip


def axes_of(spec: Spec) -> list[Grid | Draw]:
    """
    Return the parameters that vary, one or two.

    Raises
    ------
    ConfigError
        if there are none or more.

    """
    axes = [each for each in spec.variations if isinstance(each, Draw) or len(each.values) > 1]
    if not 1 <= len(axes) <= 2:
        raise ConfigError(
            f'a plot is over one or two parameters, and {len(axes)} vary: plot index.csv yourself'
        )
    return axes


def full_name(outcome: str, spec: Spec) -> str:
    """
    Return the name of an outcome; that of an only body may be left out.

    Raises
    ------
    ConfigError
        if there is none.

    """
    known = names_of(spec.bodies)
    if outcome in known:
        return outcome
    if len(spec.bodies) == 1 and f'{spec.bodies[0]}.{outcome}' in known:
        return f'{spec.bodies[0]}.{outcome}'
    raise ConfigError(f'unknown outcome {outcome[:80]}: {unknown_name(outcome, known)}')


def draw_plot(rows: Iterable[Mapping[str, Any]], outcome: str, spec: Spec, path: Path) -> None:
    """
    Write a PNG of an outcome over the parameters that vary.

    Draws of one point are averaged; what failed, or has no such outcome, is left out.

    Parameters
    ----------
    rows : iterable of mapping
        attributes of the runs, as the store has them
    outcome : str
        its full name
    spec : Spec
    path : Path
        of the file

    """
    axes = axes_of(spec)
    shown = [row for row in rows if row['outcomes'].get(outcome) is not None]
    values = np.array([float(row['outcomes'][outcome]) for row in shown])
    figure, panel = plt.subplots(figsize=(6.4, 4.8), layout='constrained')
    unit = UNITS.get(outcome.rpartition('.')[2], '')
    label = f'{_words(outcome)} ({unit})' if unit else _words(outcome)
    are_cells = len(axes) == 2 and all(isinstance(axis, Grid) for axis in axes)
    places = [_Axis(axis, shown, spec, are_cells) for axis in axes]
    for place, which in zip(places, 'xy', strict=False):
        place.label(panel, which)
    if len(axes) == 1:
        _line(panel, places[0], values, isinstance(axes[0], Grid))
        panel.set_ylabel(label)
    else:
        x, y = places
        if are_cells:
            colors: Any = panel.pcolormesh(x.ticks, y.ticks, _means(x, y, values))
        else:
            colors = panel.scatter(x.of_rows, y.of_rows, c=values)
        figure.colorbar(colors, label=label)
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, dpi=120, format='png')
    plt.close(figure)


class _Axis:
    """
    Places along an axis: the values of a parameter, or 0, 1, … if these are no numbers, or cells.

    Attributes
    ----------
    of_rows : (rows,) float
        the place of each row
    ticks : (any,) float
        of listed values

    """

    def __init__(
        self, axis: Grid | Draw, rows: list[Mapping[str, Any]], spec: Spec, are_cells: bool
    ) -> None:
        facts = table(scene_lists(spec.scene))[axis.name]
        given = [row['parameters'][axis.name] for row in rows]
        listed: list = list(axis.values if isinstance(axis, Grid) else axis.numbers)
        is_number = isinstance(facts.default, (int, float)) and not isinstance(facts.default, bool)
        self._name = f'{axis.name} ({facts.unit})' if facts.unit else axis.name
        self._is_log = axis.is_log and not are_cells
        self._texts: list[str] = []
        if is_number and not are_cells:
            self.of_rows = np.array(given, dtype=float)
            self.ticks = np.unique(np.array(listed, dtype=float))
            return
        if is_number:
            listed.sort()
        known = {as_key(value): place for place, value in enumerate(listed)}
        for value in given:  # drawn vectors
            known.setdefault(as_key(value), len(known))
        self._texts = _texts(known)
        self.of_rows = np.array([known[as_key(value)] for value in given], dtype=float)
        self.ticks = np.arange(len(known), dtype=float)

    def label(self, panel: Any, which: str) -> None:
        getattr(panel, f'set_{which}label')(self._name)
        if self._texts:
            every = -(-len(self._texts) // MOST_TICKS)
            getattr(panel, f'set_{which}ticks')(self.ticks[::every], self._texts[::every])
        elif self._is_log:
            getattr(panel, f'set_{which}scale')('log')


def _texts(values: Iterable[Any]) -> list[str]:
    """Return labels of different values, with as few digits as tell them apart."""
    for digits in range(LEAST_DIGITS, MOST_DIGITS + 1):
        texts = [_text(value, digits) for value in values]
        if len(set(texts)) == len(texts):
            break
    return texts


def _text(value: Any, digits: int) -> str:
    if isinstance(value, tuple):
        return ', '.join(_text(each, digits) for each in value)
    return f'{value:.{digits}g}' if isinstance(value, float) else str(value)


def _words(outcome: str) -> str:
    body, _, name = outcome.rpartition('.')
    words = name.replace('_', ' ')
    return f'{words} of {body}' if body else words


def _line(panel: Any, place: _Axis, values: np.ndarray, is_grid: bool) -> None:
    if not is_grid:
        panel.plot(place.of_rows, values, 'o', alpha=0.6)
        return
    at = {tick: values[place.of_rows == tick] for tick in place.ticks}
    at = {tick: some for tick, some in at.items() if len(some)}
    panel.plot(list(at), [some.mean() for some in at.values()], 'o-')
    if any(len(some) > 1 for some in at.values()):
        lows, highs = ([end(some) for some in at.values()] for end in (np.min, np.max))
        panel.fill_between(list(at), lows, highs, alpha=0.2)


def _means(x: _Axis, y: _Axis, values: np.ndarray) -> np.ndarray:
    """Return means (rows of y, columns of x) over the runs of each cell, NaN without any."""
    result = np.full((len(y.ticks), len(x.ticks)), np.nan)
    for row, column in np.ndindex(result.shape):
        here = values[(x.of_rows == column) & (y.of_rows == row)]
        if len(here):
            result[row, column] = here.mean()
    return result
