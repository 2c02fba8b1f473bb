"""The loop: deterministic, resumable to the bit, chooses by flights, the same on two processes."""

import json
import multiprocessing
import os
import socket

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from learning_rig import shard  # noqa: E402

from labr_autonomy.errors import BadInput  # noqa: E402
from labr_autonomy.gkpn.learning import train as loop  # noqa: E402
from labr_autonomy.gkpn.learning.cost import Cost  # noqa: E402
from labr_autonomy.gkpn.learning.machine import Machine, find_machine  # noqa: E402
from labr_autonomy.gkpn.learning.settings import Settings, read_settings  # noqa: E402
from labr_autonomy.gkpn.learning.spoiled import KINDS  # noqa: E402
from labr_autonomy.gkpn.learning.step import draw, step_losses  # noqa: E402
from labr_autonomy.gkpn.learning.teacher import taught  # noqa: E402
from labr_autonomy.gkpn.learning.views import join  # noqa: E402
from labr_autonomy.gkpn.networks import presets  # noqa: E402
from labr_autonomy.gkpn.networks.config import (  # noqa: E402
    AttentionConfig,
    MapConfig,
    NetworkConfig,
    PerceptionConfig,
)
from labr_autonomy.gkpn.networks.planner import build  # noqa: E402

SMALL = PerceptionConfig(stem=4, stem_px=5, stages=(8, 8), blocks=(1, 1), strides=(2, 2))
TINY = NetworkConfig(
    45,
    80,
    SMALL,
    AttentionConfig(embed=8, tail=8, hidden=(32, 32), fear=8),
    MapConfig(PerceptionConfig(edges=False, stem=4, stages=(8,), blocks=(1,), strides=(2,)), embed=8, tail=4),
    hypotheses=2,
)
ALONE = Machine(torch.device("cpu"), 0, 1, False)


class Notes:
    """Listens and remembers."""

    def __init__(self):
        self.totals, self.checks, self.flights = [], [], []

    def step(self, done, parts, rate):
        self.totals.append((done, parts["total"]))

    def check(self, done, figures):
        self.checks.append((done, figures))

    def flown(self, done, share):
        self.flights.append((done, share))


@pytest.fixture(autouse=True)
def _tiny(monkeypatch):
    monkeypatch.setitem(presets.NETWORKS, "tiny", TINY)


@pytest.fixture(scope="module")
def lesson():
    size = (80, 45)
    training = join([shard(seed=s, views=16, size=size) for s in (1, 2)])
    return loop.Lesson(
        training, join([shard(seed=9, views=8, size=size), shard(seed=10, views=8, size=size)])
    )


def settings(**changed):
    return Settings(
        **{
            "name": "t",
            "network": "tiny",
            "steps": 12,
            "images": 6,
            "goals": 4,
            "save_every": 4,
            "check_every": 12,
        }
        | changed
    )


def weights(net):
    return torch.cat([p.detach().flatten() for p in net.state_dict().values()]).numpy()


def test_a_run_follows_from_its_seed_and_goes_on_as_if_never_stopped(lesson, tmp_path):
    whole = weights(loop.train(lesson, settings(), tmp_path / "a", ALONE, Notes()))

    class Stop(Notes):
        def step(self, done, parts, rate):
            if done == 7:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        loop.train(lesson, settings(), tmp_path / "b", ALONE, Stop())
    notes = Notes()
    again = weights(loop.train(lesson, settings(), tmp_path / "b", ALONE, notes))
    assert notes.totals[0][0] == 5  # from the checkpoint after step 4
    np.testing.assert_array_equal(whole, again)
    other = weights(loop.train(lesson, settings(seed=1), tmp_path / "c", ALONE, Notes()))
    assert np.abs(whole - other).max() > 1e-3


def test_other_settings_in_the_same_folder_are_refused(lesson, tmp_path):
    loop.train(lesson, settings(steps=4), tmp_path, ALONE, Notes())
    with pytest.raises(BadInput, match="another rate"):
        loop.train(lesson, settings(steps=4, rate=0.5), tmp_path, ALONE, Notes())


def test_it_learns(lesson, tmp_path):
    notes = Notes()
    loop.train(lesson, settings(steps=150, images=12, save_every=500), tmp_path, ALONE, notes)
    first, last = notes.totals[9][1], notes.totals[-1][1]
    assert last < 0.8 * first
    figures = notes.checks[-1][1]
    assert figures["paths"] == 16 * 8
    assert 0.0 <= figures["mu_calibration_error"] <= 1.0


def test_the_best_is_what_flew_best(lesson, tmp_path):
    shares = iter([0.2, 0.9, 0.4])
    seen = []

    def fly(net):
        seen.append(weights(net))
        return next(shares)

    chosen = loop.train(lesson, settings(closed_loop={"every": 4}), tmp_path, ALONE, Notes(), fly)
    np.testing.assert_array_equal(weights(chosen), seen[1])
    assert np.abs(seen[2] - seen[1]).max() > 0.0


def test_each_way_of_spoiling_makes_another_image_of_the_same_size(lesson):
    image = lesson.training.images_m(np.array([0]))[0]
    rng = np.random.default_rng(0)
    made = {name: spoil(image, rng) for name, spoil in KINDS.items()}
    for one in made.values():
        assert one.shape == image.shape
        assert not torch.equal(one, image)
    assert torch.equal(made["upside_down"].flip(-2), image)
    h, w = (side // 4 for side in image.shape[-2:])
    kept = made["torn"][:, : 4 * h, : 4 * w].flatten().sort().values
    assert torch.equal(kept, image[:, : 4 * h, : 4 * w].flatten().sort().values)


def test_spoiled_frames_are_to_be_feared_and_teach_no_path(lesson):
    every = settings(spoiled=1.0)
    batch = draw(lesson.training, None, 0, every, ALONE)
    assert batch.spoiled.all()
    net = loop.Learner(build(TINY))
    out = step_losses(net, batch, lesson.training, every, ALONE, 0.0)
    assert float(out.parts["obstacle"].detach()) == 0.0
    out.total.backward()
    path = net.net.heads.path[2].weight.grad
    assert path.abs().max() == 0.0
    assert net.net.heads.fear[2].weight.grad.abs().max() > 0.0


def test_a_mirrored_view_costs_what_the_view_costs(lesson):
    plain = settings(spoiled=0.0, unmapped=0.0)
    batch = draw(lesson.training, None, 3, plain, ALONE)
    half = len(batch.mirror) // 2
    assert (batch.mirror[:half, 1] == -1.0).all()

    class Line(torch.nn.Module):
        def forward(self, images, maps, goal, floor):
            share = (torch.arange(1, 6) / 5.0)[None, None, :, None]
            return [goal[:, None, None, :] * share], torch.zeros(len(goal), 1)

    out = step_losses(Line(), batch, lesson.training, plain, ALONE, 0.0)
    assert float(out.parts["goal"].detach()) < 0.2  # a goal on the wrong side would be metres off


def test_the_winner_learns_and_the_others_a_little(lesson):
    class Two(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.off = torch.nn.Parameter(torch.tensor([0.0, 0.8]))

        def forward(self, images, maps, goal, floor):
            share = (torch.arange(1, 6) / 5.0)[None, None, :, None]
            short = 1.0 - 0.5 * self.off[None, :, None, None]
            return [goal[:, None, None, :] * share * short], torch.zeros(len(goal), 2)

    batch = draw(lesson.training, None, 0, settings(spoiled=0.0), ALONE)

    def pushed(others):
        net = Two()
        how = settings(spoiled=0.0, others=others)
        step_losses(net, batch, lesson.training, how, ALONE, 0.0).total.backward()
        return net.off.grad.numpy()

    alone = pushed(0.0)
    little, more = pushed(0.05) - alone, pushed(0.5) - alone
    assert abs(alone[0]) > 0.1  # the straight one wins where the way is free
    np.testing.assert_allclose(more, 10.0 * little, rtol=1e-3)
    assert abs(more[1]) > 1.0  # the other learns where it lost, too


def test_a_path_learns_before_its_last_revision_as_well(lesson):
    class Revised(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.off = torch.nn.Parameter(torch.tensor([0.3, 0.3]))

        def forward(self, images, maps, goal, floor):
            share = (torch.arange(1, 6) / 5.0)[None, None, :, None]
            every = [goal[:, None, None, :] * share * (1.0 - off) for off in self.off]
            return every, torch.zeros(len(goal), 1)

    batch = draw(lesson.training, None, 0, settings(spoiled=0.0), ALONE)

    def pushed(early):
        net = Revised()
        how = settings(spoiled=0.0, early=early)
        step_losses(net, batch, lesson.training, how, ALONE, 0.0).total.backward()
        return net.off.grad.numpy()

    first, last = pushed(0.25)
    assert first == pytest.approx(0.25 * last, rel=1e-4)
    assert pushed(0.0)[0] == 0.0
    assert abs(last) > 0.1


def test_a_teacher_is_asked_once(lesson, tmp_path):
    asked = []
    first = taught(lesson.training, Cost(), tmp_path, asked.append)
    assert sum(asked) == int(lesson.training.hard.sum())
    again = taught(lesson.training, Cost(), tmp_path, lambda _: pytest.fail("asked again"))
    np.testing.assert_array_equal(first, again)
    batch = draw(lesson.training, first, 0, settings(spoiled=0.0), ALONE)
    with_teacher = step_losses(
        loop.Learner(build(TINY)), batch, lesson.training, settings(spoiled=0.0), ALONE, 1.0
    )
    assert float(with_teacher.parts["teacher"].detach()) > 0.1
    taper = settings(teacher={"weight": 2.0, "until": 0.5}, steps=100)
    assert [loop.teacher_at(s, taper) for s in (0, 25, 50, 80)] == [2.0, 1.0, 0.0, 0.0]


def _half(rank, port, folder, lesson):
    os.environ |= {"RANK": str(rank), "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
    presets.NETWORKS["tiny"] = TINY
    machine = find_machine("float32", 1)
    net = loop.train(lesson, settings(steps=3), folder / "run", machine, Notes())
    np.save(folder / f"{rank}.npy", torch.cat([p.detach().flatten() for p in net.parameters()]).numpy())
    torch.distributed.destroy_process_group()


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_two_processes_learn_one_network(lesson, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    both = multiprocessing.get_context("spawn")
    workers = [both.Process(target=_half, args=(rank, port, tmp_path, lesson)) for rank in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(110)
        assert worker.exitcode == 0
    one, two = (np.load(tmp_path / f"{rank}.npy") for rank in range(2))
    np.testing.assert_array_equal(one, two)
    torch.manual_seed(0)
    fresh = torch.cat([p.detach().flatten() for p in build(TINY).parameters()]).numpy()
    assert np.abs(one - fresh).max() > 1e-4  # and it has moved


def test_a_step_on_two_processes_draws_other_views(lesson):
    left, right = (
        draw(lesson.training, None, 0, settings(), Machine(ALONE.device, r, 2, False)) for r in (0, 1)
    )
    assert len(left.images_m) == len(right.images_m) == 3
    assert not torch.equal(left.asked.view, right.asked.view)


def test_recipes_can_be_read_by_name():
    from pathlib import Path

    for name in ("shipped", "table1", "iplanner"):
        assert read_settings(Path(name)).steps > 100


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: x\nnetwork: nonesuch\n", "there is no network 'nonesuch'"),
        ("name: x\nnetwork: labr\nstepz: 3\n", "stepz"),
        ("name: x\nnetwork: labr\nsteps: -3\n", "steps"),
        ("name: x\nnetwork: labr\nweights: {heigth: 1.0}\n", "weights.heigth"),
        ("name: [x\n", "not YAML"),
        ("- 3\n", "holds no settings"),
    ],
)
def test_bad_settings_are_refused_in_one_sentence(tmp_path, text, words):
    path = tmp_path / "s.yaml"
    path.write_text(text)
    with pytest.raises(BadInput, match=words):
        read_settings(path)


def test_settings_that_are_not_there_name_the_recipes(tmp_path):
    with pytest.raises(BadInput, match="shipped"):
        read_settings(tmp_path / "none.yaml")


def test_the_log_can_be_read_by_tensorboard(tmp_path):
    pytest.importorskip("tensorboard")
    from labr_autonomy.gkpn.learning.report import BoardLog

    log = BoardLog(tmp_path)
    log.step(20, {"total": 1.5}, 1e-3)
    log.check(20, {"reached": 0.5, "by": {"x": 1}})
    log.flown(20, 0.25)
    log.close()
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path))
    events.Reload()
    assert set(events.Tags()["scalars"]) == {
        "loss/total",
        "rate",
        "validation/reached",
        "closed_loop/reached",
    }
    assert json.dumps(events.Scalars("loss/total")[0].value) == "1.5"
