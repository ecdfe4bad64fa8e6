"""Layouts of all messages. Written by echogrid (`echogrid topic layout --lang python`); do not edit."""

import ctypes
from typing import NamedTuple


class Header(ctypes.Structure):
    """echogrid/Header/3, 32 bytes."""

    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("epoch", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("flags", ctypes.c_uint16),
        ("robot", ctypes.c_uint16),
        ("life", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        return "echogrid/Header/3"


class Sensor(ctypes.Structure):
    """echogrid/Sensor/1, 80 bytes."""

    _fields_ = [
        ("kind", ctypes.c_uint32),
        ("first_transducer", ctypes.c_uint16),
        ("transducers", ctypes.c_uint16),
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("theta_rad", ctypes.c_double),
        ("first_bearing_rad", ctypes.c_double),
        ("bearing_step_rad", ctypes.c_double),
        ("aperture_rad", ctypes.c_double),
        ("range_min_m", ctypes.c_double),
        ("range_max_m", ctypes.c_double),
        ("range_error_ratio", ctypes.c_double),
    ]

    @staticmethod
    def type_name():
        return "echogrid/Sensor/1"


class RobotDescription(ctypes.Structure):
    """echogrid/RobotDescription/2, 20568 bytes."""

    _fields_ = [
        ("name", ctypes.c_uint8 * 64),
        ("footprint_length_m", ctypes.c_double),
        ("footprint_width_m", ctypes.c_double),
        ("sensor_count", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("sensors", Sensor * 256),
    ]

    @staticmethod
    def type_name():
        return "echogrid/RobotDescription/2"


class OdometryRaw(ctypes.Structure):
    """echogrid/OdometryRaw/1, 40 bytes."""

    _fields_ = [
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("theta_rad", ctypes.c_double),
        ("v_mps", ctypes.c_double),
        ("w_radps", ctypes.c_double),
    ]

    @staticmethod
    def type_name():
        return "echogrid/OdometryRaw/1"


class RangeReading(ctypes.Structure):
    """echogrid/RangeReading/1, 16 bytes."""

    _fields_ = [
        ("range_m", ctypes.c_double),
        ("offset_ns", ctypes.c_int32),
        ("transducer", ctypes.c_uint16),
        ("echo", ctypes.c_uint8),
        ("reserved", ctypes.c_uint8),
    ]

    @staticmethod
    def type_name():
        return "echogrid/RangeReading/1"


class Incidents(ctypes.Structure):
    """echogrid/Incidents/1, 32 bytes."""

    _fields_ = [
        ("first_ns", ctypes.c_uint64),
        ("largest_m", ctypes.c_double),
        ("largest_rad", ctypes.c_double),
        ("count", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        return "echogrid/Incidents/1"


class OdometryEstimate(ctypes.Structure):
    """echogrid/OdometryEstimate/4, 304 bytes."""

    _fields_ = [
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("theta_rad", ctypes.c_double),
        ("covariance", ctypes.c_double * 15),
        ("lin_scale", ctypes.c_double),
        ("ang_scale", ctypes.c_double),
        ("travel_m", ctypes.c_double),
        ("turn_rad", ctypes.c_double),
        ("e_lin_m", ctypes.c_double),
        ("e_ang_rad", ctypes.c_double),
        ("eps_lin_m2", ctypes.c_double),
        ("eps_ang_rad2", ctypes.c_double),
        ("trust", ctypes.c_double),
        ("distance_m", ctypes.c_double),
        ("fixes", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("fixes_refused", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("leaps", Incidents),
        ("contradictions", Incidents),
    ]

    @staticmethod
    def type_name():
        return "echogrid/OdometryEstimate/4"


class MapTile(ctypes.Structure):
    """echogrid/MapTile/2, 16416 bytes."""

    _fields_ = [
        ("tile_x", ctypes.c_int32),
        ("tile_y", ctypes.c_int32),
        ("revision", ctypes.c_uint64),
        ("resolution_m", ctypes.c_double),
        ("layer", ctypes.c_uint16),
        ("sonar", ctypes.c_uint16),
        ("reserved", ctypes.c_uint32),
        ("log_odds", ctypes.c_float * 4096),
    ]

    @staticmethod
    def type_name():
        return "echogrid/MapTile/2"


class MapInfo(ctypes.Structure):
    """echogrid/MapInfo/7, 16696 bytes."""

    _fields_ = [
        ("revision", ctypes.c_uint64),
        ("scans", ctypes.c_uint64),
        ("cells_known", ctypes.c_uint64),
        ("cells_occupied", ctypes.c_uint64),
        ("cells_free", ctypes.c_uint64),
        ("entropy_bits", ctypes.c_double),
        ("trust", ctypes.c_double),
        ("distance_m", ctypes.c_double),
        ("bounds", ctypes.c_int32 * 4),
        ("verdicts", ctypes.c_uint64 * 16),
        ("remapped", ctypes.c_uint64),
        ("remap_left", ctypes.c_uint64),
        ("leaps", Incidents),
        ("contradictions", Incidents),
        ("flags", ctypes.c_uint32),
        ("fixes", ctypes.c_uint32),
        ("fixes_refused", ctypes.c_uint32),
        ("sonar_count", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("sonar_verdicts", ctypes.c_uint32 * 4096),
        ("reserved_behind", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        return "echogrid/MapInfo/7"


class RangeVerdict(ctypes.Structure):
    """echogrid/RangeVerdict/1, 4 bytes."""

    _fields_ = [
        ("transducer", ctypes.c_uint16),
        ("verdict", ctypes.c_uint8),
        ("reserved", ctypes.c_uint8),
    ]

    @staticmethod
    def type_name():
        return "echogrid/RangeVerdict/1"


class Ack(ctypes.Structure):
    """echogrid/Ack/2, 24 bytes."""

    _fields_ = [
        ("topic", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("epoch", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
    ]

    @staticmethod
    def type_name():
        return "echogrid/Ack/2"


class Health(ctypes.Structure):
    """echogrid/Health/4, 1056 bytes."""

    _fields_ = [
        ("service", ctypes.c_uint8 * 32),
        ("pid", ctypes.c_uint32),
        ("state", ctypes.c_uint32),
        ("progress", ctypes.c_uint64),
        ("total", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("first_stamp_ns", ctypes.c_uint64),
        ("faults", ctypes.c_uint64),
        ("lost", ctypes.c_uint64),
        ("ack_count", ctypes.c_uint32),
        ("waits_for", ctypes.c_uint32),
        ("acks", Ack * 8),
        ("last_error", ctypes.c_uint8 * 512),
        ("note", ctypes.c_uint8 * 256),
    ]

    @staticmethod
    def type_name():
        return "echogrid/Health/4"


class TruePose(ctypes.Structure):
    """echogrid/TruePose/1, 32 bytes."""

    _fields_ = [
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("theta_rad", ctypes.c_double),
        ("known", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        return "echogrid/TruePose/1"


class LocalizationRequest(ctypes.Structure):
    """echogrid/LocalizationRequest/4, 320 bytes."""

    _fields_ = [
        ("id", ctypes.c_uint64),
        ("estimate", OdometryEstimate),
        ("reason", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        return "echogrid/LocalizationRequest/4"


class LocalizationFix(ctypes.Structure):
    """echogrid/LocalizationFix/1, 112 bytes."""

    _fields_ = [
        ("request", ctypes.c_uint64),
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("theta_rad", ctypes.c_double),
        ("covariance", ctypes.c_double * 9),
        ("known", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]

    @staticmethod
    def type_name():
        return "echogrid/LocalizationFix/1"


class TrueWorld(ctypes.Structure):
    """echogrid/TrueWorld/1, 512 bytes."""

    _fields_ = [
        ("name", ctypes.c_uint8 * 480),
        ("bounds_m", ctypes.c_double * 4),
    ]

    @staticmethod
    def type_name():
        return "echogrid/TrueWorld/1"


class ControlRequest(ctypes.Structure):
    """echogrid/ControlRequest/2, 56 bytes."""

    _fields_ = [
        ("id", ctypes.c_uint64),
        ("command", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("arguments", ctypes.c_double * 5),
    ]

    @staticmethod
    def type_name():
        return "echogrid/ControlRequest/2"


class ControlReply(ctypes.Structure):
    """echogrid/ControlReply/1, 496 bytes."""

    _fields_ = [
        ("id", ctypes.c_uint64),
        ("done", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("text", ctypes.c_uint8 * 480),
    ]

    @staticmethod
    def type_name():
        return "echogrid/ControlReply/1"


class Topic(NamedTuple):
    """A topic: its number on the wire, what its messages are, and what it promises."""

    code: int
    payload: type
    is_slice: bool
    delivery: str


TOPICS = {
    "robot/description": Topic(1, RobotDescription, False, "latest"),
    "odometry/raw": Topic(2, OdometryRaw, False, "lossless"),
    "range/scan": Topic(3, RangeReading, True, "lossless"),
    "odometry/estimate": Topic(4, OdometryEstimate, False, "lossless"),
    "map/tiles": Topic(5, MapTile, False, "relayed"),
    "map/info": Topic(6, MapInfo, False, "latest"),
    "range/verdict": Topic(7, RangeVerdict, True, "droppable"),
    "health": Topic(8, Health, False, "latest"),
    "truth/pose": Topic(9, TruePose, False, "lossless"),
    "localization/request": Topic(10, LocalizationRequest, False, "relayed"),
    "localization/fix": Topic(11, LocalizationFix, False, "latest"),
    "truth/world": Topic(12, TrueWorld, False, "latest"),
}

# Where every field must lie, in bytes.
_OFFSETS = {
    Header: (32, [0, 8, 16, 24, 26, 28]),
    Sensor: (80, [0, 4, 6, 8, 16, 24, 32, 40, 48, 56, 64, 72]),
    RobotDescription: (20568, [0, 64, 72, 80, 84, 88]),
    OdometryRaw: (40, [0, 8, 16, 24, 32]),
    RangeReading: (16, [0, 8, 12, 14, 15]),
    Incidents: (32, [0, 8, 16, 24, 28]),
    OdometryEstimate: (304, [0, 8, 16, 24, 144, 152, 160, 168, 176, 184, 192, 200, 208, 216, 224, 228, 232, 236, 240, 272]),
    MapTile: (16416, [0, 4, 8, 16, 24, 26, 28, 32]),
    MapInfo: (16696, [0, 8, 16, 24, 32, 40, 48, 56, 64, 80, 208, 216, 224, 256, 288, 292, 296, 300, 304, 308, 16692]),
    RangeVerdict: (4, [0, 2, 3]),
    Ack: (24, [0, 4, 8, 16]),
    Health: (1056, [0, 32, 36, 40, 48, 56, 64, 72, 80, 88, 92, 96, 288, 800]),
    TruePose: (32, [0, 8, 16, 24, 28]),
    LocalizationRequest: (320, [0, 8, 312, 316]),
    LocalizationFix: (112, [0, 8, 16, 24, 32, 104, 108]),
    TrueWorld: (512, [0, 480]),
    ControlRequest: (56, [0, 8, 12, 16]),
    ControlReply: (496, [0, 8, 12, 16]),
}

for _type, (_size, _offsets) in _OFFSETS.items():
    _here = [getattr(_type, field[0]).offset for field in _type._fields_]
    if (ctypes.sizeof(_type), _here) != (_size, _offsets):
        raise ImportError(f"{_type.type_name()}: this machine lays it out otherwise: {_here}")
