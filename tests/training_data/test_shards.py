"""The format on disk: what is written is read, and what is damaged is refused in one sentence."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.local_map import CHANNELS, SIDE
from labr_autonomy.gkpn.shards import (
    LAND_SIDE,
    MANIFEST,
    Shard,
    read_folder,
    read_manifest,
    read_shard,
    write_manifest,
    write_shard,
)


@pytest.fixture
def shard():
    rng = np.random.default_rng(4)
    v, k = 3, 4
    land = (v, LAND_SIDE, LAND_SIDE)
    return Shard(
        images_mm=rng.integers(0, 10_000, (v, 9, 16)).astype(np.uint16),
        maps=rng.integers(0, 256, (v, CHANNELS, SIDE * SIDE // 8)).astype(np.uint8),
        poses=rng.random((v, 6), dtype=np.float32),
        floor_m=np.zeros(v, np.float32),
        goals_m=rng.random((v, k, 3), dtype=np.float32),
        in_air=rng.random((v, k)) < 0.5,
        hard=rng.random((v, k)) < 0.5,
        land_cm=rng.integers(-127, 128, land).astype(np.int8),
        floors_cm=rng.integers(-300, 300, land).astype(np.int16),
        land_corner_m=rng.random((v, 2), dtype=np.float32),
        air_cm=rng.integers(-127, 128, (5, 6, 7)).astype(np.int8),
        air_origin_m=rng.random(3, dtype=np.float32),
        air_cell_m=0.1,
        family="rooms",
        seed=1_000_000,
    )


def entry(name, sha256, shard):
    counts = {"goals": shard.in_air.size, "hard": int(shard.hard.sum()), "air": int(shard.in_air.sum())}
    told = {"family": shard.family, "seed": shard.seed, "views": len(shard.poses)}
    return {"file": name, "sha256": sha256, **told, **counts}


@pytest.fixture
def folder(tmp_path, shard):
    entries = [entry(f"{n}.npz", write_shard(tmp_path / f"{n}.npz", shard), shard) for n in ("b", "a")]
    write_manifest(tmp_path, {"kind": "test"}, entries)
    return tmp_path


def test_a_shard_comes_back_as_it_was_and_leaves_no_other_file(tmp_path, shard):
    write_shard(tmp_path / "one.npz", shard)
    again = read_shard(tmp_path / "one.npz")
    for field in fields(Shard):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(shard, field.name))
        assert type(getattr(again, field.name)) is type(getattr(shard, field.name))
    assert [path.name for path in tmp_path.iterdir()] == ["one.npz"]


def test_the_same_shard_has_the_same_bytes(tmp_path, shard):
    assert write_shard(tmp_path / "one.npz", shard) == write_shard(tmp_path / "two.npz", shard)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


@pytest.mark.parametrize("keep", [0, 40, 0.5, 0.98])
def test_a_shard_cut_short_is_refused(tmp_path, shard, keep):
    path = tmp_path / "one.npz"
    write_shard(path, shard)
    data = path.read_bytes()
    path.write_bytes(data[: keep if isinstance(keep, int) else int(keep * len(data))])
    with pytest.raises(BadInput, match=r"one\.npz is damaged"):
        read_shard(path)


def test_a_flipped_byte_is_found(tmp_path, shard):
    path = tmp_path / "one.npz"
    write_shard(path, shard)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(BadInput, match="damaged"):
        read_shard(path)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("goals_m", np.zeros((3, 5, 3), np.float32), "'goals_m' has shape"),
        ("maps", np.zeros((3, CHANNELS, 9), np.uint8), "'maps' has shape"),
        ("land_cm", np.zeros((3, LAND_SIDE, LAND_SIDE), np.int16), "'land_cm' is int16"),
        ("images_mm", np.zeros((2, 9, 16), np.uint16), "'images_mm' has shape"),
        ("air_cell_m", 0.0, "no size"),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(tmp_path, shard, name, values, words):
    write_shard(tmp_path / "one.npz", replace(shard, **{name: values}))
    with pytest.raises(BadInput, match=words):
        read_shard(tmp_path / "one.npz")


def test_other_files_and_formats_are_refused(tmp_path, shard):
    with pytest.raises(BadInput, match="there is no shard"):
        read_shard(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(BadInput, match="format -1"):
        read_shard(tmp_path / "other.npz")
    np.savez(tmp_path / "less.npz", format=1, maps=np.zeros(3))
    with pytest.raises(BadInput, match="its arrays are maps"):
        read_shard(tmp_path / "less.npz")


def test_a_folder_lists_its_shards_and_their_counts(folder, shard):
    assert read_folder(folder) == [folder / "a.npz", folder / "b.npz"]
    manifest = read_manifest(folder)
    assert manifest["counts"]["goals"] == 24
    assert manifest["counts"]["hard_share"] == pytest.approx(shard.hard.mean(), abs=1e-4)
    assert manifest["families"] == {"rooms": 2}


def test_a_folder_with_a_damaged_or_missing_shard_is_refused(folder):
    path = folder / "b.npz"
    data = path.read_bytes()
    path.write_bytes(data[:-1] + b"x")
    with pytest.raises(BadInput, match=r"b\.npz is damaged.*Delete it and run"):
        read_folder(folder)
    path.unlink()
    with pytest.raises(BadInput, match=r"b\.npz is missing"):
        read_folder(folder)


def test_a_folder_without_a_good_manifest_is_refused(folder, tmp_path):
    path = folder / MANIFEST
    manifest = json.loads(path.read_text())
    for spoil, words in (({"sha256": "0"}, "damaged"), ({"format": 9}, "format 9")):
        path.write_text(json.dumps({**manifest, **spoil}))
        with pytest.raises(BadInput, match=words):
            read_folder(folder)
    path.write_text("{")
    with pytest.raises(BadInput, match="damaged"):
        read_folder(folder)
    path.unlink()
    with pytest.raises(BadInput, match="there is no data set"):
        read_folder(folder)
