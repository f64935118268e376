// A neighbour's fluxes, and the positions of each port's components in them.
#include "lockstep/flux_link.h"

#include <string.h>

#include "scene/integrator.h"
#include "transport/channel.h"

pm_flux_place pm_flux_place_begin(const pm_scene *scene, int process_id) {
    const pm_scene_process *process = &scene->process[process_id];
    return (pm_flux_place){.scene = scene,
                           .process_id = process_id,
                           .position = -1,
                           .next = scene->first_end[process->subsystem[0]]};
}

bool pm_flux_place_next(pm_flux_place *p) {
    const pm_scene *scene = p->scene;
    const pm_scene_process *process = &scene->process[p->process_id];
    p->position += 1;
    p->first += p->ny;
    p->ny = 0;
    while (p->subsystem < process->count) {
        while (p->next < scene->first_end[process->subsystem[p->subsystem] + 1]) {
            p->end_at = scene->end_at[p->next++];
            const pm_scene_port *port = &scene->port[p->end_at / 2];
            if (pm_scene_joins_processes(scene, port)) {
                p->ny = port->layout[p->end_at % 2].nz;
                return true;
            }
        }
        p->subsystem += 1;
        p->next =
            p->subsystem < process->count ? scene->first_end[process->subsystem[p->subsystem]] : 0;
    }
    return false;
}

pm_status pm_flux_message_alloc(portmet_flux_t *flux, pm_arena *arena, const pm_scene *scene,
                                int process_id) {
    pm_flux_place place = pm_flux_place_begin(scene, process_id);
    while (pm_flux_place_next(&place)) {
    }
    const int nend = place.position, ny = place.first;
    const pm_integrator *integrator = scene->integrator;
    const int nresponse = integrator != NULL && integrator->discrete ? ny : 0;
    const int nknown = nresponse > 0 ? nend : 0;
    const size_t count = 2 * (size_t)nend + 3 * (size_t)ny + (size_t)nresponse;
    double *memory = pm_arena_array(arena, count, sizeof(double));
    int64_t *known = pm_arena_array(arena, (size_t)nknown, sizeof *known);
    if (memory == NULL || known == NULL) {
        return pm_fail(PM_ENOMEM, "flux of %zu numbers: out of memory", count);
    }
    *flux = (portmet_flux_t){.nend = nend,
                             .energy_flux = memory,
                             .entropy_flux = memory + nend,
                             .ny = ny,
                             .y = memory + 2 * nend,
                             .e = memory + 2 * nend + ny,
                             .eta = memory + 2 * nend + 2 * ny,
                             .nresponse = nresponse,
                             .response = memory + 2 * nend + 3 * ny,
                             .nknown = nknown,
                             .known = known};
    return PM_OK;
}

pm_status pm_flux_link_init(pm_flux_link *link, pm_arena *arena, const pm_scene *scene,
                            int process_id) {
    link->process_id = process_id;
    link->neighbour = scene->process[process_id].name;
    PM_TRY(pm_channel_process(link->channel, scene, "FLUX", process_id));
    PM_TRY(pm_channel_request(link->address, scene, link->neighbour));
    PM_TRY(pm_flux_message_alloc(&link->scratch, arena, scene, process_id));
    for (int i = 0; i < PM_INBOX_DEPTH; ++i) {
        PM_TRY(pm_flux_message_alloc(&link->inbox[i], arena, scene, process_id));
        link->inbox_key[i] = -1;
    }
    return PM_OK;
}

// True if two messages of a round expose the same bits. The fluxes are those of the step before,
// which a process that has returned does not know.
static bool is_same(const portmet_flux_t *a, const portmet_flux_t *b) {
    const size_t size = (size_t)a->ny * sizeof(double);
    return memcmp(a->y, b->y, size) == 0 && memcmp(a->e, b->e, size) == 0 &&
           memcmp(a->eta, b->eta, size) == 0 &&
           memcmp(a->response, b->response, (size_t)a->nresponse * sizeof(double)) == 0 &&
           memcmp(a->known, b->known, (size_t)a->nknown * sizeof *a->known) == 0;
}

static int find_slot(const pm_flux_link *link, int64_t key) {
    int slot = 0;
    while (slot < PM_INBOX_DEPTH && link->inbox_key[slot] != key) {
        ++slot;
    }
    return slot;
}

// Returns the slot for a message. One of the present round stays, and so does one that is ahead, as
// long as it is not the same neighbour's next one that comes.
static int choose_slot(const pm_flux_link *link, int64_t key, int64_t present, int64_t next_step) {
    const int64_t *kept = link->inbox_key;
    if (key != present && (kept[0] == present || kept[1] == present)) {
        return kept[0] == present ? 1 : 0;
    }
    return kept[0] == present + 1 || kept[0] == next_step ? 1 : 0;
}

pm_drop pm_flux_link_keep(pm_flux_link *link, int64_t key, int64_t present, int64_t next_step) {
    int slot = find_slot(link, key);
    if (slot < PM_INBOX_DEPTH) {
        return is_same(&link->inbox[slot], &link->scratch) ? PM_DROP_REPEATED : PM_DROP_CONFLICT;
    }
    if (key < present) {
        return PM_DROP_REPEATED;
    }
    if (key > present + 1 && key != next_step) {
        return PM_DROP_RANGE;
    }
    slot = choose_slot(link, key, present, next_step);
    // The inbox takes the decoded arrays and leaves its own for the next message.
    const portmet_flux_t unused = link->inbox[slot];
    link->inbox[slot] = link->scratch;
    link->inbox_key[slot] = key;
    link->scratch = unused;
    return PM_KEEP;
}

const portmet_flux_t *pm_flux_link_take(const pm_flux_link *link, int64_t key) {
    const int slot = find_slot(link, key);
    return slot < PM_INBOX_DEPTH ? &link->inbox[slot] : NULL;
}
