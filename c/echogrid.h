/* Sensors and listeners of echogrid graphs, in C: link libechogrid_c.so. docs/c.md tells how, docs/topics.md what is behind it.
 *
 * Lengths are metres, angles radians, counter-clockwise; x is forward, y is left. Stamps are nanoseconds of any clock that does not run
 * backwards; the odometry of a stamp goes before its scan.
 */

#ifndef ECHOGRID_H
#define ECHOGRID_H

#include "echogrid_layouts.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What a sensor says next. */
#define ECHOGRID_FAILED (-1)     /* why stands in `error`; the sensor is started again, unless the graph file says otherwise */
#define ECHOGRID_OVER 0          /* the drive is over: the map is saved */
#define ECHOGRID_ODOMETRY 1      /* `odometry` */
#define ECHOGRID_SCAN 2          /* `readings` and `reading_count` */
#define ECHOGRID_NOTHING_YET 3   /* waited for a little (a tenth of a second at most), and nothing came */

/* Filled in by `next`. What `readings` points to must stay until `next` is called again. */
struct echogrid_said {
    uint64_t stamp_ns;
    struct echogrid_odometry_raw odometry;
    const struct echogrid_range_reading *readings;
    size_t reading_count;
    char error[256];
};

struct echogrid_driver {
    const char *name;                                   /* of the program, for logs */
    const struct echogrid_robot_description *robot;     /* as it looks */
    void *user;                                         /* handed to the functions below */
    int32_t (*next)(void *user, struct echogrid_said *said);
    void (*close)(void *user);                          /* called once, at the end: lets motors and ports go; may be null */
    int32_t is_live;                                    /* 1: it measures what is now, and can't say the same again */
};

/* Plays the sensor in the graph that started this program, to its end. What it returns is the exit code of the program.
 * Call it before any thread is started, and from one thread only. */
int32_t echogrid_run_sensor(const struct echogrid_driver *driver);

/* The map of a running graph, looked at: nobody waits for who looks. */
struct echogrid_map;

/* A map as one array, row by row from the lowest y, each from the lowest x: log-odds, NaN where nothing is known. `origin` is the lower
 * left corner of the first cell. It stays until the next call with the same map. */
struct echogrid_grid {
    uint64_t rows;
    uint64_t columns;
    double origin_x_m;
    double origin_y_m;
    double resolution_m;
    const float *log_odds;
};

/* Of the graph in `domain`, or of the only one that runs if that is null. Null on failure; why stands in `error` then. */
struct echogrid_map *echogrid_map_open(const char *domain, char *error, size_t error_bytes);

/* Takes in what came, and waits a little (a tenth of a second) for it. 1: the map changed, 0: it did not, -1: the graph has ended. */
int32_t echogrid_map_update(struct echogrid_map *map);

/* The map as it is now; a grid of no rows before anything was mapped. */
struct echogrid_grid echogrid_map_grid(struct echogrid_map *map);

void echogrid_map_close(struct echogrid_map *map);

#ifdef __cplusplus
}
#endif

#endif
