"""The mapping-based method at the planner's seam: map, A*, B-spline, check; no network.

In the manner of EGO-Planner: unknown space is free to plan through, a local goal lies at the planning
horizon, a trajectory is kept while it stays clear and is planned anew every so often. Map, outline,
clearances, limits, brakes and turns on the spot are those of `labr_autonomy`, so that the methods differ in
how they plan and in nothing else.
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.decision import classify
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.perception.rolling_map import RollingMap, warm_up
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.planner.places import AT_END_M, column_clear
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.reference import along
from labr_autonomy.refine.search import GOAL_SNAP_M
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Mode, Source, Trajectory
from sim.bench.mapping.astar import Way, way_on_map
from sim.bench.mapping.flight import Flight
from sim.bench.mapping.ground import Ground
from sim.bench.mapping.takeoff import lift_off_m
from sim.bench.mapping.timing import Made, judged, remaining

UNDER_GOAL_M = 2.5  # how far from below an air goal the drive may end
HORIZON_M = 7.5  # EGO-Planner's planning horizon
REPLAN_S = 0.3  # a trajectory that stays clear is kept this long
RETRY_S = 0.1  # after a brake
OFF_PLAN_M = 0.1  # farther from the kept trajectory than this it is planned anew
MARGINS_M = (0.06, 0.0)  # of the way beyond the hard clearance; the next one when the goal is not reached
AIR_HALF_M = (6.0, 6.0)  # crop of the map that a flight is planned in
NEAR_HALF_M = (3.0, 3.0)  # and in which a kept one is checked between two plans
AIR_GREED = 1.1
LOWEST_M = 0.45  # of the body above the floor in flight, unless the goal is lower


class MappingPlanner:
    """State of the method between cycles: map and kept trajectory.

    Args:
        config: The robot.
    """

    def __init__(self, config: RobotConfig) -> None:
        self._config = config
        self._clock = SystemClock()
        self._map = RollingMap(config)
        warm_up()
        refiner = Refiner(config)
        self._refiner = refiner
        self._ground = Ground(config, refiner)
        self._flight = Flight(config, refiner)
        self._kept: Trajectory | None = None
        self._kept_why = ""
        self._planned_s = -math.inf
        self._goal: Array | None = None
        self._way: Way | None = None
        self._seen = -1

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once; without a frame (overwritten or not there yet) from the map as it is."""
        now = self._clock.now_s
        began_s = now()
        if frame is not None and frame.sequence != self._seen:
            self._seen = frame.sequence
            self._map.update(frame, request.frame_pose, request.floor_z_m)
            self._map.clear_robot(request.body_pose)
        self._forget(request)
        made = self._still_good(request)
        mapped_s = routed_s = now()
        if made is None:
            field = self._field(request, AIR_HALF_M)
            mapped_s = now()
            self._way = self._search(request, field)
            routed_s = now()
            made = self._plan(request, field)
        done_s = now()
        assert made.trajectory is not None
        keys = self._key_points(request)
        outline_m = self._config.body.radius_m
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=frame.stamp_s if frame is not None else math.nan,
            trajectory=made.trajectory,
            network=keys,
            followed=None if made.trajectory.source is Source.BRAKE else keys,
            source=made.trajectory.source,
            clearance_m=made.nearest_m - outline_m,
            reason=made.why,
            lift_off_m=lift_off_m(
                self._config.camera, self._map, request.body_pose, request.goal_m, request.goal_in_air
            ),
            land_path_ends=self._land_path_ends(request),
            take_off_clear=self._column_clear(request, request.lift_to_m),
            landing_clear=self._column_clear(request, float(request.body_pose.position_m[2])),
            timings=Timings(
                map_s=mapped_s - began_s,
                route_s=routed_s - mapped_s,
                refine_s=done_s - routed_s,
                total_s=done_s - began_s,
            ),
        )

    # ------------------------------------------------------------------ what is kept
    def _forget(self, request: PlanRequest) -> None:
        """Drop what belongs to another goal, mode or motion."""
        kept = self._kept
        if request.fresh or (kept is not None and kept.mode is not request.mode):
            self._kept = None
        if self._goal is None or not np.array_equal(self._goal, request.goal_m):
            self._goal = np.array(request.goal_m, dtype=float)
            self._planned_s = -math.inf
            self._way = None

    def _field(self, request: PlanRequest, half_m: tuple[float, float]) -> Field2 | Field3:
        if request.mode is Mode.LAND:
            return self._map.land_field(request.body_pose, request.floor_z_m)
        if self._map.frames == 0:
            self._map.clear_robot(request.body_pose)
        return self._map.air_field(request.motion.position_m, half_m)

    def _on_kept(self, request: PlanRequest) -> bool:
        """Whether the robot will be where the kept trajectory says."""
        if self._kept is None or request.start_s >= self._kept.end_s - self._kept.step_s:
            return False
        d = 2 if request.mode is Mode.LAND else 3
        there = self._kept.sample(request.start_s).position_m[:d]
        return math.dist(there, request.motion.position_m[:d]) < OFF_PLAN_M

    def _judge(self, request: PlanRequest, plan: Trajectory, field: Field2 | Field3) -> tuple[bool, float]:
        land = request.mode is Mode.LAND
        hard_m = self._ground.hard_m if land else self._flight.hard_m
        verdict = judged(plan, field, hard_m, 2 if land else 3)
        return verdict.free, verdict.nearest_m

    def _still_good(self, request: PlanRequest) -> Made | None:
        """The rest of the kept trajectory while it is young and clear, as far as `NEAR_HALF_M` shows."""
        if request.start_s - self._planned_s >= REPLAN_S - 1e-6 or not self._on_kept(request):
            return None
        assert self._kept is not None
        rest = remaining(self._kept, request.start_s)
        free, nearest_m = self._judge(request, rest, self._field(request, NEAR_HALF_M))
        return Made(rest, nearest_m, self._kept_why) if free else None

    # ------------------------------------------------------------------ the way on the map
    def _search(self, request: PlanRequest, field: Field2 | Field3) -> Way | None:
        land = request.mode is Mode.LAND
        here = request.motion.position_m
        goal = np.array(request.goal_m, dtype=float)
        if not land and not request.goal_in_air:
            goal[2] = here[2]
        d = 2 if land else 3
        hard_m = self._ground.hard_m if land else self._flight.hard_m
        reach_m = UNDER_GOAL_M if land and request.goal_in_air else GOAL_SNAP_M
        lowest = min(request.floor_z_m + LOWEST_M, float(here[2]), float(goal[2])) - self._map.cell_m
        z_range = (lowest, self._ceiling_m(request))
        best: Way | None = None
        for margin_m in MARGINS_M:
            way = way_on_map(
                field,
                here[:d],
                goal[:d],
                hard_m + margin_m,
                reach_m,
                z_range,
                1.0 if land else AIR_GREED,
            )
            if way is not None and (best is None or way.reached):
                best = way
            if best is not None and best.reached:
                break
        return best

    def _ceiling_m(self, request: PlanRequest) -> float:
        return request.floor_z_m + self._config.air.height_max_m

    def _local(self) -> Array | None:
        """The way up to the planning horizon."""
        if self._way is None:
            return None
        points = self._way.points_m
        reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        if reached[-1] <= HORIZON_M:
            return points
        end = along(points, np.array([HORIZON_M]))
        return np.vstack([points[reached < HORIZON_M], end])

    # ------------------------------------------------------------------ the trajectory
    def _plan(self, request: PlanRequest, field: Field2 | Field3) -> Made:
        way = self._local()
        made = Made(None, math.nan, "no way on the map")
        if way is not None:
            made = (
                self._drive(request, way, field)
                if isinstance(field, Field2)
                else self._fly(request, way, field)
            )
        if made.trajectory is not None:
            self._kept, self._kept_why, self._planned_s = made.trajectory, made.why, request.start_s
            return made
        if self._on_kept(request):
            assert self._kept is not None
            rest = remaining(self._kept, request.start_s, Source.PREVIOUS)
            free, nearest_m = self._judge(request, rest, field)
            if free:
                return Made(rest, nearest_m, made.why)
        brake = self._brake(request)
        self._kept, self._kept_why = brake, made.why
        self._planned_s = request.start_s + RETRY_S - REPLAN_S
        return Made(brake, self._judge(request, brake, field)[1], made.why)

    def _land_state(self, request: PlanRequest) -> LandState:
        m = request.motion
        return LandState(m.position_m[:2], m.yaw_rad, m.speed_mps, m.yaw_rate_rps, float(m.position_m[2]))

    def _air_state(self, request: PlanRequest) -> AirState:
        m = request.motion
        return AirState(m.position_m, m.velocity_mps, m.acceleration_mps2, m.yaw_rad)

    def _drive(self, request: PlanRequest, way: Array, field: Field2) -> Made:
        return self._ground.plan(self._land_state(request), way, field, request.start_s)

    def _fly(self, request: PlanRequest, way: Array, field: Field3) -> Made:
        return self._flight.plan(
            self._air_state(request),
            request.motion.yaw_rate_rps,
            way,
            field,
            request.start_s,
            self._ceiling_m(request),
        )

    def _brake(self, request: PlanRequest) -> Trajectory:
        if request.mode is Mode.LAND:
            return self._refiner.brake_land(self._land_state(request), request.start_s)
        return self._refiner.brake_air(self._air_state(request), request.start_s)

    # ------------------------------------------------------------------ what the pilot decides by
    def _key_points(self, request: PlanRequest) -> KeyPoints:
        points = request.motion.position_m[None] if self._way is None else self._way.points_m[1:]
        if points.shape[1] == 2:
            points = np.column_stack([points, np.full(len(points), request.motion.position_m[2])])
        drive_z_m = request.floor_z_m + self._config.body.below_m
        return KeyPoints(points, classify(points, drive_z_m), 0.0, Source.SEARCH)

    def _land_path_ends(self, request: PlanRequest) -> bool:
        """Nearer to below the goal the wheels cannot get."""
        if request.mode is not Mode.LAND or not request.goal_in_air:
            return False
        if self._way is None or not self._way.reached:
            return True
        end, here = self._way.points_m[-1], request.body_pose.position_m[:2]
        return float(np.hypot(*(end - here))) < AT_END_M

    def _column_clear(self, request: PlanRequest, up_to_m: float) -> bool:
        return column_clear(self._map, self._config, request, up_to_m)
