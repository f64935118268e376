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

static double part_value(const pm_evaluation *e, const double *values, int which, int j, int part) {
    const int n = e->system->scene->physics.nsubsystem;
    return values[((ptrdiff_t)which * e->truth->ntime + j) * n + part];
}

// Returns the change of a subsystem's value over the step to state j.
static double step_of(const pm_evaluation *e, const double *values, int which, int j, int part) {
    return part_value(e, values, which, j, part) - part_value(e, values, which, j - 1, part);
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
    memset(side, 0, (size_t)scene->physics.nsubsystem * sizeof *side);
    if (scene->physics.port[port].subsystem[0] < 0 || scene->physics.port[port].subsystem[1] < 0) {
        return false;
    }
    side[scene->physics.port[port].subsystem[0]] = true;
    for (bool grown = true; grown;) {
        grown = false;
        for (int i = 0; i < scene->physics.nport; ++i) {
            const int *end = scene->physics.port[i].subsystem;
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
    return !side[scene->physics.port[port].subsystem[1]];
}

// --- scores ---

// Computes the relative L2 error over time of the present quantity in one rollout.
static void score_series(const series *s, int rollout) {
    double error = 0, norm = 0;
    const int ntime = s->e->rollout[rollout].length;
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

// Adds a row, unless the quantity vanishes.
static void add_row(pm_thermo *t, const series *s, const char *kind, const char *name) {
    const int count = s->e->count;
    const pm_box sign = pm_box_of(count, s->sign), size = pm_box_of(count, s->size);
    const pm_box error = pm_box_of(count, s->error);
    double largest = 0;
    for (int i = 0; i < count; ++i) {
        largest = fmax(largest, s->error[i]);
    }
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

// Adds the rows of the energies or the entropies of all subsystems that are not constant.
static void add_parts(pm_thermo *t, const series *s, bool entropy) {
    const pm_scene *scene = s->e->system->scene;
    for (int part = 0; part < scene->physics.nsubsystem; ++part) {
        double largest = 0, own = 0;
        for (int i = 0; i < s->e->count; ++i) {
            const pm_rollout *r = &s->e->rollout[i];
            const double *values = entropy ? r->part_entropy : r->part_energy;
            for (int other = 0; other < scene->physics.nsubsystem; ++other) {
                gain(s, values, other);
                for (int j = 0; j < r->length; ++j) {
                    largest = fmax(largest, fabs(s->truth[j]));
                }
            }
            gain(s, values, part);
            score_series(s, i);
            own = fmax(own, s->size[i]);
        }
        if (own > NOTHING * largest) {
            add_row(t, s, entropy ? "entropy" : "energy", scene->physics.subsystem[part].name);
        }
    }
}

pm_status pm_thermo_make(pm_thermo *thermo, const pm_evaluation *e) {
    const pm_scene *scene = e->system->scene;
    const int npart = scene->physics.nsubsystem;
    const size_t ntime = (size_t)e->truth->ntime, count = (size_t)e->count;
    const size_t rows = 1 + (size_t)scene->physics.nport + 2 * (size_t)npart;
    *thermo = (pm_thermo){.given = true, .warmer = NAN};
    if (pm_system_without_energy(e->system) >= 0) {
        thermo->given = false;
        return PM_OK;
    }
    pm_arena *arena = &thermo->arena;
    const series s = {.e = e,
                      .predicted = pm_arena_array(arena, ntime, sizeof(double)),
                      .truth = pm_arena_array(arena, ntime, sizeof(double)),
                      .error = pm_arena_array(arena, count, sizeof(double)),
                      .sign = pm_arena_array(arena, count, sizeof(double)),
                      .size = pm_arena_array(arena, count, sizeof(double))};
    bool *side = pm_arena_array(arena, (size_t)npart, sizeof *side), entropy = false;
    thermo->row = pm_arena_array(arena, rows, sizeof *thermo->row);
    const pm_status status = pm_arena_status(arena, "energies and entropies");
    if (status != PM_OK) {
        pm_thermo_free(thermo);
        return status;
    }
    for (int i = 0; i < npart; ++i) {
        entropy = entropy || pm_part_has_entropy(e->system->part[i]);
        thermo->given = thermo->given && e->system->part[i]->spec.entropy.nterm == 0 &&
                        !pm_part_has_coenergies(e->system->part[i]);
    }
    for (int k = 0; k < e->count && entropy; ++k) {
        const pm_rollout *r = &e->rollout[k];
        const int last = r->length - 1;
        double predicted = 0, truth = 0;
        for (int i = 0; i < npart; ++i) {
            gain(&s, r->part_entropy, i);
            predicted += s.predicted[last];
            truth += s.truth[last];
        }
        const double relative = (predicted - truth) / (truth != 0 ? fabs(truth) : 1);
        s.sign[k] = r->reached > last ? relative : INFINITY;
        s.error[k] = fabs(s.sign[k]);
        s.size[k] = fabs(truth);
    }
    if (entropy) {
        add_row(thermo, &s, "production", "");
    }
    for (int port = 0; port < scene->physics.nport; ++port) {
        if (find_side(scene, port, side)) {
            for (int i = 0; i < e->count; ++i) { // the mean power into the side over each step
                const double *energy = e->rollout[i].part_energy;
                for (int j = 0; j < e->rollout[i].length; ++j) {
                    s.predicted[j] = s.truth[j] = 0;
                    for (int k = 0; k < npart && j > 0; ++k) {
                        if (side[k]) {
                            s.predicted[j] += step_of(e, energy, 0, j, k) / e->truth->dt;
                            s.truth[j] += step_of(e, energy, 1, j, k) / e->truth->dt;
                        }
                    }
                }
                score_series(&s, i);
            }
            add_row(thermo, &s, "power", scene->physics.port[port].name);
        }
    }
    add_parts(thermo, &s, false);
    if (entropy) {
        add_parts(thermo, &s, true);
    }
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        thermo->coldest = i == 0 ? r->coldest : fmin(thermo->coldest, r->coldest);
        thermo->warmest = i == 0 ? r->warmest : fmax(thermo->warmest, r->warmest);
    }
    // The change of the energy along the true states of a closed system, over the heat produced.
    const double temperature = 0.5 * (thermo->coldest + thermo->warmest);
    int n = 0;
    for (int k = 0; k < e->count && thermo->coldest > 0 && scene->physics.nboundary_input == 0;
         ++k) {
        const pm_rollout *r = &e->rollout[k];
        const int last = r->length - 1;
        double gained = 0, produced = 0;
        for (int i = 0; i < npart; ++i) {
            gain(&s, r->part_energy, i);
            gained += s.truth[last];
            gain(&s, r->part_entropy, i);
            produced += s.truth[last];
        }
        if (produced > 0) {
            s.error[n++] = gained / (temperature * produced);
        }
    }
    if (2 * n > e->count) {
        const pm_box box = pm_box_of(n, s.error);
        thermo->warmer = box.first_quartile * box.third_quartile > 0 ? box.median : 0;
    }
    return PM_OK;
}

void pm_thermo_free(pm_thermo *thermo) {
    pm_arena_free(&thermo->arena);
}

pm_status pm_thermo_summarise(const pm_thermo_row *row, int count, pm_thermo_row *sum,
                              pm_thermo_row *worst) {
    double *median = malloc(2 * (size_t)count * sizeof *median);
    PM_TRY(median != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for a summary"));
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
