// Selects samples, divides the time between them into intervals, and interpolates missing values.
#include "data/track.h"

#include <math.h>
#include <string.h>

#include "scene/boundary_input.h"

#define EQUAL 1e-6   // relative difference of times that count as equal
#define NEIGHBOURS 4 // samples of an interpolating polynomial

// --- samples ---

// Returns true if the sample after sample j is at least as near to the time `aim` as sample j. The
// last sample counts as followed by another one, at its own distance from the one before it.
static bool later_is_nearer(const pm_dataset *d, int trajectory, int j, int end, double aim,
                            double dt) {
    const double t = pm_dataset_time(d, trajectory, j);
    if (j == 0) {
        return false;
    }
    const double next = j + 1 < end ? pm_dataset_time(d, trajectory, j + 1)
                                    : 2 * t - pm_dataset_time(d, trajectory, j - 1);
    return next - aim <= aim - t + EQUAL * dt;
}

// --- boundary inputs ---

static pm_status follow_inputs(pm_tracks *tracks, const pm_scene *scene, const pm_dataset *d,
                               const int *which) {
    if (scene->physics.nprescribed == 0) {
        return PM_OK;
    }
    if (tracks->stretched || d->times != NULL) {
        return pm_fail(PM_EDATA,
                       "%s: boundary inputs need measurements that are dt = %g s apart, found %g s",
                       scene->path, scene->physics.dt, d->dt);
    }
    pm_boundary_input input = {0};
    const size_t width = (size_t)scene->physics.nprescribed * PM_BOUNDARY_INPUT_ORDER;
    PM_TRY(pm_boundary_input_bind(&input, scene, d, 1, &tracks->arena));
    for (int i = 0; i < tracks->count; ++i) {
        pm_track *r = &tracks->track[i];
        pm_boundary_input_follow(&input, d, which[i]);
        r->input = pm_arena_array(&tracks->arena, (size_t)r->count * width, sizeof *r->input);
        PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
        for (int k = 0; k + 1 < r->count; ++k) {
            memcpy(r->input + (size_t)k * width, pm_boundary_input_interval(&input, k),
                   width * sizeof *r->input);
        }
    }
    return PM_OK;
}

// --- statistics ---

// --- making ---

static pm_status make(pm_tracks *tracks, const pm_scene *scene, const pm_observation *o,
                      const pm_dataset *d, const int *which, double until, bool thin) {
    tracks->track = pm_arena_array(&tracks->arena, (size_t)tracks->count, sizeof *tracks->track);
    int *sample = pm_arena_array(&tracks->arena, (size_t)d->ntime, sizeof *sample);
    PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
    for (int i = 0; i < tracks->count; ++i) {
        pm_track *r = &tracks->track[i];
        // Lists the samples of a trajectory and returns how many there are. With `thin`, each
        // sample after the first is the one whose time is nearest to dt after that of the one
        // before.
        const double start = pm_dataset_time(d, which[i], 0);
        int count = 0, end = 0;
        for (; end < d->ntime; ++end) {
            const double t = pm_dataset_time(d, which[i], end);
            if (isnan(t) || t - start > until * (1 + EQUAL)) {
                break;
            }
        }
        for (int j = 0; j < end; ++j) {
            const double aim =
                count == 0 ? start
                           : pm_dataset_time(d, which[i], sample[count - 1]) + scene->physics.dt;
            while (thin && j < end &&
                   later_is_nearer(d, which[i], j, end, aim, scene->physics.dt)) {
                ++j;
            }
            if (j < end) {
                sample[count++] = j;
            }
        }
        r->count = count;
        if (r->count < 2) {
            return pm_fail(PM_EDATA,
                           "trajectory %d has %d samples within %g s that are about dt = %g s "
                           "apart, expected two or more",
                           which[i], r->count, until, scene->physics.dt);
        }
        r->sample = pm_arena_array(&tracks->arena, (size_t)r->count, sizeof *r->sample);
        PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
        memcpy(r->sample, sample, (size_t)r->count * sizeof *sample);
        const size_t n = (size_t)r->count;
        r->time = pm_arena_array(&tracks->arena, n, sizeof *r->time);
        r->y = pm_arena_array(&tracks->arena, n * (size_t)o->count, sizeof *r->y);
        r->steps = pm_arena_array(&tracks->arena, n, sizeof *r->steps);
        r->duration = pm_arena_array(&tracks->arena, n, sizeof *r->duration);
        PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
        for (int k = 0; k < r->count; ++k) {
            const double *row = pm_dataset_state(d, which[i], r->sample[k]);
            r->time[k] = pm_dataset_time(d, which[i], r->sample[k]);
            for (int c = 0; c < o->count; ++c) {
                r->y[(ptrdiff_t)k * o->count + c] = row[o->column[c]];
            }
        }
        for (int k = 0; k + 1 < r->count; ++k) {
            const double span = (r->time[k + 1] - r->time[k]) / scene->physics.dt;
            r->steps[k] = (int)fmax(1, ceil(span * (1 - EQUAL)));
            r->duration[k] = span / r->steps[k];
            if (fabs(r->duration[k] - 1) < EQUAL) {
                r->duration[k] = 1;
            } else {
                tracks->stretched = true;
            }
        }
    }
    PM_TRY(follow_inputs(tracks, scene, d, which));
    tracks->deviation =
        pm_arena_array(&tracks->arena, (size_t)tracks->ny, sizeof *tracks->deviation);
    PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
    for (int c = 0; c < tracks->ny; ++c) {
        // Computes the deviation of one column over all samples.
        double sum = 0, square = 0;
        int n = 0;
        for (int i = 0; i < tracks->count; ++i) {
            const pm_track *r = &tracks->track[i];
            for (int k = 0; k < r->count; ++k) {
                const double y = r->y[(ptrdiff_t)k * tracks->ny + c];
                sum += isfinite(y) ? y : 0;
                square += isfinite(y) ? y * y : 0;
                n += isfinite(y);
            }
        }
        const double mean = n > 0 ? sum / n : 0;
        const double deviation = n > 1 ? sqrt(fmax(square / n - mean * mean, 0)) : 0;
        tracks->deviation[c] = deviation > 0 ? deviation : 1;
    }
    return PM_OK;
}

pm_status pm_tracks_make(pm_tracks *tracks, const pm_scene *scene, const pm_observation *o,
                         const pm_dataset *dataset, int count, const int *which, double until,
                         bool thin) {
    *tracks = (pm_tracks){.count = count, .ny = o->count};
    const pm_status status = make(tracks, scene, o, dataset, which, until, thin);
    if (status != PM_OK) {
        pm_tracks_free(tracks);
    }
    return status;
}

void pm_tracks_free(pm_tracks *tracks) {
    pm_arena_free(&tracks->arena);
    *tracks = (pm_tracks){0};
}

// --- states ---

// Interpolates a column of a track at a time: the polynomial through the nearest samples that are
// there, from sample `*near` on, which moves with the time.
static double interpolate(const pm_track *r, int ny, int column, double time, int *near) {
    int chosen[NEIGHBOURS], n = 0;
    while (*near + 1 < r->count && r->time[*near + 1] <= time) {
        ++*near;
    }
    int before = *near, after = *near + 1;
    while (n < NEIGHBOURS && (before >= 0 || after < r->count)) {
        const bool back =
            after >= r->count || (before >= 0 && time - r->time[before] <= r->time[after] - time);
        const int k = back ? before-- : after++;
        if (isfinite(r->y[(ptrdiff_t)k * ny + column])) {
            chosen[n++] = k;
        }
    }
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        double weight = 1;
        for (int j = 0; j < n; ++j) {
            if (j != i) {
                weight *= (time - r->time[chosen[j]]) / (r->time[chosen[i]] - r->time[chosen[j]]);
            }
        }
        sum += weight * r->y[(ptrdiff_t)chosen[i] * ny + column];
    }
    return sum;
}

// Writes the states of a track at rising times.
static void states_at(const pm_track *r, const pm_scene *scene, const pm_observation *o, int n,
                      double (*time_at)(const void *context, int i), const void *context,
                      double *state) {
    const int nz = scene->physics.nz;
    for (int i = 0; i < n * nz; ++i) {
        state[i] = o->guess[i % nz];
    }
    for (int c = 0; c < o->count; ++c) {
        int near = 0;
        for (int i = 0; i < n && o->component[c] >= 0; ++i) {
            state[(ptrdiff_t)i * nz + o->component[c]] =
                interpolate(r, o->count, c, time_at(context, i), &near);
        }
    }
    for (int i = 0; i < n; ++i) {
        // Columns hold values from the origin, components values from their base. The end of a
        // chain of bases comes first, so that every base still holds its column when it is
        // subtracted.
        double *z = state + (ptrdiff_t)i * nz;
        int longest = 0;
        for (int pass = 0; pass <= longest; ++pass) {
            for (int c = 0; c < nz; ++c) {
                int depth = 0;
                for (int base = o->base[c]; base >= 0; base = o->base[base]) {
                    ++depth;
                }
                if (pass == 0 && depth > longest) {
                    longest = depth;
                }
                if (pass > 0 && depth == longest + 1 - pass && !o->hidden[c]) {
                    z[c] -= z[o->base[c]];
                }
            }
        }
    }
}

typedef struct grid {
    double start, dt;
} grid;

static double grid_time(const void *context, int i) {
    const grid *g = context;
    return g->start + i * g->dt;
}

static double sample_time(const void *context, int i) {
    return ((const double *)context)[i];
}

void pm_track_states(const pm_tracks *tracks, int id, const pm_scene *scene,
                     const pm_observation *o, int ntime, double *state) {
    const pm_track *r = &tracks->track[id];
    const grid g = {r->time[0], scene->physics.dt};
    states_at(r, scene, o, ntime, grid_time, &g, state);
}

void pm_track_sample_states(const pm_tracks *tracks, int id, const pm_scene *scene,
                            const pm_observation *o, int first, int end, double *state) {
    const pm_track *r = &tracks->track[id];
    states_at(r, scene, o, end - first, sample_time, r->time + first, state);
}
