# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Readers of observations: films of `bake`, bags, and folders of point files.

A film (.npz) has the vertices of each body. A bag has messages sensor_msgs/PointCloud2 of one
topic (observation_bag.py). In a folder each file is a cloud: .npy, .ply, or text (.csv, .txt,
.xyz) with x, y, z in the first three columns, m. Its time, s, stands in times.csv (lines
`file,time`), or is the last number in its name if that has a decimal point, as in
cloud_0.033.ply.
"""

from __future__ import annotations

from collections.abc import Sequence
import importlib.util
from pathlib import Path
import re
from typing import Any

import numpy as np

from softbody_ros.ensemble.observation import ANY_BODY, Observation, ObservationError, in_order

TIMES = 'times.csv'
TEXTS = ('.csv', '.txt', '.xyz')
SUFFIXES = ('.npy', '.ply', *TEXTS)
NUMBER = r'(?:(?<![^\W_])[-+])?\d+\.\d+(?:[eE][-+]?\d+)?|\d+'
"""In the name of a file; a dash after a letter or a digit is no sign."""


def read_observation(path: Path, bodies: Sequence[str], topic: str | None = None) -> Observation:
    """
    Return what a file or a folder has.

    Parameters
    ----------
    path : Path
    bodies : sequence of str
        of the scene, by their numbers in clouds
    topic : str, optional
        of a bag

    Raises
    ------
    ObservationError
        if it cannot be read, or has no points.

    """
    if not path.exists():
        raise ObservationError(f'the observation {path} does not exist')
    is_bag = path.suffix in ('.bag', '.mcap', '.db3') or (path / 'metadata.yaml').exists()
    if topic is not None and not is_bag:
        raise ObservationError(f'--topic is of a bag, and {path} is none: leave it out')
    if path.suffix.lower() == '.npz':
        observation = _film(path)
    elif is_bag:
        if importlib.util.find_spec('rosbags') is None:
            raise ObservationError(
                'bags need rosbags, which is not installed: pip install rosbags'
            )
        from softbody_ros.ensemble.observation_bag import read_bag

        observation = read_bag(path, bodies, topic)
    elif path.is_dir():
        observation = _folder(path)
    else:
        raise ObservationError(
            f'the observation {path} has an unknown suffix: give a film of bake (.npz), a bag, '
            'or a folder of point files'
        )
    if not any(
        np.isfinite(cloud).all(axis=1).any()
        for clouds in observation.clouds.values()
        for cloud in clouds
    ):
        raise ObservationError(f'the observation {path} has no points: all its clouds are empty')
    return observation


def _film(path: Path) -> Observation:
    try:
        with np.load(path, allow_pickle=False) as film:
            # the tick that a frame shows, not the time nearest to which it is
            times = np.ravel(film['ticks'] * film['time_step']).astype(float).tolist()
            clouds = {
                name: np.asarray(film[f'{name}.positions'], dtype=float)
                for name in film['bodies'].tolist()
            }
    except OSError as error:
        raise ObservationError(_unreadable(f'the observation {path}', error)) from None
    except MemoryError:
        raise
    except Exception:  # as many kinds as there are ways of being damaged
        raise ObservationError(
            f'the observation {path} is no film of bake, or damaged: bake it again'
        ) from None
    for name, positions in clouds.items():
        if positions.ndim != 3 or positions.shape != (len(times), positions.shape[1], 3):
            raise ObservationError(
                f'the observation {path} has positions of {name} of the shape {positions.shape}: '
                f'it must be ({len(times)}, n, 3), the number of its times first'
            )
    return in_order(times, {name: list(each) for name, each in clouds.items()}, path)


def _folder(path: Path) -> Observation:
    stamped = _times_of(path)
    clouds = [_points(file) for file in stamped]
    return in_order(list(stamped.values()), {ANY_BODY: clouds}, path)


def _times_of(folder: Path) -> dict[Path, float]:
    """Return the files of a folder with their times, s."""
    table = folder / TIMES
    if table.exists():
        return _listed(table)
    files = sorted(each for each in folder.iterdir() if each.suffix.lower() in SUFFIXES)
    if not files:
        raise ObservationError(
            f'the folder {folder} has no point files: they end with {", ".join(SUFFIXES)}'
        )
    result = {}
    for file in files:
        numbers = re.findall(NUMBER, file.stem)
        if not numbers or '.' not in numbers[-1]:
            raise ObservationError(
                f'{file} has no time in its name, such as cloud_0.033{file.suffix}: name all '
                f'files like that, or list them in {table}, with lines file,time'
            )
        result[file] = float(numbers[-1])
    return result


def _listed(table: Path) -> dict[Path, float]:
    try:
        lines = table.read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeError) as error:
        raise ObservationError(_unreadable(str(table), error)) from None
    result: dict[Path, float] = {}
    for number, line in enumerate(lines):
        name, _, time = (part.strip() for part in line.partition(','))
        if not line.strip() or (number == 0 and not _is_number(time)):
            continue  # a headline
        if not _is_number(time) or not (table.parent / name).is_file():
            raise ObservationError(
                f'{table}, line {number + 1}: it must be the name of a file in this folder, a '
                'comma, and a time in seconds'
            )
        result[table.parent / name] = float(time)
    if not result:
        raise ObservationError(f'{table} lists no file: its lines are file,time')
    return result


def _unreadable(what: str, error: OSError | UnicodeError) -> str:
    reason = getattr(error, 'strerror', None) or 'it is not UTF-8 text'
    return f'{what} cannot be read: {reason}'


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _points(file: Path) -> np.ndarray:
    """Return the points (k, 3) of a file."""
    try:
        points = np.asarray(_loaded(file), dtype=float)
    except Exception as error:  # readers of formats raise anything
        reason = ' '.join(str(error).split())[:100]
        raise ObservationError(f'the points {file} cannot be read: {reason}') from None
    if points.ndim != 2 or points.shape[1] < 3:
        raise ObservationError(
            f'the points {file} have the shape {points.shape}: it must be (k, 3), a row of '
            'x, y, z for each'
        )
    return points[:, :3]


def _loaded(file: Path) -> Any:
    suffix = file.suffix.lower()
    if suffix == '.npy':
        return np.load(file, allow_pickle=False)
    if suffix == '.ply':
        import trimesh

        loaded: Any = trimesh.load(file, process=False)
        return np.asarray(loaded.vertices)
    if suffix not in TEXTS:
        raise ObservationError(f'it must end with one of {", ".join(SUFFIXES)}')
    lines = file.read_text(encoding='utf-8-sig').replace(',', ' ').replace(';', ' ').splitlines()
    if lines and not all(_is_number(word) for word in lines[0].split()):
        del lines[0]  # a headline
    rows = [line.split()[:3] for line in lines if line.strip()]
    return np.array(rows, dtype=float).reshape(len(rows), 3 if not rows else len(rows[0]))
