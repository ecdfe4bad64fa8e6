#!/usr/bin/env python3
"""Looks on while a graph maps, and tells what of it is known: a listener to the map as numpy arrays."""

import numpy

import echogrid

with echogrid.MapListener() as maps:
    for grid in maps:
        p = grid.probability
        known = ~numpy.isnan(p)
        occupied = (p > 0.65).sum()
        print(f"{p.shape[1]} x {p.shape[0]} cells from {grid.origin}: {known.sum()} known, {occupied} occupied", flush=True)
