"""Sensors and listeners for echogrid graphs, in Python.

    import echogrid

    with echogrid.Sensor(echogrid.Robot("mine", [echogrid.sonar(0.2, 0.0, 0.0)])) as sensor:
        sensor.odometry(0.0, x=0.0, y=0.0, theta=0.0)
        sensor.scan(0.0, {0: 1.5})
        sensor.odometry(0.1, x=0.02, y=0.0, theta=0.0)

Needs the package `iceoryx2`, 0.10.0; maps as arrays need `numpy`. Stamps are seconds, lengths metres, angles radians,
counter-clockwise; x is forward, y is left. The contract behind it is docs/topics.md, this module is docs/python.md.
"""

from .graph import GraphError, Orphaned
from .maps import Grid, MapListener
from .sensor import INVALID, Robot, Sensor, Transducers, lidar, sonar

__all__ = [
    "INVALID",
    "GraphError",
    "Grid",
    "MapListener",
    "Orphaned",
    "Robot",
    "Sensor",
    "Transducers",
    "lidar",
    "sonar",
]
