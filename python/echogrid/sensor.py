"""A sensor: what it looks like, where the robot is, what it hears."""

import time
from typing import Dict, Iterable, Mapping, Optional, Union

from . import layouts
from .graph import RUNNING, GraphError, Orphaned, Participant, Stopped, put_text
from .robot import Robot, readings

_TOPICS = ["robot/description", "truth/pose", "odometry/raw", "range/scan"]


def _description(robot: Robot):
    """A robot as it goes over the topic."""
    message = layouts.RobotDescription(footprint_length_m=robot.length, footprint_width_m=robot.width)
    if len(robot.sensors) > len(message.sensors):
        raise GraphError(f"robot {robot.name!r} has {len(robot.sensors)} sensors; expected at most {len(message.sensors)}")
    put_text(message.name, robot.name)
    message.sensor_count = len(robot.sensors)
    first = 0
    for wire, of in zip(message.sensors, robot.sensors):
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
        output.send(0, _description(self._robot))
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
        scan = [
            layouts.RangeReading(range_m, round(offsets.get(transducer, 0.0) * 1e9), transducer, echo)
            for transducer, echo, range_m in readings(ranges)
        ]
        if len(scan) > self._process.plan["max_readings"]:
            most = self._process.plan["max_readings"]
            raise GraphError(f"{len(scan)} readings in one scan; this run has room for {most}: name the robot (run.robot)")
        self._send("range/scan", stamp, scan)

    def _send(self, topic, stamp, payload):
        process, output, stamp_ns = self._process, self._process.outputs[topic], round(stamp * 1e9)
        process.attend()
        while True:
            if process.is_stopped and all(process.may_end(name) for name in process.outputs):
                raise Stopped
            acknowledged = process.acknowledged(topic)
            if acknowledged is not None and output.sequence < acknowledged:
                # An earlier life of this program said it, and everybody has it.
                output.sequence += 1
                break
            due_s = 0.0 if process.is_stopped else self._due_in(stamp_ns)
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
