"""The way out of a material without memory, in plain arithmetic: what a loop asks of a law in every tick of contact."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.models.contact_model import SLICE_BEYOND, SLICES, SLICES_BEYOND

__all__ = ["way_out"]


def way_out(force_at: Callable[[float], float], depth: float, offset: float, largest: float) -> tuple[float, float]:
    """`ContactModel.exit_work` of a law that has no force outside and remembers nothing, to the last bit.

    Args:
        force_at: Force at rest at a depth above 0 [N].
        depth: [m].
        offset: A constant beside the force [N].
        largest: The force counts as no more than this [N].

    Returns:
        The work [J], and the way on which there is any [m].
    """
    before = _felt(force_at, depth, offset, largest)
    energy = way = 0.0
    length = depth / SLICES
    if length > 0.0:
        for _ in range(SLICES):
            depth -= length
            after = _felt(force_at, depth, offset, largest)
            energy += 0.5 * (before + after) * length
            way += length
            before = after
    for _ in range(SLICES_BEYOND):
        if not before > 0.0:
            break
        depth -= SLICE_BEYOND
        after = _felt(force_at, depth, offset, largest)
        energy += 0.5 * (before + after) * SLICE_BEYOND
        way += SLICE_BEYOND
        before = after
    return energy, way


def _felt(force_at: Callable[[float], float], depth: float, offset: float, largest: float) -> float:
    force = force_at(depth) if depth > 0.0 else 0.0
    force = (force if force < largest else largest) + offset
    return force if force > 0.0 else 0.0
