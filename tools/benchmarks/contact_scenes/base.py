# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a scene of the battery is, in which cases it is measured, and what a measurement is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import itertools
import math

from contact_scenes.analytic import GRAVITY, reference_step
from softbody_ros.core import BodyConfig, SimulationError, World, WorldConfig

MODES = ('rigid', 'linear', 'quadratic')
SOFT_MODES = ('linear', 'quadratic')
STEPS = (60, 240, 1000)
"""Ticks a second."""
DEFAULT_FREQUENCY = (None,)
STIFFNESS = 0.5


@dataclass(frozen=True)
class Target:
    """What a measurement should be: at least `low`, at most `high`."""

    low: float = -math.inf
    high: float = math.inf
    name: str = ''

    def is_met(self, value):
        return self.low <= value <= self.high

    def __str__(self):
        if self.name:
            return self.name
        if self.low == -math.inf:
            return f'≤ {self.high:.4g}'
        if self.high == math.inf:
            return f'≥ {self.low:.4g}'
        return f'{self.low:.4g} … {self.high:.4g}'


YES, NO = Target(1, 1, 'yes'), Target(0, 0, 'no')


def at_most(high):
    return Target(high=high)


def at_least(low):
    return Target(low=low)


def near(value, share):
    """Return the target of a value that may be wrong by a share of it."""
    off = share * abs(value)
    return Target(value - off, value + off, f'{value:.4g} ± {100 * share:g} %')


@dataclass(frozen=True)
class Measured:
    """A measurement, a number or whether something is so, and what it should be."""

    value: float | bool
    target: Target | None = None

    @property
    def is_met(self):
        return self.target is None or self.target.is_met(self.value)


@dataclass(frozen=True)
class Case:
    """
    How the bodies of a scene are simulated.

    Attributes
    ----------
    mode : str
    hertz : int
        ticks a second
    frequency : float or None
        natural frequency of the bodies, Hz; that of the defaults if None
    quick : bool
        whether only to try that the scene can be measured: whatever takes long is cut short

    """

    mode: str
    hertz: int
    frequency: float | None = None
    quick: bool = False

    @property
    def step(self):
        """One tick, s."""
        return 1 / self.hertz

    def seconds(self, full, quick=0.05):
        """Return how long something takes, s."""
        return min(full, quick) if self.quick else full

    def body(self, **values):
        """Return the config of a body, at the origin and with Coulomb friction by default."""
        defaults = {'mode': self.mode, 'friction_model': 'coulomb', 'friction': 0.5,
                    'stiffness': STIFFNESS, 'position': (0.0, 0.0, 0.0)}  # fmt: skip
        return BodyConfig(**defaults | values)

    def world(self, bodies, obstacles=(), gravity=GRAVITY):
        """Return a world with a step and a frequency as this case says."""
        step = reference_step(self.frequency, STIFFNESS) if self.frequency else 1 / 120
        return World(
            WorldConfig(
                time_step=self.step,
                reference_step=step,
                gravity_magnitude=gravity,
                bodies=tuple(bodies),
                obstacles=tuple(obstacles),
            )
        )


@dataclass(frozen=True)
class Scene:
    """
    A scene and the cases in which it is measured.

    Attributes
    ----------
    measure : callable
        (case, **parameters) -> dict of Measured by name, or None if that case makes no sense
    modes, steps, frequencies : tuples
        of its cases
    parameters : dict of tuples
        all combinations are measured
    compare : callable or None
        adds measurements that compare rows to these, in place

    """

    measure: Callable
    modes: tuple
    steps: tuple
    frequencies: tuple
    parameters: dict
    compare: Callable | None

    @property
    def name(self):
        return self.measure.__name__

    @property
    def title(self):
        """The first line of what the scene says about itself."""
        return self.measure.__doc__.strip().splitlines()[0].rstrip('.')

    def rows(self, modes, steps, quick=False, progress=lambda row: None):
        """
        Return a `Row` for each case and combination of parameters.

        A scene that has none of these steps is measured with its own; where `measure` returns
        None there is no row.
        """
        modes = [mode for mode in self.modes if mode in modes]
        steps = [step for step in self.steps if step in steps] or self.steps
        parameters = self.parameters
        if quick:
            modes, steps = modes[-1:], steps[-1:]
            parameters = {name: values[:1] for name, values in parameters.items()}
        rows = []
        for mode, step in itertools.product(modes, steps):
            frequencies = DEFAULT_FREQUENCY if mode == 'rigid' else self.frequencies
            for frequency in frequencies[-1:] if quick else frequencies:
                case = Case(mode, step, frequency, quick)
                for values in itertools.product(*parameters.values()):
                    row = self._row(case, dict(zip(parameters, values, strict=True)))
                    if row.measured is not None:
                        rows.append(row)
                        progress(row)
        if self.compare and rows:
            self.compare(rows)
        return rows

    def _row(self, case, parameters):
        try:
            return Row(case, parameters, self.measure(case, **parameters))
        except SimulationError as error:
            return Row(case, parameters, {}, str(error))


@dataclass(frozen=True)
class Row:
    """What was measured in one case with one combination of parameters, or why nothing was."""

    case: Case
    parameters: dict
    measured: dict
    error: str = ''


SCENES: dict[str, Scene] = {}


def scene(modes=MODES, steps=STEPS, frequencies=DEFAULT_FREQUENCY, compare=None, **parameters):
    """Return a decorator that makes a function measure a scene, in all these cases."""

    def register(measure):
        made = Scene(measure, modes, steps, frequencies, parameters, compare)
        SCENES[made.name] = made
        return measure

    return register


# -------------------------------------------------------------------------------------- comparing
def groups(rows, *left_out):
    """Yield the rows that agree in all but what is left out: 'step', names of parameters."""
    found = {}
    for row in rows:
        values = {'mode': row.case.mode, 'f': row.case.frequency, 'step': row.case.hertz}
        values |= row.parameters
        key = tuple(value for name, value in values.items() if name not in left_out)
        found.setdefault(key, []).append(row)
    return found.values()


def compare_steps(rows, what, share):
    """Add what a measurement is relative to that with the shortest step."""
    for group in groups(rows, 'step'):
        finest = max(group, key=lambda row: row.case.hertz)
        if what not in finest.measured or len(group) < 2:
            continue
        reference = finest.measured[what].value
        for row in group:
            if what in row.measured and row is not finest:
                ratio = row.measured[what].value / reference if reference else math.nan
                column = f'{what}, relative to the shortest step'
                row.measured[column] = Measured(ratio, near(1.0, share))


def compare_growth(rows, what, along):
    """Add whether a measurement is larger than that with the next smaller value of a parameter."""
    for group in groups(rows, along):
        for before, row in itertools.pairwise(group):
            if what in before.measured and what in row.measured:
                growth = row.measured[what].value - before.measured[what].value
                if not math.isnan(growth):
                    column = f'{what.split(",")[0]} grows with {along}'
                    row.measured[column] = Measured(bool(growth > 0.0), YES)
