"""A planner: it sees where the robot is, and says how fast it is to drive."""

import ctypes
import time
from typing import Iterator, NamedTuple

from . import layouts
from .graph import END, RUNNING, GraphError, Input, Orphaned, Output, Participant

_COMMAND = "drive/command"


class _Velocity(ctypes.Structure):
    _fields_ = [("v_mps", ctypes.c_double), ("w_radps", ctypes.c_double)]

    @staticmethod
    def type_name():
        return "echogrid/Velocity/1"


class Place(NamedTuple):
    """Where the robot is: seconds of its clock, metres and radians in the frame of the map, and the weight of a reading from there."""

    stamp: float
    x: float
    y: float
    theta: float
    trust: float


class Planner:
    """Drives the robot of the graph that started this program. Iterating gives the newest `Place` of the robot, each time there is one;
    it ends with the graph. The sensor must read `drive/command`, and this program write it, by the graph file.

    The robot stands when the `with` is left. A Pioneer stands, too, when nothing was said for `pioneer.dead_man_s`.
    """

    def __init__(self):
        self._process = Participant()
        declared = self._process.plan["config"].get("topics", {}).get(_COMMAND)
        if declared is None:
            raise GraphError(f"no service of the graph file reads or writes {_COMMAND}: writes = [{_COMMAND!r}] of this one does")
        self._estimates = Input(self._process.domain, "odometry/estimate")
        topic = layouts.Topic(0, _Velocity, False, "latest")
        self._command = Output(self._process.domain, _COMMAND, time.time_ns(), topic=topic)
        self._over = False

    def __enter__(self):
        self._process.health.state = RUNNING
        self._process.beat(now=True)
        return self

    def __exit__(self, kind, error, traceback):
        if kind is not None and issubclass(kind, Orphaned):
            return True
        self.drive(0.0, 0.0)
        if kind is None:
            self._process.end()
        elif issubclass(kind, Exception):
            self._process.fail(f"{kind.__name__}: {error}")
        return False

    def drive(self, v: float, w: float):
        """Forward speed, m/s, and turn rate, rad/s, counter-clockwise, from now on."""
        self._command.send(self._process.health.stamp_ns, _Velocity(v, w))
        self._command.ring()

    def __iter__(self) -> Iterator[Place]:
        process = self._process
        while not (self._over or process.is_stopped):
            self._estimates.wait(0.05)
            process.attend()
            newest = None
            for header, payload in self._estimates:
                if header.flags & END:
                    self._over = True
                    continue
                at = payload.contents
                newest = Place(header.stamp_ns * 1e-9, at.x_m, at.y_m, at.theta_rad, at.trust)
                process.health.stamp_ns = header.stamp_ns
                process.health.progress += 1
            if newest is not None:
                yield newest
