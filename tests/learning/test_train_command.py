"""`labr-mission train`: data sets in, a weights' folder that flies out; resumed; bad input."""

import json

import pytest
from click.testing import CliRunner

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")
pytest.importorskip("tensorboard")

from learning_rig import shard  # noqa: E402

from labr_autonomy.cli import main  # noqa: E402
from labr_autonomy.gkpn.infer import GkpnOnnx  # noqa: E402
from labr_autonomy.gkpn.shards import write_manifest, write_shard  # noqa: E402

SETTINGS = """
name: tiny run
network: labr-unrevised
steps: 6
images: 4
goals: 4
save_every: 3
check_every: 3
teacher: {weight: 1.0}
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folders = {}
    for name, seeds in (("training", (1, 2)), ("validation", (11, 12))):
        folder = tmp_path_factory.mktemp(name)
        entries = []
        for seed in seeds:
            made = shard(seed=seed, views=8)
            digest = write_shard(folder / f"{seed}.npz", made)
            counts = {
                "views": 8,
                "goals": made.hard.size,
                "hard": int(made.hard.sum()),
                "air": int(made.in_air.sum()),
            }
            entries.append(
                {"file": f"{seed}.npz", "sha256": digest, "family": "hall", "seed": seed, **counts}
            )
        write_manifest(folder, {"made": "by a test"}, entries)
        folders[name] = folder
    return folders


def run(data, tmp_path, *more, settings=SETTINGS):
    path = tmp_path / "settings.yaml"
    path.write_text(settings)
    words = ["train", str(path), "--out", str(tmp_path / "run")]
    for name, folder in data.items():
        words += [f"--{name}", str(folder)]
    return CliRunner().invoke(main, [*words, *more])


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_run_leaves_weights_that_fly_and_goes_on_when_asked_again(data, tmp_path):
    result = run(data, tmp_path, "--json")
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    assert answer["training"]["steps"] == 6
    assert answer["metrics"]["network"]["paths"] == 2 * 8 * 8
    weights = tmp_path / "run" / "weights"
    assert GkpnOnnx(weights).takes_map
    before = (weights / "gkpn.onnx").read_bytes()
    again = run(data, tmp_path, "--quiet")
    assert again.exit_code == 0, again.output
    assert "unseen paths" in again.stdout
    assert (weights / "gkpn.onnx").read_bytes() == before  # nothing was left to learn
    assert list((tmp_path / "run" / "log").glob("events*"))


def test_a_changed_run_in_the_same_folder_is_refused(data, tmp_path):
    quick = SETTINGS.replace("steps: 6", "steps: 1").replace("weight: 1.0", "weight: 0.0")
    assert run(data, tmp_path, "--quiet", settings=quick).exit_code == 0
    refused = run(data, tmp_path, "--quiet", "--set", "seed=4", settings=quick)
    assert refused.exit_code == 2
    assert "another seed" in refused.output


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--set", "seed"), "has no value"),
        (("--set", "colour=red"), "colour"),
        (("--set", "network=x"), "no network"),
    ],
)
def test_bad_words_are_refused(data, tmp_path, more, words):
    refused = run(data, tmp_path, *more)
    assert refused.exit_code == 2
    assert words in refused.output


def test_a_folder_without_data_is_refused(tmp_path):
    refused = run({"training": tmp_path, "validation": tmp_path}, tmp_path)
    assert refused.exit_code == 2
    assert "no data set" in refused.output
