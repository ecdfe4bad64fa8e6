/* A listener in C: looks on while a graph maps, and tells how much of the map is known.
 *
 *     cc -O2 -Ic examples/c/watch_map.c -Ltarget/release -lechogrid_c -o watch_map
 */

#include <stdio.h>

#include "echogrid.h"

int main(int argc, char **argv)
{
    char error[256];
    struct echogrid_map *map = echogrid_map_open(argc > 1 ? argv[1] : NULL, error, sizeof error);
    int32_t changed;

    if (!map) {
        fprintf(stderr, "watch_map: %s\n", error);
        return 1;
    }
    while ((changed = echogrid_map_update(map)) >= 0) {
        struct echogrid_grid grid = echogrid_map_grid(map);
        uint64_t known = 0;
        if (!changed) continue;
        for (uint64_t at = 0; at < grid.rows * grid.columns; at++) known += grid.log_odds[at] == grid.log_odds[at];
        printf("%llu x %llu cells of %g m: %llu known\n", (unsigned long long)grid.columns, (unsigned long long)grid.rows,
               grid.resolution_m, (unsigned long long)known);
        fflush(stdout);
    }
    echogrid_map_close(map);
    return 0;
}
