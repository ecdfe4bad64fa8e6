#!/usr/bin/env python3
"""A ROS 2 robot as the sensor of a graph: /odom and /scan, printed as lines. Needs rclpy, and nothing of echogrid (docs/ros.md).

    [services.sensor]
    exec = "./lines_of_ros2.py"
    args = ["--ros-args", "-p", "mount:=[0.1, 0.0, 0.0]", "-r", "scan:=/base_scan"]
    speaks = "carmen"
"""

import math

import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan


def seconds(header):
    return header.stamp.sec + header.stamp.nanosec * 1e-9


class Lines(Node):
    """Prints what it hears. `mount`: the laser's x, y and heading in the robot's base, metres and radians."""

    def __init__(self):
        super().__init__("echogrid_lines")
        self.mount = self.declare_parameter("mount", [0.0, 0.0, 0.0]).value
        self.pose = None
        self.create_subscription(Odometry, "odom", self.odometry, qos_profile_sensor_data)
        self.create_subscription(LaserScan, "scan", self.scan, qos_profile_sensor_data)

    def odometry(self, message):
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        heading = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
        speed = message.twist.twist
        self.pose = place.x, place.y, heading
        stamp = seconds(message.header)
        print(f"ODOM {place.x:.6f} {place.y:.6f} {heading:.6f} {speed.linear.x:.4f} {speed.angular.z:.4f} 0 {stamp:.9f} ros 0", flush=True)

    def scan(self, message):
        if self.pose is None:
            return
        x, y, heading = self.pose
        dx, dy, turned = self.mount
        laser = x + dx * math.cos(heading) - dy * math.sin(heading), y + dx * math.sin(heading) + dy * math.cos(heading), heading + turned
        # No echo is the maximum, what says nothing is 0.
        far = message.range_max
        ranges = [far if math.isinf(r) and r > 0 else r if message.range_min <= r <= far else 0.0 for r in message.ranges]
        view = message.angle_increment * (len(ranges) - 1)
        words = ["ROBOTLASER1", 0, message.angle_min, view, message.angle_increment, far, 0.01, 0, len(ranges), *ranges, 0]
        words += [*laser, x, y, heading, 0, 0, 0, 0, 0, f"{seconds(message.header):.9f}", "ros", 0]
        print(*words, flush=True)


rclpy.init()
try:
    rclpy.spin(Lines())
except KeyboardInterrupt:
    pass
