/* A sensor in C: a make-believe robot with four sonars that drives around a square room of 6 m; the same drive whenever it is started.
 *
 *     cc -O2 -Ic examples/c/square.c -Ltarget/release -lechogrid_c -lm -o square
 *     LD_LIBRARY_PATH=target/release echogrid up launch/graphs/map.toml --sensor ./square
 */

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "echogrid.h"

#define STEPS 600
#define SONARS 4
#define PI 3.14159265358979
#define ROOM 6.0

struct drive {
    int said; /* messages so far: odometry and scan in turn */
    struct echogrid_range_reading readings[SONARS];
};

static double to_the_wall(double x, double y, double bearing)
{
    double c = cos(bearing), s = sin(bearing), range = 99;
    if (c > 1e-9) range = fmin(range, (ROOM - x) / c);
    if (c < -1e-9) range = fmin(range, -x / c);
    if (s > 1e-9) range = fmin(range, (ROOM - y) / s);
    if (s < -1e-9) range = fmin(range, -y / s);
    return range;
}

static int32_t next(void *user, struct echogrid_said *said)
{
    struct drive *drive = user;
    int step = drive->said / 2, is_scan = drive->said % 2;
    double angle = step * 2 * PI / STEPS, theta = angle + PI / 2;
    double x = 3 + 1.5 * cos(angle), y = 3 + 1.5 * sin(angle);

    if (step == STEPS) return ECHOGRID_OVER;
    drive->said++;
    said->stamp_ns = (uint64_t)step * 100000000;
    if (!is_scan) {
        said->odometry.x_m = x;
        said->odometry.y_m = y;
        said->odometry.theta_rad = theta;
        said->odometry.v_mps = 0.157;
        said->odometry.w_radps = 0.105;
        return ECHOGRID_ODOMETRY;
    }
    for (int k = 0; k < SONARS; k++) {
        double range = to_the_wall(x, y, theta + k * PI / 2);
        struct echogrid_range_reading *reading = &drive->readings[k];
        memset(reading, 0, sizeof *reading);
        reading->transducer = (uint16_t)k;
        reading->echo = range < 5 ? 0 : 1; /* a hit, or no echo */
        reading->range_m = range;
    }
    said->readings = drive->readings;
    said->reading_count = SONARS;
    return ECHOGRID_SCAN;
}

int main(void)
{
    static struct echogrid_robot_description robot;
    static struct drive drive;
    struct echogrid_driver driver = { .name = "square", .robot = &robot, .user = &drive, .next = next };

    strcpy((char *)robot.name, "square");
    robot.footprint_length_m = robot.footprint_width_m = 0.4;
    robot.sensor_count = SONARS;
    for (int k = 0; k < SONARS; k++) {
        robot.sensors[k] = (struct echogrid_sensor){
            .kind = 1, .first_transducer = (uint16_t)k, .transducers = 1, .theta_rad = k * PI / 2,
            .aperture_rad = PI / 12, .range_min_m = 0.1, .range_max_m = 5, .range_error_ratio = 0.01,
        };
    }
    return echogrid_run_sensor(&driver);
}
