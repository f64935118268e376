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
#define COLLINEAR 20     // collinearity index of constants that are hard to tell apart

// A weight of the fit.
typedef struct weight {
    const char *component, *name; // name: NULL for a weight of a network
    const char *at;               // place of its model in the training file
    bool logarithm;
    double unit; // its change that counts as 1 in a direction
} weight;

static const char *component_name(const pm_system *system, int i) {
    const pm_scene *scene = system->scene;
    return i < scene->nsubsystem ? scene->subsystem[i].name
                                 : scene->port[i - scene->nsubsystem].name;
}

static const char *component_place(const pm_system *system, int i) {
    const int nsubsystem = system->scene->nsubsystem;
    return i < nsubsystem ? system->part[i]->spec.at : system->port[i - nsubsystem]->spec.at;
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
                list[at] =
                    (weight){component_name(s->how.system, i), constant ? entry->name + 9 : NULL,
                             component_place(s->how.system, i), logarithm,
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

// --- before the fit ---

// Computes the normal matrix of the weights after elimination of all starts, as its Cholesky factor
// in s->reduced. Returns false if the equations are singular or there is no memory.
static bool factorise(pm_shooting *s, const double *noise, const double *gap) {
    const pm_shooting kept = *s;
    double *step = malloc(((size_t)s->nweight + (size_t)s->nwindow * (size_t)s->nz) * sizeof *step);
    double *own = malloc((size_t)(s->ny + s->nz) * sizeof *own);
    bool known = step != NULL && own != NULL;
    if (known) {
        memcpy(own, noise, (size_t)s->ny * sizeof *own);
        memcpy(own + s->ny, gap, (size_t)s->nz * sizeof *own);
        s->noise = own;
        s->gap = own + s->ny;
        s->huber = INFINITY; // the model is still wrong: all samples count
        s->hold = s->everywhere = s->early = false;
        pm_shooting_evaluate(s, s->z, true);
        known = s->failed == PM_OK && pm_shooting_solve(s, 0, step, step + s->nweight);
        s->noise = kept.noise;
        s->gap = kept.gap;
        s->huber = kept.huber;
        s->hold = kept.hold;
        s->everywhere = kept.everywhere;
        s->early = kept.early;
    }
    free(step);
    free(own);
    return known;
}

// Returns element i of the diagonal of u' u.
static double diagonal(size_t n, const double *u, size_t i) {
    double square = 0;
    for (size_t k = 0; k <= i; ++k) {
        square += u[k * n + i] * u[k * n + i];
    }
    return square;
}

// Writes the inverse [n][n] of the matrix u' u after scaling its diagonal to 1.
static void scaled_inverse(size_t n, const double *u, double *inverse) {
    memset(inverse, 0, n * n * sizeof *inverse);
    for (size_t i = 0; i < n; ++i) {
        inverse[i * (n + 1)] = sqrt(diagonal(n, u, i));
    }
    pm_cholesky_back((int)n, u, (int)n, inverse);
    for (size_t i = 0; i < n * n; ++i) {
        inverse[i] *= sqrt(diagonal(n, u, i / n));
    }
}

static void print_collinear(int n, const weight *list, const double *direction, double index) {
    int largest = 0;
    double constants = 0;
    for (int k = 0; k < n; ++k) {
        largest = fabs(direction[k]) > fabs(direction[largest]) ? k : largest;
        constants += list[k].name != NULL ? direction[k] * direction[k] : 0;
    }
    if (constants < 0.5 || list[largest].name == NULL) {
        return;
    }
    printf("%s: note:", list[largest].at);
    for (int k = 0, count = 0; k < n; ++k) {
        if (list[k].name != NULL && fabs(direction[k]) > NAMED * fabs(direction[largest])) {
            printf("%s %s.%s", count++ > 0 ? "," : "", list[k].component, list[k].name);
        }
    }
    printf(": the measurements hardly tell them apart from each other and from hidden starts "
           "(collinearity %.0f); the fit may miss them: give what is known\n",
           index);
}

pm_status pm_directions_foresee(pm_shooting *s, const double *noise, const double *gap) {
    const size_t n = (size_t)s->nweight;
    if (n < 2 || n > MOST_WEIGHTS) {
        return PM_OK;
    }
    weight *list = malloc(n * sizeof *list);
    double *matrix = malloc(n * n * sizeof *matrix), *vector = malloc(n * n * sizeof *vector);
    double *value = malloc(n * sizeof *value);
    const bool memory = list != NULL && matrix != NULL && vector != NULL && value != NULL;
    if (memory && factorise(s, noise, gap)) {
        list_weights(s, list);
        scaled_inverse(n, s->reduced, matrix);
        const bool found = pm_eigen_largest((int)n, matrix, (int)n, value, vector);
        for (size_t k = 0; found && k < n && k < MOST_PRINTED; ++k) {
            if (value[k] > COLLINEAR * COLLINEAR) {
                print_collinear((int)n, list, vector + k * n, sqrt(value[k]));
            }
        }
        fflush(stdout);
    }
    free(list);
    free(matrix);
    free(vector);
    free(value);
    return memory ? s->failed : pm_fail(PM_ENOMEM, "out of memory for directions of weights");
}
