"""Adds normal noise of a standard deviation (m) to the positions of a nodes.csv: add-noise.py NODES NOISE > MARKERS."""

import random
import sys

noise = random.Random(1)
with open(sys.argv[1]) as nodes:
    print(nodes.readline().strip())
    for line in nodes:
        time, *positions = line.split(",")
        print(time, *(f"{float(x) + noise.gauss(0.0, float(sys.argv[2])):.5f}" for x in positions), sep=",")
