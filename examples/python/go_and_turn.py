#!/usr/bin/env python3
"""A planner in Python: the robot drives a metre ahead of where it began, and turns there for as long as the graph runs."""

from math import hypot

import echogrid

with echogrid.Planner() as planner:
    begin = None
    for place in planner:
        begin = begin or place
        is_there = hypot(place.x - begin.x, place.y - begin.y) >= 1.0
        planner.drive(v=0.0 if is_there else 0.3, w=0.4 if is_there else 0.0)
