# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Python processes of their own: with another cache of machine code, processor, or no numba."""

import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).parent.parent
WITHOUT_NUMBA = "import sys; sys.modules['numba'] = None\n"


def begun(code, folder=ROOT, python=sys.executable, **environment):
    """Start a process that imports from a folder; variables that are None are not set."""
    environment = {'PYTHONPATH': str(folder), 'OPENBLAS_NUM_THREADS': '1'} | environment
    merged = os.environ | environment
    return subprocess.Popen(
        [python, '-c', code],
        env={name: str(value) for name, value in merged.items() if value is not None},
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def finished(process):
    """Return what a process has printed; it must not have failed."""
    output, errors = process.communicate(timeout=3000)
    assert process.returncode == 0, errors
    return output


def printed(code, folder=ROOT, python=sys.executable, **environment):
    return finished(begun(code, folder, python, **environment))
