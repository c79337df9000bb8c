# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Films as Universal Scene Description, float32: z up, metres, one time code for each frame.

/scene (default prim)
    bodies/NAME       Mesh: points, normals and extent per time code, all else once
    obstacles/NAME    Mesh; moving ones have animated xforms
    materials/NAME    UsdPreviewSurface of each body, and of the obstacles

Obstacles are meshes too: Blender drops the material of Cube, Cylinder etc., and tessellates them
coarsely.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from softbody_ros.bake.writing import OBSTACLE_COLOR, linear, quaternion
from softbody_ros.core import Surface
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.shapes import obstacle_surface
from softbody_ros.core.geometry.shading import Shading, shading
from softbody_ros.ensemble.film import Film, Frame

ROOT = '/scene'
SAVED_AT_ONCE = 64 << 20
"""Bytes of frames collected in memory before they are appended to a binary file."""


class UsdWriter:
    """Writes one film; binary files grow with the frames, text is written at the end."""

    def __init__(self, path: Path, film: Film) -> None:
        self._is_text = path.suffix == '.usda'
        self._waiting = 0
        with _errors_of_files():
            self._stage = Usd.Stage.CreateNew(str(path))
        _set_metadata(self._stage, film)
        for group in ('', '/bodies', '/obstacles'):
            UsdGeom.Xform.Define(self._stage, ROOT + group)
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
        for name, positions in frame.pictures.items():
            self._waiting += self._bodies[name].show(positions, Usd.TimeCode(frame.index))
        for name, obstacle in frame.obstacles.items():
            if obstacle.moves:
                self._obstacles[name].place(obstacle, Usd.TimeCode(frame.index))
        if self._waiting > SAVED_AT_ONCE and not self._is_text:
            self.finish()

    def finish(self) -> None:
        """Save the frames that are not saved yet."""
        self._waiting = 0
        with _errors_of_files():
            self._stage.Save()

    def _body(self, film: Film, name: str) -> _Mesh:
        color = film.color(name)
        body = _Mesh(self._stage, f'{ROOT}/bodies/{name}', film.picture(name))
        _paint(body.prim, color, self._material(name, color))
        return body

    def _obstacle(self, obstacle: Obstacle, reach: float, grey: UsdShade.Material) -> _Placed:
        config = obstacle.config
        surface = obstacle_surface(config, reach)
        shape = _Mesh(self._stage, f'{ROOT}/obstacles/{config.name}', surface)
        shape.show(surface.vertices, Usd.TimeCode.Default())
        _paint(shape.prim, OBSTACLE_COLOR, grey)
        placed = _Placed(shape.prim)
        placed.place(obstacle, Usd.TimeCode.Default())
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


class _Mesh:
    """A mesh with moving vertices and constant faces."""

    def __init__(self, stage: Usd.Stage, path: str, surface: Surface) -> None:
        faces = surface.faces
        self.prim = UsdGeom.Mesh.Define(stage, path)
        self.prim.CreateFaceVertexCountsAttr(
            Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32))
        )
        self.prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel()))
        self.prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        self.prim.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
        self.prim.CreateDoubleSidedAttr(not surface.closed)
        self._shading = shading(surface.vertices, surface.faces)
        self._normals = _normals(self.prim, self._shading)

    def show(self, positions: np.ndarray, time: Usd.TimeCode) -> int:
        """Set positions (n, 3), normals and extent; return their number of bytes."""
        points, normals = positions.astype(np.float32), self._shading.normals(positions)
        extent = np.array([points.min(axis=0), points.max(axis=0)])
        self.prim.GetPointsAttr().Set(_vectors(points), time)
        self.prim.GetExtentAttr().Set(_vectors(extent), time)
        self._normals.Set(_vectors(normals), time)
        return points.nbytes + normals.nbytes


class _Placed:
    """The translation and orientation of an obstacle."""

    def __init__(self, shape: UsdGeom.Gprim) -> None:
        self._translation = shape.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
        self._orientation = shape.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)

    def place(self, obstacle: Obstacle, time: Usd.TimeCode) -> None:
        x, y, z, w = quaternion(obstacle)
        self._translation.Set(Gf.Vec3d(*obstacle.position.tolist()), time)
        self._orientation.Set(Gf.Quatd(w, x, y, z), time)


@contextmanager
def _errors_of_files() -> Iterator[None]:
    """Convert a list of USD errors, the first of which is the cause, to an OSError."""
    try:
        yield
    except Tf.ErrorException as error:
        raise OSError(error.args[0].commentary) from None


def _set_metadata(stage: Usd.Stage, film: Film) -> None:
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.LinearUnits.meters)
    stage.SetTimeCodesPerSecond(film.fps)
    stage.SetFramesPerSecond(film.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(film.times) - 1)


def _normals(mesh: UsdGeom.Mesh, shared: Shading) -> UsdGeom.Primvar:
    """Return the primvar for normals: per vertex, or per corner if there are creases."""
    has_creases = len(shared.origin) > len(np.unique(shared.origin))
    tokens = UsdGeom.Tokens
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        'normals',
        Sdf.ValueTypeNames.Normal3fArray,
        tokens.faceVarying if has_creases else tokens.vertex,
    )
    if has_creases:
        primvar.SetIndices(Vt.IntArray.FromNumpy(shared.faces.astype(np.int32).ravel()))
    return primvar


def _paint(shape: UsdGeom.Gprim, color: tuple[float, ...], material: UsdShade.Material) -> None:
    *rgb, alpha = linear(color)
    shape.CreateDisplayColorAttr([Gf.Vec3f(*rgb)])
    shape.CreateDisplayOpacityAttr([alpha])
    UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(material)


def _vectors(points: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(points)
