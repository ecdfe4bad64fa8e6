"""What a robot looks like."""

import math
from dataclasses import dataclass, field
from typing import List

# A reading that says nothing about the world; None is another: that nothing answered.
INVALID = math.nan


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


HIT, NO_ECHO, _INVALID = 0, 1, 2


def readings(ranges):
    """Transducer, echo as on the wire, and range, of a mapping by transducer or of all ranges in their order."""
    numbered = ranges.items() if hasattr(ranges, "items") else enumerate(ranges)
    for transducer, range_m in numbered:
        range_m = None if range_m is None else float(range_m)
        if range_m is None or range_m == math.inf:
            yield int(transducer), NO_ECHO, 0.0
        elif not math.isfinite(range_m) or range_m <= 0:
            yield int(transducer), _INVALID, 0.0
        else:
            yield int(transducer), HIT, range_m
