"""Rendering: from models and the hand's motion to a force that neither jerks nor drives the hand."""

from foretouch.rendering.energy import EnergyAccount, RenderingDevice, SpatialEnergyAccount
from foretouch.rendering.friction import FrictionRenderer
from foretouch.rendering.limits import LARGEST_FORCE, LARGEST_FORCE_RATE, ForceLimiter, rendered_share
from foretouch.rendering.mediation import LARGEST_STEP, Mediation
from foretouch.rendering.proxy import Proxy
from foretouch.rendering.renderer import Renderer
from foretouch.rendering.surfaces import (
    HeightField,
    OffsetSurface,
    Plane,
    Surface,
    SurfaceContact,
    SurfaceProxy,
    TriangleMesh,
    read_mesh,
)

__all__ = [
    "LARGEST_FORCE",
    "LARGEST_FORCE_RATE",
    "LARGEST_STEP",
    "EnergyAccount",
    "ForceLimiter",
    "FrictionRenderer",
    "HeightField",
    "Mediation",
    "OffsetSurface",
    "Plane",
    "Proxy",
    "Renderer",
    "RenderingDevice",
    "SpatialEnergyAccount",
    "Surface",
    "SurfaceContact",
    "SurfaceProxy",
    "TriangleMesh",
    "read_mesh",
    "rendered_share",
]
