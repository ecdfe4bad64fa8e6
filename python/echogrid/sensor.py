"""A sensor: what it looks like, where the robot is, what it hears."""

import math
import time
from dataclasses import dataclass, field
from typing import Dict, Iterable, List, Mapping, Optional, Union

from . import layouts
from .graph import RUNNING, GraphError, Orphaned, Participant, Stopped, put_text

HIT, NO_ECHO, _INVALID = 0, 1, 2
# A reading that says nothing about the world; None is another: that nothing answered.
INVALID = math.nan
_TOPICS = ["robot/description", "truth/pose", "odometry/raw", "range/scan"]


@dataclass
class Transducers:
    """A sonar, or a lidar of many beams, mounted at x, y, theta in the robot's base."""

    kind: int
    x: float
    y: float
    theta: float
    count: int
    first_bearing: float
    bearing_step: float
    aperture: float
    range_min: float
    range_max: float
    error_ratio: float


def sonar(x, y, theta, aperture=math.radians(30), range_min=0.1, range_max=5.0, error_ratio=0.01):
    """A sonar that looks along `theta`, with a cone of the full angle `aperture`."""
    return Transducers(1, x, y, theta, 1, 0.0, 0.0, aperture, range_min, range_max, error_ratio)


def lidar(x, y, theta, beams, first_bearing, bearing_step, aperture=None, range_min=0.02, range_max=12.0, error_ratio=0.002):
    """A planar lidar: beam i looks along `first_bearing` + i * `bearing_step` in its own frame."""
    aperture = abs(bearing_step) if aperture is None else aperture
    return Transducers(2, x, y, theta, beams, first_bearing, bearing_step, aperture, range_min, range_max, error_ratio)


@dataclass
class Robot:
    """The robot: its range sensors, in the order of their transducers, and its size (0: unknown)."""

    name: str
    sensors: List[Transducers] = field(default_factory=list)
    length: float = 0.0
    width: float = 0.0

    def description(self):
        """As it goes over the topic."""
        message = layouts.RobotDescription(footprint_length_m=self.length, footprint_width_m=self.width)
        if len(self.sensors) > len(message.sensors):
            raise GraphError(f"robot {self.name!r} has {len(self.sensors)} sensors; expected at most {len(message.sensors)}")
        put_text(message.name, self.name)
        message.sensor_count = len(self.sensors)
        first = 0
        for wire, of in zip(message.sensors, self.sensors):
            wire.kind, wire.first_transducer, wire.transducers = of.kind, first, of.count
            wire.x_m, wire.y_m, wire.theta_rad = of.x, of.y, of.theta
            wire.first_bearing_rad, wire.bearing_step_rad, wire.aperture_rad = of.first_bearing, of.bearing_step, of.aperture
            wire.range_min_m, wire.range_max_m, wire.range_error_ratio = of.range_min, of.range_max, of.error_ratio
            first += of.count
        return message


Ranges = Union[Mapping[int, Optional[float]], Iterable[Optional[float]]]


class Sensor:
    """The sensor of a graph. Within its `with`, what it says goes to the graph, as fast as that takes it.

    The end of the `with` ends the streams, and so does the launcher's word: then the body is left by an exception that goes no
    further. After a death this program is started again: if it says the same again, nothing is lost and nothing doubled. One that
    can't belongs into the graph file with `restart = "never"`.
    """

    def __init__(self, robot: Robot, knows_truth: bool = False):
        self._process = Participant()
        self._process.open_outputs(_TOPICS)
        self._robot, self._knows_truth = robot, knows_truth
        self._rate, self._began = self._process.plan.get("rate"), None

    def __enter__(self):
        self._process.health.state = RUNNING
        self._process.beat(now=True)
        output = self._process.outputs["robot/description"]
        output.send(0, self._robot.description())
        output.ring()
        return self

    def __exit__(self, kind, error, traceback):
        if kind is None or issubclass(kind, Stopped):
            try:
                self._process.end()
            except Orphaned:
                pass
            return True
        if issubclass(kind, Orphaned):
            return True
        if issubclass(kind, Exception):
            self._process.fail(f"{kind.__name__}: {error}")
        return False

    @property
    def plan(self) -> Dict:
        """What the launcher says of the run; `plan["config"]` holds the sections of the graph file."""
        return self._process.plan

    def note(self, text: str):
        """For people: how what this sensor measures with is doing."""
        put_text(self._process.health.note, text)

    def odometry(self, stamp, x, y, theta, v=0.0, w=0.0):
        """Where the wheels believe the robot is, at `stamp` seconds of any clock that does not run backwards."""
        if self._knows_truth:
            raise GraphError("this sensor knows the truth: give it with the odometry, by odometry_and_truth")
        self._send("odometry/raw", stamp, layouts.OdometryRaw(x, y, theta, v, w))

    def odometry_and_truth(self, stamp, x, y, theta, true_x, true_y, true_theta, v=0.0, w=0.0):
        """As `odometry`, with where the robot really is, which only a simulator or motion capture knows."""
        self._send("truth/pose", stamp, layouts.TruePose(true_x, true_y, true_theta, 1))
        self._send("odometry/raw", stamp, layouts.OdometryRaw(x, y, theta, v, w))

    def scan(self, stamp, ranges: Ranges, offsets: Mapping[int, float] = {}):
        """Ranges by transducer, or of all of them in their order. `None` is no echo, `INVALID` a reading that says nothing.

        `offsets`: seconds after the stamp at which a transducer fired, where that differs.
        """
        numbered = ranges.items() if isinstance(ranges, Mapping) else enumerate(ranges)
        readings = []
        for transducer, range_m in numbered:
            echo = NO_ECHO if range_m is None else _INVALID if not math.isfinite(range_m) or range_m <= 0 else HIT
            offset_ns = round(offsets.get(transducer, 0.0) * 1e9)
            readings.append(layouts.RangeReading(range_m if echo == HIT else 0.0, offset_ns, transducer, echo))
        if len(readings) > self._process.plan["max_readings"]:
            most = self._process.plan["max_readings"]
            raise GraphError(f"{len(readings)} readings in one scan; this run has room for {most}: name the robot (run.robot)")
        self._send("range/scan", stamp, readings)

    def _send(self, topic, stamp, payload):
        process, output, stamp_ns = self._process, self._process.outputs[topic], round(stamp * 1e9)
        process.attend()
        while True:
            if process.is_stopped:
                raise Stopped
            acknowledged = process.acknowledged(topic)
            if acknowledged is not None and output.sequence < acknowledged:
                # An earlier life of this program said it, and everybody has it.
                output.sequence += 1
                break
            due_s = self._due_in(stamp_ns)
            if due_s <= 0 and acknowledged is not None and output.sequence < acknowledged + process.window(topic):
                output.send(stamp_ns, payload)
                output.ring()
                break
            process.health.waits_for = output.topic.code if due_s <= 0 else 0
            process.attend(patience_s=due_s if due_s > 0 else 1.0)
        health = process.health
        health.waits_for, health.progress, health.stamp_ns = 0, health.progress + 1, stamp_ns
        health.first_stamp_ns = health.first_stamp_ns or stamp_ns

    def _due_in(self, stamp_ns):
        """Seconds until a stamp is due, at the rate of the run."""
        if not self._rate:
            return 0.0
        if self._began is None:
            self._began = (time.monotonic(), stamp_ns)
        began_s, first_ns = self._began
        return began_s + (stamp_ns - first_ns) * 1e-9 / self._rate - time.monotonic()
