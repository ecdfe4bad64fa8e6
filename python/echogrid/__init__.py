"""Sensors and listeners for echogrid graphs, maps of arrays, and map files, in Python.

    import echogrid

    with echogrid.Sensor(echogrid.Robot("mine", [echogrid.sonar(0.2, 0.0, 0.0)])) as sensor:
        sensor.odometry(0.0, x=0.0, y=0.0, theta=0.0)
        sensor.scan(0.0, {0: 1.5})
        sensor.odometry(0.1, x=0.02, y=0.0, theta=0.0)

What talks to a graph (`Sensor`, `MapListener`, `Planner`) needs the package `iceoryx2`, 0.10.0; what computes (`GridMapper`, `Odometry`, `read_map`,
`score`) needs the wheel, which carries the core. Stamps are seconds, lengths metres, angles radians, counter-clockwise; x is forward, y is
left. docs/python.md tells more.
"""

from importlib import import_module

_PLACES = {
    "robot": ["INVALID", "Robot", "Transducers", "lidar", "sonar"],
    "grid": ["Grid"],
    "sensor": ["Sensor"],
    "maps": ["MapListener"],
    "planner": ["Place", "Planner"],
    "graph": ["GraphError", "Orphaned"],
    "core": ["Estimate", "GridMapper", "Odometry", "PathPoint", "SavedMap", "read_map", "score"],
}
_MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name):
    """Each part is imported when it is asked for: not everybody has what the others need."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)


def __dir__():
    return __all__
