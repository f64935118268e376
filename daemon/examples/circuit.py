# SPDX-License-Identifier: MIT
"""Simulates a capacitor and a coil in series with resistors that warm, for the tutorial in trainer/CIRCUIT.md.

    python3 circuit.py RESISTORS TRAJECTORIES FILE
"""
import sys

import h5py
import numpy as np

n, ntrajectory, path = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
L, C, K3 = 0.01, 1e-4, 5e7      # H, F, V/C^3: the voltage of the capacitor is q/C + K3 q^3
R0, ALPHA = 1.0, 0.004          # ohm and 1/K: the resistance grows with the temperature
T0, CR, CH = 300.0, 0.1, 0.5    # K, J/K, J/K: heat capacities of a resistor and of its housing
G = 2.5                         # W/K: heat conduction from a resistor to its housing


def rate(z):
    q, phi, sr, sh = z[:, 0], z[:, 1], z[:, 2:2 + n], z[:, 2 + n:]
    i = phi / L
    Tr, Th = T0 * np.exp(sr / CR), T0 * np.exp(sh / CH)
    R, heat = R0 * (1 + ALPHA * (Tr - T0)), G * (Tr - Th)
    voltage = q / C + K3 * q**3 + i * R.sum(1)
    return np.hstack([i[:, None], -voltage[:, None], (R * i[:, None]**2 - heat) / Tr, heat / Th])


def rk4(z, h):
    a = rate(z)
    b = rate(z + h / 2 * a)
    c = rate(z + h / 2 * b)
    d = rate(z + h * c)
    return z + h / 6 * (a + 2 * b + 2 * c + d)


rng = np.random.default_rng(1)
ntime, dt, fine = 251, 2e-4, 20
z = np.zeros((ntrajectory, ntime, 2 + 2 * n))
z[:, 0, 0] = rng.uniform(-1e-2, 1e-2, ntrajectory)                                # C
z[:, 0, 1] = rng.uniform(-0.05, 0.05, ntrajectory)                                # Wb
z[:, 0, 2:2 + n] = CR * np.log(rng.uniform(290, 330, (ntrajectory, n)) / T0)      # J/K
z[:, 0, 2 + n:] = CH * np.log(rng.uniform(290, 310, (ntrajectory, n)) / T0)       # J/K
for j in range(1, ntime):
    z[:, j] = z[:, j - 1]
    for _ in range(fine):
        z[:, j] = rk4(z[:, j], dt / fine)

columns = ["q", "phi"] + [f"s_r{k}" for k in range(n)] + [f"s_h{k}" for k in range(n)]
with h5py.File(path, "w") as file:
    file["z"] = z                        # [trajectory][time][column]
    file["t"] = dt * np.arange(ntime)    # s
    file["dt"] = dt                      # s
    file.attrs["state_layout"] = " ".join(columns)
