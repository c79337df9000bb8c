# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The 3-D view of bodies, obstacles and the ground, drawn by viser."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import viser
from visualization_msgs.msg import Marker

from softbody_ros.viewer import decoding
from softbody_ros.viewer.decoding import Color, Frame, Part, Surface
from softbody_ros.viewer.glb import ColoredFile

GRID: dict[str, Any] = {
    'infinite_grid': True, 'cell_size': 0.1, 'section_size': 1.0, 'fade_distance': 40.0,
    'cell_color': (222, 222, 218), 'section_color': (190, 190, 186),
    'plane_color': (244, 243, 240), 'shadow_opacity': 0.35,
}  # fmt: skip
NO_COLOR = (200, 204, 212)
"""Colour of a marker without one."""
TRANSLUCENT = 0.5
"""Opacity of bodies that are to be seen through."""
FAR = 1e9
"""Largest coordinate that is drawn, m."""


class View3D:
    """The contents of the view; each method replaces the previous ones."""

    def __init__(self, server: viser.ViserServer, shadows: bool) -> None:
        self._server, self._scene = server, server.scene
        self._surface: Surface | None = None
        self._parts: list[Part] = []
        self._meshes: list[Any] = []
        self._colored_mesh: Any = None
        self._file: ColoredFile | None = None
        self._obstacles: dict[tuple[str, int], tuple[Any, Any]] = {}
        self._added = 0
        self._opacity = 1.0
        self._scene.set_up_direction('+z')
        self._scene.configure_environment_map('studio', environment_intensity=0.4)
        self._scene.configure_default_lights(True, cast_shadow=shadows)
        self._grid = self._scene.add_grid('/ground', plane_opacity=0.0, **GRID)
        self._keep_shader()

    def _keep_shader(self) -> None:
        """
        Add tiny meshes that keep the shaders for vertex colours in use.

        The page recompiles such a shader whenever the last mesh that uses it is replaced, which
        takes longer than everything else: these are never replaced.
        """
        corners = 1e-4 * np.eye(3)
        white = np.full((3, 4), 255, np.uint8)
        for name, opacity in (('/speck', 1.0), ('/translucent_speck', TRANSLUCENT)):
            file = ColoredFile(corners, np.array([[0, 1, 2]]), opacity)
            self._scene.add_glb(name, file.filled(corners, np.eye(3), white))

    # ------------------------------------------------------------------------------------- bodies
    def look_at(self, surface: Surface) -> None:
        """Point the cameras at the bodies and the ground below them."""
        low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
        width, height = (high - low)[:2].max(), (high - low)[2]
        if low[2] < 0.1 * height:
            high[2] += 2.0 * min(width, height)  # what lies on the ground may be lifted
        low[2] = min(low[2], 0.0)
        centre, reach = (low + high) / 2.0, max(float(np.linalg.norm(high - low)), 1e-3)
        position = centre + reach * np.array([0.55, -1.25, 0.35])
        camera = self._server.initial_camera
        camera.fov, camera.look_at, camera.position = 0.8, centre, position
        for client in self._server.get_clients().values():
            # in this order: setting a position also moves the target
            client.camera.position = position
            client.camera.fov, client.camera.look_at = 0.8, centre

    def set_bodies(self, surface: Surface, body: np.ndarray, colors: Mapping[int, Color]) -> None:
        """Set the bodies, and their colours by the numbers in `body`."""
        self._surface = surface
        self._parts = decoding.parts(surface, body, colors)
        self._file = None
        self._clear_bodies()

    def see_through(self, is_wanted: bool) -> None:
        """Let bodies be translucent, to show what is in them, or as they are."""
        self._opacity, self._file = TRANSLUCENT if is_wanted else 1.0, None
        for mesh, part in zip(self._meshes, self._parts, strict=False):
            mesh.opacity = self._opacity_of(part)

    def _opacity_of(self, part: Part) -> float | None:
        opacity = min(part.color[3] / 255.0, self._opacity)
        return opacity if opacity < 1.0 else None

    def _clear_bodies(self) -> None:
        for mesh in [*self._meshes, self._colored_mesh]:
            if mesh is not None:
                mesh.remove()
        self._meshes, self._colored_mesh = [], None

    def show(self, frame: Frame, values: np.ndarray | None, most: float) -> None:
        """Draw the bodies, coloured by values (n,) from 0 to `most`, or in their own colours."""
        if self._surface is None or not self._surface.fits(frame) or not self._surface.faces.size:
            return
        with self._server.atomic():
            if values is None:
                self._show_bodies(frame.positions)
            else:
                self._show_colored(frame.positions, decoding.heat(values, most))

    def _show_bodies(self, positions: np.ndarray) -> None:
        if self._meshes:
            for mesh, part in zip(self._meshes, self._parts, strict=True):
                mesh.vertices = positions[part.particles]
            return
        self._clear_bodies()
        self._meshes = [
            self._scene.add_mesh_simple(
                f'/bodies/{index}',
                positions[part.particles],
                part.faces,
                color=part.color[:3],
                opacity=self._opacity_of(part),
                side='double',
            )
            for index, part in enumerate(self._parts)
        ]

    def _show_colored(self, positions: np.ndarray, colors: np.ndarray) -> None:
        assert self._surface is not None
        shading = self._surface.shading
        if self._file is None:
            vertices = self._surface.vertices[shading.origin]
            self._file = ColoredFile(vertices, shading.faces, self._opacity)
        data = self._file.filled(
            positions[shading.origin], shading.normals(positions), colors[shading.origin]
        )
        if self._colored_mesh is None:
            self._clear_bodies()
            self._colored_mesh = self._scene.add_glb('/bodies/colored', data)
        else:
            self._colored_mesh.glb_data = data

    # ---------------------------------------------------------------------------------- obstacles
    def set_obstacles(self, markers: Iterable[Marker]) -> None:
        """Draw the obstacles, planes as grids; those that only moved are not rebuilt."""
        shown = {(m.ns, m.id): m for m in markers if m.action == Marker.ADD and _is_drawable(m)}
        for key, (appearance, node) in list(self._obstacles.items()):
            if key not in shown or appearance != _appearance(shown[key]):
                node.remove()
                del self._obstacles[key]
        for key, marker in shown.items():
            if key in self._obstacles:
                _, node = self._obstacles[key]
                node.position, node.wxyz = _pose(marker)
            else:
                self._added += 1
                node = self._add_obstacle(f'/obstacles/{self._added}', marker)
                self._obstacles[key] = _appearance(marker), node
        self._grid.visible = not any(marker.text == 'plane' for marker in shown.values())

    @property
    def grids(self) -> list[viser.GridHandle]:
        """The ground and the planes among the obstacles."""
        planes = [node for _, node in self._obstacles.values()]
        return [self._grid, *(node for node in planes if isinstance(node, viser.GridHandle))]

    def _add_obstacle(self, name: str, marker: Marker) -> Any:
        pose = dict(zip(('position', 'wxyz'), _pose(marker), strict=True))
        if marker.text == 'plane':
            return self._scene.add_grid(name, plane_opacity=1.0, **GRID, **pose)
        color = marker.color
        rgb = decoding.to_bytes((color.r, color.g, color.b))
        appearance: dict[str, Any] = {'color': rgb if color.a > 0.0 else NO_COLOR, **pose}
        if 0.0 < color.a < 1.0:
            appearance['opacity'] = color.a
        size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
        if marker.type == Marker.CUBE:
            return self._scene.add_box(name, dimensions=tuple(size), **appearance)
        if marker.type == Marker.SPHERE:
            return self._scene.add_icosphere(name, size[0] / 2.0, subdivisions=4, **appearance)
        if marker.type == Marker.CYLINDER:
            return self._scene.add_cylinder(
                name, size[0] / 2.0, size[2], radial_segments=64, **appearance
            )
        corners = np.array([(p.x, p.y, p.z) for p in marker.points], float).reshape(-1, 3)
        corners = corners[(np.abs(corners) <= FAR).all(axis=-1)]
        faces = np.arange(len(corners) // 3 * 3).reshape(-1, 3)
        return self._scene.add_mesh_simple(
            name, size * corners, faces, flat_shading=True, side='double', **appearance
        )


def _is_drawable(marker: Marker) -> bool:
    """Whether the numbers of a marker are finite, and its size positive."""
    (position, orientation), size, color = _pose(marker), marker.scale, marker.color
    numbers = [*position, *orientation, size.x, size.y, size.z, color.r, color.g, color.b, color.a]
    is_near = (np.abs(numbers) <= FAR).all()  # false for NaN
    return bool(is_near and any(orientation) and min(size.x, size.y, size.z) > 0.0)


def _pose(marker: Marker) -> tuple[Any, Any]:
    """Return position and quaternion, w first."""
    position, orientation = marker.pose.position, marker.pose.orientation
    return (position.x, position.y, position.z), (
        orientation.w,
        orientation.x,
        orientation.y,
        orientation.z,
    )


def _appearance(marker: Marker) -> Any:
    """Return everything but the pose, to recognise markers that only moved."""
    points = marker.points
    ends = [(p.x, p.y, p.z) for p in (*points[:1], *points[-1:])]
    return marker.type, marker.text, str(marker.scale), str(marker.color), len(points), ends
