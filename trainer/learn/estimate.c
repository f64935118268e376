// Multiple shooting with fixed weights on the first samples, and a prediction by the same steps.
#include "learn/estimate.h"

#include <math.h>
#include <string.h>

#include "learn/shooting_schedule.h"

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for an estimate");
}

static pm_flow_how how_of(pm_system *system, const pm_observation *o, const pm_tracks *tracks) {
    const pm_scene *scene = system->scene;
    return (pm_flow_how){.system = system,
                         .observation = o,
                         .integrator = scene->integrator,
                         .substeps = scene->substeps,
                         .stretched = tracks->stretched,
                         .fixed = true};
}

// --- starts ---

static pm_status shoot(pm_estimate *e, pm_shooting *s, const pm_observation *o,
                       const volatile sig_atomic_t *stop) {
    double *given = pm_arena_array(&e->arena, (size_t)e->ny, sizeof *given);
    if (given == NULL) {
        return no_memory();
    }
    for (int c = 0; c < s->nz; ++c) {
        s->prior[c] = o->hidden[c] ? o->deviation[c] : 0;
    }
    const pm_shooting_course course = {.given = given, .typical = o->deviation, .stop = stop};
    PM_TRY(pm_shooting_run(s, &course));
    for (int w = 0; w < s->nwindow; ++w) {
        if (!s->window[w].follows) {
            memcpy(e->start + (ptrdiff_t)s->window[w].track * e->nz, s->z + (ptrdiff_t)w * e->nz,
                   (size_t)e->nz * sizeof *e->start);
        }
    }
    memcpy(e->noise, s->noise, (size_t)e->ny * sizeof *e->noise);
    return PM_OK;
}

static pm_status find_starts(pm_estimate *e, pm_system *system, const pm_observation *o,
                             const pm_dataset *dataset, const int *which, double seconds,
                             const volatile sig_atomic_t *stop) {
    pm_tracks tracks;
    pm_shooting shooting = {0};
    PM_TRY(pm_tracks_make(&tracks, system->scene, o, dataset, e->count, which, seconds, true));
    const pm_flow_how how = how_of(system, o, &tracks);
    pm_status status = pm_shooting_open(&shooting, &how, &tracks);
    if (status == PM_OK) {
        status = shoot(e, &shooting, o, stop);
    }
    pm_shooting_close(&shooting);
    pm_tracks_free(&tracks);
    return status;
}

// --- prediction ---

static void write_sample(pm_estimate *e, const pm_track *track, int id, int k, const double *z,
                         const double *y) {
    const ptrdiff_t at = (ptrdiff_t)id * e->ntime + track->sample[k];
    memcpy(e->z + at * e->nz, z, (size_t)e->nz * sizeof *z);
    memcpy(e->y + at * e->ny, y, (size_t)e->ny * sizeof *y);
}

// Follows one track from its start, one sample after the other.
static void follow(pm_estimate *e, pm_flow *flow, const pm_track *track, int id, double *z,
                   double *y) {
    pm_flow_item item = {.z = z};
    pm_flow_item *const items[] = {&item};
    const ptrdiff_t width = pm_flow_inputs(flow);
    memcpy(z, e->start + (ptrdiff_t)id * e->nz, (size_t)e->nz * sizeof *z);
    for (int k = 0; k < track->count; ++k) {
        pm_flow_look(flow, 1, items, y, NULL, NULL);
        write_sample(e, track, id, k, z, y);
        item.duration = track->duration[k];
        item.input = track->input == NULL ? NULL : track->input + k * width;
        for (int step = 0; step < track->steps[k]; ++step) {
            pm_flow_step(flow, 1, items);
        }
    }
}

static pm_status predict(pm_estimate *e, pm_system *system, const pm_observation *o,
                         const pm_dataset *dataset, const int *which,
                         const volatile sig_atomic_t *stop) {
    pm_tracks tracks;
    pm_flow *flow = NULL;
    double *z = pm_arena_array(&e->arena, (size_t)e->nz, sizeof *z);
    double *y = pm_arena_array(&e->arena, (size_t)e->ny, sizeof *y);
    if (z == NULL || y == NULL) {
        return no_memory();
    }
    PM_TRY(pm_tracks_make(&tracks, system->scene, o, dataset, e->count, which, INFINITY, false));
    const pm_flow_how how = how_of(system, o, &tracks);
    pm_status status = pm_flow_open(&flow, &how, false);
    for (int i = 0; i < e->count && status == PM_OK; ++i) {
        follow(e, flow, &tracks.track[i], i, z, y);
        status = stop != NULL && *stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK;
    }
    pm_flow_close(flow);
    pm_tracks_free(&tracks);
    return status;
}

static pm_status allocate(pm_estimate *e) {
    const size_t samples = (size_t)e->count * (size_t)e->ntime;
    const size_t ny = (size_t)e->ny, nz = (size_t)e->nz;
    e->start = pm_arena_array(&e->arena, (size_t)e->count * nz, sizeof *e->start);
    e->noise = pm_arena_array(&e->arena, ny, sizeof *e->noise);
    e->y = pm_arena_array(&e->arena, samples * ny, sizeof *e->y);
    e->z = pm_arena_array(&e->arena, samples * nz, sizeof *e->z);
    if (e->start == NULL || e->noise == NULL || e->y == NULL || e->z == NULL) {
        return no_memory();
    }
    for (size_t i = 0; i < samples * ny; ++i) {
        e->y[i] = NAN;
    }
    for (size_t i = 0; i < samples * nz; ++i) {
        e->z[i] = NAN;
    }
    return PM_OK;
}

pm_status pm_estimate_make(pm_estimate *e, pm_system *system, const pm_observation *o,
                           const pm_dataset *dataset, int count, const int *which, double seconds,
                           const volatile sig_atomic_t *stop) {
    *e = (pm_estimate){
        .count = count, .ntime = dataset->ntime, .ny = o->count, .nz = system->scene->nz};
    pm_status status = allocate(e);
    if (status == PM_OK) {
        status = find_starts(e, system, o, dataset, which, seconds, stop);
    }
    if (status == PM_OK) {
        status = predict(e, system, o, dataset, which, stop);
    }
    if (status != PM_OK) {
        pm_estimate_free(e);
    }
    return status;
}

void pm_estimate_free(pm_estimate *e) {
    pm_arena_free(&e->arena);
    *e = (pm_estimate){0};
}
