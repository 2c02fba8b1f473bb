"""Occupancy round the robot, built from depth images: log-odds cells in a box that moves with the robot.

Unknown is kept apart from free. The box is centred on the robot in x and y and moves by whole cells; in
height it stands on the floor, so that the floor and everything the robot can reach stay inside. Frame: odom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LabrError
from labr_autonomy.frames import rotation_matrix
from labr_autonomy.perception.columns import columns, unended
from labr_autonomy.perception.driving_layer import DrivingLayer
from labr_autonomy.perception.fields import Bits, Field2, Field3
from labr_autonomy.perception.ground import scan
from labr_autonomy.perception.raycast import Grid, integrate
from labr_autonomy.perception.shift import moved
from labr_autonomy.types import Array, DepthFrame, Intrinsics, Pose

# Log-odds in units of 0.05: two certain returns make an obstacle, and eight frames that see through the
# strongest obstacle remove it again.
HIT, MISS = 20, 5
LOWEST, HIGHEST = -40, 70
OCCUPIED = 30

FLOOR_BAND_M = 0.06  # lower than this above the floor nothing is in the way of a slice
ON_WHEELS_M = 0.05  # no higher than this above its driving height, the robot is as inclined as the floor
BELOW_FLOOR_CELLS = 2
GOES_ON_FROM_M = 0.4  # above the floor; a wall from close by shows little more, its top is out of view
WALL_FROM_M = 0.8  # above the floor; what stands so high is taken to go on where nothing was seen
WALL_TO_M = 1.7  # and this high at most: lintels and ceilings say nothing of the floor
HEADROOM_M = 0.6  # above the body origin, kept inside the box
LAYER_OVERLAP_M = 0.02  # a layer counts for a height range when it overlaps it by more than this
LAND_HEADROOM_M = 0.05  # added to the robot's height when it drives under something

# D435 datasheet and recordings: 0.1 px of disparity at 848 columns, 50 mm baseline.
_DISPARITY_SIGMA_PX, _SENSOR_COLUMNS, _BASELINE_M = 0.1, 848, 0.050


@dataclass(frozen=True, slots=True)
class Column:
    """What the map knows of an upright cylinder."""

    occupied: int  # cells
    known: float  # share of the cells that have been seen, 0..1

    @property
    def clear(self) -> bool:
        """Whether no cell is occupied; look at `known` as well."""
        return self.occupied == 0


class RollingMap:
    """Log-odds occupancy grid that follows the robot.

    Args:
        config: Outline, camera and clearances.
        size_m: Edges of the box [m].
        cell_m: Edge of a cell [m].
        stride: Every how many pixels, in both directions, a ray is cast; the pattern shifts with each frame.
        range_m: Longest distance at which returns and free space are believed [m].
    """

    def __init__(
        self,
        config: RobotConfig,
        size_m: tuple[float, float, float] = (20.0, 20.0, 3.2),
        cell_m: float = 0.1,
        *,
        stride: int = 3,
        range_m: float = 6.0,
    ) -> None:
        self._config = config
        self.cell_m = cell_m
        self.stride = stride
        self.range_m = range_m
        shape = tuple(round(edge / cell_m) for edge in size_m)
        self.log_odds: Grid = np.zeros(shape, np.int8)
        self._corner = np.zeros(3, np.int64)  # odom, in whole cells
        self._marks = np.zeros(self.log_odds.size, np.int8)
        self._touched = np.zeros(self.log_odds.size, np.int32)
        self._placed = False
        body = config.body
        self.driving = DrivingLayer(size_m[0], body.below_m + body.above_m + LAND_HEADROOM_M)
        self.floor_z_m = 0.0
        self.frames = 0

    @property
    def origin_m(self) -> Array:
        """Lower corner (3,) odom [m]."""
        out: Array = self._corner.astype(np.float64) * self.cell_m
        return out

    @property
    def occupied(self) -> Bits:
        """(nx, ny, nz) cells believed solid."""
        return self.log_odds >= OCCUPIED

    @property
    def unknown(self) -> Bits:
        """(nx, ny, nz) cells that were neither seen to be solid nor seen through."""
        return (self.log_odds >= 0) & (self.log_odds < OCCUPIED)

    def update(self, frame: DepthFrame, pose: Pose, floor_z_m: float) -> int:
        """Take in one depth image.

        Args:
            frame: The image.
            pose: Body in odom at the image's stamp.
            floor_z_m: Height of the floor under the robot, odom.

        Returns:
            How many cells were seen.
        """
        self._follow(pose.position_m, floor_z_m)
        camera = self._config.camera
        rotation = np.ascontiguousarray(rotation_matrix(pose.quaternion))
        eye_m = pose.position_m + rotation @ np.array([camera.x_m, 0.0, camera.z_m])
        k = self.frames
        self.frames += 1
        cell, optics = self.cell_m, _optics(frame.intrinsics)
        depth_m = np.ascontiguousarray(frame.depth_m, np.float32)
        sampling = (self.stride, k % self.stride, (k // self.stride) % self.stride)
        near_m, far_m = camera.range_min_m, camera.range_max_m
        kinds, floors_m = scan(
            depth_m,
            optics,
            rotation,
            eye_m,
            *self._below(pose, rotation, eye_m, floor_z_m),
            stride=self.stride,
            first=sampling[2],
            range_m=(near_m, far_m),
            known_m=max(0.0, self._config.body.radius_m - camera.x_m) if self._on_wheels(pose) else 0.0,
        )
        self.driving.update(
            depth_m,
            kinds,
            floors_m,
            optics=optics,
            rotation=rotation,
            eye_m=eye_m,
            floor_z_m=floor_z_m,
            sampling=sampling,
            range_m=self.range_m,
            stamp_s=frame.stamp_s,
        )
        return integrate(
            self.log_odds,
            self._marks,
            self._touched,
            depth_m,
            optics=optics,
            rotation=rotation,
            eye=eye_m / cell - self._corner,
            cell_m=cell,
            sampling=sampling,
            ranges=(near_m, far_m, self.range_m, self.range_m),
            kinds=kinds,
            weights=(HIT, MISS, LOWEST, HIGHEST),
        )

    def _below(
        self, pose: Pose, rotation: Array, eye_m: Array, floor_z_m: float
    ) -> tuple[float, tuple[float, float]]:
        """Floor below the camera, and its incline along x and y: the wheels' where they stand on it."""
        up = rotation[:, 2]
        if not self._on_wheels(pose) or up[2] < 0.5:
            return floor_z_m, (0.0, 0.0)
        x, y = float(-up[0] / up[2]), float(-up[1] / up[2])
        ahead = eye_m - pose.position_m
        return floor_z_m + x * float(ahead[0]) + y * float(ahead[1]), (x, y)

    def _on_wheels(self, pose: Pose) -> bool:
        return bool(pose.position_m[2] - self.floor_z_m <= self._config.body.below_m + ON_WHEELS_M)

    def clear_robot(self, pose: Pose) -> None:
        """Mark the space the robot itself fills as free: cells whose centre lies in its outline."""
        if not self._placed:
            self._follow(pose.position_m, pose.position_m[2] - self._config.body.below_m)
        body = self._config.body
        x, y, disc = self._disc(pose.position_m[:2], body.radius_m)
        low, high = self._layers(pose.position_m[2] - body.below_m, pose.position_m[2] + body.above_m)
        region = self.log_odds[x, y, low:high]
        region[disc] = np.minimum(region[disc], LOWEST)
        if self._on_wheels(pose):
            self.driving.clear(pose.position_m[:2], body.radius_m)

    def land_field(self, pose: Pose, floor_z_m: float) -> Field2:
        """Distance to what was seen to hinder the driving body, over the whole box; `driving_layer`.

        Args:
            pose: Body in odom; with the floor's height it places the box when nothing has been seen yet.
            floor_z_m: Of the floor below it, odom.
        """
        if not self._placed:
            self._follow(pose.position_m, floor_z_m)
        return self.driving.seen()

    def land_room(self, pose: Pose, floor_z_m: float, half_m: float) -> Field2:
        """The same in a square round the robot where what was not seen counts as solid; as above.

        Args:
            pose: As for `land_field`.
            floor_z_m: As for `land_field`.
            half_m: Half of the square's edge.
        """
        if not self._placed:
            self._follow(pose.position_m, floor_z_m)
        return self.driving.room(pose.position_m, half_m)

    def assume_free(self, pose: Pose, ring_m: float) -> None:
        """Take the floor about a robot for free that the camera cannot see: it was put, or came down, there.

        Args:
            pose: Body in odom, on its wheels.
            ring_m: So far beyond the outline.
        """
        if not self._placed:
            self._follow(pose.position_m, pose.position_m[2] - self._config.body.below_m)
        self.driving.assume_free(pose.position_m[:2], self._config.body.radius_m + ring_m)

    def slice_field(self, pose: Pose, floor_z_m: float) -> Field2:
        """Distance to what would hinder a robot that drove at some height, as for flying at it.

        Known is a column where an obstacle was seen, or whose lowest layer and most of the others up to
        the robot's height were seen free. What stands high and was not seen to end below goes on.

        Args:
            pose: Body in odom; places the box when nothing has been seen yet.
            floor_z_m: Height of the floor that it would drive on, odom; the box stays as the last frame
                left it.
        """
        if not self._placed:
            self._follow(pose.position_m, floor_z_m)
        body = self._config.body
        top_m = floor_z_m + body.below_m + body.above_m + LAND_HEADROOM_M
        low, high = self._layers(floor_z_m + FLOOR_BAND_M, top_m)
        occupied, known = columns(self.log_odds, low, high, OCCUPIED)
        tall, _ = self._layers(self.floor_z_m + GOES_ON_FROM_M, top_m)
        if tall < low:
            occupied |= unended(self.log_odds, tall, low, OCCUPIED) & ~known
            known |= occupied
        return Field2.from_occupied(occupied, known, self.origin_m[:2], self.cell_m)

    def column_field(self, z_from_m: float, z_to_m: float) -> Field2:
        """Distance to whatever was seen between two heights (odom), for judging columns of many places."""
        self._require_place()
        low, high = self._layers(z_from_m, z_to_m)
        occupied, known = columns(self.log_odds, low, high, OCCUPIED)
        return Field2.from_occupied(occupied, known, self.origin_m[:2], self.cell_m)

    def walls(self) -> Array:
        """Middles (k, 2) odom of the columns in which something as high as a wall was seen."""
        self._require_place()
        low, high = self._layers(self.floor_z_m + WALL_FROM_M, self.floor_z_m + WALL_TO_M)
        cells = np.argwhere(columns(self.log_odds, low, high, OCCUPIED)[0])
        out: Array = np.add(self._corner[:2] + 0.5, cells, dtype=np.float64) * self.cell_m
        return out

    def air_field(self, centre_m: Array, half_m: tuple[float, float] = (3.0, 3.0)) -> Field3:
        """Distance to anything solid in a crop of the box, over its whole height; below the floor all is.

        Args:
            centre_m: Centre of the crop (2,) or (3,), odom; only x and y count.
            half_m: Half of its edges along x and y [m].
        """
        self._require_place()
        centre = np.asarray(centre_m, float)[:2]
        half = np.asarray(half_m, float)
        shape = np.array(self.log_odds.shape[:2])
        low = np.floor((centre - half) / self.cell_m).astype(np.int64) - self._corner[:2]
        high = np.ceil((centre + half) / self.cell_m).astype(np.int64) - self._corner[:2]
        low, high = np.clip(low, 0, shape - 1), np.clip(high, 1, shape)
        high = np.maximum(high, low + 1)
        crop = self.log_odds[low[0] : high[0], low[1] : high[1]]
        occupied = crop >= OCCUPIED
        known = occupied | (crop < 0)
        below = max(0, round(self.floor_z_m / self.cell_m - float(self._corner[2])))
        occupied[:, :, :below] = True
        known[:, :, :below] = True
        corner = self._corner + np.array([low[0], low[1], 0])
        return Field3.from_occupied(occupied, known, corner * self.cell_m, self.cell_m)

    def column_clear(self, xy_m: Array, radius_m: float, z_from_m: float, z_to_m: float) -> Column:
        """What is known of an upright cylinder, to judge places for take-off and landing.

        Args:
            xy_m: Axis (2,), odom.
            radius_m: Radius; every cell that it touches counts.
            z_from_m: Lower end, odom; leave out the floor's band.
            z_to_m: Upper end, odom.
        """
        self._require_place()
        wanted = max(1, math.ceil((z_to_m - z_from_m) / self.cell_m - 1e-6)) * (
            math.pi * (radius_m / self.cell_m) ** 2
        )
        x, y, disc = self._disc(np.asarray(xy_m, float), radius_m, touching=True)
        low, high = self._layers(z_from_m, z_to_m)
        region = self.log_odds[x, y, low:high][disc]
        occupied = int((region >= OCCUPIED).sum())
        seen = int((region < 0).sum()) + occupied
        # What lies outside the box was not seen: never divide by fewer cells than the cylinder has.
        return Column(occupied, min(1.0, seen / max(region.size, wanted, 1)))

    def _follow(self, position_m: Array, floor_z_m: float) -> None:
        """Move the box so that the robot is in its middle and the floor at its bottom."""
        shape = np.array(self.log_odds.shape)
        corner = np.floor(position_m / self.cell_m).astype(np.int64) - shape // 2
        floor_cell = round(floor_z_m / self.cell_m)
        corner[2] = floor_cell - BELOW_FLOOR_CELLS
        if self._placed and 1 <= floor_cell - self._corner[2] <= BELOW_FLOOR_CELLS + 1:
            corner[2] = self._corner[2]  # the floor's estimate may waver by a cell
        top = math.ceil((position_m[2] + HEADROOM_M) / self.cell_m)
        corner[2] = max(corner[2], top - shape[2])
        self.floor_z_m = floor_z_m
        if self._placed and (corner != self._corner).any():
            self.log_odds = moved(self.log_odds, corner - self._corner, 0)
        self._corner = corner
        self._placed = True
        if self.driving.follow(position_m):
            self.log_odds -= self.log_odds > 0

    def _disc(self, xy_m: Array, radius_m: float, touching: bool = False) -> tuple[slice, slice, Bits]:
        """Cells of a disc: slices along x and y and the mask within them, by centre or by any touch."""
        cells = []
        offsets = []
        for axis in (0, 1):
            at = float(xy_m[axis]) / self.cell_m - float(self._corner[axis])
            reach = radius_m / self.cell_m + 1.0
            size = self.log_odds.shape[axis]
            low = min(max(math.floor(at - reach), 0), size)
            high = min(max(math.ceil(at + reach), low), size)
            cells.append(slice(low, high))
            away = np.abs(np.arange(low, high) + 0.5 - at)
            offsets.append(np.maximum(away - 0.5, 0.0) if touching else away)
        squared = offsets[0][:, None] ** 2 + offsets[1][None, :] ** 2
        disc: Bits = squared <= (radius_m / self.cell_m) ** 2
        return cells[0], cells[1], disc

    def _layers(self, low_m: float, high_m: float) -> tuple[int, int]:
        """Range of layers that overlap a height range, clipped to the box; at least one."""
        base = float(self._corner[2])
        size = self.log_odds.shape[2]
        low = math.floor((low_m + LAYER_OVERLAP_M) / self.cell_m - base)
        high = math.ceil((high_m - LAYER_OVERLAP_M) / self.cell_m - base)
        low = min(max(low, 0), size - 1)
        return low, min(max(high, low + 1), size)

    def _require_place(self) -> None:
        if not self._placed:
            raise LabrError("the rolling map is empty", "Give it a depth frame or clear_robot() first.")


def _optics(i: Intrinsics) -> tuple[float, float, float, float, float]:
    """Pinhole and depth noise at one metre."""
    focal_px = i.fx * _SENSOR_COLUMNS / i.width  # at the sensor's own resolution
    return i.fx, i.fy, i.cx, i.cy, _DISPARITY_SIGMA_PX / (focal_px * _BASELINE_M)


def warm_up() -> None:
    """Compile or load the kernels, so that the first frame of a flight is not late."""
    grid = RollingMap(RobotConfig(), (1.0, 1.0, 1.0))
    depth = np.ones((12, 16), np.float32)
    frame = DepthFrame(0, 0.0, depth, Intrinsics(16, 12, 8.0, 8.0, 8.0, 6.0))
    pose = Pose(np.array([0.0, 0.0, 0.12]), np.array([1.0, 0.0, 0.0, 0.0]))
    grid.update(frame, pose, 0.0)
    grid.clear_robot(pose)
    land, air = grid.land_field(pose, 0.0), grid.air_field(np.zeros(2))
    land.lookup(np.zeros((1, 2)))
    air.lookup(np.zeros((1, 3)))
    land.surface_points()
    air.surface_points()
