"""STUB, replaced by the real one."""
from dataclasses import dataclass
import numpy as np
from scipy.spatial import cKDTree


@dataclass(frozen=True, eq=False)
class NearestFaces:
    origin: np.ndarray
    cell: float
    shape: np.ndarray
    face: np.ndarray

    def nearest(self, points):
        index = np.floor((points - self.origin) * (1.0 / self.cell)).astype(np.int64)
        inside = ((index >= 0) & (index < self.shape)).all(axis=1)
        flat = (index[:, 0] * self.shape[1] + index[:, 1]) * self.shape[2] + index[:, 2]
        return np.where(inside, self.face[np.where(inside, flat, 0)], -1)


def nearest_faces(surface):
    v, f = surface.vertices, surface.faces
    lo, hi = v.min(0), v.max(0)
    cell = (hi - lo).max() / 32
    origin = lo - 2 * cell
    shape = np.ceil((hi - lo) / cell).astype(int) + 4
    grid = np.stack(np.meshgrid(*(np.arange(k) for k in shape), indexing='ij'), -1).reshape(-1, 3)
    tri = v[f]
    samples = np.concatenate([tri.mean(1)] + [tri @ np.array(w) if 0 else np.einsum('fij,i->fj', tri, np.array(w)) for w in ((.6,.2,.2),(.2,.6,.2),(.2,.2,.6),(.9,.05,.05),(.05,.9,.05),(.05,.05,.9))])
    _, k = cKDTree(samples).query(origin + (grid + .5) * cell)
    return NearestFaces(origin, cell, shape, k % len(f))
