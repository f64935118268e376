// Selects samples, divides the time between them into intervals, and interpolates missing values.
#include "data/track.h"

#include <math.h>
#include <string.h>

#include "scene/boundary_input.h"

#define EQUAL 1e-6   // relative difference of times that count as equal
#define NEIGHBOURS 4 // samples of an interpolating polynomial

// --- samples ---

// Leaves some of the samples [count], and returns how many: after the first one, each is that whose
// time is nearest to dt after that of the one before. The last sample counts as followed by another
// one, at its own distance from the one before it.
static int thin_out(const pm_dataset *d, int trajectory, double dt, int count, int *sample) {
    int left = 0;
    for (int j = 0; j < count; ++j) {
        const double aim =
            left == 0 ? -INFINITY : pm_dataset_time(d, trajectory, sample[left - 1]) + dt;
        for (bool nearer = j > 0; nearer && j < count; j += nearer) {
            const double t = pm_dataset_time(d, trajectory, sample[j]);
            const double next = j + 1 < count
                                    ? pm_dataset_time(d, trajectory, sample[j + 1])
                                    : 2 * t - pm_dataset_time(d, trajectory, sample[j - 1]);
            nearer = next - aim <= aim - t + EQUAL * dt;
        }
        if (j < count) {
            sample[left++] = sample[j];
        }
    }
    return left;
}

// --- steps ---

// The steps of a track while they are listed. `input` follows its trajectory; NULL: no inputs.
typedef struct listing {
    const pm_scene *scene;
    pm_boundary_input *input;
    pm_track *track;
    int count; // of steps so far; the arrays of the track are filled unless they are NULL
} listing;

// Lists the equal steps, of at most one dt each, from one time to another, between which no input
// jumps.
static void list_steps(listing *l, double from, double end) {
    const double span = (end - from) / l->scene->physics.dt;
    const int steps = (int)fmax(1, ceil(span * (1 - EQUAL)));
    const double exact = span / steps, duration = fabs(exact - 1) < EQUAL ? 1 : exact;
    for (int i = 0; i < steps && l->track->duration != NULL; ++i) {
        l->track->duration[l->count + i] = duration;
        if (l->input != NULL) {
            const double length = (end - from) / steps;
            const size_t width = (size_t)l->input->n * PM_BOUNDARY_INPUT_ORDER;
            pm_boundary_input_over(l->input,
                                   pm_boundary_input_position(l->input, from + i * length),
                                   pm_boundary_input_position(l->input, from + (i + 1) * length),
                                   l->track->input + (size_t)(l->count + i) * width);
        }
    }
    l->count += steps;
}

// Lists the steps of a track, which begin at samples and at jumps of inputs.
static void list_track(listing *l) {
    pm_track *r = l->track;
    l->count = 0;
    for (int k = 0; k + 1 < r->count; ++k) {
        r->first_step[k] = l->count;
        double from = r->time[k];
        while (l->input != NULL) {
            const double end = pm_boundary_input_position(l->input, r->time[k + 1]);
            const double jump =
                pm_boundary_input_jump(l->input, pm_boundary_input_position(l->input, from), end);
            if (jump >= end) {
                break;
            }
            const double time = l->input->origin + jump * l->input->unit;
            list_steps(l, from, time);
            from = time;
        }
        list_steps(l, from, r->time[k + 1]);
    }
    r->first_step[r->count - 1] = l->count;
}

// Finds the steps of all tracks, and the boundary inputs over them.
static pm_status make_steps(pm_tracks *tracks, const pm_scene *scene, const pm_dataset *d,
                            const int *which) {
    const int n = scene->physics.nprescribed;
    pm_boundary_input input = {0};
    pm_arena *arena = &tracks->arena;
    if (n > 0) {
        PM_TRY(pm_boundary_input_bind(&input, scene, d, pm_boundary_input_stride(scene, d), arena));
    }
    for (int i = 0; i < tracks->count; ++i) {
        pm_track *r = &tracks->track[i];
        listing l = {scene, n > 0 ? &input : NULL, r, 0};
        if (n > 0) {
            pm_boundary_input_follow(&input, d, which[i]);
        }
        r->first_step = pm_arena_array(arena, (size_t)r->count, sizeof *r->first_step);
        PM_TRY(pm_arena_status(arena, "measured trajectories"));
        list_track(&l);
        const size_t steps = (size_t)l.count, width = (size_t)n * PM_BOUNDARY_INPUT_ORDER;
        double *duration = pm_arena_array(arena, steps, sizeof *duration);
        double *over = pm_arena_array(arena, steps * width, sizeof *over);
        if (n > 0) {
            r->input = over;
            r->now = pm_arena_array(arena, (size_t)(r->count * n), sizeof *r->now);
        }
        PM_TRY(pm_arena_status(arena, "measured trajectories"));
        r->duration = duration;
        list_track(&l);
        for (size_t k = 0; k < steps; ++k) {
            tracks->stretched = tracks->stretched || duration[k] != 1;
        }
        for (int k = 0; k < r->count * n; ++k) {
            r->now[k] = pm_boundary_input_of(&input, k % n, r->time[k / n]);
        }
    }
    return PM_OK;
}

// --- making ---

static pm_status make(pm_tracks *tracks, const pm_scene *scene, const pm_observation *o,
                      const pm_dataset *d, const int *which, double until, bool thin) {
    tracks->track = pm_arena_array(&tracks->arena, (size_t)tracks->count, sizeof *tracks->track);
    int *sample = pm_arena_array(&tracks->arena, (size_t)d->ntime, sizeof *sample);
    PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
    for (int i = 0; i < tracks->count; ++i) {
        pm_track *r = &tracks->track[i];
        const double start = pm_dataset_time(d, which[i], 0);
        int count = 0, end = pm_dataset_length(d, which[i]);
        while (end > 0 && pm_dataset_time(d, which[i], end - 1) - start > until * (1 + EQUAL)) {
            --end;
        }
        for (int j = 0; j < end; ++j) {
            // Rows to choose from: the first one, and those with a sample of a measured column.
            // Inputs may have rows of their own.
            bool measured = !thin || j == 0;
            for (int c = 0; c < o->count && !measured; ++c) {
                measured = !isnan(pm_dataset_state(d, which[i], j)[o->column[c]]);
            }
            sample[count] = j;
            count += measured;
        }
        if (thin) {
            count = thin_out(d, which[i], scene->physics.dt, count, sample);
        }
        r->count = count;
        if (r->count < 2) {
            return pm_fail(PM_EDATA,
                           "trajectory %d has %d sample%s within %g s, about dt = %g s apart, "
                           "expected two or more",
                           which[i], r->count, r->count == 1 ? "" : "s", until, scene->physics.dt);
        }
        r->sample = pm_arena_array(&tracks->arena, (size_t)r->count, sizeof *r->sample);
        PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
        memcpy(r->sample, sample, (size_t)r->count * sizeof *sample);
        const size_t n = (size_t)r->count;
        r->time = pm_arena_array(&tracks->arena, n, sizeof *r->time);
        r->y = pm_arena_array(&tracks->arena, n * (size_t)o->count, sizeof *r->y);
        PM_TRY(pm_arena_status(&tracks->arena, "measured trajectories"));
        for (int k = 0; k < r->count; ++k) {
            const double *row = pm_dataset_state(d, which[i], r->sample[k]);
            r->time[k] = pm_dataset_time(d, which[i], r->sample[k]);
            for (int c = 0; c < o->count; ++c) {
                r->y[(ptrdiff_t)k * o->count + c] = row[o->column[c]];
            }
        }
    }
    PM_TRY(make_steps(tracks, scene, d, which));
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
