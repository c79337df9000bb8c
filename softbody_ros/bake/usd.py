# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Films as Universal Scene Description, float32: z up, metres, one time code for each frame.

/scene (default prim)
    bodies/NAME       Mesh: points and extent for each time code, all else once
    obstacles/NAME    Cube, Sphere, Capsule, Cylinder or Mesh; those that move have moving xforms
    materials/NAME    UsdPreviewSurface of each body, and of the obstacles
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from softbody_ros.bake.film import OBSTACLE_COLOR, Film, Frame, linear, quaternion
from softbody_ros.core import ObstacleConfig, Surface
from softbody_ros.core.obstacle_surface import obstacle_surface, straight_length
from softbody_ros.core.obstacles import Obstacle

ROOT = '/scene'
SAVED_AT_ONCE = 64 << 20
"""Bytes of frames that wait in memory for being appended to a binary file."""


class UsdWriter:
    """Writes one film into a stage; binary files grow with it, a text is written at the end."""

    def __init__(self, path: Path, film: Film) -> None:
        self._is_text = path.suffix == '.usda'
        self._waiting = 0
        self._stage = Usd.Stage.CreateNew(str(path))
        _set_metadata(self._stage, film)
        for part in ('', '/bodies', '/obstacles'):
            UsdGeom.Xform.Define(self._stage, ROOT + part)
        UsdGeom.Scope.Define(self._stage, ROOT + '/materials')
        self._stage.SetDefaultPrim(self._stage.GetPrimAtPath(ROOT))
        self._bodies = {name: self._body(film, name) for name in film.world.names}
        grey = self._material('_obstacles', OBSTACLE_COLOR)  # no body's name
        self._obstacles = {
            item.config.name: self._obstacle(item, film.plane_reach(item.config), grey)
            for item in film.world.obstacles
        }

    def add(self, frame: Frame) -> None:
        """Take a frame."""
        for name, positions in frame.positions.items():
            points = positions.astype(np.float32)
            body, extent = self._bodies[name], [points.min(axis=0), points.max(axis=0)]
            body.GetPointsAttr().Set(_vectors(points), frame.index)
            body.GetExtentAttr().Set(_vectors(np.array(extent)), frame.index)
        for name, obstacle in frame.obstacles.items():
            if obstacle.moves:
                self._obstacles[name].place(obstacle, Usd.TimeCode(frame.index))
        self._waiting += sum(12 * len(positions) for positions in frame.positions.values())
        if self._waiting > SAVED_AT_ONCE and not self._is_text:
            self.finish()

    def finish(self) -> None:
        """Save what is not saved yet."""
        self._waiting = 0
        try:
            self._stage.Save()
        except Tf.ErrorException as error:
            # a whole list of errors, the first of which is the cause
            raise OSError(error.args[0].commentary) from None

    def _body(self, film: Film, name: str) -> UsdGeom.Mesh:
        mesh = UsdGeom.Mesh.Define(self._stage, f'{ROOT}/bodies/{name}')
        _set_faces(mesh, film.surface(name))
        color = film.color(name)
        _paint(mesh, color, self._material(name, color))
        return mesh

    def _obstacle(self, obstacle: Obstacle, reach: float, grey: UsdShade.Material) -> _Placed:
        config = obstacle.config
        shape = _shape(self._stage, f'{ROOT}/obstacles/{config.name}', config, reach)
        _paint(shape, OBSTACLE_COLOR, grey)
        placed = _Placed(shape)
        placed.place(obstacle, Usd.TimeCode.Default())
        if config.type == 'box':
            shape.AddScaleOp().Set(Gf.Vec3f(*config.size))
        extent = UsdGeom.Boundable.ComputeExtentFromPlugins(shape, Usd.TimeCode.Default())
        shape.GetExtentAttr().Set(extent)
        return placed

    def _material(self, name: str, color: tuple[float, ...]) -> UsdShade.Material:
        path = f'{ROOT}/materials/{name}'
        material = UsdShade.Material.Define(self._stage, path)
        shader = UsdShade.Shader.Define(self._stage, f'{path}/surface')
        shader.CreateIdAttr('UsdPreviewSurface')
        *rgb, alpha = linear(color)
        shader.CreateInput('diffuseColor', Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*rgb))
        shader.CreateInput('opacity', Sdf.ValueTypeNames.Float).Set(alpha)
        shader.CreateInput('roughness', Sdf.ValueTypeNames.Float).Set(0.5)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), 'surface')
        return material


class _Placed:
    """The translation and orientation of an obstacle."""

    def __init__(self, shape: UsdGeom.Gprim) -> None:
        self._translation = shape.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
        self._orientation = shape.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)

    def place(self, obstacle: Obstacle, time: Usd.TimeCode) -> None:
        x, y, z, w = quaternion(obstacle)
        self._translation.Set(Gf.Vec3d(*obstacle.position.tolist()), time)
        self._orientation.Set(Gf.Quatd(w, x, y, z), time)


def _set_metadata(stage: Usd.Stage, film: Film) -> None:
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.LinearUnits.meters)
    stage.SetTimeCodesPerSecond(film.fps)
    stage.SetFramesPerSecond(film.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(film.times) - 1)


def _shape(stage: Usd.Stage, path: str, config: ObstacleConfig, reach: float) -> UsdGeom.Gprim:
    radius, _, half_length = config.size
    if config.type == 'box':
        cube = UsdGeom.Cube.Define(stage, path)
        cube.CreateSizeAttr(2.0)
        return cube
    if config.type == 'sphere':
        sphere = UsdGeom.Sphere.Define(stage, path)
        sphere.CreateRadiusAttr(radius)
        return sphere
    if config.type in ('plane', 'mesh'):
        surface = obstacle_surface(config, reach)
        mesh = UsdGeom.Mesh.Define(stage, path)
        _set_faces(mesh, surface)
        mesh.CreatePointsAttr(_vectors(surface.vertices.astype(np.float32)))
        return mesh
    kind = UsdGeom.Capsule if config.type == 'capsule' else UsdGeom.Cylinder
    length = straight_length(config) if config.type == 'capsule' else 2.0 * half_length
    prim = kind.Define(stage, path)
    prim.CreateAxisAttr(UsdGeom.Tokens.z)
    prim.CreateRadiusAttr(radius)
    prim.CreateHeightAttr(length)
    return prim


def _set_faces(mesh: UsdGeom.Mesh, surface: Surface) -> None:
    faces = surface.faces
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(not surface.closed)


def _paint(shape: UsdGeom.Gprim, color: tuple[float, ...], material: UsdShade.Material) -> None:
    *rgb, alpha = linear(color)
    shape.CreateDisplayColorAttr([Gf.Vec3f(*rgb)])
    shape.CreateDisplayOpacityAttr([alpha])
    UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(material)


def _vectors(points: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(points)
