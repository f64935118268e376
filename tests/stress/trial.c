// Runs trials and checks every step.
#include "trial.h"

#include <math.h>
#include <string.h>

#include "scene/recording.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "store/hdf5_io.h"

// J/K; entropies are of order one, and summed over the substeps of a step.
#define LARGEST_FALL 1e-12

static void keep_text(char *to, const char *format, long step, const char *text) {
    if (to[0] == 0) {
        snprintf(to, TRIAL_TEXT, format, step, text);
    }
}

// Sum of q x p with positions from the pivot, where every subsystem is a link with q[2], p[2] and
// q relative to the one before; else NaN.
static double angular_momentum(const pm_scene *scene, const double *z) {
    double pivot[2] = {0, 0}, sum = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_layout *layout = &scene->physics.subsystem[i].layout;
        const pm_group *q = pm_layout_find(layout, "q"), *p = pm_layout_find(layout, "p");
        if (q == NULL || p == NULL || q->size != 2 || p->size != 2) {
            return NAN;
        }
        const double *own = z + scene->physics.subsystem[i].first;
        pivot[0] += own[q->first];
        pivot[1] += own[q->first + 1];
        sum += pivot[0] * own[p->first + 1] - pivot[1] * own[p->first];
    }
    return sum;
}

static bool is_finite(const pm_scene *scene, const pm_sample *sample) {
    bool finite = true;
    for (int i = 0; i < scene->physics.nz; ++i) {
        finite = finite && isfinite(sample->z[i]);
    }
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        finite = finite && isfinite(sample->energy[i]) && isfinite(sample->entropy[i]);
    }
    return finite;
}

// --- one run ---

typedef struct trial {
    const pm_scene *scene;
    pm_monolithic *assembly;
    pm_ledger ledger;
    pm_recording *recording;
    long reached;
    double momentum; // largest drift
    trial_row *row;
} trial;

static pm_status book(trial *t) {
    pm_sample sample = *pm_monolithic_sample(t->assembly);
    if (!is_finite(t->scene, &sample)) {
        keep_text(t->row->fault, "step %ld: a number that is not finite went by in silence%s",
                  sample.step, "");
    }
    if (pm_ledger_add_sample(&t->ledger, &sample) != PM_OK) {
        keep_text(t->row->fault, "step %ld: %s", sample.step, pm_error());
    }
    return pm_recording_append(t->recording, &sample);
}

// Steps until the end, or until the program says that it cannot go on.
static pm_status step_on(trial *t, long steps) {
    const double first = angular_momentum(t->scene, pm_monolithic_sample(t->assembly)->z);
    PM_TRY(book(t));
    while (t->reached < steps) {
        const pm_status status = pm_monolithic_step(t->assembly);
        if (status != PM_OK) {
            ++t->row->ended;
            keep_text(t->row->why, "step %ld: %s", t->reached + 1, pm_error());
            if (status != PM_ENUMERIC) {
                keep_text(t->row->fault, "step %ld ends with another error: %s", t->reached + 1,
                          pm_error());
            }
            return PM_OK;
        }
        ++t->reached;
        PM_TRY(book(t));
        const double now = angular_momentum(t->scene, pm_monolithic_sample(t->assembly)->z);
        t->momentum = fmax(t->momentum, fabs(now - first));
    }
    return PM_OK;
}

// The recording must hold the start and every step that was done.
static pm_status check_recording(const trial *t, const char *path) {
    pm_hdf5 *file = NULL;
    int count = 0;
    pm_status status = pm_hdf5_open(&file, path, PM_HDF5_ANY, PM_EDATA);
    if (status == PM_OK) {
        status = pm_hdf5_shape(file, "/ledger/energy", 1, &count);
    }
    pm_hdf5_close(file);
    if (status != PM_OK || count != t->reached + 1) {
        keep_text(t->row->fault, "the recording lacks some of %ld samples%s", t->reached + 1, "");
    }
    return status == PM_ENOMEM ? status : PM_OK;
}

pm_status trial_run(trial_row *row, const pm_system *system, const double *z, long steps,
                    const char *recording) {
    trial t = {.scene = system->scene, .row = row};
    pm_status status;
    PM_TRY_DONE(pm_monolithic_open(&t.assembly, system));
    PM_TRY_DONE(pm_recording_open(&t.recording, recording, t.scene));
    pm_monolithic_set_state(t.assembly, z);
    pm_ledger_init(&t.ledger, system);
    PM_TRY_DONE(step_on(&t, steps));
    status = pm_recording_close(t.recording);
    t.recording = NULL;
    PM_TRY_DONE(status);
    PM_TRY_DONE(check_recording(&t, recording));
    ++row->count;
    if (t.ledger.worst_entropy_fall > LARGEST_FALL) {
        keep_text(row->fault, "by step %ld the total entropy has fallen%s", t.reached, "");
    }
    row->fall = fmax(row->fall, t.ledger.worst_entropy_fall);
    if (t.reached == steps) {
        row->drift = fmax(row->drift, t.ledger.energy_drift);
        row->momentum = fmax(row->momentum, t.momentum);
    }
done:
    pm_recording_close(t.recording);
    pm_monolithic_close(t.assembly);
    return status;
}

// --- the table ---

void trial_print_header(FILE *csv) {
    printf("%-52s %5s %5s %9s %9s %9s\n", "", "runs", "ended", "E drift", "S falls", "momentum");
    if (csv != NULL) {
        fprintf(csv, "what,runs,ended,energy_drift,entropy_fall,momentum_drift,why,fault\n");
    }
}

void trial_print(const trial_row *row, FILE *csv) {
    printf("%-52s %5d %5d %9.1e %9.1e %9.1e\n", row->name, row->count, row->ended, row->drift,
           row->fall, row->momentum);
    if (row->why[0] != 0) {
        printf("    first end: %s\n", row->why);
    }
    if (row->fault[0] != 0) {
        printf("    FAULT: %s\n", row->fault);
    }
    if (csv != NULL) {
        fprintf(csv, "\"%s\",%d,%d,%.3g,%.3g,%.3g,\"%s\",\"%s\"\n", row->name, row->count,
                row->ended, row->drift, row->fall, row->momentum, row->why, row->fault);
    }
    fflush(stdout);
}
