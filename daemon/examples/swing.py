# SPDX-License-Identifier: MIT
"""A controller in Python that swings the pivot of configs/live_double_pendulum.yaml to and fro.

    python3 swing.py [URL]

Every tick says how many steps the run has been granted; the controller answers with the values of the
step that comes next. swing.c does the same in C.
"""
import math
import sys

import portmet
from portmet.types import input_t

AMPLITUDE, FREQUENCY = 0.2, 2.0  # m, rad/s

url = sys.argv[1] if len(sys.argv) > 1 else "udpm://239.255.76.67:7667?ttl=0"
listener = portmet.Listener(url, channels="live_double_pendulum_TICK$")
for message in listener:
    tick = message.content
    time = tick.granted * tick.dt
    answer = input_t()
    answer.step = tick.granted
    answer.value = [AMPLITUDE * FREQUENCY * math.cos(FREQUENCY * time), 0.0]  # m/s
    answer.n = len(answer.value)
    listener.publish("PIVOT", answer)
