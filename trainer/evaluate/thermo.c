// Computes entropy production and powers from the energies and entropies of the subsystems over
// time.
#include "evaluate/thermo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// A quantity that changes by less than this fraction of the largest change of any subsystem counts
// as constant and gets no row.
#define NOTHING 1e-9

typedef struct series {
    const pm_evaluation *e;
    double *predicted, *truth;   // [ntime] of the present quantity and rollout
    double *error, *sign, *size; // [count] of the present quantity
} series;

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for energies and entropies");
}

static double part_value(const pm_evaluation *e, const double *values, int which, int j, int part) {
    const int n = e->system->scene->nsubsystem;
    return values[((ptrdiff_t)which * e->truth->ntime + j) * n + part];
}

// --- the quantities over time ---

// Computes the change of a subsystem since the beginning.
static void gain(const series *s, const double *values, int part) {
    for (int j = 0; j < s->e->truth->ntime; ++j) {
        s->predicted[j] =
            part_value(s->e, values, 0, j, part) - part_value(s->e, values, 0, 0, part);
        s->truth[j] = part_value(s->e, values, 1, j, part) - part_value(s->e, values, 1, 0, part);
    }
}

// Marks the subsystems that stay connected with end a when the port is removed. Returns false if
// end b or a boundary input is among them; energies of subsystems then do not determine the power.
static bool find_side(const pm_scene *scene, int port, bool *side) {
    memset(side, 0, (size_t)scene->nsubsystem * sizeof *side);
    if (scene->port[port].subsystem[0] < 0 || scene->port[port].subsystem[1] < 0) {
        return false;
    }
    side[scene->port[port].subsystem[0]] = true;
    for (bool grown = true; grown;) {
        grown = false;
        for (int i = 0; i < scene->nport; ++i) {
            const int *end = scene->port[i].subsystem;
            const bool first = end[0] >= 0 && side[end[0]], second = end[1] >= 0 && side[end[1]];
            if (i == port || (!first && !second)) {
                continue;
            }
            if (end[0] < 0 || end[1] < 0) {
                return false;
            }
            grown = grown || first != second;
            side[end[0]] = side[end[1]] = true;
        }
    }
    return !side[scene->port[port].subsystem[1]];
}

// Computes the mean power into the marked subsystems over each step.
static void power(const series *s, const double *energy, const bool *side) {
    const pm_evaluation *e = s->e;
    for (int j = 0; j < e->truth->ntime; ++j) {
        s->predicted[j] = s->truth[j] = 0;
        for (int i = 0; i < e->system->scene->nsubsystem && j > 0; ++i) {
            if (side[i]) {
                s->predicted[j] +=
                    (part_value(e, energy, 0, j, i) - part_value(e, energy, 0, j - 1, i)) /
                    e->truth->dt;
                s->truth[j] +=
                    (part_value(e, energy, 1, j, i) - part_value(e, energy, 1, j - 1, i)) /
                    e->truth->dt;
            }
        }
    }
}

// --- scores ---

// Computes the relative L2 error over time of the present quantity in one rollout.
static void score_series(const series *s, int rollout) {
    double error = 0, norm = 0;
    const int ntime = s->e->truth->ntime;
    for (int j = 0; j < ntime; ++j) {
        const double difference = s->predicted[j] - s->truth[j];
        error += difference * difference;
        norm += s->truth[j] * s->truth[j];
    }
    const bool whole = s->e->rollout[rollout].reached == ntime;
    s->error[rollout] = whole ? sqrt(error / (norm > 0 ? norm : 1)) : INFINITY;
    s->sign[rollout] = 0;
    s->size[rollout] = sqrt(norm / ntime);
}

static void score_production(const series *s, int rollout) {
    const pm_rollout *r = &s->e->rollout[rollout];
    double predicted = 0, truth = 0;
    const int last = s->e->truth->ntime - 1;
    for (int i = 0; i < s->e->system->scene->nsubsystem; ++i) {
        gain(s, r->part_entropy, i);
        predicted += s->predicted[last];
        truth += s->truth[last];
    }
    const double relative = (predicted - truth) / (truth != 0 ? fabs(truth) : 1);
    s->sign[rollout] = r->reached > last ? relative : INFINITY;
    s->error[rollout] = fabs(s->sign[rollout]);
    s->size[rollout] = fabs(truth);
}

static void add_row(pm_thermo *t, const series *s, const char *kind, const char *name) {
    const int count = s->e->count;
    const pm_box sign = pm_box_of(count, s->sign), size = pm_box_of(count, s->size);
    double largest = 0;
    for (int i = 0; i < count; ++i) {
        largest = fmax(largest, s->error[i]);
    }
    const pm_box error = pm_box_of(count, s->error);
    if (size.median > 0) {
        t->row[t->count++] = (pm_thermo_row){.kind = kind,
                                             .name = name,
                                             .median = error.median,
                                             .mean = error.mean,
                                             .largest = largest,
                                             .bias = sign.median,
                                             .typical = size.median};
    }
}

// Adds the row of the energy or the entropy of a subsystem, unless it is constant.
static void add_part(pm_thermo *t, const series *s, bool entropy, int part) {
    double largest = 0;
    for (int i = 0; i < s->e->count; ++i) {
        const pm_rollout *r = &s->e->rollout[i];
        const double *values = entropy ? r->part_entropy : r->part_energy;
        for (int other = 0; other < s->e->system->scene->nsubsystem; ++other) {
            gain(s, values, other);
            for (int j = 0; j < s->e->truth->ntime; ++j) {
                largest = fmax(largest, fabs(s->truth[j]));
            }
        }
        gain(s, values, part);
        score_series(s, i);
    }
    double own = 0;
    for (int i = 0; i < s->e->count; ++i) {
        own = fmax(own, s->size[i]);
    }
    if (own > NOTHING * largest) {
        add_row(t, s, entropy ? "entropy" : "energy", s->e->system->scene->subsystem[part].name);
    }
}

static void add_port(pm_thermo *t, const series *s, int port, bool *side) {
    if (!find_side(s->e->system->scene, port, side)) {
        return;
    }
    for (int i = 0; i < s->e->count; ++i) {
        power(s, s->e->rollout[i].part_energy, side);
        score_series(s, i);
    }
    add_row(t, s, "power", s->e->system->scene->port[port].name);
}

static bool has_entropy(const pm_system *system) {
    bool has = false;
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        has = has || pm_part_has_entropy(system->part[i]);
    }
    return has;
}

static void add_all(pm_thermo *t, const series *s, bool *side) {
    const pm_scene *scene = s->e->system->scene;
    const bool entropy = has_entropy(s->e->system);
    for (int i = 0; i < s->e->count && entropy; ++i) {
        score_production(s, i);
    }
    if (entropy) {
        add_row(t, s, "production", "");
    }
    for (int i = 0; i < scene->nport; ++i) {
        add_port(t, s, i, side);
    }
    for (int i = 0; i < scene->nsubsystem; ++i) {
        add_part(t, s, false, i);
    }
    for (int i = 0; i < scene->nsubsystem && entropy; ++i) {
        add_part(t, s, true, i);
    }
}

static void find_temperatures(pm_thermo *t, const pm_evaluation *e) {
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        t->coldest = i == 0 ? r->coldest : fmin(t->coldest, r->coldest);
        t->warmest = i == 0 ? r->warmest : fmax(t->warmest, r->warmest);
    }
    t->given = true;
    for (int i = 0; i < e->system->scene->nsubsystem; ++i) {
        t->given = t->given && e->system->part[i]->spec.entropy.nterm == 0;
    }
}

pm_status pm_thermo_make(pm_thermo *thermo, const pm_evaluation *e) {
    const pm_scene *scene = e->system->scene;
    const size_t ntime = (size_t)e->truth->ntime, count = (size_t)e->count;
    const size_t rows = 1 + (size_t)scene->nport + 2 * (size_t)scene->nsubsystem;
    *thermo = (pm_thermo){.count = 0};
    if (pm_system_without_energy(e->system) >= 0) {
        return PM_OK;
    }
    pm_arena *arena = &thermo->arena;
    const series s = {.e = e,
                      .predicted = pm_arena_array(arena, ntime, sizeof(double)),
                      .truth = pm_arena_array(arena, ntime, sizeof(double)),
                      .error = pm_arena_array(arena, count, sizeof(double)),
                      .sign = pm_arena_array(arena, count, sizeof(double)),
                      .size = pm_arena_array(arena, count, sizeof(double))};
    bool *side = pm_arena_array(arena, (size_t)scene->nsubsystem, sizeof *side);
    thermo->row = pm_arena_array(arena, rows, sizeof *thermo->row);
    if (s.predicted == NULL || s.truth == NULL || s.error == NULL || s.sign == NULL ||
        s.size == NULL || side == NULL || thermo->row == NULL) {
        pm_thermo_free(thermo);
        return no_memory();
    }
    add_all(thermo, &s, side);
    find_temperatures(thermo, e);
    return PM_OK;
}

void pm_thermo_free(pm_thermo *thermo) {
    pm_arena_free(&thermo->arena);
}

pm_status pm_thermo_summarise(const pm_thermo_row *row, int count, pm_thermo_row *sum,
                              pm_thermo_row *worst) {
    double *median = malloc(2 * (size_t)count * sizeof *median);
    if (median == NULL) {
        return no_memory();
    }
    double *typical = median + count;
    *worst = row[0];
    *sum = (pm_thermo_row){.kind = row[0].kind, .name = ""};
    for (int i = 0; i < count; ++i) {
        median[i] = row[i].median;
        typical[i] = row[i].typical;
        sum->mean += row[i].mean / count;
        sum->largest = fmax(sum->largest, row[i].largest);
        *worst = row[i].median > worst->median ? row[i] : *worst;
    }
    sum->median = pm_box_of(count, median).median;
    sum->typical = pm_box_of(count, typical).median;
    free(median);
    return PM_OK;
}
