"""Surfaces in space (a plane, a field of heights, a mesh; for a sphere, offset), and the proxy that slides on them."""

from foretouch.rendering.surfaces.mesh import HeightField, TriangleMesh
from foretouch.rendering.surfaces.mesh_files import first_hit_from_above, read_mesh
from foretouch.rendering.surfaces.offset import OffsetSurface
from foretouch.rendering.surfaces.surface import Plane, Point, Surface, SurfaceContact, SurfaceProxy

__all__ = [
    "HeightField",
    "OffsetSurface",
    "Plane",
    "Point",
    "Surface",
    "SurfaceContact",
    "SurfaceProxy",
    "TriangleMesh",
    "first_hit_from_above",
    "read_mesh",
]
