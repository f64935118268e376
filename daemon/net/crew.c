// Rounds of several subsystems at once. Every one exposes before any couples, and couples before
// any advances.
#include "net/crew.h"

#include <string.h>

#include "store/channel.h"

static pm_status no_memory(const pm_scene *scene, int process_id) {
    return pm_fail(PM_ENOMEM, "%s: out of memory", scene->process[process_id].name);
}

// --- opening ---

// The link to a process, made when it is first asked for.
static pm_status find_link(pm_crew *crew, pm_arena *arena, const pm_scene *scene, int process_id,
                           int *link) {
    for (*link = 0; *link < crew->nlink; ++*link) {
        if (crew->link[*link].process_id == process_id) {
            return PM_OK;
        }
    }
    return pm_flux_link_init(&crew->link[crew->nlink++], arena, scene, process_id);
}

static int position_of(const pm_scene_process *process, int subsystem_id) {
    int i = 0;
    while (process->subsystem[i] != subsystem_id) {
        ++i;
    }
    return i;
}

// Which of a subsystem's ports, in the scene's order, an end is.
static int port_position(const pm_subsystem *subsystem, int port_id) {
    int i = 0;
    while (pm_subsystem_port_id(subsystem, i) != port_id) {
        ++i;
    }
    return i;
}

static pm_status open_port(pm_crew *crew, pm_arena *arena, const pm_scene *scene, int process_id,
                           const pm_subsystem *subsystem, int position, pm_crew_port *port) {
    const int port_id = pm_subsystem_port_id(subsystem, position);
    const pm_end own = pm_subsystem_end(subsystem, position);
    const pm_end other = own == PM_END_A ? PM_END_B : PM_END_A;
    const int neighbour = scene->port[port_id].subsystem[other];
    port->load = pm_subsystem_is_load(subsystem, position);
    if (port->load) {
        return PM_OK;
    }
    if (!pm_scene_joins_processes(scene, &scene->port[port_id])) {
        port->peer = position_of(&scene->process[process_id], neighbour);
        port->peer_port = port_position(crew->part[port->peer].subsystem, port_id);
        return PM_OK;
    }
    port->peer = -1;
    port->first = pm_flux_first(scene, port_id, other);
    port->ny = scene->port[port_id].layout[other].nz;
    return find_link(crew, arena, scene, scene->subsystem[neighbour].process, &port->link);
}

// What two subsystems of this crew would both evaluate, the first one does.
static pm_status share_port(const pm_crew *crew, int part_id, int position) {
    const pm_crew_part *part = &crew->part[part_id];
    const pm_crew_port *port = &part->port[position];
    if (port->load || port->peer <= part_id) {
        return PM_OK;
    }
    return pm_subsystem_share(part->subsystem, position, crew->part[port->peer].subsystem,
                              port->peer_port);
}

static pm_status open_part(pm_crew_part *part, pm_arena *arena, const pm_system *system,
                           int subsystem_id, const double *z, const pm_load *load) {
    PM_TRY(pm_subsystem_open(&part->subsystem, system, subsystem_id));
    pm_subsystem_set_load(part->subsystem, load);
    if (z != NULL) {
        pm_subsystem_set_state(part->subsystem, z + system->scene->subsystem[subsystem_id].first);
    }
    part->nport = pm_subsystem_nport(part->subsystem);
    part->port = pm_arena_array(arena, (size_t)part->nport, sizeof *part->port);
    return part->port == NULL
               ? no_memory(system->scene, system->scene->subsystem[subsystem_id].process)
               : PM_OK;
}

pm_status pm_crew_init(pm_crew *crew, pm_arena *arena, const pm_system *system, int process_id,
                       const double *z, const pm_load *load, int depth) {
    const pm_scene *scene = system->scene;
    const pm_scene_process *process = &scene->process[process_id];
    crew->part = pm_arena_array(arena, (size_t)process->count, sizeof *crew->part);
    crew->link = pm_arena_array(arena, (size_t)scene->nprocess, sizeof *crew->link);
    if (crew->part == NULL || crew->link == NULL) {
        return no_memory(scene, process_id);
    }
    for (int i = 0; i < process->count; ++i) {
        crew->count = i + 1;
        PM_TRY(open_part(&crew->part[i], arena, system, process->subsystem[i], z, load));
    }
    for (int i = 0; i < crew->count; ++i) {
        const pm_crew_part *part = &crew->part[i];
        for (int k = 0; k < part->nport; ++k) {
            PM_TRY(open_port(crew, arena, scene, process_id, part->subsystem, k, &part->port[k]));
            PM_TRY(share_port(crew, i, k));
        }
    }
    PM_TRY(pm_flux_make(&crew->shown, arena, scene, process_id));
    PM_TRY(pm_channel_process(crew->sent.channel, scene, "FLUX", process_id));
    return pm_outbox_init(&crew->sent, arena, depth, pm_flux_size(&crew->shown));
}

void pm_crew_free(pm_crew *crew) {
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_close(crew->part[i].subsystem);
    }
}

// --- a round ---

// Gathers what leaves this process: same order as pm_flux_first's.
static void gather_shown(pm_crew *crew) {
    portmet_flux_t *shown = &crew->shown;
    int end = 0, first = 0;
    for (int i = 0; i < crew->count; ++i) {
        const pm_crew_part *part = &crew->part[i];
        const pm_books books = pm_subsystem_books(part->subsystem);
        for (int k = 0; k < part->nport; ++k) {
            if (part->port[k].load || part->port[k].peer >= 0) {
                continue;
            }
            const pm_port_values *values = pm_subsystem_values(part->subsystem, k);
            const size_t size = (size_t)values->ny * sizeof(double);
            shown->energy_flux[end] = books.flux[k].energy;
            shown->entropy_flux[end] = books.flux[k].entropy;
            memcpy(shown->y + first, values->y, size);
            memcpy(shown->e + first, values->e, size);
            memcpy(shown->eta + first, values->eta, size);
            if (values->response != NULL) {
                memcpy(shown->response + first, values->response, size);
            }
            end += 1;
            first += values->ny;
        }
    }
}

static pm_status send_shown(pm_crew *crew, pm_transport *transport, int64_t key,
                            const portmet_flux_t *head) {
    portmet_flux_t *shown = &crew->shown;
    gather_shown(crew);
    shown->session = head->session;
    shown->step = head->step;
    shown->round = head->round;
    shown->time = head->time;
    unsigned char *data = pm_outbox_data(&crew->sent, key);
    const size_t size = pm_flux_encode(shown, data, crew->sent.capacity);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC, "channel %s: not finite in round %d of step %lld",
                       crew->sent.channel, head->round, (long long)head->step);
    }
    return pm_outbox_publish(&crew->sent, transport, key, size);
}

pm_status pm_crew_start_round(pm_crew *crew, pm_transport *transport, int64_t key,
                              const portmet_flux_t *head) {
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_expose(crew->part[i].subsystem);
    }
    if (crew->nlink > 0) {
        PM_TRY(send_shown(crew, transport, key, head));
    }
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_bulk(crew->part[i].subsystem);
    }
    crew->part_id = crew->port_id = 0;
    return PM_OK;
}

bool pm_crew_couple(pm_crew *crew, int64_t key, bool *used) {
    *used = false;
    for (; crew->part_id < crew->count; ++crew->part_id, crew->port_id = 0) {
        const pm_crew_part *part = &crew->part[crew->part_id];
        for (; crew->port_id < part->nport; ++crew->port_id) {
            const pm_crew_port *port = &part->port[crew->port_id];
            if (port->load) {
                pm_subsystem_couple(part->subsystem, crew->port_id, NULL);
                continue;
            }
            if (port->peer >= 0) {
                const pm_subsystem *peer = crew->part[port->peer].subsystem;
                pm_subsystem_couple(part->subsystem, crew->port_id,
                                    pm_subsystem_values(peer, port->peer_port));
                continue;
            }
            const pm_flux_link *link = &crew->link[port->link];
            const portmet_flux_t *flux = pm_flux_link_take(link, key);
            if (flux == NULL) {
                return false;
            }
            const int first = port->first;
            const pm_port_values values = {port->ny, flux->y + first, flux->e + first,
                                           flux->eta + first,
                                           flux->nresponse > 0 ? flux->response + first : NULL};
            pm_subsystem_couple(part->subsystem, crew->port_id, &values);
            *used = true;
        }
    }
    return true;
}

const pm_flux_link *pm_crew_misses(const pm_crew *crew, int64_t key) {
    for (int i = 0; i < crew->nlink; ++i) {
        if (pm_flux_link_take(&crew->link[i], key) == NULL) {
            return &crew->link[i];
        }
    }
    return NULL;
}

void pm_crew_advance(pm_crew *crew) {
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_advance(crew->part[i].subsystem);
    }
}

pm_status pm_crew_end_step(pm_crew *crew) {
    for (int i = 0; i < crew->count; ++i) {
        PM_TRY(pm_subsystem_end_step(crew->part[i].subsystem));
    }
    return PM_OK;
}

void pm_crew_set_substeps(pm_crew *crew, int substeps) {
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_set_substeps(crew->part[i].subsystem, substeps);
    }
}

int pm_crew_rounds(const pm_crew *crew) {
    return pm_subsystem_rounds(crew->part[0].subsystem);
}

// --- memory ---

int pm_crew_memory(const pm_crew *crew) {
    int count = 0;
    for (int i = 0; i < crew->count; ++i) {
        count += pm_subsystem_memory(crew->part[i].subsystem);
    }
    return count;
}

void pm_crew_save(const pm_crew *crew, double *memory) {
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_save(crew->part[i].subsystem, memory);
        memory += pm_subsystem_memory(crew->part[i].subsystem);
    }
}

void pm_crew_restore(pm_crew *crew, const double *memory) {
    for (int i = 0; i < crew->count; ++i) {
        pm_subsystem_restore(crew->part[i].subsystem, memory);
        memory += pm_subsystem_memory(crew->part[i].subsystem);
    }
}
