// Rings of a node's reports and states.
#include "net/member.h"

#include <string.h>

#include "net/channel.h"

static pm_status no_memory(const pm_member *member) {
    return pm_fail(PM_ENOMEM, "coordinator: out of memory for %s", member->subsystem->name);
}

static pm_status make_report(const pm_member *member, pm_arena *arena, portmet_report_t *report) {
    const size_t n = (size_t)member->nport;
    double *memory = pm_arena_array(arena, 4 * n, sizeof(double));
    if (memory == NULL) {
        return no_memory(member);
    }
    *report = (portmet_report_t){
        .step = -1,
        .nport = member->nport,
        .energy_flux = memory,
        .entropy_flux = memory + n,
        .energy_gross = memory + 2 * n,
        .entropy_gross = memory + 3 * n,
    };
    return PM_OK;
}

static pm_status make_state(const pm_member *member, pm_arena *arena, portmet_state_t *state) {
    const int nz = member->subsystem->layout.nz;
    double *z = pm_arena_array(arena, (size_t)nz, sizeof(double));
    if (z == NULL) {
        return no_memory(member);
    }
    *state = (portmet_state_t){.step = -1, .nz = nz, .z = z};
    return PM_OK;
}

// The ports that end at the subsystem, in the scene's order, then the world's ends of its loads: as
// its own reports list them.
static pm_status list_ports(pm_member *member, pm_arena *arena, const pm_scene *scene) {
    member->port = pm_arena_array(arena, 2 * (size_t)scene->nport, sizeof *member->port);
    if (member->port == NULL) {
        return no_memory(member);
    }
    for (int i = 0; i < 2 * scene->nport; ++i) {
        if (scene->port[i / 2].subsystem[i % 2] == member->subsystem_id) {
            member->port[member->nport++] = i;
        }
    }
    for (int i = 0, count = member->nport; i < count; ++i) {
        const int other = member->port[i] ^ 1;
        if (scene->port[other / 2].load[other % 2] >= 0) {
            member->port[member->nport++] = other;
        }
    }
    return PM_OK;
}

pm_status pm_member_init(pm_member *member, pm_arena *arena, const pm_scene *scene,
                         int subsystem_id, int depth) {
    member->subsystem_id = subsystem_id;
    member->subsystem = &scene->subsystem[subsystem_id];
    member->depth = depth;
    PM_TRY(pm_channel_subsystem(member->report_channel, scene, "REPORT", subsystem_id));
    PM_TRY(pm_channel_subsystem(member->state_channel, scene, "STATE", subsystem_id));
    PM_TRY(list_ports(member, arena, scene));
    member->report = pm_arena_array(arena, (size_t)depth, sizeof *member->report);
    member->state = pm_arena_array(arena, (size_t)depth, sizeof *member->state);
    if (member->report == NULL || member->state == NULL) {
        return no_memory(member);
    }
    PM_TRY(make_report(member, arena, &member->report_scratch));
    PM_TRY(make_state(member, arena, &member->state_scratch));
    for (int i = 0; i < depth; ++i) {
        PM_TRY(make_report(member, arena, &member->report[i]));
        PM_TRY(make_state(member, arena, &member->state[i]));
    }
    return PM_OK;
}

bool pm_member_has_report(const pm_member *member, int64_t step) {
    return member->report[step % member->depth].step == step;
}

bool pm_member_has_state(const pm_member *member, int64_t step) {
    return member->state[step % member->depth].step == step;
}

// In both, the ring takes the decoded arrays and leaves its own for the next message.

pm_drop pm_member_keep_report(pm_member *member) {
    const int64_t step = member->report_scratch.step;
    if (pm_member_has_report(member, step)) {
        return PM_DROP_REPEATED;
    }
    const portmet_report_t unused = member->report[step % member->depth];
    member->report[step % member->depth] = member->report_scratch;
    member->report_scratch = unused;
    return PM_KEEP;
}

pm_drop pm_member_keep_state(pm_member *member) {
    const int64_t step = member->state_scratch.step;
    if (pm_member_has_state(member, step)) {
        return PM_DROP_REPEATED;
    }
    const portmet_state_t unused = member->state[step % member->depth];
    member->state[step % member->depth] = member->state_scratch;
    member->state_scratch = unused;
    return PM_KEEP;
}

void pm_member_fill_sample(const pm_member *member, int64_t step, pm_sample *sample) {
    const portmet_report_t *r = &member->report[step % member->depth];
    const int i = member->subsystem_id;
    sample->energy[i] = r->energy;
    sample->entropy[i] = r->entropy;
    sample->bulk_energy[i] = r->bulk_energy;
    sample->bulk_entropy[i] = r->bulk_entropy;
    sample->bulk_gross[2 * i] = r->bulk_energy_gross;
    sample->bulk_gross[2 * i + 1] = r->bulk_entropy_gross;
    sample->evaluated[i] = (long)r->evaluated;
    sample->skipped[i] = (long)r->skipped;
    for (int j = 0; j < member->nport; ++j) {
        sample->flux[member->port[j] / 2][member->port[j] % 2] = (pm_flux){
            .energy = r->energy_flux[j],
            .entropy = r->entropy_flux[j],
            .energy_gross = r->energy_gross[j],
            .entropy_gross = r->entropy_gross[j],
        };
    }
    if (pm_member_has_state(member, step)) {
        const portmet_state_t *state = &member->state[step % member->depth];
        memcpy(sample->z + member->subsystem->first, state->z, (size_t)state->nz * sizeof(double));
    }
}
