#!/usr/bin/env python3
"""A sensor in Python: a make-believe robot that drives around a square room; the same drive whenever it is started."""

from math import cos, pi, sin

import echogrid

ROOM = 6.0
ROBOT = echogrid.Robot("walk", [echogrid.sonar(0.2 * cos(a), 0.2 * sin(a), a) for a in (k * pi / 4 for k in range(8))], 0.5, 0.5)


def to_the_wall(x, y, bearing):
    ahead = [(ROOM if way > 0 else 0.0) - at for at, way in ((x, cos(bearing)), (y, sin(bearing)))]
    return min(gap / way for gap, way in zip(ahead, (cos(bearing), sin(bearing))) if abs(way) > 1e-9)


def heard(x, y, theta, sonar):
    x, y = x + sonar.x * cos(theta) - sonar.y * sin(theta), y + sonar.x * sin(theta) + sonar.y * cos(theta)
    cone = (theta + sonar.theta + part / 10 * sonar.aperture for part in range(-5, 6))
    nearest = min(to_the_wall(x, y, bearing) for bearing in cone)
    return nearest if nearest < sonar.range_max else None  # None: no echo


with echogrid.Sensor(ROBOT) as sensor:
    for step in range(600):
        angle = step * 2 * pi / 600
        x, y, theta = 3 + 1.5 * cos(angle), 3 + 1.5 * sin(angle), angle + pi / 2
        sensor.odometry(step * 0.1, x, y, theta, v=0.157, w=0.105)
        sensor.scan(step * 0.1, [heard(x, y, theta, sonar) for sonar in ROBOT.sensors])
