// The rounds of all subsystems of a process: every one exposes before any is coupled, and all are
// coupled before any advances.
#include "lockstep/process_subsystems.h"

#include <string.h>

#include "transport/channel.h"

static pm_status no_memory(const pm_scene *scene, int process_id) {
    return pm_fail(PM_ENOMEM, "%s: out of memory", scene->process[process_id].name);
}

// --- opening ---

// Finds the link to a process, or makes it; `link` receives its position.
static pm_status find_link(pm_process_subsystems *subsystems, pm_arena *arena,
                           const pm_scene *scene, int process_id, int *link) {
    for (*link = 0; *link < subsystems->nlink; ++*link) {
        if (subsystems->link[*link].process_id == process_id) {
            return PM_OK;
        }
    }
    return pm_flux_link_init(&subsystems->link[subsystems->nlink++], arena, scene, process_id);
}

static int position_of(const pm_scene_process *process, int subsystem_id) {
    int i = 0;
    while (process->subsystem[i] != subsystem_id) {
        ++i;
    }
    return i;
}

// Returns the index of a port among the ports of a subsystem, in the scene's order.
static int port_position(const pm_subsystem *subsystem, int port_id) {
    int i = 0;
    while (pm_subsystem_port_id(subsystem, i) != port_id) {
        ++i;
    }
    return i;
}

static pm_status open_port(pm_process_subsystems *subsystems, pm_arena *arena,
                           const pm_scene *scene, int process_id, const pm_subsystem *subsystem,
                           int position, pm_process_port *port) {
    const int port_id = pm_subsystem_port_id(subsystem, position);
    const pm_end own = pm_subsystem_end(subsystem, position);
    const pm_end other = own == PM_END_A ? PM_END_B : PM_END_A;
    const int neighbour = scene->port[port_id].subsystem[other];
    port->boundary_input = pm_subsystem_has_boundary_input(subsystem, position);
    if (port->boundary_input) {
        return PM_OK;
    }
    if (!pm_scene_joins_processes(scene, &scene->port[port_id])) {
        port->peer = position_of(&scene->process[process_id], neighbour);
        port->peer_port = port_position(subsystems->part[port->peer].subsystem, port_id);
        return PM_OK;
    }
    port->peer = -1;
    port->first = pm_flux_message_offset(scene, port_id, other, &port->end);
    port->ny = scene->port[port_id].layout[other].nz;
    return find_link(subsystems, arena, scene, scene->subsystem[neighbour].process, &port->link);
}

// Lets the first of two subsystems of this process evaluate the port between them for both.
static pm_status share_port(const pm_process_subsystems *subsystems, int part_id, int position) {
    const pm_process_subsystem *part = &subsystems->part[part_id];
    const pm_process_port *port = &part->port[position];
    if (port->boundary_input || port->peer <= part_id) {
        return PM_OK;
    }
    return pm_subsystem_share(part->subsystem, position, subsystems->part[port->peer].subsystem,
                              port->peer_port);
}

static pm_status open_part(pm_process_subsystem *part, pm_arena *arena, const pm_system *system,
                           int subsystem_id, const double *z,
                           const pm_boundary_input *boundary_input) {
    PM_TRY(pm_subsystem_open(&part->subsystem, system, subsystem_id));
    pm_subsystem_set_boundary_input(part->subsystem, boundary_input);
    if (z != NULL) {
        pm_subsystem_set_state(part->subsystem, z + system->scene->subsystem[subsystem_id].first);
    }
    part->nport = pm_subsystem_nport(part->subsystem);
    part->port = pm_arena_array(arena, (size_t)part->nport, sizeof *part->port);
    return part->port == NULL
               ? no_memory(system->scene, system->scene->subsystem[subsystem_id].process)
               : PM_OK;
}

pm_status pm_process_subsystems_init(pm_process_subsystems *subsystems, pm_arena *arena,
                                     const pm_system *system, int process_id, const double *z,
                                     const pm_boundary_input *boundary_input, int depth) {
    const pm_scene *scene = system->scene;
    const pm_scene_process *process = &scene->process[process_id];
    subsystems->part = pm_arena_array(arena, (size_t)process->count, sizeof *subsystems->part);
    subsystems->link = pm_arena_array(arena, (size_t)scene->nprocess, sizeof *subsystems->link);
    if (subsystems->part == NULL || subsystems->link == NULL) {
        return no_memory(scene, process_id);
    }
    for (int i = 0; i < process->count; ++i) {
        subsystems->count = i + 1;
        PM_TRY(open_part(&subsystems->part[i], arena, system, process->subsystem[i], z,
                         boundary_input));
    }
    for (int i = 0; i < subsystems->count; ++i) {
        const pm_process_subsystem *part = &subsystems->part[i];
        for (int k = 0; k < part->nport; ++k) {
            PM_TRY(open_port(subsystems, arena, scene, process_id, part->subsystem, k,
                             &part->port[k]));
            PM_TRY(share_port(subsystems, i, k));
        }
    }
    PM_TRY(pm_flux_message_alloc(&subsystems->flux, arena, scene, process_id));
    PM_TRY(pm_channel_process(subsystems->sent.channel, scene, "FLUX", process_id));
    return pm_resend_buffer_init(&subsystems->sent, arena, depth, pm_flux_size(&subsystems->flux));
}

void pm_process_subsystems_free(pm_process_subsystems *subsystems) {
    for (int i = 0; i < subsystems->count; ++i) {
        pm_subsystem_close(subsystems->part[i].subsystem);
    }
}

// --- a round ---

// Fills the flux message, with the ends in the order of pm_flux_message_offset.
static void fill_flux(pm_process_subsystems *subsystems) {
    portmet_flux_t *flux = &subsystems->flux;
    int end = 0, first = 0;
    for (int i = 0; i < subsystems->count; ++i) {
        const pm_process_subsystem *part = &subsystems->part[i];
        const pm_books books = pm_subsystem_books(part->subsystem);
        for (int k = 0; k < part->nport; ++k) {
            if (part->port[k].boundary_input || part->port[k].peer >= 0) {
                continue;
            }
            const pm_port_values *values = pm_subsystem_values(part->subsystem, k);
            const size_t size = (size_t)values->ny * sizeof(double);
            flux->energy_flux[end] = books.flux[k].energy;
            flux->entropy_flux[end] = books.flux[k].entropy;
            memcpy(flux->y + first, values->y, size);
            memcpy(flux->e + first, values->e, size);
            memcpy(flux->eta + first, values->eta, size);
            if (values->response != NULL) {
                memcpy(flux->response + first, values->response, size);
                flux->known[end] = (int64_t)values->known;
            }
            end += 1;
            first += values->ny;
        }
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
    for (int i = 0; i < subsystems->count; ++i) {
        pm_subsystem_expose(subsystems->part[i].subsystem);
    }
    if (subsystems->nlink > 0) {
        PM_TRY(publish_flux(subsystems, transport, key, head));
    }
    for (int i = 0; i < subsystems->count; ++i) {
        pm_subsystem_bulk(subsystems->part[i].subsystem);
    }
    subsystems->part_id = subsystems->port_id = 0;
    return PM_OK;
}

bool pm_process_subsystems_couple(pm_process_subsystems *subsystems, int64_t key, bool *used) {
    *used = false;
    for (; subsystems->part_id < subsystems->count;
         ++subsystems->part_id, subsystems->port_id = 0) {
        const pm_process_subsystem *part = &subsystems->part[subsystems->part_id];
        for (; subsystems->port_id < part->nport; ++subsystems->port_id) {
            const pm_process_port *port = &part->port[subsystems->port_id];
            if (port->boundary_input) {
                pm_subsystem_couple(part->subsystem, subsystems->port_id, NULL);
                continue;
            }
            if (port->peer >= 0) {
                const pm_subsystem *peer = subsystems->part[port->peer].subsystem;
                pm_subsystem_couple(part->subsystem, subsystems->port_id,
                                    pm_subsystem_values(peer, port->peer_port));
                continue;
            }
            const pm_flux_link *link = &subsystems->link[port->link];
            const portmet_flux_t *flux = pm_flux_link_take(link, key);
            if (flux == NULL) {
                return false;
            }
            const int first = port->first;
            const bool iterates = flux->nknown > 0;
            const pm_port_values values = {
                port->ny,
                flux->y + first,
                flux->e + first,
                flux->eta + first,
                iterates ? flux->response + first : NULL,
                iterates ? (uint64_t)flux->known[port->end] : 0,
            };
            pm_subsystem_couple(part->subsystem, subsystems->port_id, &values);
            *used = true;
        }
    }
    return true;
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

void pm_process_subsystems_advance(pm_process_subsystems *subsystems) {
    for (int i = 0; i < subsystems->count; ++i) {
        pm_subsystem_advance(subsystems->part[i].subsystem);
    }
}

pm_status pm_process_subsystems_end_step(pm_process_subsystems *subsystems) {
    for (int i = 0; i < subsystems->count; ++i) {
        PM_TRY(pm_subsystem_end_step(subsystems->part[i].subsystem));
    }
    return PM_OK;
}

void pm_process_subsystems_set_substeps(pm_process_subsystems *subsystems, int substeps) {
    for (int i = 0; i < subsystems->count; ++i) {
        pm_subsystem_set_substeps(subsystems->part[i].subsystem, substeps);
    }
}

bool pm_process_subsystems_complete_step(const pm_process_subsystems *subsystems) {
    return pm_subsystem_completes_step(subsystems->part[0].subsystem);
}

// --- checkpoints ---

void pm_process_subsystems_record(pm_process_subsystems *subsystems, pm_record *record) {
    for (int i = 0; i < subsystems->count; ++i) {
        pm_subsystem_record(subsystems->part[i].subsystem, record);
    }
}
