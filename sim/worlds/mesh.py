"""Mesh files as worlds: .npz (V, F) by itself, .glb .gltf .obj .ply .stl .off .dae through trimesh."""

from __future__ import annotations

import math
import re
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.errors import BadInput
from sim.worlds.world import World, make_world

SUFFIXES = (".npz", ".glb", ".gltf", ".obj", ".ply", ".stl", ".off", ".dae")
WIDEST_M = 1000.0  # wider than this, a scale is missing (a COLLADA house in centimetres is 1.9 km wide)
SMALLEST_M = 1.0

# Rows turn file axes into x right, y away, z up.
_TURNS = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
# What readers of mesh files are known to raise on broken ones.
_BROKEN = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    NotImplementedError,
    OSError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    zipfile.BadZipFile,
)

Vertices = NDArray[np.floating[Any]]
Faces = NDArray[np.integer[Any]]


def load_mesh(path: Path, *, scale: float = 1.0, up: str | None = None, name: str | None = None) -> World:
    """Read a mesh file.

    Args:
        path: The file.
        scale: Metres per unit of the file; for COLLADA, on top of the file's own unit.
        up: Axis of the file that points up, "x", "y" or "z"; None takes what the format says: COLLADA's
            `up_axis`, y for glTF, z otherwise.
        name: Name of the world; the file's stem by default.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadInput(f"'{path.name}' is not a mesh file known here", f"Use one of {' '.join(SUFFIXES)}.")
    if not (math.isfinite(scale) and scale > 0.0):
        raise BadInput(f"the scale of '{path.name}' is {scale:g}", "Give metres per unit, above zero.")
    vertices, faces = _read_npz(path) if suffix == ".npz" else _read_trimesh(path)
    if suffix == ".dae":
        unit_m, declared = _collada_asset(path)
        scale *= unit_m
        up = up or declared
    up = up or ("y" if suffix in (".glb", ".gltf") else "z")
    if up not in _TURNS:
        raise BadInput(f"the up axis of '{path.name}' is '{up}'", "Give x, y or z.")
    _check(path, vertices, faces)
    world = make_world(name or path.stem, vertices.astype(np.float64) @ _TURNS[up].T * scale, faces, {})
    _check_size(path, world)
    return world


def _read_npz(path: Path) -> tuple[Vertices, Faces]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            if "V" not in data or "F" not in data:
                raise BadInput(
                    f"'{path.name}' lacks the arrays V and F", "V is (n, 3) corners, F (m, 3) faces."
                )
            return data["V"], data["F"]
    except _BROKEN as error:
        raise BadInput(
            f"'{path.name}' cannot be read: {_short(error)}", "Is it a whole .npz file?"
        ) from error


def _read_trimesh(path: Path) -> tuple[Vertices, Faces]:
    import trimesh  # takes 0.7 s: only when it is needed
    from collada.common import DaeError

    try:
        mesh = trimesh.load_scene(path, process=False).to_mesh()
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except (*_BROKEN, DaeError) as error:
        raise BadInput(f"'{path.name}' cannot be read: {_short(error)}", "Is the file whole?") from error
    return vertices, faces


def _short(error: Exception) -> str:
    return f"{type(error).__name__} {error}".strip().splitlines()[0][:160]


def _collada_asset(path: Path) -> tuple[float, str]:
    """Metres per unit and up axis that a COLLADA file declares (its <asset>); trimesh drops both."""
    head = path.read_bytes()[:65536].decode("utf-8", errors="replace")
    unit = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']([0-9.eE+-]+)[\"']", head)
    axis = re.search(r"<up_axis>\s*([XYZ])_UP", head)
    return (float(unit[1]) if unit else 1.0), (axis[1].lower() if axis else "y")


def _check(path: Path, vertices: Vertices, faces: Faces) -> None:
    """One sentence for each way in which arrays are no world."""
    for array, title, kind in ((vertices, "V", np.floating), (faces, "F", np.integer)):
        if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, kind):
            raise BadInput(
                f"{title} of '{path.name}' is {array.dtype} of shape {array.shape}",
                f"It must be (n, 3) {'floats' if kind is np.floating else 'integers'}.",
            )
    if len(vertices) == 0 or len(faces) == 0:
        raise BadInput(f"'{path.name}' holds no triangles", "Export the scene with its meshes.")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise BadInput(f"{bad} vertices of '{path.name}' are not finite", "Repair the mesh.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BadInput(
            f"faces of '{path.name}' name vertices {faces.min()}..{faces.max()} of {len(vertices)}",
            "Repair the mesh.",
        )


def _check_size(path: Path, world: World) -> None:
    widest = float((world.upper_m - world.lower_m).max())
    if not SMALLEST_M <= widest <= WIDEST_M:
        raise BadInput(
            f"'{path.name}' is {widest:.3g} m wide, which is no world to drive in",
            "Set `scale` to the metres per unit of the file (0.01 for centimetres).",
        )
