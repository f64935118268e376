"""check_guard.py GUARDED PLAIN RANGE ENERGY SCALE: unpacked FMUs of a scene with the guards training_range RANGE and
energy_drift ENERGY (inf: none), and without guards. From the start times SCALE, the output guard_used is the part of
these guards that is used; the first step that would end beyond 1 fails, and leaves the FMU in the state before it."""
import ctypes
import sys

from couple_fmus import Fmu, Value

MOST, SHIFT, CLOSE = 200, 1e-7, 1e-3


def steps(fmu, time):
    flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
    return fmu.library.fmi3DoStep(fmu.instance, Value(time), Value(fmu.dt), True, *flags, ctypes.byref(Value())) == 0


def check_slope(fmu, states):
    """The derivative of guard_used along the states is its difference quotient, where it is smooth."""
    size, one, slope = ctypes.c_size_t(len(states)), ctypes.c_size_t(1), (Value * 1)()
    saved, z = ctypes.c_void_p(), fmu.get(states)
    fmu.call("GetDirectionalDerivative", fmu.references(["guard_used"]), one, fmu.references(states), size,
             (Value * len(z))(*z), size, slope, one)
    fmu.call("GetFMUState", ctypes.byref(saved))
    fmu.call("SetContinuousStates", (Value * len(z))(*[x * (1 + SHIFT) for x in z]), size)
    shifted = fmu.get(["guard_used"])[0]
    fmu.call("SetFMUState", saved)
    quotient = (shifted - fmu.get(["guard_used"])[0]) / SHIFT
    assert abs(quotient - slope[0]) <= CLOSE * abs(quotient), (quotient, slope[0])


def main():
    guarded, plain = (Fmu(folder) for folder in sys.argv[1:3])
    limit_range, limit_energy, scale = (float(x) for x in sys.argv[3:6])
    states = [name for name, v in guarded.variables.items() if v.get("initial") == "exact"]
    assert "guard_used" not in plain.variables
    for fmu in guarded, plain:
        fmu.set(states, [scale * x for x in fmu.get(states)])
        fmu.call("ExitInitializationMode")
    used = []
    for k in range(MOST):
        assert steps(plain, k * plain.dt)
        distance, change = plain.get(["outside_training_range", "energy_change"])
        used.append(max(distance / limit_range, abs(change) / limit_energy))
        before = guarded.get(states)
        if not steps(guarded, k * guarded.dt):
            break
        assert guarded.get(["guard_used"]) == used[-1:], (k, guarded.get(["guard_used"]), used[-1])
    assert len(used) > 3 and used[-1] > 1 >= max(used[:-1]) > 0.5, used
    assert guarded.get(states) == before and guarded.get(["guard_used"]) == used[-2:-1]
    check_slope(guarded, states)
    print(f"guard_used reached {used[-2]:.3g}, and step {len(used)} failed: {used[-1]:.3g}")


main()
