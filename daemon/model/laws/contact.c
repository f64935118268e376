// The port law `contact`: the motion of a body (end a, which exposes its momenta) opens and closes
// gaps (end b), which store the energy of the contact. A wall and a prescribed force on a surface
// are coupled in the same way. The given matrix H [ny_b][ny_a], or the identity, is the rate at
// which each gap opens per unit of generalised velocity:
//     ydot_b += H e_a,    ydot_a -= H^T e_b
// The energy that leaves the body enters the gap, e_b . H e_a - e_a . H^T e_b = 0, and no entropy
// moves. With the penalty energy k/2 |min(g,0)|^2 of a gap, e_b is minus the force that pushes the
// bodies apart, and zero while the gap is open (Wriggers, Computational Contact Mechanics, 2006).
#include <math.h>

#include "model/operator.h"
#include "model/port.h"
#include "model/potential.h"

#define MOST_NUMBERS 10000000 // of a matrix: 80 MB

static pm_status check_matrix(const pm_port_model *port, int rows, int cols) {
    const pm_matrix_spec *matrix = &port->spec.matrix;
    if (matrix->identity && rows != cols) {
        return pm_fail(PM_ECONFIG,
                       "the identity joins %d numbers of the first end to %d of the second, "
                       "expected as many",
                       cols, rows);
    }
    if (rows > MOST_NUMBERS / cols) {
        return pm_fail(PM_ECONFIG, "a matrix of %d x %d, at most %d numbers are possible", rows,
                       cols, MOST_NUMBERS);
    }
    if (matrix->value != NULL && (matrix->rows != rows || matrix->cols != cols)) {
        return pm_fail(PM_ECONFIG,
                       "the matrix is %d x %d, expected %d x %d: a row for each number that the "
                       "second end exposes, a column for each of the first",
                       matrix->rows, matrix->cols, rows, cols);
    }
    return PM_OK;
}

static pm_status declare(pm_port_model *port) {
    const pm_matrix_spec *matrix = &port->spec.matrix;
    const int rows = port->layout[PM_END_B].nz, cols = port->layout[PM_END_A].nz;
    const pm_port_spec *spec = &port->spec;
    if (spec->form != PM_HARD || pm_potential_exists(&spec->energy) ||
        pm_potential_exists(&spec->entropy) || pm_operator_exists(&spec->reversible) ||
        pm_operator_exists(&spec->irreversible)) {
        return pm_spec_locate(
            spec->at,
            pm_fail(PM_ECONFIG, "law contact is hard, and has a matrix and nothing else"));
    }
    PM_TRY(pm_spec_locate(matrix->at, check_matrix(port, rows, cols)));
    if (matrix->identity) {
        return PM_OK;
    }
    PM_TRY(pm_params_add(&port->params, "matrix", rows, cols, false, 0, NAN));
    const pm_param_entry *H = pm_params_find(&port->params, "matrix");
    for (int i = 0; matrix->value != NULL && i < rows * cols; ++i) {
        H->value[i] = matrix->value[i];
    }
    return PM_OK;
}

static pm_node rate(pm_graph *g, const pm_port_model *port, pm_end own, const pm_port_nodes end[2],
                    pm_node *degeneracy) {
    (void)degeneracy;
    const pm_node e = end[own == PM_END_A ? PM_END_B : PM_END_A].e;
    if (port->spec.matrix.identity) {
        return pm_scale(g, e, own == PM_END_B ? 1 : -1);
    }
    const pm_param_entry *entry = pm_params_find(&port->params, "matrix");
    const pm_node H = pm_param(g, entry->value, entry->rows, entry->cols);
    return own == PM_END_B ? pm_matmul(g, e, false, H, true)
                           : pm_scale(g, pm_matmul(g, e, false, H, false), -1);
}

static pm_status visit(const pm_port_model *port, pm_graph *g, const pm_port_nodes end[2],
                       pm_normaliser_visit *visitor, void *context) {
    (void)port, (void)g, (void)end, (void)visitor, (void)context;
    return PM_OK;
}

const pm_port_law pm_law_contact = {
    .name = "contact",
    .conservative = true,
    .separate = true,
    .has_matrix = true,
    .has_no_operators = true,
    .joins_gaps = true,
    .declare = declare,
    .rate = rate,
    .visit = visit,
};
