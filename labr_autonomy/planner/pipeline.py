"""One planning cycle: depth image and pose in, trajectory out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi, yaw_of
from labr_autonomy.modes.decision import lift_off_distance_m
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.perception.frame_check import FrameCheck
from labr_autonomy.perception.rolling_map import RollingMap, warm_up
from labr_autonomy.planner import routes
from labr_autonomy.planner.first_stage import GOAL_JOIN_M, FirstStage
from labr_autonomy.planner.map_ways import MapWays
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.planner.places import column_clear
from labr_autonomy.planner.way_out import WayOut
from labr_autonomy.refine import shortest
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.reference import to_key_points
from labr_autonomy.refine.search import CostToGo
from labr_autonomy.refine.values import AirState, LandState, RefineResult
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Mode, Source, Trajectory

CAREFUL_MPS = 0.3
PUSH_M = 0.08  # by so much the refiner pushes a path out of obstacles
LAND_HALF_M = 4.5  # of the map that a trajectory is checked against
FIELD_HALF_M = (3.5, 3.5)
RING_M = 0.25  # about a robot that begins to drive the floor is taken for free: the camera cannot see it
MAP_EVERY_S = 1.0
COMES_DOWN_S, DESCENTS_MAX = 4.0, 2  # a flight held up so long comes down and drives on, at most so often
HELD_UP_S, STUCK_IN_AIR_S = 1.0, 10.0  # hovering costs thirty times what standing does: it does not wait long
SAME_GOAL_M = 0.05  # a goal that was moved by less is the same
STILL_MPS = 0.05
DEPART_M = 0.3  # a flight that goes no farther than this needs no turn


class Pipeline:
    """State of the planner between cycles: map, previous trajectory, route memory.

    What it decides follows from the requests and their stamps alone; the clock only measures the cycle.

    Args:
        config: The robot.
        network: Whether the first stage is asked at all; without, the map's ways alone lead.
        memory: Whether searches know what left the rolling map.
    """

    def __init__(self, config: RobotConfig, *, network: bool = True, memory: bool = True) -> None:
        self._config = config
        self._clock = SystemClock()
        self._map = RollingMap(config)
        self._check = FrameCheck(config.camera.range_max_m)
        warm_up()
        shortest.warm_up()
        self._first, self._asks = FirstStage(config), network
        self._refiner = Refiner(config)
        hard_m = self._refiner.land_hard_m, self._refiner.air_hard_m
        self._ways = MapWays(config, self._map, *hard_m, memory=memory)
        self._previous: Trajectory | None = None
        self._route = routes.State()
        self._way_out = WayOut()
        self._held_up_s: float | None = None  # since when a flight gets no farther
        self._descents, self._comes_down = 0, False  # of flights to one goal that were held up
        self._begins = True
        self._goal_m: Array | None = None
        self._seen = -1
        self._drawn_s = -math.inf
        self._turn_m = config.land.speed_mps / config.land.yaw_rate_rps  # a turn costs the time of so many

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once; without a frame (overwritten or not there yet) from the map as it is."""
        now = self._clock.now_s
        began_s = now()
        if frame is not None and frame.sequence != self._seen:
            self._seen = frame.sequence
            if self._check.good(frame, request.frame_pose):
                self._map.update(frame, request.frame_pose, request.floor_z_m)
            self._map.clear_robot(request.body_pose)
        mapped_s = now()
        if request.fresh or (self._previous is not None and self._previous.mode is not request.mode):
            self._previous = None
        if request.mode is Mode.LAND and (request.fresh or self._begins):
            self._map.assume_free(request.body_pose, RING_M)
        self._forget(request)
        self._begins = False
        ways = self._ways.on_land(request, self._way_out.closed)
        asked_s = now()
        network = self._first.ask(request, frame if self._asks else None, self._map)
        thought_s = now()
        room_above = self._column_clear(request, request.lift_to_m)
        self._ways.refuse_take_off(request, ways, room_above)
        if not request.follow:
            followed, refined, why = None, self._wait(request), "wheels and rotors change over"
            routed_s = now()
        elif request.mode is Mode.LAND:
            followed, refined, routed_s, why = self._drive(request, network, ways, room_above)
        else:
            followed, refined, routed_s, why = self._fly(request, network, ways)
        done_s = now()
        self._previous = refined.trajectory
        held_up_s = self._held_up(request, refined)
        comes_down = self._gives_up_flying(request, ways, held_up_s)
        at_once = request.mode is Mode.LAND and self._way_out.hops
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=frame.stamp_s if frame is not None else math.nan,
            trajectory=refined.trajectory,
            network=network,
            followed=followed,
            source=refined.source,
            clearance_m=refined.clearance_m,
            reason="; ".join(part for part in (why, refined.reason) if part),
            lift_off_m=self._lift_off_m(request, network, ways),
            land_path_ends=at_once or self._ways.drive_ends(request, ways),
            take_off_clear=room_above,
            landing_clear=self._may_land(request, ways),
            depart_rad=math.nan if request.follow else self._depart_rad(request, ways),
            hop=at_once or comes_down or self._ways.hop_planned(request, ways),
            nearest=self._ways.nearest(request, ways) or held_up_s > HELD_UP_S,
            stuck=held_up_s > STUCK_IN_AIR_S or (request.mode is Mode.LAND and self._way_out.given_up),
            timings=Timings(
                mapped_s - began_s,
                thought_s - asked_s,
                routed_s - thought_s + asked_s - mapped_s,
                done_s - routed_s,
                done_s - began_s,
            ),
            depth_fault=self._check.fault,
            probe=self._ways.probe(request),
            map_xy_m=self._map_now_and_then(request.start_s),
        )

    def _forget(self, request: PlanRequest) -> None:
        """What was tried in vain counts for one goal; a robot that was carried elsewhere goes on with it."""
        another = self._goal_m is None or float(np.linalg.norm(request.goal_m - self._goal_m)) > SAME_GOAL_M
        self._goal_m = np.array(request.goal_m, dtype=float)
        if another:
            self._way_out.reset()
            self._descents, self._comes_down = 0, False
        elif request.fresh:
            self._way_out.resume()
        if another or (request.fresh and request.mode is Mode.LAND):
            self._ways.reset()

    # ------------------------------------------------------------------ ways on the map
    def _lift_off_m(self, request: PlanRequest, network: KeyPoints, ways: CostToGo) -> float:
        """How far it drives before it leaves the floor: by the network where it leads, else by the map."""
        if self._route.source is Source.GKPN:
            return lift_off_distance_m(request.body_pose.position_m, network.points_m, network.air)
        return self._ways.lift_off_m(request, ways)

    def _evidence(
        self, request: PlanRequest, network: KeyPoints, path: Array, ways: CostToGo
    ) -> routes.Evidence:
        pose = request.body_pose
        here = pose.position_m[:2]
        dense = routes.densify(np.vstack([here, path[:, :2]]))
        beyond = dense[np.hypot(*(dense - here).T) > 0.3]
        free = self._ways.near.lookup(beyond) - self._refiner.land_hard_m if len(beyond) else np.array([1.0])
        away = request.goal_m[:2] - here
        bearing = wrap_pi(math.atan2(away[1], away[0]) - yaw_of(pose.quaternion))
        return routes.Evidence(
            mu=network.mu,
            goal_bearing_rad=bearing,
            clearance_m=float(free.min()) + PUSH_M,
            path_m=routes.length_m(dense),
            after_path_m=ways.cost_m(path[-1, :2]) if len(path) else math.inf,
            shortest_m=ways.cost_m(here),
        )

    # ------------------------------------------------------------------ second stage, on land
    def _drive(
        self,
        request: PlanRequest,
        network: KeyPoints,
        ways: CostToGo,
        room_above: bool,
    ) -> tuple[KeyPoints | None, RefineResult, float, str]:
        land_part = network.points_m
        if request.goal_in_air and network.air.any():
            land_part = land_part[: int(np.argmax(network.air))]
        motion = request.motion
        here = motion.position_m
        if not len(land_part):  # lift off right here
            land_part = here[None]
        evidence = self._evidence(request, network, land_part, ways)
        self._route, why = routes.choose(self._route, evidence, request.start_s)
        if float(np.hypot(*(request.goal_m[:2] - here[:2]))) < GOAL_JOIN_M:  # nothing left to see there
            self._route, why = routes.State(Source.SEARCH, request.start_s, 0), "at the goal"
        followed = KeyPoints(land_part, np.zeros(len(land_part), bool), network.mu, Source.GKPN)
        if self._route.source is Source.SEARCH:
            way = ways.path(here[:2], motion.yaw_rad, self._turn_m)
            if way is None:
                why = f"{why}; no way on the map"
            else:
                points = to_key_points(way)
                points = np.column_stack([points[:, :2], np.full(len(points), here[2])])
                followed = KeyPoints(points, np.zeros(len(points), bool), network.mu, Source.SEARCH)
        field = self._map.land_room(request.body_pose, request.floor_z_m, LAND_HALF_M)
        state = LandState(here[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps, float(here[2]))
        doing = self._way_out.step(
            request,
            ways,
            lambda closed: self._ways.through_gaps(request, closed),
            room_above and request.may_hop,
        )
        routed_s = self._clock.now_s()
        if doing is not None:
            said = "; ".join(part for part in (self._way_out.state.action.value, why) if part)
            refined = self._doing(state, doing, field, request)
            return None, refined, routed_s, said
        blocked = followed.source is Source.GKPN and bool(why)
        if blocked:  # nothing usable: come to rest
            trajectory = self._refiner.brake_land(state, request.start_s)
            refined = RefineResult(trajectory, Source.BRAKE, math.nan, True, "", 0.0)
            return None, refined, routed_s, why
        refined = self._refiner.land(
            state,
            followed.points_m,
            field,
            request.start_s,
            self._previous,
            source=followed.source,
        )
        if refined.stopped and followed.source is Source.GKPN:  # the map's way next, for a while
            self._route = routes.State(Source.SEARCH, request.start_s, 0)
        return followed, refined, routed_s, why

    # ------------------------------------------------------------------ when it gets no farther
    def _doing(
        self, state: LandState, what: Array | float, field: Field2, request: PlanRequest
    ) -> RefineResult:
        """The trajectory of a step of the recovery."""
        if isinstance(what, float) and abs(state.speed) > STILL_MPS:  # it would leave its way
            trajectory = self._refiner.brake_land(state, request.start_s)
            return RefineResult(trajectory, Source.BRAKE, math.nan, True, "", 0.0)
        if isinstance(what, float):
            trajectory = self._refiner.turn(state, what, request.start_s)
            return RefineResult(trajectory, Source.TURN, math.nan, False, "", 0.0)
        return self._refiner.land(
            state, what, field, request.start_s, self._previous, source=Source.SEARCH, speed_mps=CAREFUL_MPS
        )

    def _may_land(self, request: PlanRequest, ways: CostToGo) -> bool:
        """Room to come down here, and, for a goal on land, nothing to gain by flying on."""
        room = self._column_clear(request, float(request.body_pose.position_m[2]))
        if request.mode is Mode.LAND or (request.goal_in_air and not self._comes_down):
            return room
        return self._ways.hops.may_land(request, ways, room)

    # ------------------------------------------------------------------ second stage, in the air
    def _air_way(
        self, request: PlanRequest, network: KeyPoints, ways: CostToGo, space: Field3
    ) -> tuple[Array, Source, str]:
        """Key points of a flight to a goal in the air, or to where it comes down for one on land."""
        here, goal, over = request.motion.position_m, np.array(request.goal_m, dtype=float), None
        if not request.goal_in_air or self._comes_down:
            over = self._ways.hops.in_air(request, ways)
            end = over.end(here[:2])
            goal = np.array([*(goal[:2] if end is None else end), here[2]])
        return self._air_points(request, network, goal, space, over)

    def _depart_rad(self, request: PlanRequest, ways: CostToGo) -> float:
        """Where a flight would go at first, once it is as high as it climbs here; NaN if not far."""
        up = np.array([*request.body_pose.position_m[:2], request.lift_to_m])
        raised = replace(
            request,
            body_pose=replace(request.body_pose, position_m=up),
            motion=replace(request.motion, position_m=up),
        )
        space = self._map.air_field(up, FIELD_HALF_M)
        unsure = KeyPoints(up[None], np.ones(1, bool), 1.0, Source.GKPN)
        points, _, _ = self._air_way(raised, unsure, ways, space)
        away = points[:, :2] - up[:2]
        far = np.flatnonzero(np.hypot(*away.T) > DEPART_M)
        return math.atan2(away[far[0], 1], away[far[0], 0]) if len(far) else math.nan

    def _held_up(self, request: PlanRequest, refined: RefineResult) -> float:
        """How long a flight to a goal in the air has got no farther [s]."""
        flies = request.follow and request.mode is Mode.AIR and request.goal_in_air
        if not (flies and (refined.stopped or refined.source is Source.BRAKE)):
            self._held_up_s = None
        elif self._held_up_s is None:
            self._held_up_s = request.start_s
        return 0.0 if self._held_up_s is None else request.start_s - self._held_up_s

    def _gives_up_flying(self, request: PlanRequest, ways: CostToGo, held_up_s: float) -> bool:
        """Whether a flight to a goal in the air that gets no farther is to come down and to drive on."""
        if request.mode is Mode.LAND:
            self._descents += self._comes_down
            self._comes_down = False
        elif held_up_s > COMES_DOWN_S and self._descents < DESCENTS_MAX:
            here = request.body_pose.position_m[:2]
            far = float(np.hypot(*(request.goal_m[:2] - here))) > GOAL_JOIN_M
            if far and math.isfinite(ways.cost_m(here)) and not self._comes_down:
                self._comes_down = True
                self._ways.hops.anywhere()
        return self._comes_down

    def _wait(self, request: PlanRequest) -> RefineResult:
        """To rest: nobody follows it."""
        motion = request.motion
        state = AirState(motion.position_m, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad)
        trajectory = self._refiner.brake_air(state, request.start_s)
        return RefineResult(trajectory, Source.BRAKE, math.nan, True, "", 0.0)

    def _fly(
        self, request: PlanRequest, network: KeyPoints, ways: CostToGo
    ) -> tuple[KeyPoints | None, RefineResult, float, str]:
        motion = request.motion
        here = motion.position_m
        space = self._map.air_field(here, FIELD_HALF_M)
        points, source, why = self._air_way(request, network, ways, space)
        routed_s = self._clock.now_s()
        state = AirState(here, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad)
        refined = self._refiner.air(
            state,
            points,
            space,
            request.start_s,
            self._previous,
            source=source,
            floor_m=request.floor_z_m,
        )
        followed = KeyPoints(points, np.ones(len(points), bool), network.mu, source)
        return followed, refined, routed_s, why

    def _air_points(
        self, request: PlanRequest, network: KeyPoints, goal: Array, space: Field3, over: CostToGo | None
    ) -> tuple[Array, Source, str]:
        """The network's path while usable, else straight to the goal, else round obstacles at this height."""
        here = request.motion.position_m
        radius_m = self._refiner.air_hard_m
        points = network.points_m.copy()
        points[:, 2] = np.clip(points[:, 2], min(here[2], goal[2]), max(here[2], goal[2]))
        if float(np.linalg.norm(points[-1] - goal)) < GOAL_JOIN_M:
            points[-1] = goal
        away = goal[:2] - here[:2]
        near = float(np.hypot(*away)) < GOAL_JOIN_M
        bearing = wrap_pi(math.atan2(away[1], away[0]) - request.motion.yaw_rad)

        def free_m(path: Array) -> float:
            dense = routes.densify(np.vstack([here, path]))
            beyond = dense[np.linalg.norm(dense - here, axis=1) > 0.3]
            return float(space.lookup(beyond).min()) - radius_m if len(beyond) else 1.0

        evidence = routes.Evidence(network.mu, bearing, free_m(points) + PUSH_M, 0.0, 0.0, 0.0)
        why = "at the goal" if near else routes.objection(evidence)
        if over is not None:  # the network was asked for the goal, not for where to land
            why = "to where it lands"
        straight = near or free_m(goal[None]) >= 0.0
        if straight and not why and self._seen_through(space, here, goal):
            why = "straight through what was seen to be free"
        if not why:
            return points, Source.GKPN, ""
        if straight:
            return goal[None], Source.DIRECT, why
        way = (over or self._ways.in_air(request, goal, float(here[2]))).path(here[:2])
        if way is None:
            return here[None], Source.BRAKE, f"{why}; no way at this height"
        keys = to_key_points(way)
        rise = np.linspace(0.0, 1.0, len(keys) + 1)[1:]
        around = np.column_stack([keys[:, :2], here[2] + rise * (goal[2] - here[2])])
        return around, Source.SEARCH, why

    @staticmethod
    def _seen_through(space: Field3, here: Array, goal: Array) -> bool:
        """Whether the map has seen all of the straight way: there is nothing to guess."""
        line = routes.densify(np.vstack([here, goal]))
        return bool(space.is_known(line).all())

    # ------------------------------------------------------------------ places to take off and land
    def _column_clear(self, request: PlanRequest, up_to_m: float) -> bool:
        return column_clear(self._map, self._config, request, up_to_m)

    def _map_now_and_then(self, now_s: float) -> np.ndarray | None:
        if now_s - self._drawn_s < MAP_EVERY_S:
            return None
        self._drawn_s = now_s
        return self._ways.drawn()
