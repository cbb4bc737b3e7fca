"""What a call from Python costs beyond the stepper's own work: `python bindings/python/benches/calls.py`.

The same twenty internal steps in twenty calls and in one, in turns: the difference is what nineteen calls cost.
"""

import time

import numpy as np

import caudal

tail = caudal.Stepper("models/baseline-smooth.toml")  # N = 9
start, h, count = tail.save(), 5e-3, 20
many = one = get = float("inf")
clock = time.perf_counter_ns
for _ in range(1000):
    tail.restore(start)
    begin = clock()
    for _ in range(count):
        tail.do_step(h)
    many = min(many, clock() - begin)
    end = tail.get("x_m")
    tail.restore(start)
    begin = clock()
    tail.do_step(count * h)
    one = min(one, clock() - begin)
    assert np.array_equal(tail.get("x_m"), end)
    begin = clock()
    for _ in range(count):
        tail.get("tip_y_m")
    get = min(get, clock() - begin)
overhead = (many - one) / (count - 1)
print(f"{one / count:.0f} ns per step inside, {overhead:.0f} ns a call beyond it, {get / count:.0f} ns a get")
