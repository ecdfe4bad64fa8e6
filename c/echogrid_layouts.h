/* Layouts of all messages. Written by echogrid (`echogrid topic layout --lang c`); do not edit. */

#ifndef ECHOGRID_LAYOUTS_H
#define ECHOGRID_LAYOUTS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define ECHOGRID_ASSERT static_assert
#else
#define ECHOGRID_ASSERT _Static_assert
#endif

/* echogrid/Header/3 */
struct echogrid_header {
    uint64_t sequence;
    uint64_t epoch;
    uint64_t stamp_ns;
    uint16_t flags;
    uint16_t robot;
    uint32_t life;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_header) == 32, "echogrid/Header/3");
ECHOGRID_ASSERT(offsetof(struct echogrid_header, sequence) == 0, "echogrid/Header/3");
ECHOGRID_ASSERT(offsetof(struct echogrid_header, epoch) == 8, "echogrid/Header/3");
ECHOGRID_ASSERT(offsetof(struct echogrid_header, stamp_ns) == 16, "echogrid/Header/3");
ECHOGRID_ASSERT(offsetof(struct echogrid_header, flags) == 24, "echogrid/Header/3");
ECHOGRID_ASSERT(offsetof(struct echogrid_header, robot) == 26, "echogrid/Header/3");
ECHOGRID_ASSERT(offsetof(struct echogrid_header, life) == 28, "echogrid/Header/3");

/* echogrid/Sensor/1 */
struct echogrid_sensor {
    uint32_t kind;
    uint16_t first_transducer;
    uint16_t transducers;
    double x_m;
    double y_m;
    double theta_rad;
    double first_bearing_rad;
    double bearing_step_rad;
    double aperture_rad;
    double range_min_m;
    double range_max_m;
    double range_error_ratio;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_sensor) == 80, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, kind) == 0, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, first_transducer) == 4, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, transducers) == 6, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, x_m) == 8, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, y_m) == 16, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, theta_rad) == 24, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, first_bearing_rad) == 32, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, bearing_step_rad) == 40, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, aperture_rad) == 48, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, range_min_m) == 56, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, range_max_m) == 64, "echogrid/Sensor/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_sensor, range_error_ratio) == 72, "echogrid/Sensor/1");

/* echogrid/RobotDescription/2 */
struct echogrid_robot_description {
    uint8_t name[64];
    double footprint_length_m;
    double footprint_width_m;
    uint32_t sensor_count;
    uint32_t reserved;
    struct echogrid_sensor sensors[256];
};
ECHOGRID_ASSERT(sizeof(struct echogrid_robot_description) == 20568, "echogrid/RobotDescription/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_robot_description, name) == 0, "echogrid/RobotDescription/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_robot_description, footprint_length_m) == 64, "echogrid/RobotDescription/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_robot_description, footprint_width_m) == 72, "echogrid/RobotDescription/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_robot_description, sensor_count) == 80, "echogrid/RobotDescription/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_robot_description, reserved) == 84, "echogrid/RobotDescription/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_robot_description, sensors) == 88, "echogrid/RobotDescription/2");

/* echogrid/OdometryRaw/1 */
struct echogrid_odometry_raw {
    double x_m;
    double y_m;
    double theta_rad;
    double v_mps;
    double w_radps;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_odometry_raw) == 40, "echogrid/OdometryRaw/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_raw, x_m) == 0, "echogrid/OdometryRaw/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_raw, y_m) == 8, "echogrid/OdometryRaw/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_raw, theta_rad) == 16, "echogrid/OdometryRaw/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_raw, v_mps) == 24, "echogrid/OdometryRaw/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_raw, w_radps) == 32, "echogrid/OdometryRaw/1");

/* echogrid/RangeReading/1 */
struct echogrid_range_reading {
    double range_m;
    int32_t offset_ns;
    uint16_t transducer;
    uint8_t echo;
    uint8_t reserved;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_range_reading) == 16, "echogrid/RangeReading/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_reading, range_m) == 0, "echogrid/RangeReading/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_reading, offset_ns) == 8, "echogrid/RangeReading/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_reading, transducer) == 12, "echogrid/RangeReading/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_reading, echo) == 14, "echogrid/RangeReading/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_reading, reserved) == 15, "echogrid/RangeReading/1");

/* echogrid/Incidents/1 */
struct echogrid_incidents {
    uint64_t first_ns;
    double largest_m;
    double largest_rad;
    uint32_t count;
    uint32_t reserved;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_incidents) == 32, "echogrid/Incidents/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_incidents, first_ns) == 0, "echogrid/Incidents/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_incidents, largest_m) == 8, "echogrid/Incidents/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_incidents, largest_rad) == 16, "echogrid/Incidents/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_incidents, count) == 24, "echogrid/Incidents/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_incidents, reserved) == 28, "echogrid/Incidents/1");

/* echogrid/OdometryEstimate/4 */
struct echogrid_odometry_estimate {
    double x_m;
    double y_m;
    double theta_rad;
    double covariance[15];
    double lin_scale;
    double ang_scale;
    double travel_m;
    double turn_rad;
    double e_lin_m;
    double e_ang_rad;
    double eps_lin_m2;
    double eps_ang_rad2;
    double trust;
    double distance_m;
    uint32_t fixes;
    uint32_t flags;
    uint32_t fixes_refused;
    uint32_t reserved;
    struct echogrid_incidents leaps;
    struct echogrid_incidents contradictions;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_odometry_estimate) == 304, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, x_m) == 0, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, y_m) == 8, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, theta_rad) == 16, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, covariance) == 24, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, lin_scale) == 144, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, ang_scale) == 152, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, travel_m) == 160, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, turn_rad) == 168, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, e_lin_m) == 176, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, e_ang_rad) == 184, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, eps_lin_m2) == 192, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, eps_ang_rad2) == 200, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, trust) == 208, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, distance_m) == 216, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, fixes) == 224, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, flags) == 228, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, fixes_refused) == 232, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, reserved) == 236, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, leaps) == 240, "echogrid/OdometryEstimate/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_odometry_estimate, contradictions) == 272, "echogrid/OdometryEstimate/4");

/* echogrid/MapTile/2 */
struct echogrid_map_tile {
    int32_t tile_x;
    int32_t tile_y;
    uint64_t revision;
    double resolution_m;
    uint16_t layer;
    uint16_t sonar;
    uint32_t reserved;
    float log_odds[4096];
};
ECHOGRID_ASSERT(sizeof(struct echogrid_map_tile) == 16416, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, tile_x) == 0, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, tile_y) == 4, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, revision) == 8, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, resolution_m) == 16, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, layer) == 24, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, sonar) == 26, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, reserved) == 28, "echogrid/MapTile/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_tile, log_odds) == 32, "echogrid/MapTile/2");

/* echogrid/MapInfo/7 */
struct echogrid_map_info {
    uint64_t revision;
    uint64_t scans;
    uint64_t cells_known;
    uint64_t cells_occupied;
    uint64_t cells_free;
    double entropy_bits;
    double trust;
    double distance_m;
    int32_t bounds[4];
    uint64_t verdicts[16];
    uint64_t remapped;
    uint64_t remap_left;
    struct echogrid_incidents leaps;
    struct echogrid_incidents contradictions;
    uint32_t flags;
    uint32_t fixes;
    uint32_t fixes_refused;
    uint32_t sonar_count;
    uint32_t reserved;
    uint32_t sonar_verdicts[4096];
    uint32_t reserved_behind;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_map_info) == 16696, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, revision) == 0, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, scans) == 8, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, cells_known) == 16, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, cells_occupied) == 24, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, cells_free) == 32, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, entropy_bits) == 40, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, trust) == 48, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, distance_m) == 56, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, bounds) == 64, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, verdicts) == 80, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, remapped) == 208, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, remap_left) == 216, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, leaps) == 224, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, contradictions) == 256, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, flags) == 288, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, fixes) == 292, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, fixes_refused) == 296, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, sonar_count) == 300, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, reserved) == 304, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, sonar_verdicts) == 308, "echogrid/MapInfo/7");
ECHOGRID_ASSERT(offsetof(struct echogrid_map_info, reserved_behind) == 16692, "echogrid/MapInfo/7");

/* echogrid/RangeVerdict/1 */
struct echogrid_range_verdict {
    uint16_t transducer;
    uint8_t verdict;
    uint8_t reserved;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_range_verdict) == 4, "echogrid/RangeVerdict/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_verdict, transducer) == 0, "echogrid/RangeVerdict/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_verdict, verdict) == 2, "echogrid/RangeVerdict/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_range_verdict, reserved) == 3, "echogrid/RangeVerdict/1");

/* echogrid/Ack/2 */
struct echogrid_ack {
    uint32_t topic;
    uint32_t reserved;
    uint64_t epoch;
    uint64_t sequence;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_ack) == 24, "echogrid/Ack/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_ack, topic) == 0, "echogrid/Ack/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_ack, reserved) == 4, "echogrid/Ack/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_ack, epoch) == 8, "echogrid/Ack/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_ack, sequence) == 16, "echogrid/Ack/2");

/* echogrid/Health/4 */
struct echogrid_health {
    uint8_t service[32];
    uint32_t pid;
    uint32_t state;
    uint64_t progress;
    uint64_t total;
    uint64_t stamp_ns;
    uint64_t first_stamp_ns;
    uint64_t faults;
    uint64_t lost;
    uint32_t ack_count;
    uint32_t waits_for;
    struct echogrid_ack acks[8];
    uint8_t last_error[512];
    uint8_t note[256];
};
ECHOGRID_ASSERT(sizeof(struct echogrid_health) == 1056, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, service) == 0, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, pid) == 32, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, state) == 36, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, progress) == 40, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, total) == 48, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, stamp_ns) == 56, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, first_stamp_ns) == 64, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, faults) == 72, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, lost) == 80, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, ack_count) == 88, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, waits_for) == 92, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, acks) == 96, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, last_error) == 288, "echogrid/Health/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_health, note) == 800, "echogrid/Health/4");

/* echogrid/TruePose/1 */
struct echogrid_true_pose {
    double x_m;
    double y_m;
    double theta_rad;
    uint32_t known;
    uint32_t reserved;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_true_pose) == 32, "echogrid/TruePose/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_pose, x_m) == 0, "echogrid/TruePose/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_pose, y_m) == 8, "echogrid/TruePose/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_pose, theta_rad) == 16, "echogrid/TruePose/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_pose, known) == 24, "echogrid/TruePose/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_pose, reserved) == 28, "echogrid/TruePose/1");

/* echogrid/LocalizationRequest/4 */
struct echogrid_localization_request {
    uint64_t id;
    struct echogrid_odometry_estimate estimate;
    uint32_t reason;
    uint32_t reserved;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_localization_request) == 320, "echogrid/LocalizationRequest/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_request, id) == 0, "echogrid/LocalizationRequest/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_request, estimate) == 8, "echogrid/LocalizationRequest/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_request, reason) == 312, "echogrid/LocalizationRequest/4");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_request, reserved) == 316, "echogrid/LocalizationRequest/4");

/* echogrid/LocalizationFix/1 */
struct echogrid_localization_fix {
    uint64_t request;
    double x_m;
    double y_m;
    double theta_rad;
    double covariance[9];
    uint32_t known;
    uint32_t reserved;
};
ECHOGRID_ASSERT(sizeof(struct echogrid_localization_fix) == 112, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, request) == 0, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, x_m) == 8, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, y_m) == 16, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, theta_rad) == 24, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, covariance) == 32, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, known) == 104, "echogrid/LocalizationFix/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_localization_fix, reserved) == 108, "echogrid/LocalizationFix/1");

/* echogrid/TrueWorld/1 */
struct echogrid_true_world {
    uint8_t name[480];
    double bounds_m[4];
};
ECHOGRID_ASSERT(sizeof(struct echogrid_true_world) == 512, "echogrid/TrueWorld/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_world, name) == 0, "echogrid/TrueWorld/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_true_world, bounds_m) == 480, "echogrid/TrueWorld/1");

/* echogrid/ControlRequest/2 */
struct echogrid_control_request {
    uint64_t id;
    uint32_t command;
    uint32_t reserved;
    double arguments[5];
};
ECHOGRID_ASSERT(sizeof(struct echogrid_control_request) == 56, "echogrid/ControlRequest/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_request, id) == 0, "echogrid/ControlRequest/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_request, command) == 8, "echogrid/ControlRequest/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_request, reserved) == 12, "echogrid/ControlRequest/2");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_request, arguments) == 16, "echogrid/ControlRequest/2");

/* echogrid/ControlReply/1 */
struct echogrid_control_reply {
    uint64_t id;
    uint32_t done;
    uint32_t reserved;
    uint8_t text[480];
};
ECHOGRID_ASSERT(sizeof(struct echogrid_control_reply) == 496, "echogrid/ControlReply/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_reply, id) == 0, "echogrid/ControlReply/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_reply, done) == 8, "echogrid/ControlReply/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_reply, reserved) == 12, "echogrid/ControlReply/1");
ECHOGRID_ASSERT(offsetof(struct echogrid_control_reply, text) == 16, "echogrid/ControlReply/1");

#define ECHOGRID_TOPIC_ROBOT_DESCRIPTION 1
#define ECHOGRID_TOPIC_ODOMETRY_RAW 2
#define ECHOGRID_TOPIC_RANGE_SCAN 3
#define ECHOGRID_TOPIC_ODOMETRY_ESTIMATE 4
#define ECHOGRID_TOPIC_MAP_TILES 5
#define ECHOGRID_TOPIC_MAP_INFO 6
#define ECHOGRID_TOPIC_RANGE_VERDICT 7
#define ECHOGRID_TOPIC_HEALTH 8
#define ECHOGRID_TOPIC_TRUTH_POSE 9
#define ECHOGRID_TOPIC_LOCALIZATION_REQUEST 10
#define ECHOGRID_TOPIC_LOCALIZATION_FIX 11
#define ECHOGRID_TOPIC_TRUTH_WORLD 12

#endif
