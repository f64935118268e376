// Values of boundary inputs in examined states; orthonormal bases by the modified Gram-Schmidt
// method (Golub and Van Loan, Matrix Computations, 5.2.8).
#include "propose/input_basis.h"

#include <math.h>
#include <string.h>

#define INDEPENDENT 1e-6 // length of what is new in an input, relative to its size
#define KINDS 3          // values of each variable of a boundary input: state, dE and dS

pm_status pm_inputs_bind(pm_inputs *inputs, const pm_scene *scene, const pm_dataset *dataset,
                         int capacity, pm_arena *arena) {
    *inputs = (pm_inputs){.dataset = dataset, .trajectory = -1, .capacity = capacity};
    PM_TRY(pm_boundary_input_bind(&inputs->input, scene, dataset, 1, arena));
    const size_t size = (size_t)capacity * (size_t)scene->nprescribed;
    inputs->value = pm_arena_array(arena, size, sizeof *inputs->value);
    inputs->basis = pm_arena_array(arena, (size_t)scene->nsubsystem, sizeof *inputs->basis);
    return inputs->value != NULL && inputs->basis != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "out of memory for boundary inputs");
}

void pm_inputs_at(pm_inputs *inputs, int i, int j, double *value) {
    if (inputs->trajectory != i) {
        pm_boundary_input_follow(&inputs->input, inputs->dataset, i);
        inputs->trajectory = i;
    }
    pm_boundary_input_at(&inputs->input, j, 0, value);
}

void pm_inputs_add(pm_inputs *inputs, int i, int j) {
    if (inputs->input.n > 0 && inputs->count < inputs->capacity) {
        pm_inputs_at(inputs, i, j, inputs->value + (ptrdiff_t)inputs->count * inputs->input.n);
    }
    ++inputs->count;
}

// --- bases ---

static double product(int count, const double *a, const double *b) {
    double sum = 0;
    for (int k = 0; k < count; ++k) {
        sum += a[k] * b[k];
    }
    return sum;
}

// Adds the prescribed value number `id` to a basis of the values before it, unless it depends on
// them linearly. `to` [count of states] has room for it.
static void add_function(const pm_inputs *inputs, int id, pm_input_basis *basis, double *to) {
    const int count = inputs->count, n = inputs->input.n;
    double mean = 0, size = 0;
    for (int k = 0; k < count; ++k) {
        to[k] = inputs->value[(ptrdiff_t)k * n + id];
        mean += to[k] / count;
        size = fmax(size, fabs(to[k]));
    }
    for (int k = 0; k < count; ++k) {
        to[k] -= mean;
    }
    for (int b = 0; b < basis->count; ++b) {
        const double *other = basis->value + (ptrdiff_t)b * count;
        const double along = product(count, to, other);
        for (int k = 0; k < count; ++k) {
            to[k] -= along * other[k];
        }
    }
    const double length = sqrt(product(count, to, to));
    for (int k = 0; k < count; ++k) {
        to[k] /= length > 0 ? length : 1;
    }
    basis->count += length > INDEPENDENT * size * sqrt(count);
}

// Adds the values of a boundary input that a port shows to the subsystem at its other end.
static void add_port(const pm_inputs *inputs, const pm_scene_port *port, int end,
                     pm_input_basis *basis, double *work) {
    const pm_scene_boundary_input *owner =
        &inputs->input.scene->boundary_input[port->boundary_input[end]];
    for (int kind = 0; kind < KINDS; ++kind) {
        for (int c = 0; c < port->layout[end].nz && basis->count < PM_MAX_INPUT_BASIS; ++c) {
            add_function(inputs, owner->first + kind * owner->layout.nz + port->component[end][c],
                         basis, work + (ptrdiff_t)basis->count * inputs->count);
        }
    }
}

pm_status pm_inputs_find_bases(pm_inputs *inputs, pm_arena *arena) {
    const pm_scene *scene = inputs->input.scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        double *work = NULL;
        for (int e = scene->first_end[i]; e < scene->first_end[i + 1]; ++e) {
            const pm_scene_port *port = &scene->port[scene->end_at[e] / 2];
            const int other = 1 - scene->end_at[e] % 2;
            if (port->boundary_input[other] < 0) {
                continue;
            }
            if (work == NULL) {
                const size_t size = (size_t)PM_MAX_INPUT_BASIS * (size_t)inputs->count;
                work = pm_arena_array(arena, size, sizeof *work);
                inputs->basis[i] = (pm_input_basis){.stride = inputs->count, .value = work};
            }
            if (work == NULL) {
                return pm_fail(PM_ENOMEM, "out of memory for boundary inputs");
            }
            add_port(inputs, port, other, &inputs->basis[i], work);
        }
    }
    return PM_OK;
}

int pm_inputs_vectors(const pm_inputs *inputs, int subsystem, int size, int most,
                      int (*component)[3]) {
    const pm_scene *scene = inputs->input.scene;
    int count = 0;
    for (int e = scene->first_end[subsystem]; e < scene->first_end[subsystem + 1]; ++e) {
        const pm_scene_port *port = &scene->port[scene->end_at[e] / 2];
        const int other = 1 - scene->end_at[e] % 2, id = port->boundary_input[other];
        for (int g = 0; id >= 0 && g < port->layout[other].ngroup; ++g) {
            const pm_group *group = &port->layout[other].group[g];
            const pm_scene_boundary_input *owner = &scene->boundary_input[id];
            for (int c = 0; c < size && group->size == size && count < most; ++c) {
                component[count][c] =
                    owner->first + owner->layout.nz + port->component[other][group->first + c];
            }
            count += group->size == size && count < most;
        }
    }
    return count;
}

void pm_input_basis_project(const pm_input_basis *basis, int k, int n, const double *variable,
                            double *along) {
    for (int b = 0; b < basis->count; ++b) {
        const double u = basis->value[(ptrdiff_t)b * basis->stride + k];
        for (int a = 0; a < n; ++a) {
            along[b * n + a] += u * variable[a];
        }
    }
}

void pm_input_basis_remove(const pm_input_basis *basis, int k, int n, const double *along,
                           double *variable) {
    for (int b = 0; b < basis->count; ++b) {
        const double u = basis->value[(ptrdiff_t)b * basis->stride + k];
        for (int a = 0; a < n; ++a) {
            variable[a] -= u * along[b * n + a];
        }
    }
}
