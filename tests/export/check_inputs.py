"""check_inputs.py FOLDER: inputs of the unpacked FMU, whose models were trained with them, count for its output
outside_training_range: the distance of an input to the range that its description names, in widths, and its slope."""
import ctypes
import re
import sys

from couple_fmus import Fmu, Value

CLOSE = 1e-3  # descriptions have four digits


def main():
    fmu, seen = Fmu(sys.argv[1]), 0
    fmu.call("ExitInitializationMode")
    inputs = [name for name in fmu.variables if fmu.causality(name) == "input"]
    first = fmu.get(inputs)
    for name, v in fmu.variables.items():
        said = re.search(r"prescribes; from (\S+) to (\S+) in training", v.get("description") or "")
        if not said:
            continue
        low, high = (float(x) for x in said.groups())
        for value, distance in ((low, 0), (high, 0), (2 * low - high, 1), (2 * high - low, 1)):
            fmu.set(inputs, first)
            fmu.set([name], [value])
            found = fmu.get(["outside_training_range"])[0]
            assert abs(found - distance) <= CLOSE * (1 + abs(value) / (high - low)), (name, value, found, distance)
        slope, one = (Value * 1)(), ctypes.c_size_t(1)
        fmu.call("GetDirectionalDerivative", fmu.references(["outside_training_range"]), one, fmu.references([name]), one,
                 (Value * 1)(1.0), one, slope, one)
        assert abs(slope[0] * (high - low) - 1) <= CLOSE, (name, slope[0])
        seen += 1
    assert seen >= 5, "no range of an input"
    print(f"{seen} inputs have ranges")


main()
