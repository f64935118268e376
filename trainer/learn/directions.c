// The eigenvectors of the covariance of all weights, in the names of the scene.
#include "learn/directions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"

#define MOST_WEIGHTS 500 // beyond which eigenvectors take too long
#define MOST_PRINTED 6   // directions
#define UNFIXED 0.25     // standard deviation along a direction that the data do not fix
#define SINGLE 0.95      // part of the square of a direction that makes it one constant
#define NAMED 0.15       // of the largest change, at least, of the constants that are named

// A weight of the fit.
typedef struct weight {
    const char *component, *name; // name: NULL for a weight of a network
    bool logarithm;
    double unit; // its change that counts as 1 in a direction
} weight;

static const char *component_name(const pm_system *system, int i) {
    const pm_scene *scene = system->scene;
    return i < scene->nsubsystem ? scene->subsystem[i].name
                                 : scene->port[i - scene->nsubsystem].name;
}

static void list_weights(const pm_shooting *s, weight *list) {
    size_t at = 0;
    for (int i = 0; i < pm_system_components(s->how.system); ++i) {
        const pm_params *params = pm_system_params(s->how.system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const bool constant = strncmp(entry->name, "constant.", 9) == 0;
            for (int j = 0; entry->trained && j < entry->rows * entry->cols; ++j, ++at) {
                const bool logarithm = constant && s->reach[at] == PM_SHOOTING_REACH;
                const double size = fmax(fabs(entry->value[j]), fabs(s->first_weight[at]));
                list[at] = (weight){component_name(s->how.system, i),
                                    constant ? entry->name + 9 : NULL, logarithm,
                                    !constant   ? s->reach[at]
                                    : logarithm ? 1
                                    : size > 0  ? size
                                                : 1};
            }
        }
    }
}

// Whether a direction [n] consists of several constants.
static bool is_combination(int n, const weight *list, const double *direction) {
    double constants = 0, largest = 0;
    for (int k = 0; k < n; ++k) {
        const double square = direction[k] * direction[k];
        constants += list[k].name != NULL ? square : 0;
        largest = fmax(largest, square);
    }
    return constants > 0.5 && largest < SINGLE;
}

static void print_direction(int n, const weight *list, const double *direction, double deviation) {
    double largest = 0, sign = 1;
    for (int k = 0; k < n; ++k) {
        if (fabs(direction[k]) > largest) {
            largest = fabs(direction[k]);
            sign = direction[k] > 0 ? 1 : -1;
        }
    }
    const char *before = "  cannot be identified, as the data hardly change along";
    for (int k = 0; k < n; ++k) {
        const double change = sign * direction[k] * deviation;
        if (fabs(direction[k]) < NAMED * largest || list[k].name == NULL) {
            continue;
        }
        printf("%s %s.%s ", before, list[k].component, list[k].name);
        before = ",";
        if (list[k].logarithm) {
            printf("x %.2g", exp(change));
        } else {
            printf("%+.2g", change * list[k].unit);
        }
    }
    printf(" (one standard deviation): give one of them\n");
}

static pm_status print_all(const pm_uncertainty *u, const pm_shooting *s, weight *list,
                           double *matrix, double *vector) {
    const size_t n = (size_t)u->nweight;
    double *value = malloc(n * sizeof *value);
    if (value == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for directions of weights");
    }
    list_weights(s, list);
    for (size_t i = 0; i < n * n; ++i) {
        matrix[i] = u->covariance[i] / (list[i / n].unit * list[i % n].unit);
    }
    int printed = 0;
    if (pm_eigen_largest(u->nweight, matrix, u->nweight, value, vector)) {
        for (int k = 0; k < u->nweight && value[k] > UNFIXED * UNFIXED; ++k) {
            const double *direction = vector + (size_t)k * n;
            if (printed < MOST_PRINTED && is_combination(u->nweight, list, direction)) {
                print_direction(u->nweight, list, direction, sqrt(value[k]));
                ++printed;
            }
        }
    }
    free(value);
    return PM_OK;
}

pm_status pm_directions_print(const pm_uncertainty *u, const pm_shooting *s) {
    const size_t n = (size_t)u->nweight;
    if (n < 2 || n > MOST_WEIGHTS) {
        return PM_OK;
    }
    weight *list = malloc(n * sizeof *list);
    double *matrix = malloc(n * n * sizeof *matrix), *vector = malloc(n * n * sizeof *vector);
    const pm_status status = list == NULL || matrix == NULL || vector == NULL
                                 ? pm_fail(PM_ENOMEM, "out of memory for directions of weights")
                                 : print_all(u, s, list, matrix, vector);
    free(list);
    free(matrix);
    free(vector);
    fflush(stdout);
    return status;
}
