"""A number over two parameters, known at points: interpolated, with an estimate of the interpolation's error."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError

from workbench.core.values.arrays import Floats

__all__ = ["Surface"]

_LEAST = 4  # points of a surface
_RING = 3  # neighbours that a plane is fitted to


class Surface:
    """Linear interpolation in the triangles between points (Delaunay's), and how far it may be off.

    The error at a point is how far its value is off the plane through its neighbours (least squares), or the scatter of
    the neighbours about that plane, whichever is larger. For a smooth function that is the second difference over the
    distance to the neighbours, twice the triangle's; inside a triangle the largest of its corners counts. A detail
    between the points that none of them meets is not seen.

    Args:
        places: of the points, both coordinates scaled to 0 … 1, shape (n, 2).
        values: at the points, shape (n,).

    Raises:
        ValueError: fewer than four points, or all on one line.
    """

    def __init__(self, places: Floats, values: Floats) -> None:
        if len(places) < _LEAST:
            raise ValueError("a surface takes at least four points")
        try:
            self._mesh = Delaunay(places)
        except QhullError:
            raise ValueError("all points are on one line") from None
        self._values = values
        self._linear = LinearNDInterpolator(self._mesh, values)
        self._errors = self._at_points()

    def _at_points(self) -> Floats:
        pointers, neighbours = self._mesh.vertex_neighbor_vertices
        places, count = self._mesh.points, len(self._mesh.points)
        ring = np.diff(pointers)
        own = np.repeat(np.arange(count), ring)
        rows = np.column_stack([np.ones(len(own)), places[neighbours] - places[own]])
        values = self._values[neighbours] - self._values[own]
        squares = np.zeros((count, 3, 3))
        np.add.at(squares, own, rows[:, :, None] * rows[:, None, :])
        right = np.zeros((count, 3))
        np.add.at(right, own, rows * values[:, None])
        planes = np.einsum("kij,kj->ki", np.linalg.pinv(squares, hermitian=True), right)
        residues = np.zeros(count)
        np.add.at(residues, own, (np.einsum("ij,ij->i", rows, planes[own]) - values) ** 2)
        result = np.maximum(np.abs(planes[:, 0]), np.sqrt(residues / ring))
        corners = ring < _RING  # three points fit any plane: a corner is as uncertain as its neighbours
        near = np.zeros(count)
        np.maximum.at(near, own, np.where(corners[neighbours], 0.0, result[neighbours]))
        usual = float(np.max(result[~corners], initial=0.0)) if not corners.all() else float(np.ptp(self._values))
        return np.where(corners, np.where(near > 0.0, near, usual), result)

    def __call__(self, places: Floats) -> tuple[Floats, Floats]:
        """Return value and error at places, shape (m,) each; NaN outside of the points.

        Args:
            places: shape (m, 2).
        """
        triangles = self._mesh.find_simplex(places)
        values = np.asarray(self._linear(places), dtype=np.float64)
        errors = self._errors[self._mesh.simplices[triangles]].max(axis=1)
        return values, np.where(triangles < 0, np.nan, errors)
