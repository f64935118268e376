// The rounds of a process: what the subsystems show at their remote ends is packed into one flux
// message, and what the neighbours' messages show there is unpacked, end by end.
#include "lockstep/process_subsystems.h"

#include <string.h>

#include "scene/integrator.h"
#include "transport/channel.h"

// --- the places of ends in a message ---

// The place of one end of a port in the flux messages of its process. The ends are ordered by
// subsystem, then by port, as in the scene.
typedef struct flux_place {
    const pm_scene *scene; // borrowed
    int process_id;
    int end_at;          // 2 * position of the port in the scene + end
    int position;        // index of the end in the arrays energy_flux, entropy_flux and known
    int first, ny;       // first index and number of its components in y, e, eta and response
    int subsystem, next; // where to look for the next end: subsystem of the process, end of a port
} flux_place;

// Returns a place before the first end.
static flux_place begin_place(const pm_scene *scene, int process_id) {
    const pm_scene_process *process = &scene->network.process[process_id];
    return (flux_place){.scene = scene,
                        .process_id = process_id,
                        .position = -1,
                        .next = scene->physics.first_end[process->subsystem[0]]};
}

// Goes to the next end. Returns false if there is none; `position` and `first` are then the numbers
// of ends and of components.
static bool next_place(flux_place *p) {
    const pm_scene *scene = p->scene;
    const pm_scene_process *process = &scene->network.process[p->process_id];
    p->position += 1;
    p->first += p->ny;
    p->ny = 0;
    while (p->subsystem < process->count) {
        while (p->next < scene->physics.first_end[process->subsystem[p->subsystem] + 1]) {
            p->end_at = scene->physics.end_at[p->next++];
            const pm_scene_port *port = &scene->physics.port[p->end_at / 2];
            if (pm_port_crosses_processes(scene, port)) {
                p->ny = port->layout[p->end_at % 2].nz;
                return true;
            }
        }
        p->subsystem += 1;
        p->next = p->subsystem < process->count
                      ? scene->physics.first_end[process->subsystem[p->subsystem]]
                      : 0;
    }
    return false;
}

pm_status pm_flux_message_alloc(portmet_flux_t *flux, pm_arena *arena, const pm_scene *scene,
                                int process_id) {
    flux_place place = begin_place(scene, process_id);
    while (next_place(&place)) {
    }
    const int nend = place.position, ny = place.first;
    const pm_integrator *integrator = scene->physics.integrator;
    const int nresponse = integrator != NULL && pm_integrator_iterates(integrator) ? ny : 0;
    *flux = (portmet_flux_t){
        .nend = nend, .ny = ny, .nresponse = nresponse, .nknown = nresponse > 0 ? nend : 0};
    return pm_flux_alloc(flux, arena);
}

// --- the fluxes of a neighbour ---

static int find_slot(const pm_flux_link *link, int64_t key) {
    int slot = 0;
    while (slot < PM_INBOX_DEPTH && link->inbox_key[slot] != key) {
        ++slot;
    }
    return slot;
}

pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present, int64_t next_step) {
    int slot = find_slot(link, key);
    if (slot < PM_INBOX_DEPTH) {
        // Another message of the round must expose the same bits. The fluxes are not compared: they
        // are those of the step before, which a process that has returned does not know.
        const portmet_flux_t *a = &link->inbox[slot], *b = &link->scratch;
        const size_t size = (size_t)a->ny * sizeof(double);
        const bool same =
            memcmp(a->y, b->y, size) == 0 && memcmp(a->e, b->e, size) == 0 &&
            memcmp(a->eta, b->eta, size) == 0 &&
            memcmp(a->response, b->response, (size_t)a->nresponse * sizeof(double)) == 0 &&
            memcmp(a->known, b->known, (size_t)a->nknown * sizeof *a->known) == 0;
        return same ? PM_DROP_REPEATED : PM_DROP_CONFLICT;
    }
    if (key < present) {
        return PM_DROP_REPEATED;
    }
    if (key > present + 1 && key != next_step) {
        return PM_DROP_RANGE;
    }
    // A message of the present round stays, and so does one that is ahead, as long as it is not the
    // same neighbour's next one that comes.
    const int64_t *kept = link->inbox_key;
    if (key != present && (kept[0] == present || kept[1] == present)) {
        slot = kept[0] == present ? 1 : 0;
    } else {
        slot = kept[0] == present + 1 || kept[0] == next_step ? 1 : 0;
    }
    // The inbox takes the decoded arrays and leaves its own for the next message.
    const portmet_flux_t unused = link->inbox[slot];
    link->inbox[slot] = link->scratch;
    link->inbox_key[slot] = key;
    link->scratch = unused;
    return PM_KEEP;
}

// Returns the neighbour's message of the round with the key `key`; NULL if it has not arrived or is
// no longer kept. It is valid until a message of a later round takes its place.
static const portmet_flux_t *take(const pm_flux_link *link, int64_t key) {
    const int slot = find_slot(link, key);
    return slot < PM_INBOX_DEPTH ? &link->inbox[slot] : NULL;
}

// --- opening ---

// Makes a link to each neighbouring process, in the order of the first remote ends, and notes where
// its messages have the other sides of the remote ends here.
static pm_status open_links(pm_process_subsystems *s, pm_arena *arena, const pm_scene *scene) {
    const int nremote = pm_local_subsystems_nremote(s->local);
    pm_arena scratch = {0};
    pm_status status;
    // At each end of a port the remote end, plus one; for each process its link, plus one, and the
    // number of its remote ends.
    int *remote_at = pm_arena_array(&scratch, 2 * (size_t)scene->physics.nport, sizeof *remote_at);
    int *link_of = pm_arena_array(&scratch, (size_t)scene->network.nprocess, sizeof *link_of);
    int *count = pm_arena_array(&scratch, (size_t)scene->network.nprocess, sizeof *count);
    s->ny = pm_arena_array(arena, (size_t)nremote, sizeof *s->ny);
    const int most = nremote < scene->network.nprocess ? nremote : scene->network.nprocess;
    s->link = pm_arena_array(arena, (size_t)most, sizeof *s->link);
    PM_TRY_DONE(pm_arena_status(&scratch, "flux links"));
    PM_TRY_DONE(pm_arena_status(arena, "flux links"));
    for (int i = 0; i < nremote; ++i) {
        const pm_remote_end end = pm_local_subsystems_remote(s->local, i);
        const pm_scene_port *port = &scene->physics.port[end.port_id];
        const int beyond = scene->physics.subsystem[port->subsystem[1 - (int)end.end]].process;
        remote_at[2 * end.port_id + (int)end.end] = i + 1;
        s->ny[i] = port->layout[end.end].nz;
        if (link_of[beyond] == 0) {
            s->link[s->nlink].process_id = beyond;
            link_of[beyond] = ++s->nlink;
        }
        ++count[beyond];
    }
    for (int i = 0; i < s->nlink; ++i) {
        pm_flux_link *link = &s->link[i];
        const int process_id = link->process_id;
        link->neighbour = scene->network.process[process_id].name;
        PM_TRY_DONE(pm_channel_process(link->channel, scene, "FLUX", process_id));
        PM_TRY_DONE(pm_channel_request(link->address, scene, link->neighbour));
        PM_TRY_DONE(pm_flux_message_alloc(&link->scratch, arena, scene, process_id));
        for (int k = 0; k < PM_INBOX_DEPTH; ++k) {
            PM_TRY_DONE(pm_flux_message_alloc(&link->inbox[k], arena, scene, process_id));
            link->inbox_key[k] = -1;
        }
        link->remote = pm_arena_array(arena, (size_t)count[process_id], sizeof *link->remote);
        PM_TRY_DONE(pm_arena_status(arena, "flux links"));
        flux_place place = begin_place(scene, process_id);
        while (next_place(&place)) {
            const int remote = remote_at[place.end_at ^ 1] - 1;
            if (remote >= 0) {
                link->remote[link->count++] =
                    (pm_process_remote){remote, place.first, place.ny, place.position};
            }
        }
    }
done:
    pm_arena_free(&scratch);
    return status;
}

pm_status pm_process_subsystems_init(pm_process_subsystems *subsystems, pm_arena *arena,
                                     const pm_system *system, int process_id, const double *z,
                                     const pm_boundary_input *boundary_input, int depth) {
    const pm_scene *scene = system->scene;
    const pm_scene_process *process = &scene->network.process[process_id];
    subsystems->count = process->count;
    PM_TRY(
        pm_local_subsystems_open(&subsystems->local, system, process->count, process->subsystem));
    pm_local_subsystems_set_boundary_input(subsystems->local, boundary_input);
    if (z != NULL) {
        pm_local_subsystems_set_state(subsystems->local, z);
    }
    PM_TRY(open_links(subsystems, arena, scene));
    PM_TRY(pm_flux_message_alloc(&subsystems->flux, arena, scene, process_id));
    PM_TRY(pm_channel_process(subsystems->sent.channel, scene, "FLUX", process_id));
    return pm_resend_buffer_init(&subsystems->sent, arena, depth, pm_flux_size(&subsystems->flux));
}

void pm_process_subsystems_free(pm_process_subsystems *subsystems) {
    pm_local_subsystems_close(subsystems->local);
}

// --- a round ---

pm_status pm_process_subsystems_start_round(pm_process_subsystems *subsystems,
                                            pm_transport *transport, int64_t key,
                                            const portmet_flux_t *head) {
    portmet_flux_t *flux = &subsystems->flux;
    for (int i = 0, first = 0; i < flux->nend; first += subsystems->ny[i++]) {
        const pm_flux through = pm_local_subsystems_get_boundary(
            subsystems->local, i, flux->y + first, flux->e + first, flux->eta + first,
            flux->response + first, flux->known + i);
        flux->energy_flux[i] = through.energy;
        flux->entropy_flux[i] = through.entropy;
    }
    if (subsystems->nlink > 0) {
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
        PM_TRY(pm_resend_buffer_publish(&subsystems->sent, transport, key, size));
    }
    pm_local_subsystems_bulk(subsystems->local);
    for (int i = 0; i < subsystems->nlink; ++i) {
        subsystems->link[i].heard = false;
    }
    return PM_OK;
}

bool pm_process_subsystems_couple(pm_process_subsystems *subsystems, int64_t key, bool *used) {
    bool all = true;
    *used = false;
    for (int i = 0; i < subsystems->nlink; ++i) {
        pm_flux_link *link = &subsystems->link[i];
        const portmet_flux_t *flux = link->heard ? NULL : take(link, key);
        for (int k = 0; k < link->count && flux != NULL; ++k) {
            const pm_process_remote *r = &link->remote[k];
            const bool iterates = flux->nknown > 0;
            const pm_port_values values = {
                r->ny,
                flux->y + r->first,
                flux->e + r->first,
                flux->eta + r->first,
                iterates ? flux->response + r->first : NULL,
                iterates ? (uint64_t)flux->known[r->end] : 0,
            };
            pm_local_subsystems_set_boundary(subsystems->local, r->remote, &values);
        }
        *used = *used || flux != NULL;
        link->heard = link->heard || flux != NULL;
        all = all && link->heard;
    }
    if (all) {
        pm_local_subsystems_couple(subsystems->local);
    }
    return all;
}

const pm_flux_link *pm_process_subsystems_missing(const pm_process_subsystems *subsystems,
                                                  int64_t key) {
    for (int i = 0; i < subsystems->nlink; ++i) {
        if (take(&subsystems->link[i], key) == NULL) {
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
