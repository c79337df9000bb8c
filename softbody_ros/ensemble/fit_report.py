# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a fit leaves: a table, a scene file with the parameters, a picture over time."""

from __future__ import annotations

from contextlib import suppress
import dataclasses
import io
from typing import Any

import numpy as np
import yaml

from softbody_ros.core import ConfigError, MeshError, SimulationError
from softbody_ros.ensemble.fit_estimates import Verdict
from softbody_ros.ensemble.fit_parameters import OFFSET, fitted_values, offset_of
from softbody_ros.ensemble.fit_problem import Match, Problem, matches
from softbody_ros.ensemble.fit_search import Solution
from softbody_ros.scene.parameters import normal, scene_lists, table
from softbody_ros.scene.scene_file import EVERY_NODE, PARAMETERS

SECTION = '/softbody_fit'
"""Name of the section with the deviations: that of a node that does not exist."""
LOWEST = 0.1
"""Least residual that is drawn, in units of the noise."""
OBSERVED, FITTED, BEFORE, LIMIT = '#222222', '#d9541e', '#9a9a9a', '#3c78b4'


def text_table(verdict: Verdict) -> str:
    """Return the parameters with values, standard deviations and notes as a table."""
    rows = [('parameter', 'value', '±', 'note')]
    for each in verdict.estimates:
        unit = f' {each.unknown.unit}' if each.unknown.unit else ''
        deviation = '—' if each.deviation is None else f'{each.deviation:.2g}'
        rows.append((each.unknown.name, f'{each.value:.5g}{unit}', deviation, each.note))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = (
        '  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    )
    return '\n'.join(line.rstrip() for line in lines)


def scene_text(problem: Problem, verdict: Verdict, source: str) -> str:
    """
    Return a parameter file of the scene with the fitted values.

    A second section, which nodes ignore, has the standard deviations and the RMS residual.
    """
    values = fitted_values(problem.scene, problem.unknowns, verdict.coordinates)
    known = table(scene_lists(values))
    scene = {name: normal(value, known[name]) for name, value in values.items()}
    facts: dict[str, Any] = {
        'residual_rms': float(verdict.rms * problem.noise),
        'noise': float(problem.noise),
        'deviation': {
            each.unknown.name: each.deviation
            for each in verdict.estimates
            if each.deviation is not None
        },
    }
    if OFFSET in [unknown.name for unknown in problem.unknowns]:
        facts[OFFSET] = offset_of(problem.unknowns, verdict.coordinates)
    head = [f'fitted to {source}', *text_table(verdict).splitlines(), *verdict.warnings]
    body = {EVERY_NODE: {PARAMETERS: _nested(scene)}, SECTION: {PARAMETERS: facts}}
    comment = ''.join(f'# {line}\n' for line in head)
    return comment + yaml.safe_dump(body, sort_keys=False, allow_unicode=True)


def _nested(values: dict[str, Any]) -> dict[str, Any]:
    """Return dotted names as maps in maps."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        *groups, own = name.split('.')
        inner = result
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[own] = value
    return result


def picture(problem: Problem, verdict: Verdict) -> bytes:
    """Return a PNG of heights and residuals over time: observed, fitted, and as the scene was."""
    from matplotlib.figure import Figure

    fitted = matches(problem, verdict.coordinates)
    shown = [(fitted, FITTED, '-', 'fitted')]
    # the scene as given may be one that cannot be simulated
    with suppress(ConfigError, MeshError, SimulationError):
        before = matches(dataclasses.replace(problem, unknowns=()), np.zeros(0))
        shown.insert(0, (before, BEFORE, '--', 'scene as given'))
    figure = Figure(figsize=(8.0, 5.6), layout='constrained')
    height, residual = figure.subplots(2, 1, sharex=True)
    for k, target in enumerate(problem.targets):
        frames = np.unique(target.frames)
        times = problem.times[frames]
        label = lambda text, k=k: text if k == 0 else None  # noqa: E731
        mean = _over_frames(target.frames, target.points[:, 2])
        height.plot(times, mean, 'o', ms=4, color=OBSERVED, label=label('observed'))
        for found, color, style, text in shown:
            mean = _over_frames(target.frames, found[k].nearest[:, 2])
            height.plot(times, mean, style, color=color, label=label(text))
            rms = np.sqrt(_over_frames(target.frames, _squares(found[k], len(target.points))))
            rms = np.maximum(rms, problem.noise * LOWEST)
            residual.plot(times, 1e3 * rms, style, color=color)
    residual.axhline(1e3 * problem.noise, color=LIMIT, lw=1, ls=':', label='noise')
    residual.set_ylim(bottom=1e3 * problem.noise * LOWEST)
    height.set_ylabel('mean height of the points, m')
    residual.set_ylabel('residual, RMS, mm')
    residual.set_xlabel('time in the scene, s')
    residual.set_yscale('log')
    for axes in (height, residual):
        axes.grid(alpha=0.25)
        axes.spines[['top', 'right']].set_visible(False)
        axes.legend(frameon=False)
    data = io.BytesIO()
    figure.savefig(data, format='png', dpi=120)
    return data.getvalue()


def _over_frames(frames: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the mean of values (n,) in each frame that has points."""
    _, index, counts = np.unique(frames, return_inverse=True, return_counts=True)
    return np.bincount(index, values) / counts


def _squares(match: Match, count: int) -> np.ndarray:
    """Return the squared residual (n,) of each point, the mean over its coordinates."""
    return (match.residuals.reshape(count, -1) ** 2).mean(axis=1)


def summary(problem: Problem, solution: Solution, verdict: Verdict, seconds: float) -> str:
    """Return what was compared, in one line."""
    points = sum(len(target.points) for target in problem.targets)
    failed = f', {solution.failures} of them failed' if solution.failures else ''
    return (
        f'residual {1e3 * verdict.rms * problem.noise:.3g} mm RMS (noise '
        f'{1e3 * problem.noise:.3g} mm), {points} points in {len(problem.times)} frames, '
        f'{solution.runs} runs{failed} in {seconds:.0f} s'
    )
