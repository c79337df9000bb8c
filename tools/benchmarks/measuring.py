# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How long a step takes, and whether the bodies did what they should: one run in one process."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
import multiprocessing
import os
import time

import numpy as np
from simulators import SIMULATORS
from workloads import RADIUS, STEP

FALLING = slice(3, 25)
"""Steps in free flight: those before may warm up, contact comes at step 27."""
RESTING = 60
"""Steps at the end in which the bodies lie on the ground."""
LARGE_COPY = 200_000_000
"""Bytes, far more than caches hold."""
THREAD_COUNTS = ('OMP', 'OPENBLAS', 'MKL', 'RAYON')


def measured_apart(name, workload):
    """Return what `measured` does, from a process of its own with one thread."""
    os.environ.update({f'{library}_NUM_THREADS': '1' for library in THREAD_COUNTS})
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(1, context, _without_output) as process:
        return process.submit(measured, name, workload).result()


def _without_output():
    """Send what a library prints nowhere, so that the table can be piped."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def measured(name, workload):
    """
    Return measurements of a simulator at a workload, by name.

    falling, resting : time of a step, ms
    acceleration : of the fall, m/s²
    lowest : height of the lowest vertex at rest, mm
    deformation : RMS distance from the nearest rigid pose of the rest shape, at rest, % of RADIUS
    and those of `bandwidths`
    """
    simulator = SIMULATORS[name](workload)
    start = np.array(simulator.positions(), dtype=np.float64)
    steps = max(workload.steps, getattr(simulator, 'settling', 0))
    seconds, heights, lowest = np.zeros(steps), [start[..., 2].mean()], []
    for step in range(steps):
        begin = time.perf_counter()
        simulator.step()
        seconds[step] = time.perf_counter() - begin
        height = simulator.positions()[..., 2]
        heights.append(height.mean(dtype=np.float64))
        lowest.append(height.min())
    times, heights = STEP * np.arange(FALLING.stop), heights[: FALLING.stop]
    falling = np.median(seconds[FALLING])
    values = {
        'falling': 1e3 * falling,
        'resting': 1e3 * np.median(seconds[-RESTING:]),
        'acceleration': -2.0 * np.polyfit(times, heights, 2)[0],
        'lowest': 1e3 * np.median(lowest[-RESTING:]),
        'deformation': deformation(simulator.positions(), start[0]),
    } | bandwidths(falling, workload.particles, simulator.number_size)
    return {key: float(value) for key, value in values.items()}


def bandwidths(seconds, particles, number_size):
    """
    Return how near a step in free flight comes to a copy of the state, by name.

    What a step cannot but move is the position and the velocity of each particle, read and
    written: 12 numbers. Copies are made by `numpy.copyto`: of an array as large as the state,
    which is in the cache if the state fits, and of a large one.

    particle time : ns
    copy, large copy : bytes that they read and write a second, GB/s
    share of copy, share of large copy : bytes that a step cannot but move a second, % of those
    """
    traffic = 12 * number_size * particles
    copy, large = copy_bandwidth(traffic // 2), copy_bandwidth(LARGE_COPY)
    return {
        'particle time': 1e9 * seconds / particles,
        'copy': copy,
        'large copy': large,
        'share of copy': 1e-7 * traffic / seconds / copy,
        'share of large copy': 1e-7 * traffic / seconds / large,
    }


def deformation(positions, rest):
    """Return the median over bodies of the RMS distance to rest (n, 3) as it fits, % of RADIUS."""
    rest = rest - rest.mean(axis=0)
    errors = []
    for body in positions:
        arms = body - body.mean(axis=0)
        left, _, right = np.linalg.svd(arms.T @ rest)
        left[:, 2] *= np.sign(np.linalg.det(left @ right))
        distance = np.linalg.norm(arms - rest @ (left @ right).T, axis=1)
        errors.append(100 * np.sqrt(np.mean(distance**2)) / RADIUS)
    return float(np.median(errors))


def copy_bandwidth(size):
    """Return what copies of so many bytes read and write a second, GB/s."""
    source = np.ones(size // 8)
    target = np.empty_like(source)
    copies = max(1, 2_000_000 // size)  # of small arrays so many that the clock is fine enough
    rates = []
    for _ in range(8):
        begin = time.perf_counter()
        for _ in range(copies):
            np.copyto(target, source)
        rates.append(1e-9 * 2 * copies * source.nbytes / (time.perf_counter() - begin))
    return float(np.median(rates[1:]))
