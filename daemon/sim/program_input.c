// Inputs are compared bit by bit: 0 and -0 are different inputs.
#include "sim/program_input.h"

#include <string.h>

double *pm_input_of(pm_program *program, pm_node x) {
    return x == PM_NO_NODE || !pm_program_depends(program, x) ? NULL : pm_program_value(program, x);
}

bool pm_renew(double *to, const double *from, int n) {
    const size_t size = (size_t)n * sizeof *to;
    if (to == NULL || from == NULL || memcmp(to, from, size) == 0) {
        return false;
    }
    memcpy(to, from, size);
    return true;
}
