"""One planning cycle: depth image and pose in, trajectory out."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi, yaw_of
from labr_autonomy.modes.decision import lift_off_distance_m
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.driving_kernels import CELL_M
from labr_autonomy.perception.fields import Bits, Field2, Field3
from labr_autonomy.perception.memory import Memory
from labr_autonomy.perception.rolling_map import RollingMap, warm_up
from labr_autonomy.planner import routes
from labr_autonomy.planner.first_stage import GOAL_JOIN_M, FirstStage
from labr_autonomy.planner.hops import Hops
from labr_autonomy.planner.kept_ways import KeptWays
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.planner.places import AT_END_M, column_clear, column_m, column_radius_m
from labr_autonomy.planner.take_off import offers_by_air
from labr_autonomy.planner.way_out import WayOut
from labr_autonomy.refine import shortest
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.reference import to_key_points
from labr_autonomy.refine.search import GOAL_SNAP_M, CostToGo
from labr_autonomy.refine.values import AirState, LandState, RefineResult
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Mode, Source, Trajectory

UNDER_GOAL_M = 2.5  # how far from below an air goal out of the map's reach the drive may end
ROUTE_MARGIN_M = 0.06  # beyond the hard clearance, so that the refiner can follow with ease
NARROW_MARGIN_M = 0.01  # and so that it can follow at all
TIGHT_M = 0.12  # as near as this to obstacles leads a way when there is no other
CAREFUL_MPS = 0.3
PUSH_M = 0.08  # by so much the refiner pushes a path out of obstacles
LAND_HALF_M = 4.5  # of the map that a trajectory is checked against
FIELD_HALF_M = (3.5, 3.5)
RING_M = 0.25  # about a robot that begins to drive the floor is taken for free: the camera cannot see it
MAP_EVERY_S = 1.0


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
        warm_up()
        shortest.warm_up()
        self._first, self._asks = FirstStage(config), network
        self._refiner = Refiner(config)
        self._previous: Trajectory | None = None
        self._route = routes.State()
        self._land_ways, self._air_ways = KeptWays(), KeptWays()
        self._way_out = WayOut()
        self._memory = Memory(2.0 * CELL_M) if memory else None
        self._hops = Hops(config, self._map, self._refiner.air_hard_m)
        self._begins = True
        self._seen = -1
        self._drawn_s = -math.inf
        self._energy = EnergyModel.of(config)
        self._turn_m = config.land.speed_mps / config.land.yaw_rate_rps  # a turn costs the time of so many
        self._seen_field: Field2

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once; without a frame (overwritten or not there yet) from the map as it is."""
        now = self._clock.now_s
        began_s = now()
        if frame is not None and frame.sequence != self._seen:
            self._seen = frame.sequence
            self._map.update(frame, request.frame_pose, request.floor_z_m)
            self._map.clear_robot(request.body_pose)
        mapped_s = now()
        if request.fresh or (self._previous is not None and self._previous.mode is not request.mode):
            self._previous = None
        if request.mode is Mode.LAND and (request.fresh or self._begins):
            self._map.assume_free(request.body_pose, RING_M)
        if request.fresh:
            self._way_out.reset()
            if request.mode is Mode.LAND:
                self._hops.reset()
        self._begins = False
        ways = self._ways_on_land(request)
        asked_s = now()
        network = self._first.ask(request, frame if self._asks else None, self._map)
        thought_s = now()
        room_above = self._column_clear(request, request.lift_to_m)
        if request.mode is Mode.LAND:
            followed, refined, routed_s, why = self._drive(request, network, ways, room_above)
        else:
            followed, refined, routed_s, why = self._fly(request, network, ways)
        done_s = now()
        self._previous = refined.trajectory
        planned = request.mode is Mode.LAND and self._hops.planned(ways, request.body_pose.position_m)
        at_once = request.mode is Mode.LAND and (self._way_out.hops or self._hops.must)
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=frame.stamp_s if frame is not None else math.nan,
            trajectory=refined.trajectory,
            network=network,
            followed=followed,
            source=refined.source,
            clearance_m=refined.clearance_m,
            reason="; ".join(part for part in (why, refined.reason) if part),
            lift_off_m=self._lift_off_m(request, network, ways, planned),
            land_path_ends=at_once or self._land_path_ends(request, ways, planned),
            take_off_clear=room_above,
            landing_clear=self._may_land(request, ways),
            hop=planned or at_once,
            stuck=request.mode is Mode.LAND and self._way_out.given_up,
            timings=Timings(
                mapped_s - began_s,
                thought_s - asked_s,
                routed_s - thought_s + asked_s - mapped_s,
                done_s - routed_s,
                done_s - began_s,
            ),
            probe=self._probe(request),
            map_xy_m=self._map_now_and_then(request.start_s),
        )

    # ------------------------------------------------------------------ ways on the map
    def _ways_on_land(self, request: PlanRequest) -> CostToGo:
        """To a goal on land, or to where a flight to one in the air is best begun."""
        goal = request.goal_m

        def search() -> CostToGo:
            self._seen_field = self._map.land_field(request.body_pose, request.floor_z_m)
            if self._memory is not None:
                place_m = request.body_pose.position_m
                sure = self._map.driving.surely_free()
                self._memory.remember(self._seen_field.coarser(), place_m, self._map.walls(), sure)
            ways = self._ways(request, None, ())
            if request.goal_in_air or request.mode is Mode.AIR:
                return ways
            return self._hops.on_land(request, self._plan(goal)[0], ways, hopping)

        def hopping(offers: Array) -> CostToGo:
            return self._ways(request, None, (), offers)

        asked = float(goal[0]), float(goal[1]), float(request.mode is Mode.AIR)
        return self._land_ways.of(asked, request.start_s, search)

    def _ways(
        self,
        request: PlanRequest,
        tight_m: float | None,
        closed: tuple[Array, ...],
        offers: Array | None = None,
    ) -> CostToGo:
        goal, hard_m = request.goal_m, self._refiner.land_hard_m
        plan, likely = self._plan(goal)
        if request.goal_in_air and self._seen_field.contains(goal[None, :2])[0]:
            air = self._ways_in_air(request, goal, float(goal[2]))
            offers = offers_by_air(plan, air, *self._take_off_column(request), goal, self._energy)
        return CostToGo(
            plan,
            goal[:2],
            hard_m + NARROW_MARGIN_M,
            reach_m=UNDER_GOAL_M if request.goal_in_air else GOAL_SNAP_M,
            roomy_m=hard_m + ROUTE_MARGIN_M,
            tight_m=tight_m,
            closed=closed,
            likely=likely,
            offers=offers,
        )

    def _plan(self, goal_m: Array) -> tuple[Field2, Bits | None]:
        """What searches on land go by, and where it is likely solid though unknown."""
        return (self._seen_field.coarser(), None) if self._memory is None else self._memory.plan(goal_m)

    def _take_off_column(self, request: PlanRequest) -> tuple[Field2, float]:
        """What stands in the way of take-offs, and the free radius that they need at a cell's middle."""
        low_m, high_m = column_m(self._config, request, request.lift_to_m)
        cell_m = self._map.cell_m
        return self._map.column_field(low_m, high_m), column_radius_m(self._config) + cell_m * math.sqrt(0.5)

    def _ways_in_air(self, request: PlanRequest, goal_m: Array, height_m: float) -> CostToGo:
        """At a height of the body in odom, as if the robot drove there."""
        floor_m = height_m - self._config.body.below_m - 0.1

        def search() -> CostToGo:
            layer = self._map.slice_field(request.body_pose, floor_m)
            return CostToGo(layer, goal_m[:2], self._refiner.air_hard_m)

        level = round(floor_m / self._map.cell_m)
        return self._air_ways.of((float(goal_m[0]), float(goal_m[1]), level), request.start_s, search)

    def _lift_off_m(self, request: PlanRequest, network: KeyPoints, ways: CostToGo, hops: bool) -> float:
        """How far it drives before it leaves the floor: by the network where it leads, else by the map."""
        here = request.body_pose.position_m
        if self._route.source is Source.GKPN:
            return lift_off_distance_m(here, network.points_m, network.air)
        way = ways.path(here[:2]) if request.goal_in_air or hops else None
        return math.inf if way is None else routes.length_m(way)

    def _land_path_ends(self, request: PlanRequest, ways: CostToGo, hops: bool) -> bool:
        """Driving on costs more than it saves."""
        here = request.body_pose.position_m[:2]
        end = ways.end(here) if request.goal_in_air or hops else None
        return end is not None and float(np.hypot(*(end - here))) < AT_END_M

    def _evidence(
        self, request: PlanRequest, network: KeyPoints, path: Array, ways: CostToGo
    ) -> routes.Evidence:
        pose = request.body_pose
        here = pose.position_m[:2]
        dense = routes.densify(np.vstack([here, path[:, :2]]))
        beyond = dense[np.hypot(*(dense - here).T) > 0.3]
        free = self._seen_field.lookup(beyond) - self._refiner.land_hard_m if len(beyond) else np.array([1.0])
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
        routed_s = self._clock.now_s()
        field = self._map.land_room(request.body_pose, request.floor_z_m, LAND_HALF_M)
        state = LandState(here[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps, float(here[2]))
        doing = self._way_out.step(
            request,
            ways,
            lambda closed: self._ways(request, TIGHT_M, closed),
            room_above and request.may_hop,
        )
        if doing is not None:
            said = "; ".join(part for part in (self._way_out.state.action.value, why) if part)
            refined = self._doing(state, doing, field, request)
            return None, refined, self._clock.now_s(), said
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
        if isinstance(what, float):
            trajectory = self._refiner.turn(state, what, request.start_s)
            return RefineResult(trajectory, Source.TURN, math.nan, False, "", 0.0)
        return self._refiner.land(
            state, what, field, request.start_s, self._previous, source=Source.SEARCH, speed_mps=CAREFUL_MPS
        )

    def _may_land(self, request: PlanRequest, ways: CostToGo) -> bool:
        """Room to come down here, and, for a goal on land, nothing to gain by flying on."""
        room = self._column_clear(request, float(request.body_pose.position_m[2]))
        if request.goal_in_air or request.mode is Mode.LAND:
            return room
        return self._hops.may_land(request, ways, room)

    # ------------------------------------------------------------------ second stage, in the air
    def _fly(
        self, request: PlanRequest, network: KeyPoints, ways: CostToGo
    ) -> tuple[KeyPoints | None, RefineResult, float, str]:
        motion = request.motion
        here = motion.position_m
        goal, over = np.array(request.goal_m, dtype=float), None
        if not request.goal_in_air:
            over = self._hops.in_air(request, ways)
            end = over.end(here[:2])
            goal = np.array([*(goal[:2] if end is None else end), here[2]])
        space = self._map.air_field(here, FIELD_HALF_M)
        points, source, why = self._air_points(request, network, goal, space, over)
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
        if not why:
            return points, Source.GKPN, ""
        if near or free_m(goal[None]) >= 0.0:
            return goal[None], Source.DIRECT, why
        way = (over or self._ways_in_air(request, goal, float(here[2]))).path(here[:2])
        if way is None:
            return here[None], Source.BRAKE, f"{why}; no way at this height"
        keys = to_key_points(way)
        rise = np.linspace(0.0, 1.0, len(keys) + 1)[1:]
        around = np.column_stack([keys[:, :2], here[2] + rise * (goal[2] - here[2])])
        return around, Source.SEARCH, why

    # ------------------------------------------------------------------ places to take off and land
    def _column_clear(self, request: PlanRequest, up_to_m: float) -> bool:
        return column_clear(self._map, self._config, request, up_to_m)

    def _probe(self, request: PlanRequest) -> str | None:
        """Whether the wheels could get to the place that is asked about, as far as the map knows."""
        place = request.probe_m
        if place is None:
            return None
        hard_m = self._refiner.land_hard_m
        plan, likely = self._plan(place)
        ways = CostToGo(plan, place[:2], hard_m + NARROW_MARGIN_M, likely=likely)
        if math.isfinite(ways.cost_m(request.body_pose.position_m[:2])):
            return ""
        if float(plan.lookup(place[None, :2])[0]) <= hard_m:
            return f"the place is in an obstacle, more than {GOAL_SNAP_M:g} m from floor that can be reached"
        return "the map shows no way there that is wide enough for the robot"

    def _map_now_and_then(self, now_s: float) -> np.ndarray | None:
        if now_s - self._drawn_s < MAP_EVERY_S:
            return None
        self._drawn_s = now_s
        return np.asarray(self._seen_field.surface_points(), dtype=np.float32)
