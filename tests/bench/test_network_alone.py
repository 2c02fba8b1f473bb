"""A network alone in the loop: it gets where it says, and nothing saves it from what it says."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil

import bench_fakes as fakes
import numpy as np
import pytest
from click.testing import CliRunner

from labr_autonomy import cli
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput, Refused
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.gkpn.local_map import CHANNELS, SIDE
from labr_autonomy.gkpn.package import MANIFEST_NAME, packaged_dir
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.types import DepthFrame, Mode, Pose, Source
from sim.bench import gallery, jobs, methods, run
from sim.bench.alone import validate
from sim.bench.alone.flyer import fly_along
from sim.bench.alone.planner import LOWEST_M, AlonePlanner
from sim.bench.alone.validate import closed_loop, fly_on_land
from sim.bench.iplanner.planner import AFRAID, BEARING_MAX_RAD
from sim.bench.settings import open_folder
from sim.lockstep.run import Stage, fly_with
from sim.lockstep.trial import Task
from sim.worlds.build import build_world

ROBOT = RobotConfig()
CAMERA = ROBOT.camera.intrinsics
BELOW_M = ROBOT.body.below_m
SHARES = np.linspace(0.2, 1.0, 5)[:, None]


class Line:
    """Straight to the goal on the floor and up at its end; or aside by a share `bend` of the way."""

    takes_map, range_m = False, 9.0

    def __init__(self, mu=0.0, bend=0.0, heights_m=None):
        self.mu, self.bend, self.heights_m, self.goals = mu, bend, heights_m, []

    def predict(self, depth_m, intrinsics, goal_level_m, seen=None, floor_m=0.0):
        self.goals.append(goal_level_m)
        keys = SHARES * [goal_level_m[0], goal_level_m[1], 0.0]
        keys += self.bend * np.sin(math.pi * SHARES) * [-goal_level_m[1], goal_level_m[0], 0.0]
        keys[-1, 2] = goal_level_m[2]
        if self.heights_m is not None:
            keys[:, 2] = self.heights_m
        return keys, self.mu, 0.0


class MapLine(Line):
    """The same, shown a map as well."""

    takes_map, range_m = True, 6.0
    seen = None

    def predict(self, depth_m, intrinsics, goal_level_m, seen=None, floor_m=0.0):
        self.seen, self.floor_m = seen, floor_m
        return super().predict(depth_m, intrinsics, goal_level_m, seen, floor_m)


# ---------------------------------------------------------------- whole flights
@pytest.fixture(autouse=True)
def _empty_stage():
    yield
    if Stage._last is not None:
        Stage._last.close()
        Stage._last = None


def fly(network, goal, *, in_air=False):
    start = (-3.0, 0.0, 0.0, 0.0)
    body = (start[0], start[1], BELOW_M)
    world = build_world({"family": "hall", "size_m": [9, 6]}, seed=4, clear_m=[body, (1.0, 1.0, BELOW_M)])
    away = math.dist(body, goal)
    task = Task(world.spec, 4, start, goal, in_air, False, away, away, 700.0, 8.0)
    return fly_with(task, AlonePlanner(ROBOT, network), ROBOT)


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_a_straight_network_reaches_a_goal_on_the_floor_and_one_that_swerves_goes_farther():
    straight, bent = (fly(Line(bend=bend), (1.0, 1.0, BELOW_M)) for bend in (0.0, -0.2))
    assert straight.outcome == bent.outcome == "reached"
    assert straight.air_m == bent.air_m == 0.0
    assert straight.land_m < bent.land_m < 1.4 * straight.land_m
    assert set(straight.sources) == {"gkpn"}


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_it_takes_off_below_a_goal_in_the_air_and_hovers_at_it():
    result = fly(Line(), (1.0, 1.0, 1.6), in_air=True)
    assert result.outcome == "reached", result.events
    assert result.land_m > 3.0  # as long as the key points stay on the floor
    assert result.air_m > 1.0
    assert result.goal_error_m < 0.25


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_a_network_that_lifts_off_early_flies_along_its_spline_and_lands_at_a_goal_on_the_floor():
    result = fly(Line(heights_m=[0.0, 0.8, 0.8, 0.8, 0.0]), (1.0, 1.0, BELOW_M))
    assert result.outcome == "reached", result.events
    assert result.air_m > 2.0
    assert 0.3 < result.land_m < 2.5
    assert result.track[-1][4] == 0
    assert any("touchdown" in sentence for _, sentence in result.events)


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_no_hidden_map_saves_it_from_a_wall():
    result = fly(Line(), (7.0, 0.4, BELOW_M))
    assert result.outcome == "contact"
    assert result.min_clearance_m <= 0.0


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_fear_stops_it():
    result = fly(Line(mu=1.0), (1.0, 1.0, BELOW_M))
    assert result.outcome == "timeout"
    assert result.land_m < 0.4
    assert result.sources["brake"] > 0.9 * result.plans


# ---------------------------------------------------------------- one cycle
def request(
    goal, *, at=(0.0, 0.0, BELOW_M), mode=Mode.LAND, in_air=False, velocity=(0.0, 0.0, 0.0), **changes
):
    place = np.array(at, float)
    pose = Pose(place, quaternion_from_rpy(0.0, 0.0, 0.0))
    values = dict(
        sequence=0,
        frame_sequence=0,
        frame_pose=pose,
        body_pose=pose,
        start_s=10.0,
        motion=Motion(place, np.array(velocity), np.zeros(3), 0.0, 0.0, velocity[0]),
        mode=mode,
        goal_m=np.array(goal, float),
        goal_in_air=in_air,
        floor_z_m=0.0,
        lift_to_m=1.0,
    )
    return PlanRequest(**{**values, **changes})


def frame(sequence=0):
    return DepthFrame(sequence, 9.9, np.full((CAMERA.height, CAMERA.width), 5.0, np.float32), CAMERA)


def test_the_driven_part_ends_before_the_first_key_point_in_the_air():
    planner = AlonePlanner(ROBOT, Line(heights_m=[0.0, 0.1, 0.2, 0.9, 1.4]))
    plan = planner.cycle(request([5.0, 0.0, 1.52], in_air=True), frame())
    assert plan.network.air.tolist() == [False, False, False, True, True]
    assert plan.lift_off_m == pytest.approx(3.0)
    assert plan.trajectory.mode is Mode.LAND
    assert plan.trajectory.position_m[-1, 0] == pytest.approx(2.85, abs=0.1)
    assert plan.take_off_clear
    assert not plan.landing_clear
    up = AlonePlanner(ROBOT, Line(heights_m=[0.5, 0.8, 0.9, 1.0, 1.4]))
    here = up.cycle(request([5.0, 0.0, 1.52], in_air=True), frame())
    assert here.lift_off_m == 0.0
    assert np.abs(here.trajectory.speed_mps).max() == 0.0


def test_a_network_of_land_alone_never_leaves_the_floor():
    planner = AlonePlanner(ROBOT, Line(heights_m=[0.5] * 5), drives_only=True)
    plan = planner.cycle(request([4.0, 0.0, 0.0]), frame())
    assert not plan.network.air.any()
    assert math.isinf(plan.lift_off_m)
    assert not plan.hop
    assert plan.trajectory.position_m[-1, 0] > 3.5


def test_only_a_way_to_the_floor_that_leaves_it_is_a_hop():
    hop = [0.0, 0.8, 0.8, 0.8, 0.0]
    assert AlonePlanner(ROBOT, Line(heights_m=hop)).cycle(request([4.0, 0.0, 0.0]), frame()).hop
    assert not AlonePlanner(ROBOT, Line()).cycle(request([4.0, 0.0, 0.0]), frame()).hop


def test_goals_are_shown_at_the_edge_and_those_on_the_floor_at_driving_height():
    network = Line()
    planner = AlonePlanner(ROBOT, network)
    planner.cycle(request([20.0, 0.0, 0.7]), frame())
    planner.cycle(request([20.0, 0.0, 1.62], at=(0.0, 0.0, 1.0), mode=Mode.AIR, in_air=True), frame(1))
    planner.cycle(request([-5.0, 0.1, 0.0]), frame(2))
    np.testing.assert_allclose(network.goals[0], [9.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(network.goals[1], [9.0, 0.0, 0.62], atol=1e-9)
    assert math.atan2(*network.goals[2][1::-1]) == pytest.approx(BEARING_MAX_RAD)


def test_in_the_air_the_spline_is_flown_and_a_goal_on_the_floor_is_landed_on_when_over_it():
    flying = dict(at=(0.0, 0.0, 1.0), mode=Mode.AIR)
    plan = AlonePlanner(ROBOT, Line()).cycle(request([5.0, 1.0, 1.6], in_air=True, **flying), frame())
    assert plan.trajectory.mode is Mode.AIR
    np.testing.assert_allclose(plan.trajectory.position_m[-1], [5.0, 1.0, 1.6], atol=0.02)
    down = AlonePlanner(ROBOT, Line()).cycle(request([3.0, 0.0, 0.0], **flying), frame())
    assert not down.landing_clear
    assert down.trajectory.position_m[:, 2].min() == pytest.approx(LOWEST_M, abs=0.05)
    over = AlonePlanner(ROBOT, Line()).cycle(request([0.2, 0.0, 0.0], **flying), frame())
    assert over.landing_clear
    assert over.source is Source.DIRECT
    np.testing.assert_allclose(over.trajectory.position_m[-1], [0.2, 0.0, 1.0], atol=0.02)


def test_fear_brakes_a_flight_and_forbids_a_take_off():
    planner = AlonePlanner(ROBOT, Line(mu=0.9))
    flying = dict(at=(0.0, 0.0, 1.0), mode=Mode.AIR, in_air=True, velocity=(1.0, 0.0, 0.0))
    plans = [planner.cycle(request([6.0, 0.0, 1.0], **flying), frame(k)) for k in range(4)]
    assert [p.source for p in plans] == [Source.GKPN] * 3 + [Source.BRAKE]
    assert plans[3].reason == AFRAID
    assert plans[3].trajectory.position_m[-1, 0] < 1.0
    assert not plans[3].take_off_clear


def test_what_is_no_path_is_feared():
    class Broken(Line):
        def predict(self, *given):
            return np.full((5, 3), np.nan), 0.0, 0.0

    planner = AlonePlanner(ROBOT, Broken())
    plans = [planner.cycle(request([4.0, 0.0, 0.0]), frame(k)) for k in range(4)]
    assert plans[-1].source is Source.BRAKE
    assert all(np.isfinite(p.trajectory.position_m).all() for p in plans)


def test_a_network_that_fears_the_whole_way_is_asked_for_its_beginning():
    class Timid(Line):
        def predict(self, depth_m, intrinsics, goal_level_m, seen=None, floor_m=0.0):
            self.mu = 0.9 if np.hypot(*goal_level_m[:2]) > 4.0 else 0.1
            return super().predict(depth_m, intrinsics, goal_level_m, seen, floor_m)

    network = Timid()
    planner = AlonePlanner(ROBOT, network)
    plans = [planner.cycle(request([20.0, 0.0, 1.4], in_air=True), frame(k)) for k in range(6)]
    assert plans[-1].source is Source.GKPN
    np.testing.assert_allclose([g[0] for g in network.goals[:3]], [9.0, 5.4, 3.15], atol=1e-6)
    assert network.goals[0][2] == 0.0  # shown on the floor while it is out of range
    near = AlonePlanner(ROBOT, Line())
    near.cycle(request([5.0, 0.0, 1.4], in_air=True), frame())
    assert near._network._network.goals[0][2] == pytest.approx(1.4 - BELOW_M)


@pytest.mark.slow
def test_a_network_that_takes_a_map_is_shown_what_has_been_seen():
    network = MapLine()
    planner = AlonePlanner(ROBOT, network)
    planner.cycle(request([4.0, 0.0, 0.0]), frame())
    assert network.seen.shape == (CHANNELS, SIDE, SIDE)
    assert network.seen[1].any()  # something of the lowest band is known after one image
    assert network.floor_m == 0.0
    planner.cycle(request([9.0, 0.0, 1.0], at=(0.0, 0.0, 1.0), mode=Mode.AIR, in_air=True), frame(1))
    assert network.floor_m == pytest.approx(BELOW_M - 1.0)
    np.testing.assert_allclose(network.goals[-1], [6.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (1.0, -0.3, 0.2), (-0.8, 0.4, -0.3)])
def test_a_flown_path_keeps_the_limits_from_any_motion_and_ends_at_rest_at_its_end(velocity):
    path = np.linspace([0.0, 0.0, 1.0], [-4.0, 3.0, 2.0], 51)
    motion = Motion(np.array([0.1, 0.2, 1.1]), np.array(velocity), np.zeros(3), 0.5, 0.3, 0.0)
    plan = fly_along(path, motion, ROBOT.air, 3.0, Source.GKPN)
    p, v, a = plan.position_m, plan.velocity_mps, plan.acceleration_mps2
    np.testing.assert_allclose(p[0], motion.position_m)
    np.testing.assert_allclose(v[0], velocity)
    np.testing.assert_allclose(p[-1], path[-1], atol=0.02)
    assert np.abs(v[-1]).max() == plan.yaw_rate_rps[-1] == 0.0
    assert np.hypot(v[:, 0], v[:, 1]).max() <= ROBOT.air.speed_mps
    assert v[:, 2].max() <= ROBOT.air.climb_mps
    assert v[:, 2].min() >= -ROBOT.air.descend_mps
    assert np.linalg.norm(a, axis=1).max() <= ROBOT.air.acceleration_mps2
    assert np.linalg.norm(np.diff(a, axis=0), axis=1).max() / plan.step_s <= 1.01 * ROBOT.air.jerk_mps3
    assert np.abs(plan.yaw_rate_rps).max() <= ROBOT.air.yaw_rate_rps
    np.testing.assert_allclose(np.diff(p, axis=0)[:-1], 0.5 * (v[1:-1] + v[:-2]) * plan.step_s, atol=2e-3)


# ---------------------------------------------------------------- as methods
@pytest.fixture
def weights(tmp_path):
    """A copy of the packaged weights with facts of its own in the manifest."""

    def make(name="run-a", **facts):
        folder = shutil.copytree(packaged_dir(), tmp_path / "weights" / name)
        path = folder / MANIFEST_NAME
        path.write_text(json.dumps(json.loads(path.read_text()) | facts))
        return folder

    return make


def test_networks_are_methods_by_name_but_not_part_of_all(weights):
    folder = weights(land_only=True)
    found = methods.find_methods(f"network@{folder},oracle,network,two-stage")
    assert [m.name for m in found] == ["two-stage", "oracle", f"network@{folder}", "network"]
    assert [m.land_only for m in found] == [False, False, True, False]
    assert found[2].title == "network run-a"
    assert not any(m.name.startswith("network") for m in methods.find_methods("all"))
    task = fakes.make_task(0)
    assert isinstance(methods.make_planner(f"network@{folder}", ROBOT, task), AlonePlanner)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("network@", "'network@' names no folder"),
        ("network@nowhere", r"nowhere/manifest\.json cannot be read"),
        ("networks", "no method 'networks'"),
    ],
)
def test_networks_that_are_not_there_are_refused(name, words):
    with pytest.raises(BadInput, match=words):
        methods.find_methods(name)
    with pytest.raises(BadInput, match=words):
        methods.find_method(name)


@pytest.mark.slow
def test_a_benchmark_copes_with_networks_in_tables_pictures_and_jobs(weights, tmp_path):
    both, land = weights("both"), weights("land", land_only=True)
    names = (f"network@{both}", f"network@{land}", "network")
    settings = fakes.settings(methods=("two-stage", *names), trials=4)
    open_folder(settings, tmp_path / "run", resume=False)
    executor = fakes.Inline(lambda job: _hit(job) if job.method == names[0] else fakes.fly_well(job))
    findings = run.run_bench(settings, tmp_path / "run", lambda: executor, lambda _: None)
    flown = {name: {seed for _, seed, method in executor.flown if method == name} for name in names}
    assert flown == {names[0]: {0, 1, 2, 3}, names[1]: {0, 2}, names[2]: {0, 1, 2, 3}}
    results = findings.results()
    page = run_page(results)
    assert f"- {names[1]}: the network in {land} alone" in page
    assert f"{names[1]} (land)" in page
    run.write_results(tmp_path / "run", results, page)
    gallery.draw_navigation(findings, results)
    assert {p.name for p in (tmp_path / "run").glob("*.png")} == {
        "summary.png", "ways-indoor.png", "failures-indoor.png"
    }  # fmt: skip
    assert len(set(gallery.colours_of(names).values())) == len(gallery.COLOURS) + len(names)


def run_page(results):
    from sim.bench.page import navigation_page

    return navigation_page(results)


def _hit(job):
    answer = fakes.fly_well(job)
    return dataclasses.replace(answer, result=fakes.make_result(outcome="contact", min_clearance_m=-0.01))


def test_other_weights_in_the_same_folder_are_another_question(weights, tmp_path):
    folder = weights()
    settings = fakes.settings(methods=(f"network@{folder}",))
    open_folder(settings, tmp_path / "run", resume=False)
    open_folder(settings, tmp_path / "run", resume=True)
    path = folder / MANIFEST_NAME
    manifest = json.loads(path.read_text())
    manifest["files"]["gkpn.onnx"]["sha256"] = "0" * 64
    path.write_text(json.dumps(manifest))
    with pytest.raises(BadInput, match="other settings: weights was"):
        open_folder(settings, tmp_path / "run", resume=True)
    assert "weights" not in fakes.settings().as_dict()  # folders of before can still be continued


@pytest.mark.slow
def test_a_trial_of_a_network_can_be_shown(weights, tmp_path, monkeypatch):
    flown = []
    monkeypatch.setattr(jobs, "fly_job", lambda job: flown.append(job) or fakes.fly_well(job))
    method = f"network@{weights()}"
    asked = [
        "sim",
        "--family",
        "rooms",
        "--seed",
        "3",
        "--method",
        method,
        "--show",
        "--out",
        str(tmp_path / "o"),
    ]
    done = CliRunner().invoke(cli.main, asked)
    assert done.exit_code == 0, done.output
    assert flown[0].method == method
    assert len(list((tmp_path / "o").glob("*/trial.png"))) == 1
    asked[6] = "network@nowhere"
    assert CliRunner().invoke(cli.main, asked).exit_code == 2


# ---------------------------------------------------------------- validation
def test_closed_loop_counts_by_family_and_repeats_itself():
    def work(job):
        result = fakes.make_result(outcome=("reached", "contact", "timeout", "reached")[job.seed % 4])
        return jobs.Answer(fakes.make_task(job.seed), result)

    asked = dict(first_seed=500_000, begin_executor=lambda _: fakes.Inline(work))
    found = closed_loop(packaged_dir(), ["rooms", "forest"], 6, **asked)
    one = {"reached": 3, "contacts": 2, "timeouts": 1, "stopped": 0, "n": 6}
    assert found["families"] == {"rooms": one, "forest": one}
    assert found["reached_pct"] == 50.0
    low, high = found["reached_pct_ci95"]
    assert 10.0 < low < 50.0 < high < 90.0
    assert json.loads(json.dumps(found)) == json.loads(
        json.dumps(closed_loop(packaged_dir(), ["rooms", "forest"], 6, **asked))
    )


def test_closed_loop_flies_no_oracle_and_says_when_the_program_fails():
    inline = fakes.Inline()
    seen = []
    closed_loop(
        packaged_dir(), ["rooms"], 3, begin_executor=lambda _: inline, on_flight=lambda: seen.append(1)
    )
    method = f"network@{packaged_dir()}"
    assert inline.flown == [("rooms", 500_000 + k, method) for k in range(3)]
    assert len(seen) == 3
    assert inline.closed

    def fails(job):
        raise ValueError("at a loss")

    with pytest.raises(Refused, match="failed in rooms seed 500000: ValueError: at a loss"):
        closed_loop(packaged_dir(), ["rooms"], 1, begin_executor=lambda _: fakes.Inline(fails))


def test_closed_loop_gives_a_network_of_land_alone_goals_on_the_floor(weights, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        validate, "sample_task", lambda spec, seed, _: drawn.append((spec, seed)) or fakes.make_task(seed)
    )
    monkeypatch.setattr(validate, "fly_job", fakes.fly_well)
    job = jobs.Job("rooms", {"family": "rooms", "stride": 3}, 7, "network")
    assert fly_on_land(job).task.seed == 10  # 7 is in the air
    assert drawn == [({"family": "rooms"}, 7), ({"family": "rooms"}, 10)]
    inline = fakes.Inline()
    found = closed_loop(weights(land_only=True), ["rooms"], 3, begin_executor=lambda _: inline)
    assert found["land_only"]


@pytest.mark.parametrize(
    ("families", "trials", "words"),
    [([], 3, "no world family"), (["moon"], 3, "family 'moon'"), (["rooms"], 0, "0 trials tell nothing")],
)
def test_closed_loop_refuses_what_tells_nothing(families, trials, words):
    with pytest.raises(BadInput, match=words):
        closed_loop(packaged_dir(), families, trials)
