#!/usr/bin/env python3
"""The map of a running graph as a nav_msgs/OccupancyGrid on /map, for RViz and Nav2. Needs rclpy, iceoryx2 and numpy (docs/ros.md)."""

import numpy
import rclpy
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile

import echogrid


def occupancy(grid):
    """Percent of probability, -1 where nothing is known."""
    percent = numpy.nan_to_num(numpy.rint(100 * grid.probability), nan=-1)
    return percent.astype(numpy.int8)


def message(grid, now):
    """A grid as ROS has it; row 0 is the lowest y in both."""
    to = OccupancyGrid()
    to.header.frame_id, to.header.stamp = "map", now
    to.info.resolution = float(grid.resolution)
    to.info.height, to.info.width = grid.log_odds.shape
    to.info.origin.position.x, to.info.origin.position.y = map(float, grid.origin)
    to.info.origin.orientation.w = 1.0
    to.data = occupancy(grid).ravel().tolist()
    return to


rclpy.init()
node = rclpy.create_node("echogrid_map")
# Whoever comes late gets the map, too.
publisher = node.create_publisher(OccupancyGrid, "map", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
with echogrid.MapListener() as maps:
    for grid in maps:
        publisher.publish(message(grid, node.get_clock().now().to_msg()))
