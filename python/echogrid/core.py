"""Maps without a graph: the mathematics of echogrid, on arrays."""

import json
from typing import List, NamedTuple, Optional

from .grid import Grid
from .robot import Robot, readings

try:
    from . import _core
except ImportError as error:
    raise ImportError("this echogrid has no core: install the wheel (docs/python.md)") from error


def _grid(dense):
    import numpy

    if dense is None:
        return None
    raw, rows, columns, x, y, resolution = dense
    return Grid(numpy.frombuffer(raw, numpy.float32).reshape(rows, columns), (x, y), resolution)


class Estimate:
    """Where the robot is in the map frame, and how far that can be trusted: `covariance` is the 3 × 3 matrix of x, y and theta, or `None` of
    a pose that is exact."""

    def __init__(self, x, y, theta, covariance=None):
        rows = None if covariance is None else [float(number) for row in covariance for number in row]
        if rows is not None and len(rows) != 9:
            raise ValueError(f"a covariance of {len(rows)} numbers; expected 3 x 3")
        self._of = _core.Estimate(x, y, theta, rows)

    @classmethod
    def _wrap(cls, of):
        estimate = cls.__new__(cls)
        estimate._of = of
        return estimate

    @property
    def pose(self):
        """x, y and theta."""
        return self._of.pose

    @property
    def covariance(self):
        """3 × 3, of x, y and theta."""
        import numpy

        return numpy.array(self._of.covariance_rows).reshape(3, 3)


class Odometry:
    """Dead reckoning with the errors of the paper. `settings` are keys of `[odometry]`: `k_ll=0.001`, …"""

    def __init__(self, **settings):
        self._of = _core.Odometry(json.dumps(settings))

    def step(self, x, y, theta) -> Estimate:
        """The next pose as the wheels have it."""
        return Estimate._wrap(self._of.step(x, y, theta))


class GridMapper:
    """Makes a grid of scans. `settings` are keys of `[mapper]`: `resolution_m=0.1`, `fusion="paper"`, …"""

    def __init__(self, robot: Robot, **settings):
        sensors = [
            (of.kind, of.x, of.y, of.theta, of.count, of.first_bearing, of.bearing_step, of.aperture, of.range_min, of.range_max, of.error_ratio)
            for of in robot.sensors
        ]
        self._of = _core.Mapper(json.dumps(settings), robot.name, robot.length, robot.width, sensors)

    def scan(self, where, ranges, stamp=0.0) -> List[str]:
        """Fuses a scan that was taken at `where`: an `Estimate`, or x, y and theta of a pose that is exact.

        `ranges` by transducer, or of all of them in their order; `None` or infinity is no echo, NaN says nothing. What became of each reading,
        in words: "accepted", or why not.
        """
        estimate = where if isinstance(where, Estimate) else Estimate(*where)
        return self._of.scan(round(stamp * 1e9), estimate._of, list(readings(ranges)))

    def grid(self) -> Optional[Grid]:
        """The map as it is now; none before anything was fused."""
        return _grid(self._of.dense())

    def save(self, path):
        """Saves the map as `map.echogrid`, for `echogrid score`, `convert` and `read_map`."""
        self._of.save(path)


class PathPoint(NamedTuple):
    """Where the robot was: stamp in seconds, pose, and how far that could be trusted, 0 to 1."""

    stamp: float
    x: float
    y: float
    theta: float
    trust: float


class SavedMap(NamedTuple):
    """A map file: the map, the path of the robot, and the settings that it was made with, as TOML."""

    grid: Optional[Grid]
    path: List[PathPoint]
    settings: str


def read_map(path) -> SavedMap:
    """Reads a `map.echogrid`."""
    dense, points, settings = _core.read_map(path)
    return SavedMap(_grid(dense), [PathPoint(stamp_ns * 1e-9, *rest) for stamp_ns, *rest in points], settings)


def score(path, world) -> dict:
    """How well a `map.echogrid` shows a known world (a name as `"office"`, or a file), as `echogrid score` tells it: `bits`, 0 to 1 or more,
    is the mean over walls and free space of how wrong the probabilities are. The map's own path is taken for true."""
    return json.loads(_core.score(path, world))
