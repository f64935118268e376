// The subsystems of one process, in a batch or one by one. In every round all of them expose before
// any is coupled, and all are coupled before any advances.
#include "sim/local_subsystems.h"

#include <stdlib.h>
#include <string.h>

#include "sim/batch.h"
#include "sim/step_controller.h"

// Fewer subsystems are stepped one by one, as are those of which most lanes of a batch would be
// empty. The bits are the same.
#define FEWEST_IN_BATCH 16

// A peer is what stands at the other end of a port of a subsystem that is stepped alone.
typedef enum peer_kind { PEER_BOUNDARY_INPUT, PEER_HERE, PEER_REMOTE } peer_kind;

typedef struct peer {
    peer_kind kind;
    int subsystem, port; // PEER_HERE: position among the subsystems here, and among its ports
    int remote;          // PEER_REMOTE: position of the remote end
} peer;

struct pm_local_subsystems {
    const pm_system *system;
    pm_arena arena;
    int count;
    const int *id;            // [count] positions in the scene
    pm_batch *batch;          // NULL: the subsystems are stepped one by one
    pm_subsystem **subsystem; // [count] NULL: they are a batch
    peer **peer;              // [count][ports of the subsystem]
    int nremote;
    pm_remote_end *remote; // [nremote]
    // These serve subsystems that are stepped alone: subsystem here and its port, and what was
    // heard.
    int (*own)[2];         // [nremote]
    pm_port_values *heard; // [nremote]
};

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for the subsystems of a process");
}

// --- opening ---

static pm_status open_batch(pm_local_subsystems *l) {
    if (l->count < FEWEST_IN_BATCH) {
        return PM_OK;
    }
    PM_TRY(pm_batch_open(&l->batch, l->system, l->count, l->id));
    if (l->batch != NULL && pm_batch_lanes(l->batch) > 2 * l->count) {
        pm_batch_close(l->batch);
        l->batch = NULL;
    }
    return PM_OK;
}

// Returns the position of a subsystem of the scene among those here; -1: it is in another process.
static int find(const pm_local_subsystems *l, int id) {
    int low = 0, high = l->count;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (l->id[middle] < id) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low < l->count && l->id[low] == id ? low : -1;
}

// Lists the remote ends.
static pm_status list_remote(pm_local_subsystems *l) {
    const pm_scene *scene = l->system->scene;
    for (int pass = 0; pass < 2; ++pass) {
        const size_t count = (size_t)l->nremote;
        l->nremote = 0;
        if (pass == 1) {
            l->remote = pm_arena_array(&l->arena, count, sizeof *l->remote);
            if (l->remote == NULL) {
                return no_memory();
            }
        }
        for (int i = 0; i < l->count; ++i) {
            for (int k = scene->first_end[l->id[i]]; k < scene->first_end[l->id[i] + 1]; ++k) {
                const int port = scene->end_at[k] / 2, end = scene->end_at[k] % 2;
                const int other = scene->port[port].subsystem[1 - end];
                if (other < 0 || find(l, other) >= 0) {
                    continue;
                }
                if (pass == 1) {
                    l->remote[l->nremote] = (pm_remote_end){port, (pm_end)end};
                }
                ++l->nremote;
            }
        }
    }
    return PM_OK;
}

// Returns the index of a port among the ports of a subsystem.
static int port_position(const pm_subsystem *subsystem, int port_id) {
    int i = 0;
    while (pm_subsystem_port_id(subsystem, i) != port_id) {
        ++i;
    }
    return i;
}

// Finds the peers of a subsystem. The first of two subsystems here evaluates the port between them
// for both. `nremote` counts the remote ends so far.
static pm_status find_peers(pm_local_subsystems *l, int i, int *nremote) {
    const pm_scene *scene = l->system->scene;
    pm_subsystem *s = l->subsystem[i];
    for (int k = 0; k < pm_subsystem_nport(s); ++k) {
        peer *p = &l->peer[i][k];
        const int port = pm_subsystem_port_id(s, k);
        const int other = scene->port[port].subsystem[1 - (int)pm_subsystem_end(s, k)];
        const int here = other < 0 ? -1 : find(l, other);
        if (other >= 0 && here < 0) {
            l->own[*nremote][0] = i;
            l->own[*nremote][1] = k;
            *p = (peer){.kind = PEER_REMOTE, .remote = (*nremote)++};
        } else if (other >= 0) {
            *p = (peer){PEER_HERE, here, port_position(l->subsystem[here], port), -1};
            if (i < here) {
                PM_TRY(pm_subsystem_share(s, k, l->subsystem[here], p->port));
            }
        }
    }
    return PM_OK;
}

static pm_status open_alone(pm_local_subsystems *l) {
    const int *first_end = l->system->scene->first_end;
    const size_t n = (size_t)l->count, nremote = (size_t)l->nremote;
    l->subsystem = pm_arena_array(&l->arena, n, sizeof *l->subsystem);
    l->peer = pm_arena_array(&l->arena, n, sizeof *l->peer);
    l->own = pm_arena_array(&l->arena, nremote, sizeof *l->own);
    l->heard = pm_arena_array(&l->arena, nremote, sizeof *l->heard);
    if (l->subsystem == NULL || l->peer == NULL || l->own == NULL || l->heard == NULL) {
        return no_memory();
    }
    for (int i = 0; i < l->count; ++i) {
        const int id = l->id[i];
        PM_TRY(pm_subsystem_open(&l->subsystem[i], l->system, id));
        l->peer[i] = pm_arena_array(&l->arena, (size_t)(first_end[id + 1] - first_end[id]),
                                    sizeof *l->peer[i]);
        if (l->peer[i] == NULL) {
            return no_memory();
        }
    }
    for (int i = 0, remote = 0; i < l->count; ++i) {
        PM_TRY(find_peers(l, i, &remote));
    }
    return PM_OK;
}

// Starts a batch where its subsystems would start alone.
static pm_status start_batch(pm_local_subsystems *l) {
    const pm_scene *scene = l->system->scene;
    double *z = calloc((size_t)scene->nz + 1, sizeof *z);
    if (z == NULL) {
        return no_memory();
    }
    for (int i = 0; i < l->count; ++i) {
        const pm_scene_subsystem *s = &scene->subsystem[l->id[i]];
        if (s->initial != NULL) {
            memcpy(z + s->first, s->initial, (size_t)s->layout.nz * sizeof *z);
        }
    }
    pm_batch_set_state(l->batch, z);
    free(z);
    return PM_OK;
}

static pm_status open_all(pm_local_subsystems *l, const int *id) {
    l->id = id;
    if (id == NULL) {
        int *all = pm_arena_array(&l->arena, (size_t)l->count, sizeof *all);
        if (all == NULL) {
            return no_memory();
        }
        for (int i = 0; i < l->count; ++i) {
            all[i] = i;
        }
        l->id = all;
    }
    PM_TRY(list_remote(l));
    PM_TRY(open_batch(l));
    return l->batch == NULL ? open_alone(l) : start_batch(l);
}

pm_status pm_local_subsystems_open(pm_local_subsystems **local, const pm_system *system, int count,
                                   const int *id) {
    pm_local_subsystems *l = calloc(1, sizeof *l);
    if (l == NULL) {
        return no_memory();
    }
    l->system = system;
    l->count = id == NULL ? system->scene->nsubsystem : count;
    const pm_status status = open_all(l, id);
    if (status != PM_OK) {
        pm_local_subsystems_close(l);
        return status;
    }
    *local = l;
    return PM_OK;
}

void pm_local_subsystems_close(pm_local_subsystems *l) {
    if (l != NULL) {
        for (int i = 0; i < l->count && l->subsystem != NULL; ++i) {
            pm_subsystem_close(l->subsystem[i]);
        }
        pm_batch_close(l->batch);
        pm_arena_free(&l->arena);
        free(l);
    }
}

int pm_local_subsystems_nremote(const pm_local_subsystems *l) {
    return l->nremote;
}

pm_remote_end pm_local_subsystems_remote(const pm_local_subsystems *l, int remote) {
    return l->remote[remote];
}

// --- the start of a run ---

void pm_local_subsystems_set_boundary_input(pm_local_subsystems *l,
                                            const pm_boundary_input *boundary_input) {
    for (int i = 0; i < l->count && l->batch == NULL; ++i) {
        pm_subsystem_set_boundary_input(l->subsystem[i], boundary_input);
    }
}

void pm_local_subsystems_set_state(pm_local_subsystems *l, const double *z) {
    if (l->batch != NULL) {
        pm_batch_set_state(l->batch, z);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        pm_subsystem_set_state(l->subsystem[i], z + l->system->scene->subsystem[l->id[i]].first);
    }
}

void pm_local_subsystems_set_substeps(pm_local_subsystems *l, int substeps) {
    if (l->batch != NULL) {
        pm_batch_set_substeps(l->batch, substeps);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        pm_subsystem_set_substeps(l->subsystem[i], substeps);
    }
}

int pm_local_subsystems_most_rounds(const pm_local_subsystems *l) {
    const pm_scene *scene = l->system->scene;
    const int most = scene->tolerance > 0 ? PM_MOST_SUBSTEPS : scene->substeps;
    return l->batch != NULL ? most * scene->integrator->nstage
                            : pm_subsystem_most_rounds(l->subsystem[0]);
}

// --- a round ---

bool pm_local_subsystems_completes_step(const pm_local_subsystems *l) {
    return l->batch != NULL ? pm_batch_completes_step(l->batch)
                            : pm_subsystem_completes_step(l->subsystem[0]);
}

void pm_local_subsystems_expose(pm_local_subsystems *l) {
    // A batch has exposed its subsystems when they reached their states.
    for (int i = 0; i < l->count && l->batch == NULL; ++i) {
        pm_subsystem_expose(l->subsystem[i]);
    }
}

pm_flux pm_local_subsystems_show(const pm_local_subsystems *l, int remote, double *y, double *e,
                                 double *eta, double *response, int64_t *known) {
    if (l->batch != NULL) {
        return pm_batch_show(l->batch, remote, y, e, eta);
    }
    const pm_subsystem *s = l->subsystem[l->own[remote][0]];
    const int port = l->own[remote][1];
    const pm_port_values *values = pm_subsystem_values(s, port);
    const size_t size = (size_t)values->ny * sizeof *y;
    memcpy(y, values->y, size);
    memcpy(e, values->e, size);
    memcpy(eta, values->eta, size);
    if (values->response != NULL) {
        memcpy(response, values->response, size);
        *known = (int64_t)values->known;
    }
    return pm_subsystem_books(s).flux[port];
}

void pm_local_subsystems_bulk(pm_local_subsystems *l) {
    if (l->batch != NULL) {
        pm_batch_bulk(l->batch);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        pm_subsystem_bulk(l->subsystem[i]);
    }
}

void pm_local_subsystems_hear(pm_local_subsystems *l, int remote, const pm_port_values *values) {
    if (l->batch != NULL) {
        pm_batch_hear(l->batch, remote, values);
    } else {
        l->heard[remote] = *values;
    }
}

static void couple_ports(pm_local_subsystems *l, int i) {
    pm_subsystem *s = l->subsystem[i];
    for (int k = 0; k < pm_subsystem_nport(s); ++k) {
        const peer *p = &l->peer[i][k];
        const pm_port_values *values =
            p->kind == PEER_HERE     ? pm_subsystem_values(l->subsystem[p->subsystem], p->port)
            : p->kind == PEER_REMOTE ? &l->heard[p->remote]
                                     : NULL;
        pm_subsystem_couple(s, k, values);
    }
}

void pm_local_subsystems_couple(pm_local_subsystems *l) {
    if (l->batch != NULL) {
        pm_batch_couple(l->batch);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        couple_ports(l, i);
    }
}

void pm_local_subsystems_advance(pm_local_subsystems *l) {
    if (l->batch != NULL) {
        pm_batch_advance(l->batch);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        pm_subsystem_advance(l->subsystem[i]);
    }
}

pm_status pm_local_subsystems_end_step(pm_local_subsystems *l) {
    if (l->batch != NULL) {
        return pm_batch_end_step(l->batch);
    }
    for (int i = 0; i < l->count; ++i) {
        PM_TRY(pm_subsystem_end_step(l->subsystem[i]));
    }
    return PM_OK;
}

// --- results ---

pm_books pm_local_subsystems_books(const pm_local_subsystems *l, int i) {
    return l->batch != NULL ? pm_batch_books(l->batch, i) : pm_subsystem_books(l->subsystem[i]);
}

void pm_local_subsystems_state(const pm_local_subsystems *l, int i, double *z) {
    if (l->batch != NULL) {
        pm_batch_state(l->batch, i, z);
        return;
    }
    const int nz = l->system->scene->subsystem[l->id[i]].layout.nz;
    memcpy(z, pm_subsystem_state(l->subsystem[i]), (size_t)nz * sizeof *z);
}

void pm_local_subsystems_fill_sample(const pm_local_subsystems *l, pm_sample *sample) {
    if (l->batch != NULL) {
        pm_batch_fill_sample(l->batch, sample);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        pm_subsystem_fill_sample(l->subsystem[i], sample);
    }
}

void pm_local_subsystems_fill_first(const pm_local_subsystems *l, int count, pm_sample *sample) {
    const pm_scene *scene = l->system->scene;
    for (int i = 0; i < count && i < l->count; ++i) {
        const int id = l->id[i];
        const pm_books books = pm_local_subsystems_books(l, i);
        pm_sample_set_books(sample, id, &books);
        for (int k = 0; k < scene->first_end[id + 1] - scene->first_end[id]; ++k) {
            const int end_at = scene->end_at[scene->first_end[id] + k];
            sample->flux[end_at / 2][end_at % 2] = books.flux[k];
        }
        pm_local_subsystems_state(l, i, sample->z + scene->subsystem[id].first);
    }
}

// Adds a subsystem that is stepped alone, and its ports to later ones.
static void tally_one(const pm_local_subsystems *l, int i, pm_tally *tally) {
    const pm_system *system = l->system;
    const pm_subsystem *s = l->subsystem[i];
    pm_books books = pm_subsystem_books(s);
    const pm_lane_flux bulk = pm_lane_flux_of(&books.bulk);
    pm_tally_add_content(tally, 1, &books.energy, &books.entropy);
    pm_tally_add_fluxes(tally, pm_tally_form_of_subsystem(system, l->id[i]), 1,
                        system->scene->nport + l->id[i], NULL, &bulk, NULL);
    pm_tally_add_counts(tally, l->id[i], books.evaluated, books.skipped, books.outside);
    for (int k = 0; k < pm_subsystem_nport(s); ++k) {
        const peer *p = &l->peer[i][k];
        if (p->kind == PEER_HERE && p->subsystem > i) {
            const int port = pm_subsystem_port_id(s, k), end = (int)pm_subsystem_end(s, k);
            pm_flux flux[2];
            flux[end] = books.flux[k];
            flux[1 - end] = pm_subsystem_books(l->subsystem[p->subsystem]).flux[p->port];
            const pm_lane_flux a = pm_lane_flux_of(&flux[0]), b = pm_lane_flux_of(&flux[1]);
            pm_tally_add_fluxes(tally, pm_tally_form_of_port(system, port), 1, port, NULL, &a, &b);
        }
    }
}

void pm_local_subsystems_tally(const pm_local_subsystems *l, pm_tally *tally) {
    if (l->batch != NULL) {
        pm_batch_tally(l->batch, tally);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        tally_one(l, i, tally);
    }
}

void pm_local_subsystems_record(pm_local_subsystems *l, pm_record *record) {
    if (l->batch != NULL) {
        pm_batch_record(l->batch, record);
        return;
    }
    for (int i = 0; i < l->count; ++i) {
        pm_subsystem_record(l->subsystem[i], record);
    }
}
