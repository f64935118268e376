// Memory of multiple shooting, and the division of tracks into windows.
#include "learn/shooting.h"

#include <stdlib.h>
#include <string.h>

// Residuals beyond this many deviations of the noise count less: 95 % efficient with normal noise.
#define HUBER 1.345

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for multiple shooting");
}

static pm_status open_arrays(pm_shooting *s) {
    const size_t nz = (size_t)s->nz, ny = (size_t)s->ny, border = (size_t)s->nborder;
    s->noise = pm_arena_array(&s->arena, ny, sizeof *s->noise);
    s->gap = pm_arena_array(&s->arena, nz, sizeof *s->gap);
    s->prior = pm_arena_array(&s->arena, nz, sizeof *s->prior);
    s->later = pm_arena_array(&s->arena, nz, sizeof *s->later);
    s->first_weight = pm_arena_array(&s->arena, border, sizeof *s->first_weight);
    s->reach = pm_arena_array(&s->arena, border, sizeof *s->reach);
    s->early_reach = pm_arena_array(&s->arena, border, sizeof *s->early_reach);
    s->matrix = pm_arena_array(&s->arena, border * border, sizeof *s->matrix);
    s->reduced = pm_arena_array(&s->arena, border * border, sizeof *s->reduced);
    s->residual = pm_arena_array(&s->arena, (size_t)s->tracks->count, sizeof *s->residual);
    if (s->noise == NULL || s->gap == NULL || s->prior == NULL || s->later == NULL ||
        s->first_weight == NULL || s->reach == NULL || s->early_reach == NULL ||
        s->matrix == NULL || s->reduced == NULL || s->residual == NULL) {
        return no_memory();
    }
    for (int i = 0; i < s->tracks->count; ++i) {
        s->residual[i] =
            pm_arena_array(&s->arena, (size_t)s->tracks->track[i].count * ny, sizeof **s->residual);
        if (s->residual[i] == NULL) {
            return no_memory();
        }
    }
    for (size_t c = 0; c < ny; ++c) {
        s->noise[c] = 1;
    }
    for (size_t c = 0; c < nz; ++c) {
        s->gap[c] = 1;
    }
    return pm_shooting_open_lanes(s);
}

pm_status pm_shooting_open(pm_shooting *s, const pm_flow_how *how, const pm_tracks *tracks) {
    *s = (pm_shooting){.how = *how,
                       .tracks = tracks,
                       .observation = how->observation,
                       .nz = how->system->scene->nz,
                       .ny = how->observation->count,
                       .huber = HUBER};
    for (int i = 0; i < pm_system_components(how->system) && !how->fixed; ++i) {
        s->nweight += (int)pm_params_trained(pm_system_params(how->system, i));
    }
    s->nborder = s->nweight + 1;
    const pm_status status = open_arrays(s);
    if (status != PM_OK) {
        pm_shooting_close(s);
    }
    return status;
}

static void free_windows(pm_shooting *s) {
    free(s->window);
    free(s->z);
    free(s->end);
    free(s->own);
    free(s->border);
    free(s->end_by_start);
    free(s->end_by_weights);
    free(s->factor);
    free(s->coupling);
    free(s->solved);
}

void pm_shooting_clear(pm_shooting *s) {
    free_windows(s);
    s->window = NULL;
    s->z = s->end = s->own = s->border = s->end_by_start = s->end_by_weights = NULL;
    s->factor = s->coupling = s->solved = NULL;
    s->nwindow = 0;
}

void pm_shooting_close(pm_shooting *s) {
    free_windows(s);
    pm_shooting_close_lanes(s);
    pm_arena_free(&s->arena);
    *s = (pm_shooting){0};
}

// --- windows ---

// Lists the windows of all tracks and returns how many there are. A window begins at a multiple of
// `length` after which at least half as many samples follow, so that longer windows begin where
// shorter ones did.
static int list_windows(const pm_tracks *tracks, int length, pm_window *window) {
    int count = 0;
    for (int i = 0; i < tracks->count; ++i) {
        const int samples = tracks->track[i].count;
        for (int first = 0; first < samples; first += length) {
            if (first > 0 && 2 * (samples - first) < length) {
                break;
            }
            const int next = first + length;
            const bool ends = next >= samples || 2 * (samples - next) < length;
            if (window != NULL) {
                window[count] = (pm_window){i, first, ends ? samples : next, first > 0, ends};
            }
            ++count;
        }
    }
    return count;
}

static bool same_start(const pm_window *a, const pm_window *b) {
    return a->track == b->track && a->first == b->first;
}

static pm_status allocate_windows(pm_shooting *s, int count) {
    const size_t n = (size_t)count, nz = (size_t)s->nz, border = (size_t)s->nborder;
    s->window = malloc(n * sizeof *s->window);
    s->z = malloc(n * nz * sizeof *s->z);
    s->end = malloc(n * nz * sizeof *s->end);
    s->own = malloc(n * nz * nz * sizeof *s->own);
    s->border = malloc(n * nz * border * sizeof *s->border);
    s->end_by_start = malloc(n * nz * nz * sizeof *s->end_by_start);
    s->end_by_weights = malloc(n * nz * border * sizeof *s->end_by_weights);
    s->factor = malloc(n * nz * nz * sizeof *s->factor);
    s->coupling = malloc(n * nz * nz * sizeof *s->coupling);
    s->solved = malloc(n * nz * border * sizeof *s->solved);
    return s->window != NULL && s->z != NULL && s->end != NULL && s->own != NULL &&
                   s->border != NULL && s->end_by_start != NULL && s->end_by_weights != NULL &&
                   s->factor != NULL && s->coupling != NULL && s->solved != NULL
               ? PM_OK
               : no_memory();
}

pm_status pm_shooting_divide(pm_shooting *s, int length) {
    pm_window *before = s->window;
    double *z = s->z;
    const int nbefore = s->nwindow, count = list_windows(s->tracks, length, NULL);
    const size_t nz = (size_t)s->nz;
    s->window = NULL;
    s->z = NULL;
    free_windows(s);
    s->nwindow = count;
    const pm_status status = allocate_windows(s, count);
    if (status == PM_OK) {
        list_windows(s->tracks, length, s->window);
    }
    for (int w = 0, old = 0; status == PM_OK && w < count; ++w) {
        while (old < nbefore && !same_start(&before[old], &s->window[w])) {
            ++old;
        }
        if (old < nbefore) {
            memcpy(s->z + (size_t)w * nz, z + (size_t)old * nz, nz * sizeof *z);
        } else {
            pm_track_sample_states(s->tracks, s->window[w].track, s->how.system->scene,
                                   s->observation, s->window[w].first, s->window[w].first + 1,
                                   s->z + (size_t)w * nz);
        }
    }
    free(before);
    free(z);
    return status;
}
