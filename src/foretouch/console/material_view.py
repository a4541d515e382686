"""The material in the picture: a cut block whose surface sinks under the tip, darker the deeper."""

from __future__ import annotations

from typing import Any

from foretouch.console import shapes
from foretouch.quantities.colours import CUT, DENT

__all__ = ["MaterialView", "add_body"]

SMALLEST_CHANGE = 0.002
"""Changes below this [scene units], 0.01 mm, are not drawn."""
LARGEST_DEPTH = 2.9
"""The picture of the block goes no deeper [scene units]."""
STEPS = (0.1, 0.4, 0.9, 1.5)
"""Of the dent's colours [scene units]: 0.5, 2, 4.5 and 7.5 mm."""


def add_body(
    scene: Any, name: str, mesh: shapes.Mesh, colour: tuple[int, int, int], opacity: float | None = None
) -> Any:
    """One coloured mesh of the scene.

    Args:
        scene: The viewer's.
        name: Path of the node.
        mesh: Vertices and triangles.
        colour: Of all of it.
        opacity: None for a body that nothing shows through.
    """
    return scene.add_mesh_simple(name, *mesh, color=colour, opacity=opacity, side="double", material="toon5")


class MaterialView:
    """The block of `shapes.Material`; its upper surface has the colour of how far it has sunk.

    Args:
        scene: The viewer's.
    """

    def __init__(self, scene: Any) -> None:
        self._material = shapes.Material()
        self._drawn_depth = 0.0
        top, cut = self._material.top(0.0), self._material.cut(0.0)
        self._tops = [
            add_body(scene, f"/line/material/top_{i}", (top, self._material.top_faces), colour)
            for i, colour in enumerate(DENT)
        ]
        for node in self._tops[1:]:
            node.visible = False
        self._cut = [
            add_body(scene, f"/line/material/cut_{i}", (cut, faces), colour)
            for i, (faces, colour) in enumerate(zip(self._material.layer_faces, CUT, strict=True))
        ]
        add_body(scene, "/line/material/sides", self._material.sides(), CUT[1])

    def draw(self, depth: float) -> None:
        """Sink under the tip at a depth [scene units]."""
        depth = min(max(depth, 0.0), LARGEST_DEPTH)
        if abs(depth - self._drawn_depth) < SMALLEST_CHANGE:
            return
        self._drawn_depth = depth
        top = self._material.top(depth)
        for node, faces in zip(self._tops, self._material.levels(depth, STEPS), strict=True):
            node.visible = len(faces) > 0
            if len(faces):
                node.vertices, node.faces = top, faces
        for node in self._cut:
            node.vertices = self._material.cut(depth)
