# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The simulators that `core.py` compares: this one, and what pip can install that matches shapes.

Each is made from a workload, has `step()`, which advances by 1/60 s, and `positions()`, which
returns (bodies, n, 3) float, z up.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
import tempfile

import numpy as np
import trimesh
from workloads import GRAVITY, STEP

from softbody_ros.core import BodyConfig, Surface, World, WorldConfig

STIFFNESS = 0.8


class Ours:
    """This simulator with one match a step; bodies do not fall asleep."""

    package = 'softbody_ros'
    number_size = 8
    """Bytes of a coordinate."""
    mode = 'rigid'
    clusters = False  # a rigid body has no use for regions
    largest = 4_000_000

    def __init__(self, workload):
        surface = Surface(workload.mesh.vertices, workload.mesh.faces)
        bodies = tuple(
            BodyConfig(
                name=f'body{index}',
                mesh=surface,
                mode=self.mode,
                stiffness=STIFFNESS,
                bounciness=0.3,
                regions_count=workload.clusters,
                position=tuple(centre),
            )
            for index, centre in enumerate(workload.centres)
        )
        config = WorldConfig(
            time_step=STEP, reference_step=STEP, gravity_magnitude=GRAVITY, bodies=bodies
        )
        self._world = World(config)

    def step(self):
        # awake by counting anew, not by another limit: kernels are compiled with that
        self._world._state.still_samples[:] = 0
        self._world.step()

    def positions(self):
        if any(self._world.is_asleep(name) for name in self._world.names):
            raise RuntimeError('a body sleeps: what would be measured is not a step')
        return np.stack([self._world.positions(name) for name in self._world.names])


class Linear(Ours):
    mode = 'linear'
    clusters = True


class Quadratic(Ours):
    mode = 'quadratic'
    clusters = True


class PyPBD:
    """
    Rigid shape matching by position based dynamics, C++.

    One match a step, as many as ours, instead of its default of 15 in 1/60 s. Its gravity is
    always (0, −9.81, 0) m/s²: its y is our z.
    """

    package = 'pypbd'
    clusters = True
    largest = 4_000_000
    number_size = 8
    settling = 300
    """Steps until it lies still: its restitution is 0.6."""

    def __init__(self, workload):
        import pypbd

        simulation = pypbd.Simulation.getCurrent()
        simulation.initDefault()
        self._model, self._stepper = simulation.getModel(), simulation.getTimeStep()
        vertices, faces = workload.mesh.vertices, workload.mesh.faces.ravel().tolist()
        clusters = workload.members if workload.clusters else [np.arange(len(vertices))]
        shared_by = np.bincount(np.concatenate(clusters))
        for centre in workload.centres:
            points = list((vertices + centre)[:, [1, 2, 0]])
            body = self._model.addTriangleModel(points, faces, testMesh=True)
            first = body.getIndexOffset()
            for members in clusters:
                self._model.addShapeMatchingConstraint(
                    len(members),
                    (first + members).tolist(),
                    shared_by[members].tolist(),
                    STIFFNESS,
                )
        self._add_ground(pypbd)
        stepper = pypbd.TimeStepController
        for count in (stepper.NUM_SUB_STEPS, stepper.MAX_ITERATIONS, stepper.MAX_ITERATIONS_V):
            self._stepper.setValueUInt(count, 1)
        pypbd.TimeManager.getCurrent().setTimeStepSize(STEP)
        self._shape = (workload.bodies, len(vertices), 3)

    def _add_ground(self, pypbd):
        """Add a box of 100 m with its top at height 0: it has no planes."""
        size = [100.0, 1.0, 100.0]
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / 'box.obj')
            trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
            box = pypbd.OBJLoader.loadObjToMesh(path, [1, 1, 1])
        body = self._model.addRigidBody(1.0, *box, [0, -0.5, 0], np.eye(3), size, False, None)
        body.setMass(0.0)
        vertices = body.getGeometry().getVertexDataLocal()
        kind = pypbd.CollisionObject.RigidBodyCollisionObjectType
        detector = self._stepper.getCollisionDetection()
        detector.addCollisionBox(0, kind, vertices, 0, vertices.size(), size, False, False)

    def step(self):
        self._stepper.step(self._model)

    def positions(self):
        particles = np.asarray(self._model.getParticles().getVertices())
        ours = particles[: self._shape[0] * self._shape[1]]
        return ours.reshape(self._shape)[:, :, [2, 0, 1]]


class Rapier:
    """
    Rigid shape matching by implicit springs, Rust, float32, with its defaults.

    Four solver iterations, each with a match, in 1/60 s. Particles weigh 1 kg, its default: with
    lighter ones a ball far from the origin falls at a wrong rate.
    """

    package = 'rapier3d'
    clusters = True
    largest = 100_000
    """Beyond, a run takes many minutes."""
    number_size = 4

    def __init__(self, workload):
        import rapier3d

        self._world = world = rapier3d.PhysicsWorld(gravity=(0.0, 0.0, -GRAVITY))
        world.set_num_threads(1)
        world.add_collider(rapier3d.Collider.halfspace((0, 0, 1)))
        vertices, faces = np.asarray(workload.mesh.vertices), np.asarray(workload.mesh.faces)
        clusters = workload.members if workload.clusters else []
        self._bodies = []
        for centre in workload.centres:
            builder = rapier3d.SoftBodyBuilder(vertices + centre).surface(faces)
            builder = builder.shape_matching(not clusters).can_sleep(False)
            handle = world.add_soft_body(builder)
            body = world.soft_bodies[handle]
            for members in clusters:
                cluster = world.add_soft_body_cluster(handle, members.tolist())
                body.enable_cluster_shape_matching(cluster, True)
            self._bodies.append(body)
        self.step = world.step

    def positions(self):
        return np.stack([body.particle_positions for body in self._bodies])


SIMULATORS = {
    'rigid': Ours,
    'linear': Linear,
    'quadratic': Quadratic,
    'pypbd': PyPBD,
    'rapier3d': Rapier,
}
"""Those of this project are called by their mode."""


def is_installed(name):
    """Return whether the package of a simulator is there."""
    return importlib.util.find_spec(SIMULATORS[name].package) is not None


def takes_part(name, workload):
    """Return whether a simulator can do a workload."""
    kind = SIMULATORS[name]
    if workload.clusters and not kind.clusters:
        return False
    return workload.particles <= kind.largest
