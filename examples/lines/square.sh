#!/bin/sh
# A sensor that knows nothing of echogrid: a robot that drives around a square room of 6 m, with four sonars, as lines.
#
#     [services.sensor]
#     exec = "./square.sh"
#     speaks = "carmen"
#     replays = true        # it prints the same whenever it is started
exec awk 'BEGIN {
    pi = 3.14159265358979
    print "PARAM echogrid_sonar_max 5 sh 0"
    for (step = 0; step < 600; step++) {
        t = step / 10; a = t * 2 * pi / 60
        x = 3 + 1.5 * cos(a); y = 3 + 1.5 * sin(a); theta = a + pi / 2
        printf "ODOM %.4f %.4f %.4f %.4f %.4f 0 %.1f sh 0\n", x, y, theta, 1.5 * 2 * pi / 60, 2 * pi / 60, t
        ranges = mounts = ""
        for (k = 0; k < 4; k++) {
            bearing = theta + k * pi / 2; c = cos(bearing); s = sin(bearing); r = 99
            if (c > 1e-9 && (6 - x) / c < r) r = (6 - x) / c; if (c < -1e-9 && -x / c < r) r = -x / c
            if (s > 1e-9 && (6 - y) / s < r) r = (6 - y) / s; if (s < -1e-9 && -y / s < r) r = -y / s
            ranges = ranges sprintf("%.3f ", r); mounts = mounts sprintf("0 0 %.6f ", k * pi / 2)
        }
        # SONAR cone-in-radians number ranges mounts
        printf "SONAR 0.2618 4 %s%s%.1f sh 0\n", ranges, mounts, t
    }
}'
