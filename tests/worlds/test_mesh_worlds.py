from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from labr_autonomy.errors import BadInput
from sim.worlds.build import build_world, rebuild_world
from sim.worlds.mesh import load_mesh

V = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 0, 2]], np.float32)
F = np.array([[0, 1, 2], [0, 1, 3]], np.int32)
SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
HOUSE = SHARED / "data" / "worlds" / "aws_small_house" / "small_house.npz"


def save(folder, name="room.npz", **arrays):
    path = folder / name
    np.savez(path, **({"V": V, "F": F} | arrays))
    return path


def test_arrays_become_triangles_with_scale_and_bounds(tmp_path):
    world = load_mesh(save(tmp_path), scale=0.5)
    assert world.name == "room"
    assert world.upper_m.tolist() == [2.0, 1.5, 1.0]
    assert world.lower_m.tolist() == [0.0, 0.0, 0.0]
    assert world.triangles_m.shape == (2, 3, 3)
    assert world.faces.dtype == np.int32


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_up_axis_turns_without_mirroring(tmp_path, up):
    world = load_mesh(save(tmp_path), up=up)
    axis = "xyz".index(up)
    assert world.vertices_m[:, 2].tolist() == V[:, axis].tolist()
    assert np.linalg.det(world.vertices_m[1:]) == pytest.approx(np.linalg.det(V[1:]))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl", ".off"])
def test_mesh_formats_give_the_same_triangles(tmp_path, suffix):
    path = tmp_path / f"room{suffix}"
    scene = trimesh.Scene()
    moved = np.eye(4)
    moved[0, 3] = -1.0
    scene.add_geometry(trimesh.Trimesh(V + np.array([1, 0, 0]), F, process=False), transform=moved)
    (scene if suffix == ".glb" else scene.to_mesh()).export(path)
    world = load_mesh(path, up="z")
    assert np.sort(world.triangles_m.reshape(-1, 9), axis=0) == pytest.approx(
        np.sort(V[F].reshape(-1, 9), axis=0), abs=1e-6
    )


@pytest.mark.slow
def test_gltf_stands_on_y_unless_told(tmp_path):
    path = tmp_path / "room.glb"
    trimesh.Trimesh(V, F, process=False).export(path)
    assert load_mesh(path).upper_m[2] == 3.0
    assert load_mesh(path, up="z").upper_m[2] == 2.0


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00Z</created><modified>2020-01-01T00:00:00Z</modified>
<unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 400 0 0 400 300 0 0 0 200</float_array>
<technique_common><accessor source="#pa" count="4" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 1 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_collada_unit_and_up_axis_are_applied(tmp_path):
    path = tmp_path / "house.dae"
    path.write_text(COLLADA)
    world = load_mesh(path)
    assert world.upper_m == pytest.approx([4.0, 0.0, 3.0])
    assert world.lower_m == pytest.approx([0.0, -2.0, 0.0])


def test_what_is_wrong_with_arrays_is_said(tmp_path):
    holed = V.copy()
    holed[1, 1] = np.nan
    for arrays, said in (
        ({"V": holed}, "1 vertices of 'room.npz' are not finite"),
        ({"F": np.zeros((0, 3), np.int32)}, "no triangles"),
        ({"F": F + 2}, r"vertices 2\.\.5 of 4"),
        ({"F": -F}, r"vertices -3\.\.0"),
        ({"F": F.astype(float)}, "F of 'room.npz' is float64"),
        ({"V": V[:, :2]}, r"V of 'room.npz' is float32 of shape \(4, 2\)"),
        ({"V": V * 1000}, "4e\\+03 m wide"),
        ({"V": V * 0.01}, "0.04 m wide"),
    ):
        with pytest.raises(BadInput, match=said):
            load_mesh(save(tmp_path, **arrays))


def test_broken_files_are_said(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 not a zip")
    (tmp_path / "b.npz").write_bytes(b"")
    np.savez(tmp_path / "c.npz", X=V)
    np.savez(tmp_path / "e.npz", V=np.array([object()]), F=F)
    for name in "abe":
        with pytest.raises(BadInput, match=f"'{name}.npz' cannot be read"):
            load_mesh(tmp_path / f"{name}.npz")
    with pytest.raises(BadInput, match="lacks the arrays"):
        load_mesh(tmp_path / "c.npz")
    with pytest.raises(BadInput, match="not a mesh file known"):
        load_mesh(tmp_path / "d.step")
    for scale in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(BadInput, match="the scale of"):
            load_mesh(save(tmp_path), scale=scale)
    with pytest.raises(BadInput, match="up axis"):
        load_mesh(save(tmp_path), up="w")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl", ".dae", ".gltf"])
@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02 rubbish", b"solid {[<a"])
def test_broken_mesh_files_are_said(tmp_path, suffix, content):
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=f"'bad{suffix}'"):
        load_mesh(path)


def test_an_absent_mesh_names_its_public_source_and_the_option(tmp_path):
    with pytest.raises(BadInput) as caught:
        build_world({"mesh": "aws_small_house/small_house.npz"}, seed=0, worlds_dir=tmp_path)
    said = str(caught.value)
    assert "github.com/aws-robotics/aws-robomaker-small-house-world" in said
    assert "MIT-0" in said
    assert "--worlds DIR" in said
    assert str(tmp_path) in said
    with pytest.raises(BadInput, match="--worlds DIR"):
        build_world({"mesh": "mine.glb"}, seed=0, worlds_dir=tmp_path)


def test_the_folder_comes_from_the_environment(tmp_path, monkeypatch):
    save(tmp_path)
    monkeypatch.setenv("LABR_WORLDS", str(tmp_path))
    assert build_world({"mesh": "room.npz"}, seed=0).name == "room"


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ({}, "either a `family` or a `mesh`"),
        ({"family": "hall", "mesh": "a.npz"}, "either a `family` or a `mesh`"),
        ({"familly": "hall"}, "no field 'familly'"),
        ({"family": "hall", "size_m": [1]}, "size_m is"),
        ({"family": "hall", "size_m": 3}, "size_m is"),
        ({"mesh": "room.npz", "scale": "big"}, "scale of 'room.npz' is 'big'"),
    ],
)
def test_a_wrong_world_is_said(tmp_path, spec, said):
    save(tmp_path)
    with pytest.raises(BadInput, match=said):
        build_world(spec, seed=0, worlds_dir=tmp_path)


def test_a_mesh_world_can_be_made_again_from_json(tmp_path):
    save(tmp_path)
    first = build_world({"mesh": "room.npz", "scale": 2, "up": "Y"}, seed=3, worlds_dir=tmp_path)
    again = rebuild_world(json.loads(json.dumps(first.spec)))
    assert np.array_equal(again.triangles_m, first.triangles_m)
    assert again.spec == first.spec


@pytest.mark.slow
def test_a_generated_world_can_be_made_again_from_json():
    spec = {"family": "hall", "size_m": [9, 6]}
    first = build_world(spec, seed=3, clear_m=[(-2, 0, 0.0), (2, 1, 0)])
    again = rebuild_world(json.loads(json.dumps(first.spec)))
    assert np.array_equal(again.triangles_m, first.triangles_m)
    assert not np.array_equal(first.vertices_m, build_world(spec, seed=4).vertices_m)


@pytest.mark.slow
@pytest.mark.skipif(not HOUSE.exists(), reason="the small house is not beside the checkout")
def test_the_small_house_is_whole():
    world = build_world({"mesh": "aws_small_house/small_house.npz"}, seed=0, worlds_dir=HOUSE.parents[1])
    assert len(world.faces) == 146480
    assert world.lower_m == pytest.approx([-9.5, -5.7, 0.0], abs=0.01)
    assert world.upper_m == pytest.approx([9.5, 5.7, 3.0], abs=0.01)
