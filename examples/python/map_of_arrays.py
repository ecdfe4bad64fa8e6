#!/usr/bin/env python3
"""A map of arrays, without a graph: a lidar is driven through the middle of a room of 6 m by 4 m, and the map shown."""

import matplotlib.pyplot as plt
import numpy as np

import echogrid

bearings = np.radians(np.arange(360) - 179.5)
robot = echogrid.Robot("disc", [echogrid.lidar(0, 0, 0, 360, bearings[0], bearings[1] - bearings[0])])
mapper = echogrid.GridMapper(robot, resolution_m=0.05)
for x in np.linspace(1, 5, 50):
    to_x = np.where(np.cos(bearings) > 0, 6 - x, -x) / np.cos(bearings)
    to_y = np.where(np.sin(bearings) > 0, 2, -2) / np.sin(bearings)
    mapper.scan((x, 2.0, 0.0), np.minimum(to_x, to_y))
grid = mapper.grid()
plt.imshow(grid.probability, origin="lower", extent=grid.extent, cmap="gray_r", vmin=0, vmax=1)
plt.gca().set_facecolor("0.7")  # unknown
plt.savefig("map_of_arrays.png")
