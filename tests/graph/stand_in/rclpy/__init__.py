"""A stand-in for rclpy, for tests where no ROS is installed: a robot drives around a room of 6 m; what is published is printed."""

import math
from types import SimpleNamespace as Some

from . import node, qos

STEPS = 300


def init():
    """There is nothing to begin."""


def create_node(name):
    return node.Node(name)


def spin(of):
    """Hands a node what a robot with a laser would publish, ten times a second."""
    for step in range(STEPS):
        header = Some(stamp=Some(sec=100 + step // 10, nanosec=step % 10 * 100_000_000))
        angle = step * 2 * math.pi / STEPS
        heading = angle + math.pi / 2
        x, y = 1.5 * math.cos(angle), 1.5 * math.sin(angle)
        turn = Some(w=math.cos(heading / 2), x=0.0, y=0.0, z=math.sin(heading / 2))
        twist = Some(linear=Some(x=0.3), angular=Some(z=0.2))
        pose = Some(position=Some(x=x, y=y), orientation=turn)
        of.handlers["odom"](Some(header=header, pose=Some(pose=pose), twist=Some(twist=twist)))
        ranges = [to_the_wall(x, y, heading + math.radians(beam - 30)) for beam in range(61)]
        ranges[:2] = math.inf, math.nan
        first, step_rad = math.radians(-30), math.radians(1)
        of.handlers["scan"](Some(header=header, angle_min=first, angle_increment=step_rad, range_min=0.05, range_max=8.0, ranges=ranges))


def to_the_wall(x, y, bearing):
    along = [((3 if way > 0 else -3) - at) / way for at, way in ((x, math.cos(bearing)), (y, math.sin(bearing))) if abs(way) > 1e-9]
    return min(along)
