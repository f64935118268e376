// The rounds of a process: what the subsystems show at their remote ends is packed into one flux
// message, and what the neighbours' messages show there is unpacked, end by end.
#include "lockstep/process_subsystems.h"

#include <string.h>

#include "transport/channel.h"

static pm_status no_memory(const pm_scene *scene, int process_id) {
    return pm_fail(PM_ENOMEM, "%s: out of memory", scene->process[process_id].name);
}

// --- opening ---

// Returns the process at the other side of a remote end.
static int process_beyond(const pm_scene *scene, pm_remote_end end) {
    const int id = scene->port[end.port_id].subsystem[1 - (int)end.end];
    return scene->subsystem[id].process;
}

// Makes a link to each neighbouring process, in the order of the first remote ends. link_of
// [nprocess] receives the position of each link, plus one.
static pm_status open_links(pm_process_subsystems *s, pm_arena *arena, const pm_scene *scene,
                            int *link_of) {
    const int nremote = pm_local_subsystems_nremote(s->local);
    int *beyond[2] = {NULL, NULL}; // of each link: the process, and the number of its remote ends
    for (int i = 0; i < 2; ++i) {
        beyond[i] = pm_arena_array(arena, (size_t)scene->nprocess, sizeof(int));
    }
    if (beyond[0] == NULL || beyond[1] == NULL) {
        return pm_fail(PM_ENOMEM, "flux links: out of memory");
    }
    for (int i = 0; i < nremote; ++i) {
        const int process_id = process_beyond(scene, pm_local_subsystems_remote(s->local, i));
        if (link_of[process_id] == 0) {
            beyond[0][s->nlink] = process_id;
            link_of[process_id] = ++s->nlink;
        }
        ++beyond[1][link_of[process_id] - 1];
    }
    s->link = pm_arena_array(arena, (size_t)s->nlink, sizeof *s->link);
    s->neighbour = pm_arena_array(arena, (size_t)s->nlink, sizeof *s->neighbour);
    if (s->link == NULL || s->neighbour == NULL) {
        return pm_fail(PM_ENOMEM, "flux links: out of memory");
    }
    for (int i = 0; i < s->nlink; ++i) {
        PM_TRY(pm_flux_link_init(&s->link[i], arena, scene, beyond[0][i]));
        s->neighbour[i].remote =
            pm_arena_array(arena, (size_t)beyond[1][i], sizeof *s->neighbour[i].remote);
        if (s->neighbour[i].remote == NULL) {
            return pm_fail(PM_ENOMEM, "flux links: out of memory");
        }
    }
    return PM_OK;
}

// Notes where the messages of one neighbour have the other sides of remote ends here. `remote_at`
// [2 nport] has the remote end at each end of a port, plus one.
static void find_remote(pm_process_neighbour *n, const pm_scene *scene, int process_id,
                        const int *remote_at) {
    pm_flux_place place = pm_flux_place_begin(scene, process_id);
    while (pm_flux_place_next(&place)) {
        const int remote = remote_at[place.end_at ^ 1] - 1;
        if (remote >= 0) {
            n->remote[n->count++] =
                (pm_process_remote){remote, place.first, place.ny, place.position};
        }
    }
}

static pm_status find_all_remote(pm_process_subsystems *s, pm_arena *arena, const pm_scene *scene,
                                 int process_id) {
    const int nremote = pm_local_subsystems_nremote(s->local);
    pm_arena scratch = {0};
    int *remote_at = pm_arena_array(&scratch, 2 * (size_t)scene->nport, sizeof *remote_at);
    int *link_of = pm_arena_array(&scratch, (size_t)scene->nprocess, sizeof *link_of);
    s->ny = pm_arena_array(arena, (size_t)nremote, sizeof *s->ny);
    pm_status status = PM_OK;
    if (remote_at == NULL || link_of == NULL || s->ny == NULL) {
        status = no_memory(scene, process_id);
        goto done;
    }
    for (int i = 0; i < nremote; ++i) {
        const pm_remote_end end = pm_local_subsystems_remote(s->local, i);
        remote_at[2 * end.port_id + (int)end.end] = i + 1;
        s->ny[i] = scene->port[end.port_id].layout[end.end].nz;
    }
    PM_TRY_DONE(open_links(s, arena, scene, link_of));
    for (int i = 0; i < s->nlink; ++i) {
        find_remote(&s->neighbour[i], scene, s->link[i].process_id, remote_at);
    }
done:
    pm_arena_free(&scratch);
    return status;
}

pm_status pm_process_subsystems_init(pm_process_subsystems *subsystems, pm_arena *arena,
                                     const pm_system *system, int process_id, const double *z,
                                     const pm_boundary_input *boundary_input, int depth) {
    const pm_scene *scene = system->scene;
    const pm_scene_process *process = &scene->process[process_id];
    subsystems->count = process->count;
    PM_TRY(
        pm_local_subsystems_open(&subsystems->local, system, process->count, process->subsystem));
    pm_local_subsystems_set_boundary_input(subsystems->local, boundary_input);
    if (z != NULL) {
        pm_local_subsystems_set_state(subsystems->local, z);
    }
    PM_TRY(find_all_remote(subsystems, arena, scene, process_id));
    PM_TRY(pm_flux_message_alloc(&subsystems->flux, arena, scene, process_id));
    PM_TRY(pm_channel_process(subsystems->sent.channel, scene, "FLUX", process_id));
    return pm_resend_buffer_init(&subsystems->sent, arena, depth, pm_flux_size(&subsystems->flux));
}

void pm_process_subsystems_free(pm_process_subsystems *subsystems) {
    pm_local_subsystems_close(subsystems->local);
}

// --- a round ---

// Fills the flux message with the remote ends in their order.
static void fill_flux(pm_process_subsystems *subsystems) {
    portmet_flux_t *flux = &subsystems->flux;
    for (int i = 0, first = 0; i < flux->nend; first += subsystems->ny[i++]) {
        const pm_flux through =
            pm_local_subsystems_show(subsystems->local, i, flux->y + first, flux->e + first,
                                     flux->eta + first, flux->response + first, flux->known + i);
        flux->energy_flux[i] = through.energy;
        flux->entropy_flux[i] = through.entropy;
    }
}

static pm_status publish_flux(pm_process_subsystems *subsystems, pm_transport *transport,
                              int64_t key, const portmet_flux_t *head) {
    portmet_flux_t *flux = &subsystems->flux;
    fill_flux(subsystems);
    flux->session = head->session;
    flux->step = head->step;
    flux->round = head->round;
    flux->time = head->time;
    unsigned char *data = pm_resend_buffer_data(&subsystems->sent);
    const size_t size = pm_flux_encode(flux, data, subsystems->sent.capacity);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC, "channel %s: not finite in round %d of step %lld",
                       subsystems->sent.channel, head->round, (long long)head->step);
    }
    return pm_resend_buffer_publish(&subsystems->sent, transport, key, size);
}

pm_status pm_process_subsystems_start_round(pm_process_subsystems *subsystems,
                                            pm_transport *transport, int64_t key,
                                            const portmet_flux_t *head) {
    pm_local_subsystems_expose(subsystems->local);
    if (subsystems->nlink > 0) {
        PM_TRY(publish_flux(subsystems, transport, key, head));
    }
    pm_local_subsystems_bulk(subsystems->local);
    for (int i = 0; i < subsystems->nlink; ++i) {
        subsystems->neighbour[i].heard = false;
    }
    return PM_OK;
}

// Hands over what a neighbour's message shows at the other sides of the remote ends.
static void unpack(pm_local_subsystems *local, const pm_process_neighbour *neighbour,
                   const portmet_flux_t *flux) {
    const bool iterates = flux->nknown > 0;
    for (int i = 0; i < neighbour->count; ++i) {
        const pm_process_remote *r = &neighbour->remote[i];
        const pm_port_values values = {
            r->ny,
            flux->y + r->first,
            flux->e + r->first,
            flux->eta + r->first,
            iterates ? flux->response + r->first : NULL,
            iterates ? (uint64_t)flux->known[r->end] : 0,
        };
        pm_local_subsystems_hear(local, r->remote, &values);
    }
}

bool pm_process_subsystems_couple(pm_process_subsystems *subsystems, int64_t key, bool *used) {
    bool all = true;
    *used = false;
    for (int i = 0; i < subsystems->nlink; ++i) {
        pm_process_neighbour *neighbour = &subsystems->neighbour[i];
        const portmet_flux_t *flux =
            neighbour->heard ? NULL : pm_flux_link_take(&subsystems->link[i], key);
        if (flux != NULL) {
            unpack(subsystems->local, neighbour, flux);
            neighbour->heard = *used = true;
        }
        all = all && neighbour->heard;
    }
    if (all) {
        pm_local_subsystems_couple(subsystems->local);
    }
    return all;
}

const pm_flux_link *pm_process_subsystems_missing(const pm_process_subsystems *subsystems,
                                                  int64_t key) {
    for (int i = 0; i < subsystems->nlink; ++i) {
        if (pm_flux_link_take(&subsystems->link[i], key) == NULL) {
            return &subsystems->link[i];
        }
    }
    return NULL;
}

pm_status pm_process_subsystems_end_round(pm_process_subsystems *subsystems, bool *complete) {
    pm_local_subsystems_advance(subsystems->local);
    *complete = pm_local_subsystems_completes_step(subsystems->local);
    return *complete ? pm_local_subsystems_end_step(subsystems->local) : PM_OK;
}
