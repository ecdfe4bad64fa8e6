"""Qualities of service of the stand-in."""

from types import SimpleNamespace

qos_profile_sensor_data = None
DurabilityPolicy = SimpleNamespace(TRANSIENT_LOCAL=1)


def QoSProfile(**settings):
    return settings
